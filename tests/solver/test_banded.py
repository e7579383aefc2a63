"""The banded Cholesky factor against scipy."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import cholesky_banded, solveh_banded

from featherfx.solver.step.banded_kernels import factorise, solve_factored
from featherfx.solver.types import panel_shape


def random_band(size, width, seed):
    """Lower band, band[j, d] = A[j + d, j], of a diagonally dominant matrix."""
    rng = np.random.default_rng(seed)
    band = rng.normal(size=(size, width))
    band[:, 0] = 2.0 * width + rng.uniform(0.0, 1.0, size)
    for d in range(1, width):
        band[max(size - d, 0) :, d] = 0.0
    return band


@pytest.mark.parametrize(
    ("size", "width"),
    [(1, 1), (2, 2), (7, 3), (8, 3), (9, 30), (60, 18), (61, 42), (294, 42), (180, 87)],
)
def test_factor_and_solution_agree_with_scipy(size, width):
    band = random_band(size, width, size + width)
    right = np.random.default_rng(0).normal(size=size)
    # scipy takes at most as many diagonals as the matrix has
    lower = np.ascontiguousarray(band.T[: min(size, width)])
    factor, x = band.copy(), right.copy()
    assert factorise(factor, np.zeros(panel_shape(width)))
    assert factor.T[: len(lower)] == pytest.approx(cholesky_banded(lower, lower=True), abs=1e-12)
    solve_factored(factor, x)
    assert x == pytest.approx(solveh_banded(lower, right, lower=True), abs=1e-12)


@pytest.mark.parametrize("place", [0, 1, 4, 9])
def test_an_indefinite_or_broken_matrix_is_refused(place):
    for bad in (-1.0, 0.0, np.nan):
        band = random_band(10, 4, 1)
        band[place, 0] = bad
        assert not factorise(band, np.zeros(panel_shape(4)))
