"""Is a gradient the derivative of its function? Central differences over a range of steps."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from featherfx.algebra.types import Array

STEPS = 10.0 ** np.arange(-1.0, -5.1, -0.5)
EPSILON = np.finfo(float).eps


def sweep(
    value: Callable[[Array], float], gradient: Array, directions: Array, noise: float = 0.0
) -> tuple[Array, Array]:
    """Root mean square over directions (k, N) of the errors of central differences, (steps,), and
    of what round-off may explain of them, (steps,).

    noise: absolute round-off of a value beyond a few units in its last place.
    """
    errors = np.zeros((len(STEPS), len(directions)))
    floors = np.zeros_like(errors)
    for k, direction in enumerate(directions):
        slope = float(gradient @ direction)
        for s, step in enumerate(STEPS):
            ahead, behind = value(step * direction), value(-step * direction)
            errors[s, k] = (ahead - behind) / (2.0 * step) - slope
            roundoff = 8.0 * EPSILON * (abs(ahead) + abs(behind)) + noise
            floors[s, k] = roundoff / (2.0 * step) + 8.0 * EPSILON * abs(slope)
    return np.sqrt(np.mean(errors**2, axis=1)), np.sqrt(np.mean(floors**2, axis=1))


def derivative_fault(
    value: Callable[[Array], float],
    gradient: Array,
    rng: np.random.Generator,
    scale: float | Array = 1.0,
    directions: int = 6,
    curved: bool = True,
    noise: float = 0.0,
) -> str:
    """What is wrong with a gradient (N,) of value(increment (N,)) at zero; empty if nothing.

    The error along random directions must fall with the square of the step until round-off hides
    it, and end small. scale: size of the increments (the largest step is a tenth of it), one or
    (N,). curved: whether there must be a range in which the order can be seen.
    """
    chosen = scale * rng.normal(size=(directions, len(gradient)))
    errors, floors = sweep(value, gradient, chosen, noise)
    slope = float(np.linalg.norm(gradient * scale))
    if not errors.min() <= max(1e-7 * slope, 4.0 * floors.min()):
        return f"smallest error {errors.min():.1e} of a slope of {slope:.1e}"
    clear = errors > 30.0 * floors
    last = len(STEPS) if clear.all() else int(np.argmin(clear))
    if last < 3:
        return "round-off hides the order" if curved else ""
    orders = np.log(errors[: last - 1] / errors[1:last]) / np.log(STEPS[0] / STEPS[1])
    return "" if 1.8 < orders[-1] < 2.2 else f"orders {np.round(orders, 2)}"


def with_a_wrong_sign(gradient: Array, place: int) -> Array:
    """A copy of a gradient with the sign of one entry turned."""
    wrong = gradient.copy()
    wrong[place] = -wrong[place]
    return wrong


def unnoticed_signs(check: Callable[[Array], str], gradient: Array) -> list[int]:
    """Places where a turned sign goes unnoticed; entries below 1e-4 of the largest are left out."""
    places = np.flatnonzero(np.abs(gradient) > 1e-4 * np.abs(gradient).max())
    return [int(p) for p in places if not check(with_a_wrong_sign(gradient, p))]
