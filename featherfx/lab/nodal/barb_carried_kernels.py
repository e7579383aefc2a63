"""Barb bending in a section that is carried along the barb without twist, from its clamp.

    (s, b) at joint j = turns between t_j and t_j+1 with the normal n_j,    j = 0 at the clamp
    n_j+1 = n_j - (n_j.t_j+1) / (1 + t_j.t_j+1) (t_j + t_j+1)

t_0, n_0: rest direction of the clamp and its normal, in the row's frame; t_k direction of segment
k. `turns` and the energy are those of featherfx/lab/nodal/barb_bending_kernels.py, where the
normal is the vane's own. This is the section of the barb-curvature kinematics, in terms of nodes:
barbs that do not yield in torsion, against barbs whose section the barbules turn with the vane.

Derivatives: with dt_k of the directions and the rotation r_k of the carried frame about t_k,

    dn_j = r_j t_j x n_j - (n_j.dt_j) t_j
    r_j+1 = r_j - (t_j x t_j+1).(dt_j + dt_j+1) / (1 + t_j.t_j+1)

The second is the holonomy of parallel transport (Bergou et al. 2008). A stencil's points are the
rachis point, the row's rotation and the barb's nodes from the first on.
"""

from featherfx.algebra.rotation_kernels import multiply, rotate
from featherfx.algebra.vec3_kernels import accumulate, add, cross, dot, scale, store
from featherfx.jit.compiled import kernel
from featherfx.lab.nodal.barb_bending_kernels import (
    MIN_COSINE,
    pull_back,
    turns,
    turns_gradient,
    unit_between,
)

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
    lean = dot(normal, second) / max(1.0 + dot(first, second), MIN_COSINE)
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
    by_direction = scale(-1.0 / max(1.0 + dot(first, second), MIN_COSINE), cross(first, second))
    for half in range(2):
        slope = gradient[0, half]
        store(slope, by_direction)
        _add_direction(joint + half, frame[half], before if half == 0 else length, slope, twist)
    _carry(frame)
    return length
