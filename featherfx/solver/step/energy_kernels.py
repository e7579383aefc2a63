"""Total energy of one feather's pose: the merit function of a step.

Every strain s has a stiffness k and, where the material is damped, a reference s_r:

    W = sum 1/2 k s^2 + 1/2 k q (s - s_r)^2

(strain_kernels; s measured from rest). Those of a hinge are angles, of which the elastic part
knows the fold alone, and their energy is multiplied by the square of its openness
(vane_bending_kernels). The rest is in node_kernels and contact_kernels.

Energy of a feather that is left alone: no step may end with more of it than it began with.

    E = T + U,    T = 1/2 sum m |v - d|^2 + 1/2 sum m_a (n.v)^2,
    U = elastic, springs of the dashpots included + gravity, grips and dead loads

m_a the added mass (air_kernels), v velocities, d that of the root. The root moves evenly or not at
all, so that it does no work in its own frame; heights are measured from it. Where E grows over a
step, its new velocities v - d are made smaller, which alters nothing that was solved for; where U
alone is above what there was, the step fails.

Within the tolerance of a step, generalised-alpha keeps part of the energy in its accelerations and
gives it back: T + U ripples within a period while a sum with terms of second order in h falls. For
a linear system and s = (1 - r) / (2 (1 + r)), r the spectral radius, K the stiffness,

    T + U + 1/2 s^2 h^2 a.M a + 1/4 (a - w).M K^-1 M (a - w)

never grows (derived here; compare Erlicher, Bonaventura and Bursi 2002), a smoothed, w true
acceleration. In motion that is resolved M (a - w) = 2 s h K v, so the last term is 1/2 s h
|v.M (a - w)|. A step that is resolved may give back this much, with the largest s, 1/2, because
nonlinear systems ripple as much for small s, too. Many steps of a frame that each gave back what
they may could gain without end, so none ends with more than T + U and this at the begin of any
before it in the frame.
"""

from math import inf, sqrt
from typing import NamedTuple

from featherfx.algebra.vector_kernels import dot, scale, sub
from featherfx.jit.compiled import kernel, shared_kernel
from featherfx.mechanics.air_kernels import carried_energy, carries_air, unit_normal
from featherfx.mechanics.barb_kernels import couple_energy, director_energy
from featherfx.mechanics.contact_kernels import contact_energy
from featherfx.mechanics.guard_kernels import guard_total, turn_guard_total
from featherfx.mechanics.node_kernels import dead_energy, grip_energy, node_energy
from featherfx.mechanics.ribbon_kernels import curl_total
from featherfx.mechanics.vane_bending_kernels import folded
from featherfx.mechanics.vane_hook_kernels import (
    all_hold,
    gaps_of,
    hinge_hold,
    hooks_energy,
    twist_hold,
)
from featherfx.solver.step.integrator_kernels import DIRECTOR_POINTS, NODE_POINTS, motion_of
from featherfx.solver.step.strain_kernels import difference_rate, strains_at


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
def _strain_energy(model, f, strains, reference, gaps, rachis, vane, held):
    """As elastic_energy, without what no strain of a dashpot changes."""
    return (
        _quadratic(strains.rachis, reference.rachis, model.rachis_stiffness[f], rachis)
        + _quadratic(strains.barb, reference.barb, model.barb_stiffness[f], vane)
        + _cell_energy(model, f, strains.cell, reference.cell, gaps, vane, held)
        + _bending_energy(model, f, strains, reference, gaps, vane, held)
    )


@shared_kernel(float)
def elastic_energy(model, f, strains, reference, gaps, rachis, vane):
    """Elastic energy, with that of damping and what slips in the step, of Strains (J).

    reference: Strains. gaps: at the step's start. rachis, vane: their damping, 0 for the elastic
    energy alone.
    """
    held = all_hold(model, f, strains.cell, gaps)
    return (
        _strain_energy(model, f, strains, reference, gaps, rachis, vane, held)
        + curl_total(model, f, strains.rachis)
        + turn_guard_total(model, f, strains.rachis)
        + guard_total(model.cell_guard[f], strains.cell)
    )


@kernel
def viscous_energy(model, f, now, history, gaps, h):
    """Energy of the springs of the dashpots, 1/2 sum g k (s - v)^2, or, with a time h (s) above 0,
    the energy that the dashpots take in it, J.

    now: Strains. history: of a state, of feather f. gaps: as in elastic_energy.
    """
    held, branches = all_hold(model, f, now.cell, gaps), model.relaxation_time.shape[2]
    total = -branches * _strain_energy(model, f, now, now, gaps, 0.0, 0.0, held)
    for i in range(branches):
        rachis, vane = model.relaxation_weight[f, 0, i], model.relaxation_weight[f, 1, i]
        if h > 0.0:
            rachis *= 2.0 * h / model.relaxation_time[f, 0, i]
            vane *= 2.0 * h / model.relaxation_time[f, 1, i]
        lag = strains_at(history, 2 + i)
        total += _strain_energy(model, f, now, lag, gaps, rachis, vane, held)
    return total


@kernel
def damped_energy(model, f, now, reference, history, gaps, steps):
    """Return the energy that damping takes in a step at the rate of its end, J.

    now, reference: Strains. history: of a state, its dashpots at the end. steps: (h, before) of
    damping_over.
    """
    h, before = steps
    rate = difference_rate(h, before)
    times = model.retardation[f]
    own = 2.0 * h * rate * rate
    whole = elastic_energy(model, f, now, reference, gaps, own * times[0], own * times[1])
    whole -= elastic_energy(model, f, now, now, gaps, 0.0, 0.0)
    return whole + viscous_energy(model, f, now, history, gaps, h)


@kernel
def step_energy(model, loads, f, fraction, factors, pose, around):
    """Energy that an implicit step minimises, of a pose whose strains are known (J).

    factors: of the integrator. fraction: of the frame, for the grips.
    """
    nodes, directors = pose.points.nodes, pose.points.directors
    return (
        elastic_energy(
            model,
            f,
            pose.strains,
            around.reference,
            around.gaps,
            factors.rachis_damping,
            factors.vane_damping,
        )
        + grip_energy(loads, f, fraction, nodes)
        + dead_energy(loads, f, fraction, nodes)
        + contact_energy(loads.contacts, f, fraction, nodes)
        + node_energy(model, loads, f, factors, nodes, around)
        + couple_energy(loads.couple[f], directors)
        + director_energy(
            model.rotary_inertia[f], factors.inertia, directors, around.target.directors
        )
    )


# growth that round-off and Newton's tolerance may cause, part of the energy that there is, and
# rounding of a strain (1 or rad)
_ENERGY_ROUNDING, _STRAIN_ROUNDING = 1e-8, 1e-11
# m over m, by which a path may leave the even motion that it is taken for
_EVEN_MOTION_TOLERANCE = 1e-12
# of what has no drift: directors
_NO_DRIFT = 0.0, 0.0, 0.0


class EnergyBound(NamedTuple):
    """Bound on the energy of a feather in the steps of a frame.

    alone: whether anything is promised. drift: (x, y, z) m/s, velocity of the root. rounding: J, by
    which round-off may raise the energy. energy: T + U now, J; most: that a step may end with.
    """

    alone: bool
    drift: tuple[float, float, float]
    rounding: float
    energy: float
    most: float


@kernel
def _any(values):
    found = False
    for value in values.flat:
        found = found or value != 0.0
    return found


@kernel
def _evenly(path):
    """Return whether a root path (K, 6) is straight, without turns and at one speed."""
    count, size = path.shape[0], 0.0
    for k in range(3):
        size = max(size, abs(path[0, k]), abs(path[count - 1, k]))
    for i in range(count):
        for k in range(3):
            place = path[0, k] + (path[count - 1, k] - path[0, k]) * i / (count - 1)
            if (
                abs(path[i, k] - place) > _EVEN_MOTION_TOLERANCE * size
                or path[i, 3 + k] != path[0, 3 + k]
            ):
                return False
    return True


@kernel
def is_isolated(model, loads, f, path, duration):
    """Return whether no work is done on feather f in a frame; return also the velocity d of its
    root (m/s).

    path: (K, 6) of the root (root_path); duration: s, of the frame. A free feather is never
    taken as left alone: smaller velocities would change its momenta.
    """
    last = path.shape[0] - 1
    x, y, z = path[last, 0] - path[0, 0], path[last, 1] - path[0, 1], path[last, 2] - path[0, 2]
    moving = x != 0.0 or y != 0.0 or z != 0.0
    alone = model.held[f] and _evenly(path)
    if loads.air[0] > 0.0:
        alone = alone and not (moving or _any(loads.wind_mean[f]) or _any(loads.wind_amplitude))
    for g in range(loads.grip_stiffness.shape[1]):
        still = not moving
        for k in range(3):
            still = still and loads.grip_start[f, g, k] == loads.grip_end[f, g, k]
        alone = alone and (still or loads.grip_node[f, g, 0] < 0)
    if loads.force[f].shape[0] > 0:
        alone = alone and not (moving or _any(loads.force_change))
    alone = alone and loads.couple[f].shape[0] == 0
    alone = alone and loads.contacts.first[f] == loads.contacts.first[f + 1]
    return alone, (x / duration, y / duration, z / duration)


@kernel
def _potential(model, loads, f, points, strains, history, gaps):
    """(U, scale of its rounding) of feather f, J, with its root at points[0, 0]."""
    elastic = elastic_energy(model, f, strains, strains, gaps, 0.0, 0.0)
    elastic += viscous_energy(model, f, strains, history, gaps, 0.0)
    fall, size = 0.0, 0.0
    for i in range(points.shape[0]):
        for p in range(points.shape[1]):
            part = 0.0
            for k in range(3):
                part -= loads.gravity[k] * (points[i, p, k] - points[0, 0, k])
            fall += model.mass[f, i, p] * part
            size += model.mass[f, i, p] * abs(part)
    grips, dead = grip_energy(loads, f, 0.0, points), dead_energy(loads, f, 0.0, points)
    return elastic + fall + grips + dead, elastic + size + grips + abs(dead)


@kernel
def _sum(values):
    total = 0.0
    for value in values.flat:
        total += value
    return total


@kernel
def _rounding_energy(model, f):
    """Energy (J) of strains that are nothing but round-off: that of a feather at perfect rest."""
    stiffness = _sum(model.rachis_stiffness[f]) + _sum(model.barb_stiffness[f])
    stiffness += _sum(model.cell_stiffness[f]) + _sum(model.hinge_stiffness[f])
    stiffness += _sum(model.twist_stiffness[f])
    return 0.5 * stiffness * _STRAIN_ROUNDING * _STRAIN_ROUNDING


@kernel
def _kinetic(mass, velocity, drift):
    """1/2 sum m |v - d|^2, J. mass: (n, .). velocity: (n, ., 3)."""
    total = 0.0
    for i in range(mass.shape[0]):
        for p in range(mass.shape[1]):
            v = sub(velocity[i, p], drift)
            total += 0.5 * mass[i, p] * dot(v, v)
    return total


@kernel
def _state_energy(model, loads, f, drift, state, around):
    """T + U of feather f of a state, J. drift: (x, y, z) m/s, d."""
    velocity, nodes = state.velocity, state.points.nodes[f]
    history, gaps = strains_at(state.strains, f), gaps_of(state.gaps, f)
    potential, _ = _potential(model, loads, f, nodes, strains_at(history, 0), history, gaps)
    turning = _kinetic(model.rotary_inertia[f], velocity.directors[f], _NO_DRIFT)
    carried = carried_energy(model, loads, f, nodes, velocity.nodes[f], around)
    return potential + _kinetic(model.mass[f], velocity.nodes[f], drift) + turning + carried


@kernel
def begin_bound(model, loads, f, path, duration, state, around):
    """Return the EnergyBound of a frame of duration (s) at its start; path: RootPath."""
    alone, drift = is_isolated(model, loads, f, path.samples[f], duration)
    if not alone:
        return EnergyBound(alone, drift, 0.0, 0.0, inf)
    energy = _state_energy(model, loads, f, drift, state, around)
    return EnergyBound(alone, drift, _rounding_energy(model, f), energy, inf)


@kernel
def update_bound(promise, energy):
    """The promise after a step that ends with so much energy (J)."""
    return EnergyBound(promise.alone, promise.drift, promise.rounding, energy, promise.most)


@kernel
def stored_sums(mass, drift, motion):
    """Sums of m |a|^2 and m (v - d).(a - w) of a Motion."""
    square, lag = 0.0, 0.0
    for i in range(mass.shape[0]):
        for p in range(mass.shape[1]):
            a, v = motion.smoothed[i, p], sub(motion.velocity[i, p], drift)
            square += mass[i, p] * dot(a, a)
            lag += mass[i, p] * dot(v, sub(a, motion.acceleration[i, p]))
    return square, lag


@kernel
def _carried_sums(motion, around):
    """As stored_sums, of the added mass, which moves along the normals alone."""
    square, lag = 0.0, 0.0
    for i in range(around.carried.shape[0]):
        for p in range(around.carried.shape[1]):
            m, n = around.carried[i, p], unit_normal(around.area[i, p])
            a, w = dot(n, motion.smoothed[i, p]), dot(n, motion.acceleration[i, p])
            square += m * a * a
            lag += m * dot(n, motion.velocity[i, p]) * (a - w)
    return square, lag


@kernel
def stored_energy(model, f, h, drift, state, around):
    """Return the energy that the accelerations of feather f may give back in a step of h (s), J."""
    nodes = motion_of(state, f, NODE_POINTS)
    square, lag = stored_sums(model.mass[f], drift, nodes)
    carried = _carried_sums(nodes, around)
    square, lag = square + carried[0], lag + carried[1]
    turning = stored_sums(model.rotary_inertia[f], _NO_DRIFT, motion_of(state, f, DIRECTOR_POINTS))
    return 0.125 * h * h * (square + turning[0]) + 0.25 * h * abs(lag + turning[1])


@kernel
def bound_step(promise, model, f, h, state, around):
    """The promise for a step of h (s) from a state on."""
    if not promise.alone:
        return promise
    held = stored_energy(model, f, h, promise.drift, state, around)
    most = min(promise.most, promise.energy + held)
    return EnergyBound(promise.alone, promise.drift, promise.rounding, promise.energy, most)


@kernel
def _solved_kinetic(mass, rate, points, past, drift):
    """As _kinetic of v = rate (x - past)."""
    total = 0.0
    for i in range(mass.shape[0]):
        for p in range(mass.shape[1]):
            v = sub(scale(rate, sub(points[i, p], past[i, p])), drift)
            total += 0.5 * mass[i, p] * dot(v, v)
    return total


@kernel
def _solved_carried(rate, points, around):
    """1/2 sum m_a (n.v)^2, J, of v = rate (x - past) in still air."""
    total = 0.0
    for i in range(points.shape[0]):
        for p in range(points.shape[1]):
            way = sub(points[i, p], around.past.nodes[i, p])
            across = rate * dot(unit_normal(around.area[i, p]), way)
            total += 0.5 * around.carried[i, p] * across * across
    return total


@kernel
def solved_energy(model, loads, f, promise, growth, rate, work):
    """(part of the velocities v - d that a solved step may keep, T + U with them in J).

    growth: J, what the integrator may give back. rate: of the integrator, v = rate (x - past). The
    solved step is in work, with its gaps and dashpots. The part is -1 where U alone is more than
    there was.
    """
    points, past, rotary = work.now.points, work.around.past, model.rotary_inertia[f]
    strains, history = work.now.strains, work.history
    potential, size = _potential(model, loads, f, points.nodes, strains, history, work.gaps)
    kinetic = _solved_kinetic(model.mass[f], rate, points.nodes, past.nodes, promise.drift)
    kinetic += _solved_kinetic(rotary, rate, points.directors, past.directors, _NO_DRIFT)
    if carries_air(loads, f):
        kinetic += _solved_carried(rate, points.nodes, work.around)
    growth += promise.rounding + _ENERGY_ROUNDING * (size + kinetic)
    most = promise.energy + growth - potential
    if kinetic <= most:
        return 1.0, potential + kinetic
    if most < 0.0:
        return -1.0, promise.energy
    return sqrt(most / kinetic), potential + most


@kernel
def _slow_down(keeps, drift, velocity):
    for i in range(velocity.shape[0]):
        for p in range(velocity.shape[1]):
            for k in range(3):
                velocity[i, p, k] = drift[k] + keeps * (velocity[i, p, k] - drift[k])


@kernel
def slow_down(keeps, drift, velocity):
    """Multiply velocities (RowPoints), measured from the root's, by what they keep, in place."""
    if keeps < 1.0:
        _slow_down(keeps, drift, velocity.nodes)
        _slow_down(keeps, _NO_DRIFT, velocity.directors)
