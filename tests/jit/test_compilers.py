"""Worker processes that compile kernels."""

import os
import subprocess
import sys
from collections import Counter
from pathlib import Path

import pytest
from kernel_runs import ALL

from featherfx.errors import InputError
from featherfx.jit.compile_workers import count_compilers

ELSEWHERE = """
import time
from featherfx.jit import compile_workers
BREAK
import trial_kernels
trial_kernels.total.request("<f8:1C, float64")
time.sleep(0.5)
"""


@pytest.mark.parametrize(
    "broken",
    [
        "compile_workers.SERVE = 'import sys; sys.exit(1)'",
        pytest.param("import sys; sys.executable = '/none'", marks=pytest.mark.slow),
    ],
)
def test_where_helpers_end_all_is_compiled_here(run_kernels, tmp_path, broken):
    before = ELSEWHERE.replace("BREAK", broken)
    assert run_kernels(tmp_path / "here", before=before, FEATHERFX_COMPILERS="3") == ["4.0", ALL]


WAITED = """
import sys, time
import numpy as np
import trial_kernels
from featherfx.phases import Account

trial_kernels.total.request("<f8:1C, float64")
time.sleep(0.3)  # a helper has taken it up
told = []
with Account(told.append) as own:
    trial_kernels.total(np.ones(3), 0.0)
    share = own.spent("compiling") / own.elapsed
known = [each.left for each in told if each.left is not None]
print(share > 0.3, len(known) > 0, all(left >= 0.0 for left in known), file=sys.stderr)
"""


def test_a_helper_compiles_what_is_needed_later_and_waiting_for_it_is_told(run_kernels, tmp_path):
    found = run_kernels(tmp_path / "here", before=WAITED, FEATHERFX_COMPILERS="2")
    assert found == ["4.0", "(3.0, 3) 9.0 ['mean', 'square']\n"]
    assert run_kernels.stderr == "True True True\n"


def test_what_a_shared_kernel_returns_is_what_it_declares(run_kernels, tmp_path):
    wrong = """
from typing import NamedTuple
import trial_kernels
Other = NamedTuple("Other", [("result", float), ("count", float)])
trial_kernels.total.returns = Other
"""
    with pytest.raises(subprocess.CalledProcessError) as error:
        run_kernels(tmp_path / "here", before=wrong)
    assert "total returns Total(" in error.value.stderr
    assert "declared: Other(" in error.value.stderr


@pytest.mark.nightly
def test_what_is_compiled_ahead_of_a_bake_is_what_it_needs(tmp_path):
    """No step is compiled again for the feathers of the shot, so that nothing was asked in vain."""
    shot = Path(__file__).parents[2] / "samples" / "breeze" / "shot.toml"
    command = [sys.executable, "-m", "featherfx", "bake", str(shot), "--frames", "1-2", "-o"]
    variables = os.environ | {"FEATHERFX_CACHE": str(tmp_path / "code")}
    subprocess.run([*command, str(tmp_path / "a.usdc")], env=variables, check=True)
    stored = [each.name.split(".")[1] for each in (tmp_path / "code").rglob("*.code")]
    assert {"advance_feathers", "settle_feathers"} <= set(stored)
    assert max(Counter(stored).values()) == 1


@pytest.mark.parametrize("given", ["0", "65", "two", "-1"])
def test_a_number_of_compilers_that_cannot_be_is_named(monkeypatch, given):
    monkeypatch.setenv("FEATHERFX_COMPILERS", given)
    with pytest.raises(InputError, match=f"FEATHERFX_COMPILERS.*'{given}'.*1 to 64"):
        count_compilers()
