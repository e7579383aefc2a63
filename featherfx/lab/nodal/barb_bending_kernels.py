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
"""

from math import sqrt

from featherfx.algebra.rotation_kernels import multiply, rotate
from featherfx.algebra.vec3_kernels import add, combined, cross, dot, length, scale, store, sub
from featherfx.jit.compiled import kernel

MIN_COSINE = 1e-6  # of c: a barb folded back on itself would have an infinite slope


@kernel
def turns(first, second, normal):
    """(s, b) between unit directions first and second, each (3,), with unit normal (3,)."""
    c = max(1.0 + dot(first, second), MIN_COSINE)
    out, within = dot(sub(first, second), normal), dot(cross(first, second), normal)
    return sqrt(2.0 / c) * out, 2.0 / c * within


@kernel
def turns_gradient(first, second, normal, gradient):
    """Derivatives of (s, b) by the three vectors, written to gradient (2, 3, 3)."""
    c = max(1.0 + dot(first, second), MIN_COSINE)
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
