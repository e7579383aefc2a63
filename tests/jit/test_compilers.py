"""Who compiles kernels: helpers, or a numba of unknown inner classes."""

import subprocess
import sys
import tomllib

import pytest
from kernel_runs import ALL, ROOT
from packaging.specifiers import SpecifierSet

from featherfx.errors import InputError
from featherfx.jit.compile_workers import compilers
from featherfx.jit.compiled import TRIED


def test_a_numba_of_unknown_inner_classes_compiles_as_it_does(run_kernels, tmp_path):
    """Slower, and nothing is kept; it is said once."""
    before = "import numba; numba.__version__ = '99.0'"
    assert run_kernels(tmp_path / "here", before=before) == ["4.0", ALL]
    assert run_kernels.stderr.count("InputWarning: numba 99.0 is none of") == 1
    assert not list((tmp_path / "cache").rglob("*.code"))
    project = tomllib.loads((ROOT.parent / "pyproject.toml").read_text())["project"]
    (bound,) = (each for each in project["dependencies"] if each.startswith("numba"))
    assert SpecifierSet(bound.removeprefix("numba")) == TRIED


BY_NUMBA = """
import numba
numba.__version__ = "99.0"
import numpy as np
from typing import NamedTuple
from featherfx.algebra.lanes import load, put
from featherfx.jit.compiled import kernel
from featherfx.jit.views import shaped, viewed, views_of


class Line(NamedTuple):
    values: np.ndarray


@kernel
def double(views):
    values = shaped(viewed(views, 0).values, (4,))
    put(values, 0, 2.0 * load(values, 0))


held = views_of([Line(np.arange(4.0).reshape(2, 2))])
double(held.views)
print(held.tuples[0].values.tolist())
"""


def test_what_kernels_have_of_their_own_is_known_to_such_a_numba():
    done = subprocess.run(
        [sys.executable, "-c", BY_NUMBA], capture_output=True, text=True, check=True
    )
    assert done.stdout == "[[0.0, 2.0], [4.0, 6.0]]\n"


ELSEWHERE = """
import threading
from featherfx.jit import compile_workers
BREAK
done = threading.Event()
compile_workers.LISTENERS.append(lambda need: done.set())
import trial_kernels
from featherfx.jit.compiled import compile_ahead
compile_ahead(trial_kernels.total, __import__("numpy").ones(3), 0.0)
done.wait(0.5)
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
from featherfx.jit.compiled import compile_ahead
from featherfx.phases import Account

compile_ahead(trial_kernels.total, np.ones(3), 0.0)
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


@pytest.mark.parametrize("given", ["0", "65", "two", "-1"])
def test_a_number_of_compilers_that_cannot_be_is_named(monkeypatch, given):
    monkeypatch.setenv("FEATHERFX_COMPILERS", given)
    with pytest.raises(InputError, match=f"FEATHERFX_COMPILERS.*'{given}'.*1 to 64"):
        compilers()
