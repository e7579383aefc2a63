"""The one decorator of all compiled kernels, and where their machine code is kept.

Kernels are compiled on first use and cached in a folder whose name holds a hash of their file and
of all kernel files that it imports, because numba on its own only watches the file of the function
that it was asked for, not those of the functions that it calls. The folder is in $FEATHERFX_CACHE,
else in $XDG_CACHE_HOME/featherfx, else in ~/.cache/featherfx, else in one of the system's temporary
ones.
"""

from __future__ import annotations

import ast
import hashlib
import inspect
import os
import tempfile
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import numba
from numba import njit

ROOT = Path(__file__).resolve().parent
# No "nnan" or "ninf": the solver's checks for values that are not finite must keep their meaning.
FAST_MATH = {"contract", "reassoc", "nsz", "arcp"}


@cache
def _imported(source: Path) -> frozenset[Path]:
    """Kernel files that a kernel file imports, itself included."""
    found = {source}
    for node in ast.parse(source.read_bytes()).body:
        if isinstance(node, ast.ImportFrom) and (node.module or "").endswith("_kernels"):
            name = str(node.module).removeprefix("featherfx.").replace(".", "/")
            found |= _imported(ROOT / f"{name}.py")
    return frozenset(found)


@cache
def cache_folder(source: Path) -> Path:
    """Folder of the compiled kernels of a source file; made if it is not there."""
    digest = hashlib.sha256(numba.__version__.encode())
    for part in sorted(_imported(source)):
        digest.update(part.read_bytes())
    name = digest.hexdigest()[:16]
    candidates = [
        os.environ.get("FEATHERFX_CACHE"),
        Path(os.environ.get("XDG_CACHE_HOME") or Path("~/.cache").expanduser()) / "featherfx",
        Path(tempfile.gettempdir()) / "featherfx",
    ]
    for candidate in candidates:
        if not candidate:
            continue
        folder = Path(candidate) / name
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except OSError:
            continue
        if os.access(folder, os.W_OK):
            return folder
    return Path(tempfile.mkdtemp(prefix="featherfx-"))


def kernel(function: Callable[..., Any]) -> Any:
    """Compile a function of arrays and scalars without Python objects, cached between runs."""
    config: Any = numba.config
    compile_cached: Any = njit
    before = config.CACHE_DIR
    config.CACHE_DIR = str(cache_folder(Path(inspect.getfile(function)).resolve()))
    try:
        # kernels allocate nothing, so counting references to arrays would only cost time
        return compile_cached(
            cache=True, nogil=True, _nrt=False, error_model="numpy", fastmath=FAST_MATH
        )(function)
    finally:
        config.CACHE_DIR = before
