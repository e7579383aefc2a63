"""Barb-curvature kinematics: a barb as an exactly inextensible curve clamped in its row's frame.

    T_0 = R C                          frame of the row times the rest direction of the clamp
    T_j = T_{j-1} D_j exp(0, n_j, b_j)     frame of segment j = 1..m (D_1 = 1)
    x_j = x_{j-1} + l T_j e1

    n_j = sum_c phi_c(j) q_c            turn out of the vane at joint j (about e2), rad
    b_j = sum_c phi_c(j) q_{C+c}        turn within the vane (about e3), rad

R row frame, C and D_j rotations at rest (so that q = 0 is the rest shape exactly), l segment
length, phi_c the share of shape function c that falls on joint j: a table of the batch, with
curvatures orthogonal under the barb's bending stiffness (featherfx/mechanics/vane_rest.py).
The energy of a barb is then 1/2 sum_c k_c q_c^2: its coefficients are its strains. A frame is
carried along, not a pair of global angles, so no pose is singular. Derived here; the idea of
curvature unknowns is that of super-helices and ribbon elements (Charrondiere et al. 2019).
"""

from math import cos, sin, sqrt

from featherfx.algebra.vector_kernels import (
    SMALL_SQUARE,
    accumulate,
    add,
    copy_values,
    cross,
    dot,
    exponential,
    length,
    multiply,
    rotate,
    scale,
    store,
    store_rotation,
    sub,
)
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


@kernel
def _right_jacobian(y, z):
    """Columns 2 and 3 of the right Jacobian of exp at (0, y, z)."""
    square = y * y + z * z
    if square < SMALL_SQUARE:
        # the terms left out are below rounding
        a = 1.0 / 40320.0 - square * (1.0 / 3628800.0 - square / 479001600.0)
        a = 0.5 - square * (1.0 / 24.0 - square * (1.0 / 720.0 - square * a))
        b = 1.0 / 362880.0 - square * (1.0 / 39916800.0 - square / 6227020800.0)
        b = 1.0 / 6.0 - square * (1.0 / 120.0 - square * (1.0 / 5040.0 - square * b))
    else:
        angle = sqrt(square)
        a = (1.0 - cos(angle)) / square
        b = (angle - sin(angle)) / (square * angle)
    return (a * z, 1.0 - b * z * z, b * y * z), (-a * y, b * y * z, 1.0 - b * y * y)


@kernel
def _joint_angles(shapes, coefficients, j):
    """Turns out of the vane and within it at joint j."""
    count = shapes.shape[0]
    normal, in_plane = 0.0, 0.0
    for c in range(count):
        normal += shapes[c, j] * coefficients[c]
        in_plane += shapes[c, j] * coefficients[count + c]
    return normal, in_plane


@kernel
def _next_frame(frame, joint, normal, in_plane):
    """T_j from T_{j-1}. The turn between them is made first: that does not wait for T_{j-1}."""
    return multiply(frame, multiply(joint, exponential((0.0, normal, in_plane))))


@kernel
def barb_points(row, root, clamp, joints, segment, shapes, coefficients, frames, points):
    """Nodes of one barb, and the frames of its segments.

    row: (4,) quaternion R. root: (3,). clamp: (4,). joints: (m, 4) D_j. segment: m, length.
    shapes: (C, m). coefficients: (2 C,), normal then in-plane. Written: frames (m, 4),
    T_j, and points (m, 3).
    """
    frame = multiply(row, clamp)
    px, py, pz = root[0], root[1], root[2]
    for j in range(shapes.shape[1]):
        normal, in_plane = _joint_angles(shapes, coefficients, j)
        frame = _next_frame(frame, joints[j], normal, in_plane)
        store_rotation(frames[j], frame)
        w, x, y, z = frame
        px += segment * (1.0 - 2.0 * (y * y + z * z))
        py += segment * 2.0 * (x * y + w * z)
        pz += segment * 2.0 * (x * z - w * y)
        store(points[j], (px, py, pz))


@kernel
def barb_axes(frames, shapes, coefficients, axes):
    """World vectors about which a joint turns what lies beyond it, per unit of n_j and of b_j.

    Arguments as of barb_points, which writes the frames. Written: axes (m, 6), n_j first.
    """
    for j in range(shapes.shape[1]):
        normal, in_plane = _joint_angles(shapes, coefficients, j)
        by_normal, by_in_plane = _right_jacobian(normal, in_plane)
        store(axes[j], rotate(frames[j], by_normal))
        store(axes[j, 3:], rotate(frames[j], by_in_plane))


@kernel
def barb_jacobian(axes, shapes, root, points, jacobian):
    """Derivative of a barb's nodes by its coefficients.

    dx_k = sum of phi_c(j) axis_j x (x_k - x_{j-1}) over j up to k. axes: (m, 6) of barb_axes.
    shapes: (C, m). root: (3,). points: (m, 3). Written: rows 6 and on of jacobian
    (6 + 2 C, 3, m + 1), node 0, the rachis point, left out: it does not move.
    """
    count = shapes.shape[0]
    for c in range(2 * count):
        shape = shapes[c if c < count else c - count]
        first = 0 if c < count else 3
        d = jacobian[6 + c]
        spin, move, before = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), root
        for j in range(shape.shape[0]):
            spin = add(spin, scale(shape[j], axes[j, first:]))
            move = add(move, cross(spin, sub(points[j], before)))
            d[0, j + 1], d[1, j + 1], d[2, j + 1] = move
            before = points[j]


@kernel
def root_jacobian(root, points, jacobian):
    """Derivative of a barb's nodes by its row: dx = dr + u x (x - root).

    root: (3,). points: (m, 3). Written: rows 0 to 5 of jacobian (6 + 2 C, 3, m + 1), except for
    what is always zero.
    """
    for j in range(points.shape[0] + 1):
        for k in range(3):
            jacobian[k, k, j] = 1.0
        if j == 0:
            continue
        x, y, z = sub(points[j - 1], root)
        jacobian[3, 1, j], jacobian[3, 2, j] = -z, y
        jacobian[4, 0, j], jacobian[4, 2, j] = z, -x
        jacobian[5, 0, j], jacobian[5, 1, j] = -y, x


@kernel
def add_barb_forces(axes, shapes, root, points, forces, row, barb):
    """Gradient by a barb's increments from that by its nodes, subtracted: the transposed Jacobian.

    Sums of forces and of their moments run from the tip inwards. axes to points: as in
    barb_jacobian. forces: (m, 3). Changed: row (6,), of the row's dr and u, and barb (2 C,).
    """
    count, columns = shapes.shape
    force, moment = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
    for back in range(columns):
        j = columns - 1 - back
        before = points[j - 1] if j > 0 else root
        force = add(force, forces[j])
        moment = add(moment, cross(sub(points[j], before), force))
        normal, in_plane = dot(axes[j], moment), dot(axes[j, 3:], moment)
        for c in range(count):
            barb[c] -= shapes[c, j] * normal
            barb[count + c] -= shapes[c, j] * in_plane
    accumulate(row, -1.0, force)
    accumulate(row[3:], -1.0, moment)


@kernel
def barb_tensions(root, points, forces, tension):
    """Tension of a barb's segments from the forces on its nodes, written to tension (m,), N.

    root: (3,). points: (m, 3). forces: (m, 3), gradient of the energy at the nodes (minus the
    force). The constraint of inextensibility carries the sum of all forces further out.

    Tension T stiffens a segment against turning: the second derivative of the barb's nodes times
    the forces is T / l |turn of l e1|^2 (leading order in the turns between joints).
    """
    pull = (0.0, 0.0, 0.0)
    for j in range(points.shape[0] - 1, -1, -1):
        pull = sub(pull, forces[j])
        span = sub(points[j], root if j == 0 else points[j - 1])
        distance = length(span)
        tension[j] = dot(pull, span) / distance if distance > 0.0 else 0.0
