"""Vane bending across barbs: the dihedral angle at every edge that lies along a barb.

    W = 1/2 k g(t - t0)^2,        k = D s^2 / (A_1 + A_2)

              x_2
            /  |            t   dihedral angle, 0 when flat, rad;  t0 at rest
        x_0 - x_1           s   rest length of the barb edge x_0 x_1, m
            \\  |            A   rest areas of the two triangles, m^2
              x_3           D   bending modulus across the barbs, N m
                            g   the fold: the angle itself up to 2 rad

With heights h_1, h_2 of the triangles, k = 2 D s / (h_1 + h_2): a strip of barbs h apart that is
bent to a cylinder turns t = h / radius at each, and W per area is D / (2 radius^2).
Source: Grinspun et al. 2003; the factor is derived for edges of one direction only.

x_1, x_2 and x_3 are of one column: twist of the vane does not turn its hinges. Were x_2 and x_3 of
two columns s apart, as the membrane's triangles have them, twist k_vw would turn them by s k_vw, as
if the vane had a twist modulus of D (s / h)^2 / 4, which depends on the grid; its twist is that
below alone. A hinge measures the curvature at its outer node and stands for the strip around it,
the innermost one also for what is next to the rachis.

Nothing keeps the two wings of a hinge from passing through each other, as triangles of one vane do
not touch. Were g the angle for good, a crumpled vane would wind up its hinges, turn by turn, and
store energy that no feather has. So it ends at pi: with u = (|t| - 2) / (pi - 2)

    g = +-(2 + (pi - 2) (u - u^3 / 3)),      g' = 1 - u^2,      of period 2 pi

(derived here), whose square is smooth where the wings meet. Damping resists every turn.

Where a triangle is crushed to a line its normal turns over and the angle jumps by pi, which would
make the energy jump, too. t - t0 is therefore multiplied by w(y) of either triangle,

    w(y) = y (2 - y),    y = (area / (c area at rest))^2,  1 at most,    c = 0.2

(derived here): nothing changes until a triangle has lost four fifths of its area.
"""

from math import atan2, ceil, copysign, pi, sqrt

from featherfx.algebra.vector_kernels import (
    accumulate,
    add,
    arctan2,
    combined,
    cross,
    dot,
    length,
    normal_of,
    scale,
    store,
    sub,
)
from featherfx.jit.compiled import kernel

_TINY = 1e-300
# rad: up to it the fold is the angle
_PLAIN = 2.0
_BENT = pi - _PLAIN


@kernel
def wrapped(angle):
    """Angle brought to (-pi, pi]."""
    return angle - 2.0 * pi * ceil(angle / (2.0 * pi) - 0.5)


@kernel
def folded(angle):
    """The fold g of a hinge and its derivative, of its angle from rest, whatever its turns."""
    if abs(angle) <= _PLAIN:
        return angle, 1.0
    turned = wrapped(angle)
    u = (abs(turned) - _PLAIN) / _BENT
    if u <= 0.0:
        return turned, 1.0
    fold = _PLAIN + _BENT * u * (1.0 - u * u / 3.0)
    return copysign(fold, turned), 1.0 - u * u


@kernel
def _fold_of(e, u, v):
    """Sine and cosine of a hinge's dihedral angle, times the same number, and |n|^2 of both
    triangles; arguments as of hinge_slopes."""
    n1, n2 = cross(e, u), cross(v, e)
    return dot(cross(n1, n2), e), length(e) * dot(n1, n2) + _TINY, dot(n1, n1), dot(n2, n2)


@kernel
def hinge_angle(start, end, above, below):
    """Dihedral angle of x_0, x_1, x_2, x_3 (each (3,)), in (-pi, pi]."""
    sine, cosine, _, _ = _fold_of(sub(end, start), sub(above, start), sub(below, start))
    return atan2(sine, cosine)


@kernel
def hinge_slopes(e, u, v):
    """Derivatives of the dihedral angle by x_0, x_1, x_2, x_3.

    e = x_1 - x_0, u = x_2 - x_0, v = x_3 - x_0.
    """
    n1, n2 = cross(e, u), cross(v, e)
    square = dot(e, e)
    size = sqrt(square)
    # a triangle crushed to a line would give an infinite slope; it is bounded there
    floor = 1e-12 * square * square
    n1 = scale(size / max(dot(n1, n1), floor), n1)
    n2 = scale(size / max(dot(n2, n2), floor), n2)
    s, t = dot(u, e) / square, dot(v, e) / square
    by_start, by_end = combined(1.0 - s, n1, 1.0 - t, n2), combined(s, n1, t, n2)
    return by_start, by_end, scale(-1.0, n1), scale(-1.0, n2)


@kernel
def hinge_gradient(start, end, above, below, gradient):
    """Gradient of the dihedral angle, written to gradient (4, 3): x_0, x_1, x_2, x_3."""
    slopes = hinge_slopes(sub(end, start), sub(above, start), sub(below, start))
    for node in range(4):
        store(gradient[node], slopes[node])


@kernel
def _openness(square, opening):
    """w and its derivative by |n|^2, of a triangle with n = e x u of the given square."""
    y = min(square * opening, 1.0)
    return y * (2.0 - y), 2.0 * (1.0 - y) * opening


@kernel
def angles_and_openness(e, u, v, open_above, open_below):
    """Dihedral angles of four hinges (lanes), and w of both triangles of each, multiplied.

    e, u, v: as of hinge_slopes. open_above, open_below: of `opening`.
    """
    sine, cosine, over, under = _fold_of(e, u, v)
    first, _ = _openness(over, open_above)
    second, _ = _openness(under, open_below)
    return arctan2(sine, cosine), first * second


@kernel
def _add_area_slope(start, end, opposite, factor, at, gradient):
    """factor times the gradient of |e x u|^2, added to rows 0, 1 and at of gradient (4, 3)."""
    e, u = sub(end, start), sub(opposite, start)
    normal = cross(e, u)
    by_end, by_opposite = cross(u, normal), cross(normal, e)
    accumulate(gradient[1], 2.0 * factor, by_end)
    accumulate(gradient[at], 2.0 * factor, by_opposite)
    accumulate(gradient[0], -2.0 * factor, add(by_end, by_opposite))


@kernel
def openness_gradient(start, end, above, below, open_above, open_below, gradient):
    """Gradient of w of both triangles, multiplied, written to gradient (4, 3)."""
    n1, n2 = normal_of(start, end, above), normal_of(start, end, below)
    first, first_slope = _openness(dot(n1, n1), open_above)
    second, second_slope = _openness(dot(n2, n2), open_below)
    gradient[:] = 0.0
    _add_area_slope(start, end, above, first_slope * second, 2, gradient)
    _add_area_slope(start, end, below, second_slope * first, 3, gradient)


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
