"""Folders of the program: shipped files, presets, the cache, and what may be loaded from it.

Whoever can write machine code where it is loaded from runs it as this user. So a file is loaded
only if it, its folder and all folders above belong to this user or to root, and nobody else can
write there. The way is walked from the root of the file system by descriptors, links step by step,
and what is judged is what is read: nothing can be exchanged between. A folder such as /tmp, where
each may remove only what is his own, may lie above one that is this user's.

The cache holds what may be made again: $FEATHERFX_CACHE, else the system's own folder of a user.
Where others can write there, a private folder serves instead, unless $FEATHERFX_TRUSTED_CACHE names
it, too.
"""

from __future__ import annotations

import contextlib
import errno
import os
import stat
from collections.abc import Iterable, Sequence
from functools import cache
from pathlib import Path
from typing import BinaryIO

import platformdirs

from featherfx.errors import Problem, require, require_type, warn_input

_PACKAGE = Path(__file__).resolve().parents[1]
# links on a way, as Linux allows
_MAX_LINKS = 40
# a folder that may be passed need not be listed
_PASS = getattr(os, "O_PATH", 0) | getattr(os, "O_DIRECTORY", 0) | getattr(os, "O_NOFOLLOW", 0)
_READ = os.O_RDONLY | getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_NONBLOCK", 0)
# on Windows the user's own folders are guarded by access lists
_GUARDED = os.name != "nt"


class DistrustError(OSError):
    """A place that others can change, in words."""


def shipped(name: str) -> Path:
    """A folder of files that come with featherfx: within an installed package, or in a checkout."""
    inside = _PACKAGE / f"_{name}"
    return inside if inside.is_dir() else _PACKAGE.parent / name


def distrust(place: Path) -> str:
    """Why a folder or file is not trusted, in words; empty if it is. What is not there yet is
    judged by the folders above. Raises OSError where one cannot be looked at."""
    try:
        os.close(_walk(place))
    except DistrustError as fault:
        return str(fault)
    except (FileNotFoundError, NotADirectoryError):
        return ""
    return ""


def read_trusted(root: Path, parts: Sequence[str]) -> bytes:
    """Read a file below a root that is trusted.

    parts: names of folders below the root, and of the file; none of them may be a link. Raises
    DistrustError, and OSError where it cannot be read.
    """
    if not _GUARDED or _is_named(root):
        return root.joinpath(*parts).read_bytes()
    above, place = _walk(root), root
    try:
        for name in parts[:-1]:
            place = place / name
            above = _step(above, name)
            _judge(os.fstat(above), place, is_last=True)
        file = os.open(parts[-1], _READ, dir_fd=above)
    finally:
        os.close(above)
    with os.fdopen(file, "rb") as stream:
        found = os.fstat(file)
        if not stat.S_ISREG(found.st_mode):
            raise IsADirectoryError(errno.EISDIR, "is no file", str(place / parts[-1]))
        _judge(found, place / parts[-1], is_last=True)
        return stream.read()


def _walk(place: Path) -> int:
    """Return the descriptor of a place whose way is trusted.

    Raises DistrustError, and OSError where something on the way is missing or closed.
    """
    if not _GUARDED:
        return os.open(os.devnull, os.O_RDONLY)
    way, links = list(reversed(Path(os.path.abspath(place)).parts)), 0
    seen, here = Path(way.pop()), os.open("/", _PASS)
    try:
        _judge(os.fstat(here), seen, is_last=not way)
        while way:
            name = way.pop()
            found = os.stat(name, dir_fd=here, follow_symlinks=False)
            if stat.S_ISLNK(found.st_mode):
                # a link is as safe as the folder that holds it, but where each makes his own
                links += 1
                if links > _MAX_LINKS:
                    raise OSError(errno.ELOOP, os.strerror(errno.ELOOP), str(place))
                _judge_owner(found, seen / name)
                target = Path(os.readlink(name, dir_fd=here))
                parts = list(target.parts)
                if target.is_absolute():
                    seen, here = Path(parts.pop(0)), _exchange(here, os.open("/", _PASS))
                way += reversed(parts)
                continue
            here, seen = _step(here, name, is_last=not way), seen / name
            _judge(os.fstat(here), seen, is_last=not way)
    except BaseException:
        os.close(here)
        raise
    return here


def _step(above: int, name: str, is_last: bool = False) -> int:
    """Open what is in a folder, and close the folder."""
    flags = _PASS & ~getattr(os, "O_DIRECTORY", 0) if is_last else _PASS
    return _exchange(above, os.open(name, flags, dir_fd=above))


def _exchange(before: int, after: int) -> int:
    os.close(before)
    return after


def _judge(found: os.stat_result, place: Path, is_last: bool) -> None:
    _judge_owner(found, place)
    sticky = not is_last and found.st_mode & stat.S_ISVTX
    if _others_can_write(found) and not sticky:
        raise DistrustError(f"others can write to {place}")


def _judge_owner(found: os.stat_result, place: Path) -> None:
    if found.st_uid not in (0, os.geteuid()):
        raise DistrustError(f"{place} belongs to another user")


def _others_can_write(found: os.stat_result) -> bool:
    if found.st_mode & stat.S_IWOTH:
        return True
    return bool(found.st_mode & stat.S_IWGRP) and not _is_own_group(found.st_gid)


def _is_own_group(group: int) -> bool:
    """Return whether a group's only member is named as it is. Root's never is: in some containers
    it is everybody's."""
    import grp
    import pwd

    try:
        user, entry = pwd.getpwuid(os.geteuid()).pw_name, grp.getgrgid(group)
    except KeyError:
        return False
    return group != 0 and entry.gr_name == user and set(entry.gr_mem) <= {user}


def make_private_folder(folder: Path) -> None:
    """Make a folder and those above it that are missing, closed to others. Raises OSError."""
    if not folder.is_dir():
        make_private_folder(folder.parent)
        with contextlib.suppress(FileExistsError):
            folder.mkdir(mode=0o700)


def write_private(stream: BinaryIO, *parts: bytes | memoryview) -> None:
    """Write a file that others may read, but not change, whatever the mask of new files is."""
    if _GUARDED:
        os.fchmod(stream.fileno(), os.fstat(stream.fileno()).st_mode & 0o755)
    for part in parts:
        stream.write(part)


def wanted_folder() -> Path:
    """The folder that is asked for; on Linux by default ~/.cache/featherfx."""
    asked = os.environ.get("FEATHERFX_CACHE")
    return Path(asked) if asked else platformdirs.user_cache_path("featherfx", appauthor=False)


def cache_folder() -> Path:
    """The folder of the cache: the one that is asked for, or a private one where others can write
    to that, which is told once. Raises OSError where it cannot be looked at."""
    return _choose_folder(wanted_folder(), os.environ.get("FEATHERFX_TRUSTED_CACHE", ""))


@cache
def _choose_folder(wanted: Path, trusted: str) -> Path:
    fault = doubt(wanted)
    if not fault:
        return wanted
    # folders for what others must not change, the best first
    own = f"featherfx-{os.geteuid()}" if _GUARDED else "featherfx"
    for other in [Path(os.path.expanduser("~")) / ".featherfx" / "cache", Path("/var/tmp") / own]:
        with contextlib.suppress(OSError, RuntimeError):
            if not distrust(other):
                make_private_folder(other)
                message = f"{fault}. The cache is in {other} instead"
                warn_input(message)
                return other
    return wanted


def _is_named(folder: Path) -> bool:
    """Return whether the user trusts a folder, or one above it, by name."""
    named = os.environ.get("FEATHERFX_TRUSTED_CACHE")
    return bool(named) and Path(str(named)) in (folder, *folder.parents)


def doubt(folder: Path) -> str:
    """Why nothing may be loaded from a folder, in words; empty if it is trusted, or
    $FEATHERFX_TRUSTED_CACHE names it. Raises OSError where it cannot be looked at."""
    fault = "" if _is_named(folder) else distrust(folder)
    return f"{fault}; FEATHERFX_TRUSTED_CACHE={folder} would trust it" if fault else ""


_PRESETS_VARIABLE = "FEATHERFX_PRESETS"
# stands for the folder of shipped presets among folders that are given
SHIPPED_PRESETS = "shipped"


def shipped_folder() -> Path:
    """The presets that come with featherfx."""
    return shipped("presets")


def folders_of(preset_folders: Iterable[str | Path]) -> tuple[str | Path, ...]:
    """Return folders of presets. Raises TypeError for one path, InputError for those not there."""
    listed = not isinstance(preset_folders, str | Path)
    require_type("preset_folders", preset_folders, Iterable if listed else (), "a list of folders")
    found = tuple(preset_folders)
    told = "there is no such folder. Check the path"
    lacking = (each for each in found if each != SHIPPED_PRESETS and not Path(each).is_dir())
    require(*(Problem(str(each), "", told) for each in lacking))
    return found


def search_path(folders: Iterable[str | Path] = ()) -> tuple[Path, ...]:
    """Folders of presets, the strongest first: given ones, FEATHERFX_PRESETS, home, shipped.

    folders: SHIPPED among them is the folder of shipped presets; what comes after it matters no
    more.
    """
    listed = [shipped_folder() if folder == SHIPPED_PRESETS else Path(folder) for folder in folders]
    variable = os.environ.get(_PRESETS_VARIABLE, "")
    listed += [Path(part) for part in variable.split(os.pathsep) if part]
    home = os.environ.get("XDG_CONFIG_HOME") or str(Path("~/.config").expanduser())
    return (*listed, Path(home) / "featherfx" / "presets", shipped_folder())


def own_folders(folders: Iterable[str | Path] = ()) -> tuple[Path, ...]:
    """Folders of the search path that are there and are not the shipped ones, absolute."""
    found = [Path(os.path.abspath(folder)) for folder in search_path(folders) if folder.is_dir()]
    shipped = Path(os.path.abspath(shipped_folder()))
    return tuple(dict.fromkeys(folder for folder in found if folder != shipped))
