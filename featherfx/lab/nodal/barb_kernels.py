"""Barb bending: turns of a barb at its nodes, out of the vane and within it, and at its clamp.

    W = 1/2 k_n (s - s0)^2 + 1/2 k_b (b - b0)^2,          k = B / l

    s = sqrt(2 / c) (t_1 - t_2).n     turn out of the vane, about n x t, rad
    b = (2 / c) (t_1 x t_2).n         turn within the vane, about n, rad
    c = 1 + t_1.t_2                   s^2 + b^2 = (2 tan(angle / 2))^2
    n = N / |N|,    N = (x_+ - x_-) x (x_a - x_b)          normal of the vane at the node

t_1, t_2 unit directions of the segments before and after the node (x_-, x, x_+), x_a and x_b its
neighbours on the next and the last barb, s0 and b0 at rest, l the length that the node stands for,
B the bending stiffness of the bundle of barbs, in N m^2, out of the vane and within it.
Source: curvature of Bergou et al. 2008 (discrete elastic rods), split by the vane's own normal
instead of a material frame that would have to be carried along.

At the clamp the turns are those between c_1 and the direction t of the first segment, with c_3 for
the normal; R C = (c_1, c_2, c_3) is the row's frame times the rest frame of the clamp. There
k = B / (l / 2): the spring is the bending of the half segment next to the rachis, so that the barb
is clamped ever harder, in the limit exactly, as segments get shorter. An elastic clamp lowers k.

Barb stretch: every segment of a barb between two of its nodes.

    W = 1/2 k e^2,      e = e_vv = (d.d / s^2 - 1) / 2,      k = b E_vv (A_1 + A_2)

d = x_1 - x_0 the segment, s its rest length, A_1 and A_2 the rest areas of the triangles beside
it, b thickness, E_vv modulus along the barbs. Green-Lagrange strain along the barb is the same in
both triangles, because both have this edge: the term of Jouve 2024 eq. 4.1 needs no other nodes.

A stretched segment resists turning: its second variation is k e / s^2 |dx_1 - dx_0|^2 besides the
square of de.

Barb bending in a section that is carried along the barb without twist, from its clamp.

    (s, b) at joint j = turns between t_j and t_j+1 with the normal n_j,    j = 0 at the clamp
    n_j+1 = n_j - (n_j.t_j+1) / (1 + t_j.t_j+1) (t_j + t_j+1)

t_0, n_0: rest direction of the clamp and its normal, in the row's frame; t_k direction of segment
k. `turns` and the energy are those of featherfx/lab/nodal/barb_kernels.py, where the
normal is the vane's own. This is the section of the barb-curvature kinematics, in terms of nodes:
barbs that do not yield in torsion, against barbs whose section the barbules turn with the vane.

Derivatives: with dt_k of the directions and the rotation r_k of the carried frame about t_k,

    dn_j = r_j t_j x n_j - (n_j.dt_j) t_j
    r_j+1 = r_j - (t_j x t_j+1).(dt_j + dt_j+1) / (1 + t_j.t_j+1)

The second is the holonomy of parallel transport (Bergou et al. 2008). A stencil's points are the
rachis point, the row's rotation and the barb's nodes from the first on.
"""

from math import sqrt

from featherfx.algebra.vector_kernels import (
    accumulate,
    add,
    combined,
    cross,
    dot,
    length,
    multiply,
    rotate,
    scale,
    store,
    sub,
)
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


_MIN_COSINE = 1e-6  # of c: a barb folded back on itself would have an infinite slope


@kernel
def turns(first, second, normal):
    """(s, b) between unit directions first and second, each (3,), with unit normal (3,)."""
    c = max(1.0 + dot(first, second), _MIN_COSINE)
    out, within = dot(sub(first, second), normal), dot(cross(first, second), normal)
    return sqrt(2.0 / c) * out, 2.0 / c * within


@kernel
def turns_gradient(first, second, normal, gradient):
    """Derivatives of (s, b) by the three vectors, written to gradient (2, 3, 3)."""
    c = max(1.0 + dot(first, second), _MIN_COSINE)
    root = sqrt(2.0 / c)
    out, within = turns(first, second, normal)
    store(gradient[0, 0], combined(root, normal, -0.5 * out / c, second))
    store(gradient[0, 1], combined(-root, normal, -0.5 * out / c, first))
    store(gradient[0, 2], scale(root, sub(first, second)))
    store(gradient[1, 0], combined(2.0 / c, cross(second, normal), -within / c, second))
    store(gradient[1, 1], combined(2.0 / c, cross(normal, first), -within / c, first))
    store(gradient[1, 2], scale(2.0 / c, cross(first, second)))


@kernel
def _unit(v, out):
    """v / |v| to out (3,), zero if it has no length; returns the length."""
    size = length(v)
    store(out, scale(1.0 / size if size > 0.0 else 0.0, v))
    return size


@kernel
def unit_between(start, end, out):
    """Unit vector from start to end to out (3,), zero if they coincide; returns the distance."""
    return _unit(sub(end, start), out)


@kernel
def pull_back(unit, size, gradient):
    """Gradient (3,) by a unit vector u / |u| becomes that by u, in place; size: |u|."""
    inverse = 1.0 / size if size > 0.0 else 0.0
    store(gradient, scale(inverse, sub(gradient, scale(dot(gradient, unit), unit))))


@kernel
def vane_frame(before, node, after, above, below, frame):
    """t_1, t_2 and n of a barb node to frame (3, 3), rows; returns their three lengths."""
    first = unit_between(before, node, frame[0])
    second = unit_between(node, after, frame[1])
    return first, second, _unit(cross(sub(after, before), sub(above, below)), frame[2])


@kernel
def bend_strain(before, node, after, above, below, frame):
    """(s, b) at a barb node; x_-, x, x_+, x_a, x_b: (3,) each. frame: (3, 3) scratch."""
    vane_frame(before, node, after, above, below, frame)
    return turns(frame[0], frame[1], frame[2])


@kernel
def bend_gradient(before, node, after, above, below, frame, gradient, lines):
    """Gradients of (s, b), written to lines (2, 15): before, node, after, above, below.

    Scratch: frame (3, 3), gradient (2, 3, 3).
    """
    first, second, size = vane_frame(before, node, after, above, below, frame)
    turns_gradient(frame[0], frame[1], frame[2], gradient)
    along, up = sub(after, before), sub(above, below)
    for d in range(2):
        by_first, by_second, by_normal = gradient[d, 0], gradient[d, 1], gradient[d, 2]
        pull_back(frame[0], first, by_first)
        pull_back(frame[1], second, by_second)
        pull_back(frame[2], size, by_normal)
        by_barb, by_row = cross(up, by_normal), cross(by_normal, along)
        line = lines[d]
        store(line, scale(-1.0, add(by_first, by_barb)))
        store(line[3:], sub(by_first, by_second))
        store(line[6:], add(by_second, by_barb))
        store(line[9:], by_row)
        store(line[12:], scale(-1.0, by_row))


@kernel
def _clamp_frame(row, clamp, root, node, frame):
    """c_1, t and c_3 to frame (3, 3), rows; returns the segment's length."""
    base = multiply(row, clamp)
    store(frame[0], rotate(base, (1.0, 0.0, 0.0)))
    store(frame[2], rotate(base, (0.0, 0.0, 1.0)))
    return unit_between(root, node, frame[1])


@kernel
def clamp_strain(row, clamp, root, node, frame):
    """(s, b) of one clamp.

    row, clamp: (4,) quaternions of R and C. root, node: (3,) rachis point and the barb's first
    node. frame: (3, 3) scratch.
    """
    _clamp_frame(row, clamp, root, node, frame)
    return turns(frame[0], frame[1], frame[2])


@kernel
def clamp_gradient(row, clamp, root, node, frame, gradient, lines):
    """Gradients of (s, b), written to lines (2, 9): root, world rotation of R, node.

    Scratch: frame (3, 3), gradient (2, 3, 3).
    """
    length = _clamp_frame(row, clamp, root, node, frame)
    turns_gradient(frame[0], frame[1], frame[2], gradient)
    for d in range(2):
        by_axis, by_segment, by_normal = gradient[d, 0], gradient[d, 1], gradient[d, 2]
        pull_back(frame[1], length, by_segment)
        store(lines[d], scale(-1.0, by_segment))
        store(lines[d, 3:], add(cross(frame[0], by_axis), cross(frame[2], by_normal)))
        store(lines[d, 6:], by_segment)


_TWIST = 4  # line that holds the derivative of r_j


@kernel
def begin_barb(row, clamp, frame):
    """t_0 and n_0 to rows 0 and 2 of frame (3, 3); row, clamp: (4,) quaternions."""
    base = multiply(row, clamp)
    store(frame[0], rotate(base, (1.0, 0.0, 0.0)))
    store(frame[2], rotate(base, (0.0, 0.0, 1.0)))


@kernel
def _carry(frame):
    """Frame to the next segment: n_j+1 to row 2, t_j+1 to row 0."""
    first, second, normal = frame[0], frame[1], frame[2]
    lean = dot(normal, second) / max(1.0 + dot(first, second), _MIN_COSINE)
    accumulate(normal, -lean, add(first, second))
    store(first, second)


@kernel
def carried_turns(start, end, frame):
    """(s, b) at the joint before the segment from start to end, and frame to that segment."""
    unit_between(start, end, frame[1])
    s, b = turns(frame[0], frame[1], frame[2])
    _carry(frame)
    return s, b


@kernel
def begin_twist(frame, lines):
    """Derivative of r_0 at the clamp: that of the row's rotation, along t_0."""
    for a in range(lines.shape[1]):
        lines[_TWIST, a] = 0.0
    for k in range(3):
        lines[_TWIST, 3 + k] = frame[0, k]


@kernel
def _add_direction(segment, unit, length, gradient, line):
    """line += gradient (3,) by the direction of a segment; the gradient is overwritten."""
    if segment == 0:
        accumulate(line[3:], 1.0, cross(unit, gradient))
        return
    pull_back(unit, length, gradient)
    far = 3 * (segment + 1)
    near = far - 3 if segment > 1 else 0
    accumulate(line[far:], 1.0, gradient)
    accumulate(line[near:], -1.0, gradient)


@kernel
def carried_gradient(joint, before, start, end, frame, gradient, lines):
    """Gradients of (s, b) at a joint to lines 0 and 1, over the first 3 (joint + 3) unknowns.

    before: length of segment joint. start, end: (3,) of the segment after it. frame: (3, 3) of the
    segment before. lines[_TWIST] and frame go on to the next segment, whose length is returned.
    Scratch: gradient (2, 3, 3).
    """
    length = unit_between(start, end, frame[1])
    first, second, normal, twist = frame[0], frame[1], frame[2], lines[_TWIST]
    turns_gradient(first, second, normal, gradient)
    side = cross(first, normal)
    for d in range(2):
        by_first, by_second, by_normal = gradient[d, 0], gradient[d, 1], gradient[d, 2]
        about = dot(by_normal, side)
        accumulate(by_first, -dot(by_normal, first), normal)
        for a in range(3 * (joint + 3)):
            lines[d, a] = about * twist[a]
        _add_direction(joint, first, before, by_first, lines[d])
        _add_direction(joint + 1, second, length, by_second, lines[d])
    by_direction = scale(-1.0 / max(1.0 + dot(first, second), _MIN_COSINE), cross(first, second))
    for half in range(2):
        slope = gradient[0, half]
        store(slope, by_direction)
        _add_direction(joint + half, frame[half], before if half == 0 else length, slope, twist)
    _carry(frame)
    return length
