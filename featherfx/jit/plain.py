"""Kernels by numba's own ways, for versions of it whose inner classes are not known (compiled.py).

They compile slower, since each is turned into machine code at every level of calls, and anew by
every run: numba itself would not see that a file has changed whose functions a kernel calls.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numba

from featherfx.jit.lazy_import import import_all

# No "nnan" or "ninf": the solver's checks for values that are not finite must keep their meaning.
FAST_MATH = {"contract", "reassoc", "nsz", "arcp"}
OPTIONS: dict[str, Any] = {"nogil": True, "error_model": "numpy", "fastmath": FAST_MATH}


def kernel(function: Callable[..., Any]) -> Any:
    """Compile a function of arrays and scalars without Python objects."""
    import_all()
    return numba.njit(**OPTIONS)(function)


loop_kernel = kernel


def shared_kernel(returns: Any) -> Callable[[Callable[..., Any]], Any]:
    """As kernel."""
    return kernel


def compile_ahead(shared: Any, *arguments: Any) -> None:
    """Nobody else compiles here."""


def is_asked_for(shared: Any) -> bool:
    """There is nobody to ask."""
    return True
