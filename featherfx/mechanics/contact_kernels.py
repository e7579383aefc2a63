"""Contact of material points with planes that move: pressure by a multiplier, Coulomb friction.

    W = <L - r g>^2 / (2 r) + b f(|u|),     g = n.x - d,     u = (1 - n n^T)(x - q)

<.> positive part. g gap to the plane of unit normal n and offset d; L (N) force of the iteration
before and r (N/m) stiffness, so that the pressing force is <L - r g>: where it converges, g = 0
under the force L, whatever r is. u slip from where the point would be had it gone along with the
other body, b (N) friction coefficient times the force of the iteration before, and

    f(s) = s^2 / e - s^3 / (3 e^2),  s < e;     s - e / 3,  s >= e

a friction force b that sets in smoothly over a slip of e (m). W is convex.
Sources: augmented Lagrangian of Powell and Hestenes 1969; lagged smoothed friction of Li et al.
2020 (Incremental Potential Contact, section 5). d and q move linearly within the interval.
"""

from math import sqrt

from featherfx.jit.compiled import kernel

# columns of a contact's strength
STIFFNESS, FORCE, FRICTION, SMOOTHING = 0, 1, 2, 3


@kernel
def _gap(point, normal, offset, share):
    """Gap (m) of a point at a share (0..1) of the interval."""
    level = offset[0] + share * (offset[1] - offset[0])
    return normal[0] * point[0] + normal[1] * point[1] + normal[2] * point[2] - level


@kernel
def _slip(point, normal, target, share):
    """Slip vector (m) of a point within its plane, and its length."""
    x = point[0] - target[0, 0] - share * (target[1, 0] - target[0, 0])
    y = point[1] - target[0, 1] - share * (target[1, 1] - target[0, 1])
    z = point[2] - target[0, 2] - share * (target[1, 2] - target[0, 2])
    along = normal[0] * x + normal[1] * y + normal[2] * z
    x, y, z = x - along * normal[0], y - along * normal[1], z - along * normal[2]
    return x, y, z, sqrt(x * x + y * y + z * z)


@kernel
def friction_potential(slip, smoothing):
    """f, f', f' / s and f'' at a slip s (m)."""
    if slip >= smoothing:
        return slip - smoothing / 3.0, 1.0, 1.0 / slip, 0.0
    r = slip / smoothing
    return (
        slip * r * (1.0 - r / 3.0),
        r * (2.0 - r),
        (2.0 - r) / smoothing,
        2.0 * (1.0 - r) / smoothing,
    )


@kernel
def contact_energy(contacts, f, share, points):
    """Energy of feather f's contacts (J). points: (n, P, 3)."""
    total = 0.0
    for c in range(contacts.first[f], contacts.first[f + 1]):
        point = points[contacts.node[c, 0], contacts.node[c, 1]]
        normal, strength = contacts.normal[c], contacts.strength[c]
        stiffness = strength[STIFFNESS]
        push = strength[FORCE] - stiffness * _gap(point, normal, contacts.offset[c], share)
        if push > 0.0:
            total += 0.5 * push * push / stiffness
        if strength[FRICTION] > 0.0:
            _, _, _, slip = _slip(point, normal, contacts.target[c], share)
            value, _, _, _ = friction_potential(slip, strength[SMOOTHING])
            total += strength[FRICTION] * value
    return total


@kernel
def add_contact_forces(contacts, f, share, points, force, stiff):
    """Gradient and Hessian of contact_energy, added to force (n, P, 3) and stiff (n, P, 6)."""
    for c in range(contacts.first[f], contacts.first[f + 1]):
        row, p = contacts.node[c, 0], contacts.node[c, 1]
        point, normal, strength = points[row, p], contacts.normal[c], contacts.strength[c]
        nx, ny, nz = normal[0], normal[1], normal[2]
        push = strength[FORCE] - strength[STIFFNESS] * _gap(
            point, normal, contacts.offset[c], share
        )
        isotropic, along_normal, along_slip = 0.0, 0.0, 0.0
        ux, uy, uz = 0.0, 0.0, 0.0
        if push > 0.0:
            force[row, p, 0] -= push * nx
            force[row, p, 1] -= push * ny
            force[row, p, 2] -= push * nz
            along_normal = strength[STIFFNESS]
        bound = strength[FRICTION]
        if bound > 0.0:
            ux, uy, uz, slip = _slip(point, normal, contacts.target[c], share)
            _, _, ratio, second = friction_potential(slip, strength[SMOOTHING])
            isotropic = bound * ratio
            force[row, p, 0] += isotropic * ux
            force[row, p, 1] += isotropic * uy
            force[row, p, 2] += isotropic * uz
            along_normal -= isotropic
            if slip > 0.0:
                along_slip = bound * (second - ratio) / (slip * slip)
        out = stiff[row, p]
        out[0] += isotropic + along_normal * nx * nx + along_slip * ux * ux
        out[1] += isotropic + along_normal * ny * ny + along_slip * uy * uy
        out[2] += isotropic + along_normal * nz * nz + along_slip * uz * uz
        out[3] += along_normal * nx * ny + along_slip * ux * uy
        out[4] += along_normal * nx * nz + along_slip * ux * uz
        out[5] += along_normal * ny * nz + along_slip * uy * uz
