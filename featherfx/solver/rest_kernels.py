"""Feathers in their rest shape."""

from featherfx.algebra.rotation_kernels import exponential, multiply, normalised
from featherfx.jit.compiled import kernel
from featherfx.solver.step.pose_kernels import chain, material_points


@kernel
def rest_pose(model, positions, turns, turn, centre, coefficient, frames, points):
    """Put all feathers in their rest shape with roots at positions (F, 3), turns (F, 4).

    Written: turn (F, n, 4), centre (F, n, 3), points (F, n, P, 3); coefficient (F, 2, n, 2 C)
    must be zero. frames: (2, n, m, 4) scratch.
    """
    for f in range(positions.shape[0]):
        for k in range(3):
            centre[f, 0, k] = positions[f, k]
        for k in range(4):
            turn[f, 0, k] = turns[f, k]
        for i in range(turn.shape[1] - 1):
            rest, t = model.rachis_rest[f, i], turn[f, i]
            w, x, y, z = exponential(rest[3], rest[4], rest[5])
            w, x, y, z = multiply(t[0], t[1], t[2], t[3], w, x, y, z)
            w, x, y, z = normalised(w, x, y, z)
            after = turn[f, i + 1]
            after[0], after[1], after[2], after[3] = w, x, y, z
            chain(t, after, rest, model.length[f, i], centre[f, i], centre[f, i + 1])
        material_points(model, f, turn[f], centre[f], coefficient[f], frames, points[f])
