"""Barb clamp: the first segment of a barb against its rest direction in the row's frame.

    W = 1/2 k_n s^2 + 1/2 k_b b^2,      k = B / (l / 2)

(s, b) are the turns of featherfx/lab/nodal/barb_bending_kernels.py between c_1 and the direction
t of the first segment, with c_3 for the normal; R C = (c_1, c_2, c_3) is the row's frame times the
rest frame of the clamp, B the barb's bending stiffness at its root and l the segment's length.
The spring is the bending of the half segment next to the rachis, so that the barb is clamped ever
harder, and in the limit exactly, as segments get shorter. An elastic clamp lowers k.
"""

from featherfx.algebra.rotation_kernels import cross, multiply, rotate
from featherfx.jit.compiled import kernel
from featherfx.lab.nodal.barb_bending_kernels import pull_back, turns, turns_gradient, unit_between


@kernel
def _clamp_frame(turn, clamp, root, node, frame):
    """c_1, t and c_3 to frame (3, 3), rows; returns the segment's length."""
    w, x, y, z = multiply(
        turn[0], turn[1], turn[2], turn[3], clamp[0], clamp[1], clamp[2], clamp[3]
    )
    frame[0, 0], frame[0, 1], frame[0, 2] = rotate(w, x, y, z, 1.0, 0.0, 0.0)
    frame[2, 0], frame[2, 1], frame[2, 2] = rotate(w, x, y, z, 0.0, 0.0, 1.0)
    return unit_between(root, node, frame[1])


@kernel
def clamp_strain(turn, clamp, root, node, frame):
    """(s, b) of one clamp.

    turn, clamp: (4,) quaternions of R and C. root, node: (3,) rachis point and the barb's first
    node. frame: (3, 3) scratch.
    """
    _clamp_frame(turn, clamp, root, node, frame)
    return turns(frame[0], frame[1], frame[2])


@kernel
def clamp_gradient(turn, clamp, root, node, frame, gradient, lines):
    """Gradients of (s, b), written to lines (2, 9): root, world rotation of R, node.

    Scratch: frame (3, 3), gradient (2, 3, 3).
    """
    length = _clamp_frame(turn, clamp, root, node, frame)
    turns_gradient(frame[0], frame[1], frame[2], gradient)
    for d in range(2):
        by_axis, by_segment, by_normal = gradient[d, 0], gradient[d, 1], gradient[d, 2]
        pull_back(frame[1], length, by_segment)
        ax, ay, az = cross(
            frame[0, 0], frame[0, 1], frame[0, 2], by_axis[0], by_axis[1], by_axis[2]
        )
        nx, ny, nz = cross(
            frame[2, 0], frame[2, 1], frame[2, 2], by_normal[0], by_normal[1], by_normal[2]
        )
        lines[d, 3], lines[d, 4], lines[d, 5] = ax + nx, ay + ny, az + nz
        for k in range(3):
            lines[d, k] = -by_segment[k]
            lines[d, 6 + k] = by_segment[k]
