"""The strains of a feather, all measured from rest: from a pose, and those of a state.

Stresses of damped strains at the end of a step, and the history that they depend on.

A material whose loss hardly depends on the frequency (solver/damping) is a Maxwell model of B
branches, springs in series with dashpots, and a dashpot of a time t alone. Of a strain s with the
stiffness k at rest,

    stress = k (s + t ds/dt + sum_i g_i (s - v_i)),      dv_i/dt = (s - v_i) / t_i

v_i the strain of dashpot i, g_i its spring over k, t_i its time. ds/dt is the backward difference
over two steps, c / h (s - (a s_0 - b s_1) / c). Where s changes evenly from s_0 to s over a step of
h, the branches are solved exactly:

    s - v_i = p_i (s - s_0) + a_i (s_0 - v_i0),      a_i = exp(-h / t_i),  p_i = (1 - a_i) t_i / h

so that at the end of the step, with no unknown beside those of s,

    stress = k (s + q (s - r)),      q = t c / h + sum g_i p_i

Branches are second order in h, and r lies between strains of before, as p_i >= a_i. To a vibration
of phase w a step a branch gives k g p (1 - z) / (1 - a z), z = exp(-i w), whose imaginary part has
the sign of p (1 - a) sin(w): it takes energy at every length of step (derived here).
"""

from __future__ import annotations

from math import exp, expm1

from featherfx.algebra.vector_kernels import copy_values, sub
from featherfx.algebra.views import COUNT as LANES
from featherfx.algebra.views import follow, lane, load, put, shaped, spread, transposed, where_there
from featherfx.jit.compiled import kernel, loop_kernel
from featherfx.mechanics.barb_kernels import node_index
from featherfx.mechanics.vane_bending_kernels import angles_and_openness, cell_twist, wrapped
from featherfx.mechanics.vane_membrane_kernels import membrane_strain
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


@kernel
def _decay(h, time):
    """Return a and p of a branch of a time (s) over a step of h (s)."""
    if h <= 0.0:
        return 1.0, 1.0
    return exp(-h / time), -expm1(-h / time) * time / h


@kernel
def _difference_weights(h, before):
    """(a, b, c) of the backward difference; before: s, of the last step, 0 for the one-step one."""
    if before <= 0.0:
        return 1.0, 0.0, 1.0
    r = h / before
    return 1.0 + r, r * r / (1.0 + r), (1.0 + 2.0 * r) / (1.0 + r)


@kernel
def difference_rate(h, before):
    """Return c / h of the backward difference, 1/s."""
    return _difference_weights(h, before)[2] / h


@kernel
def damping_over(model, f, part, h, before):
    """Return q of the rachis (part 0) or the vane (1) of feather f over a step of h (s).

    before: s, of the step before it, 0 for a difference over one step.
    """
    total = model.retardation[f, part] * difference_rate(h, before)
    for i in range(model.relaxation_time.shape[2]):
        _, passed = _decay(h, model.relaxation_time[f, part, i])
        total += model.relaxation_weight[f, part, i] * passed
    return total


@kernel
def set_reference(model, f, part, steps, span, history, reference):
    """Set r of strains of part 0 or 1.

    steps: (h, before) of damping_over. history: (2 + B, ...), strains at the step's start, at that
    of the last one, and of the dashpots. reference: (...). span: first and last of those that are
    set, in order.
    """
    (first, last), (h, before), count = span, steps, reference.size
    past, out = shaped(history, (history.shape[0], count)), shaped(reference, (count,))
    start, out = past[0, first:last], out[first:last]
    _, b, c = _difference_weights(h, before)
    whole = damping_over(model, f, part, h, before)
    own = model.retardation[f, part] * (c / h) / whole if whole > 0.0 else 1.0
    copy_values(start, out)
    _move(-own * b / c, start, past[1, first:last], out)
    for i in range(model.relaxation_time.shape[2] if whole > 0.0 else 0):
        decayed, _ = _decay(h, model.relaxation_time[f, part, i])
        pull = model.relaxation_weight[f, part, i] * decayed / whole
        _move(pull, start, past[2 + i, first:last], out)


@kernel
def _move(part, start, end, out):
    """Add a part of the way from start to end to out, all (.,)."""
    for k in range(out.size):
        out[k] += part * (end[k] - start[k])


@kernel
def relax(model, f, part, h, span, now, history, out):
    """Set the strains of dashpots at the end of a step of h (s) that ends with strains now, in out,
    which may be the history; others as in set_reference."""
    count = now.size
    past, end = shaped(history, (history.shape[0], count)), shaped(now, (count,))
    to, (first, last) = shaped(out, (history.shape[0], count)), span
    for i in range(model.relaxation_time.shape[2]):
        decayed, passed = _decay(h, model.relaxation_time[f, part, i])
        for k in range(first, last):
            start = past[0, k]
            lag = passed * (end[k] - start) + decayed * (start - past[2 + i, k])
            to[2 + i, k] = end[k] - lag


@kernel
def _set_whole_reference(model, f, part, steps, history, reference):
    set_reference(model, f, part, steps, (0, reference.size), history, reference)


@kernel
def set_reference_strains(model, f, steps, history, reference):
    """As set_reference, of all strains of feather f."""
    _set_whole_reference(model, f, 0, steps, history.rachis, reference.rachis)
    _set_whole_reference(model, f, 1, steps, history.barb, reference.barb)
    _set_whole_reference(model, f, 1, steps, history.cell, reference.cell)
    _set_whole_reference(model, f, 1, steps, history.hinge, reference.hinge)
    _set_whole_reference(model, f, 1, steps, history.twist, reference.twist)


@kernel
def _relax_whole(model, f, part, h, now, history, out):
    relax(model, f, part, h, (0, now.size), now, history, out)


@kernel
def relax_strains(model, f, h, now, history, out):
    """As relax, of all strains of feather f."""
    _relax_whole(model, f, 0, h, now.rachis, history.rachis, out.rachis)
    _relax_whole(model, f, 1, h, now.barb, history.barb, out.barb)
    _relax_whole(model, f, 1, h, now.cell, history.cell, out.cell)
    _relax_whole(model, f, 1, h, now.hinge, history.hinge, out.hinge)
    _relax_whole(model, f, 1, h, now.twist, history.twist, out.twist)


@kernel
def relax_fully(history):
    """Put the dashpots of a feather where its strains are."""
    for i in range(1, history.rachis.shape[0]):
        copy_strains(strains_at(history, 0), strains_at(history, i))
