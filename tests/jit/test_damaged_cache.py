"""Cache folders that are damaged, full, read-only, or open to others."""

import hashlib
import os
import shutil

import pytest
from kernel_runs import ALL, NONE, flip

from featherfx.files.folders import distrust, read_trusted
from featherfx.jit import code_cache


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


@pytest.mark.parametrize(
    "content",
    [b"", b"\x80\x04\x95", bytes(8), b"\xff" * 40, (2).to_bytes(8, "little") + b"[]machine"],
)
def test_sound_entries_of_another_form_count_as_missing(content):
    stored = hashlib.sha256(content).digest() + content
    assert code_cache._decode(stored, ("float64", "linux", "x86_64", "any")) is None


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
    (tmp_path / "home").mkdir(mode=0o700)
    assert run_kernels(tmp_path / "here")[1] == ALL
    own = tmp_path / "home/.featherfx/cache"
    assert f"others can write to {shared}" in run_kernels.stderr
    assert f"The cache is in {own} instead" in run_kernels.stderr
    assert run_kernels.stderr.count("InputWarning") == 1
    assert not list(shared.iterdir())
    assert own.stat().st_mode & 0o777 == own.parent.stat().st_mode & 0o777 == 0o700
    # who cannot trust a folder does not compile again
    assert run_kernels(tmp_path / "here")[1] == NONE
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
@pytest.mark.parametrize(
    ("lacks", "compiled"), [("", []), ("total", ["mean", "total"]), ("mean", ["mean"])]
)
def test_a_folder_that_can_only_be_read_is_loaded_from(
    run_kernels, tmp_path, compiled_once, lacks, compiled
):
    """What it lacks, and what calls that, is compiled, told once, and not kept."""
    shutil.copytree(compiled_once[1], tmp_path / "cache")
    for file in (tmp_path / "cache").rglob(f"*.{lacks}.*") if lacks else ():
        file.unlink()
    before = sorted((tmp_path / "cache").rglob("*"))
    value, rest = run_kernels(tmp_path / "here", before=READ_ONLY)
    assert (value, rest) == ("4.0", NONE.replace("[]", str(compiled)))
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


UMASK = "import os; os.umask(0o002)"


@needs_posix
def test_a_cache_made_under_a_mask_for_groups_is_used_again(run_kernels, tmp_path):
    """As in studios: what others of the group could write to would not be trusted."""
    assert run_kernels(tmp_path / "here", before=UMASK)[1] == ALL
    assert run_kernels(tmp_path / "here", before=UMASK)[1] == NONE
    assert not run_kernels.stderr
    for place in [tmp_path / "cache", *(tmp_path / "cache").rglob("*")]:
        assert not place.stat().st_mode & 0o022 or place.is_file()


def give(place, user=54321):
    try:
        os.chown(place, user, user, follow_symlinks=False)
    except PermissionError:
        pytest.skip("only root can give a folder away")


def link(place, other):
    """A link to what has been moved away."""
    place.rename(other)
    place.symlink_to(other)


# by name: what another user could have done below a root R/cache with an entry R/cache/sub/file,
# and whether the entry is loaded all the same
LAYOUTS = {
    "own": (lambda r: None, True),
    "root for group": (lambda r: (r / "cache").chmod(0o770), False),
    "root for all": (lambda r: (r / "cache").chmod(0o777), False),
    "root sticky": (lambda r: (r / "cache").chmod(0o1777), False),
    "root given": (lambda r: give(r / "cache"), False),
    "above for all": (lambda r: r.chmod(0o777), False),
    "above for group": (lambda r: r.chmod(0o775), False),
    "above sticky": (lambda r: r.chmod(0o1777), True),
    "above given": (lambda r: give(r), False),
    "folder for group": (lambda r: (r / "cache/sub").chmod(0o775), False),
    "folder for all": (lambda r: (r / "cache/sub").chmod(0o777), False),
    "folder sticky": (lambda r: (r / "cache/sub").chmod(0o1777), False),
    "folder given": (lambda r: give(r / "cache/sub"), False),
    "folder is a link": (lambda r: link(r / "cache/sub", r / "other"), False),
    "file for group": (lambda r: (r / "cache/sub/file").chmod(0o664), False),
    "file for all": (lambda r: (r / "cache/sub/file").chmod(0o666), False),
    "file given": (lambda r: give(r / "cache/sub/file"), False),
    "file is a link": (lambda r: link(r / "cache/sub/file", r / "other"), False),
    "root is an own link": (lambda r: link(r / "cache", r / "other"), True),
    "root is another's link": (
        lambda r: (link(r / "cache", r / "other"), give(r / "cache")),
        False,
    ),
    "link into an open folder": (
        lambda r: (
            (r / "open").mkdir(),
            (r / "open").chmod(0o777),
            link(r / "cache", r / "open/c"),
        ),
        False,
    ),
    "file is a pipe": (
        lambda r: ((r / "cache/sub/file").unlink(), os.mkfifo(r / "cache/sub/file")),
        False,
    ),
    "folder is missing": (lambda r: (r / "cache/sub").rename(r / "sub"), False),
    "read only": (lambda r: (r / "cache/sub").chmod(0o500), True),
}


@needs_posix
@pytest.mark.parametrize("name", LAYOUTS)
def test_what_others_can_change_is_not_loaded(tmp_path, monkeypatch, name):
    root = tmp_path / "above"
    (root / "cache/sub").mkdir(parents=True)
    root.chmod(0o755)
    file = root / "cache/sub/file"
    file.write_bytes(b"code")
    os.chown(file, -1, os.getegid())
    # a group that others are in
    monkeypatch.setattr("featherfx.files.folders._is_own_group", lambda group: False)
    change, is_loaded = LAYOUTS[name]
    change(root)
    if is_loaded:
        assert read_trusted(root / "cache", ("sub", "file")) == b"code"
    else:
        with pytest.raises(OSError, match=r"others can write|another user|\[Errno"):
            read_trusted(root / "cache", ("sub", "file"))
        monkeypatch.setenv("FEATHERFX_TRUSTED_CACHE", str(root / "cache"))
        if not any(word in name for word in ("missing", "pipe")):
            assert read_trusted(root / "cache", ("sub", "file")) == b"code"


@needs_posix
def test_links_without_end_are_an_error(tmp_path):
    (tmp_path / "a").symlink_to(tmp_path / "b")
    (tmp_path / "b").symlink_to(tmp_path / "a")
    with pytest.raises(OSError, match="symbolic links"):
        distrust(tmp_path / "a" / "cache")


@needs_posix
def test_a_folder_of_another_user_is_not_trusted(tmp_path):
    folder = tmp_path / "cache"
    folder.mkdir()
    try:
        os.chown(folder, 54321, 54321)
    except PermissionError:
        pytest.skip("only root can give a folder away")
    assert distrust(folder) == f"{folder} belongs to another user"
