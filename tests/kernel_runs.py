"""Runs trial kernels in processes of their own, as users' processes compile and load them."""

import os
import subprocess
import sys
from pathlib import Path

from featherfx.jit import code_cache

ROOT = Path(code_cache.__file__).parents[1]

TYPES = """
from typing import NamedTuple

import numpy as np


class Pair(NamedTuple):
    values: np.ndarray
    first: float
"""
KERNELS = """
from typing import NamedTuple

from featherfx.jit.compiled import kernel, shared_kernel


class Total(NamedTuple):
    result: float
    count: int


@kernel
def square(x):
    return x * x


@shared_kernel(Total)
def total(values, first):
    result = first
    for i in range(values.shape[0]):
        result += square(values[i])
    return Total(result, values.shape[0])


@kernel
def mean(pair):
    result, count = total(pair.values, pair.first)
    return result / count
"""
RUN = """
import numpy as np
from trial_kernels import mean, square, total
from TYPES import Pair

found = mean(Pair(np.arange(4.0), 2.0))
print(found, tuple(total(np.ones(3), 0.0)), square(3.0), end=" ")
print(sorted(k.__name__ for k in (mean, total, square) if k.compiled))
"""
ALL, NONE = "(3.0, 3) 9.0 ['mean', 'square', 'total']\n", "(3.0, 3) 9.0 []\n"


def run_in(folder, module, before, variables):
    """Runs RUN in a process of its own, with the kernels in a folder and the type that it calls
    them with in a module there; what it prints, and its stderr."""
    folder.mkdir(exist_ok=True)
    (folder / f"{module}.py").write_text(TYPES)
    (folder / "trial_kernels.py").write_text(KERNELS)
    paths = os.pathsep.join([str(folder), str(ROOT.parent)])
    done = subprocess.run(
        [sys.executable, "-c", before + RUN.replace("TYPES", module)],
        env=os.environ | {"PYTHONPATH": paths, "FEATHERFX_COMPILERS": "1"} | variables,
        capture_output=True,
        text=True,
        check=True,
    )
    return done.stdout.split(maxsplit=1), done.stderr


def flip(file):
    """Change a bit in the middle of a file."""
    content = bytearray(file.read_bytes())
    content[len(content) // 2] ^= 0x10
    file.write_bytes(content)
