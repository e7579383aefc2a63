"""Memory goes back to the system."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest

ALTERNATE = """
import numpy as np
from featherfx.baking.bake import resident_bytes
from featherfx.files.memory import keep_arrays_apart
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
