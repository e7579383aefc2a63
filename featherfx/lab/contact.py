"""Plates that touch, case by case, beside the closed forms of plates.py.

A case brings its plates, and what is measured of them; all are solved as a shot solves feathers.
Roots bear what the first element of the rachis pulls with, and the weight of row 0:

    F = - sum (c v)_k R_k - m_0 g

c v forces and R frame of the element (mechanics/rachis_kernels.py). No force of contact is in it.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from math import atan, cos, radians, sin
from typing import Any, Literal, NamedTuple

import numpy as np

from featherfx.algebra.types import Array
from featherfx.algebra.vectors import quats_to_frames
from featherfx.errors import require
from featherfx.jit.compiled import KernelModule
from featherfx.lab.declare import Range, out_of_range, value
from featherfx.lab.plates import (
    BENDING,
    FRAMES_PER_SECOND,
    LENGTH,
    Plate,
    PlateSetup,
    droop_of,
    frequency_of,
    make_shot,
    propped_tip,
    sliding_of,
)
from featherfx.mechanics.model import Model
from featherfx.shot.contact.contact_group import ContactStage
from featherfx.shot.loop.free_group import free_groups
from featherfx.shot.loop.groups import FeatherGroup
from featherfx.shot.loop.run import ShotRun, StepGroup, make_groups
from featherfx.solver.solver import specific_energy
from featherfx.solver.state import State

energy_kernels = KernelModule("featherfx.solver.step.energy_kernels")


class PlateSample(NamedTuple):
    """Plates at one time.

    tips: (P,) m, heights over rest. velocity: (P, 3) m/s, of their middles of mass. momentum: (3,)
    N s. kinetic, energy: J, the latter with elastic energy and that of weight. reactions: (P, 3) N,
    on their roots, 0 of free ones; of what is at rest.
    """

    tips: Array
    velocity: Array
    momentum: Array
    kinetic: float
    energy: float
    reactions: Array


class TouchingPlates:
    """Plates that may touch each other, at rest without loads to begin with."""

    def __init__(self, plates: Sequence[Plate], setup: PlateSetup) -> None:
        self._plates, self._weight = plates, setup.weight
        self._run = run = ShotRun(make_shot(plates, setup), 1, 1, None, 0)
        stage, self._index = ContactStage(run), 0
        run.groups = make_groups(run)
        for group in run.groups:
            group.solver.model.held[:] = [not plates[f].is_free for f in group.members]
        stage.prepare()
        self._stage = stage
        self._steps: list[StepGroup] = [*stage.contact_groups, *free_groups(run)]
        self._rest = self._tips()

    def settle(self) -> PlateSample:
        """Bring the plates to rest."""
        for each in self._steps:
            each.settle()
        return self.sample()

    def throw(self, plate: int, velocity: Sequence[float]) -> None:
        """Give a plate a velocity (3,) m/s."""
        for group in self._run.groups:
            group.state.velocity.nodes[group.members == plate] += velocity

    def go(self, frames: int) -> Iterator[PlateSample]:
        """Yield the plates where they are, and after each of so many frames."""
        yield self.sample()
        for _ in range(frames):
            self._index += 1
            for each in self._steps:
                each.advance(self._index)
            yield self.sample()

    @property
    def slip_speed(self) -> float:
        """m/s, slip speed below which friction sets in."""
        return self._stage.contact_groups[0].contact.solver.settings.smoothing

    def contact_report(self) -> dict[str, Any]:
        """Return the figures of contact so far; {} of plates that cannot touch."""
        found: dict[str, Any] = self._stage.report().get("contact", {})
        return found

    def sample(self) -> PlateSample:
        """Measure the plates where they are."""
        count = len(self._plates)
        velocity, reactions, momentum = (np.zeros((count, 3)) for _ in range(3))
        kinetic = potential = 0.0
        for group in self._run.groups:
            model, state, some = group.solver.model, group.state, group.members
            mass = model.mass.sum(axis=(1, 2))
            for inertia, rate in zip(
                (model.mass, model.rotary_inertia), state.velocity, strict=True
            ):
                kinetic += 0.5 * float(np.einsum("fnp,fnpk,fnpk->", inertia, rate, rate))
            potential += sum(_elastic_energy(model, state, f) for f in range(len(some)))
            potential -= float(
                np.einsum("fnp,fnpk,k->", model.mass, state.points.nodes, self._weight)
            )
            momentum[some] = np.einsum("fnp,fnpk->fk", model.mass, state.velocity.nodes)
            velocity[some] = momentum[some] / mass[:, None]
            reactions[some] = self._reactions(group)
        return PlateSample(
            tips=self._tips() - self._rest,
            velocity=velocity,
            momentum=momentum.sum(axis=0),
            kinetic=kinetic,
            energy=kinetic + potential,
            reactions=reactions,
        )

    def _tips(self) -> Array:
        found = np.zeros(len(self._plates))
        for group in self._run.groups:
            found[group.members] = group.state.points.nodes[:, -1, 0, 2]
        return found

    def _reactions(self, group: FeatherGroup) -> Array:
        model, state = group.solver.model, group.state
        middle = state.rotation[:, 0] + state.rotation[:, 1]
        frames = quats_to_frames(middle / np.linalg.norm(middle, axis=1, keepdims=True))
        forces = model.rachis_stiffness[:, 0, :3] / model.length[:, :1]
        forces = forces * state.strains.rachis[:, 0, 0, :3]
        pull = np.einsum("fij,fj->fi", frames, forces)
        weight = model.mass[:, 0].sum(axis=1)[:, None] * self._weight
        return np.where(model.held[:, None], -pull - weight, 0.0)


def _elastic_energy(model: Model, state: State, f: int) -> float:
    """Energy (J) of the springs of feather f, and of those of its dashpots."""
    strains, gaps, history = state.strains.at(f, 0), state.gaps_of(f), state.strains.at(f)
    viscous = energy_kernels.viscous_energy(model, f, strains, history, gaps, 0.0)
    return float(model.mass[f].sum()) * specific_energy(model, state, f) + float(viscous)


Case = Literal["plates", "stack", "graded", "wedge", "slide", "collide"]

# kg/m^2; of plates of a stack that weigh next to nothing; bending of rigid plates, over BENDING
_DENSITY, _LIGHT, _RIGID = 0.1, 1e-4, 1e3
# frames of plates that are let go, and of those that slide, of which the first half is left out
_SWING_FRAMES, _SLIDE_FRAMES = 48, 12
# friction of plates that slide, and tangents of slopes over it: it slides, it sticks
_FRICTION, _STEEP, _FLAT = 0.3, 1.5, 0.8
# m/s, of a plate that is thrown at another; m, between them, and from root to root; frames
_SPEED, _GAP, _ASIDE, _COLLIDE_FRAMES = 1.0, 1e-3, 0.1, 3
# degrees, by which a plate rises whose edge bears another; m, from root to root
_WEDGE_SLOPE, _WEDGE_ASIDE = 5.0, -0.14


@dataclass(frozen=True)
class ContactTest:
    """Let plates droop, swing, slide and collide in contact, beside closed forms."""

    case: Case = value(
        "plates: two of different stiffness. stack: n, the top one loaded. graded: n of graded"
        " stiffness and weight. wedge: one on a rigid edge. slide: one on a slope."
        " collide: two in free flight."
    )
    n: int = value("Plates of a stack.", 2, Range(1, 50))
    thickness: float = value("m, of a plate.", 5e-4, Range(1e-6, 0.01, unit="m"))
    quality: str = value("Preset of the quality.", "preview")
    tolerance: float | None = value(
        "m, local error of a step; by default that of the quality.", None, Range(1e-9, 0.1)
    )
    steps: int = value(
        "Common steps a frame; 0: as many as the tolerance asks.", 16, Range(0, 1000)
    )
    at_rest: bool = value("Stacks only hang, and are not let go.", False)


@dataclass(frozen=True)
class ContactRun:
    """Outcome of a ContactTest; None where a case has no such figure.

    droop: m, mean height of the tips over their rest once settled; droop_exact: of one beam.
    frequency: Hz, of the tips once let go from the straight pose; frequency_exact: of one beam.
    reaction_sum: N, what all roots bear against gravity at rest; weight: of all plates.
    acceleration: m/s^2, down a steep slope; creep: m/s, of a plate that sticks on a flat one, and
    creep_most: slip speed below which friction sets in. momentum: N s, after a collision.
    energy_gain: most that T + U rises above what it was before, over the largest T. depth: m,
    deepest that plates are in each other, settled or in motion. steps_a_frame: mean, of a swing.
    """

    droop: float | None = None
    droop_exact: float | None = None
    frequency: float | None = None
    frequency_exact: float | None = None
    reaction_sum: float | None = None
    weight: float | None = None
    acceleration: float | None = None
    acceleration_exact: float | None = None
    creep: float | None = None
    creep_most: float | None = None
    momentum: float | None = None
    momentum_exact: float | None = None
    energy_gain: float | None = None
    steps_a_frame: float | None = None
    depth: float = 0.0


def run_contact(test: ContactTest) -> ContactRun:
    """Run a test. Raises InputError with every wrong value."""
    require(*out_of_range(test))
    setup = PlateSetup(
        thickness=test.thickness, quality=test.quality, tolerance=test.tolerance, steps=test.steps
    )
    plates, frames = make_plates(test), 0 if test.at_rest else _SWING_FRAMES
    others = {"slide": _slide, "collide": _collide, "wedge": _press}
    if test.case in others:
        return others[test.case](plates, setup)
    return _hang(plates, setup, frames)


def make_plates(test: ContactTest) -> list[Plate]:
    """Return the plates of a test, the lowest first."""
    t, rigid = test.thickness, _RIGID * BENDING
    if test.case == "plates":
        return [Plate(4.0 * BENDING, _DENSITY), Plate(BENDING, _DENSITY, t)]
    if test.case == "slide":
        return [Plate(rigid, _DENSITY), Plate(rigid, _DENSITY, t, is_free=True)]
    if test.case == "collide":
        upper = Plate(BENDING, _DENSITY, t + _GAP, _ASIDE, is_free=True)
        return [Plate(BENDING, _DENSITY, is_free=True), upper]
    if test.case == "wedge":
        height = -LENGTH * sin(radians(_WEDGE_SLOPE)) - t
        wedge = Plate(100.0 * rigid, _DENSITY, height, _WEDGE_ASIDE, -_WEDGE_SLOPE)
        return [wedge, Plate(BENDING, _DENSITY)]
    if test.case == "graded":
        # the stiffest below, the heaviest above
        grades = [(1.0 + k) / test.n for k in range(test.n)]
        pairs = zip(reversed(grades), grades, range(test.n), strict=True)
        return [Plate(a * BENDING, b * _DENSITY, k * t) for a, b, k in pairs]
    density = [*(_LIGHT for _ in range(test.n - 1)), 0.4 * _DENSITY * test.n]
    return [Plate(BENDING, each, k * t) for k, each in enumerate(density)]


def _hang(plates: Sequence[Plate], setup: PlateSetup, frames: int) -> ContactRun:
    """Plates that hang as one beam, and swing as one for so many frames once they are let go."""
    hanging = TouchingPlates(plates, setup)
    settled = hanging.settle()
    found = ContactRun(
        droop=float(settled.tips.mean()),
        droop_exact=droop_of(plates, setup.gravity),
        depth=hanging.contact_report().get("depth_after_settling", 0.0),
        **_borne(settled, plates, setup),
    )
    if not frames:
        return found
    swinging = TouchingPlates(plates, setup)
    samples, report = list(swinging.go(frames)), swinging.contact_report()
    return replace(
        found,
        steps_a_frame=report["steps"] / frames if report else None,
        frequency=_measure_frequency(np.array([each.tips.mean() for each in samples])),
        frequency_exact=frequency_of(plates, setup.loss),
        energy_gain=energy_gain(samples),
    )


def _press(plates: Sequence[Plate], setup: PlateSetup) -> ContactRun:
    """A plate that rests on the edge of a rigid one."""
    pressing = TouchingPlates(plates, setup)
    settled = pressing.settle()
    at = _WEDGE_ASIDE + LENGTH * cos(radians(_WEDGE_SLOPE))
    return ContactRun(
        droop=float(settled.tips[1]),
        droop_exact=propped_tip(plates[1], at, setup.gravity),
        depth=pressing.contact_report()["depth_after_settling"],
        **_borne(settled, plates, setup),
    )


def _slide(plates: Sequence[Plate], setup: PlateSetup) -> ContactRun:
    """A plate on one that is held, on a slope that is steeper than friction, and on a flat one."""
    setup = replace(setup, friction=_FRICTION)
    slopes = [atan(each * _FRICTION) for each in (_STEEP, _FLAT)]
    runs = [TouchingPlates(plates, replace(setup, incline=each)) for each in slopes]
    steep, flat = (list(run.go(_SLIDE_FRAMES)) for run in runs)
    speeds, flat_setup = [each.velocity[1, 0] for each in steep], replace(setup, incline=slopes[1])
    begin = _SLIDE_FRAMES // 2
    return ContactRun(
        acceleration=float(speeds[-1] - speeds[begin])
        * FRAMES_PER_SECOND
        / (_SLIDE_FRAMES - begin),
        acceleration_exact=sliding_of(slopes[0], _FRICTION, setup.gravity),
        creep=abs(float(flat[-1].velocity[1, 0])),
        creep_most=runs[1].slip_speed,
        energy_gain=energy_gain(steep),
        depth=runs[0].contact_report()["worst_depth"],
        **_borne(flat[-1], plates, flat_setup),
    )


def _collide(plates: Sequence[Plate], setup: PlateSetup) -> ContactRun:
    """A free plate that is thrown at another, without weight."""
    flying = TouchingPlates(plates, replace(setup, gravity=0.0))
    flying.throw(1, (0.0, 0.0, -_SPEED))
    samples = list(flying.go(_COLLIDE_FRAMES))
    return ContactRun(
        momentum=float(samples[-1].momentum[2]),
        momentum_exact=-_SPEED * plates[1].mass,
        energy_gain=energy_gain(samples),
        depth=flying.contact_report()["worst_depth"],
    )


def _borne(sample: PlateSample, plates: Sequence[Plate], setup: PlateSetup) -> dict[str, Any]:
    """Sum of what roots bear against gravity (N), and the weight."""
    up = np.array([-sin(setup.incline), 0.0, cos(setup.incline)])
    weight = setup.gravity * sum(plate.mass for plate in plates)
    return {"reaction_sum": float(sample.reactions.sum(axis=0) @ up), "weight": weight}


def energy_gain(samples: Sequence[PlateSample]) -> float:
    """Return the most that the energy rises above what it was before, over the largest T."""
    energy = np.array([each.energy for each in samples])
    gain = float((energy - np.minimum.accumulate(energy)).max())
    return gain / max(each.kinetic for each in samples)


def _measure_frequency(heights: Array) -> float:
    """Return the frequency (Hz) of a damped swing (T,) m that begins at rest."""
    from scipy.optimize import curve_fit

    times = np.arange(len(heights)) / FRAMES_PER_SECOND

    def swing(t: Array, middle: float, decay: float, frequency: float) -> Array:
        turn = 2.0 * np.pi * frequency
        swung = np.exp(-decay * t) * (np.cos(turn * t) + decay / turn * np.sin(turn * t))
        return np.asarray(middle * (1.0 - swung))

    middle = float(heights.mean())
    tried = [
        curve_fit(swing, times, heights, [middle, 1.0, each], full_output=True, maxfev=4000)
        for each in np.linspace(2.0, 6.0, 5)
    ]
    best = min(tried, key=lambda found: float(np.square(found[2]["fvec"]).sum()))
    return float(best[0][2])
