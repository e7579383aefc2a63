"""Vane bending across barbs: the dihedral angle at every edge that lies along a barb.

    W = 1/2 k (t - t0)^2,        k = D s^2 / (A_1 + A_2)

           x_2
          /    \\            t   dihedral angle, 0 when flat, rad;  t0 at rest
        x_0 --- x_1         s   rest length of the barb edge x_0 x_1, m
          \\    /            A   rest areas of the two triangles, m^2
           x_3              D   bending modulus across the barbs, N m

With heights h_1, h_2 of the triangles, k = 2 D s / (h_1 + h_2): a strip of barbs h apart that is
bent to a cylinder turns t = h / radius at each, and W per area is D / (2 radius^2).
Source: Grinspun et al. 2003; the factor is derived for edges of one direction only.

Where a triangle is crushed to a line its normal turns over and the angle jumps by pi, which would
make the energy jump, too. t - t0 is therefore multiplied by w(y) of either triangle,

    w(y) = y (2 - y),    y = (area / (c area at rest))^2,  1 at most,    c = 0.2

(derived here): nothing changes until a triangle has lost four fifths of its area.
"""

from math import atan2, sqrt

from featherfx.algebra.rotation_kernels import cross
from featherfx.jit.compiled import kernel

TINY = 1e-300
CRUSHED = 0.2


@kernel
def _angle_and_squares(start, end, above, below):
    """Dihedral angle, and |n|^2 of both triangles, n = e x u."""
    ex, ey, ez = end[0] - start[0], end[1] - start[1], end[2] - start[2]
    ux, uy, uz = above[0] - start[0], above[1] - start[1], above[2] - start[2]
    vx, vy, vz = below[0] - start[0], below[1] - start[1], below[2] - start[2]
    ax, ay, az = cross(ex, ey, ez, ux, uy, uz)
    bx, by, bz = cross(vx, vy, vz, ex, ey, ez)
    cx, cy, cz = cross(ax, ay, az, bx, by, bz)
    length = sqrt(ex * ex + ey * ey + ez * ez)
    angle = atan2(cx * ex + cy * ey + cz * ez, length * (ax * bx + ay * by + az * bz) + TINY)
    return angle, ax * ax + ay * ay + az * az, bx * bx + by * by + bz * bz


@kernel
def hinge_angle(start, end, above, below):
    """Dihedral angle of x_0, x_1, x_2, x_3 (each (3,)), in (-pi, pi]."""
    angle, _, _ = _angle_and_squares(start, end, above, below)
    return angle


@kernel
def hinge_slopes(ex, ey, ez, ux, uy, uz, vx, vy, vz):
    """Derivatives of the dihedral angle by x_0, x_1, x_2, x_3, three each, in one tuple.

    e = x_1 - x_0, u = x_2 - x_0, v = x_3 - x_0, axis by axis.
    """
    ax, ay, az = cross(ex, ey, ez, ux, uy, uz)
    bx, by, bz = cross(vx, vy, vz, ex, ey, ez)
    square = ex * ex + ey * ey + ez * ez
    length = sqrt(square)
    # a triangle crushed to a line would give an infinite slope; it is bounded there
    floor = 1e-12 * square * square
    a = length / max(ax * ax + ay * ay + az * az, floor)
    b = length / max(bx * bx + by * by + bz * bz, floor)
    ax, ay, az, bx, by, bz = a * ax, a * ay, a * az, b * bx, b * by, b * bz
    s = (ux * ex + uy * ey + uz * ez) / square
    t = (vx * ex + vy * ey + vz * ez) / square
    p, q = 1.0 - s, 1.0 - t
    start = p * ax + q * bx, p * ay + q * by, p * az + q * bz
    end = s * ax + t * bx, s * ay + t * by, s * az + t * bz
    return (*start, *end, -ax, -ay, -az, -bx, -by, -bz)


@kernel
def hinge_gradient(start, end, above, below, gradient):
    """Gradient of the dihedral angle, written to gradient (4, 3): x_0, x_1, x_2, x_3."""
    slopes = hinge_slopes(
        end[0] - start[0],
        end[1] - start[1],
        end[2] - start[2],
        above[0] - start[0],
        above[1] - start[1],
        above[2] - start[2],
        below[0] - start[0],
        below[1] - start[1],
        below[2] - start[2],
    )
    for node in range(4):
        for k in range(3):
            gradient[node, k] = slopes[3 * node + k]


@kernel
def opening(rest):
    """1 / (2 c A)^2 of a triangle with rest values (1/s, p, 1/h), 1/m^4."""
    return (rest[0] * rest[2] / CRUSHED) ** 2


@kernel
def _share(square, opening):
    """w and its derivative by |n|^2, of a triangle with n = e x u of the given square."""
    y = square * opening
    if y >= 1.0:
        return 1.0, 0.0
    return y * (2.0 - y), 2.0 * (1.0 - y) * opening


@kernel
def _normal_square(edge_start, edge_end, opposite):
    ex, ey, ez = cross(
        edge_end[0] - edge_start[0],
        edge_end[1] - edge_start[1],
        edge_end[2] - edge_start[2],
        opposite[0] - edge_start[0],
        opposite[1] - edge_start[1],
        opposite[2] - edge_start[2],
    )
    return ex * ex + ey * ey + ez * ez


@kernel
def angle_and_share(start, end, above, below, open_above, open_below):
    """Dihedral angle of a hinge, and w of both its triangles, multiplied.

    start to below: as in hinge_angle. open_above, open_below: of `opening`.
    """
    angle, over, under = _angle_and_squares(start, end, above, below)
    first, _ = _share(over, open_above)
    second, _ = _share(under, open_below)
    return angle, first * second


@kernel
def _add_area_slope(start, end, opposite, scale, at, gradient):
    """scale times the gradient of |e x u|^2, added to rows 0, 1 and at of gradient (4, 3)."""
    ex, ey, ez = end[0] - start[0], end[1] - start[1], end[2] - start[2]
    ux, uy, uz = opposite[0] - start[0], opposite[1] - start[1], opposite[2] - start[2]
    nx, ny, nz = cross(ex, ey, ez, ux, uy, uz)
    by_end = cross(ux, uy, uz, nx, ny, nz)
    by_opposite = cross(nx, ny, nz, ex, ey, ez)
    for k in range(3):
        gradient[1, k] += 2.0 * scale * by_end[k]
        gradient[at, k] += 2.0 * scale * by_opposite[k]
        gradient[0, k] -= 2.0 * scale * (by_end[k] + by_opposite[k])


@kernel
def crush_gradient(start, end, above, below, open_above, open_below, gradient):
    """Gradient of w of both triangles, multiplied, written to gradient (4, 3)."""
    first, first_slope = _share(_normal_square(start, end, above), open_above)
    second, second_slope = _share(_normal_square(start, end, below), open_below)
    gradient[:] = 0.0
    _add_area_slope(start, end, above, first_slope * second, 2, gradient)
    _add_area_slope(start, end, below, second_slope * first, 3, gradient)
