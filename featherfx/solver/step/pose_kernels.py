"""From generalised coordinates to nodes and directors, and from one pose to the next.

Coordinates of a row: centre r (3), frame as quaternion (4), coefficients of both barbs (2 x 2 C).
Increments of a row, w = 6 + 4 C of them: dr (3), world rotation vector u (3), leading and trailing
coefficients.

Place of a root within a frame: a polynomial through samples of its path.

A path is (K, 6): position (m) and rotation vector relative to the frame's first sample (rad) at K
evenly spaced fractions of the frame; the rotation vectors are unwrapped, so that a root may spin
several turns in a frame. The polynomial through all samples is smooth, so substeps of any length
see no kinks.
"""

from featherfx.algebra.vector_kernels import (
    add,
    conjugate,
    copy_values,
    exponential,
    halfway_between,
    multiply,
    normalised,
    rotate,
    scale,
    store,
    store_rotation,
)
from featherfx.algebra.views import shaped
from featherfx.jit.compiled import kernel, shared_kernel
from featherfx.mechanics.barb_kernels import (
    barb_axes,
    barb_jacobian,
    barb_points,
    copy_points,
    points_of,
    root_jacobian,
)
from featherfx.mechanics.rachis_kernels import rachis_gradient, rachis_strain
from featherfx.solver.step.strain_kernels import copy_strains, feather_strains, strains_of


@kernel
def store_directors(rotation, directors):
    """Directors (2, 3) of a row from its frame (4,)."""
    store(directors[0], rotate(rotation, (0.0, 1.0, 0.0)))
    store(directors[1], rotate(rotation, (0.0, 0.0, 1.0)))


@kernel
def place_points(model, f, pose):
    """Points of feather f's pose, and the frames of its barbs, from its coordinates."""
    columns = model.joints.shape[3]
    for i in range(pose.rotation.shape[0]):
        nodes = pose.points.nodes[i]
        store(nodes[0], pose.centre[i])
        store_directors(pose.rotation[i], pose.points.directors[i])
        for side in range(2):
            start = 1 + side * columns
            barb_points(
                pose.rotation[i],
                pose.centre[i],
                model.clamp[f, side, i],
                model.joints[f, side, i],
                model.segment[f, side, i],
                model.shapes,
                pose.coefficient[side, i],
                pose.frames[side, i],
                nodes[start : start + columns],
            )


@kernel
def joint_axes(shapes, pose, axes):
    """Axes (2, n, m, 6) of the joints of all barbs, as barb_axes gives them.

    pose: with its frames, as place_points leaves them.
    """
    for side in range(2):
        for i in range(pose.rotation.shape[0]):
            barb_axes(pose.frames[side, i], shapes, pose.coefficient[side, i], axes[side, i])


@shared_kernel(None)
def barb_jacobians(shapes, pose, axes, jacobian):
    """Derivatives of the nodes of all barbs by their row's increments.

    shapes: (C, m). axes: of joint_axes at this pose. Written: jacobian (n, 2, 6 + 2 C, 3 S):
    increment (dr, u and the coefficients of this side), then axis by axis the nodes, of which 0 is
    the rachis point; what is always zero is not touched, nor what follows the m + 1 nodes.
    """
    columns, wide, size = shapes.shape[1], jacobian.shape[2], jacobian.shape[3] // 3
    for i in range(pose.rotation.shape[0]):
        for side in range(2):
            start, nodes = 1 + side * columns, pose.points.nodes[i]
            root, points = nodes[0], nodes[start : start + columns]
            barb = shaped(jacobian[i, side], (wide, 3, size))
            root_jacobian(root, points, barb)
            barb_jacobian(axes[side, i], shapes, root, points, barb)


@kernel
def _rachis_strains(length, pose):
    """Frames and strains of all rachis elements; length: (n-1,) at rest."""
    for i in range(length.shape[0]):
        rachis_strain(
            pose.rotation[i],
            pose.rotation[i + 1],
            pose.centre[i],
            pose.centre[i + 1],
            length[i],
            pose.halfway[i],
            pose.rachis[i],
        )


@kernel
def load_pose(model, f, state, pose):
    """Coordinates of feather f of a state into a pose, with its rachis frames and strains."""
    copy_values(state.rotation[f], pose.rotation)
    copy_values(state.centre[f], pose.centre)
    copy_values(state.coefficient[f], pose.coefficient)
    _rachis_strains(model.length[f], pose)


@kernel
def complete_pose(model, f, pose, angles):
    """Points and strains of a pose from its coordinates; angles: of feather_strains."""
    place_points(model, f, pose)
    _rachis_strains(model.length[f], pose)
    feather_strains(model, f, pose, angles)


@kernel
def keep_pose(f, pose, state):
    """A complete pose becomes that of feather f of a state, with the strains of the last step."""
    copy_values(pose.rotation, state.rotation[f])
    copy_values(pose.centre, state.centre[f])
    copy_values(pose.coefficient, state.coefficient[f])
    copy_points(pose.points, points_of(state.points, f))
    copy_strains(pose.strains, strains_of(state.strains, f, 0))


@kernel
def add_increment(length, now, step, factor, trial, gradient):
    """Coordinates of pose now plus factor times the increment step (N,), to those of pose trial.

    Row frames are turned by their rotation vectors and coefficients are added; the rachis points
    are then rebuilt from the root so that every stretch and shear changes by exactly its linear
    increment. Moving the points straight instead would stretch the nearly inextensible rachis at
    second order, and that artificial energy is what makes Newton crawl.

    length: (n-1,) m. gradient: (6, 12) scratch.
    """
    rows, count = now.rotation.shape[0], now.coefficient.shape[2]
    wide = 6 + 2 * count
    for i in range(rows):
        at = i * wide
        rotate_by(now.rotation[i], step[at + 3 : at + 6], factor, trial.rotation[i])
        for side in range(2):
            for c in range(count):
                trial.coefficient[side, i, c] = (
                    now.coefficient[side, i, c] + factor * step[at + 6 + side * count + c]
                )
    for k in range(3):
        trial.centre[0, k] = now.centre[0, k] + factor * step[k]
    for i in range(rows - 1):
        rachis_gradient(
            now.centre[i], now.centre[i + 1], length[i], now.halfway[i], now.rachis[i], gradient
        )
        at, to = i * wide, (i + 1) * wide
        for k in range(3):
            change = 0.0
            for a in range(6):
                change += gradient[k, a] * step[at + a] + gradient[k, 6 + a] * step[to + a]
            trial.rachis[i, k] = now.rachis[i, k] + factor * change
    rebuild_centres(length, trial)


@kernel
def rotate_by(rotation, vector, factor, out):
    """Quaternion (4,) followed by the world rotation vector (3,) times factor, to out."""
    store_rotation(out, normalised(multiply(exponential(scale(factor, vector)), rotation)))


@kernel
def turn_rows(rotations, before, x):
    """Turn the vectors of all rows in x (N,), a gradient or an increment, as the rows have turned
    from the rotations (n, 4) before."""
    wide = x.shape[0] // rotations.shape[0]
    for i in range(rotations.shape[0]):
        turn = multiply(rotations[i], conjugate(before[i]))
        for at in (i * wide, i * wide + 3):
            store(x[at:], rotate(turn, (x[at], x[at + 1], x[at + 2])))


@kernel
def rebuild_centres(length, pose):
    """Rachis points from the root, the frames and the stretches in pose.rachis."""
    for i in range(length.shape[0]):
        chain(
            pose.rotation[i],
            pose.rotation[i + 1],
            pose.rachis[i],
            length[i],
            pose.centre[i],
            pose.centre[i + 1],
        )


@kernel
def chain(rotation_a, rotation_b, stretch, length, point_a, point_b):
    """Next rachis point from the last one, both frames and the stretch between them."""
    along = rotate(halfway_between(rotation_a, rotation_b), stretch)
    store(point_b, add(point_a, scale(length, along)))


@kernel
def rest_pose(model, positions, rotations, state, pose):
    """Put all feathers of a state in their rest shape with roots at positions (F, 3), rotations
    (F, 4). pose: scratch, its coefficients zero."""
    for f in range(positions.shape[0]):
        store(pose.centre[0], positions[f])
        store_rotation(pose.rotation[0], rotations[f])
        for i in range(pose.rachis.shape[0]):
            for k in range(6):
                pose.rachis[i, k] = model.rachis_rest[f, i, k]
            bend = exponential(pose.rachis[i, 3:])
            after = normalised(multiply(pose.rotation[i], bend))
            store_rotation(pose.rotation[i + 1], after)
        rebuild_centres(model.length[f], pose)
        place_points(model, f, pose)
        copy_values(pose.rotation, state.rotation[f])
        copy_values(pose.centre, state.centre[f])
        copy_points(pose.points, points_of(state.points, f))


@kernel
def root_at(path, f, fraction, rotation, centre):
    """Root quaternion (4,) and position (3,) of feather f at a fraction 0..1 of the frame, written
    in place; path: RootPath.
    """
    samples = path.samples[f]
    count = samples.shape[0]
    place, vector = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
    for i in range(count):
        weight = 1.0
        for j in range(count):
            if j != i:
                weight *= (fraction * (count - 1) - j) / (i - j)
        place = add(place, scale(weight, samples[i]))
        vector = add(vector, scale(weight, samples[i, 3:]))
    store(centre, place)
    store_rotation(rotation, normalised(multiply(exponential(vector), path.base[f])))
