"""Ribbons that move: the statics of rest.py with inertia and drag, clamped at one end or at both.

Mass is lumped at the points of the centreline, whose places follow from curvature and ruling. A
step minimises

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

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from featherfx.algebra.types import Array
from featherfx.algebra.vectors import dots
from featherfx.errors import SimulationError, require
from featherfx.lab.declare import NOT_NEGATIVE, POSITIVE, Range, out_of_range, value
from featherfx.lab.ribbons.curve import (
    LINKS,
    Centreline,
    angle_slopes,
    centreline,
    link_masses,
    slopes_of_loads,
    slopes_of_points,
)
from featherfx.lab.ribbons.energy import Ribbon, elastic
from featherfx.lab.ribbons.rest import GRADIENT, descend
from featherfx.solver.step.integrator_kernels import (
    EULER,
    PointMotion,
    begin_step,
    end_step,
    integrator_of,
)

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
