"""Machine code that comes with the program."""

import shutil

import pytest
from kernel_runs import ALL, NONE, flip, run_in

from featherfx.jit import code_cache

SHIPPED = """
from pathlib import Path
from featherfx.jit import code_cache
code_cache.SHIPPED = Path(FOLDER)
"""


@pytest.fixture(scope="module")
def shipped_code(tmp_path_factory):
    """What a machine that builds wheels has compiled, for a common processor."""
    if not code_cache.find_target():
        pytest.skip("no machine code is shipped for this processor")
    folder = tmp_path_factory.mktemp("shipped")
    for_it = {"NUMBA_CPU_NAME": code_cache.find_target(), "NUMBA_CPU_FEATURES": ""}
    run_in(folder / "here", "trial_types", "", for_it | {"FEATHERFX_CACHE": str(folder / "code")})
    return folder / "code"


def test_machine_code_that_came_with_the_program_is_loaded(run_kernels, tmp_path, shipped_code):
    before = SHIPPED.replace("FOLDER)", f"{str(shipped_code)!r})")
    assert run_kernels(tmp_path / "here", before=before) == ["4.0", NONE]
    assert not list((tmp_path / "cache").rglob("*.code"))
    # not for a processor that it may not be for
    other = {"NUMBA_CPU_NAME": "x86-64-v2", "NUMBA_CPU_FEATURES": ""}
    assert run_kernels(tmp_path / "here", before=before, **other) == ["4.0", ALL]


@pytest.mark.parametrize(
    "harm",
    [
        pytest.param(flip, marks=pytest.mark.slow),
        pytest.param(lambda file: file.chmod(0o666), id="open"),
    ],
)
def test_shipped_code_that_was_changed_or_could_be_is_not_loaded(
    run_kernels, tmp_path, shipped_code, harm
):
    folder = shutil.copytree(shipped_code, tmp_path / "code")
    for file in folder.rglob("*.code"):
        harm(file)
    before = SHIPPED.replace("FOLDER)", f"{str(folder)!r})")
    assert run_kernels(tmp_path / "here", before=before) == ["4.0", ALL]
    assert run_kernels.stderr.count("InputWarning") == (harm is not flip)
