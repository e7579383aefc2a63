"""Rows of vectors, and numbers each once."""

import numpy as np
import pytest

from featherfx.algebra.vectors import distinct


@pytest.mark.parametrize("shape", [(0,), (1,), (500,), (40, 3)])
def test_distinct_numbers_ascend_each_once(shape):
    numbers = np.random.default_rng(1).integers(-20, 20, shape)
    before = numbers.copy()
    assert distinct(numbers).tolist() == sorted(set(numbers.ravel().tolist()))
    assert np.array_equal(numbers, before)
