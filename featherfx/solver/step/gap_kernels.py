"""Gaps between barbs after a step: they slip, grow weaker, and open.

Within a step hooks only slip, so that its energy is convex. Afterwards gaps that have reached the
strength give way: in proportion to their slip where their triangle holds less than the opening
costs, else at once (vane_hook_kernels). At once only one gap of each vane opens in a step, the one
that slipped most at its strength: what was stressed as much as it may be relieved then, and splits
run along barbs because the stress beside an opened triangle is higher in the same gap.

Barbs that nothing joins may touch. That they do not pass through each other within one step is told
by the normal N of the triangle between them, over its size at rest, so that |N| is their distance
over that at rest: a normal that turns over from N_0 to N_1, past zero by less than half of where
they touch,

    N_0.N_1 < 0,      min |N_0 + t (N_1 - N_0)| < n / 2

has not gone round. Such a step is repeated shorter where it can be.
"""

from math import inf, sqrt

from featherfx.algebra.vector_kernels import add, dot, length, normal_of, scale, sub
from featherfx.jit.compiled import kernel, shared_kernel
from featherfx.mechanics.barb_kernels import node_index
from featherfx.mechanics.guard_kernels import area_ratio
from featherfx.mechanics.vane_hook_kernels import (
    all_hold,
    copy_gaps,
    gap_of,
    holds,
    never_slip,
    row_of_gaps,
    slip_after,
)

# slip in one step, as a strain, above which the step is repeated shorter where it can be
MAX_STEP_SLIP = 0.02
# error over tolerance of a step in which barbs pass through each other, and how near that is, over
# the distance at which they touch
PASSED_ERROR_RATIO, _PASS_DISTANCE_RATIO = 8.0, 0.5
# part of the strength that counts as none
LOOSE_FRACTION = 1e-3
# of Gaps.spent
SLIP_WORK, OPENING_WORK, RELEASED_ENERGY, PREENING_WORK, DAMPED_ENERGY = 0, 1, 2, 3, 4
# of Gaps.length
OPENED_LENGTH, HEALED_LENGTH = 0, 1


@shared_kernel(float)
def slip_gaps(model, f, cell, before, after):
    """Gaps after the slip of a step, and the level that it brings; returns the largest slip of the
    step, a strain.

    cell: (2, n-1, m, 2, 2) strains at the step's end. before, after: Gaps at its start and end.
    """
    if never_slip(before):
        return 0.0
    copy_gaps(before, after)
    if all_hold(model, f, cell, before):
        return 0.0
    largest, stiffness = 0.0, model.cell_stiffness[f]
    for side in range(2):
        for i in range(cell.shape[1]):
            row = row_of_gaps(model.hooks, f, side, i, before)
            for j in range(cell.shape[2]):
                for half in range(2):
                    k, x = stiffness[side, i, j, half], cell[side, i, j, half]
                    if k[0] == 0.0 or holds(k, x, row, j, half):
                        continue
                    gap = gap_of(row, j, half)
                    if gap.level <= 0.0:
                        after.level[side, i, j, half] = max(gap.nearest, _distance(x))
                        continue
                    slip, work = slip_after(
                        (k[0], k[1]), (x[0], x[1]), gap.slip, gap.limit, gap.level, gap.growth
                    )
                    across, shear = slip[0] - gap.slip[0], slip[1] - gap.slip[1]
                    after.level[side, i, j, half] += gap.growth * work
                    after.slip[side, i, j, half, 0] = slip[0]
                    after.slip[side, i, j, half, 1] = slip[1]
                    largest = max(largest, sqrt(across * across + shear * shear))
    return largest


@kernel
def _touching(model, f, gaps, place):
    """n of barbs that nothing joins at a triangle (side, i, j, half), else 0."""
    side, i, j, half = place
    if not never_slip(gaps) and gaps.hooked[side, i, j, half] == 0.0:
        return gaps.level[side, i, j, half]
    guard = model.cell_guard[f]
    loose = guard.shape[0] > 0 and guard[side, i, j, half, 1] < 1.0
    return guard[side, i, j, half, 1] if loose else 0.0


@kernel
def _normal(points, side, i, j, half):
    """Normal of triangle A or B (half) of a cell, as long as twice its area."""
    columns = points.shape[1] // 2
    near, far = node_index(side, j, columns), node_index(side, j + 1, columns)
    row, other, tip = (i, i + 1, near) if half == 0 else (i + 1, i, far)
    return normal_of(points[row, near], points[row, far], points[other, tip])


@kernel
def _passes(first, second, least):
    """Return whether a normal turns over from one to another and is shorter than the least
    between."""
    change = sub(second, first)
    if dot(first, second) >= 0.0:
        return False
    part = -dot(first, change) / dot(change, change)
    return length(add(first, scale(part, change))) < least


@kernel
def barbs_pass(model, f, before, after, cell, gaps):
    """Return whether loose barbs pass through each other on their way between two poses.

    before, after: nodes (n, 1 + 2 m, 3). cell: strains of the latter. gaps: at the step's start.
    """
    slips = not never_slip(gaps)
    if (slips or model.cell_guard.shape[1] == 0) and all_hold(model, f, cell, gaps):
        return False
    rest = model.cell_rest[f]
    for side in range(rest.shape[0]):
        for i in range(rest.shape[1]):
            for j in range(rest.shape[2]):
                for half in range(2):
                    near = _PASS_DISTANCE_RATIO * _touching(model, f, gaps, (side, i, j, half))
                    if near == 0.0 or rest[side, i, j, half, 0] == 0.0:
                        continue
                    size = rest[side, i, j, half, 0] * rest[side, i, j, half, 2]
                    first = _normal(before, side, i, j, half)
                    if _passes(first, _normal(after, side, i, j, half), near / size):
                        return True
    return False


@kernel
def _distance(strain):
    """n of a triangle that opens at strains (2,), or has been there while it was open."""
    return min(1.0, area_ratio(strain[0], strain[1]))


@kernel
def _has_slipped(slip, before):
    """Return whether a slip, (2,), is another one than before."""
    return slip[0] != before[0] or slip[1] != before[1]


@kernel
def _slip_work(slip, gap):
    """l, the work at level 1 (J) of the way from a gap's slip to a new one, (2,)."""
    across = gap.limit[0] * (slip[0] - gap.slip[0])
    shear = gap.limit[1] * (slip[1] - gap.slip[1])
    return sqrt(across * across + shear * shear)


@kernel
def _stored(stiffness, strain, slip):
    """Elastic energy (J) that a triangle loses when it opens; all (2,)."""
    across, shear = strain[0] - slip[0], strain[1] - slip[1]
    held = 0.5 * (stiffness[0] * across * across + stiffness[1] * shear * shear)
    return held


@kernel
def _is_brittle(hooks, f, place, stiffness):
    """Return whether a triangle at its strength holds more energy than its opening costs.

    place: (side, i, j, half). stiffness: (2,) J.
    """
    side, i, j, half = place
    limit, release = hooks.limit[f, side, i, j, half, 0], hooks.release[f, side, i, j, half]
    return limit * limit * hooks.strength[f] >= stiffness[0] * release


@kernel
def half_cell(model, f, side, i, half):
    """m, the length of a gap that triangle A or B (half) between rows i and i + 1 stands for."""
    return 0.5 * model.segment[f, side, i + half]


@kernel
def _harden(hooks, f, place, work, gap, after):
    """Level of a hooked triangle after slip of work (J at level 1), in place; returns the work that
    was done at its strength."""
    side, i, j, half = place
    strength, level = hooks.strength[f], gap.level + gap.growth * work
    after.level[side, i, j, half] = min(level, strength)
    if level < strength:
        return 0.0
    return (level - strength) / gap.growth if gap.growth > 0.0 else work


@kernel
def _weaken(hooks, f, place, beyond, strain, after):
    """Hooks that are left of a triangle after slip at its strength (beyond, J at level 1), in
    place; returns whether it opens."""
    side, i, j, half = place
    hooked = after.hooked[side, i, j, half]
    left = hooked - beyond / hooks.release[f, side, i, j, half]
    after.hooked[side, i, j, half] = left if left > LOOSE_FRACTION else 0.0
    if left <= LOOSE_FRACTION:
        after.level[side, i, j, half] = _distance(strain)
    return left <= LOOSE_FRACTION


@kernel
def _open(hooks, f, place, stiffness, strain, after):
    """Open a triangle, in place; what it held beyond the cost is released."""
    side, i, j, half = place
    held = _stored(stiffness, strain, after.slip[side, i, j, half])
    # in shear a triangle may hold less than its opening across would cost
    cost = min(0.5 * hooks.strength[f] * hooks.release[f, side, i, j, half], held)
    after.hooked[side, i, j, half] = 0.0
    after.level[side, i, j, half] = _distance(strain)
    after.spent[OPENING_WORK] += cost
    after.spent[RELEASED_ENERGY] += held - cost


@kernel
def _slip_row(model, f, side, i, cell, before, after):
    """Account for the slip of the triangles between two rows, whose gaps weaken, in place.

    Returns the largest slip of a brittle triangle at its strength, a strain.
    """
    hooks, farthest = model.hooks, 0.0
    row = row_of_gaps(hooks, f, side, i, before)
    for j in range(after.slip.shape[2]):
        for half in range(2):
            if not _has_slipped(after.slip[side, i, j, half], row.slip[j, half]):
                continue
            place, gap = (side, i, j, half), gap_of(row, j, half)
            work = _slip_work(after.slip[side, i, j, half], gap)
            if work == 0.0:
                continue
            cost, beyond = work * (gap.level + 0.5 * gap.growth * work), work
            if gap.hooked == 1.0:
                beyond = _harden(hooks, f, place, work, gap, after)
            if beyond == 0.0 or hooks.release[f, side, i, j, half] == inf:
                after.spent[SLIP_WORK] += cost
            elif _is_brittle(hooks, f, place, model.cell_stiffness[f, side, i, j, half]):
                after.spent[SLIP_WORK] += cost
                farthest = max(farthest, beyond / gap.limit[0])
            else:
                after.spent[OPENING_WORK] += cost
                if _weaken(hooks, f, place, beyond, cell[side, i, j, half], after):
                    after.length[OPENED_LENGTH] += half_cell(model, f, side, i, half)
    return farthest


@kernel
def _open_row(model, f, side, i, cell, before, after):
    """Open the brittle triangles of a gap that have slipped at their strength."""
    hooks, row = model.hooks, row_of_gaps(model.hooks, f, side, i, before)
    for j in range(after.slip.shape[2]):
        for half in range(2):
            place, gap = (side, i, j, half), gap_of(row, j, half)
            stiffness = model.cell_stiffness[f, side, i, j, half]
            work = _slip_work(after.slip[side, i, j, half], gap)
            strong = after.level[side, i, j, half] < hooks.strength[f]
            if work > 0.0 and not strong and _is_brittle(hooks, f, place, stiffness):
                _open(hooks, f, place, stiffness, cell[side, i, j, half], after)
                after.length[OPENED_LENGTH] += half_cell(model, f, side, i, half)


@shared_kernel(float)
def weaken_gaps(model, f, cell, before, after):
    """Weaken and open the gaps of feather f where a step ends; returns what they release, J.

    cell: (2, n-1, m, 2, 2) strains at the step's end. before: Gaps at its start. after: those of
    slip_gaps, changed in place.
    """
    if never_slip(before) or all_hold(model, f, cell, before):
        return 0.0
    for side in range(after.slip.shape[0]):
        first, farthest = -1, 0.0
        for i in range(after.slip.shape[1]):
            slipped = _slip_row(model, f, side, i, cell, before, after)
            if slipped > farthest:
                first, farthest = i, slipped
        if first >= 0:
            _open_row(model, f, side, first, cell, before, after)
    return after.spent[RELEASED_ENERGY] - before.spent[RELEASED_ENERGY]
