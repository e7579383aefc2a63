"""A vane that unhooks: slip and release of the gaps between barbs, triangle by triangle.

    W = 1/2 sum k (x - p)^2 + D(p - p_0),     x = (e_ww, 2 e_vw),   k = b A (E_ww, E_vw)
    f = sqrt((<s_w> / y_w)^2 + (s_v / y_v)^2) <= level,     s = k (x - p)
    dp = mu (<s_w> / y_w^2, s_v / y_v^2),   D = level l + 1/2 c l^2,   l = mu f

x the strains of featherfx/mechanics/vane_membrane_kernels.py, p the slip of hooklets along their
barbules, p_0 that of the step's start, s stress, y yield stress times b A, <s> the positive part:
barbs that are pressed together touch and do not slip. l is the work of slip at level 1; the level
grows with it by c until the strength, while all gaps of a triangle share the slip. W is the least
over p, convex and with a continuous slope, so that slip is one more energy to Newton; its curvature
is the consistent tangent. Source of the form: Ortiz and Stainier 1999 (incremental potential) for
the associated flow that the issue of hysteresis in Jouve 2024, section 3.2 and figure 3.9, asks
for: after a cycle the force at no displacement is negative.

At the strength one gap of the triangle gives way. Over its opening d the level falls in
proportion, to nothing at the release opening R; what is spent per length of barb, 1/2 b S R (S the
strength), therefore does not depend on the height h of the triangle, for how many gaps ever it
stands. A triangle with h > E_ww R / S holds more than that: it opens at once, and the rest is
released to motion. An open triangle resists only the touch of its barbs,

    W = 1/2 k_w min(e_ww, 0)^2
"""

from math import sqrt

from featherfx.jit.compiled import kernel

# Newton iterations of the return mapping; it converges from one side
ITERATIONS = 12
ENOUGH = 1e-12


@kernel
def _yield_measure(stress, limit):
    """f of stresses (s_w, s_v); limit: (y_w, y_v)."""
    across = max(stress[0], 0.0) / limit[0]
    shear = stress[1] / limit[1]
    return sqrt(across * across + shear * shear)


@kernel
def _relaxed(trial, rates, mu):
    """Stresses after a flow mu; trial: before, rates: k / y^2 of those that yield, else 0."""
    return trial[0] / (1.0 + mu * rates[0]), trial[1] / (1.0 + mu * rates[1])


@kernel
def _flow(trial, limit, rates, level, growth):
    """(mu, slope): flow that brings the trial stresses onto the yield surface, and the slope there
    of f (1 - growth mu) by mu. growth: c."""
    mu, slope = 0.0, -1.0
    for _ in range(ITERATIONS):
        stress = _relaxed(trial, rates, mu)
        across, shear = max(stress[0], 0.0) / limit[0], stress[1] / limit[1]
        f = sqrt(across * across + shear * shear)
        fall = across * across * rates[0] / (1.0 + mu * rates[0])
        fall += shear * shear * rates[1] / (1.0 + mu * rates[1])
        slope = -fall / f * (1.0 - growth * mu) - growth * f
        excess = f * (1.0 - growth * mu) - level
        if excess <= ENOUGH * level:
            break
        mu -= excess / slope
    return mu, slope


@kernel
def _trial(stiffness, strains, slip, limit):
    """Stresses (s_w, s_v) without flow, and k / y^2 of those that may yield."""
    trial = stiffness[0] * (strains[0] - slip[0]), stiffness[1] * (strains[1] - slip[1])
    across = stiffness[0] / (limit[0] * limit[0]) if trial[0] > 0.0 else 0.0
    return trial, (across, stiffness[1] / (limit[1] * limit[1]))


@kernel
def hooked_energy(stiffness, strains, slip, limit, level, growth):
    """W of one hooked triangle (J), with what its slip of this step costs.

    stiffness: (k_w, k_v) J. strains: (e_ww, 2 e_vw). slip: p_0. limit: (y_w, y_v) J. level: at the
    step's start, > 0. growth: c, 1/J.
    """
    trial, rates = _trial(stiffness, strains, slip, limit)
    if _yield_measure(trial, limit) <= level:
        return 0.5 * (trial[0] ** 2 / stiffness[0] + trial[1] ** 2 / stiffness[1])
    mu, _ = _flow(trial, limit, rates, level, growth)
    stress = _relaxed(trial, rates, mu)
    work = mu * _yield_measure(stress, limit)
    stored = 0.5 * (stress[0] ** 2 / stiffness[0] + stress[1] ** 2 / stiffness[1])
    return stored + level * work + 0.5 * growth * work * work


@kernel
def hooked_response(stiffness, strains, slip, limit, level, growth):
    """((s_w, s_v), (C_ww, C_wv, C_vv)): stresses and consistent tangent (J); as hooked_energy."""
    trial, rates = _trial(stiffness, strains, slip, limit)
    if _yield_measure(trial, limit) <= level:
        return trial, (stiffness[0], 0.0, stiffness[1])
    mu, slope = _flow(trial, limit, rates, level, growth)
    stress = _relaxed(trial, rates, mu)
    f = _yield_measure(stress, limit)
    across = stress[0] * rates[0] / (1.0 + mu * rates[0])
    shear = stress[1] * rates[1] / (1.0 + mu * rates[1])
    fall = (1.0 - growth * mu) / (f * slope)
    tangent = (
        stiffness[0] / (1.0 + mu * rates[0]) + fall * across * across,
        fall * across * shear,
        stiffness[1] / (1.0 + mu * rates[1]) + fall * shear * shear,
    )
    return stress, tangent


@kernel
def slip_after(stiffness, strains, slip, limit, level, growth):
    """((p_w, p_v), l): slip and its work at level 1 (J) where a step ends; as hooked_energy."""
    trial, rates = _trial(stiffness, strains, slip, limit)
    if _yield_measure(trial, limit) <= level:
        return slip, 0.0
    mu, _ = _flow(trial, limit, rates, level, growth)
    stress = _relaxed(trial, rates, mu)
    moved = (
        slip[0] + mu * max(stress[0], 0.0) / (limit[0] * limit[0]),
        slip[1] + mu * stress[1] / (limit[1] * limit[1]),
    )
    return moved, mu * _yield_measure(stress, limit)


@kernel
def open_response(stiffness, strains):
    """(W, s_w, C_ww) of an open triangle: its barbs may touch."""
    closed = min(strains[0], 0.0)
    curvature = stiffness[0] if strains[0] < 0.0 else 0.0
    return 0.5 * stiffness[0] * closed * closed, stiffness[0] * closed, curvature
