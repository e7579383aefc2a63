"""A number that stands in a caller makes no version of the kernel that is called."""

from __future__ import annotations

import pytest
from numba import types

from featherfx.jit.compiled import kernel, shared_kernel


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
    both.linked.compile((types.float64, types.int64))  # the call above may load what is kept
    assert len(power.linked.overloads) == 1
    assert len(root_of_power.linked.overloads) == 1
