"""Yield and slip of hooks from cycles of a transverse sample, and how well these tell them.

Barbs across the pull stay straight, so the sample deforms evenly and its stress is that of one
triangle (featherfx/mechanics/vane_hook_kernels.py) that goes through the measured strains in their
order. Least squares in the logarithms of the modulus across the barbs, the yield stress and the
slip on the way to the strength; intervals and what counts as identified are those of calibrate.py.
The strength is the preset's: samples that slip do not show it. Shear is not loaded: its yield
cannot be identified.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from itertools import product
from typing import Any, NamedTuple

import numpy as np
from scipy.optimize import least_squares

from featherfx.algebra.types import Array
from featherfx.errors import InputError, Problem, require
from featherfx.groom.types import FeatherKind
from featherfx.lab.vane.calibrate import (
    IDENTIFIED,
    MeasuredCurve,
    half_intervals,
    identified_fractions,
)
from featherfx.mechanics.vane_hook_kernels import hooked_response, slip_after

_NAMES = ("across", "hook_yield_across", "hook_slip")
_MISSING = {
    "across": "points at small strain",
    "hook_yield_across": "a cycle that goes beyond the yield stress and back",
    "hook_slip": "a cycle that goes well beyond the yield stress",
}
# first guesses: yield as a share of the greatest stress, slip strain up to the strength
_YIELDS, _SLIPS = (0.2, 0.5, 0.8), (0.01, 0.05, 0.2)
# parts of the way between two points
_PARTS = 4


class Hook(NamedTuple):
    """across, yield stress, strength: Pa. slip: strain up to the strength."""

    across: float
    limit: float
    slip: float
    strength: float


@dataclass(frozen=True)
class Fitted:
    """A value (SI units), its 95 % interval, None with no more points than values, and the share
    of the stress that is left of its effect."""

    value: float
    low: float | None
    high: float | None
    identified: float


@dataclass(frozen=True)
class Hysteresis:
    """across, hook_yield_across: Pa. hook_slip: m. residual: root mean square, as a share of the
    stress. curves, points: how many."""

    across: Fitted
    hook_yield_across: Fitted
    hook_slip: Fitted
    residual: float
    curves: int
    points: int

    def as_json(self) -> dict[str, Any]:
        """Plain values by key; the yield in shear is never identified."""
        return asdict(self) | {"hook_yield_shear": None}


def cyclic_stress(strain: Array, hook: Hook) -> Array:
    """(n,) Pa, second Piola-Kirchhoff stress across at Green-Lagrange strains (n,), in their
    order, from rest."""
    stiffness, limit = (hook.across, hook.across), (hook.limit, hook.limit)
    most = hook.strength / hook.limit
    growth = max(most - 1.0, 0.0) / (hook.limit * hook.slip)
    slip, level, last, found = (0.0, 0.0), 1.0, 0.0, []
    for end in strain.tolist():
        for across in np.linspace(last, end, _PARTS + 1)[1:].tolist():
            now = (across, 0.0)
            stress, _ = hooked_response(stiffness, now, slip, limit, level, growth)
            slip, work = slip_after(stiffness, now, slip, limit, level, growth)
            level = min(level + growth * work, most)
        last = end
        found.append(stress[0])
    return np.array(found)


def fit_cycles(curves: Sequence[MeasuredCurve], kind: FeatherKind, source: str = "") -> Hysteresis:
    """Modulus, yield and slip that fit curves (points in the order of the test) best.

    kind: whose strength and distance of barbs hold. Raises InputError for curves that cannot
    determine them.
    """
    _require_cycles(curves, source)
    strength = kind.vane_material.hook_strength
    scale = [float(np.sqrt(np.mean(curve.stress**2))) for curve in curves]
    data = np.concatenate([c.stress / s for c, s in zip(curves, scale, strict=True)])

    def missed(logarithms: Array) -> Array:
        across, limit, slip = np.exp(logarithms).tolist()
        hook = Hook(across, min(limit, strength), slip, strength)
        parts = [cyclic_stress(c.strain, hook) / s for c, s in zip(curves, scale, strict=True)]
        return np.asarray(np.concatenate(parts) - data)

    guesses = _guesses(curves)
    best = min(guesses, key=lambda guess: float(np.sum(missed(guess) ** 2)))
    found = least_squares(missed, best, x_scale="jac", diff_step=1e-4, max_nfev=60)
    fractions = identified_fractions(found.jac)
    weak = [name for name, fraction in zip(_NAMES, fractions, strict=True) if fraction < IDENTIFIED]
    if weak:
        message = "the curves do not determine it. Missing is {}"
        raise InputError(*(Problem(source, n, message.format(_MISSING[n])) for n in weak))
    half = half_intervals(found.jac, found.fun)
    unit = np.array([1.0, 1.0, kind.barb_spacing])
    fitted = {}
    for k, name in enumerate(_NAMES):
        middle, most = float(found.x[k]), None if half is None else float(half[k])
        low, high = (
            None if most is None else float(np.exp(middle + sign * most) * unit[k])
            for sign in (-1.0, 1.0)
        )
        fitted[name] = Fitted(float(np.exp(middle) * unit[k]), low, high, fractions[k])
    residual = float(np.sqrt(np.mean(found.fun**2)))
    return Hysteresis(**fitted, residual=residual, curves=len(curves), points=len(data))


def _require_cycles(curves: Sequence[MeasuredCurve], source: str) -> None:
    problems = []
    for number, curve in enumerate(curves):
        at = f"curve {number + 1}"
        if curve.sample.angle != 0.0:
            message = (
                f"barbs at {curve.sample.angle:g} degrees: such a sample deforms unevenly, and the "
                "yield in shear cannot be identified from it. Give transverse samples, angle 0"
            )
            problems.append(Problem(source, at, message))
        elif not np.any(np.diff(curve.strain) < 0.0):
            problems.append(Problem(source, at, "is never unloaded. A cycle goes up and back"))
    require(*problems)


def _guesses(curves: Sequence[MeasuredCurve]) -> list[Array]:
    first = curves[0]
    up = int(np.argmax(np.diff(first.strain) < 0.0)) + 1
    early = first.strain[:up] <= 0.3 * first.strain[:up].max()
    strain, stress = first.strain[:up][early], first.stress[:up][early]
    across = abs(float(strain @ stress)) / max(float(strain @ strain), 1e-12)
    most = max(float(curve.stress.max()) for curve in curves)
    return [np.log([across, fraction * most, slip]) for fraction, slip in product(_YIELDS, _SLIPS)]
