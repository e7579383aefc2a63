"""A vane at rest: its cells, hinges and twist, and how integrals along its barbs are summed.

Curvature shapes of the barbs, orthonormal under the barb's bending stiffness.

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

from featherfx.feather.types import Feather, barb_slice
from featherfx.mechanics.resolution import stiffness_along

Array = NDArray[np.float64]

# part of its area at rest that a triangle of a hinge keeps before its angle counts for less
CRUSHED_OPENNESS = 0.2
# what Gregory's rule of third order (h^4) moves of the last term of a sum by trapezoids: to itself
# and to the two next to it
_MOVED = -1.0 / 4.0, 1.0 / 3.0, -1.0 / 12.0
# what makes a sum over the middles of segments as exact: to the last three of them
_MOVED_MIDDLES = 1.0 / 12.0, -1.0 / 8.0, 1.0 / 24.0


def end_corrections(columns: int) -> Array:
    """(m + 1, m + 1) by which sums by trapezoids over a barb's nodes become Gregory's.

    What is lumped at the nodes stands for integrals along the barb. By trapezoids four columns err
    by 0.36 % of the length in the shake of docs/benchmarks.md, so by 0.05 %.
    """
    moved = np.eye(columns + 1)
    if columns > 1:
        moved[0, :3] += _MOVED
        moved[-1, :-4:-1] += _MOVED
    return moved


def _node_weights(columns: int) -> Array:
    """(m + 1,) of a barb's nodes in such a sum, in segments."""
    trapezoids = np.ones(columns + 1)
    trapezoids[[0, -1]] = 0.5
    return np.asarray(trapezoids @ end_corrections(columns))


def cell_weights(columns: int) -> Array:
    """(m, 2, 2) of e_ww and 2 e_vw of triangles A and B in integrals over the vane, beside their
    areas.

    The strain across the barbs is that at node j in A and at j + 1 in B, in both as wide as half a
    segment. Shear turns with the segment and is that of its middle.
    """
    nodes, middles = _node_weights(columns), np.ones(columns)
    nodes[[0, -1]] *= 2.0
    if columns > 2:
        middles[:3] += _MOVED_MIDDLES
        middles[:-4:-1] += _MOVED_MIDDLES
    of_shear = np.stack([middles, middles], axis=-1)
    return np.stack([np.stack([nodes[:-1], nodes[1:]], axis=-1), of_shear], axis=-1)


def barb_nodes(nodes: Array) -> Array:
    """(2, n, m + 1, 3) nodes of all barbs, column 0 on the rachis, from nodes (n, 1 + 2 m, 3)."""
    root, columns = nodes[:, :1], nodes.shape[1] // 2
    sides = [nodes[:, barb_slice(side, columns)] for side in range(2)]
    return np.stack([np.concatenate([root, side], axis=1) for side in sides])


def _triangle(feather: Feather) -> tuple[Array, Array, Array]:
    """Edge start, edge end and opposite node of all cells: (2, n-1, m, 2, 3) each."""
    nodes = barb_nodes(feather.rest.nodes)
    low, high = nodes[:, :-1], nodes[:, 1:]
    start = np.stack([low[:, :, :-1], high[:, :, :-1]], axis=3)
    end = np.stack([low[:, :, 1:], high[:, :, 1:]], axis=3)
    opposite = np.stack([high[:, :, :-1], low[:, :, 1:]], axis=3)
    return start, end, opposite


def cells_at_rest(feather: Feather) -> tuple[Array, Array]:
    """cell_rest (2, n-1, m, 2, 3) and rest area (2, n-1, m, 2), zero where masked."""
    start, end, opposite = _triangle(feather)
    exists = feather.cell
    edge = np.linalg.norm(end - start, axis=-1)
    edge = np.where(exists, edge, 1.0)
    along = np.einsum("...k,...k", opposite - start, end - start) / edge
    reach = np.einsum("...k,...k", opposite - start, opposite - start)
    height = np.sqrt(np.where(exists, np.maximum(reach - along**2, 0.0), 1.0))
    rest = np.stack([1.0 / edge, along, 1.0 / height], axis=-1)
    return np.where(exists[..., None], rest, 0.0), np.where(exists, 0.5 * edge * height, 0.0)


def hinges_at_rest(feather: Feather, held: Array, modulus: float) -> tuple[Array, Array]:
    """hinge_rest (2, n, m, 3) and hinge_stiffness (2, n, m).

    held: (2, n-1, m, 2) share of the modulus that each cell has; those on either side of the barb
    bend one after the other.
    """
    nodes = barb_nodes(feather.rest.nodes)
    shape = (2, feather.rows, feather.columns)
    rest, stiffness = np.zeros((*shape, 3)), np.zeros(shape)
    start, end = nodes[:, 1:-1, :-1], nodes[:, 1:-1, 1:]
    above, below = nodes[:, 2:, 1:], nodes[:, :-2, 1:]
    edge = end - start
    first, second = np.cross(edge, above - start), np.cross(below - start, edge)
    size = np.linalg.norm(edge, axis=-1)
    sine = np.einsum("...k,...k", np.cross(first, second), edge)
    angle = np.arctan2(sine, size * np.einsum("...k,...k", first, second))
    upper, lower = 0.5 * np.linalg.norm(first, axis=-1), 0.5 * np.linalg.norm(second, axis=-1)
    both = feather.cell[:, 1:, :, 0] & feather.cell[:, :-1, :, 1] & (upper > 0.0) & (lower > 0.0)
    upper, lower = np.where(both, upper, 1.0), np.where(both, lower, 1.0)
    softer = upper / held[:, 1:, :, 0] + lower / held[:, :-1, :, 1]
    # of a segment, the width of the strip that each hinge stands for
    weights = _node_weights(feather.columns)
    fraction = weights[1:]
    fraction[0] += weights[0]
    stiffness[:, 1:-1] = np.where(both, modulus * fraction * size**2 / softer, 0.0)
    known = np.stack([angle, opening(upper), opening(lower)], axis=-1)
    rest[:, 1:-1] = np.where(stiffness[:, 1:-1, :, None] > 0.0, known, 0.0)
    return rest, stiffness


def twists_at_rest(feather: Feather, cell_area: Array) -> tuple[Array, Array]:
    """twist_rest (2, n-1, m, 2), and 1 where there is a whole cell, 0 elsewhere, (2, n-1, m)."""
    nodes = barb_nodes(feather.rest.nodes)
    low, high = nodes[:, :-1], nodes[:, 1:]
    start, end = low[:, :, :-1], low[:, :, 1:]
    normal = np.cross(end - start, high[:, :, :-1] - start)
    volume = np.einsum("...k,...k", high[:, :, 1:] - start, normal)
    whole = (cell_area[..., 0] > 0.0) & (cell_area[..., 1] > 0.0)
    area = np.where(whole, cell_area.sum(axis=-1), 1.0)
    rest = np.stack([area**-1.5, volume * area**-1.5], axis=-1)
    return np.where(whole[..., None], rest, 0.0), whole.astype(float)


def opening(area: Array | float) -> Array:
    """1 / (2 c A)^2 of triangles with rest area A, 1/m^4 (vane_bending_kernels)."""
    return np.asarray((0.5 / (CRUSHED_OPENNESS * area)) ** 2)


_SAMPLES = 2000

Factors = Callable[[NDArray[np.float64]], NDArray[np.float64]]


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
