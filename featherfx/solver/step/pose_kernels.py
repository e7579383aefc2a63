"""From generalised coordinates to material points, and from one pose to the next.

Coordinates of a row: centre r (3), frame as quaternion (4), coefficients of both barbs (2 x 2 C).
Increments of a row, w = 6 + 4 C of them: dr (3), world rotation vector u (3), leading and trailing
coefficients.
"""

from featherfx.algebra.copy_kernels import copy_values
from featherfx.algebra.rotation_kernels import (
    exponential,
    halfway_between,
    multiply,
    normalised,
    rotate,
    store_rotation,
)
from featherfx.algebra.vec3_kernels import add, scale, store
from featherfx.jit.compiled import kernel, shared_kernel
from featherfx.mechanics.barb_kernels import barb_axes, barb_jacobian, barb_points, root_jacobian
from featherfx.mechanics.rachis_kernels import rachis_gradient, rachis_strain


@kernel
def store_directors(turn, points):
    """Material points 1 and 2 of a row (P, 3) from its frame (4,)."""
    store(points[1], rotate(turn, (0.0, 1.0, 0.0)))
    store(points[2], rotate(turn, (0.0, 0.0, 1.0)))


@kernel
def material_points(model, f, turn, centre, coefficient, frames, points):
    """Material points (n, P, 3) of feather f's pose, and the frames (2, n, m, 4) of its barbs."""
    columns = model.joints.shape[3]
    for i in range(turn.shape[0]):
        store(points[i, 0], centre[i])
        store_directors(turn[i], points[i])
        for side in range(2):
            start = 3 + side * columns
            barb_points(
                turn[i],
                centre[i],
                model.clamp[f, side, i],
                model.joints[f, side, i],
                model.segment[f, side, i],
                model.shapes,
                coefficient[side, i],
                frames[side, i],
                points[i, start : start + columns],
            )


@kernel
def joint_axes(shapes, pose, axes):
    """Axes (2, n, m, 6) of the joints of all barbs, as barb_axes gives them.

    pose: with its frames, as material_points leaves them.
    """
    for side in range(2):
        for i in range(pose.turn.shape[0]):
            barb_axes(pose.frames[side, i], shapes, pose.coefficient[side, i], axes[side, i])


@shared_kernel
def barb_jacobians(shapes, pose, axes, jacobian):
    """Derivatives of the nodes of all barbs by their row's increments.

    shapes: (C, m). axes: of joint_axes at this pose. Written: jacobian (n, 2, 6 + 2 C, 3 S):
    increment (dr, u and the coefficients of this side), then axis by axis the nodes, of which 0 is
    the rachis point; what is always zero is not touched, nor what follows the m + 1 nodes.
    """
    columns, wide, size = shapes.shape[1], jacobian.shape[2], jacobian.shape[3] // 3
    for i in range(pose.turn.shape[0]):
        for side in range(2):
            start = 3 + side * columns
            root, points = pose.points[i, 0], pose.points[i, start : start + columns]
            barb = jacobian[i, side].reshape((wide, 3, size))
            root_jacobian(root, points, barb)
            barb_jacobian(axes[side, i], shapes, root, points, barb)


@kernel
def rachis_strains(length, turn, centre, halfway, strain):
    """Frames (n-1, 3, 3) and strains (n-1, 6) of all rachis elements; length: (n-1,) at rest."""
    for i in range(turn.shape[0] - 1):
        rachis_strain(
            turn[i], turn[i + 1], centre[i], centre[i + 1], length[i], halfway[i], strain[i]
        )


@kernel
def load_pose(turn, centre, coefficient, length, pose):
    """Coordinates of one feather into a pose, with its rachis frames and strains."""
    copy_values(turn, pose.turn)
    copy_values(centre, pose.centre)
    copy_values(coefficient, pose.coefficient)
    rachis_strains(length, pose.turn, pose.centre, pose.halfway, pose.rachis)


@kernel
def add_increment(length, now, step, factor, trial, beam, stretch):
    """Coordinates of pose now plus factor times the increment step (N,), to those of pose trial.

    Row frames are turned by their rotation vectors and coefficients are added; the rachis points
    are then rebuilt from the root so that every stretch and shear changes by exactly its linear
    increment. Moving the points straight instead would stretch the nearly inextensible shaft at
    second order, and that artificial energy is what makes Newton crawl.

    length: (n-1,) m. beam: (6, 12) and stretch: (3,) are scratch.
    """
    rows = now.turn.shape[0]
    count = now.coefficient.shape[2]
    wide = 6 + 2 * count
    for i in range(rows):
        at = i * wide
        turn_by(now.turn[i], step[at + 3 : at + 6], factor, trial.turn[i])
        for side in range(2):
            for c in range(count):
                trial.coefficient[side, i, c] = (
                    now.coefficient[side, i, c] + factor * step[at + 6 + side * count + c]
                )
    for k in range(3):
        trial.centre[0, k] = now.centre[0, k] + factor * step[k]
    for i in range(rows - 1):
        rachis_gradient(
            now.centre[i], now.centre[i + 1], length[i], now.halfway[i], now.rachis[i], beam
        )
        at, to = i * wide, (i + 1) * wide
        for k in range(3):
            change = 0.0
            for a in range(6):
                change += beam[k, a] * step[at + a] + beam[k, 6 + a] * step[to + a]
            stretch[k] = now.rachis[i, k] + factor * change
        chain(
            trial.turn[i],
            trial.turn[i + 1],
            stretch,
            length[i],
            trial.centre[i],
            trial.centre[i + 1],
        )


@kernel
def turn_by(turn, vector, factor, out):
    """Quaternion turn (4,) followed by the world rotation vector (3,) times factor, to out."""
    store_rotation(out, normalised(multiply(exponential(scale(factor, vector)), turn)))


@kernel
def chain(turn_a, turn_b, stretch, length, point_a, point_b):
    """Next rachis point from the last one, both frames and the stretch between them."""
    along = rotate(halfway_between(turn_a, turn_b), stretch)
    store(point_b, add(point_a, scale(length, along)))
