"""The share of a barb's deflection that few coefficients miss, measured on the barb kernel."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import minimize

from featherfx.mechanics.barb_kernels import barb_points
from featherfx.mechanics.resolution import MISSED_DEFLECTION
from featherfx.mechanics.vane_rest import curvature_shapes

STRAIGHT = np.array([1.0, 0.0, 0.0, 0.0])
SEGMENTS = 6


# of a load of one in all, from the second node on, the one at the end last
LOADS = {
    "uniform": np.array([1.0, 1.0, 1.0, 1.0, 1.0, 0.5]) / SEGMENTS,
    "growing": np.array([1.0, 2.0, 3.0, 4.0, 5.0, 3.0]) / 18.0,
    "end": np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.4]),
}


def barb_end(count: int, taper: float, load: float, kind: str = "uniform") -> np.ndarray:
    """End of a unit barb under a load (over stiffness / length^2), by minimisation."""
    shapes = curvature_shapes(count, SEGMENTS, taper)
    joints = np.tile(STRAIGHT, (SEGMENTS, 1))
    weights = LOADS[kind]

    def nodes(normal: np.ndarray) -> np.ndarray:
        points = np.zeros((SEGMENTS, 3))
        both = np.concatenate([normal, np.zeros(count)])
        barb_points(
            *(STRAIGHT, np.zeros(3), STRAIGHT, joints, 1.0 / SEGMENTS),
            *(shapes, both, np.zeros((SEGMENTS, 4)), points),
        )
        return points

    def energy(normal: np.ndarray) -> float:
        return 0.5 * normal @ normal + load * float(weights @ nodes(normal)[:, 2])

    start = np.zeros(count)
    found = minimize(energy, start, method="BFGS", options={"gtol": 1e-11}).x if count else start
    return nodes(found)[-1]


@pytest.mark.parametrize("kind", LOADS)
@pytest.mark.parametrize("taper", [0.0, 1.0, 2.0])
@pytest.mark.parametrize("load", [0.1, 1.0, 4.0])
def test_the_missed_share_is_within_the_table(kind: str, taper: float, load: float) -> None:
    reference = barb_end(8, taper, load, kind)
    deflection = float(np.linalg.norm(reference - [1.0, 0.0, 0.0]))
    for count, missed in enumerate(MISSED_DEFLECTION):
        error = float(np.linalg.norm(barb_end(count, taper, load, kind) - reference))
        assert error <= 1.1 * missed * deflection


def test_the_table_is_not_idle() -> None:
    """One coefficient is a uniform load's; of what a force at the end of a barb that tapers to a
    point does, it misses what the table says."""
    reference = barb_end(8, 2.0, 0.1, "end")
    deflection = float(np.linalg.norm(reference - [1.0, 0.0, 0.0]))
    error = float(np.linalg.norm(barb_end(1, 2.0, 0.1, "end") - reference))
    assert error > 0.9 * MISSED_DEFLECTION[1] * deflection


@pytest.mark.parametrize("taper", [0.0, 1.0, 2.0])
def test_one_coefficient_bends_as_beam_theory_says(taper: float) -> None:
    """q L^4 / B times the integral of (1 - s)^3 / (2 b), with the load on six segments' nodes."""
    s = (np.arange(20000) + 0.5) / 20000
    exact = float(np.mean((1.0 - s) ** 3 / (2.0 * np.maximum((1.0 - s) ** taper, 0.05))))
    deflection = -barb_end(1, taper, 1e-3)[2] / 1e-3
    assert deflection == pytest.approx(exact, rel=0.03)
