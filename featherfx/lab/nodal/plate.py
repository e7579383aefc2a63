"""Tables of the vane's bending by dihedral angles: separate hinges, or a plate.

    hinge    W = 1/2 D(beta) s^2 / (A_1 + A_2) (t - t0)^2
             D(beta) = (D_p - D_b) / 2 cos(2 beta) + (D_p + D_b) / 2
    plate    W = 1/2 A (D_b k_vv^2 + D_p k_ww^2 + 2 D_t k_vw^2),      k = R^-1 (t - t0)

D_b bending along the barbs, D_p across them, D_t in twist, N m; s rest length of the edge, A rest
areas, beta the angle between edge and barb at rest, the average of both triangles weighted by
their areas; t dihedral angles, R the angles of a triangle for unit curvatures of its patch.

Source of the hinge: Jouve 2024, eq. 6.2 to 6.5, with the factor of
featherfx/mechanics/vane_bending_kernels.py, under which D_p is the modulus of a strip of barbs
that is rolled up; eq. 6.2 with 6.3 as printed means a modulus 27 times smaller. Hinges at all
edges mix bending with twist on such a grid, so the bending that they give depends on the grid.
The plate does not: R maps every constant curvature exactly, so it converges to the Kirchhoff
plate (Oñate and Zárate 2000, basic shell triangle, on this grid). At a free edge the missing
angle takes the value of least energy, which is the edge's natural condition.
"""

from __future__ import annotations

import numpy as np

from featherfx.algebra.types import Array, Flags
from featherfx.lab.nodal.plate_kernels import angles_per_curvature


def hinge_places(cell: Flags) -> Flags:
    """(3, 2, n, m) which hinges have both triangles; cell: (2, n-1, m, 2)."""
    sides, cells, columns, _ = cell.shape
    active = np.zeros((3, sides, cells + 1, columns), dtype=np.bool_)
    active[0, :, 1:-1] = cell[:, 1:, :, 0] & cell[:, :-1, :, 1]
    active[1, :, :-1] = cell[..., 0] & cell[..., 1]
    active[2, :, :-1, 1:] = cell[:, :, 1:, 0] & cell[:, :, :-1, 1]
    active[2, 0, :-1, 0] = cell[0, :, 0, 0] & cell[1, :, 0, 0]
    return active


def barb_hinges(nodes: Array, area: Array, active: Flags, held: Array, across: float) -> Array:
    """(2, n-1, m, 2, 3, 3) tables of hinges at the barb edges only, as of oriented_hinges.

    held: (2, n-1, m, 2), share of the modulus that each triangle has.
    """
    edge = np.diff(nodes, axis=2)[:, 1:-1]
    softer = area[:, 1:, :, 0] / held[:, 1:, :, 0] + area[:, :-1, :, 1] / held[:, :-1, :, 1]
    there = active[0, :, 1:-1] & (softer > 0.0)
    stiffness = across * np.einsum("...k,...k", edge, edge) / np.where(there, softer, 1.0)
    modes = np.zeros((*area.shape, 3, 3))
    modes[:, 1:, :, 0, 0, 0] = np.sqrt(np.where(there, stiffness, 0.0))
    return modes


def oriented_hinges(nodes: Array, area: Array, active: Flags, along: Array, across: float) -> Array:
    """(2, n-1, m, 2, 3, 3) tables of hinges at all edges, but not where the vanes meet.

    nodes: (2, n, m + 1, 3) m, column 0 on the rachis. area: (2, n-1, m, 2) m^2, of the triangles.
    active: (3, 2, n, m). along: (m,) N m, modulus along the barbs by column; across: N m.
    """
    low, high = nodes[:, :-1], nodes[:, 1:]
    barb_low, barb_high = np.diff(low, axis=2), np.diff(high, axis=2)
    first, second = area[..., 0], area[..., 1]
    diagonal = high[:, :, :-1] - low[:, :, 1:]
    row_edge = (high - low)[:, :, :-1]
    before = np.zeros_like(second)
    before[:, :, 1:] = second[:, :, :-1]
    barb_before = np.zeros_like(barb_high)
    barb_before[:, :, 1:] = barb_high[:, :, :-1]
    below = np.zeros_like(second)
    below[:, 1:] = second[:, :-1]
    kinds = (
        (barb_low, barb_low, barb_low, first, below),
        (diagonal, barb_low, barb_high, first, second),
        (row_edge, barb_low, barb_before, first, before),
    )
    modes = np.zeros((*area.shape, 3, 3))
    for kind, (edge, barb_1, barb_2, area_1, area_2) in enumerate(kinds):
        total = area_1 + area_2
        there = active[kind, :, :-1] & (total > 0.0)
        if kind == 2:
            there[:, :, 0] = False
        safe = np.where(there, total, 1.0)
        tilt = (area_1 * _angle(edge, barb_1) + area_2 * _angle(edge, barb_2)) / safe
        modulus = 0.5 * (across - along) * np.cos(2.0 * tilt) + 0.5 * (across + along)
        square = np.einsum("...k,...k", edge, edge)
        modes[:, :, :, 0, kind, kind] = np.sqrt(np.where(there, modulus * square / safe, 0.0))
    return modes


def plate_tables(points: Array, area: Array, active: Flags, moduli: Array) -> Array:
    """(2, n-1, m, 2, 3, 3) tables of a plate.

    points: (n, 1 + 2 m, 3) m at rest. area: (2, n-1, m, 2) m^2. active: (3, 2, n, m). moduli:
    (3, 3) N m, for k = (k_vv, k_ww, k_vw): along the leading vane's barbs, across them towards the
    tip, and in twist; W = 1/2 A k.moduli k.
    """
    response = np.zeros((*area.shape, 3, 3))
    angles_per_curvature(
        np.ascontiguousarray(points),
        active,
        np.zeros((6, 2), np.int64),
        np.zeros((4, 3)),
        np.zeros(18),
        response,
    )
    flat = response.reshape(-1, 3, 3)
    # a triangle's own axes lead away from the shaft and, in the second of a cell, to the base
    twist = np.ones(area.shape)
    twist[1] *= -1.0
    twist[..., 1] *= -1.0
    table = np.zeros_like(flat)
    for t in np.flatnonzero(area.reshape(-1) > 0.0):
        axes = np.array([1.0, 1.0, twist.reshape(-1)[t]])
        table[t] = _triangle_table(flat[t], moduli * np.outer(axes, axes) * area.reshape(-1)[t])
    return table.reshape(*area.shape, 3, 3)


def _triangle_table(response: Array, weight: Array) -> Array:
    """(3, 3) table of one triangle whose missing hinges have rows of zeros in response (3, 3)."""
    there = np.any(response != 0.0, axis=1)
    if not there.any():
        return np.zeros((3, 3))
    # least energy among the curvatures that have the angles there are
    angles = response[there]
    stiffness = np.linalg.inv(angles @ np.linalg.solve(weight, angles.T))
    values, vectors = np.linalg.eigh(stiffness)
    table = np.zeros((3, 3))
    table[: len(values), there] = np.sqrt(np.maximum(values, 0.0))[:, None] * vectors.T
    return table


def _angle(first: Array, second: Array) -> Array:
    """Angle between lines, 0..pi/2; 0 where one has no length."""
    dot = np.abs(np.einsum("...k,...k", first, second))
    size = np.linalg.norm(first, axis=-1) * np.linalg.norm(second, axis=-1)
    return np.arccos(np.clip(np.divide(dot, size, out=np.ones_like(dot), where=size > 0), 0, 1))
