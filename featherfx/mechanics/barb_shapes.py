"""Curvature shapes of the barbs, orthonormal under the barb's bending stiffness.

    kappa(s) = (1/L) sum_c q_c P_c(s),     integral_0^1 b(s) P_c P_d ds = delta_cd

s = arc length / L from the rachis, b(s) = max((1 - s)^taper, 0.05) the stiffness relative to the
root's, times what the profiles of its material make of it. The energy of a barb with root stiffness
B is then 1/2 (B / L) sum_c q_c^2.

A barb is clamped at the rachis and free at its end, where no moment acts: its curvature is M / b
with the moments

    M(s) = (1 - s)^2,  (1 - s),  (1 - s)^3,  (1 - s)^4, ...

of a load that is uniform, one at the end, and those that fall off towards it. So a small deflection
under a uniform pressure takes one coefficient, and under a force at the end two. Made orthonormal
in this order (Gram and Schmidt), fewer shapes are the first of more.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

MIN_BARB_STIFFNESS = 0.05
_SAMPLES = 2000

Factors = Callable[[NDArray[np.float64]], NDArray[np.float64]]


def stiffness_along(taper: float, places: NDArray[np.float64]) -> NDArray[np.float64]:
    """(K,) b at places (K,) of a barb without factors of its own."""
    return np.maximum((1.0 - places) ** taper, MIN_BARB_STIFFNESS)


def curvature_shapes(
    count: int, joints: int, taper: float, factors: Factors | None = None
) -> NDArray[np.float64]:
    """(count, joints) share of every shape's turn that falls on each joint of a barb.

    factors: of b, at places of the barb, where it has any.

    A barb of m segments has a joint at its root and one between any two segments. Each segment has
    the mean direction of the arc that it stands for, so the nodes of a small deflection are where
    the shape has them, however few there are.
    """
    if not count:
        return np.zeros((0, joints))
    step = 1.0 / _SAMPLES
    s = np.asarray((np.arange(_SAMPLES) + 0.5) * step, dtype=np.float64)
    stiffness = stiffness_along(taper, s)
    if factors is not None:
        stiffness = stiffness * factors(s)
    powers = np.array((2, 1, *range(3, count + 1))[:count], dtype=float)
    curvatures = (1.0 - s)[:, None] ** powers / stiffness[:, None]
    _, triangle = np.linalg.qr(np.sqrt(stiffness * step)[:, None] * curvatures)
    values = curvatures @ np.linalg.inv(triangle) * np.sign(np.diag(triangle))
    # turn and deflection at the ends of the samples, then mean directions between the nodes
    turned = np.cumsum(values * step, axis=0)
    turned = np.vstack([np.zeros(count), turned])
    deflection = np.cumsum(0.5 * step * (turned[1:] + turned[:-1]), axis=0)
    deflection = np.vstack([np.zeros(count), deflection])
    grid, nodes = np.linspace(0.0, 1.0, _SAMPLES + 1), np.linspace(0.0, 1.0, joints + 1)
    at_nodes = np.array([np.interp(nodes, grid, each) for each in deflection.T])
    directions = joints * np.diff(at_nodes, axis=1)
    result: NDArray[np.float64] = np.diff(directions, axis=1, prepend=0.0)
    return result


def clamped_shapes(shapes: NDArray[np.float64]) -> NDArray[np.float64]:
    """(C + 1, joints): the shapes and that of an elastic clamp, a turn at the root alone.

    A spring between rachis and barb is in series with the barb, so the barb's turn at its root is
    one more coefficient q with the energy 1/2 k q^2, k in N m per rad: curvature concentrated at
    the root.
    """
    root = np.zeros((1, shapes.shape[1]))
    root[0, :1] = 1.0
    return np.concatenate([shapes, root])
