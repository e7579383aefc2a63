"""Forces and stiffness of a vane's triangles: strains e_ww and 2 e_vw, and the guard.

Beside k g_p g_q^T of its strains, a triangle has a geometric stiffness (vane_membrane_kernels): the
whole of it, or, where the whole matrix is indefinite, its stabilising part along the normal. A
compression guard (guard_kernels) adds to the stresses, and J as one more strain.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from featherfx.algebra.views import COUNT as LANES
from featherfx.algebra.views import load, put, spread, transposed, where_there
from featherfx.jit.compiled import kernel, loop_kernel
from featherfx.mechanics.guard_kernels import guard_slopes, is_apart
from featherfx.mechanics.vane_hook_kernels import GapRow, gap_of, gap_response, holds
from featherfx.mechanics.vane_membrane_kernels import (
    membrane_geometric_stiffness,
    membrane_normal_stiffness,
)
from featherfx.solver.types import (
    AXIS_SIZE,
    FORCES_ONLY,
    GEOMETRIC_PLACE,
    HALF_SIZE,
    PAIR_SIZE,
    STABILISING_STIFFNESS,
    STRAIN_SIZE,
    STRESS_PLACE,
    STRIP_SIZE,
    WEIGHT_PLACE,
)
from featherfx.solver.vane.line_kernels import (
    PAIR_ALONG,
    PAIR_OWN,
    PAIR_SLANT,
    PAIR_UP,
    add_outer,
    block_of,
    damped_stress,
    lanes,
    membrane_gradients,
    place_of,
    vectors,
)

Array = NDArray[np.float64]


class Strip(NamedTuple):
    """The triangles between two rows of one side.

    rest: (m, 2, 3). stiffness, strains, reference: (m, 2, 2). guard: (2, n-1, m, 2, 2) of all rows,
    or of size 0; pressed: whether any feels it. gaps: of the triangles at the step's start; held:
    whether all of the vane hold.
    """

    rest: Array
    stiffness: Array
    guard: Array
    pressed: bool
    strains: Array
    reference: Array
    held: bool
    gaps: GapRow


# part of the elastic stiffness that counts as none
_NO_STIFFNESS = 1e-12
# strains of a triangle beside e_ww and 2 e_vw: the guard's J and the one along the normal
_GUARD_STRAIN, _NORMAL_STRAIN = 0, 1


@loop_kernel
def _four_of(line, j, count, size, first):
    """Four numbers of each of the cells j to j + 3, number by number. line: of count cells, size of
    each; first: of these the first that is taken."""
    none, at = spread(0.0), j * size + first
    return transposed(
        load(line, at),
        load(line, at + size) if j + 1 < count else none,
        load(line, at + 2 * size) if j + 2 < count else none,
        load(line, at + 3 * size) if j + 3 < count else none,
    )


@loop_kernel
def _load_triangles(j, half, of_half, damping, rest, cells):
    """Those A or B (half) of the cells j to j + 3. of_half: rest values, stiffnesses, strains and
    references, each of this half."""
    known, (first, second), strain, before = of_half
    at, second = block_of(j, STRIP_SIZE) + 2 * AXIS_SIZE * half, where_there(first, second)
    for k in range(3):
        put(rest[half, k], j, where_there(first, known[k]))
    put(cells, at + WEIGHT_PLACE, first * (1.0 + damping))
    put(cells, at + WEIGHT_PLACE + AXIS_SIZE, second * (1.0 + damping))
    put(cells, at + STRESS_PLACE, damped_stress(first, strain[0], before[0], damping))
    put(cells, at + STRESS_PLACE + AXIS_SIZE, damped_stress(second, strain[1], before[1], damping))


@loop_kernel
def _load_cells(strip, damping, rest, cells):
    """Rest values, to rest (2, 3, .), stresses and stiffnesses of the triangles of a strip.

    Triangles without stiffness are not there: all their values are zero.
    """
    count = strip.stiffness.shape[0]
    for j in range(0, count, LANES):
        a0, a1, a2, b0 = _four_of(strip.rest, j, count, 6, 0)
        _, _, b1, b2 = _four_of(strip.rest, j, count, 6, 2)
        k, s = _four_of(strip.stiffness, j, count, 4, 0), _four_of(strip.strains, j, count, 4, 0)
        r = _four_of(strip.reference, j, count, 4, 0)
        of_a = (a0, a1, a2), (k[0], k[1]), (s[0], s[1]), (r[0], r[1])
        of_b = (b0, b1, b2), (k[2], k[3]), (s[2], s[3]), (r[2], r[3])
        _load_triangles(j, 0, of_a, damping, rest, cells)
        _load_triangles(j, 1, of_b, damping, rest, cells)


@kernel
def _let_slip(half, gaps, strip, damping, coupling, cells):
    """Stresses and stiffnesses of triangles A or B (half) whose gaps slip or are open; whether any
    does.

    The tangent C is that of the strains e_ww + (C_wv / C_ww) 2 e_vw, with C_ww, and 2 e_vw, with
    C_vv - C_wv^2 / C_ww: the first one's coupling is kept for _mix_strains.
    """
    coupled = False
    for j in range(gaps.level.shape[0]):
        coupling[j] = 0.0
        k = strip.stiffness[j, half, 0], strip.stiffness[j, half, 1]
        if k[0] == 0.0:
            continue
        at = place_of(j, STRIP_SIZE) + 2 * AXIS_SIZE * half
        weight, stress = at + WEIGHT_PLACE, at + STRESS_PLACE
        strain = strip.strains[j, half, 0], strip.strains[j, half, 1]
        if holds(k, strain, gaps, j, half):
            cells[stress] -= k[0] * gaps.slip[j, half, 0]
            cells[stress + AXIS_SIZE] -= k[1] * gaps.slip[j, half, 1]
            continue
        coupled, gap = True, gap_of(gaps, j, half)
        pulled, (ww, wv, vv) = gap_response(k, strain, gap)
        across, shear = damping * gap.hooked * k[0], damping * gap.hooked * k[1]
        cells[stress] = pulled[0] + across * (strain[0] - strip.reference[j, half, 0])
        cells[stress + AXIS_SIZE] = pulled[1] + shear * (strain[1] - strip.reference[j, half, 1])
        ww, vv = ww + across, vv + shear
        if ww > _NO_STIFFNESS * k[0]:
            coupling[j] = wv / ww
            vv -= wv * wv / ww
        cells[weight], cells[weight + AXIS_SIZE] = ww, vv
    return coupled


@kernel
def _mix_strains(half, columns, coupling, cells):
    """The gradient of the strain that C_ww belongs to, in place of that of e_ww, and the stresses
    with which the forces stay the same."""
    for j in range(columns):
        at = place_of(j, STRIP_SIZE)
        first, stress = at + HALF_SIZE * half, at + STRESS_PLACE + 2 * AXIS_SIZE * half
        for place in range(first, first + STRAIN_SIZE, AXIS_SIZE):
            cells[place] += coupling[j] * cells[place + STRAIN_SIZE]
        cells[stress + AXIS_SIZE] -= coupling[j] * cells[stress]


@kernel
def _add_guard(half, guard, strains, rare, cells):
    """The guard's stresses, and its J as the strain _GUARD_STRAIN; guard, strains: (m, 2, 2).
    Whether any triangle feels it."""
    pressed = False
    for j in range(guard.shape[0]):
        rare.weight[_GUARD_STRAIN, j] = 0.0
        if is_apart(guard[j, half], strains[j, half, 0], strains[j, half, 1]):
            continue
        pressed = True
        slope, curvature, by_across, by_shear = guard_slopes(
            guard[j, half], strains[j, half, 0], strains[j, half, 1]
        )
        at = place_of(j, STRIP_SIZE)
        first, stress = at + HALF_SIZE * half, at + STRESS_PLACE + 2 * AXIS_SIZE * half
        cells[stress] += slope * by_across
        cells[stress + AXIS_SIZE] += slope * by_shear
        rare.weight[_GUARD_STRAIN, j] = curvature
        for line in range(9):
            place = first + AXIS_SIZE * line
            rare.gradient[_GUARD_STRAIN, line, j] = (
                by_across * cells[place] + by_shear * cells[place + STRAIN_SIZE]
            )
    return pressed


@kernel
def _find_normal_stiffness(half, columns, own, other, rare, cells):
    """The stabilising geometric stiffness of a row of triangles, as the strain _NORMAL_STRAIN."""
    found, gradient = rare.single[2, 0], rare.single[0]
    for j in range(columns):
        stress = place_of(j, STRIP_SIZE) + STRESS_PLACE + 2 * AXIS_SIZE * half
        membrane_normal_stiffness(
            own[:, j],
            own[:, j + 1],
            other[:, j + half],
            rare.rest[half, :, j],
            (cells[stress], cells[stress + AXIS_SIZE]),
            found,
            rare.single,
        )
        rare.weight[_NORMAL_STRAIN, j] = found[0]
        for node in range(3):
            for k in range(3):
                rare.gradient[_NORMAL_STRAIN, 3 * node + k, j] = gradient[node, k]


@kernel
def _add_pairs(count, half, rare, strain, low, high):
    """_GUARD_STRAIN or _NORMAL_STRAIN (strain) of triangles A or B (half) to the blocks of the rows
    below and above them, (6, 3, 3 S)."""
    k, h, gradient = rare.weight[strain], rare.halved, rare.gradient[strain]
    for j in range(k.shape[0]):
        h[j] = 0.5 * k[j]
    a, b, c = gradient[0:3], gradient[3:6], gradient[6:9]
    if half == 0:
        add_outer(count, h, a, a, 0, low[PAIR_OWN])
        add_outer(count, h, b, b, 1, low[PAIR_OWN])
        add_outer(count, h, c, c, 0, high[PAIR_OWN])
        add_outer(count, k, a, b, 0, low[PAIR_ALONG])
        add_outer(count, k, c, a, 0, low[PAIR_UP])
        add_outer(count, k, c, b, 0, low[PAIR_SLANT])
    else:
        add_outer(count, h, a, a, 0, high[PAIR_OWN])
        add_outer(count, h, b, b, 1, high[PAIR_OWN])
        add_outer(count, h, c, c, 1, low[PAIR_OWN])
        add_outer(count, k, a, b, 0, high[PAIR_ALONG])
        add_outer(count, k, b, c, 1, low[PAIR_UP])
        add_outer(count, k, a, c, 0, low[PAIR_SLANT])


@loop_kernel
def _find_geometric_stiffness(half, count, whole, rest, cells):
    """The geometric stiffness of a row of triangles, or none of it; rest: (3, .)."""
    for j in range(0, count, LANES):
        block = block_of(j, STRIP_SIZE)
        at, stress = (
            block + GEOMETRIC_PLACE + PAIR_SIZE * half,
            block + STRESS_PLACE + 2 * AXIS_SIZE * half,
        )
        factors = membrane_geometric_stiffness(
            vectors(rest, j), load(cells, stress), load(cells, stress + AXIS_SIZE)
        )
        part = spread(1.0 if whole else 0.0)
        put(cells, at, part * factors[0])
        put(cells, at + AXIS_SIZE, part * factors[1])
        put(cells, at + 2 * AXIS_SIZE, part * factors[2])
        put(cells, at + 3 * AXIS_SIZE, part * factors[3])
        put(cells, at + 4 * AXIS_SIZE, part * factors[4])
        put(cells, at + 5 * AXIS_SIZE, part * factors[5])


@loop_kernel
def fill_strip(i, side, strip, damping, wanted, vane, cells):
    """Triangles between rows i and i + 1, to the cells of their strip; what is rare, at once to the
    blocks of both rows."""
    columns, rare = strip.stiffness.shape[0], vane.cells
    count, below, above = lanes(columns), vane.blocks[i, side], vane.blocks[i + 1, side]
    _load_cells(strip, damping, rare.rest, cells)
    for half in range(2):
        own, other = vane.nodes[i + half, side], vane.nodes[i + 1 - half, side]
        slips = False
        if not strip.held:
            slips = _let_slip(half, strip.gaps, strip, damping, rare.coupling, cells)
        membrane_gradients(count, own, other, half, rare.rest[half], cells)
        pressed = False
        if strip.pressed:
            pressed = _add_guard(half, strip.guard[side, i], strip.strains, rare, cells)
        if wanted == FORCES_ONLY:
            continue
        if pressed:
            _add_pairs(count, half, rare, _GUARD_STRAIN, below, above)
        if wanted == STABILISING_STIFFNESS:
            _find_normal_stiffness(half, columns, own, other, rare, cells)
            _add_pairs(count, half, rare, _NORMAL_STRAIN, below, above)
        _find_geometric_stiffness(
            half, count, wanted != STABILISING_STIFFNESS, rare.rest[half], cells
        )
        if slips:
            _mix_strains(half, columns, rare.coupling, cells)
