"""The decorators of all compiled kernels, which are compiled on first use.

How kernels share machine code and keep it (inner.py) rests on inner classes of numba, which are
known of the versions TRIED. With others they are compiled as numba does it (plain.py).
"""

from __future__ import annotations

import warnings

import numba
from packaging.specifiers import SpecifierSet

from featherfx.errors import InputWarning

# as in pyproject.toml
TRIED = SpecifierSet(">=0.60,<0.69")

if TRIED.contains(numba.__version__, prereleases=True):
    from featherfx.jit.inner import (
        compile_ahead,
        is_asked_for,
        kernel,
        loop_kernel,
        shared_kernel,
    )
else:
    from featherfx.jit.plain import (
        compile_ahead,
        is_asked_for,
        kernel,
        loop_kernel,
        shared_kernel,
    )

    _MESSAGE = (
        f"numba {numba.__version__} is none of {TRIED}: kernels are compiled anew by every run"
    )
    warnings.warn(_MESSAGE, InputWarning, stacklevel=2)

__all__ = ("compile_ahead", "is_asked_for", "kernel", "loop_kernel", "shared_kernel")
