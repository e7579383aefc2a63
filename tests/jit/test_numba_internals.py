"""Numba's inner classes: each that the program touches is where docs/development.md has it."""

import ast
import importlib
import inspect
import json
import re
from typing import Any, NamedTuple

import numpy as np
import pytest
from kernel_runs import ROOT
from numba.core import types

from featherfx.jit.compile_workers import SECONDS
from featherfx.jit.compiled import kernel, shared_kernel
from featherfx.jit.kernel_calls import find_kernel

_LINE = re.compile(r"^\| `(numba[\w.]+)` \| (.+?) \| .+ \|$", re.MULTILINE)
_TEXT = (ROOT.parent / "docs" / "development.md").read_text(encoding="utf-8")
TOUCHED = {name: re.findall(r"`(\w+)`", members) for name, members in _LINE.findall(_TEXT)}
FILES = ("jit/compiler.py", "jit/kernel_types.py", "algebra/intrinsics.py")


def find(name):
    """A module, or a name within one."""
    try:
        return importlib.import_module(name)
    except ImportError:
        module, _, own = name.rpartition(".")
        return getattr(importlib.import_module(module), own)


@pytest.mark.parametrize("name", TOUCHED)
def test_numba_has_what_is_touched(name):
    owner = find(name)
    kinds = inspect.getmro(owner) if inspect.isclass(owner) else ()
    for member in TOUCHED[name]:
        # attributes of instances stand in the source of their classes
        assigned = (f"self.{member} = " in inspect.getsource(k) for k in kinds if k is not object)
        assert hasattr(owner, member) or any(assigned), f"{name} has no {member}"


def imported_names(file):
    """Names that a file imports from numba, as far as they are not for extensions."""
    for node in ast.walk(ast.parse((ROOT / file).read_text())):
        module = getattr(node, "module", None) or ""
        if module.startswith("numba.") and module != "numba.extending":
            yield from (f"{module}.{each.name}" for each in node.names)


@pytest.mark.parametrize("file", FILES)
def test_every_name_of_numba_is_listed(file):
    listed = {f"{name}.{member}" for name, members in TOUCHED.items() for member in members}
    assert set(imported_names(file)) - listed - set(TOUCHED) == set()


def test_predicted_seconds_are_of_kernels_that_there_are():
    for kernels in json.loads(SECONDS.read_text()).values():
        assert all(callable(find_kernel(name)) for name in kernels)


# A number that a caller writes makes no version of the kernel that is called.


@kernel
def power(x, n):
    result = 1.0
    for _ in range(n):
        result *= x
    return result


@shared_kernel(float)
def root_of_power(x, n):
    return power(x, n) ** 0.5


@kernel
def both(x, n):
    return power(x, 2) + power(x, 3) + power(x, n) + root_of_power(x, 4) + root_of_power(x, 6)


def test_one_version_serves_all_numbers():
    assert both(2.0, 1) == pytest.approx(4.0 + 8.0 + 2.0 + 4.0 + 8.0)
    both.linked.compile((types.float64, types.int64))  # the call above may load what is stored
    assert len(power.linked.overloads) == 1
    assert len(root_of_power.linked.overloads) == 1


# Variables are values instead of places in memory.


class Line(NamedTuple):
    heights: Any
    weights: Any


def wander(line, count):
    total, last = 0.0, -1
    for k in range(count):
        height = line.heights[k]
        if height < 0.0:
            continue
        twice = Line(line.weights, line.heights) if k % 2 else line
        for n in range(k):
            step = twice.heights[n]
            if step > 1.0:
                last = k
                break
            total += step * height
        if last == k:
            total -= twice.weights[k]
    return total + last * line.weights[0]


compiled = kernel(wander)


@pytest.mark.parametrize("seed", range(4))
def test_a_kernel_does_what_its_python_does(seed):
    heights, weights = np.random.default_rng(seed).uniform(-0.5, 1.3, (2, 20))
    for count in (0, 1, 20):
        line = Line(heights, weights)
        assert compiled(line, count) == pytest.approx(wander(line, count), rel=1e-12)
