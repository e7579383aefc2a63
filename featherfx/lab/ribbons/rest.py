"""Rest shapes of ribbons under dead loads: Newton's method on curvature and ruling.

Bounded by |w t'| < 2, beyond which rulings would cross: a step goes at most nine tenths of the way
to that bound. The matrix takes the absolute values of its eigenvalues, so that every step descends;
where the curvature vanishes the ruling has no stiffness, and a floor keeps it from moving. A saddle
is left along its direction of negative curvature, so the shape that is returned is a minimum.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.linalg import eigh

from featherfx.algebra.types import Array
from featherfx.errors import SimulationError
from featherfx.lab.ribbons.curve import (
    LINKS,
    Centreline,
    centreline,
    energy_alone,
    energy_of_loads,
    link_masses,
    series_points,
    work_of_loads,
)
from featherfx.lab.ribbons.energy import Ribbon, closeness, elastic

# scaled energy, gradient and Hessian of unknowns; the energy alone
System = Callable[[Array], tuple[float, Array, Array]]
Energy = Callable[[Array], float]

_ITERATIONS, _ESCAPES, _HALVINGS = 300, 6, 30
# a gradient that ends the search, and an eigenvalue that counts as negative, as shares of D w / L
GRADIENT, _NEGATIVE, _FLOOR = 1e-9, 1e-6, 1e-11
_TO_BOUND = 0.9
# 1, first size of a step off a saddle, in the scaled unknowns
_ESCAPE = 0.05


@dataclass(frozen=True)
class RibbonRest:
    """A ribbon at rest.

    unknowns: (U,) curvature (1/m), then ruling, at the nodes. curve: its centreline. energy: J,
    elastic and of the loads. iterations: of Newton. residual: largest component of the gradient,
    as a share of rigidity times width over length. stability: lowest eigenvalue of the Hessian in
    the same unit, with curvature scaled by the length.
    """

    unknowns: Array
    curve: Centreline
    energy: float
    iterations: int
    residual: float
    stability: float


def settle_ribbon(
    ribbon: Ribbon,
    frame: Array,
    gravity: Array,
    *,
    tip_force: Array | None = None,
    start: Array | None = None,
    leave_saddles: bool = True,
    links: int = LINKS,
) -> RibbonRest:
    """A stable rest shape of a ribbon clamped at the origin.

    frame: (3, 3) columns across, normal, along at the clamp; a positive curvature bends the strip
    against its normal. gravity: (3,) m/s^2. tip_force: (3,) N. start: (U,) unknowns to begin from;
    default: the rest shape. leave_saddles: False to stop at a stationary shape that is not a
    minimum, as a planar one beyond its limit. Raises SimulationError where no minimum is found.
    """
    loads = _Loads(ribbon, frame, np.asarray(gravity, float), tip_force, links)
    size = ribbon.nodes
    scale = np.concatenate([np.full(size, 1.0 / ribbon.length), np.ones(size)])
    unit = ribbon.rigidity * ribbon.width / ribbon.length

    def at(unknowns: Array) -> tuple[float, Array, Array]:
        energy, gradient, matrix = elastic(ribbon, unknowns)
        if np.isfinite(energy):
            work = loads.work(unknowns)
            energy += work[0]
            gradient, matrix = gradient + work[1], matrix + work[2]
        return energy / unit, gradient * scale / unit, matrix * np.outer(scale, scale) / unit

    def energy_at(unknowns: Array) -> float:
        value = elastic(ribbon, unknowns)[0]
        if np.isfinite(value):
            value += loads.energy(unknowns)
        return value / unit

    unknowns = np.array(ribbon.rest if start is None else start, dtype=float)
    iterations = 0
    for _ in range(_ESCAPES):
        unknowns, count = descend(ribbon, unknowns, scale, at, energy_at)
        iterations += count
        energy, gradient, matrix = at(unknowns)
        values, vectors = eigh(matrix, subset_by_index=[0, 0])
        if values[0] > -_NEGATIVE or not leave_saddles:
            break
        unknowns = _leave(ribbon, unknowns, scale * vectors[:, 0], energy, energy_at)
    residual = float(np.abs(gradient).max())
    if residual > 1e3 * GRADIENT * (1.0 + abs(energy)):
        raise SimulationError("ribbon", 0.0, f"no rest shape found, residual {residual:.2g}")
    return RibbonRest(
        unknowns, loads.curve(unknowns), energy * unit, iterations, residual, float(values[0])
    )


class _Loads:
    """Weight and a force at the tip, by links or by power series."""

    def __init__(
        self, ribbon: Ribbon, frame: Array, gravity: Array, tip_force: Array | None, links: int
    ) -> None:
        self._ribbon, self._frame, self._gravity, self._links = ribbon, frame, gravity, links
        self._tip = np.zeros(3) if tip_force is None else np.asarray(tip_force, float)
        self._force = link_masses(ribbon, links)[:, None] * gravity
        self._force[-1] += self._tip

    def work(self, unknowns: Array) -> tuple[float, Array, Array]:
        """Energy, gradient, Hessian."""
        ribbon, frame = self._ribbon, self._frame
        if ribbon.series:
            return energy_of_loads(ribbon, unknowns, frame, self._gravity, self._tip)
        return work_of_loads(ribbon, unknowns, frame, self._force, self._links)

    def energy(self, unknowns: Array) -> float:
        """Energy alone."""
        if self._ribbon.series:
            ribbon, frame = self._ribbon, self._frame
            return energy_alone(ribbon, unknowns, frame, self._gravity, self._tip)
        return -float(np.sum(self._force * self.curve(unknowns).points))

    def curve(self, unknowns: Array) -> Centreline:
        """The centreline."""
        if self._ribbon.series:
            points, frames = series_points(self._ribbon, unknowns, self._frame, LINKS)
            return Centreline(points, frames, np.empty((0, 3)), np.empty((0, 3, 3)))
        return centreline(self._ribbon, unknowns, self._frame, self._links)


def descend(
    ribbon: Ribbon, unknowns: Array, scale: Array, at: System, energy_at: Energy
) -> tuple[Array, int]:
    """Newton steps to a stationary shape; returns it with the number of iterations."""
    energy, gradient, matrix = at(unknowns)
    for count in range(_ITERATIONS):
        if np.abs(gradient).max() < GRADIENT:
            return unknowns, count
        values, vectors = eigh(matrix)
        values = np.maximum(np.abs(values), _FLOOR * np.abs(values).max())
        step = -scale * (vectors @ ((vectors.T @ gradient) / values))
        slope = float(gradient @ (step / scale))
        fraction = _longest(ribbon, unknowns, step)
        for _ in range(_HALVINGS):
            trial = unknowns + fraction * step
            rounding = 1e-13 * (1.0 + abs(energy))
            if energy_at(trial) <= energy + 1e-4 * fraction * slope + rounding:
                break
            fraction *= 0.5
        else:
            return unknowns, count
        unknowns = trial
        energy, gradient, matrix = at(unknowns)
    return unknowns, _ITERATIONS


def _longest(ribbon: Ribbon, unknowns: Array, step: Array) -> float:
    """Share of a step, 1 at most, that stays within the bound on the rulings."""
    if not ribbon.finite_width:
        return 1.0
    now, change = closeness(ribbon, unknowns), closeness(ribbon, step)
    room = np.where(change > 0.0, 1.0 - now, 1.0 + now)
    moving = np.abs(change) > 0.0
    if not moving.any():
        return 1.0
    return float(min(1.0, _TO_BOUND * (room[moving] / np.abs(change[moving])).min()))


def _leave(
    ribbon: Ribbon, unknowns: Array, direction: Array, energy: float, energy_at: Energy
) -> Array:
    """A shape of less energy than the saddle, along its direction of negative curvature."""
    size = _ESCAPE
    for _ in range(_HALVINGS):
        step = size * direction
        trial = unknowns + _longest(ribbon, unknowns, step) * step
        if energy_at(trial) < energy:
            return trial
        size *= 0.5
    return unknowns
