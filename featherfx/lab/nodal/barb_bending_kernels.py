"""Barb bending: turns of a barb at its nodes, out of the vane and within it.

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
"""

from math import sqrt

from featherfx.algebra.rotation_kernels import cross
from featherfx.jit.compiled import kernel

SMALLEST = 1e-6  # of c: a barb folded back on itself would have an infinite slope


@kernel
def turns(first, second, normal):
    """(s, b) between unit directions first and second, each (3,), with unit normal (3,)."""
    c = 1.0 + first[0] * second[0] + first[1] * second[1] + first[2] * second[2]
    c = max(c, SMALLEST)
    x, y, z = cross(first[0], first[1], first[2], second[0], second[1], second[2])
    out, within = 0.0, 2.0 / c * (x * normal[0] + y * normal[1] + z * normal[2])
    for k in range(3):
        out += (first[k] - second[k]) * normal[k]
    return sqrt(2.0 / c) * out, within


@kernel
def turns_gradient(first, second, normal, gradient):
    """Derivatives of (s, b) by the three vectors, written to gradient (2, 3, 3)."""
    c = 1.0 + first[0] * second[0] + first[1] * second[1] + first[2] * second[2]
    c = max(c, SMALLEST)
    root = sqrt(2.0 / c)
    out, within = turns(first, second, normal)
    second_normal = cross(second[0], second[1], second[2], normal[0], normal[1], normal[2])
    normal_first = cross(normal[0], normal[1], normal[2], first[0], first[1], first[2])
    binormal = cross(first[0], first[1], first[2], second[0], second[1], second[2])
    for k in range(3):
        gradient[0, 0, k] = root * normal[k] - 0.5 * out / c * second[k]
        gradient[0, 1, k] = -root * normal[k] - 0.5 * out / c * first[k]
        gradient[0, 2, k] = root * (first[k] - second[k])
        gradient[1, 0, k] = 2.0 / c * second_normal[k] - within / c * second[k]
        gradient[1, 1, k] = 2.0 / c * normal_first[k] - within / c * first[k]
        gradient[1, 2, k] = 2.0 / c * binormal[k]


@kernel
def unit_between(start, end, out):
    """Unit vector from start to end to out (3,), zero if they coincide; returns the distance."""
    x, y, z = end[0] - start[0], end[1] - start[1], end[2] - start[2]
    length = sqrt(x * x + y * y + z * z)
    scale = 1.0 / length if length > 0.0 else 0.0
    out[0], out[1], out[2] = scale * x, scale * y, scale * z
    return length


@kernel
def pull_back(unit, length, gradient):
    """Gradient (3,) by a unit vector u / |u| becomes that by u, in place; length: |u|."""
    scale = 1.0 / length if length > 0.0 else 0.0
    along = gradient[0] * unit[0] + gradient[1] * unit[1] + gradient[2] * unit[2]
    for k in range(3):
        gradient[k] = scale * (gradient[k] - along * unit[k])


@kernel
def vane_frame(before, node, after, above, below, frame):
    """t_1, t_2 and n of a barb node to frame (3, 3), rows; returns their three lengths."""
    first = unit_between(before, node, frame[0])
    second = unit_between(node, after, frame[1])
    x, y, z = cross(
        after[0] - before[0],
        after[1] - before[1],
        after[2] - before[2],
        above[0] - below[0],
        above[1] - below[1],
        above[2] - below[2],
    )
    size = sqrt(x * x + y * y + z * z)
    scale = 1.0 / size if size > 0.0 else 0.0
    frame[2, 0], frame[2, 1], frame[2, 2] = scale * x, scale * y, scale * z
    return first, second, size


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
    ux, uy, uz = after[0] - before[0], after[1] - before[1], after[2] - before[2]
    vx, vy, vz = above[0] - below[0], above[1] - below[1], above[2] - below[2]
    for d in range(2):
        by_first, by_second, by_normal = gradient[d, 0], gradient[d, 1], gradient[d, 2]
        pull_back(frame[0], first, by_first)
        pull_back(frame[1], second, by_second)
        pull_back(frame[2], size, by_normal)
        by_barb = cross(vx, vy, vz, by_normal[0], by_normal[1], by_normal[2])
        by_row = cross(by_normal[0], by_normal[1], by_normal[2], ux, uy, uz)
        for k in range(3):
            lines[d, k] = -by_first[k] - by_barb[k]
            lines[d, 3 + k] = by_first[k] - by_second[k]
            lines[d, 6 + k] = by_second[k] + by_barb[k]
            lines[d, 9 + k] = by_row[k]
            lines[d, 12 + k] = -by_row[k]
