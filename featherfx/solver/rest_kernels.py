"""Feathers in their rest shape."""

from featherfx.algebra.copy_kernels import copy_values
from featherfx.algebra.rotation_kernels import exponential, multiply, normalised, store_rotation
from featherfx.algebra.vec3_kernels import store
from featherfx.jit.compiled import kernel
from featherfx.solver.step.pose_kernels import material_points, rebuild_centres


@kernel
def rest_pose(model, positions, rotations, state, pose):
    """Put all feathers of a state in their rest shape with roots at positions (F, 3), rotations
    (F, 4). pose: scratch, its coefficients zero."""
    for f in range(positions.shape[0]):
        store(pose.centre[0], positions[f])
        store_rotation(pose.rotation[0], rotations[f])
        copy_values(model.rachis_rest[f], pose.rachis)
        for i in range(pose.rachis.shape[0]):
            bend = exponential(pose.rachis[i, 3:])
            after = normalised(multiply(pose.rotation[i], bend))
            store_rotation(pose.rotation[i + 1], after)
        rebuild_centres(model.length[f], pose)
        material_points(model, f, pose)
        copy_values(pose.rotation, state.rotation[f])
        copy_values(pose.centre, state.centre[f])
        copy_values(pose.points, state.points[f])
