"""What a bake takes, and that memory goes back to the system."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest
from places import SAMPLES

from featherfx.jit.code_cache import can_load

ALTERNATE = """
import numpy as np
from featherfx.baking.trial import resident_bytes
from featherfx.files.process import keep_arrays_apart
for _ in range(2):  # what is freed once is else kept from then on
    arrays = [np.ones(1_000_000) for _ in range(20)]
    if {apart}:
        keep_arrays_apart()
    before = resident_bytes()
    del arrays[::2]
    freed = before - resident_bytes()
print(freed)
"""


@pytest.mark.skipif(sys.platform != "linux", reason="asks the system's malloc")
def test_arrays_that_are_freed_between_others_go_back():
    # Dask sets some for workers, in tests before this one
    usual = {name: value for name, value in os.environ.items() if not name.startswith("MALLOC_")}
    freed = [
        int(
            subprocess.check_output(
                [sys.executable, "-c", ALTERNATE.format(apart=apart)], env=usual
            )
        )
        for apart in (False, True)
    ]
    assert freed[0] < 1e6
    assert freed[1] > 70e6


@pytest.mark.skipif(not can_load(), reason="LLVM loads machine code on this system")
def test_a_bake_whose_kernels_are_stored_does_without_what_compiles(tmp_path):
    """The first bake stores what is missing; the second one is small until it writes."""
    code = """
import sys
from featherfx.baking import pipeline
from featherfx.baking.trial import resident_bytes
found = []

def note(done, total):
    found.append(resident_bytes())
pipeline.bake(*sys.argv[1:], frames=(1, 2), jobs=1, on_frame=note)
print(found[1] / 2**20, {"numba", "llvmlite", "scipy.sparse"} & set(sys.modules))
"""
    for run in range(2):
        output = str(tmp_path / f"{run}.usdc")
        shot = str(SAMPLES / "feather_pull" / "shot.toml")
        done = subprocess.run(
            [sys.executable, "-c", code, shot, output], capture_output=True, text=True, check=True
        )
    size, loaded = done.stdout.split(maxsplit=1)
    assert loaded == "set()\n"
    assert float(size) < 170.0
