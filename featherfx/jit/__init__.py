"""Compiled kernels and where their machine code is kept."""

import os

from featherfx.errors import InputError, Problem

if os.environ.get("NUMBA_DISABLE_JIT", "").strip() not in ("", "0"):
    _MESSAGE = "is set, but the solver works only as machine code; unset it"
    raise InputError(Problem("NUMBA_DISABLE_JIT", "", _MESSAGE))

# tells of whatever is compiled from here on
from featherfx.jit import told as told
