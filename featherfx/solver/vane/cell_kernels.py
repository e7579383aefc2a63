"""Forces and stiffness of a vane's triangles: strains e_ww and 2 e_vw, and the guard.

Beside k g_p g_q^T of its strains, a triangle has a geometric stiffness (vane_membrane_kernels): the
whole of it, or, where the whole matrix is indefinite, its stabilising part along the normal. A
compression guard (vane_guard_kernels) adds to the stresses, and J as one more strain.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from featherfx.jit.compiled import kernel
from featherfx.mechanics.vane_guard_kernels import guard_slopes, is_apart
from featherfx.mechanics.vane_hook_kernels import GapRow, gap_of, gap_response, holds
from featherfx.mechanics.vane_membrane_kernels import (
    membrane_geometric_stiffness,
    membrane_normal_stiffness,
)
from featherfx.solver.vane.line_kernels import (
    add_diagonal,
    add_forces,
    add_strains_outer,
    lanes,
    membrane_gradients,
)
from featherfx.solver.vane.pairs_kernels import (
    ALONG,
    FORCES_ONLY,
    OWN,
    SLANT,
    STABILISING,
    UP,
    WHOLE,
    damped_stress,
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
NOTHING = 1e-12
# strains of a triangle: e_ww, 2 e_vw, the guard's J and the one along the normal
GUARD, NORMAL = 2, 3


@kernel
def _load_cells(half, strip, damping, cells):
    """Rest values, stresses and stiffnesses of triangles A or B (half) of a strip, to lines.

    Triangles without stiffness are not there: all their values are zero.
    """
    strains, reference = strip.strains, strip.reference
    for j in range(strip.stiffness.shape[0]):
        there = strip.stiffness[j, half, 0] != 0.0
        for k in range(3):
            cells.rest[k, j] = strip.rest[j, half, k] if there else 0.0
        for k in range(2):
            value = strip.stiffness[j, half, k] if there else 0.0
            cells.weight[k, 0, j] = value * (1.0 + damping)
            cells.weight[k, 1, j] = 0.5 * value * (1.0 + damping)
            cells.stress[k, j] = damped_stress(
                value, strains[j, half, k], reference[j, half, k], damping
            )


@kernel
def _let_slip(half, gaps, strip, damping, cells):
    """Stresses and stiffnesses of triangles A or B (half) whose gaps slip or are open; whether any
    does.

    The tangent C is that of the strains e_ww + (C_wv / C_ww) 2 e_vw, with C_ww, and 2 e_vw, with
    C_vv - C_wv^2 / C_ww: the first one's coupling is kept for _mix_strains.
    """
    coupled = False
    for j in range(gaps.level.shape[0]):
        cells.coupling[j] = 0.0
        k = strip.stiffness[j, half, 0], strip.stiffness[j, half, 1]
        if k[0] == 0.0:
            continue
        strain = strip.strains[j, half, 0], strip.strains[j, half, 1]
        if holds(k, strain, gaps, j, half):
            cells.stress[0, j] -= k[0] * gaps.slip[j, half, 0]
            cells.stress[1, j] -= k[1] * gaps.slip[j, half, 1]
            continue
        coupled, gap = True, gap_of(gaps, j, half)
        stress, (ww, wv, vv) = gap_response(k, strain, gap)
        across, shear = damping * gap.hooked * k[0], damping * gap.hooked * k[1]
        cells.stress[0, j] = stress[0] + across * (strain[0] - strip.reference[j, half, 0])
        cells.stress[1, j] = stress[1] + shear * (strain[1] - strip.reference[j, half, 1])
        ww, vv = ww + across, vv + shear
        if ww > NOTHING * k[0]:
            cells.coupling[j] = wv / ww
            vv -= wv * wv / ww
        cells.weight[0, 0, j], cells.weight[0, 1, j] = ww, 0.5 * ww
        cells.weight[1, 0, j], cells.weight[1, 1, j] = vv, 0.5 * vv
    return coupled


@kernel
def _mix_strains(columns, coupling, gradient):
    """The gradient of the strain that C_ww belongs to, in place of that of e_ww."""
    for j in range(columns):
        for node in range(3):
            for k in range(3):
                gradient[0, node, k, j] += coupling[j] * gradient[1, node, k, j]


@kernel
def _add_guard(half, guard, strains, cells):
    """The guard's stresses, and its J as the strain GUARD; guard, strains: (m, 2, 2). Whether any
    triangle feels it."""
    gradient, pressed = cells.gradient, False
    for j in range(guard.shape[0]):
        cells.weight[GUARD, 0, j], cells.weight[GUARD, 1, j] = 0.0, 0.0
        if is_apart(guard[j, half], strains[j, half, 0], strains[j, half, 1]):
            continue
        pressed = True
        slope, curvature, by_across, by_shear = guard_slopes(
            guard[j, half], strains[j, half, 0], strains[j, half, 1]
        )
        cells.stress[0, j] += slope * by_across
        cells.stress[1, j] += slope * by_shear
        cells.weight[GUARD, 0, j], cells.weight[GUARD, 1, j] = curvature, 0.5 * curvature
        for node in range(3):
            for k in range(3):
                gradient[GUARD, node, k, j] = (
                    by_across * gradient[0, node, k, j] + by_shear * gradient[1, node, k, j]
                )
    return pressed


@kernel
def _find_normal_stiffness(columns, own, other, shift, cells):
    """The stabilising geometric stiffness of a row of triangles, as the strain NORMAL."""
    for j in range(columns):
        membrane_normal_stiffness(
            own[:, j],
            own[:, j + 1],
            other[:, j + shift],
            cells.rest[:, j],
            (cells.stress[0, j], cells.stress[1, j]),
            cells.single[2, 0],
            cells.single,
        )
        value = cells.single[2, 0, 0]
        cells.weight[NORMAL, 0, j], cells.weight[NORMAL, 1, j] = value, 0.5 * value
        for node in range(3):
            for k in range(3):
                cells.gradient[NORMAL, node, k, j] = cells.single[0, node, k]


@kernel
def _add_pairs(count, half, weight, gradient, low, high):
    """One or two strains of triangles A or B (half) to the blocks of the rows below and above them.

    weight: (strains, 2, .) stiffness and half of it. gradient: (strains, nodes, 3, .). low, high:
    (6, 3, 3 S).
    """
    k, h, g = weight[:, 0], weight[:, 1], gradient
    if half == 0:
        add_strains_outer(count, h, g, (0, 0), 0, low[OWN])
        add_strains_outer(count, h, g, (1, 1), 1, low[OWN])
        add_strains_outer(count, h, g, (2, 2), 0, high[OWN])
        add_strains_outer(count, k, g, (0, 1), 0, low[ALONG])
        add_strains_outer(count, k, g, (2, 0), 0, low[UP])
        add_strains_outer(count, k, g, (2, 1), 0, low[SLANT])
    else:
        add_strains_outer(count, h, g, (0, 0), 0, high[OWN])
        add_strains_outer(count, h, g, (1, 1), 1, high[OWN])
        add_strains_outer(count, h, g, (2, 2), 1, low[OWN])
        add_strains_outer(count, k, g, (0, 1), 0, high[ALONG])
        add_strains_outer(count, k, g, (1, 2), 1, low[UP])
        add_strains_outer(count, k, g, (0, 2), 0, low[SLANT])


@kernel
def _find_geometric_stiffness(columns, cells):
    """The whole geometric stiffness of a row of triangles, to geometric (6, .)."""
    rest, stress, factors = cells.rest, cells.stress, cells.geometric
    for j in range(columns):
        of_cell = membrane_geometric_stiffness(
            (rest[0, j], rest[1, j], rest[2, j]), stress[0, j], stress[1, j]
        )
        for pair in range(6):
            factors[pair, j] = of_cell[pair]


@kernel
def _add_geometric_stiffness(count, half, factors, low, high):
    """As _add_pairs, of the whole geometric stiffness."""
    if half == 0:
        add_diagonal(count, factors[0], 0, low[OWN])
        add_diagonal(count, factors[1], 1, low[OWN])
        add_diagonal(count, factors[2], 0, high[OWN])
        add_diagonal(count, factors[3], 0, low[ALONG])
        add_diagonal(count, factors[4], 0, low[UP])
        add_diagonal(count, factors[5], 0, low[SLANT])
    else:
        add_diagonal(count, factors[0], 0, high[OWN])
        add_diagonal(count, factors[1], 1, high[OWN])
        add_diagonal(count, factors[2], 1, low[OWN])
        add_diagonal(count, factors[3], 0, high[ALONG])
        add_diagonal(count, factors[5], 1, low[UP])
        add_diagonal(count, factors[4], 0, low[SLANT])


@kernel
def add_strip(i, side, half, strip, damping, wanted, vane):
    """Triangles A or B (half) between rows i and i + 1."""
    columns, cells, guard = strip.stiffness.shape[0], vane.cells, strip.guard
    count, gradient, stress = lanes(columns), cells.gradient, cells.stress
    own, other = vane.nodes[i + half, side], vane.nodes[i + 1 - half, side]
    on_own, on_other = vane.pull[i + half, side], vane.pull[i + 1 - half, side]
    _load_cells(half, strip, damping, cells)
    slips = False if strip.held else _let_slip(half, strip.gaps, strip, damping, cells)
    membrane_gradients(count, own, other, half, cells.rest, gradient)
    pressed = False
    if strip.pressed:
        pressed = _add_guard(half, guard[side, i], strip.strains, cells)
    for strain in range(2):
        add_forces(count, stress[strain], gradient[strain, 0], 0, on_own)
        add_forces(count, stress[strain], gradient[strain, 1], 1, on_own)
        add_forces(count, stress[strain], gradient[strain, 2], half, on_other)
    if wanted == FORCES_ONLY:
        return
    if wanted == STABILISING:
        _find_normal_stiffness(columns, own, other, half, cells)
    if slips:
        _mix_strains(columns, cells.coupling, gradient)
    low, high = vane.blocks[i, side], vane.blocks[i + 1, side]
    _add_pairs(count, half, cells.weight[:GUARD], gradient[:GUARD], low, high)
    for strain in range(GUARD, NORMAL + 1):
        if (strain == GUARD and not pressed) or (strain == NORMAL and wanted == WHOLE):
            continue
        this = slice(strain, strain + 1)
        _add_pairs(count, half, cells.weight[this], gradient[this], low, high)
    if wanted == WHOLE:
        _find_geometric_stiffness(columns, cells)
        _add_geometric_stiffness(count, half, cells.geometric, low, high)
