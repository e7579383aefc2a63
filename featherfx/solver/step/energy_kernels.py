"""Total energy of one feather's pose: the merit function of a step.

Every strain s has a stiffness k and, where the material is damped, a reference s_r:

    W = sum 1/2 k s^2 + 1/2 k q (s - s_r)^2,      q = retardation time * rate of the integrator

(Kelvin-Voigt; s measured from rest). Those of a hinge are angles, and their energy is multiplied by
the square of its share w (vane_bending_kernels), which follows behind the strains. The rest is in
node_kernels.
"""

from math import ceil

from featherfx.jit.compiled import kernel
from featherfx.mechanics.contact_kernels import contact_energy
from featherfx.mechanics.node_kernels import dead_energy, grip_energy, node_energy
from featherfx.mechanics.vane_bending_kernels import angle_and_openness, opening
from featherfx.mechanics.vane_guard_kernels import guard_total
from featherfx.mechanics.vane_membrane_kernels import membrane_strain


@kernel
def node_index(side, column, columns):
    """Material point of a barb node; column 0 is the rachis."""
    return 0 if column == 0 else 2 + side * columns + column


@kernel
def wrapped(angle):
    """Angle brought to (-pi, pi]."""
    return angle - 6.283185307179586 * ceil(angle / 6.283185307179586 - 0.5)


@kernel
def feather_strains(model, f, coefficient, points, rachis, reference, strains):
    """All strains of feather f, measured from rest, and the shares of hinges, to strains (S,).

    reference: (S,) strains of before; dihedral angles are those within half a turn of them, so
    that a fold that closes completely and goes on has no jump.
    """
    rows, columns = coefficient.shape[1], model.joints.shape[3]
    at = 0
    for i in range(rows - 1):
        for k in range(6):
            strains[at] = rachis[i, k] - model.rachis_rest[f, i, k]
            at += 1
    for side in range(2):
        for i in range(rows):
            for c in range(coefficient.shape[2]):
                strains[at] = coefficient[side, i, c]
                at += 1
    rest = model.cell_rest[f]
    stiffness = model.cell_stiffness[f]
    for side in range(2):
        for i in range(rows - 1):
            for j in range(columns):
                near, far = node_index(side, j, columns), node_index(side, j + 1, columns)
                for half in range(2):
                    across, shear = 0.0, 0.0
                    if stiffness[side, i, j, half, 0] != 0.0:
                        r, o = (i, i + 1) if half == 0 else (i + 1, i)
                        across, shear = membrane_strain(
                            points[r, near],
                            points[r, far],
                            points[o, near if half == 0 else far],
                            rest[side, i, j, half],
                        )
                    strains[at] = across
                    strains[at + 1] = shear
                    at += 2
    for side in range(2):
        for i in range(rows):
            for j in range(columns):
                angle, share = 0.0, 1.0
                if model.hinge_stiffness[f, side, i, j] != 0.0:
                    near, far = node_index(side, j, columns), node_index(side, j + 1, columns)
                    angle, share = angle_and_openness(
                        points[i, near],
                        points[i, far],
                        points[i + 1, near],
                        points[i - 1, far],
                        opening(rest[side, i, j, 0]),
                        opening(rest[side, i - 1, j, 1]),
                    )
                    angle = wrapped(angle - model.hinge_rest[f, side, i, j] - reference[at])
                    angle += reference[at]
                strains[at] = angle
                strains[at + 2 * rows * columns] = share
                at += 1


@kernel
def _quadratic(strain, reference, stiffness, damping):
    rate = strain - reference
    return 0.5 * stiffness * (strain * strain + damping * rate * rate)


@kernel
def elastic_energy(model, f, strains, reference, strain_rate):
    """Elastic energy, with the dissipation of the step, of strains (S,) (J).

    reference: (S,). strain_rate: 1/s, of the integrator; 0 for the elastic energy alone.
    """
    rows, columns = model.mass.shape[1], model.joints.shape[3]
    shaft = model.retardation[f, 0] * strain_rate
    vane = model.retardation[f, 1] * strain_rate
    total = 0.0
    at = 0
    for i in range(rows - 1):
        for k in range(6):
            stiffness = model.rachis_stiffness[f, i, k]
            total += _quadratic(strains[at], reference[at], stiffness, shaft)
            at += 1
    for side in range(2):
        for i in range(rows):
            for c in range(model.barb_stiffness.shape[3]):
                stiffness = model.barb_stiffness[f, side, i, c]
                total += _quadratic(strains[at], reference[at], stiffness, vane)
                at += 1
    for side in range(2):
        for i in range(rows - 1):
            for j in range(columns):
                for half in range(2):
                    for k in range(2):
                        stiffness = model.cell_stiffness[f, side, i, j, half, k]
                        total += _quadratic(strains[at], reference[at], stiffness, vane)
                        at += 1
    total += guard_total(model.cell_guard[f], strains[at - 8 * (rows - 1) * columns :])
    for side in range(2):
        for i in range(rows):
            for j in range(columns):
                share = strains[at + 2 * rows * columns]
                stiffness = model.hinge_stiffness[f, side, i, j] * share * share
                total += _quadratic(strains[at], reference[at], stiffness, vane)
                at += 1
    return total


@kernel
def step_energy(model, loads, f, fraction, factors, pose, around):
    """Energy that an implicit step minimises, of a pose whose strains are known (J).

    factors: of the integrator. fraction: of the frame, for the grips.
    """
    return (
        elastic_energy(model, f, pose.strains, around.reference, factors.strain_rate)
        + grip_energy(loads, f, fraction, pose.points)
        + dead_energy(loads, f, fraction, pose.points)
        + contact_energy(loads.contacts, f, fraction, pose.points)
        + node_energy(model, loads, f, factors, pose.points, around)
    )
