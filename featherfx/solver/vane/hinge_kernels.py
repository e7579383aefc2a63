"""Forces and stiffness of a vane's hinges and of its twist (vane_bending_kernels,
vane_bending_kernels), barb by barb.

Stiffness that damping gives hinges of which a triangle is crushed.

Their energy is 1/2 k w^2 (g^2 + q (t - t_r)^2), with the openness w (vane_bending_kernels). The
elastic part is the square of one strain, w g, whose stiffness is summed with that of other hinges;
the other one is that of another, w (t - t_r), and resists a hinge that turns as its triangle opens
so that w g stays. Without it such a turn would seem to cost nothing, and Newton would go too far.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from featherfx.algebra.vector_kernels import accumulate
from featherfx.jit.compiled import kernel, loop_kernel
from featherfx.mechanics.vane_bending_kernels import folded, hinge_gradient, openness_gradient
from featherfx.mechanics.vane_hook_kernels import all_hold, hinge_hold
from featherfx.solver.types import (
    AXIS_SIZE,
    HINGE_SIZE,
    HINGE_STRESS_PLACE,
    HINGE_WEIGHT_PLACE,
    NODE_SIZE,
    STRESS_PLACE,
    STRIP_SIZE,
    TWIST_LANE,
    WEIGHT_PLACE,
)
from featherfx.solver.vane.line_kernels import (
    PAIR_ALONG,
    PAIR_BACK,
    PAIR_OWN,
    PAIR_SKIP,
    PAIR_SLANT,
    PAIR_UP,
    damped_stress,
    hinge_gradients,
    lanes,
    place_of,
    twist_gradients,
)

Array = NDArray[np.float64]


class Hinges(NamedTuple):
    """The hinges on one barb.

    rest: (m, 3). stiffness, angle, openness, reference: (m,), angle and its reference from rest.
    """

    rest: Array
    stiffness: Array
    angle: Array
    openness: Array
    reference: Array


@kernel
def _load_hinges(hinges, damping, cells):
    """Stresses and stiffnesses of a row of hinges."""
    for j in range(hinges.stiffness.shape[0]):
        value, angle = hinges.stiffness[j], hinges.angle[j]
        fold, slope = folded(angle)
        lag, at = angle - hinges.reference[j], place_of(j, HINGE_SIZE)
        cells[at + HINGE_WEIGHT_PLACE] = value * (slope * slope + damping)
        cells[at + HINGE_STRESS_PLACE] = value * (fold * slope + damping * lag)


@kernel
def _crush(j, strain, cells, shrink, pull, above, below):
    """Hinge j, of which a triangle is crushed: its strain is the fold times its openness.

    strain: (fold, openness times the fold's derivative by the angle, derivatives of the energy by
    angle and openness). cells: with the gradient of the angle, in, and of the strain, out. shrink:
    (4, 3) gradient of the openness. pull, above, below: (3, .) forces on the nodes of its barb and
    of those around it, to which its own are added.
    """
    fold, openness, by_angle, by_openness = strain
    for k in range(3):
        for node in range(4):
            at = place_of(j, HINGE_SIZE) + NODE_SIZE * node + AXIS_SIZE * k
            force = by_angle * cells[at] + by_openness * shrink[node, k]
            cells[at] = openness * cells[at] + fold * shrink[node, k]
            if node < 2:
                pull[k, j + node] += force
            elif node == 2:
                above[k, j + 1] += force
            else:
                below[k, j + 1] += force


@kernel
def _crush_hinges(i, side, hinges, damping, vane, cells):
    """Hinges of row i of which a triangle is crushed; their stress is left zero."""
    pull, shrink = vane.pull, vane.cells.single[0]
    own, up, down = vane.nodes[i, side], vane.nodes[i + 1, side], vane.nodes[i - 1, side]
    on_own, on_up, on_down = pull[i, side], pull[i + 1, side], pull[i - 1, side]
    for j in range(hinges.stiffness.shape[0]):
        stiffness, openness = hinges.stiffness[j], hinges.openness[j]
        if stiffness == 0.0 or openness >= 1.0:
            continue
        corners = own[:, j], own[:, j + 1], up[:, j + 1], down[:, j + 1]
        openness_gradient(*corners, hinges.rest[j, 1], hinges.rest[j, 2], shrink)
        (fold, slope), lag = folded(hinges.angle[j]), hinges.angle[j] - hinges.reference[j]
        by_angle = stiffness * openness * openness * (fold * slope + damping * lag)
        by_openness = stiffness * openness * (fold * fold + damping * lag * lag)
        strain = fold, slope * openness, by_angle, by_openness
        _crush(j, strain, cells, shrink, on_own, on_up, on_down)
        cells[place_of(j, HINGE_SIZE) + HINGE_STRESS_PLACE] = 0.0
        # of the elastic part; that of damping: hinge_kernels
        cells[place_of(j, HINGE_SIZE) + HINGE_WEIGHT_PLACE] = stiffness


@loop_kernel
def fill_hinges(i, side, hinges, damping, vane, cells):
    """Hinges on row i's barb."""
    nodes, count = vane.nodes, lanes(hinges.stiffness.shape[0])
    _load_hinges(hinges, damping, cells)
    hinge_gradients(count, nodes[i, side], nodes[i + 1, side], nodes[i - 1, side], cells)
    _crush_hinges(i, side, hinges, damping, vane, cells)


class Twists(NamedTuple):
    """The cells between two barbs. rest: (m, 2). stiffness, twist, reference: (m,), twist and its
    reference from rest."""

    rest: Array
    stiffness: Array
    twist: Array
    reference: Array


@loop_kernel
def fill_twists(i, side, twists, damping, vane, cells):
    """Twist of the cells between rows i and i + 1, to their strip."""
    nodes = vane.nodes
    for j in range(twists.stiffness.shape[0]):
        value, factor = twists.stiffness[j], twists.rest[j, 0]
        stress = damped_stress(value, twists.twist[j], twists.reference[j], damping)
        at = place_of(j, STRIP_SIZE) + TWIST_LANE
        cells[at + WEIGHT_PLACE] = value * (1.0 + damping) * factor * factor
        cells[at + STRESS_PLACE] = factor * stress
    count = lanes(twists.stiffness.shape[0])
    twist_gradients(count, nodes[i, side], nodes[i + 1, side], cells)


@kernel
def _add(block, j, weight, left, right):
    """Weight times gradients left by right (3,), added at node j of a block (3, 3 S)."""
    size = block.shape[1] // 3
    for m in range(3):
        for k in range(3):
            block[m, k * size + j] += weight * left[k] * right[m]


@kernel
def _add_square(blocks, i, j, weight, slopes):
    """Add the square of a strain of hinge j on row i's barb to the blocks (n, 6, 3, 3 S) of its
    side.

    slopes: (4, 3), its gradient by nodes.
    """
    start, end, above, below = slopes[0], slopes[1], slopes[2], slopes[3]
    _add(blocks[i, PAIR_OWN], j, 0.5 * weight, start, start)
    _add(blocks[i, PAIR_OWN], j + 1, 0.5 * weight, end, end)
    _add(blocks[i + 1, PAIR_OWN], j + 1, 0.5 * weight, above, above)
    _add(blocks[i - 1, PAIR_OWN], j + 1, 0.5 * weight, below, below)
    _add(blocks[i, PAIR_ALONG], j, weight, start, end)
    _add(blocks[i, PAIR_UP], j + 1, weight, above, end)
    _add(blocks[i - 1, PAIR_UP], j + 1, weight, end, below)
    _add(blocks[i - 1, PAIR_SLANT], j, weight, start, below)
    _add(blocks[i, PAIR_BACK], j + 1, weight, above, start)
    _add(blocks[i, PAIR_SKIP], j + 1, weight, above, below)


@kernel
def _damped_slopes(corners, rest, openness, lag, single):
    """Gradient of the openness times the lag of a hinge, to single[0]. rest: (3,) of hinge_rest."""
    slopes, shrink = single[0], single[1]
    hinge_gradient(*corners, slopes)
    openness_gradient(*corners, rest[1], rest[2], shrink)
    for node in range(4):
        for k in range(3):
            slopes[node, k] *= openness
        accumulate(slopes[node], lag, shrink[node])


@kernel
def add_crushed_hinges(model, f, damping, strains, around, vane):
    """Add the damping of crushed hinges of feather f to vane.blocks.

    strains: of the pose whose nodes are in vane.nodes. around: StepEnvironment.
    """
    stiffness, gaps, nodes = model.hinge_stiffness[f], around.gaps, vane.nodes
    if damping == 0.0:
        return
    held = all_hold(model, f, strains.cell, gaps)
    for side in range(2):
        for i in range(1, stiffness.shape[1] - 1):
            own, up, down = nodes[i, side], nodes[i + 1, side], nodes[i - 1, side]
            for j in range(stiffness.shape[2]):
                weight, openness = damping * stiffness[side, i, j], strains.openness[side, i, j]
                if weight == 0.0 or openness >= 1.0:
                    continue
                if not held:
                    weight *= hinge_hold(gaps, side, i, j)
                lag = strains.hinge[side, i, j] - around.reference.hinge[side, i, j]
                corners = own[:, j], own[:, j + 1], up[:, j + 1], down[:, j + 1]
                rest, single = model.hinge_rest[f, side, i, j], vane.cells.single
                _damped_slopes(corners, rest, openness, lag, single)
                _add_square(vane.blocks[:, side], i, j, weight, single[0])
