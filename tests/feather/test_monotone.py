"""Monotone cubic interpolation against SciPy's, and its own promises."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.interpolate import PchipInterpolator

from featherfx.algebra.interpolation import monotone


@pytest.mark.parametrize("count", [2, 3, 4, 9])
@pytest.mark.parametrize("seed", range(8))
def test_equals_scipy(count, seed):
    """Values with rises, falls and plateaus, at uneven distances."""
    random = np.random.default_rng(seed)
    places = np.cumsum(random.uniform(0.01, 2.0, count))
    values = random.integers(-2, 3, (count, 4)) * random.uniform(0.1, 3.0, (count, 4))
    at = np.concatenate([places, random.uniform(places[0], places[-1], 50)])
    expected = PchipInterpolator(places, values)(at)
    np.testing.assert_allclose(monotone(places, values, at), expected, rtol=0, atol=1e-13)


def test_stays_between_its_points():
    places = np.array([0.0, 0.1, 1.0, 1.1, 3.0])
    values = np.array([[0.0], [0.0], [5.0], [5.1], [5.1]])
    curve = monotone(places, values, np.linspace(0.0, 3.0, 500))[:, 0]
    assert (np.diff(curve) >= -1e-15).all()
    assert curve[0] == 0.0
    assert curve[-1] == 5.1
