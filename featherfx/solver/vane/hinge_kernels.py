"""Forces and stiffness of a vane's hinges and of its twist (vane_bending_kernels,
vane_twist_kernels), barb by barb."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from featherfx.jit.compiled import kernel
from featherfx.mechanics.vane_bending_kernels import folded, openness_gradient
from featherfx.solver.vane.line_kernels import (
    add_forces,
    add_outer,
    hinge_gradients,
    lanes,
    twist_gradients,
)
from featherfx.solver.vane.pairs_kernels import (
    ALONG,
    BACK,
    FORCES_ONLY,
    OWN,
    SKIP,
    SLANT,
    UP,
    damped_stress,
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
    """Stresses and stiffnesses of a row of hinges, to lines."""
    for j in range(hinges.stiffness.shape[0]):
        value, angle = hinges.stiffness[j], hinges.angle[j]
        fold, slope = folded(angle)
        cells.weight[0, 0, j] = value * (slope * slope + damping)
        cells.weight[0, 1, j] = 0.5 * value * (slope * slope + damping)
        lag = angle - hinges.reference[j]
        cells.stress[0, j] = value * (fold * slope + damping * lag)


@kernel
def _crush(j, strain, gradient, shrink, pull, above, below):
    """Hinge j, of which a triangle is crushed: its strain is the fold times its openness.

    strain: (fold, openness times the fold's derivative by the angle, derivatives of the energy by
    angle and openness). gradient: (4, 3, .) of the angle,
    in, and of the strain, out. shrink: (4, 3) gradient of the openness. pull, above, below: (3, .)
    forces on the nodes of its barb and of those around it, to which its own are added.
    """
    fold, openness, by_angle, by_openness = strain
    for k in range(3):
        for node in range(4):
            force = by_angle * gradient[node, k, j] + by_openness * shrink[node, k]
            gradient[node, k, j] = openness * gradient[node, k, j] + fold * shrink[node, k]
            if node < 2:
                pull[k, j + node] += force
            elif node == 2:
                above[k, j + 1] += force
            else:
                below[k, j + 1] += force


@kernel
def _crush_hinges(i, side, hinges, damping, vane):
    """Hinges of row i of which a triangle is crushed; their stress is left zero."""
    cells, pull, shrink = vane.cells, vane.pull, vane.cells.single[0]
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
        _crush(j, strain, cells.gradient[0], shrink, on_own, on_up, on_down)
        cells.stress[0, j] = 0.0


@kernel
def _add_hinge_pairs(count, weight, gradient, low, own, high):
    """Hinges of a row to the blocks of the rows below them, their own and above.

    weight: (2, .) stiffness and half of it. gradient: (4, 3, .). low, own, high: (6, 3, 3 S).
    """
    k, h = weight[0], weight[1]
    a, b, c, d = gradient[0], gradient[1], gradient[2], gradient[3]
    add_outer(count, h, a, a, 0, own[OWN])
    add_outer(count, h, b, b, 1, own[OWN])
    add_outer(count, h, c, c, 1, high[OWN])
    add_outer(count, h, d, d, 1, low[OWN])
    add_outer(count, k, a, b, 0, own[ALONG])
    add_outer(count, k, c, a, 1, own[BACK])
    add_outer(count, k, c, b, 1, own[UP])
    add_outer(count, k, a, d, 0, low[SLANT])
    add_outer(count, k, b, d, 1, low[UP])
    add_outer(count, k, c, d, 1, own[SKIP])


@kernel
def add_hinges(i, side, hinges, damping, wanted, vane):
    """Hinges on row i's barb."""
    cells, nodes, pull = vane.cells, vane.nodes, vane.pull
    count, weight, gradient = lanes(hinges.stiffness.shape[0]), cells.weight[0], cells.gradient[0]
    _load_hinges(hinges, damping, cells)
    hinge_gradients(
        count, nodes[i, side], nodes[i + 1, side], nodes[i - 1, side], weight[0], gradient
    )
    _crush_hinges(i, side, hinges, damping, vane)
    stress = cells.stress[0]
    add_forces(count, stress, gradient[0], 0, pull[i, side])
    add_forces(count, stress, gradient[1], 1, pull[i, side])
    add_forces(count, stress, gradient[2], 1, pull[i + 1, side])
    add_forces(count, stress, gradient[3], 1, pull[i - 1, side])
    if wanted != FORCES_ONLY:
        blocks = vane.blocks
        _add_hinge_pairs(
            count, weight, gradient, blocks[i - 1, side], blocks[i, side], blocks[i + 1, side]
        )


class Twists(NamedTuple):
    """The cells between two barbs. rest: (m, 2). stiffness, twist, reference: (m,), twist and its
    reference from rest."""

    rest: Array
    stiffness: Array
    twist: Array
    reference: Array


@kernel
def _add_twist_pairs(count, weight, gradient, low, high):
    """As _add_hinge_pairs, of the twist of a row of cells."""
    k, h = weight[0], weight[1]
    a, b, c, d = gradient[0], gradient[1], gradient[2], gradient[3]
    add_outer(count, h, a, a, 0, low[OWN])
    add_outer(count, h, b, b, 1, low[OWN])
    add_outer(count, h, c, c, 0, high[OWN])
    add_outer(count, h, d, d, 1, high[OWN])
    add_outer(count, k, a, b, 0, low[ALONG])
    add_outer(count, k, c, d, 0, high[ALONG])
    add_outer(count, k, c, a, 0, low[UP])
    add_outer(count, k, d, b, 1, low[UP])
    add_outer(count, k, c, b, 0, low[SLANT])
    add_outer(count, k, d, a, 1, low[BACK])


@kernel
def add_twists(i, side, twists, damping, wanted, vane):
    """Twist of the cells between rows i and i + 1."""
    cells, nodes, pull = vane.cells, vane.nodes, vane.pull
    count, weight, gradient = lanes(twists.stiffness.shape[0]), cells.weight[0], cells.gradient[0]
    for j in range(twists.stiffness.shape[0]):
        value, factor = twists.stiffness[j], twists.rest[j, 0]
        weight[0, j] = value * (1.0 + damping) * factor * factor
        weight[1, j] = 0.5 * weight[0, j]
        stress = damped_stress(value, twists.twist[j], twists.reference[j], damping)
        cells.stress[0, j] = stress * factor
    twist_gradients(count, nodes[i, side], nodes[i + 1, side], gradient)
    stress = cells.stress[0]
    add_forces(count, stress, gradient[0], 0, pull[i, side])
    add_forces(count, stress, gradient[1], 1, pull[i, side])
    add_forces(count, stress, gradient[2], 0, pull[i + 1, side])
    add_forces(count, stress, gradient[3], 1, pull[i + 1, side])
    if wanted != FORCES_ONLY:
        _add_twist_pairs(count, weight, gradient, vane.blocks[i, side], vane.blocks[i + 1, side])
