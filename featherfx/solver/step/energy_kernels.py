"""Total energy of one feather's pose: the merit function of a step.

Every strain s has a stiffness k and, where the material is damped, a reference s_r:

    W = sum 1/2 k s^2 + 1/2 k q (s - s_r)^2,      q = retardation time * rate of the integrator

(Kelvin-Voigt; s measured from rest). Those of a hinge are angles, of which the elastic part knows
the fold alone, and their energy is multiplied by the square of its openness (vane_bending_kernels).
The rest is in node_kernels, contact_kernels and director_kernels.
"""

from featherfx.jit.compiled import kernel
from featherfx.mechanics.contact_kernels import contact_energy
from featherfx.mechanics.director_kernels import couple_energy, director_energy
from featherfx.mechanics.node_kernels import dead_energy, grip_energy, node_energy
from featherfx.mechanics.ribbon_kernels import curl_total
from featherfx.mechanics.turn_guard_kernels import turn_guard_total
from featherfx.mechanics.vane_bending_kernels import folded
from featherfx.mechanics.vane_guard_kernels import guard_total
from featherfx.mechanics.vane_hook_kernels import all_hold, hinge_hold, hooks_energy, twist_hold


@kernel
def _quadratic(strain, reference, stiffness, damping):
    """Energy of all strains of one kind, arrays of one shape."""
    s, before, k = strain.flat, reference.flat, stiffness.flat
    total = 0.0
    for a in range(stiffness.size):
        rate = s[a] - before[a]
        total += 0.5 * k[a] * (s[a] * s[a] + damping * rate * rate)
    return total


@kernel
def _hinge_energy(strains, reference, stiffness, damping):
    """As _quadratic, of the hinges. stiffness: (2, n, m)."""
    angle, before, k = strains.hinge.flat, reference.hinge.flat, stiffness.flat
    openness, total = strains.openness.flat, 0.0
    for a in range(stiffness.size):
        rate, (fold, _) = angle[a] - before[a], folded(angle[a])
        weight = 0.5 * k[a] * openness[a] * openness[a]
        total += weight * (fold * fold + damping * rate * rate)
    return total


@kernel
def _held_hinges(strains, reference, gaps, stiffness, damping):
    """As _hinge_energy, of hinges whose gaps may be open."""
    total = 0.0
    for side in range(stiffness.shape[0]):
        for i in range(1, stiffness.shape[1] - 1):
            for j in range(stiffness.shape[2]):
                angle, openness = strains.hinge[side, i, j], strains.openness[side, i, j]
                rate, (fold, _) = angle - reference.hinge[side, i, j], folded(angle)
                weight = 0.5 * stiffness[side, i, j] * hinge_hold(gaps, side, i, j)
                total += weight * openness * openness * (fold * fold + damping * rate * rate)
    return total


@kernel
def _held_twists(twist, reference, gaps, stiffness, damping):
    """As _quadratic, of the twist of cells whose gaps may be open."""
    total = 0.0
    for side in range(2):
        for i in range(stiffness.shape[1]):
            for j in range(stiffness.shape[2]):
                rate = twist[side, i, j] - reference[side, i, j]
                weight = 0.5 * stiffness[side, i, j] * twist_hold(gaps, side, i, j)
                total += weight * (twist[side, i, j] ** 2 + damping * rate * rate)
    return total


@kernel
def _bending_energy(model, f, strains, reference, gaps, damping, held):
    """As _quadratic, of hinges and twist, which open gaps leave loose."""
    hinge, twist = model.hinge_stiffness[f], model.twist_stiffness[f]
    if held:
        return _hinge_energy(strains, reference, hinge, damping) + _quadratic(
            strains.twist, reference.twist, twist, damping
        )
    return _held_hinges(strains, reference, gaps, hinge, damping) + _held_twists(
        strains.twist, reference.twist, gaps, twist, damping
    )


@kernel
def _cell_energy(model, f, cell, before, gaps, damping, held):
    """As _quadratic, of the membrane, whose gaps may slip. cell, before: (2, n-1, m, 2, 2). held:
    whether none does."""
    if held:
        return _quadratic(cell, before, model.cell_stiffness[f], damping)
    return hooks_energy(model, f, cell, before, gaps, damping)


@kernel
def elastic_energy(model, f, strains, reference, gaps, strain_rate):
    """Elastic energy, with the dissipation of the step and what slips in it, of Strains (J).

    reference: Strains. gaps: at the step's start. strain_rate: 1/s, of the integrator; 0 for
    the elastic energy alone.
    """
    shaft = model.retardation[f, 0] * strain_rate
    vane = model.retardation[f, 1] * strain_rate
    held = all_hold(model, f, strains.cell, gaps)
    return (
        _quadratic(strains.rachis, reference.rachis, model.rachis_stiffness[f], shaft)
        + curl_total(model, f, strains.rachis)
        + turn_guard_total(model, f, strains.rachis)
        + _quadratic(strains.barb, reference.barb, model.barb_stiffness[f], vane)
        + _cell_energy(model, f, strains.cell, reference.cell, gaps, vane, held)
        + guard_total(model.cell_guard[f], strains.cell)
        + _bending_energy(model, f, strains, reference, gaps, vane, held)
    )


@kernel
def _lag(strain, reference, stiffness):
    """sum k (s - s_r)^2 of all strains of one kind, arrays of one shape."""
    s, before, k = strain.flat, reference.flat, stiffness.flat
    total = 0.0
    for a in range(stiffness.size):
        rate = s[a] - before[a]
        total += k[a] * rate * rate
    return total


@kernel
def _cell_lag(cell, before, stiffness, hooked):
    """As _lag, of a membrane of which a part is hooked: (2, n-1, m, 2)."""
    s, reference, k, part = cell.flat, before.flat, stiffness.flat, hooked.flat
    total = 0.0
    for a in range(hooked.size):
        across, shear = s[2 * a] - reference[2 * a], s[2 * a + 1] - reference[2 * a + 1]
        total += part[a] * (k[2 * a] * across * across + k[2 * a + 1] * shear * shear)
    return total


@kernel
def damped_energy(model, f, strains, reference, gaps, strain_rate, h):
    """Return the energy that damping takes in a step of h (s) that ends at strains, J: h sum k tau
    (ds/dt)^2.

    strain_rate: of the integrator, ds/dt = strain_rate (s - s_r). Others as elastic_energy.
    """
    held = all_hold(model, f, strains.cell, gaps)
    bending = _bending_energy(model, f, strains, reference, gaps, 2.0, held)
    bending -= _bending_energy(model, f, strains, reference, gaps, 0.0, held)
    vane = _lag(strains.barb, reference.barb, model.barb_stiffness[f]) + bending
    vane += _cell_lag(strains.cell, reference.cell, model.cell_stiffness[f], gaps.hooked)
    shaft = _lag(strains.rachis, reference.rachis, model.rachis_stiffness[f])
    times = model.retardation[f]
    return h * strain_rate * strain_rate * (times[0] * shaft + times[1] * vane)


@kernel
def step_energy(model, loads, f, fraction, factors, pose, around):
    """Energy that an implicit step minimises, of a pose whose strains are known (J).

    factors: of the integrator. fraction: of the frame, for the grips.
    """
    nodes, directors = pose.points.nodes, pose.points.directors
    return (
        elastic_energy(model, f, pose.strains, around.reference, around.gaps, factors.strain_rate)
        + grip_energy(loads, f, fraction, nodes)
        + dead_energy(loads, f, fraction, nodes)
        + contact_energy(loads.contacts, f, fraction, nodes)
        + node_energy(model, loads, f, factors, nodes, around)
        + couple_energy(loads.couple[f], directors)
        + director_energy(
            model.rotary_inertia[f], factors.inertia, directors, around.target.directors
        )
    )
