"""Stiffness that damping gives hinges of which a triangle is crushed.

Their energy is 1/2 k w^2 (g^2 + q (t - t_r)^2), with the openness w (vane_bending_kernels). The
elastic part is the square of one strain, w g, whose stiffness is summed with that of other hinges;
the other one is that of another, w (t - t_r), and resists a hinge that turns as its triangle opens
so that w g stays. Without it such a turn would seem to cost nothing, and Newton would go too far.
"""

from featherfx.algebra.vec3_kernels import accumulate
from featherfx.jit.compiled import kernel
from featherfx.mechanics.vane_bending_kernels import hinge_gradient, openness_gradient
from featherfx.mechanics.vane_hook_kernels import all_hold, hinge_hold
from featherfx.solver.vane.pairs_kernels import (
    PAIR_ALONG,
    PAIR_BACK,
    PAIR_OWN,
    PAIR_SKIP,
    PAIR_SLANT,
    PAIR_UP,
)


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
