"""Barb stretch: every segment of a barb between two of its nodes.

    W = 1/2 k e^2,      e = e_vv = (d.d / s^2 - 1) / 2,      k = b E_vv (A_1 + A_2)

d = x_1 - x_0 the segment, s its rest length, A_1 and A_2 the rest areas of the triangles beside
it, b thickness, E_vv modulus along the barbs. Green-Lagrange strain along the barb is the same in
both triangles, because both have this edge: the term of Jouve 2024 eq. 4.1 needs no other nodes.

A stretched segment resists turning: its second variation is k e / s^2 |dx_1 - dx_0|^2 besides the
square of de.
"""

from featherfx.algebra.vec3_kernels import dot, scale, store, sub
from featherfx.jit.compiled import kernel


@kernel
def stretch_strain(start, end, inverse):
    """e of one segment from start to end, each (3,); inverse: 1/s."""
    a = scale(inverse, sub(end, start))
    return 0.5 * (dot(a, a) - 1.0)


@kernel
def stretch_gradient(start, end, inverse, line):
    """Gradient of e, written to line (6,): start, end."""
    by_end = scale(inverse, scale(inverse, sub(end, start)))
    store(line, scale(-1.0, by_end))
    store(line[3:], by_end)
