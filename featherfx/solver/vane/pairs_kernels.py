"""Pairs of nodes that a vane couples, and kinds of their stiffness."""

from featherfx.jit.compiled import kernel

# blocks K(p, q) of row i and column j: p, q =
# (i, j), (i, j), halved; (i, j), (i, j+1); (i+1, j), (i, j); (i+1, j), (i, j+1);
# (i+1, j), (i, j-1); (i+1, j), (i-1, j)
PAIR_OWN, PAIR_ALONG, PAIR_UP, PAIR_SLANT, PAIR_BACK, PAIR_SKIP = 0, 1, 2, 3, 4, 5
# which second derivatives are wanted: none, those without what may be indefinite, all
FORCES_ONLY, STABILISING_STIFFNESS, WHOLE_STIFFNESS = 0, 1, 2


@kernel
def cell_nodes(i, half, j, near, far):
    """(row of the edge, other row, other column, other node) of triangle A or B of a cell."""
    if half == 0:
        return i, i + 1, j, near
    return i + 1, i, j + 1, far


@kernel
def damped_stress(stiffness, strain, reference, damping):
    return stiffness * (strain + damping * (strain - reference))
