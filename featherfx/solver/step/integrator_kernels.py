"""Time integration of nodes and directors: generalised-alpha, and implicit Euler as the fallback.

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
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from featherfx.jit.compiled import kernel

EULER = -1.0


class Integrator(NamedTuple):
    """inertia (1/s^2), rate (1/s) and am, af, b, g of a step."""

    inertia: float
    rate: float
    am: float
    af: float
    b: float
    g: float


# places in RowPoints
NODE_POINTS, DIRECTOR_POINTS = 0, 1


class PointMotion(NamedTuple):
    """Nodes or directors (n, ., 3) of one feather and their rates, as in State."""

    points: NDArray[np.float64]
    velocity: NDArray[np.float64]
    acceleration: NDArray[np.float64]
    smoothed: NDArray[np.float64]


@kernel
def motion_of(state, f, part):
    """The Motion of feather f's NODE_POINTS or DIRECTOR_POINTS."""
    return PointMotion(
        state.points[part][f],
        state.velocity[part][f],
        state.acceleration[part][f],
        state.smoothed[part][f],
    )


@kernel
def integrator_of(spectral_radius, h):
    """The Integrator of a step of h (s); spectral radius EULER gives implicit Euler."""
    if spectral_radius == EULER:
        return Integrator(1.0 / (h * h), 1.0 / h, 0.0, 0.0, 1.0, 1.0)
    r = spectral_radius
    am = (2.0 * r - 1.0) / (r + 1.0)
    af = r / (r + 1.0)
    g = 0.5 + af - am
    b = 0.25 * (g + 0.5) ** 2
    return Integrator((1.0 - am) / ((1.0 - af) * b * h * h), g / (b * h), am, af, b, g)


@kernel
def begin_step(spectral_radius, h, motion, target, past):
    """Write target and past from the motion at the step's start."""
    _, _, am, af, b, g = integrator_of(spectral_radius, h)
    for i in range(target.shape[0]):
        for p in range(target.shape[1]):
            for k in range(3):
                x, v = motion.points[i, p, k], motion.velocity[i, p, k]
                w, a = motion.acceleration[i, p, k], motion.smoothed[i, p, k]
                if spectral_radius == EULER:
                    target[i, p, k] = x + h * v
                    past[i, p, k] = x
                    continue
                free = x + h * v + h * h * (0.5 - b) * a
                target[i, p, k] = free - (am * a - af * w) * b * h * h / (1.0 - am)
                past[i, p, k] = free - (b * h / g) * (v + h * (1.0 - g) * a)


@kernel
def begin_points(spectral_radius, h, state, f, around):
    """Target and past of the surroundings of feather f at the step's start."""
    for part in range(2):
        motion = motion_of(state, f, part)
        begin_step(spectral_radius, h, motion, around.target[part], around.past[part])


@kernel
def _true_and_smoothed(spectral_radius, method, new, target, acceleration, smoothed):
    """True and smoothed acceleration (one component) at the end of a step."""
    true = method.inertia * (new - target)
    if spectral_radius == EULER:
        return true, true
    return true, ((1.0 - method.af) * true + method.af * acceleration - method.am * smoothed) / (
        1.0 - method.am
    )


@kernel
def step_error(spectral_radius, h, motion, new, target):
    """Local error of a step's displacement, m: |b - 1/6| h^2 |change of smoothed acceleration|.

    motion: of the nodes at the start, new: their positions at the end; the largest of all.
    """
    method = integrator_of(spectral_radius, h)
    worst = 0.0
    for i in range(new.shape[0]):
        for p in range(new.shape[1]):
            square = 0.0
            for k in range(3):
                before = motion.smoothed[i, p, k]
                _, a = _true_and_smoothed(
                    spectral_radius,
                    method,
                    new[i, p, k],
                    target[i, p, k],
                    motion.acceleration[i, p, k],
                    before,
                )
                square += (a - before) ** 2
            worst = max(worst, square)
    return abs(method.b - 1.0 / 6.0) * h * h * sqrt(worst)


@kernel
def end_step(spectral_radius, h, motion, new, target, past):
    """Rates at the end of a step to the values new, written to the motion."""
    method = integrator_of(spectral_radius, h)
    for i in range(new.shape[0]):
        for p in range(new.shape[1]):
            for k in range(3):
                w, a = _true_and_smoothed(
                    spectral_radius,
                    method,
                    new[i, p, k],
                    target[i, p, k],
                    motion.acceleration[i, p, k],
                    motion.smoothed[i, p, k],
                )
                motion.velocity[i, p, k] = method.rate * (new[i, p, k] - past[i, p, k])
                motion.acceleration[i, p, k] = w
                motion.smoothed[i, p, k] = a


@kernel
def end_points(spectral_radius, h, state, f, new, around):
    """Rates of feather f at the end of a step to points new, written to the state."""
    target, past = around.target, around.past
    for part in range(2):
        motion = motion_of(state, f, part)
        end_step(spectral_radius, h, motion, new[part], target[part], past[part])
