"""Twist of the vane: a material's modulus, on whatever grid."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import brentq

from featherfx.groom.materials import VaneMaterial
from featherfx.lab.strip import strip_feather, strip_kind
from featherfx.mechanics.batch import make_model
from featherfx.solver.damping import frequencies

LENGTH, WIDTH, BENDING, DENSITY = 0.1, 0.05, 1e-5, 0.1
# barbs that nearly do not bend, held by a shaft that does not bend and does not resist torsion
VANE = VaneMaterial(
    modulus_along_barbs=1e9,
    modulus_across_barbs=1e6,
    shear_modulus=1e6,
    thickness=1e-3,
    surface_density=DENSITY,
    barb_bending_normal=10.0,
    barb_bending_in_plane=10.0,
    bending_across=BENDING,
    loss_factor=0.0,
)


def twisting_strip(ratio, rows, columns):
    """Lowest frequency of a strip whose shaft, in its middle, turns freely about itself, Hz."""
    kind = strip_kind(LENGTH, replace(VANE, twist_ratio=ratio))
    model = make_model([strip_feather(LENGTH, WIDTH, rows, columns)], [kind], 1)
    stiff = np.full((1, rows - 1, 6), 1e4)
    stiff[..., 3] = 1e-12
    return frequencies(model._replace(rachis_stiffness=stiff), 0, 1)[0]


def plate(ratio):
    """The same of Kirchhoff's plate with rigid barbs, z = y a(x), without Poisson's effect, Hz.

    48 D_66 a_xx - D b^2 a_xxxx = -rho b^2 w^2 a, with a = a_xx = 0 at the clamp, where there is no
    hinge, and a_xx = 0, 48 D_66 a_x = D b^2 a_xxx at the end.
    """
    twist, bending = 48.0 * ratio * BENDING / WIDTH**2, BENDING

    def fault(frequency):
        inertia = DENSITY * (2.0 * np.pi * frequency) ** 2
        root = np.sqrt(twist**2 + 4.0 * bending * inertia)
        p, q = np.sqrt((root + twist) / (2 * bending)), np.sqrt((root - twist) / (2 * bending))
        # a = sinh px / sinh pL + c sin qx, with a_xx = 0 at both ends
        c = p**2 / (q**2 * np.sin(q * LENGTH))
        slope = p / np.tanh(p * LENGTH) + c * q * np.cos(q * LENGTH)
        third = p**3 / np.tanh(p * LENGTH) - c * q**3 * np.cos(q * LENGTH)
        return (twist * slope - bending * third) * np.sin(q * LENGTH)

    guess = np.sqrt(twist / DENSITY) / (4.0 * LENGTH)
    return brentq(fault, 0.5 * guess, 1.6 * guess)


@pytest.mark.parametrize("ratio", [0.1, 0.5, 4.0])
def test_a_strip_that_twists_converges_to_a_plate_whatever_the_shape_of_its_cells(ratio):
    """Columns a third as wide as rows, and 2.5 times."""
    expected = plate(ratio)
    found = [twisting_strip(ratio, *grid) for grid in ((11, 8), (41, 4), (41, 16))]
    assert found == pytest.approx([expected] * 3, rel=0.004)


def test_without_a_modulus_the_vane_twists_freely():
    # what is left are the barbs' own turns and the strip's warping: z = x y has neither
    assert twisting_strip(0.0, 21, 3) < 0.02 * plate(0.5)
