"""Vibrations of a barb that is clamped in a held rachis, against a beam's."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from numpy.polynomial import Legendre, Polynomial
from scipy.linalg import eigh
from scipy.optimize import brentq

from featherfx.groom.materials import VaneMaterial
from featherfx.lab.strip import strip_feather, strip_kind
from featherfx.mechanics.batch import make_model
from featherfx.mechanics.resolution import MIN_BARB_STIFFNESS
from featherfx.solver.damping import rest_bands

pytestmark = pytest.mark.verification

REACH, LENGTH, ROWS = 0.04, 0.03, 3
VANE = VaneMaterial(
    modulus_along_barbs=3.6e8,
    modulus_across_barbs=1e-12,
    shear_modulus=1e-12,
    thickness=1.2e-4,
    surface_density=0.026,
    barb_bending_normal=2.5e-4,
    barb_bending_in_plane=8.5e-5,
    barb_taper=0.0,
    bending_across=0.0,
    loss_factor=0.0,
)


def ritz(taper: float, count: int) -> np.ndarray:
    """(count,) rad/s of a cantilever with stiffness max((1 - s)^taper, 0.05) D and uniform mass,

    times sqrt(D / (density REACH^4)): Rayleigh and Ritz with s^2 times Legendre polynomials.
    """
    knots = [0.0, 1.0 - MIN_BARB_STIFFNESS ** (1.0 / taper) if taper else 0.5, 1.0]
    nodes, weights = np.polynomial.legendre.leggauss(40)
    pieces = list(pairwise(knots))
    s = np.concatenate([a + (b - a) * 0.5 * (nodes + 1) for a, b in pieces])
    w = np.concatenate([0.5 * (b - a) * weights for a, b in pieces])
    shapes, curved = [], []
    for k in range(16):
        leg = Legendre.basis(k, domain=[0.0, 1.0]).convert(
            kind=Polynomial, domain=[-1, 1], window=[-1, 1]
        )
        full = leg * Polynomial([0.0, 0.0, 1.0])
        shapes.append(full(s))
        curved.append(full.deriv(2)(s))
    stiffness = np.maximum((1.0 - s) ** taper, MIN_BARB_STIFFNESS)
    stiff = np.einsum("as,bs,s->ab", curved, curved, w * stiffness)
    heavy = np.einsum("as,bs,s->ab", shapes, shapes, w)
    return np.sqrt(eigh(stiff, heavy, eigvals_only=True)[:count])


def of_a_barb(columns: int, coefficients: int, taper: float, count: int) -> np.ndarray:
    """(2, count) frequencies out of the vane and within it, in their beams' units."""
    vane = replace(VANE, barb_taper=taper)
    kind = strip_kind(LENGTH, vane)
    feather = strip_feather(LENGTH, 2.0 * REACH, ROWS, columns)
    model = make_model([feather], [kind], coefficients)
    stiffness, mass = rest_bands(model, 0)
    wide = 6 + 4 * coefficients
    # the leading barb of the middle row alone; its row is held
    first = wide + 6
    found = []
    for direction, bending in enumerate((vane.barb_bending_normal, vane.barb_bending_in_plane)):
        places = first + direction * coefficients + np.arange(coefficients)
        blocks = []
        for band in (stiffness, mass):
            block = np.array([[band[min(a, b), abs(a - b)] for a in places] for b in places])
            blocks.append(block)
        values = eigh(*blocks, eigvals_only=True)[:count]
        unit = bending / (vane.surface_density * REACH**4)
        found.append(np.sqrt(values / unit))
    return np.array(found)


def test_the_reference_of_a_uniform_beam_is_the_closed_form() -> None:
    """cos x cosh x = -1."""
    roots = [
        brentq(lambda x: np.cos(x) + 1.0 / np.cosh(x), (k - 0.8) * np.pi, k * np.pi)
        for k in range(1, 5)
    ]
    assert ritz(0.0, 4) == pytest.approx(np.square(roots), rel=1e-6)


@pytest.mark.parametrize("taper", [0.0, 0.5, 1.0])
def test_first_four_frequencies(taper: float) -> None:
    expected = ritz(taper, 4)
    for direction in of_a_barb(40, 8, taper, 4):
        error = np.abs(direction / expected - 1.0)
        assert error[0] < 2e-3
        assert error.max() < 1e-2


def test_fourth_order_in_the_columns() -> None:
    """Masses are summed by Gregory's rule of third order, whose error goes with h^4."""
    expected = ritz(0.0, 2)
    errors = [np.abs(of_a_barb(n, 6, 0.0, 2)[0] / expected - 1.0) for n in (10, 20, 40)]
    orders = np.log2(errors[0] / errors[2]) / 2.0
    assert orders == pytest.approx(4.0, abs=0.4)
