"""Folders of the program: shipped files, the cache, and whether a folder may be loaded from.

A folder is trusted if it and all folders above it, links followed and not, belong to this user or
to root, and nobody else can write there. A folder such as /tmp, where each may remove only what is
his own, may lie above one that is this user's. Whoever can write machine code there runs it as this
user.

The cache holds what may be made again: $FEATHERFX_CACHE, else the system's own folder of a user.
"""

from __future__ import annotations

import os
import stat
from collections.abc import Iterator
from pathlib import Path

import platformdirs

_PACKAGE = Path(__file__).resolve().parents[1]


def shipped(name: str) -> Path:
    """A folder of files that come with featherfx: within an installed package, or in a checkout."""
    inside = _PACKAGE / f"_{name}"
    return inside if inside.is_dir() else _PACKAGE.parent / name


def distrust(folder: Path) -> str:
    """Why a folder is not trusted, in words; empty if it is. Folders that are not there yet are
    judged by those above them. Raises OSError where one cannot be looked at."""
    if os.name == "nt":
        return ""  # the user's own folders are guarded by access lists
    for place in _way_to(folder):
        try:
            found = place.lstat()
        except FileNotFoundError:
            continue
        if stat.S_ISLNK(found.st_mode):
            continue  # a link is as safe as the folder that holds it
        if found.st_uid not in (0, os.geteuid()):
            return f"{place} belongs to another user"
        sticky = place != folder and found.st_mode & stat.S_ISVTX
        if _others_can_write(found) and not sticky:
            return f"others can write to {place}"
    return ""


def _way_to(folder: Path) -> Iterator[Path]:
    """A folder and those above it, as they are named and as they are."""
    for path in dict.fromkeys((Path(os.path.abspath(folder)), folder.resolve())):
        yield path
        yield from path.parents


def _others_can_write(found: os.stat_result) -> bool:
    if found.st_mode & stat.S_IWOTH:
        return True
    return bool(found.st_mode & stat.S_IWGRP) and not _is_own_group(found.st_gid)


def _is_own_group(group: int) -> bool:
    """Return whether a group is root's, or one that its only member is named after."""
    import grp
    import pwd

    try:
        user, entry = pwd.getpwuid(os.geteuid()).pw_name, grp.getgrgid(group)
    except KeyError:
        return False
    return group == 0 or (entry.gr_name == user and set(entry.gr_mem) <= {user})


def wanted_folder() -> Path:
    """The folder that is asked for; on Linux by default ~/.cache/featherfx."""
    asked = os.environ.get("FEATHERFX_CACHE")
    return Path(asked) if asked else platformdirs.user_cache_path("featherfx", appauthor=False)


def doubt(folder: Path) -> str:
    """Why nothing may be loaded from a folder, in words; empty if it is trusted (trust.py), or
    $FEATHERFX_TRUSTED_CACHE names it. Raises OSError where it cannot be looked at."""
    named = os.environ.get("FEATHERFX_TRUSTED_CACHE")
    fault = "" if named and Path(named) == folder else distrust(folder)
    return f"{fault}; FEATHERFX_TRUSTED_CACHE={folder} would trust it" if fault else ""
