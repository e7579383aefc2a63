"""Feathers in their rest shape."""

from featherfx.algebra.rotation_kernels import exponential, multiply, normalised, store_rotation
from featherfx.algebra.vec3_kernels import store
from featherfx.jit.compiled import kernel
from featherfx.solver.step.pose_kernels import chain, material_points


@kernel
def rest_pose(model, positions, turns, turn, centre, coefficient, frames, points):
    """Put all feathers in their rest shape with roots at positions (F, 3), turns (F, 4).

    Written: turn (F, n, 4), centre (F, n, 3), points (F, n, P, 3); coefficient (F, 2, n, 2 C)
    must be zero. frames: (2, n, m, 4) scratch.
    """
    for f in range(positions.shape[0]):
        store(centre[f, 0], positions[f])
        store_rotation(turn[f, 0], turns[f])
        for i in range(turn.shape[1] - 1):
            rest, row, after = model.rachis_rest[f, i], turn[f, i], turn[f, i + 1]
            store_rotation(after, normalised(multiply(row, exponential(rest[3:]))))
            chain(row, after, rest, model.length[f, i], centre[f, i], centre[f, i + 1])
        material_points(model, f, turn[f], centre[f], coefficient[f], frames, points[f])
