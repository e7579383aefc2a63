"""Kernels for one written pose: points, rates, normals, directions, extents, strains.

values: RowPoints of a feather or their rates, world frame, m. Results are single precision.

Strain and energy are those of the drawn vanes, per face, by the mechanics' own strain:

    density = 1/2 b (E_ww e_ww^2 + 4 E_vw e_vw^2)        J per square metre of the vane at rest

e_ww, e_vw Green-Lagrange strain across the barbs and in shear, b thickness, E_ww and E_vw moduli
(featherfx/mechanics/vane_membrane_kernels.py). A face of the rachis has none: zero.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from featherfx.algebra.vector_kernels import accumulate, add, length, normal_of, scale, store, sub
from featherfx.jit.compiled import kernel
from featherfx.mechanics.vane_membrane_kernels import membrane_strain

Array = NDArray[np.float64]
Floats = NDArray[np.float32]
Indices = NDArray[np.int64]


@kernel
def combine(values, surface):
    """The surface's points, or their rates, to surface.world."""
    for v in range(surface.row.shape[0]):
        i = surface.row[v]
        point = add((0.0, 0.0, 0.0), values.nodes[i, surface.node[v]])
        for k in range(2):
            w = surface.offset[v, k]
            if w != 0.0:
                point = add(point, scale(w, values.directors[i, k]))
        store(surface.world[v], point)
    for lip in range(surface.parted.shape[0]):
        if surface.parted[lip]:
            k = surface.lips[lip, 0]
            for c in range(3):
                surface.world[k, c] = surface.carried[lip, c]


@kernel
def _axes(v, stage):
    """A vector (3,) in the stage's axes."""
    return (v[0], v[2], -v[1]) if stage.y_up else (v[0], v[1], v[2])


@kernel
def write_points(world, stage, out):
    """World points or rates (3,), to out (N, 3); True if all are finite."""
    total = 0.0
    for v in range(out.shape[0]):
        store(out[v], scale(stage.units, _axes(world[v], stage)))
        total += abs(out[v, 0]) + abs(out[v, 1]) + abs(out[v, 2])
    return math.isfinite(total)


@kernel
def _join_closed_lips(surface):
    """Lips that coincide have one normal; sums of both, in place."""
    sums, lips = surface.sums, surface.lips
    for lip in range(lips.shape[0]):
        own, other = lips[lip, 0], lips[lip, 1]
        if other >= 0 and not surface.parted[lip]:
            for c in range(3):
                sums[own, c] += sums[other, c]
                sums[other, c] = sums[own, c]


@kernel
def vertex_normals(surface, stage, out):
    """Area-weighted unit normals; a point without faces (calamus) is given the up axis."""
    world, sums, triangles = surface.world, surface.sums, surface.triangles
    sums[:, :] = 0.0
    for t in range(triangles.shape[0]):
        corners = triangles[t, 0], triangles[t, 1], triangles[t, 2]
        normal = normal_of(world[corners[0]], world[corners[1]], world[corners[2]])
        for corner in corners:
            accumulate(sums[corner], 1.0, normal)
    _join_closed_lips(surface)
    for v in range(world.shape[0]):
        size = length(sums[v])
        normal = scale(1.0 / size, sums[v]) if size > 0.0 else (0.0, 0.0, 1.0)
        store(out[v], _axes(normal, stage))


@kernel
def edge_directions(surface, stage, out):
    """Unit vectors along the edges; x where an edge has no length."""
    world, edges = surface.world, surface.edges
    for t in range(edges.shape[0]):
        edge = sub(world[edges[t, 1]], world[edges[t, 0]])
        size = length(edge)
        direction = scale(1.0 / size, edge) if size > 0.0 else (1.0, 0.0, 0.0)
        store(out[t], _axes(direction, stage))


@kernel
def extent(points, padding, out):
    """(2, 3) least and greatest corner of points, padded.

    All in single precision, as USD computes extents, so that they are equal to the last bit.
    """
    for c in range(3):
        low = high = points[0, c]
        for v in range(points.shape[0]):
            low, high = min(low, points[v, c]), max(high, points[v, c])
        out[0, c], out[1, c] = low - padding, high + padding


@kernel
def write_values(values, surface, stage, out, rachis):
    """Write points or rates of a mesh, to out (V, 3), and of its rachis (n, 3); True if finite."""
    combine(values, surface)
    is_finite = write_points(surface.world, stage, out)
    return write_points(values.nodes[:, 0], stage, rachis) and is_finite


@kernel
def pose_surface(values, surface, stage, out):
    """A pose of mesh and rachis, to out (WrittenSurface); True if the points are finite."""
    finite = write_values(values, surface, stage, out.points, out.rachis)
    vertex_normals(surface, stage, out.normals)
    edge_directions(surface, stage, out.directions)
    return finite


@kernel
def mark_moved(points, rates, reference, starts, rounding, moved):
    """Mark feathers whose points differ from the reference, or of which a rate exceeds the
    rounding.

    starts: (M + 1,) first point of each. rounding: relative to the greatest coordinate of all
    points of a feather. Written: moved (M,), where a feather has.
    """
    for f in range(moved.shape[0]):
        if moved[f]:
            continue
        greatest, rate, differs = 0.0, 0.0, False
        for v in range(starts[f], starts[f + 1]):
            for c in range(3):
                differs = differs or points[v, c] != reference[v, c]
                greatest, rate = max(greatest, abs(points[v, c])), max(rate, abs(rates[v, c]))
        if differs or rate > rounding * greatest:
            moved[f] = True


@kernel
def face_strains(world, corners, rest, across, shear):
    """e_ww and e_vw (T,) of faces.

    world: (V, 3). corners: (T, 3) ends of the barb edge and the third point. rest: (T, 3) 1/s, p,
    1/h, zero for a face without strain.
    """
    for t in range(corners.shape[0]):
        across[t], shear[t] = 0.0, 0.0
        if rest[t, 0] > 0.0:
            start, end, opposite = corners[t, 0], corners[t, 1], corners[t, 2]
            first, second = membrane_strain(world[start], world[end], world[opposite], rest[t])
            across[t], shear[t] = first, 0.5 * second


@kernel
def energy_density(across, shear, across_stiffness, shear_stiffness, out):
    """(T,) J/m^2 of strains (T,). Stiffnesses: N/m, modulus times thickness."""
    for t in range(out.shape[0]):
        stretched = across_stiffness * across[t] * across[t]
        out[t] = 0.5 * (stretched + 4.0 * shear_stiffness * shear[t] * shear[t])
