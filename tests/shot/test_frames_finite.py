"""What a frame hands on is looked at: one number that is not finite ends the bake by name."""

from __future__ import annotations

import numpy as np
import pytest

from featherfx.shot.simulate import _finite


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_one_number_that_is_not_finite_is_seen(bad):
    nodes = np.random.default_rng(3).normal(size=(7, 5, 3))
    assert _finite(nodes)
    nodes[4, 2, 1] = bad
    assert not _finite(nodes)
    assert not _finite(nodes[:, :3])


def test_large_numbers_are_finite_though_their_squares_are_not():
    assert _finite(np.full((2, 3), 1e200))
