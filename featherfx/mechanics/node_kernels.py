"""What acts on single material points: inertia, gravity, air drag, grips and dead loads.

    W = 1/2 a m |x - x_t|^2 - m g.x - f.x + D(v) / c + 1/2 k |x - x_g|^2,     v = c (x - x_v)

a, x_t and c, x_v come from the time integrator (featherfx/solver/step/integrator_kernels.py): they
make the acceleration a (x - x_t) and the velocity c (x - x_v). m mass, g gravity, f dead load,
k and x_g stiffness and target of a grip.

Air drag, with u = v - wind and n the unit normal of the vane around the point, S its area there:

    D = 1/2 rho S (C_n |u.n|^3 / 3 + C_t |u0| |u - (u.n) n|^2 / 2)

so that the normal force is 1/2 rho S C_n |u.n| u.n, quadratic and implicit; n and the speed |u0| in
the small tangential part are those of the predicted pose. D is convex in v: a storm adds
stiffness to a step and never makes it unstable. Unequal C_n and C_t give lift.
"""

from math import cos, sqrt

from featherfx.jit.compiled import kernel, shared_kernel


@kernel
def wind_at(x, y, z, time, mean, wave, rate, amplitude, phase):
    """Wind velocity at one point (m/s)."""
    wx, wy, wz = mean[0], mean[1], mean[2]
    for k in range(rate.shape[0]):
        c = cos(wave[k, 0] * x + wave[k, 1] * y + wave[k, 2] * z - rate[k] * time + phase[k])
        wx += amplitude[k, 0] * c
        wy += amplitude[k, 1] * c
        wz += amplitude[k, 2] * c
    return wx, wy, wz


@kernel
def sample_wind(points, time, mean, wave, rate, amplitude, phase, wind):
    """Wind at the material points (n, P, 3), written to wind (n, P, 3).

    Gusts are sampled at the rachis and at both ends of a row and run linearly between.
    """
    rows, size = points.shape[0], points.shape[1]
    columns = (size - 3) // 2
    if rate.shape[0] == 0 or columns == 0:
        for i in range(rows):
            for p in range(size):
                for k in range(3):
                    wind[i, p, k] = mean[k]
        for i in range(rows if rate.shape[0] > 0 else 0):
            q = points[i, 0]
            wx, wy, wz = wind_at(q[0], q[1], q[2], time, mean, wave, rate, amplitude, phase)
            wind[i, 0, 0], wind[i, 0, 1], wind[i, 0, 2] = wx, wy, wz
        return
    for i in range(rows):
        p = points[i, 0]
        wx, wy, wz = wind_at(p[0], p[1], p[2], time, mean, wave, rate, amplitude, phase)
        wind[i, 0, 0], wind[i, 0, 1], wind[i, 0, 2] = wx, wy, wz
        for side in range(2):
            p = points[i, 2 + columns * (side + 1)]
            ex, ey, ez = wind_at(p[0], p[1], p[2], time, mean, wave, rate, amplitude, phase)
            for j in range(columns):
                share = (j + 1.0) / columns
                k = 3 + side * columns + j
                wind[i, k, 0] = wx + share * (ex - wx)
                wind[i, k, 1] = wy + share * (ey - wy)
                wind[i, k, 2] = wz + share * (ez - wz)


@kernel
def area_vectors(points, cell_stiffness, area):
    """Vane area around each material point times its normal, written to area (n, P, 3), m^2.

    points: (n, P, 3). cell_stiffness: (2, n-1, m, 2, 2) tells which triangles exist.
    """
    area[:] = 0.0
    columns = cell_stiffness.shape[2]
    for side in range(2):
        sign = 1.0 / 6.0 if side == 0 else -1.0 / 6.0
        for i in range(cell_stiffness.shape[1]):
            for j in range(columns):
                near = 0 if j == 0 else 2 + side * columns + j
                far = 3 + side * columns + j
                for half in range(2):
                    if cell_stiffness[side, i, j, half, 0] == 0.0:
                        continue
                    ia, ka, ib, kb, ic, kc = i, near, i, far, i + 1, near
                    if half == 1:
                        ia, ka, ib, kb, ic, kc = i, far, i + 1, far, i + 1, near
                    a, b, c = points[ia, ka], points[ib, kb], points[ic, kc]
                    ux, uy, uz = b[0] - a[0], b[1] - a[1], b[2] - a[2]
                    vx, vy, vz = c[0] - a[0], c[1] - a[1], c[2] - a[2]
                    nx = -sign * (uy * vz - uz * vy)
                    ny = -sign * (uz * vx - ux * vz)
                    nz = -sign * (ux * vy - uy * vx)
                    area[ia, ka, 0] += nx
                    area[ia, ka, 1] += ny
                    area[ia, ka, 2] += nz
                    area[ib, kb, 0] += nx
                    area[ib, kb, 1] += ny
                    area[ib, kb, 2] += nz
                    area[ic, kc, 0] += nx
                    area[ic, kc, 1] += ny
                    area[ic, kc, 2] += nz


@shared_kernel
def blow(points, time, loads, f, velocity, cell_stiffness, around):
    """Wind, vane areas and speeds through the air at the predicted points of feather f."""
    sample_wind(
        points,
        time,
        loads.wind_mean[f],
        loads.wind_wave,
        loads.wind_rate,
        loads.wind_amplitude,
        loads.wind_phase,
        around.wind,
    )
    area_vectors(points, cell_stiffness, around.area)
    for i in range(points.shape[0]):
        for p in range(points.shape[1]):
            square = 0.0
            for k in range(3):
                square += (velocity[i, p, k] - around.wind[i, p, k]) ** 2
            around.speed[i, p] = sqrt(square)


@kernel
def _drag(ux, uy, uz, nx, ny, nz, normal, tangential):
    """Energy and force of the drag potential; u relative velocity, n unit normal.

    normal = 1/2 rho S C_n, tangential = 1/2 rho S C_t |u0|.
    """
    un = ux * nx + uy * ny + uz * nz
    tx, ty, tz = ux - un * nx, uy - un * ny, uz - un * nz
    push = normal * abs(un) * un
    energy = normal * abs(un) ** 3 / 3.0 + 0.5 * tangential * (tx * tx + ty * ty + tz * tz)
    return (
        energy,
        push * nx + tangential * tx,
        push * ny + tangential * ty,
        push * nz + tangential * tz,
    )


@kernel
def air_factors(area, shaft, air, speed):
    """(unit normal, 1/2 rho S C_n, 1/2 rho S C_t |u0|) at a point; shaft: m^2 of bare shaft."""
    size = sqrt(area[0] ** 2 + area[1] ** 2 + area[2] ** 2)
    half = 0.5 * air[0]
    inverse = 1.0 / size if size > 0.0 else 0.0
    return (
        area[0] * inverse,
        area[1] * inverse,
        area[2] * inverse,
        half * size * air[1],
        half * (size * air[2] + shaft * air[3]) * speed,
    )


@kernel
def node_energy(points, target, inertia, past, rate, mass, gravity, air, wind, area, speed, shaft):
    """Energy of inertia, gravity and drag of one feather (J).

    points, target, past: (n, P, 3) x, x_t, x_v. inertia: a (1/s^2). rate: c (1/s); 0: no drag.
    mass: (n, P). wind, area: (n, P, 3). speed: (n, P) |u0|. shaft: (n,).
    """
    total = 0.0
    blowing = air[0] > 0.0 and rate > 0.0
    for i in range(points.shape[0]):
        for p in range(points.shape[1]):
            m = mass[i, p]
            x = points[i, p]
            t = target[i, p]
            square = (x[0] - t[0]) ** 2 + (x[1] - t[1]) ** 2 + (x[2] - t[2]) ** 2
            total += 0.5 * inertia * m * square
            if p == 1 or p == 2:
                continue
            total -= m * (gravity[0] * x[0] + gravity[1] * x[1] + gravity[2] * x[2])
            if blowing:
                nx, ny, nz, normal, tangential = air_factors(
                    area[i, p], shaft[i] if p == 0 else 0.0, air, speed[i, p]
                )
                ux = rate * (x[0] - past[i, p, 0]) - wind[i, p, 0]
                uy = rate * (x[1] - past[i, p, 1]) - wind[i, p, 1]
                uz = rate * (x[2] - past[i, p, 2]) - wind[i, p, 2]
                energy, _, _, _ = _drag(ux, uy, uz, nx, ny, nz, normal, tangential)
                total += energy / rate
    return total


@kernel
def node_forces(
    points, target, inertia, past, rate, mass, gravity, air, wind, area, speed, shaft, force, stiff
):
    """Gradient and Hessian of node_energy: force (n, P, 3); stiff (n, P, 6) xx yy zz xy xz yz."""
    blowing = air[0] > 0.0 and rate > 0.0
    for i in range(points.shape[0]):
        for p in range(points.shape[1]):
            m = mass[i, p]
            heavy = 0.0 if p == 1 or p == 2 else m
            for k in range(3):
                offset = points[i, p, k] - target[i, p, k]
                force[i, p, k] = inertia * m * offset - heavy * gravity[k]
                stiff[i, p, k] = inertia * m
                stiff[i, p, 3 + k] = 0.0
            if not blowing or p == 1 or p == 2:
                continue
            nx, ny, nz, normal, tangential = air_factors(
                area[i, p], shaft[i] if p == 0 else 0.0, air, speed[i, p]
            )
            ux = rate * (points[i, p, 0] - past[i, p, 0]) - wind[i, p, 0]
            uy = rate * (points[i, p, 1] - past[i, p, 1]) - wind[i, p, 1]
            uz = rate * (points[i, p, 2] - past[i, p, 2]) - wind[i, p, 2]
            _, fx, fy, fz = _drag(ux, uy, uz, nx, ny, nz, normal, tangential)
            force[i, p, 0] += fx
            force[i, p, 1] += fy
            force[i, p, 2] += fz
            un = ux * nx + uy * ny + uz * nz
            along = rate * (2.0 * normal * abs(un) - tangential)
            stiff[i, p, 0] += along * nx * nx + rate * tangential
            stiff[i, p, 1] += along * ny * ny + rate * tangential
            stiff[i, p, 2] += along * nz * nz + rate * tangential
            stiff[i, p, 3] += along * nx * ny
            stiff[i, p, 4] += along * nx * nz
            stiff[i, p, 5] += along * ny * nz


@kernel
def dead_energy(points, dead, change, share):
    """Energy of dead loads on the material points (n, P, 3).

    dead: (n, P, 3) N at the frame's start, change: (n, P, 3) N over the frame; (0, 0, 3) for none.
    share: 0..1, of the frame.
    """
    total = 0.0
    for i in range(dead.shape[0]):
        for p in range(dead.shape[1]):
            for k in range(3):
                total -= dead[i, p, k] * points[i, p, k]
    for i in range(change.shape[0]):
        for p in range(change.shape[1]):
            for k in range(3):
                total -= share * change[i, p, k] * points[i, p, k]
    return total


@kernel
def add_dead_forces(dead, change, share, force):
    """Gradient of dead_energy, added to force (n, P, 3)."""
    for i in range(dead.shape[0]):
        for p in range(dead.shape[1]):
            for k in range(3):
                force[i, p, k] -= dead[i, p, k]
    for i in range(change.shape[0]):
        for p in range(change.shape[1]):
            for k in range(3):
                force[i, p, k] -= share * change[i, p, k]
