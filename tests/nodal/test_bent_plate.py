"""Plates of any bending moduli against series of polynomials for the same energy."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from numpy.polynomial import polynomial

from featherfx.errors import InputError
from featherfx.lab.strip import PlateTest, run_plate


def moduli_of(test):
    """(3, 3) for (w_xx, w_yy, 2 w_xy): the energy of curvatures along and across the barbs."""
    c, s = np.cos(np.radians(test.angle)), np.sin(np.radians(test.angle))
    found = np.zeros((3, 3))
    own = [[test.along, test.coupling, 0], [test.coupling, test.across, 0], [0, 0, test.twist]]
    for k in range(3):
        for q in range(3):
            parts = []
            for unit in (k, q):
                xx, yy, twice = np.eye(3)[unit]
                curvature = np.array([[xx, 0.5 * twice], [0.5 * twice, yy]])
                barb, other = np.array([c, s]), np.array([-s, c])
                parts.append(
                    np.array(
                        [
                            barb @ curvature @ barb,
                            other @ curvature @ other,
                            2.0 * barb @ curvature @ other,
                        ]
                    )
                )
            found[k, q] = parts[0] @ np.array(own) @ parts[1]
    return found


@cache
def series(test, load):
    """Deflection of the middle of the free end and its twist: Ritz's method, w = sum a x^i y^j."""
    length, half = test.length, 0.5 * test.width
    terms = [(i, j) for i in range(2, 12) for j in range(9)]

    def powers(i, order):
        return polynomial.polyder(np.eye(13)[i], order) if order else np.eye(13)[i]

    # Gauss points are exact for these powers
    points, weights = np.polynomial.legendre.leggauss(14)
    x, y = 0.5 * (points + 1.0), points
    curvatures, shape = [], []
    for i, j in terms:
        along = [polynomial.polyval(x, powers(i, k)) / length**k for k in range(3)]
        across = [polynomial.polyval(y, powers(j, k)) / half**k for k in range(3)]
        shape.append(np.outer(along[0], across[0]))
        curvatures.append(
            [
                np.outer(along[2], across[0]),
                np.outer(along[0], across[2]),
                2.0 * np.outer(along[1], across[1]),
            ]
        )
    area = np.outer(0.5 * length * weights, half * weights)
    k = np.array(curvatures)
    matrix = np.einsum("akxy,kq,bqxy,xy->ab", k, moduli_of(test), k, area, optimize=True)
    force = -load * np.einsum("axy,xy->a", np.array(shape), area)
    a = np.linalg.lstsq(matrix, force, rcond=1e-13)[0]
    at = [sum(a * [s**j for _, j in terms]) for s in (-1.0, 0.0, 1.0)]
    return -at[1], (at[2] - at[0]) / test.width


@pytest.mark.parametrize(
    "test",
    [
        PlateTest(1e-4, 1e-4, 0.35e-4, 0.3e-4, width=0.1, columns=20),
        PlateTest(1e-4, 2e-5, 3e-5, 0.5e-5, angle=60.0, width=0.03, columns=8),
        PlateTest(1e-4, 2e-5, 1e-5, -0.5e-5, angle=-30.0, width=0.03, columns=8),
    ],
    ids=["isotropic", "swept", "swept back"],
)
def test_a_plate_bends_as_the_series_for_its_energy(test):
    run = run_plate(test)
    deflection, twist = series(test, run.load)
    assert run.deflection == pytest.approx(deflection, rel=2e-3)
    assert run.twist == pytest.approx(twist, rel=2e-2, abs=1e-12)


def test_a_narrow_plate_bends_and_twists_as_a_rod_of_its_compliance():
    run = run_plate(
        PlateTest(1e-4, 2e-5, 2e-5, 0.5e-5, angle=60.0, width=0.004, rows=160, columns=2)
    )
    assert run.deflection == pytest.approx(run.narrow_deflection, rel=0.015)
    assert run.twist == pytest.approx(run.narrow_twist, rel=0.03)


def test_moduli_that_would_free_energy_are_refused():
    with pytest.raises(InputError, match="either way") as caught:
        run_plate(PlateTest(1e-4, 1e-4, 5e-5, coupling=-1e-4))
    assert [problem.key for problem in caught.value.problems] == ["coupling"]
    with pytest.raises(InputError, match="twist"):
        run_plate(PlateTest(1e-4, 1e-4, -5e-5))
