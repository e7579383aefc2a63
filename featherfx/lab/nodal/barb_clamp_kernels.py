"""Barb clamp: the first segment of a barb against its rest direction in the row's frame.

    W = 1/2 k_n s^2 + 1/2 k_b b^2,      k = B / (l / 2)

(s, b) are the turns of featherfx/lab/nodal/barb_bending_kernels.py between c_1 and the direction
t of the first segment, with c_3 for the normal; R C = (c_1, c_2, c_3) is the row's frame times the
rest frame of the clamp, B the barb's bending stiffness at its root and l the segment's length.
The spring is the bending of the half segment next to the rachis, so that the barb is clamped ever
harder, and in the limit exactly, as segments get shorter. An elastic clamp lowers k.
"""

from featherfx.algebra.rotation_kernels import multiply, rotate
from featherfx.algebra.vec3_kernels import add, cross, scale, store
from featherfx.jit.compiled import kernel
from featherfx.lab.nodal.barb_bending_kernels import pull_back, turns, turns_gradient, unit_between


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
