"""Contact of nodes with planes that move: pressure by a multiplier, Coulomb friction.

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

from featherfx.algebra.vector_kernels import accumulate, dot, length, scale, sub
from featherfx.jit.compiled import kernel

# columns of a contact's strength
CONTACT_STIFFNESS, CONTACT_FORCE, _FRICTION, _SMOOTHING = 0, 1, 2, 3


@kernel
def _gap(contacts, c, point, fraction):
    """Gap (m) of a point at a fraction (0..1) of the interval."""
    offset = contacts.offset[c]
    level = offset[0] + fraction * (offset[1] - offset[0])
    return dot(contacts.normal[c], point) - level


@kernel
def _slip(contacts, c, point, fraction):
    """Slip vector (m) of a point within its plane."""
    normal, target = contacts.normal[c], contacts.target[c]
    u = sub(sub(point, target[0]), scale(fraction, sub(target[1], target[0])))
    return sub(u, scale(dot(normal, u), normal))


@kernel
def press(contacts, c, fraction, points):
    """L - r g of a contact (N), which presses where it is positive. points: (n, 1 + 2 m, 3)."""
    point, strength = points[contacts.node[c, 0], contacts.node[c, 1]], contacts.strength[c]
    return strength[CONTACT_FORCE] - strength[CONTACT_STIFFNESS] * _gap(
        contacts, c, point, fraction
    )


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
def contact_energy(contacts, f, fraction, points):
    """Energy of feather f's contacts (J). points: nodes, (n, 1 + 2 m, 3)."""
    total = 0.0
    for c in range(contacts.first[f], contacts.first[f + 1]):
        point, strength = points[contacts.node[c, 0], contacts.node[c, 1]], contacts.strength[c]
        push = press(contacts, c, fraction, points)
        if push > 0.0:
            total += 0.5 * push * push / strength[CONTACT_STIFFNESS]
        if strength[_FRICTION] > 0.0:
            slip = length(_slip(contacts, c, point, fraction))
            value, _, _, _ = friction_potential(slip, strength[_SMOOTHING])
            total += strength[_FRICTION] * value
    return total


@kernel
def _friction(contacts, c, fraction, point):
    """Slip u of a contact, and friction's b f' / |u| and b f'': its force over u and its stiffness
    along u; (0, 0, 0) and 0 where there is none."""
    bound, u = contacts.strength[c, _FRICTION], (0.0, 0.0, 0.0)
    if bound == 0.0:
        return u, 0.0, 0.0
    u = _slip(contacts, c, point, fraction)
    _, _, ratio, second = friction_potential(length(u), contacts.strength[c, _SMOOTHING])
    return u, bound * ratio, bound * second


@kernel
def add_contact_forces(contacts, f, fraction, points, force):
    """Gradient of contact_energy, added to force (n, 1 + 2 m, 3)."""
    for c in range(contacts.first[f], contacts.first[f + 1]):
        row, p = contacts.node[c, 0], contacts.node[c, 1]
        push = press(contacts, c, fraction, points)
        if push > 0.0:
            accumulate(force[row, p], -push, contacts.normal[c])
        u, ratio, _ = _friction(contacts, c, fraction, points[row, p])
        if ratio > 0.0:
            accumulate(force[row, p], ratio, u)


@kernel
def add_contact_stiffness(contacts, c, presses, fraction, points, stiff):
    """Hessian of one contact's energy, as if it pressed or not, added to stiff (n, 1 + 2 m, 6)."""
    row, p, n = contacts.node[c, 0], contacts.node[c, 1], contacts.normal[c]
    u, ratio, second = _friction(contacts, c, fraction, points[row, p])
    square, along_slip = dot(u, u), 0.0
    if square > 0.0:
        along_slip = (second - ratio) / square
    along_normal = (contacts.strength[c, CONTACT_STIFFNESS] if presses else 0.0) - ratio
    out = stiff[row, p]
    for k in range(3):
        out[k] += ratio + along_normal * n[k] * n[k] + along_slip * u[k] * u[k]
    out[3] += along_normal * n[0] * n[1] + along_slip * u[0] * u[1]
    out[4] += along_normal * n[0] * n[2] + along_slip * u[0] * u[2]
    out[5] += along_normal * n[1] * n[2] + along_slip * u[1] * u[2]
