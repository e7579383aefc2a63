"""Rachis: geometrically exact (Cosserat) beam between two rows a and b.

    W = 1/2 l sum_k c_k (v_k - v0_k)^2 + 1/(2 l) sum_k d_k (p_k - p0_k)^2

    v = R^T (r_b - r_a) / l    stretch (axis 1) and shears, in the frame R halfway between the
                               row frames R_a and R_b
    p = log(R_a^T R_b)         twist (axis 1) and bending angles over the element, rad
    c = (EA, GA_2, GA_3)  N,   d = (GJ, EI_2, EI_3)  N m^2,   l  m at rest;  v0, p0  at rest

Source: Simo 1985, Reissner 1981; one point per element, so it does not lock. With a the axis and
w the angle of p, world rotation increments u_a, u_b of the frames give (derived; checked by finite
differences in the tests)

    dp = S R^T (u_b - u_a),                  S = f I + (1 - f) a a^T,  f = (w/2) / sin(w/2)
    dm = (u_a + u_b)/2 + tan(w/4)/2 (u_b - u_a) x (R a)     rotation of the halfway frame
    dv = R^T (dr_b - dr_a - dm x (r_b - r_a)) / l

both smooth up to a relative turn of 2 pi of two neighbouring rows. The second variation is in
rachis_variation_kernels.
"""

from math import sin, sqrt, tan

from featherfx.algebra.rotation_kernels import cross, logarithm, matrix_into, multiply, normalised
from featherfx.jit.compiled import kernel


@kernel
def rachis_strain(turn_a, turn_b, point_a, point_b, length, halfway, strain):
    """Strains of one element.

    The quaternions' signs tell turns beyond pi from those the other way about: q and -q are the
    same frame, but only one of them is where the row came from.

    turn_a, turn_b: (4,) row quaternions. point_a, point_b: (3,). Written: halfway (3, 3), the
    frame R, and strain (6,): v then p.
    """
    aw, ax, ay, az = turn_a[0], turn_a[1], turn_a[2], turn_a[3]
    bw, bx, by, bz = turn_b[0], turn_b[1], turn_b[2], turn_b[3]
    w, x, y, z = normalised(aw + bw, ax + bx, ay + by, az + bz)
    matrix_into(w, x, y, z, halfway)
    dx = (point_b[0] - point_a[0]) / length
    dy = (point_b[1] - point_a[1]) / length
    dz = (point_b[2] - point_a[2]) / length
    for k in range(3):
        strain[k] = halfway[0, k] * dx + halfway[1, k] * dy + halfway[2, k] * dz
    w, x, y, z = multiply(aw, -ax, -ay, -az, bw, bx, by, bz)
    strain[3], strain[4], strain[5] = logarithm(w, x, y, z)


@kernel
def rachis_gradient(point_a, point_b, length, halfway, strain, gradient):
    """Gradient of the six strains: gradient (6, 12) for (r_a, u_a, r_b, u_b)."""
    angle = sqrt(strain[3] ** 2 + strain[4] ** 2 + strain[5] ** 2)
    f, t, ax, ay, az = 1.0, 0.0, 0.0, 0.0, 0.0
    if angle > 1e-8:
        f = 0.5 * angle / sin(0.5 * angle)
        t = 0.5 * tan(0.25 * angle)
        ax, ay, az = strain[3] / angle, strain[4] / angle, strain[5] / angle
    wx = halfway[0, 0] * ax + halfway[0, 1] * ay + halfway[0, 2] * az
    wy = halfway[1, 0] * ax + halfway[1, 1] * ay + halfway[1, 2] * az
    wz = halfway[2, 0] * ax + halfway[2, 1] * ay + halfway[2, 2] * az
    dx = (point_b[0] - point_a[0]) / length
    dy = (point_b[1] - point_a[1]) / length
    dz = (point_b[2] - point_a[2]) / length
    for k in range(3):
        nx, ny, nz = halfway[0, k], halfway[1, k], halfway[2, k]
        # dv_k = n.(dr_b - dr_a)/l + (d x n).dm ... written for the increment vectors
        mx, my, mz = cross(dx, dy, dz, nx, ny, nz)
        # dm = u/2 -+ t (axis x u): its transpose applied to m
        cx, cy, cz = cross(mx, my, mz, wx, wy, wz)
        gradient[k, 0], gradient[k, 1], gradient[k, 2] = -nx / length, -ny / length, -nz / length
        gradient[k, 6], gradient[k, 7], gradient[k, 8] = nx / length, ny / length, nz / length
        gradient[k, 3] = -0.5 * mx - t * cx
        gradient[k, 4] = -0.5 * my - t * cy
        gradient[k, 5] = -0.5 * mz - t * cz
        gradient[k, 9] = -0.5 * mx + t * cx
        gradient[k, 10] = -0.5 * my + t * cy
        gradient[k, 11] = -0.5 * mz + t * cz
        a = ax if k == 0 else (ay if k == 1 else az)
        gx = f * nx + (1.0 - f) * a * wx
        gy = f * ny + (1.0 - f) * a * wy
        gz = f * nz + (1.0 - f) * a * wz
        gradient[k + 3, 0:3] = 0.0
        gradient[k + 3, 6:9] = 0.0
        gradient[k + 3, 3], gradient[k + 3, 4], gradient[k + 3, 5] = -gx, -gy, -gz
        gradient[k + 3, 9], gradient[k + 3, 10], gradient[k + 3, 11] = gx, gy, gz


@kernel
def rachis_tension(point_a, point_b, length, halfway, stress, matrix):
    """What tension adds to an element's stiffness against turning, to the lower part of (12, 12).

    stress: (6,) derivative of the energy by the strains. Nothing is added under compression: this
    is the part of rachis_variation that never destabilises.
    """
    work, square = 0.0, 0.0
    d = (point_b[0] - point_a[0], point_b[1] - point_a[1], point_b[2] - point_a[2])
    for i in range(3):
        square += d[i] * d[i]
        for k in range(3):
            work += halfway[i, k] * stress[k] / length * d[i]
    if work <= 0.0 or square == 0.0:
        return
    for i in range(3):
        for j in range(3):
            value = -work / square * d[i] * d[j] / square
            if i == j:
                value += work / square
            if j <= i:
                matrix[i, j] += value
                matrix[6 + i, 6 + j] += value
            matrix[6 + i, j] -= value
