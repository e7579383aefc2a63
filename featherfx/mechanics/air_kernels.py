"""The air around a vane: wind at its nodes, and the areas and normals that it presses on.

What presses on a place of a vane is air that flows around a stretch of it about as long as the vane
is wide, not what a wave of a few barbs would turn aside for itself. With the normals of the surface
a wave of wave number k, over which the wind goes along the rachis at U, is fed by

    rho C_n |u.n| U k

a square metre and metre of its height: the shorter, the more, and nothing but the vane's bending
across its barbs holds it, nothing where they are loose. A plume then flutters in waves of 17 mm on
grids that have them, and the edge of a swan's vane snaps over otherwise on each grid.
A strip of width c that moves across itself by cos(k s) turns aside, in potential flow, all of
pi rho c^2 / 4 a metre where waves are long and half of it at k c = 3.76, as air goes from crest to
trough instead of around the edges. So normals n are evened out along the rachis (arc length s),

    n' - d/ds (l^2 dn'/ds) = n,     dn'/ds = 0 at both ends of the vane,

and scaled to length 1, with l = c / 3.76: waves 1.7 times as long as the vane is wide keep half of
their slope, longer ones nearly all, shorter ones less by the square. c is 0.64 of the length of
both barbs of a row together (0.61 to 0.67 in flight feathers and plumes). A vane that is straight
along the rachis keeps its normals. The area of a place is what is seen of it along n'. So do gusts:
of one of wave number k a vane feels 1 / (1 + k^2 l^2), c from end to end of its row. With all of
them, what the shortest push, by their accelerations, differs with the grid.

Added mass. A strip of chord c that moves across itself carries air (potential flow, Lamb 1932, art.
71; Theodorsen 1935 for the mean of a strip in a stream):

    rho pi c^2 / 4 a metre of vane,    m_a = rho pi c / 4 an area,
    F = -m_a n' (n'.(dv/dt - Du/Dt) + (r x n').(v - u) + (dn'/dt - r x n').(v - v_r))

v velocity of the vane, v_r as it would go rigidly with the root, r spin of the root, u velocity of
the air, Du/Dt its acceleration (Auton, Hunt and Prud'homme 1988): gusts, which travel with the mean
wind, have none and push by what they press alone. The strip's air is spread evenly over it. A thin
plate feels pressure along its normal alone. In still air, F.v = -d/dt (1/2 m_a (n'.v)^2) where the
root stays, and of a rigid vane: it gives back what it takes. Normals that turn by bending in a
stream U would also push by U dn'/dt; without the air that leaves the strip downstream that feeds
any edge that is free upstream with m_a U w^2 / 2, w its velocity across: a swan's primary then
flutters in a breeze from any side. So it is left out, and so are forces on the leading edge
(suction, Munk's moment). A vane of permeability p carries 1 - p of m_a, one of several in a sheet
a part, a loose barb its own air.
At the end of a step of h, with normals and air of the pose expected there,

    W = 1/2 m_a a (n.(x - x_t) - g / a)^2

a and x_t of the time integrator (node_kernels), g all in F but n'.dv/dt.

Air through a vane. It loses the pressure (Darcy and Forchheimer; T the transmissivity, w the mean
speed through the vane)

    dp = w / T + 1/2 rho C (1 - p) / p^2 w^2,

its strips of drag coefficient C = C_n being met at w / p. Air that passes takes off the load of a
plate: as of a porous sheet where it is light (Taylor 1944), as of an actuator disc in a straight
line to C where none passes (Wilson and Lissaman 1974). With x = w / u, u the vane's speed through
the air across itself,

    dp / (1/2 rho u^2) = 4 x (1 - x),  x > sqrt(C) / 2,      else C - 4 (sqrt(C) - 1) x.

Nearly open, a vane bears what its strips bear one by one, C (1 - p); where air is slow, Darcy's
loss closes it.
"""

from math import inf, sqrt

from featherfx.algebra.vector_kernels import (
    accumulate,
    add,
    combined,
    cosine,
    cross,
    dot,
    length,
    normal_of,
    scale,
    store,
    sub,
)
from featherfx.jit.compiled import kernel, shared_kernel
from featherfx.mechanics.barb_kernels import node_index

# d; m/s below which air stands
STALL_ROUNDNESS, NO_SPEED = 0.25, 1e-9
# of the width of a vane
EVEN_RATIO = 1.0 / 3.76
# of the length of both barbs of a row: 0.64 / 3.76
EVEN_BARB_DIFFERENCE = 0.17


@kernel
def wind_at(loads, f, time, point, even):
    """Wind velocity at one point near feather f (m/s), its waves times 1 / (1 + even k^2)."""
    wave, amplitude, mean = loads.wind_wave, loads.wind_amplitude, loads.wind_mean[f]
    x, y, z = wave[0], wave[1], wave[2]
    a, b, c = amplitude[0], amplitude[1], amplitude[2]
    u, v, w = mean[0], mean[1], mean[2]
    for k in range(loads.wind_rate.size):
        angle = x[k] * point[0] + y[k] * point[1] + z[k] * point[2]
        gust = cosine(angle - loads.wind_rate[k] * time + loads.wind_phase[k])
        gust /= 1.0 + even * (x[k] * x[k] + y[k] * y[k] + z[k] * z[k])
        u, v, w = u + gust * a[k], v + gust * b[k], w + gust * c[k]
    return u, v, w


@kernel
def sample_wind(loads, f, time, points, wind):
    """Wind at the nodes, points (n, 1 + 2 m, 3), written to wind (n, 1 + 2 m, 3).

    Gusts are sampled at the rachis and at both ends of a row and run linearly between. They are
    evened out as normals are.
    """
    columns = points.shape[1] // 2
    for i in range(points.shape[0]):
        ends = sub(points[i, columns], points[i, 2 * columns])
        even = EVEN_RATIO * EVEN_RATIO * dot(ends, ends)
        middle = wind_at(loads, f, time, points[i, 0], even)
        store(wind[i, 0], middle)
        for side in range(2 if columns > 0 else 0):
            end = middle
            if loads.wind_rate.shape[0] > 0:
                end = wind_at(loads, f, time, points[i, columns * (side + 1)], even)
            for j in range(columns):
                along = scale((j + 1.0) / columns, sub(end, middle))
                store(wind[i, node_index(side, j + 1, columns)], add(middle, along))


@kernel
def area_vectors(points, cell_stiffness, area):
    """Vane area around each node times its normal, written to area (n, 1 + 2 m, 3), m^2.

    points: nodes. cell_stiffness: (2, n-1, m, 2, 2) tells which triangles exist.
    """
    area[:] = 0.0
    columns = cell_stiffness.shape[2]
    for side in range(2):
        sign = 1.0 / 6.0 if side == 0 else -1.0 / 6.0
        for i in range(cell_stiffness.shape[1]):
            for j in range(columns):
                near, far = node_index(side, j, columns), node_index(side, j + 1, columns)
                for half in range(2):
                    if cell_stiffness[side, i, j, half, 0] == 0.0:
                        continue
                    ia, ka, ib, kb, ic, kc = i, near, i, far, i + 1, near
                    if half == 1:
                        ia, ka, ib, kb, ic, kc = i, far, i + 1, far, i + 1, near
                    third = scale(-sign, normal_of(points[ia, ka], points[ib, kb], points[ic, kc]))
                    accumulate(area[ia, ka], 1.0, third)
                    accumulate(area[ib, kb], 1.0, third)
                    accumulate(area[ic, kc], 1.0, third)


@kernel
def _joined(model, f, side, i):
    """l^2 over the distance of rows i and i + 1 (m); 0 where one of them has no barb."""
    if i < 0 or i >= model.length.shape[1]:
        return 0.0
    segment = model.segment[f]
    if segment[side, i] == 0.0 or segment[side, i + 1] == 0.0:
        return 0.0
    reach = EVEN_BARB_DIFFERENCE * model.joints.shape[3]
    here, there = segment[0, i] + segment[1, i], segment[0, i + 1] + segment[1, i + 1]
    return reach * reach * here * there / model.length[f, i]


@kernel
def _stands_for(model, f, i):
    """Length of rachis that row i stands for (m)."""
    own = 0.5 * model.length[f, i - 1] if i > 0 else 0.0
    return own + 0.5 * model.length[f, i] if i < model.length.shape[1] else own


@kernel
def _even_out(model, f, side, area, room, passed_on):
    """Areas of the nodes of one vane, along its normals evened out along the rachis.

    The rows' equations are one tridiagonal system, solved for all columns from the base to the tip
    and back; a node without area has no normal. area: (n, 1 + 2 m, 3), written. room: the same,
    scratch. passed_on: (n, .), scratch.
    """
    rows, columns, below = area.shape[0], area.shape[1] // 2, 0.0
    first = node_index(side, 1, columns)
    for i in range(rows):
        own, above = _stands_for(model, f, i), _joined(model, f, side, i)
        share = passed_on[i - 1, 0] if i > 0 else 0.0
        whole = 1.0 / (own + above + below * (1.0 - share))
        own, share, passed_on[i, 0] = own * whole, below * whole, above * whole
        for p in range(first, first + columns):
            size = length(area[i, p])
            normal = scale(own / size if size > 0.0 else 0.0, area[i, p])
            if share > 0.0:
                normal = combined(1.0, normal, share, room[i - 1, p])
            store(room[i, p], normal)
        below = above
    for k in range(rows):
        i, share = rows - 1 - k, passed_on[rows - 1 - k, 0]
        for p in range(first, first + columns):
            if share > 0.0:
                accumulate(room[i, p], share, room[i + 1, p])
            square = dot(room[i, p], room[i, p])
            seen = abs(dot(room[i, p], area[i, p])) / square if square > 0.0 else 0.0
            store(area[i, p], scale(seen, room[i, p]))


@kernel
def vane_areas(model, f, points, area, room, passed_on):
    """Area of the vane around each node, seen along its normal there, times that normal.

    area: (n, 1 + 2 m, 3) m^2, written; the rachis' own nodes have the normals of the surface. room:
    the same, scratch. passed_on: (n, 1 + 2 m), scratch.
    """
    area_vectors(points, model.cell_stiffness[f], area)
    for side in range(2):
        _even_out(model, f, side, area, room, passed_on)


@kernel
def unit_normal(area):
    """Area vector, or another, over its length; zero where it has none."""
    size = length(area)
    return scale(1.0 / size if size > 0.0 else 0.0, area)


@kernel
def carries_air(loads, f):
    """Return whether the air moves with the vane of feather f."""
    return loads.air[0] > 0.0 and loads.added_mass.size > 0 and loads.added_mass[f] > 0.0


@kernel
def carry_air(model, loads, f, around):
    """Write the added mass m_a of every node, kg; none where no air is carried."""
    around.carried[:] = 0.0
    if carries_air(loads, f):
        density = loads.air[0] * loads.added_mass[f]
        for i in range(around.carried.shape[0]):
            for p in range(around.carried.shape[1]):
                around.carried[i, p] = density * model.air_volume[f, i, p]


@kernel
def carried_energy(model, loads, f, before, velocity, around):
    """1/2 sum m_a (n.v)^2 in still air, J. Writes m_a, and the areas of the nodes before."""
    carry_air(model, loads, f, around)
    if not carries_air(loads, f):
        return 0.0
    vane_areas(model, f, before, around.area, around.wind, around.speed)
    total = 0.0
    for i in range(velocity.shape[0]):
        for p in range(velocity.shape[1]):
            across = dot(unit_normal(around.area[i, p]), velocity[i, p])
            total += 0.5 * around.carried[i, p] * across * across
    return total


@kernel
def _accelerate_slip(motion, points, span, spin, change, around):
    """Write the slip g of every node. around.aside: areas at the step's start.

    The target's accelerations belong to the normals there: with others, of a vane whose air is
    heavy, what is light along it would throw it across.
    """
    _, h, rate, inertia = span
    start = points[0, 0]
    root = scale(rate, sub(start, around.past.nodes[0, 0]))
    for i in range(points.shape[0]):
        for p in range(points.shape[1]):
            around.slip[i, p] = 0.0
            if around.carried[i, p] == 0.0:
                continue
            x, n = points[i, p], unit_normal(around.area[i, p])
            turn, rigid = sub(n, unit_normal(around.aside[i, p])), cross(spin, sub(x, start))
            velocity = combined(1.0, root, -rate, sub(x, around.past.nodes[i, p]))
            aim = sub(around.target.nodes[i, p], motion.points[i, p])
            aim = combined(inertia, aim, -inertia * h, motion.velocity[i, p])
            push = cross(spin, sub(add(root, rigid), around.wind[i, p]))
            aim = combined(1.0 / h, add(velocity, rigid), -1.0, aim)
            around.slip[i, p] = dot(n, add(change, push)) + dot(turn, aim)


@shared_kernel(None)
def blow_step(motion, points, span, spin, loads, f, model, around):
    """Air of a step: that of `blow` at the nodes expected at its end, added masses and slip g.

    motion: PointMotion of the nodes at the step's start. span: time at its end (s), its length (s),
    rate (1/s) and inertia (1/s^2) of the integrator. spin: (3,) rad/s, of the root.
    """
    carry_air(model, loads, f, around)
    if carries_air(loads, f):
        vane_areas(model, f, motion.points, around.aside, around.wind, around.speed)
    blow(points, span[0], loads, f, motion.velocity, model, around)
    if carries_air(loads, f):
        _accelerate_slip(motion, points, span, spin, loads.wind_change[f], around)


@kernel
def pressed_share(passing, air, speed):
    """Part of a closed vane's pressure at a speed across it (m/s) on one that air passes.

    passing: (2,) 1 / T, Pa s/m, and (1 - p) / p^2. air: of Loads.
    """
    drag = max(air[1], 1.0)
    rise, root = passing[1] * air[1], sqrt(drag)
    viscous = 2.0 * passing[0] / (air[0] * speed) if speed > 0.0 else inf
    line = 4.0 * (root - 1.0) + (viscous if passing[0] > 0.0 else 0.0)
    below = line + sqrt(line * line + 4.0 * rise * drag)
    through = 2.0 * drag / below if below > 0.0 else 1.0
    if through <= 0.5 * root:
        return 1.0 - 4.0 * (root - 1.0) / drag * through
    through = (4.0 - line + 4.0 * (root - 1.0)) / (4.0 + rise)
    return 4.0 * through * (1.0 - through) / drag


@kernel
def _let_through(model, f, air, velocity, around):
    """Leave the part of the areas of a vane that bears the pressure of a closed one."""
    columns, leading, trailing = velocity.shape[1] // 2, model.passing[f, 0], model.passing[f, 1]
    for i in range(velocity.shape[0]):
        for p in range(velocity.shape[1]):
            u, n = sub(velocity[i, p], around.wind[i, p]), unit_normal(around.area[i, p])
            share, across = 0.0, abs(dot(u, n))
            if p <= columns:
                share += pressed_share(leading, air, across)
            if p == 0 or p > columns:
                share += pressed_share(trailing, air, across)
            store(around.area[i, p], scale(0.5 * share if p == 0 else share, around.area[i, p]))


@shared_kernel(None)
def blow(points, time, loads, f, velocity, model, around):
    """Wind, vane areas and speeds through the air at the predicted nodes of feather f."""
    # wind and speeds are not known yet: room for the areas
    vane_areas(model, f, points, around.area, around.wind, around.speed)
    sample_wind(loads, f, time, points, around.wind)
    for i in range(points.shape[0]):
        for p in range(points.shape[1]):
            around.speed[i, p] = length(sub(velocity[i, p], around.wind[i, p]))
    if min(model.passing[f, 0, 0], model.passing[f, 1, 0]) < inf:
        _let_through(model, f, loads.air, velocity, around)
    around.stream[:] = 0.0
    if model.attached[f, 0] * model.attached[f, 1] > 0.0:
        for i in range(points.shape[0]):
            _attach_row(points, i, model.attached[f], velocity, around)


@kernel
def _attached(y):
    """Return E and its derivative."""
    over = min(max(abs(y) - 1.0 + STALL_ROUNDNESS, 0.0), 2.0 * STALL_ROUNDNESS)
    level = min(max(y, -1.0 - STALL_ROUNDNESS), 1.0 + STALL_ROUNDNESS)
    bent = over / STALL_ROUNDNESS
    return level - 0.25 * bent * over * (1.0 if y > 0.0 else -1.0), 1.0 - 0.5 * bent


@kernel
def _attach_row(points, i, flow, velocity, around):
    """Write the tangent of attached flow at the nodes of row i: its force and slope, of stream.
    flow: H and a."""
    columns, last = points.shape[1] // 2, points.shape[0] - 1
    way = unit_normal(sub(points[min(i + 1, last), 0], points[max(i - 1, 0), 0]))
    ends = sub(points[i, columns], points[i, 2 * columns])
    middle = scale(0.5, add(points[i, columns], points[i, 2 * columns]))
    through, whole, stream = 0.0, 0.0, around.stream[i]
    for p in range(points.shape[1]):
        size = length(around.area[i, p])
        if size == 0.0:
            stream[p, 0] = 0.0  # of another feather
            continue
        u, n = sub(velocity[i, p], around.wind[i, p]), scale(1.0 / size, around.area[i, p])
        un = dot(u, n)
        along = combined(1.0, u, -un, n)
        across = combined(1.0, along, -dot(along, way), way)
        half, ahead = 0.5 * abs(dot(across, ends)), dot(across, sub(points[i, p], middle))
        stream[p, 0], stream[p, 2] = length(across), un
        stream[p, 1] = 1.0 + min(max(ahead / half, -1.0), 1.0) if half > 0.0 else 1.0
        through, whole = through + size * un, whole + size
    mean = flow[1] * through / (flow[0] * whole) if whole > 0.0 else 0.0
    for p in range(points.shape[1]):
        speed, ahead, un = stream[p, 0], stream[p, 1], stream[p, 2]
        push, rise = _attached(mean / speed) if speed > NO_SPEED else (0.0, 0.0)
        slope = ahead * speed * flow[1] * rise
        stream[p, 0], stream[p, 1] = ahead * speed * speed * flow[0] * push - slope * un, slope
