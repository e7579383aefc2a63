"""How many curvature coefficients a feather's barbs need.

A barb under a pressure q on its vane is a cantilever with the stiffness D b(s) per metre of vane
(b: featherfx/mechanics/barb_shapes.py) and the load q; its end goes down by

    d = (q L^4 / D) integral_0^1 (1 - s)^3 / (2 b(s)) ds          (L^4 q / (8 D) for b = 1)

and at most by about its length. C coefficients miss a share r_C of that: the distance between the
barb's end with C coefficients and with eight over the deflection, largest over tapers 0 to 2 and
deflections of 1 to 50 % of the length, six segments (tests/mechanics/test_resolution.py measures
it again).
"""

from __future__ import annotations

import numpy as np

from featherfx.feather.types import Feather
from featherfx.groom.types import FeatherKind
from featherfx.mechanics.barb_shapes import FLOOR

# share of the deflection that C = 0, 1, ... coefficients miss
MISSED = (1.0, 0.35, 0.022, 0.019, 0.005)


def inertial_pressure(kind: FeatherKind, acceleration: float) -> float:
    """Pa, load on a vane that is accelerated (m/s^2) across its surface."""
    return kind.vane_material.surface_density * acceleration


def barb_deflection(feather: Feather, kind: FeatherKind, pressure: float) -> float:
    """m, how far a pressure (Pa) moves the end of the longest barb; at most the barb's length."""
    vane = kind.vane_material
    s = (np.arange(200) + 0.5) / 200
    stiffness = np.maximum((1.0 - s) ** vane.barb_taper, FLOOR)
    flexibility = float(np.mean((1.0 - s) ** 3 / (2.0 * stiffness)))
    length = float(feather.barb_length.max())
    deflection = pressure * length**4 / vane.barb_bending_normal * flexibility
    return min(deflection, length)


def coefficients_for(feather: Feather, kind: FeatherKind, pressure: float, tolerance: float) -> int:
    """Fewest coefficients whose error stays below a tolerance (m) under a pressure (Pa)."""
    deflection = barb_deflection(feather, kind, pressure)
    for count, missed in enumerate(MISSED):
        if missed * deflection <= tolerance:
            return count
    return len(MISSED) - 1
