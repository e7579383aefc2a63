"""The decorators of all compiled kernels, which are compiled on first use.

How kernels share machine code and keep it (kernels.py, inner.py) rests on inner classes of numba,
which are known of the versions TRIED. With others they are compiled as numba does it (plain.py).
"""

from __future__ import annotations

import os
import sys
import warnings
from collections.abc import Callable
from typing import Any

from packaging.specifiers import SpecifierSet

from featherfx.errors import InputError, InputWarning, Problem
from featherfx.jit.cache import version_of
from featherfx.jit.kernels import Kernel

if os.environ.get("NUMBA_DISABLE_JIT", "").strip() not in ("", "0"):
    _DISABLED = "is set, but the solver works only as machine code; unset it"
    raise InputError(Problem("NUMBA_DISABLE_JIT", "", _DISABLED))

# as in pyproject.toml
TRIED = SpecifierSet(">=0.60,<0.69")


def _numba_version() -> str:
    """Its version, without importing it where nobody has."""
    if (numba := sys.modules.get("numba")) is not None:
        return str(numba.__version__)
    return version_of("numba")


def _kernel(function: Callable[..., Any]) -> Any:
    """Compile a function of arrays and scalars without Python objects, cached between runs.

    Kernels that call it get its code linked in.
    """
    return Kernel(function)


def _loop_kernel(function: Callable[..., Any]) -> Any:
    """As kernel, for short loops over arrays of which none that is written overlaps another.

    Else every such loop would begin with tests whether they do.
    """
    return Kernel(function, apart=True)


def _shared_kernel(returns: Any) -> Callable[[Callable[..., Any]], Any]:
    """As kernel, for large ones that several others call: they call its own machine code.

    returns: None, bool, int, float or a NamedTuple of these.
    """

    def declared(function: Callable[..., Any]) -> Any:
        return Kernel(function, returns)

    return declared


def _compile_ahead(shared: Any, *arguments: Any) -> None:
    """Have a shared kernel compiled by others that will be called with such arguments."""
    shared.compile_ahead(arguments)


def _is_asked_for(shared: Any) -> bool:
    """Whether others know a shared kernel already, for whatever types: called or compiled ahead."""
    return bool(shared.is_asked_for)


if TRIED.contains(_numba_version(), prereleases=True):
    kernel, loop_kernel, shared_kernel = _kernel, _loop_kernel, _shared_kernel
    compile_ahead, is_asked_for = _compile_ahead, _is_asked_for
else:
    from featherfx.jit.plain import (
        compile_ahead,
        is_asked_for,
        kernel,
        loop_kernel,
        shared_kernel,
    )

    _MESSAGE = (
        f"numba {_numba_version()} is none of {TRIED}: kernels are compiled anew by every run"
    )
    warnings.warn(_MESSAGE, InputWarning, stacklevel=2)

__all__ = ("compile_ahead", "is_asked_for", "kernel", "loop_kernel", "shared_kernel")
