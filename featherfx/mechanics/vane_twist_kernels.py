"""Twist of the vane: by how much the barbs on both sides of a cell point out of each other's plane.

    W = 1/2 k (t - t0)^2,      k = 4 D_66,      t = 6 V / A^(3/2)

        x_2 --- x_3            V    volume of the tetrahedron of the four corners, signed, m^3
       /       /               A    rest area of both triangles, m^2
     x_0 --- x_1               D_66 twist modulus, N m

With w = x_3 - x_2 - x_1 + x_0, the second difference of the corners, 6 V = w.((x_1 - x_0) x (x_2 -
x_0)): A times the part of w along the normal, which is curvature k_vw = d2 z / dv dw times A where
the cell is a parallelogram. So t = k_vw sqrt(A), and W per area is 2 D_66 k_vw^2 as in Kirchhoff's
plate, whose D_66 is D (1 - nu) / 2 where it is isotropic. Derived here. V is a polynomial that does
not change under rigid motion; where a cell is crushed it goes to zero.

v runs along the barbs, and w square to them where barbs are square to the rachis. On others corners
lie on the grid's lines, along the barb and along the rachis; there t is the twist between these.
"""

from featherfx.algebra.vector_kernels import cross, dot, scale, sub
from featherfx.jit.compiled import kernel


@kernel
def cell_twist(start, end, above, beyond):
    """6 V of x_0, x_1, x_2, x_3 (each (3,)), m^3."""
    return dot(sub(beyond, start), cross(sub(end, start), sub(above, start)))


@kernel
def twist_slopes(a, b, c):
    """Derivatives of 6 V by x_0 to x_3; a, b, c: of x_1, x_2 and x_3 from x_0."""
    by_end, by_above, by_beyond = cross(b, c), cross(c, a), cross(a, b)
    total = (
        by_end[0] + by_above[0] + by_beyond[0],
        by_end[1] + by_above[1] + by_beyond[1],
        by_end[2] + by_above[2] + by_beyond[2],
    )
    return scale(-1.0, total), by_end, by_above, by_beyond
