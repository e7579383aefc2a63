"""Variables of kernels that are values instead of places in memory."""

from typing import Any, NamedTuple

import numpy as np
import pytest
from numba.core.compiler import run_frontend

from featherfx.jit.compiled import kernel
from featherfx.jit.lowering import values_of


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


def test_what_is_assigned_once_and_before_its_uses_is_a_value():
    values = values_of(run_frontend(wander).blocks)
    assert {"line", "count", "height"} <= values  # used in other blocks than assigned
    assert not {"total", "last"} & values  # assigned again
