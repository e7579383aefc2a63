"""A changed kernel file gives a new cache folder to all that call it, and to nothing else."""

from pathlib import Path

import pytest

from featherfx import compiled

ROOT = Path(compiled.__file__).parent


@pytest.fixture
def folder_after_change(monkeypatch, tmp_path):
    """Cache folders (before, after) of one kernel file when another one changes."""
    monkeypatch.setenv("FEATHERFX_CACHE", str(tmp_path))
    read = Path.read_bytes

    def folders(source, changed):
        compiled.cache_folder.cache_clear()
        before = compiled.cache_folder(ROOT / source)
        with monkeypatch.context() as patch:
            edited = ROOT / changed
            patch.setattr(
                Path, "read_bytes", lambda self: read(self) + (b"#" if self == edited else b"")
            )
            compiled.cache_folder.cache_clear()
            after = compiled.cache_folder(ROOT / source)
        compiled.cache_folder.cache_clear()
        return before, after

    return folders


@pytest.mark.parametrize(
    "changed", ["solver/step_kernels.py", "mechanics/vane_membrane_kernels.py"]
)
def test_a_kernel_that_is_called_counts(folder_after_change, changed):
    before, after = folder_after_change("solver/step_kernels.py", changed)
    assert before != after


def test_other_kernels_do_not_count(folder_after_change):
    before, after = folder_after_change(
        "usd/surface_kernels.py", "mechanics/vane_membrane_kernels.py"
    )
    assert before == after
