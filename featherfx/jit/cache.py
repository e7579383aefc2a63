"""Where the machine code of kernels is kept between runs.

Kernels are cached in a folder whose name holds a hash of their file and of all files of this
program that it imports, because numba on its own only watches the file of the function that it was
asked for, not those of the functions that it calls. Nothing else about a file counts: installed
anew elsewhere, it finds its machine code. These folders are in $FEATHERFX_CACHE, else in the
system's own folder for caches of a user (on Linux $XDG_CACHE_HOME/featherfx, else
~/.cache/featherfx), else in one that is removed when the process ends. Folders that others can
write to are not used (files/trust.py), unless $FEATHERFX_TRUSTED_CACHE names them. What is in them:
stored.py.
"""

from __future__ import annotations

import atexit
import hashlib
import os
import re
import shutil
import tempfile
import warnings
from functools import cache
from pathlib import Path

import llvmlite
import numba

from featherfx.errors import InputWarning
from featherfx.files.cache_folder import doubt, wanted_folder

ROOT = Path(__file__).resolve().parents[1]
# how kernels are compiled, and what is stored of them
COMPILER = tuple(
    ROOT / "jit" / f"{name}.py" for name in ("plain", "inner", "lowering", "parts", "stored")
)


# of a file of this program, at the top of another; parsing 60 files takes 0.4 s of every run
_IMPORT = re.compile(rb"^from featherfx\.(\S+) import ", re.MULTILINE)


@cache
def _imported(source: Path) -> frozenset[Path]:
    """Files of this program that a kernel file imports, itself included: constants and the fields
    of named tuples are in its code, too."""
    found = {source}
    for name in _IMPORT.findall(source.read_bytes()):
        # COMPILER stands for how kernels are compiled
        if not name.startswith(b"jit."):
            found |= _imported(ROOT / f"{name.decode().replace('.', '/')}.py")
    return frozenset(found)


def _digest(source: Path) -> str:
    """Short name of all that the machine code of a source file depends on."""
    digest = hashlib.sha256(f"{numba.__version__} {llvmlite.__version__}".encode())
    for part in (*COMPILER, *sorted(_imported(source))):
        digest.update(part.read_bytes())
    return digest.hexdigest()[:16]


@cache
def _fault(folder: Path) -> str:
    """Why a folder, made if need be, cannot hold machine code; empty if it can."""
    try:
        if fault := doubt(folder):
            return fault
        folder.mkdir(parents=True, exist_ok=True, mode=0o700)
    except OSError as error:
        return f"{folder}: {error.strerror or error}"
    return "" if os.access(folder, os.W_OK) else f"no permission to write to {folder}"


@cache
def root_folder() -> Path:
    """Folder that holds the caches of all sources: the one asked for, else the user's own, else one
    for this process, with a warning that says why."""
    wanted = wanted_folder()
    fault = _fault(wanted)
    if not fault:
        return wanted
    folder = Path(tempfile.mkdtemp(prefix="featherfx-"))
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    warnings.warn(
        f"machine code is not kept, and is compiled anew by every run: {fault}",
        InputWarning,
        stacklevel=2,
    )
    return folder


@cache
def cache_folder(source: Path) -> Path:
    """Folder of the compiled kernels of a source file."""
    return root_folder() / _digest(source)


@cache
def warn_once(message: str) -> None:
    """Warn of what every kernel would warn of."""
    warnings.warn(message, InputWarning, stacklevel=3)
