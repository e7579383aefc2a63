"""A pose that comes from outside, taken up by a state."""

from featherfx.compiled import kernel
from featherfx.solver.energy_kernels import feather_strains
from featherfx.solver.pose_kernels import material_points, rachis_strains


@kernel
def take_up_pose(model, f, turn, centre, coefficient, points, pose, reference, strains):
    """Material points and strains of feather f from its coordinates.

    turn (n, 4), centre (n, 3), coefficient (2, n, 2 C). Written: points (n, P, 3), strains (S,).
    pose and reference (S,) are scratch; dihedral angles are those within half a turn of reference.
    """
    material_points(model, f, turn, centre, coefficient, pose.frames, points)
    rachis_strains(model.length[f], turn, centre, pose.halfway, pose.rachis)
    feather_strains(model, f, coefficient, points, pose.rachis, reference, strains)
