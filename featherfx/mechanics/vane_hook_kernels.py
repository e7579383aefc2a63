"""A vane that unhooks: slip and release of the gaps between barbs, triangle by triangle.

    W = 1/2 sum k (x - p)^2 + D(p - p_0),     x = (e_ww, 2 e_vw),   k = b A (E_ww, E_vw)
    f = sqrt((<s_w> / y_w)^2 + (s_v / y_v)^2) <= level,     s = k (x - p)
    dp = mu (<s_w> / y_w^2, s_v / y_v^2),   D = level l + 1/2 c l^2,   l = mu f

x the strains of featherfx/mechanics/vane_membrane_kernels.py, p the slip of hooklets along their
barbules, p_0 that of the step's start, s stress, y yield stress times b A, <s> the positive part:
barbs that are pressed together touch and do not slip. l is the work of slip at level 1; the level
grows with it by c until the strength, while all gaps of a triangle share the slip. W is the least
over p, convex and with a continuous slope, so that slip is one more energy to Newton; its curvature
is the consistent tangent. Source of the form: Ortiz and Stainier 1999 (incremental potential) for
the associated flow that the issue of hysteresis in Jouve 2024, section 3.2 and figure 3.9, asks
for: after a cycle the force at no displacement is negative.

At the strength one gap of the triangle gives way. Over its opening d the level falls in
proportion, to nothing at the release opening R; what is spent per length of barb, 1/2 b S R (S the
strength), therefore does not depend on the height h of the triangle, for how many gaps ever it
stands. A triangle with h > E_ww R / S holds more than that: it opens at once, and the rest is
lost: the vane does not hold it, and nothing gets it. An open triangle resists only that its barbs
come nearer than they have been at most since it opened, or than at rest, however far they have
slid,

    W = 1/2 k_w (n - J)^2     for J < n, else 0;      n = min(1, largest J since it opened)

J the ratio of areas of featherfx/mechanics/guard_kernels.py: barbs keep their length, so J is
that of their distance. Barbs that are closer than at rest when they part are not thrown apart.
Bending across the barbs (vane_bending_kernels) is weakened as the gaps on either side of it.
"""

from math import sqrt
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from featherfx.algebra.vector_kernels import copy_values
from featherfx.algebra.views import shaped
from featherfx.jit.compiled import kernel, loop_kernel
from featherfx.mechanics.guard_kernels import area_ratio, ratio_slopes
from featherfx.mechanics.model import Gaps

Array = NDArray[np.float64]

# Newton iterations of the return mapping; it converges from one side
_MAX_ITERATIONS = 12
_YIELD_TOLERANCE = 1e-12
# e_ww below which barbs are so near to each other that they are looked at one by one
_CRUSHED_STRAIN = -0.3


@kernel
def _yield_measure(stress, limit):
    """f of stresses (s_w, s_v); limit: (y_w, y_v)."""
    across = max(stress[0], 0.0) / limit[0]
    shear = stress[1] / limit[1]
    return sqrt(across * across + shear * shear)


@kernel
def _relaxed(trial, rates, mu):
    """Stresses after a flow mu; trial: before, rates: k / y^2 of those that yield, else 0."""
    return trial[0] / (1.0 + mu * rates[0]), trial[1] / (1.0 + mu * rates[1])


@kernel
def _flow(trial, limit, rates, level, growth):
    """(mu, slope): flow that brings the trial stresses onto the yield surface, and the slope there
    of f (1 - growth mu) by mu. growth: c."""
    mu, slope = 0.0, -1.0
    for _ in range(_MAX_ITERATIONS):
        stress = _relaxed(trial, rates, mu)
        across, shear = max(stress[0], 0.0) / limit[0], stress[1] / limit[1]
        f = sqrt(across * across + shear * shear)
        fall = across * across * rates[0] / (1.0 + mu * rates[0])
        fall += shear * shear * rates[1] / (1.0 + mu * rates[1])
        slope = -fall / f * (1.0 - growth * mu) - growth * f
        excess = f * (1.0 - growth * mu) - level
        if excess <= _YIELD_TOLERANCE * level:
            break
        mu -= excess / slope
    return mu, slope


@kernel
def _trial(stiffness, strains, slip, limit):
    """Stresses (s_w, s_v) without flow, and k / y^2 of those that may yield."""
    trial = stiffness[0] * (strains[0] - slip[0]), stiffness[1] * (strains[1] - slip[1])
    across = stiffness[0] / (limit[0] * limit[0]) if trial[0] > 0.0 else 0.0
    return trial, (across, stiffness[1] / (limit[1] * limit[1]))


@kernel
def hooked_energy(stiffness, strains, slip, limit, level, growth):
    """W of one hooked triangle (J), with what its slip of this step costs.

    stiffness: (k_w, k_v) J. strains: (e_ww, 2 e_vw). slip: p_0. limit: (y_w, y_v) J. level: at the
    step's start, > 0. growth: c, 1/J.
    """
    trial, rates = _trial(stiffness, strains, slip, limit)
    if _yield_measure(trial, limit) <= level:
        return 0.5 * (trial[0] ** 2 / stiffness[0] + trial[1] ** 2 / stiffness[1])
    mu, _ = _flow(trial, limit, rates, level, growth)
    stress = _relaxed(trial, rates, mu)
    work = mu * _yield_measure(stress, limit)
    stored = 0.5 * (stress[0] ** 2 / stiffness[0] + stress[1] ** 2 / stiffness[1])
    return stored + level * work + 0.5 * growth * work * work


@kernel
def hooked_response(stiffness, strains, slip, limit, level, growth):
    """((s_w, s_v), (C_ww, C_wv, C_vv)): stresses and consistent tangent (J); as hooked_energy."""
    trial, rates = _trial(stiffness, strains, slip, limit)
    if _yield_measure(trial, limit) <= level:
        return trial, (stiffness[0], 0.0, stiffness[1])
    mu, slope = _flow(trial, limit, rates, level, growth)
    stress = _relaxed(trial, rates, mu)
    f = _yield_measure(stress, limit)
    across = stress[0] * rates[0] / (1.0 + mu * rates[0])
    shear = stress[1] * rates[1] / (1.0 + mu * rates[1])
    fall = (1.0 - growth * mu) / (f * slope)
    tangent = (
        stiffness[0] / (1.0 + mu * rates[0]) + fall * across * across,
        fall * across * shear,
        stiffness[1] / (1.0 + mu * rates[1]) + fall * shear * shear,
    )
    return stress, tangent


@kernel
def slip_after(stiffness, strains, slip, limit, level, growth):
    """((p_w, p_v), l): slip and its work at level 1 (J) where a step ends; as hooked_energy."""
    trial, rates = _trial(stiffness, strains, slip, limit)
    if _yield_measure(trial, limit) <= level:
        return slip, 0.0
    mu, _ = _flow(trial, limit, rates, level, growth)
    stress = _relaxed(trial, rates, mu)
    moved = (
        slip[0] + mu * max(stress[0], 0.0) / (limit[0] * limit[0]),
        slip[1] + mu * stress[1] / (limit[1] * limit[1]),
    )
    return moved, mu * _yield_measure(stress, limit)


@kernel
def open_energy(stiffness, strains, nearest):
    """W of an open triangle (J): its barbs may touch. nearest: n, others as in hooked_energy."""
    closed = max(nearest - area_ratio(strains[0], strains[1]), 0.0)
    return 0.5 * stiffness[0] * closed * closed


@kernel
def open_response(stiffness, strains, nearest):
    """((s_w, s_v), (C_ww, C_wv, C_vv)) of the same."""
    ratio = area_ratio(strains[0], strains[1])
    if ratio >= nearest:
        return (0.0, 0.0), (0.0, 0.0, 0.0)
    # of J = sqrt(2 e_ww - (2 e_vw)^2 + ...): dJ = (de - s ds) / J, d2J = -(de - s ds)^2 / J^3
    # - ds^2 / J
    by_across, by_shear = ratio_slopes(strains[0], strains[1])
    k, closed = stiffness[0], nearest - ratio
    along, twice = k * (1.0 + closed / ratio), k * closed * by_across
    return (-k * closed * by_across, -k * closed * by_shear), (
        along * by_across * by_across,
        along * by_across * by_shear,
        along * by_shear * by_shear + twice,
    )


@kernel
def gaps_of(gaps, f):
    """Those of one of many feathers, the same memory."""
    return Gaps(gaps.slip[f], gaps.level[f], gaps.hooked[f], gaps.spent[f], gaps.length[f])


@kernel
def copy_gaps(source, target):
    """All of one feather to another's."""
    copy_values(source.slip, target.slip)
    copy_values(source.level, target.level)
    copy_values(source.hooked, target.hooked)
    copy_values(source.spent, target.spent)
    copy_values(source.length, target.length)


@kernel
def never_slip(gaps):
    """Return whether no gap of a feather ever slips."""
    return gaps.level.shape[2] == 0


@loop_kernel
def _strained(cell, bounds, count):
    """Number of triangles whose strains are beyond what all gaps hold at; cell: (2 count,), e_ww
    and 2 e_vw in turns. bounds: of VaneHooks. Without branches, as the compiler wants it."""
    found = 0
    for k in range(count):
        opened = cell[2 * k]
        across = opened * bounds[0] if opened > 0.0 else 0.0
        shear = cell[2 * k + 1] * bounds[1]
        found += (across * across + shear * shear > 1.0) | (opened < _CRUSHED_STRAIN)
    return found


@loop_kernel
def _others(values, usual, count):
    """Count how many of count values are not the usual one."""
    found = 0
    for k in range(count):
        found += values[k] != usual
    return found


@kernel
def all_hold(model, f, cell, gaps):
    """Return whether all gaps of feather f are whole, have not slipped and do not at strains cell
    (2, n-1, m, 2, 2): to forces and energies the vane is then one whose hooks always hold.

    By bounds for the whole feather, which cost next to nothing; of one that has slipped gap by gap
    (`holds`). gaps: at the step's start.
    """
    if never_slip(gaps):
        return True
    hooked = shaped(gaps.hooked, (gaps.hooked.size,))
    slip = shaped(gaps.slip, (gaps.slip.size,))
    if _others(hooked, 1.0, hooked.size) + _others(slip, 0.0, slip.size) > 0:
        return False
    bounds = model.hooks.bounds[f, 0], model.hooks.bounds[f, 1]
    return _strained(shaped(cell, (cell.size,)), bounds, hooked.size) == 0


class GapRow(NamedTuple):
    """The gaps of the triangles between two rows of one side.

    limit: (m, 2, 2), growth: (m, 2), of the model's VaneHooks. slip: (m, 2, 2), level, hooked: (m,
    2), at the step's start. m is 0 where no gap slips.
    """

    limit: Array
    growth: Array
    slip: Array
    level: Array
    hooked: Array


@kernel
def row_of_gaps(hooks, f, side, i, gaps):
    """The GapRow between rows i and i + 1 of feather f; gaps: at the step's start."""
    return GapRow(
        hooks.limit[f, side, i],
        hooks.growth[f, side, i],
        gaps.slip[side, i],
        gaps.level[side, i],
        gaps.hooked[side, i],
    )


@kernel
def hinge_hold(gaps, side, i, j):
    """Part of the stiffness that the hinge on row i's barb has: what the weakest triangle of the
    cells on either side has left; gaps: of one feather."""
    return min(twist_hold(gaps, side, i, j), twist_hold(gaps, side, i - 1, j))


@kernel
def twist_hold(gaps, side, i, j):
    """The same of a cell's twist."""
    return min(gaps.hooked[side, i, j, 0], gaps.hooked[side, i, j, 1])


class Gap(NamedTuple):
    """One of them: slip (p_w, p_v), limit (y_w, y_v) J, level now, growth 1/J, hooked, and nearest:
    n of an open one."""

    slip: tuple[float, float]
    limit: tuple[float, float]
    level: float
    growth: float
    hooked: float
    nearest: float


@kernel
def gap_of(gaps, j, half):
    """The gap of triangle A or B (half) of cell j of a GapRow; what gives way does not harden."""
    hooked = gaps.hooked[j, half]
    return Gap(
        (gaps.slip[j, half, 0], gaps.slip[j, half, 1]),
        (gaps.limit[j, half, 0], gaps.limit[j, half, 1]),
        gaps.level[j, half] * hooked,
        gaps.growth[j, half] if hooked == 1.0 else 0.0,
        hooked,
        gaps.level[j, half],
    )


@kernel
def holds(stiffness, strains, gaps, j, half):
    """Return whether triangle A or B (half) of cell j of a GapRow is whole and below its yield:
    nothing of it slips. Without divisions, since most of them hold at most times."""
    level = gaps.level[j, half]
    first, second = gaps.limit[j, half, 0], gaps.limit[j, half, 1]
    across = second * max(stiffness[0] * (strains[0] - gaps.slip[j, half, 0]), 0.0)
    shear = first * stiffness[1] * (strains[1] - gaps.slip[j, half, 1])
    bound = level * first * second
    return gaps.hooked[j, half] == 1.0 and across * across + shear * shear <= bound * bound


@kernel
def gap_response(stiffness, strains, gap):
    """As hooked_response, open gaps included."""
    if gap.level <= 0.0:
        return open_response(stiffness, strains, gap.nearest)
    return hooked_response(stiffness, strains, gap.slip, gap.limit, gap.level, gap.growth)


@kernel
def gap_energy(stiffness, strains, gap):
    """W of the same (J)."""
    if gap.level <= 0.0:
        return open_energy(stiffness, strains, gap.nearest)
    return hooked_energy(stiffness, strains, gap.slip, gap.limit, gap.level, gap.growth)


@kernel
def _row_energy(gaps, stiffness, cell, before, damping):
    """Energy (J) of the triangles between two rows; stiffness, cell, before: (m, 2, 2)."""
    total = 0.0
    for j in range(stiffness.shape[0]):
        for half in range(2):
            k = stiffness[j, half, 0], stiffness[j, half, 1]
            if k[0] == 0.0:
                continue
            x = cell[j, half, 0], cell[j, half, 1]
            across, shear = x[0] - before[j, half, 0], x[1] - before[j, half, 1]
            rate = damping * (k[0] * across * across + k[1] * shear * shear)
            if holds(k, x, gaps, j, half):
                first, second = x[0] - gaps.slip[j, half, 0], x[1] - gaps.slip[j, half, 1]
                total += 0.5 * (k[0] * first * first + k[1] * second * second + rate)
            else:
                gap = gap_of(gaps, j, half)
                total += gap_energy(k, x, gap) + 0.5 * gap.hooked * rate
    return total


@kernel
def hooks_energy(model, f, cell, before, gaps, damping):
    """Energy of all triangles of a feather, damping included (J).

    cell, before: (2, n-1, m, 2, 2) strains now, and those that damping pulls towards.
    """
    total, stiffness = 0.0, model.cell_stiffness[f]
    for side in range(2):
        for i in range(stiffness.shape[1]):
            row = row_of_gaps(model.hooks, f, side, i, gaps)
            total += _row_energy(row, stiffness[side, i], cell[side, i], before[side, i], damping)
    return total
