"""Ribbons at rest under dead loads, and in motion.

Rest shapes are found by Newton's method on curvature and ruling.

Bounded by |w t'| < 2, beyond which rulings would cross: a step goes at most nine tenths of the way
to that bound. The matrix takes the absolute values of its eigenvalues, so that every step descends;
where the curvature vanishes the ruling has no stiffness, and a floor keeps it from moving. A saddle
is left along its direction of negative curvature, so the shape that is returned is a minimum.

Motion adds inertia and drag, with one end clamped or both. Mass is lumped at the points of the
centreline, whose places follow from curvature and ruling. A step minimises

    E + sum of 1/2 a m |x - x_t|^2 - m g.x + 1/2 rho C S |u.n|^3 / (3 c),    u = c (x - x_v) - wind

E the ribbon's energy; a, x_t and c, x_v of the time integrator, drag as on vanes
(solver/step/integrator_kernels.py, mechanics/node_kernels.py); n the strip's normal where the step
begins, S the area that a point stands for. The strip's rotary inertia about its centreline is left
out: it is w^2 / 12 of the mass, against the square of what a point moves.

The far clamp holds the last point and two more that are fixed to the last link, one along its
normal and one along the strip, by springs; their forces are carried on until the springs are slack
(augmented Lagrangian: Powell and Hestenes 1969), so that the clamp is as exact as wished.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from scipy.linalg import eigh

from featherfx.algebra.types import Array
from featherfx.algebra.vectors import dots
from featherfx.errors import SimulationError, require
from featherfx.lab.declare import NOT_NEGATIVE, POSITIVE, Range, out_of_range, value
from featherfx.lab.ribbons.curve import (
    LINKS,
    Centreline,
    angle_slopes,
    centreline,
    energy_alone,
    energy_of_loads,
    link_masses,
    series_points,
    slopes_of_loads,
    slopes_of_points,
    work_of_loads,
)
from featherfx.lab.ribbons.energy import Ribbon, closeness, elastic
from featherfx.solver.step.integrator_kernels import (
    EULER,
    PointMotion,
    begin_step,
    end_step,
    integrator_of,
)

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


# a clamp's springs over D w / L^3, lever of its turns over the length, misfit over the length that
# is small enough, and how often its forces are carried on
_SPRING, _LEVER, _SLACK, _ROUNDS = 1e5, 0.05, 1e-8, 20
# residual of a step over that of a rest shape
_LOOSER = 1e4


class FarClamp(NamedTuple):
    """Pose at which the ribbon's end is held. point: (3,) m. frame: (3, 3) columns across, normal,
    along."""

    point: Array
    frame: Array


@dataclass(frozen=True)
class Air:
    """wind: (3,) m/s, evenly."""

    wind: tuple[float, float, float] = (0.0, 0.0, 0.0)
    density: float = value("kg/m^3.", 1.2, NOT_NEGATIVE)
    drag: float = value("Force coefficient across the strip.", 1.2, NOT_NEGATIVE)


@dataclass(frozen=True)
class FixedSteps:
    """Steps of one length."""

    step: float = value("s.", allowed=POSITIVE)
    radius: float = value("Spectral radius of the integrator.", 0.8, Range(0.0, 0.9))


@dataclass(frozen=True)
class RibbonState:
    """time: s. unknowns: (U,) as of RibbonRest. pull: (3, 3) N, of the far clamp on its points.
    motion: of the N + 3 points, (N + 3, 1, 3) each."""

    time: float
    unknowns: Array
    pull: Array
    motion: PointMotion


class RibbonMotion:
    """One ribbon, clamped at the origin, and at its end if that is held."""

    def __init__(
        self, ribbon: Ribbon, frame: Array, gravity: Array, far: FarClamp | None = None
    ) -> None:
        """frame: (3, 3) columns across, normal, along at the clamp. gravity: (3,) m/s^2."""
        self.ribbon, self.frame, self.far = ribbon, frame, far
        mass = link_masses(ribbon, LINKS)
        self._mass = np.concatenate([mass, np.zeros(2)])
        self._area = self._mass / ribbon.surface_density if ribbon.surface_density else 0.0 * mass
        self._weight = self._mass[:, None] * np.asarray(gravity, float)
        size = ribbon.nodes
        self._scale = np.concatenate([np.full(size, 1.0 / ribbon.length), np.ones(size)])
        self._unit = ribbon.rigidity * ribbon.width / ribbon.length
        self._spring = _SPRING * self._unit / ribbon.length**2
        self._lever = _LEVER * ribbon.length

    def points(self, unknowns: Array) -> Array:
        """(N + 3, 3) m: the centreline's, and two that are fixed to the last link."""
        return self._placed(unknowns)[1]

    def _placed(self, unknowns: Array) -> tuple[Centreline, Array]:
        curve = centreline(self.ribbon, unknowns, self.frame, LINKS)
        end = curve.points[-1] + self._lever * curve.frames[-1][:, 1:].T
        return curve, np.concatenate([curve.points, end])

    def _held(self) -> Array:
        """(3, 3) m, where the far clamp holds the last three points."""
        assert self.far is not None
        end = self.far.point + self._lever * self.far.frame[:, 1:].T
        return np.concatenate([self.far.point[None], end])

    def let_go(self, unknowns: Array) -> RibbonState:
        """Unknowns (U,) without velocity, whatever forces them there."""
        points = self.points(unknowns)[:, None]
        still = [np.zeros_like(points) for _ in range(3)]
        return RibbonState(0.0, unknowns, np.zeros((3, 3)), PointMotion(points, *still))

    def at_rest(self, start: Array | None = None) -> RibbonState:
        """A stationary shape; where it is not stable, motion leaves it. start: (U,) unknowns to
        begin from, the rest shape by default. Raises SimulationError."""
        state = self.let_go(np.array(self.ribbon.rest if start is None else start, dtype=float))
        points = state.motion.points[:, 0]
        none = _Quadratic(np.zeros((len(points), 3, 3)), points, self._weight)
        return self._reached(state, state.unknowns, none, GRADIENT)

    def advance(self, state: RibbonState, pace: FixedSteps, air: Air | None = None) -> RibbonState:
        """The state one step later; the given one is not changed. Raises InputError for values out
        of range, SimulationError where a step finds no solution."""
        require(*out_of_range(pace, "pace"), *(out_of_range(air, "air") if air else []))
        fresh = not state.motion.smoothed.any()
        # accelerations of a ribbon that has not moved yet are not known
        radius = EULER if fresh else pace.radius
        h, old = pace.step, PointMotion(*(each.copy() for each in state.motion))
        method = integrator_of(radius, h)
        target, past = np.zeros_like(old.points), np.zeros_like(old.points)
        begin_step(radius, h, old, target, past)
        inertia = method.inertia * self._mass
        step = _Quadratic(
            inertia[:, None, None] * np.eye(3), target[:, 0], self._weight.copy(),
            None if air is None else self._drag(state, air, past[:, 0], method.rate),
        )  # fmt: skip
        new = self._reached(state, state.unknowns, step, _LOOSER * GRADIENT)
        ends = self.points(new.unknowns)[:, None]
        end_step(radius, h, old, ends, target, past)
        old.points[:] = ends
        return replace(new, time=state.time + h, motion=old)

    def energy(self, state: RibbonState) -> float:
        """J, elastic, kinetic and of the weight."""
        rates = state.motion.velocity[:, 0]
        kinetic = 0.5 * float(self._mass @ dots(rates, rates))
        weight = float(np.sum(self._weight * self.points(state.unknowns)))
        return elastic(self.ribbon, state.unknowns)[0] + kinetic - weight

    def _drag(self, state: RibbonState, air: Air, past: Array, rate: float) -> _Drag:
        curve, _ = self._placed(state.unknowns)
        factor = 0.5 * air.density * air.drag * self._area
        normal = np.concatenate([curve.frames[:, :, 1], np.zeros((2, 3))])
        return _Drag(factor, normal, past, rate, np.asarray(air.wind, float))

    def _reached(
        self, state: RibbonState, start: Array, step: _Quadratic, accuracy: float
    ) -> RibbonState:
        """The minimum, the far clamp's forces carried on until it holds."""
        unknowns, pull = start, state.pull
        for _ in range(_ROUNDS if self.far else 1):
            unknowns = self._minimum(unknowns, pull, step, accuracy)
            points = self.points(unknowns)
            if self.far is None:
                break
            away = points[-3:] - self._held()
            pull = pull - self._spring * away
            if np.abs(away).max() < _SLACK * self.ribbon.length:
                break
        else:
            raise SimulationError("ribbon", state.time, "its far clamp cannot be reached")
        motion = state.motion._replace(points=points[:, None])
        return replace(state, unknowns=unknowns, pull=pull, motion=motion)

    def _minimum(self, start: Array, pull: Array, step: _Quadratic, accuracy: float) -> Array:
        def of_points(points: Array) -> tuple[float, Array, Array]:
            energy, force, stiffness = step.at(points)
            if self.far is not None:
                away = points[-3:] - self._held()
                energy += 0.5 * self._spring * float(np.sum(away**2)) - float(np.sum(pull * away))
                force[-3:] += pull - self._spring * away
                stiffness[-3:] += self._spring * np.eye(3)
            return energy, force, stiffness

        def at(unknowns: Array) -> tuple[float, Array, Array]:
            energy, gradient, matrix = elastic(self.ribbon, unknowns)
            if np.isfinite(energy):
                curve, points = self._placed(unknowns)
                value, force, stiffness = of_points(points)
                energy += value
                loads = slopes_of_loads(self.ribbon, unknowns, curve, points, force)
                moves = slopes_of_points(curve, points)
                moves = moves @ angle_slopes(self.ribbon, unknowns, LINKS)
                gradient = gradient + loads[0]
                matrix = matrix + loads[1]
                matrix = matrix + np.einsum(
                    "pku,pkl,plv->uv", moves, stiffness, moves, optimize=True
                )
            scale, unit = self._scale, self._unit
            return energy / unit, gradient * scale / unit, matrix * np.outer(scale, scale) / unit

        def energy_at(unknowns: Array) -> float:
            energy = elastic(self.ribbon, unknowns)[0]
            if np.isfinite(energy):
                energy += of_points(self.points(unknowns))[0]
            return energy / self._unit

        found, _ = descend(self.ribbon, start, self._scale, at, energy_at)
        residual = float(np.abs(at(found)[1]).max())
        if not residual < 1e3 * accuracy:
            raise SimulationError("ribbon", 0.0, f"no solution of a step, residual {residual:.2g}")
        return found


class _Drag(NamedTuple):
    """factor: (P,) N s^2/m^2. normal: (P, 3). past: (P, 3) m and rate: 1/s, of the integrator.
    wind: (3,) m/s."""

    factor: Array
    normal: Array
    past: Array
    rate: float
    wind: Array


class _Quadratic(NamedTuple):
    """1/2 (x - y)^T K (x - y) - f.x of all points, and what the air adds. stiffness: K, (P, 3, 3)
    N/m. centre: y, (P, 3) m. force: f, (P, 3) N."""

    stiffness: Array
    centre: Array
    force: Array
    drag: _Drag | None = None

    def at(self, points: Array) -> tuple[float, Array, Array]:
        """Energy (J), force (P, 3) N and stiffness (P, 3, 3) N/m at points (P, 3)."""
        away = points - self.centre
        pulled = np.einsum("pkl,pl->pk", self.stiffness, away)
        energy = 0.5 * float(np.sum(away * pulled)) - float(np.sum(self.force * points))
        force, stiffness = self.force - pulled, self.stiffness.copy()
        if self.drag is not None:
            factor, normal, past, rate, wind = self.drag
            along = dots(rate * (points - past) - wind, normal)
            size = np.abs(along)
            energy += float(factor @ size**3) / (3.0 * rate)
            force -= (factor * size * along)[:, None] * normal
            outer = np.einsum("pk,pl->pkl", normal, normal)
            stiffness += (2.0 * rate * factor * size)[:, None, None] * outer
        return energy, force, stiffness
