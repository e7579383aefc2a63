"""Barb-curvature kinematics: a barb as an exactly inextensible curve clamped in its row's frame.

    T_0 = R C                          frame of the row times the rest direction of the clamp
    T_j = T_{j-1} D_j exp(0, n_j, b_j)     frame of segment j = 1..m (D_1 = 1)
    x_j = x_{j-1} + l T_j e1

    n_j = sum_c phi_c(j) q_c            turn out of the vane at joint j (about e2), rad
    b_j = sum_c phi_c(j) q_{C+c}        turn within the vane (about e3), rad

R row frame, C and D_j rotations at rest (so that q = 0 is the rest shape exactly), l segment
length, phi_c the share of shape function c that falls on joint j: a table of the batch, polynomial
curvatures orthogonal under the barb's bending stiffness (featherfx/mechanics/barb_shapes.py).
The energy of a barb is then 1/2 sum_c k_c q_c^2: its coefficients are its strains. A frame is
carried along, not a pair of global angles, so no pose is singular. Derived here; the idea of
curvature unknowns is that of super-helices and ribbon elements (Charrondiere et al. 2019).
"""

from math import cos, sin, sqrt

from featherfx.algebra.rotation_kernels import SMALL_SQUARE, exponential, multiply, rotate
from featherfx.jit.compiled import kernel


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
    return a * z, 1.0 - b * z * z, b * y * z, -a * y, b * y * z, 1.0 - b * y * y


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
def _next_frame(w, x, y, z, joint, normal, in_plane):
    """T_j from T_{j-1}. The turn between them is made first: that does not wait for T_{j-1}."""
    ew, ex, ey, ez = exponential(0.0, normal, in_plane)
    ew, ex, ey, ez = multiply(joint[0], joint[1], joint[2], joint[3], ew, ex, ey, ez)
    return multiply(w, x, y, z, ew, ex, ey, ez)


@kernel
def barb_points(turn, root, clamp, joints, segment, shapes, coefficients, frames, points):
    """Nodes of one barb, and the frames of its segments.

    turn: (4,) row quaternion. root: (3,). clamp: (4,). joints: (m, 4) D_j. segment: m, length.
    shapes: (C, m). coefficients: (2 C,), normal then in-plane. Written: frames (m, 4),
    T_j, and points (m, 3).
    """
    w, x, y, z = multiply(
        turn[0], turn[1], turn[2], turn[3], clamp[0], clamp[1], clamp[2], clamp[3]
    )
    px, py, pz = root[0], root[1], root[2]
    for j in range(shapes.shape[1]):
        normal, in_plane = _joint_angles(shapes, coefficients, j)
        w, x, y, z = _next_frame(w, x, y, z, joints[j], normal, in_plane)
        frames[j, 0], frames[j, 1], frames[j, 2], frames[j, 3] = w, x, y, z
        px += segment * (1.0 - 2.0 * (y * y + z * z))
        py += segment * 2.0 * (x * y + w * z)
        pz += segment * 2.0 * (x * z - w * y)
        points[j, 0], points[j, 1], points[j, 2] = px, py, pz


@kernel
def barb_axes(frames, shapes, coefficients, axes):
    """World vectors about which a joint turns what lies beyond it, per unit of n_j and of b_j.

    Arguments as of barb_points, which writes the frames. Written: axes (m, 6), n_j first.
    """
    for j in range(shapes.shape[1]):
        normal, in_plane = _joint_angles(shapes, coefficients, j)
        w, x, y, z = frames[j, 0], frames[j, 1], frames[j, 2], frames[j, 3]
        n1, n2, n3, b1, b2, b3 = _right_jacobian(normal, in_plane)
        axis = axes[j]
        axis[0], axis[1], axis[2] = rotate(w, x, y, z, n1, n2, n3)
        axis[3], axis[4], axis[5] = rotate(w, x, y, z, b1, b2, b3)


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
        sx, sy, sz = 0.0, 0.0, 0.0
        dx, dy, dz = 0.0, 0.0, 0.0
        before = root
        for j in range(shape.shape[0]):
            share, axis, point = shape[j], axes[j], points[j]
            sx += share * axis[first]
            sy += share * axis[first + 1]
            sz += share * axis[first + 2]
            tx, ty, tz = point[0] - before[0], point[1] - before[1], point[2] - before[2]
            dx += sy * tz - sz * ty
            dy += sz * tx - sx * tz
            dz += sx * ty - sy * tx
            d[0, j + 1], d[1, j + 1], d[2, j + 1] = dx, dy, dz
            before = point


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
        x = points[j - 1, 0] - root[0]
        y = points[j - 1, 1] - root[1]
        z = points[j - 1, 2] - root[2]
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
    fx, fy, fz = 0.0, 0.0, 0.0
    mx, my, mz = 0.0, 0.0, 0.0
    for back in range(columns):
        j = columns - 1 - back
        before = points[j - 1] if j > 0 else root
        point, force, axis = points[j], forces[j], axes[j]
        fx += force[0]
        fy += force[1]
        fz += force[2]
        tx, ty, tz = point[0] - before[0], point[1] - before[1], point[2] - before[2]
        mx += ty * fz - tz * fy
        my += tz * fx - tx * fz
        mz += tx * fy - ty * fx
        normal = axis[0] * mx + axis[1] * my + axis[2] * mz
        in_plane = axis[3] * mx + axis[4] * my + axis[5] * mz
        for c in range(count):
            barb[c] -= shapes[c, j] * normal
            barb[count + c] -= shapes[c, j] * in_plane
    row[0] -= fx
    row[1] -= fy
    row[2] -= fz
    row[3] -= mx
    row[4] -= my
    row[5] -= mz


@kernel
def barb_tensions(root, points, forces, tension):
    """Tension of a barb's segments from the forces on its nodes, written to tension (m,), N.

    root: (3,). points: (m, 3). forces: (m, 3), gradient of the energy at the nodes (minus the
    force). The constraint of inextensibility carries the sum of all forces further out.

    Tension T stiffens a segment against turning: the second derivative of the barb's nodes times
    the forces is T / l |turn of l e1|^2 (leading order in the turns between joints).
    """
    sx, sy, sz = 0.0, 0.0, 0.0
    for j in range(points.shape[0] - 1, -1, -1):
        sx -= forces[j, 0]
        sy -= forces[j, 1]
        sz -= forces[j, 2]
        before = root if j == 0 else points[j - 1]
        dx = points[j, 0] - before[0]
        dy = points[j, 1] - before[1]
        dz = points[j, 2] - before[2]
        length = sqrt(dx * dx + dy * dy + dz * dz)
        tension[j] = (sx * dx + sy * dy + sz * dz) / length if length > 0.0 else 0.0
