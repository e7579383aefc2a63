"""The strains of a feather, all measured from rest: from a pose, and those of a state."""

from __future__ import annotations

from featherfx.algebra.lanes import COUNT as LANES
from featherfx.algebra.lanes import follow, lane, load, put, spread, transposed, where_there
from featherfx.algebra.vector_kernels import copy_values, sub
from featherfx.algebra.views import shaped
from featherfx.jit.compiled import kernel, loop_kernel
from featherfx.mechanics.row_kernels import node_index
from featherfx.mechanics.vane_bending_kernels import angles_and_openness, wrapped
from featherfx.mechanics.vane_membrane_kernels import membrane_strain
from featherfx.mechanics.vane_twist_kernels import cell_twist
from featherfx.solver.types import Strains


@kernel
def strains_of(strains, f, index):
    """Strains of feather f of a state: after the last step (0), the one before (1), or dashpots."""
    return strains_at(strains_at(strains, f), index)


@kernel
def strains_at(strains, index):
    """Strains at an index of the first axis of all arrays, the same memory."""
    return Strains(
        strains.rachis[index],
        strains.barb[index],
        strains.cell[index],
        strains.hinge[index],
        strains.twist[index],
        strains.openness[index],
    )


@kernel
def copy_strains(source, target):
    """All strains of one feather to others."""
    copy_values(source.rachis, target.rachis)
    copy_values(source.barb, target.barb)
    copy_values(source.cell, target.cell)
    copy_values(source.hinge, target.hinge)
    copy_values(source.twist, target.twist)
    copy_values(source.openness, target.openness)


@kernel
def feather_strains(model, f, pose, angles):
    """All strains of feather f's pose, from its points, coefficients and rachis, in place.

    angles: (2, n, m) rad, of the hinges before; dihedral angles are those within half a turn of
    them, so that a fold that closes completely and goes on has no jump.
    """
    strains = pose.strains
    for i in range(pose.rachis.shape[0]):
        for k in range(6):
            strains.rachis[i, k] = pose.rachis[i, k] - model.rachis_rest[f, i, k]
    copy_values(pose.coefficient, strains.barb)
    cell_strains(model, f, pose.points.nodes, strains.cell)
    _hinge_strains(model, f, pose.points.nodes, angles, strains)
    _twist_strains(model, f, pose.points.nodes, strains.twist)


@kernel
def cell_strains(model, f, points, strains):
    """Membrane strains (2, n-1, m, 2, 2)."""
    columns = strains.shape[2]
    for side in range(2):
        for i in range(strains.shape[1]):
            for j in range(columns):
                near, far = node_index(side, j, columns), node_index(side, j + 1, columns)
                for half in range(2):
                    across, shear = 0.0, 0.0
                    if model.cell_stiffness[f, side, i, j, half, 0] != 0.0:
                        r, o = (i, i + 1) if half == 0 else (i + 1, i)
                        across, shear = membrane_strain(
                            points[r, near],
                            points[r, far],
                            points[o, near if half == 0 else far],
                            model.cell_rest[f, side, i, j, half],
                        )
                    strains[side, i, j, half, 0] = across
                    strains[side, i, j, half, 1] = shear


@loop_kernel
def _four_threes(row, first, count):
    """Four of the threes of numbers of a row from first on, zeros beyond count of them. The number
    before each is read as well."""
    none, at = spread(0.0), 3 * first - 1
    _, x, y, z = transposed(
        load(row, at),
        load(row, at + 3) if count > 1 else none,
        load(row, at + 6) if count > 2 else none,
        load(row, at + 9) if count > 3 else none,
    )
    return x, y, z


@loop_kernel
def _put_some(line, j, count, value):
    """Write the first of four numbers to line[j] and on, of which there are count."""
    if count >= LANES:
        put(line, j, value)
        return
    for k in range(count):
        line[j + k] = lane(value, k)


@loop_kernel
def _row_of_hinges(first, rows, rest, stiffness, reference, angles, openness):
    """Hinges on one barb, whose first node is at first in its row. rows: flat nodes of the row, of
    the one above and of the one below. rest: (m, 3)."""
    own, above, below = rows
    last = spread(own[0]), spread(own[1]), spread(own[2])
    for j in range(0, stiffness.shape[0], LANES):
        count, at = stiffness.shape[0] - j, first + j
        end = _four_threes(own, at, count)
        start = follow(last[0], end[0]), follow(last[1], end[1]), follow(last[2], end[2])
        last = end
        flat, open_above, open_below = _four_threes(rest, j, count)
        angle, w = angles_and_openness(
            sub(end, start),
            sub(_four_threes(above, at, count), start),
            sub(_four_threes(below, at, count), start),
            open_above,
            open_below,
        )
        before, there = _some(reference, j, count), _some(stiffness, j, count)
        angle = wrapped(angle - flat - before) + before
        _put_some(angles, j, count, where_there(there, angle))
        _put_some(openness, j, count, 1.0 + where_there(there, w - 1.0))


@loop_kernel
def _some(line, j, count):
    """Numbers of a line from j on, zeros beyond count of them."""
    if count >= LANES:
        return load(line, j)
    a = line[j]
    b = line[j + 1] if count > 1 else 0.0
    c = line[j + 2] if count > 2 else 0.0
    none = spread(0.0)
    return transposed(spread(a), spread(b), spread(c), none)[0]


@kernel
def _hinge_strains(model, f, points, reference, strains):
    """Dihedral angles and openness; reference: (2, n, m)."""
    columns, size = reference.shape[2], points.shape[1] * 3
    flat = shaped(points, (points.size,))
    strains.hinge[:] = 0.0
    strains.openness[:] = 1.0
    for side in range(2 if columns > 0 else 0):
        for i in range(1, reference.shape[1] - 1):
            at = i * size
            _row_of_hinges(
                1 + side * columns,
                (flat[at : at + size], flat[at + size :], flat[at - size :]),
                model.hinge_rest[f, side, i],
                model.hinge_stiffness[f, side, i],
                reference[side, i],
                strains.hinge[side, i],
                strains.openness[side, i],
            )


@kernel
def _twist_strains(model, f, points, strains):
    """Twist of the cells from rest, (2, n-1, m)."""
    columns = strains.shape[2]
    for side in range(2):
        for i in range(strains.shape[1]):
            for j in range(columns):
                twist, rest = 0.0, model.twist_rest[f, side, i, j]
                if model.twist_stiffness[f, side, i, j] != 0.0:
                    near, far = node_index(side, j, columns), node_index(side, j + 1, columns)
                    low, high = points[i], points[i + 1]
                    volume = cell_twist(low[near], low[far], high[near], high[far])
                    twist = rest[0] * volume - rest[1]
                strains[side, i, j] = twist
