"""The yardstick: one banded Cholesky factorisation by LAPACK, of the size of the nodal matrix."""

from __future__ import annotations

import os
import subprocess
import sys
from statistics import median
from time import thread_time

import numpy as np
from scipy.linalg.lapack import dpbtrf

_UNKNOWNS, _HALF_BANDWIDTH = 2583, 131
_REPEATS = 15
_THREAD_VARIABLES = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS")


def factorisation_seconds() -> float:
    """Median processor seconds of LAPACK's dpbtrf on the nodal hero's matrix, with one thread.

    Measured in a process of its own: a library that has started its threads keeps them.
    """
    done = subprocess.run(
        [sys.executable, "-m", __name__],
        env={**os.environ, **dict.fromkeys(_THREAD_VARIABLES, "1")},
        capture_output=True,
        text=True,
        check=True,
    )
    return float(done.stdout)


def _measured() -> float:
    random = np.random.default_rng(1)
    band = np.asfortranarray(random.uniform(-1.0, 1.0, (_HALF_BANDWIDTH + 1, _UNKNOWNS)))
    band[0] = 4.0 * _HALF_BANDWIDTH  # diagonally dominant, so that it is positive definite
    seconds = []
    for _ in range(_REPEATS):
        matrix = band.copy(order="F")
        begin = thread_time()
        _, info = dpbtrf(matrix, lower=1, overwrite_ab=1)
        seconds.append(thread_time() - begin)
        if info != 0:
            raise ArithmeticError(f"dpbtrf failed with info = {info}")
    return median(seconds)


if __name__ == "__main__":
    print(_measured())
