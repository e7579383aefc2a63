"""Cache folders that are damaged, full, read-only, or open to others."""

import os
import shutil
import tempfile
from pathlib import Path

import pytest
from kernel_runs import ALL, NONE, flip

from featherfx.files.folders import distrust


def cut(file):
    file.write_bytes(file.read_bytes()[:-100])


def empty(file):
    file.write_bytes(b"")


def other(file):
    """Sound, but of another kernel."""
    sizes = {each: each.stat().st_size for each in file.parent.iterdir()}
    file.write_bytes(max(sizes, key=sizes.get).read_bytes())


def folder_instead(file):
    file.unlink()
    file.mkdir()


@pytest.mark.parametrize(
    "damage",
    [
        pytest.param(cut, marks=pytest.mark.slow),
        flip,
        pytest.param(empty, marks=pytest.mark.slow),
        pytest.param(other, marks=pytest.mark.slow),
    ],
)
def test_damaged_machine_code_is_compiled_anew(run_kernels, tmp_path, compiled_once, damage):
    shutil.copytree(compiled_once[1], tmp_path / "cache")
    for file in sorted((tmp_path / "cache").rglob("*.code"))[1:]:
        damage(file)
    healed = run_kernels(tmp_path / "here")
    assert healed[0] == "4.0"
    assert healed[1] != NONE
    assert run_kernels(tmp_path / "here") == ["4.0", NONE]
    assert not run_kernels.stderr


@pytest.mark.slow
def test_a_folder_in_the_place_of_an_entry_does_not_stop_the_work(run_kernels, tmp_path):
    run_kernels(tmp_path / "here")
    for file in (tmp_path / "cache").rglob("*.code"):
        folder_instead(file)
    assert run_kernels(tmp_path / "here")[1] == ALL
    assert run_kernels.stderr.count("InputWarning") == 1


FULL_DISK = """
import resource, signal
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
resource.setrlimit(resource.RLIMIT_FSIZE, (1000, 1000))
"""


def test_a_full_disk_is_named_and_the_work_goes_on(run_kernels, tmp_path):
    assert run_kernels(tmp_path / "here", before=FULL_DISK)[0] == "4.0"
    assert run_kernels.stderr.count("InputWarning") == 1
    assert str(tmp_path / "cache") in run_kernels.stderr
    assert not list((tmp_path / "cache").rglob("*.*"))


needs_posix = pytest.mark.skipif(os.name == "nt", reason="modes of files are POSIX")


@needs_posix
def test_a_folder_that_others_can_write_to_is_not_used(run_kernels, tmp_path, compiled_once):
    shared = tmp_path / "cache"
    shared.mkdir()
    shared.chmod(0o777)
    before = set(Path(tempfile.gettempdir()).glob("featherfx-*"))
    assert run_kernels(tmp_path / "here")[1] == ALL
    assert "others can write to" in run_kernels.stderr
    assert run_kernels.stderr.count("InputWarning") == 1
    assert not list(shared.iterdir())
    # nothing is left of the folder that was used instead
    assert set(Path(tempfile.gettempdir()).glob("featherfx-*")) <= before
    trusted = {"FEATHERFX_TRUSTED_CACHE": str(shared)}
    shutil.copytree(compiled_once[1], shared, dirs_exist_ok=True)
    shared.chmod(0o777)
    assert run_kernels(tmp_path / "here", **trusted)[1] == NONE


READ_ONLY = """
import os
access = os.access
os.access = lambda path, mode, **how: mode != os.W_OK and access(path, mode, **how)
"""


@needs_posix
@pytest.mark.parametrize("lacks", ["", "total", "mean"])
def test_a_folder_that_can_only_be_read_is_loaded_from(run_kernels, tmp_path, compiled_once, lacks):
    """What it lacks is compiled, told once, and not kept."""
    shutil.copytree(compiled_once[1], tmp_path / "cache")
    for file in (tmp_path / "cache").rglob(f"*.{lacks}-*") if lacks else ():
        file.unlink()
    before = sorted((tmp_path / "cache").rglob("*"))
    value, rest = run_kernels(tmp_path / "here", before=READ_ONLY)
    assert (value, rest) == ("4.0", NONE.replace("[]", f"['{lacks}']" if lacks else "[]"))
    assert run_kernels.stderr.count("no permission to write to") == bool(lacks)
    assert sorted((tmp_path / "cache").rglob("*")) == before


@needs_posix
def test_who_may_write_above_a_folder_counts(tmp_path):
    folder = tmp_path / "above" / "cache"
    folder.mkdir(parents=True)
    assert distrust(folder) == ""
    folder.parent.chmod(0o777)
    assert str(folder.parent) in distrust(folder)
    assert str(folder.parent) in distrust(folder / "not" / "yet")
    # where all may make files but remove only their own, as in /tmp
    folder.parent.chmod(0o1777)
    assert distrust(folder) == ""
    link = tmp_path / "link"
    link.symlink_to(folder)
    folder.parent.chmod(0o777)
    assert str(folder.parent) in distrust(link)
    folder.parent.chmod(0o755)
    assert distrust(link) == ""


@needs_posix
def test_a_folder_of_another_user_is_not_trusted(tmp_path):
    folder = tmp_path / "cache"
    folder.mkdir()
    try:
        os.chown(folder, 54321, 54321)
    except PermissionError:
        pytest.skip("only root can give a folder away")
    assert distrust(folder) == f"{folder} belongs to another user"
