"""Where the machine code of kernels is kept between runs.

Kernels are cached in a folder whose name holds a hash of their file and of all files of this
program that it imports, because numba on its own only watches the file of the function that it was
asked for, not those of the functions that it calls. Nothing else about a file counts: installed
anew elsewhere, it finds its machine code. These folders are in $FEATHERFX_CACHE, else in the
system's own folder for caches of a user (on Linux $XDG_CACHE_HOME/featherfx, else
~/.cache/featherfx), else in one that is removed when the process ends. Folders that others can
write to are not used (files/trust.py), unless $FEATHERFX_TRUSTED_CACHE names them. What is there of
one that this user cannot write to is loaded; what it lacks is compiled by every run. What is in
them: stored.py.
"""

from __future__ import annotations

import atexit
import contextlib
import hashlib
import os
import re
import shutil
import sys
import tempfile
import warnings
from functools import cache
from pathlib import Path

from featherfx.errors import InputWarning
from featherfx.files.cache_folder import doubt, wanted_folder

ROOT = Path(__file__).resolve().parents[1]
# how kernels are compiled, and what is stored of them
COMPILER = tuple(
    ROOT / f"{name}.py"
    for name in (
        "algebra/lane_types",
        "jit/entry",
        "jit/struct_pointer",
        "jit/lowering",
        "jit/linking",
        "jit/plain",
        "jit/stored",
        "jit/thread_team_types",
        "jit/view_types",
    )
)


# of a file of this program, at the top of another; parsing 60 files takes 0.4 s of every run
_IMPORT = re.compile(rb"^from featherfx\.(\S+) import ", re.MULTILINE)


@cache
def _imported(source: Path) -> frozenset[Path]:
    """Files of this program that a kernel file imports, itself included: constants and the fields
    of named tuples are in its code, too."""
    found = {source}
    for name in _IMPORT.findall(source.read_bytes()):
        # COMPILER stands for how kernels are compiled; what they call of this room is their own
        if name != b"jit.compiled":
            place = ROOT / name.decode().replace(".", "/")
            found |= _imported(place / "__init__.py" if place.is_dir() else Path(f"{place}.py"))
    return frozenset(found)


@cache
def version_of(package: str) -> str:
    """Version of an installed package, without importing it, by the name of the folder that tells
    of it: importlib.metadata takes some MiB to read what is in it."""
    for place in sys.path:
        for found in Path(place or ".").glob(f"{package}-*.dist-info"):
            return found.name.removesuffix(".dist-info").partition("-")[2]
    from importlib.metadata import version

    return version(package)


def _digest(source: Path) -> str:
    """Short name of all that the machine code of a source file depends on."""
    digest = hashlib.sha256(" ".join(map(version_of, ("numba", "llvmlite"))).encode())
    for part in (*COMPILER, *sorted(_imported(source))):
        digest.update(part.read_bytes())
    return digest.hexdigest()[:16]


@cache
def _fault(folder: Path) -> str:
    """Why nothing can be loaded from a folder, made if need be; empty if it can."""
    try:
        if fault := doubt(folder):
            return fault
        folder.mkdir(parents=True, exist_ok=True, mode=0o700)
    except OSError as error:
        return f"{folder}: {error.strerror or error}"
    return "" if os.access(folder, os.R_OK | os.X_OK) else f"no permission to read {folder}"


def can_be_loaded(folder: Path) -> bool:
    """Whether machine code is loaded from a folder, where there is some."""
    return not _fault(folder)


@cache
def unkept() -> str:
    """Why what is compiled here is not kept, in words; empty if it is."""
    wanted = wanted_folder()
    if fault := _fault(wanted):
        return f"machine code is not kept, and is compiled anew by every run: {fault}"
    if os.access(wanted, os.W_OK):
        return ""
    return (
        f"no permission to write to {wanted}: machine code that it lacks is compiled by every run"
    )


@cache
def root_folder() -> Path:
    """Folder that holds the caches of all sources: the one asked for, else the user's own, else one
    for this process, with a warning that says why where nothing can be loaded from the other."""
    wanted = wanted_folder()
    if not unkept():
        return wanted
    folder = Path(tempfile.mkdtemp(prefix="featherfx-"))
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    if _fault(wanted):
        warnings.warn(unkept(), InputWarning, stacklevel=2)
    return folder


@cache
def cache_folder(source: Path) -> Path:
    """Folder of the compiled kernels of a source file. What is there of one that can only be read
    is linked into that of this process."""
    name, wanted = _digest(source), wanted_folder()
    folder = root_folder() / name
    if root_folder() != wanted and not _fault(wanted):
        with contextlib.suppress(OSError):
            folder.mkdir(mode=0o700)
            for file in (wanted / name).iterdir():
                (folder / file.name).symlink_to(file.absolute())
    return folder


def warn_if_unkept() -> None:
    """Tell once, where something is compiled, that it is not kept beside what is loaded."""
    if unkept() and can_be_loaded(wanted_folder()):
        warn_once(unkept())


@cache
def warn_once(message: str) -> None:
    """Warn of what every kernel would warn of."""
    warnings.warn(message, InputWarning, stacklevel=3)
