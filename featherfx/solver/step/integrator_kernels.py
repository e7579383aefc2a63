"""Time integration of material points: generalised-alpha, and implicit Euler as the fallback.

    (1 - am) a+ + am a = (1 - af) w+ + af w                 a smoothed, w true acceleration
    x+ = x + h v + h^2 ((1/2 - b) a + b a+)
    v+ = v + h ((1 - g) a + g a+)
    am = (2 r - 1)/(r + 1),  af = r/(r + 1),  g = 1/2 + af - am,  b = (g + 1/2)^2 / 4

r in [0, 1] is the spectral radius at infinite frequency: 1 conserves energy, 0 kills what the step
does not resolve at once. The equation of motion holds at the end of the step, projected on the
constraint manifold there, so the method is second order for inextensible barbs as well.
Source: Chung and Hulbert 1993 in the form of Arnold and Brüls 2007. Solved for x+:

    w+ = inertia (x+ - target),      v+ = rate (x+ - past)
"""

from math import sqrt

from featherfx.jit.compiled import kernel

EULER = -1.0


@kernel
def integrator_coefficients(radius, h):
    """(inertia, rate, am, af, b, g); radius EULER gives implicit Euler."""
    if radius == EULER:
        return 1.0 / (h * h), 1.0 / h, 0.0, 0.0, 1.0, 1.0
    am = (2.0 * radius - 1.0) / (radius + 1.0)
    af = radius / (radius + 1.0)
    g = 0.5 + af - am
    b = 0.25 * (g + 0.5) ** 2
    return (1.0 - am) / ((1.0 - af) * b * h * h), g / (b * h), am, af, b, g


@kernel
def begin_step(radius, h, points, velocity, acceleration, smoothed, target, past):
    """Write target and past (n, P, 3) from the state at the step's start."""
    _, _, am, af, b, g = integrator_coefficients(radius, h)
    for i in range(points.shape[0]):
        for p in range(points.shape[1]):
            for k in range(3):
                x, v = points[i, p, k], velocity[i, p, k]
                w, a = acceleration[i, p, k], smoothed[i, p, k]
                if radius == EULER:
                    target[i, p, k] = x + h * v
                    past[i, p, k] = x
                    continue
                free = x + h * v + h * h * (0.5 - b) * a
                target[i, p, k] = free - (am * a - af * w) * b * h * h / (1.0 - am)
                past[i, p, k] = free - (b * h / g) * (v + h * (1.0 - g) * a)


@kernel
def _true_and_smoothed(radius, factors, new, target, acceleration, smoothed):
    """True and smoothed acceleration (one component) at the end of a step."""
    inertia, _, am, af, _, _ = factors
    true = inertia * (new - target)
    if radius == EULER:
        return true, true
    return true, ((1.0 - af) * true + af * acceleration - am * smoothed) / (1.0 - am)


@kernel
def step_error(radius, h, new, acceleration, smoothed, target):
    """Local error of a step's displacement, m: |b - 1/6| h^2 |change of smoothed acceleration|.

    new: (n, P, 3) positions at the end; the largest over the points (directors left out).
    """
    factors = integrator_coefficients(radius, h)
    worst = 0.0
    for i in range(new.shape[0]):
        for p in range(new.shape[1]):
            if p == 1 or p == 2:
                continue
            square = 0.0
            for k in range(3):
                _, a = _true_and_smoothed(
                    radius,
                    factors,
                    new[i, p, k],
                    target[i, p, k],
                    acceleration[i, p, k],
                    smoothed[i, p, k],
                )
                square += (a - smoothed[i, p, k]) ** 2
            worst = max(worst, square)
    return abs(factors[4] - 1.0 / 6.0) * h * h * sqrt(worst)


@kernel
def end_step(radius, h, new, velocity, acceleration, smoothed, target, past):
    """Rates at the end of a step to positions new (n, P, 3), in place."""
    factors = integrator_coefficients(radius, h)
    rate = factors[1]
    for i in range(new.shape[0]):
        for p in range(new.shape[1]):
            for k in range(3):
                w, a = _true_and_smoothed(
                    radius,
                    factors,
                    new[i, p, k],
                    target[i, p, k],
                    acceleration[i, p, k],
                    smoothed[i, p, k],
                )
                velocity[i, p, k] = rate * (new[i, p, k] - past[i, p, k])
                acceleration[i, p, k] = w
                smoothed[i, p, k] = a
