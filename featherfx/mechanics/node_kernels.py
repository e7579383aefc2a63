"""Loads on single nodes: inertia, gravity, air drag, grips and dead loads.

    W = 1/2 a m |x - x_t|^2 + A - m g.x - f.x + D(v) / c + G(max(|x - x_g| - s, 0))
    G(u) = 1/2 k u^2 up to the largest force F = k u of a grip, beyond it F u - F^2 / (2 k)
    v = c (x - x_v)

a, x_t and c, x_v come from the time integrator (featherfx/solver/step/integrator_kernels.py): they
make the acceleration a (x - x_t) and the velocity c (x - x_v). m mass, g gravity, f dead load,
k, x_g and s stiffness, target and slack of a grip. A is that of the added mass (air_kernels).

Air drag, with u = v - wind and n the unit normal of the vane around the point, S its area there
(air_kernels.py):

    D = 1/2 rho S (C_n |u.n|^3 / 3 + C_t |u0| |u - (u.n) n|^2 / 2)

so that the normal force is 1/2 rho S C_n |u.n| u.n, quadratic and implicit; n and the speed |u0| in
the small tangential part are those of the predicted pose. D is convex in v: a storm adds
stiffness to a step and never makes it unstable. Unequal C_n and C_t push sideways, as a wing.

Attached flow adds, at a speed T of the air along the vane and across the rachis,

    1/2 rho S w T^2 H E(a x / H),    x = u.n / T

    E(y) = y up to 1 - d,    y - (y - 1 + d)^2 / 4 d up to 1 + d,    1 beyond,    E(-y) = -E(y)

a is the slope of the normal coefficient by the aspect of the vane (Helmbold 1942), H the most of
it, where flow stalls, d how round that is. u.n is its mean over the row, which meets the stream as
a plate would: camber lifts nothing. w falls from 2 at the leading edge to 0 at the trailing edge,
so that flow presses at a third of the chord. A stream along the rachis lifts nothing. Of E a step
takes the tangent at its start. With x = tan(angle), C_N = (C_n x^2 + H E) / (1 + x^2):
Helmbold's line up to stall, plates of aspect 2 up to 20 degrees (Pelletier and Mueller 2000, Re
1.4e5), and of any aspect from 30 degrees (Lindenburg 2003, ECN-C--03-025). The tangent rises with
u.n, so D stays convex.
"""

from featherfx.algebra.vector_kernels import accumulate, combined, dot, length, scale, store, sub
from featherfx.jit.compiled import kernel
from featherfx.mechanics.air_kernels import carries_air, unit_normal


@kernel
def _drag(air, rachis, facing, rate, point, around, i, p):
    """Energy D, its gradient by the velocity, and what its second derivative is made of.

    air: of Loads. rachis: m^2 of bare rachis. facing: the vane's unit normal and area, m^2. i, p:
    row and node. The second derivative is b 1 + (a - b) n n^T; returns (D, gradient, a, b).
    """
    (n, size), half = facing, 0.5 * air[0]
    normal, tangential = half * size * air[1], half * (size * air[2] + rachis * air[3])
    tangential, half = tangential * around.speed[i, p], half * size
    u = sub(scale(rate, sub(point, around.past.nodes[i, p])), around.wind[i, p])
    un = dot(u, n)
    t = sub(u, scale(un, n))
    force, slope = half * around.stream[i, p, 0], half * around.stream[i, p, 1]
    energy = normal * abs(un) ** 3 / 3.0 + 0.5 * tangential * dot(t, t)
    energy += (force + 0.5 * slope * un) * un
    gradient = combined(normal * abs(un) * un + force + slope * un, n, tangential, t)
    return energy, gradient, 2.0 * normal * abs(un) + slope, tangential


@kernel
def _carry(inertia, x, n, around, i, p):
    """Added mass at a point: A = 1/2 k d^2; returns (k, d = n.(x - x_t) - g / a)."""
    distance = dot(n, sub(x, around.target.nodes[i, p])) - around.slip[i, p] / inertia
    return inertia * around.carried[i, p], distance


@kernel
def node_energy(model, loads, f, factors, points, around):
    """Energy of inertia, added mass, gravity and drag of feather f (J).

    factors: a (1/s^2) and c (1/s; 0: no drag) of the integrator. points: (n, 1 + 2 m, 3) x. around:
    x_t, x_v, and the air of `blow_step`.
    """
    total = 0.0
    inertia, rate = factors.inertia, factors.rate
    blowing, carries = loads.air[0] > 0.0 and rate > 0.0, inertia > 0.0 and carries_air(loads, f)
    for i in range(points.shape[0]):
        for p in range(points.shape[1]):
            m, x = model.mass[f, i, p], points[i, p]
            offset = sub(x, around.target.nodes[i, p])
            total += 0.5 * inertia * m * dot(offset, offset)
            total -= m * dot(loads.gravity, x)
            facing = unit_normal(around.area[i, p]), length(around.area[i, p])
            if carries:
                stiffness, distance = _carry(inertia, x, facing[0], around, i, p)
                total += 0.5 * stiffness * distance * distance
            if blowing:
                rachis = model.rachis_area[f, i] if p == 0 else 0.0
                total += _drag(loads.air, rachis, facing, rate, x, around, i, p)[0] / rate
    return total


@kernel
def _add_along(stiffness, n, out):
    """Add stiffness n n^T to out (6,): xx yy zz xy xz yz."""
    for k in range(3):
        out[k] += stiffness * n[k] * n[k]
    out[3] += stiffness * n[0] * n[1]
    out[4] += stiffness * n[0] * n[2]
    out[5] += stiffness * n[1] * n[2]


@kernel
def node_forces(model, loads, f, factors, points, around, force, stiff):
    """Gradient and Hessian of node_energy: force (n, 1 + 2 m, 3); stiff (n, 1 + 2 m, 6) xx yy
    zz xy xz yz."""
    inertia, rate = factors.inertia, factors.rate
    blowing, carries = loads.air[0] > 0.0 and rate > 0.0, inertia > 0.0 and carries_air(loads, f)
    for i in range(points.shape[0]):
        for p in range(points.shape[1]):
            m, x, out = model.mass[f, i, p], points[i, p], stiff[i, p]
            offset = sub(x, around.target.nodes[i, p])
            store(force[i, p], combined(inertia * m, offset, -m, loads.gravity))
            for k in range(3):
                out[k], out[3 + k] = inertia * m, 0.0
            facing = unit_normal(around.area[i, p]), length(around.area[i, p])
            if carries:
                stiffness, distance = _carry(inertia, x, facing[0], around, i, p)
                accumulate(force[i, p], stiffness * distance, facing[0])
                _add_along(stiffness, facing[0], out)
            if blowing:
                rachis = model.rachis_area[f, i] if p == 0 else 0.0
                _, push, second, tangential = _drag(
                    loads.air, rachis, facing, rate, x, around, i, p
                )
                accumulate(force[i, p], 1.0, push)
                _add_along(rate * (second - tangential), facing[0], out)
                for k in range(3):
                    out[k] += rate * tangential


@kernel
def _grip_gap(loads, f, g, fraction, points):
    """From a grip's target to its point (m)."""
    start, end = loads.grip_start[f, g], loads.grip_end[f, g]
    point = points[loads.grip_node[f, g, 0], loads.grip_node[f, g, 1]]
    return sub(sub(point, start), scale(fraction, sub(end, start)))


@kernel
def _grip_pull(loads, f, g, distance):
    """(p, q) of a grip whose point is at a distance d (m) from its target: its gradient is k p d n,
    its Hessian k (p I + q n n^T).

    Beyond the slack s, p = 1 - s / d; where that would take more than the largest force F,
    p = F / (k d), so that the pull stays at F.
    """
    pull, bend = 1.0, 0.0
    if loads.grip_slack.shape[1] > 0 and loads.grip_slack[f, g] > 0.0:
        bend = min(loads.grip_slack[f, g] / distance, 1.0) if distance > 0.0 else 1.0
        pull = 1.0 - bend
        bend = bend if pull > 0.0 else 0.0
    if loads.max_grip_force.shape[1] > 0:
        most = loads.max_grip_force[f, g]
        if loads.grip_stiffness[f, g] * pull * distance > most:
            pull = most / (loads.grip_stiffness[f, g] * distance)
            bend = -pull
    return pull, bend


@kernel
def grip_energy(loads, f, fraction, points):
    """Energy of feather f's grips at a fraction of the frame (J)."""
    total = 0.0
    for g in range(loads.grip_stiffness.shape[1]):
        if loads.grip_node[f, g, 0] < 0:
            continue
        stiffness, distance = (
            loads.grip_stiffness[f, g],
            length(_grip_gap(loads, f, g, fraction, points)),
        )
        pull, bend = _grip_pull(loads, f, g, distance)
        force = stiffness * pull * distance
        if bend < 0.0:
            slack = loads.grip_slack[f, g] if loads.grip_slack.shape[1] > 0 else 0.0
            total += force * (distance - slack) - 0.5 * force * force / stiffness
        else:
            total += 0.5 * force * force / stiffness
    return total


@kernel
def add_grip_forces(loads, f, fraction, points, force, stiff):
    """Gradient and Hessian of grip_energy, added to force and stiff."""
    for g in range(loads.grip_stiffness.shape[1]):
        row, p = loads.grip_node[f, g, 0], loads.grip_node[f, g, 1]
        if row < 0:
            continue
        stiffness, gap = loads.grip_stiffness[f, g], _grip_gap(loads, f, g, fraction, points)
        distance, out = length(gap), stiff[row, p]
        pull, bend = _grip_pull(loads, f, g, distance)
        accumulate(force[row, p], stiffness * pull, gap)
        for k in range(3):
            out[k] += stiffness * pull
        if bend != 0.0:
            _add_along(stiffness * bend, scale(1.0 / distance, gap), out)


@kernel
def dead_energy(loads, f, fraction, points):
    """Energy of dead loads on feather f's nodes at a fraction of the frame (J)."""
    total = 0.0
    dead, change = loads.force[f], loads.force_change[f]
    for i in range(dead.shape[0]):
        for p in range(dead.shape[1]):
            for k in range(3):
                total -= dead[i, p, k] * points[i, p, k]
    for i in range(change.shape[0]):
        for p in range(change.shape[1]):
            for k in range(3):
                total -= fraction * change[i, p, k] * points[i, p, k]
    return total


@kernel
def add_dead_forces(loads, f, fraction, force):
    """Gradient of dead_energy, added to force."""
    dead, change = loads.force[f], loads.force_change[f]
    for i in range(dead.shape[0]):
        for p in range(dead.shape[1]):
            accumulate(force[i, p], -1.0, dead[i, p])
    for i in range(change.shape[0]):
        for p in range(change.shape[1]):
            accumulate(force[i, p], -fraction, change[i, p])
