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

from featherfx.compiled import kernel
from featherfx.mechanics.rotations_kernels import exponential, matrix_into, multiply, normalised


@kernel
def _left_jacobian(y, z):
    """Columns 2 and 3 of the left Jacobian of exp at (0, y, z)."""
    square = y * y + z * z
    if square < 1e-8:
        a = 0.5 - square / 24.0
        b = 1.0 / 6.0 - square / 120.0
    else:
        angle = sqrt(square)
        a = (1.0 - cos(angle)) / square
        b = (angle - sin(angle)) / (square * angle)
    return -a * z, 1.0 - b * z * z, b * y * z, a * y, b * y * z, 1.0 - b * y * y


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
def barb_points(turn, root, clamp, joints, segment, shapes, coefficients, points):
    """Nodes of one barb.

    turn: (4,) row quaternion. root: (3,). clamp: (4,). joints: (m, 4) D_j. segment: m, length.
    shapes: (C, m). coefficients: (2 C,), normal then in-plane. Written: points (m, 3).
    """
    w, x, y, z = multiply(
        turn[0], turn[1], turn[2], turn[3], clamp[0], clamp[1], clamp[2], clamp[3]
    )
    px, py, pz = root[0], root[1], root[2]
    for j in range(shapes.shape[1]):
        normal, in_plane = _joint_angles(shapes, coefficients, j)
        w, x, y, z = multiply(w, x, y, z, joints[j, 0], joints[j, 1], joints[j, 2], joints[j, 3])
        ew, ex, ey, ez = exponential(0.0, normal, in_plane)
        w, x, y, z = multiply(w, x, y, z, ew, ex, ey, ez)
        w, x, y, z = normalised(w, x, y, z)
        px += segment * (1.0 - 2.0 * (y * y + z * z))
        py += segment * 2.0 * (x * y + w * z)
        pz += segment * 2.0 * (x * z - w * y)
        points[j, 0], points[j, 1], points[j, 2] = px, py, pz


@kernel
def barb_jacobian(turn, clamp, joints, segment, shapes, coefficients, frame, spin, jacobian):
    """Derivative of a barb's nodes by its coefficients.

    As barb_points. Scratch: frame (3, 3); spin (3, 2 C), world rotation of the current segment by
    each coefficient. Written: rows 6 and on of jacobian (6 + 2 C, 3, m + 1), node 0 being the
    rachis point.
    """
    count = shapes.shape[0]
    w, x, y, z = multiply(
        turn[0], turn[1], turn[2], turn[3], clamp[0], clamp[1], clamp[2], clamp[3]
    )
    spin[:] = 0.0
    jacobian[6:, :, 0] = 0.0
    for j in range(shapes.shape[1]):
        normal, in_plane = _joint_angles(shapes, coefficients, j)
        w, x, y, z = multiply(w, x, y, z, joints[j, 0], joints[j, 1], joints[j, 2], joints[j, 3])
        matrix_into(w, x, y, z, frame)
        n1, n2, n3, b1, b2, b3 = _left_jacobian(normal, in_plane)
        for k in range(3):
            by_normal = frame[k, 0] * n1 + frame[k, 1] * n2 + frame[k, 2] * n3
            by_in_plane = frame[k, 0] * b1 + frame[k, 1] * b2 + frame[k, 2] * b3
            for c in range(count):
                spin[k, c] += shapes[c, j] * by_normal
                spin[k, count + c] += shapes[c, j] * by_in_plane
        ew, ex, ey, ez = exponential(0.0, normal, in_plane)
        w, x, y, z = multiply(w, x, y, z, ew, ex, ey, ez)
        w, x, y, z = normalised(w, x, y, z)
        tx = segment * (1.0 - 2.0 * (y * y + z * z))
        ty = segment * 2.0 * (x * y + w * z)
        tz = segment * 2.0 * (x * z - w * y)
        for c in range(2 * count):
            d = jacobian[6 + c]
            d[0, j + 1] = d[0, j] + spin[1, c] * tz - spin[2, c] * ty
            d[1, j + 1] = d[1, j] + spin[2, c] * tx - spin[0, c] * tz
            d[2, j + 1] = d[2, j] + spin[0, c] * ty - spin[1, c] * tx


@kernel
def root_jacobian(root, points, jacobian):
    """Derivative of a barb's nodes by its row: dx = dr + u x (x - root).

    root: (3,). points: (m, 3). Written: rows 0 to 5 of jacobian (6 + 2 C, 3, m + 1).
    """
    jacobian[0:6] = 0.0
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
