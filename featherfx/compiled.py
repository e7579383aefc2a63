"""The one decorator of all compiled kernels, and where their machine code is kept.

Kernels are compiled on first use and cached in a folder whose name holds a hash of every kernel's
source, because numba on its own only watches the file of the function that it was asked for, not
those of the functions that it calls. The folder is $FEATHERFX_CACHE, else
$XDG_CACHE_HOME/featherfx, else ~/.cache/featherfx, else a folder of the system's temporary ones.
"""

from __future__ import annotations

import hashlib
import os
import tempfile
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import numba
from numba import njit

# No "nnan" or "ninf": the solver's checks for values that are not finite must keep their meaning.
FAST_MATH = {"contract", "reassoc", "nsz", "arcp"}


@cache
def cache_folder() -> Path:
    """Folder of the compiled kernels; made if it is not there."""
    digest = hashlib.sha256(numba.__version__.encode())
    for source in sorted(Path(__file__).parent.rglob("*_kernels.py")):
        digest.update(source.read_bytes())
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
    config.CACHE_DIR = str(cache_folder())
    try:
        # kernels allocate nothing, so counting references to arrays would only cost time
        return compile_cached(
            cache=True, nogil=True, _nrt=False, error_model="numpy", fastmath=FAST_MATH
        )(function)
    finally:
        config.CACHE_DIR = before
