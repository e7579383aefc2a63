"""Nodes and directors of a feather's rows (featherfx/feather/types.py) in kernels.

Rotary inertia of the rachis, carried by the directors of its rows, and dead loads on them.

    W = 1/2 a J |d - d_t|^2 - f.d

a and d_t come from the time integrator, as of nodes (node_kernels). J (kg m^2) is the rachis'
inertia about the other director, times the length that the row stands for. f (N m) are dead loads
that act on directors as forces do on nodes. A director turns with its row, by a rotation vector u:
its forces and stiffness are those along u.
"""

from featherfx.algebra.vector_kernels import accumulate, copy_values, cross, dot, scale, sub
from featherfx.feather.types import RowPoints
from featherfx.jit.compiled import kernel


@kernel
def node_index(side, column, columns):
    """Place of a barb node within its row; column 0 is the rachis."""
    return 0 if column == 0 else side * columns + column


@kernel
def points_of(points, f):
    """RowPoints of one of many feathers, the same memory."""
    return RowPoints(points.nodes[f], points.directors[f])


@kernel
def copy_points(source, target):
    """All of one RowPoints to another's."""
    copy_values(source.nodes, target.nodes)
    copy_values(source.directors, target.directors)


@kernel
def director_energy(rotary_inertia, inertia, directors, target):
    """W of one feather (J). rotary_inertia: (n, 2). inertia: a, 1/s^2. target: (n, 2, 3)."""
    total = 0.0
    for i in range(directors.shape[0]):
        for k in range(2):
            offset = sub(directors[i, k], target[i, k])
            total += 0.5 * inertia * rotary_inertia[i, k] * dot(offset, offset)
    return total


@kernel
def subtract_director_moments(i, rotary_inertia, inertia, directors, target, right):
    """Gradient of W by row i's turn, subtracted from right (3,)."""
    for k in range(2):
        d = directors[i, k]
        force = scale(inertia * rotary_inertia[i, k], sub(d, target[i, k]))
        accumulate(right, -1.0, cross(d, force))


@kernel
def add_director_stiffness(i, rotary_inertia, inertia, directors, at, band):
    """Stiffness of W against row i's turn, whose unknowns begin at `at`."""
    for k in range(2):
        x, y, z = directors[i, k, 0], directors[i, k, 1], directors[i, k, 2]
        heavy = inertia * rotary_inertia[i, k]
        band[at, 0] += heavy * (y * y + z * z)
        band[at + 1, 0] += heavy * (x * x + z * z)
        band[at + 2, 0] += heavy * (x * x + y * y)
        band[at, 1] -= heavy * x * y
        band[at, 2] -= heavy * x * z
        band[at + 1, 1] -= heavy * y * z


@kernel
def couple_energy(couple, directors):
    """Energy of dead loads (n, 2, 3) on one feather's directors, J; none where n is 0."""
    total = 0.0
    for i in range(couple.shape[0]):
        for k in range(2):
            total -= dot(couple[i, k], directors[i, k])
    return total


@kernel
def subtract_couple_moments(i, couple, directors, right):
    """Gradient of couple_energy by row i's turn, subtracted from right (3,)."""
    for k in range(2 if couple.shape[0] > 0 else 0):
        accumulate(right, 1.0, cross(directors[i, k], couple[i, k]))
