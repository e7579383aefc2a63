"""Feathers that touch brought to rest together, before the first frame.

Long damped steps: after each one all motion is taken away, and what has come to rest, no deeper in
others than is left, is only solved again where others push it. Steps of one length end when all but
a few are at rest, the longest when these are no fewer than before. One that failed twice is not
tried again.

Feathers that settle from a pose turned up about their roots.

Coverts above and below a thin wing may curl through it at rest, and through each other. From there
no step leads out: points beyond the wing stay beyond, on its other side. So such feathers are
turned up until they are clear, and their roots are led down again while contact holds what they
meet.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from time import perf_counter
from typing import Any

import numpy as np
from numpy.typing import NDArray

from featherfx.algebra.types import Array, Flags, Indices
from featherfx.algebra.vectors import quats_to_frames, rotation_vectors, vectors_to_frames
from featherfx.errors import InputWarning
from featherfx.groom.types import Placement
from featherfx.jit.compiled import KernelModule
from featherfx.mechanics.model import Loads, Model
from featherfx.phases import phase
from featherfx.shot.contact.bodies import Bodies
from featherfx.shot.contact.local_retry import EASY
from featherfx.shot.contact.obstacles import Obstacles
from featherfx.solver.contact.interval import ContactSolver
from featherfx.solver.contact.surfaces import Grids
from featherfx.solver.contact.types import ContactReport, IntervalOptions, LedMotion
from featherfx.solver.solver import raise_if_failed
from featherfx.solver.state import RootPath, State, hold_roots, rest_state


def held_roots(states: Sequence[State]) -> list[RootPath]:
    """Paths of roots that stay where they are."""
    return [hold_roots(state) for state in states]


def raised_points(points: Array, placement: Placement, angle: float) -> Array:
    """A placed feather's points (..., 3) m, turned up about its root by an angle in rad."""
    if angle == 0.0:
        return points
    turn = vectors_to_frames(-angle * placement.rotation[:, 1])
    return np.asarray((points - placement.position) @ turn.T + placement.position)


def turned_up(
    states: Sequence[State], models: Sequence[Model], grids: Grids, angles: Array
) -> list[State]:
    """Batches whose feathers begin in their rest shape, turned up about their roots by angles (B,)
    in rad; those with 0 are as they were."""
    found = []
    for state, model, (low, high) in zip(states, models, pairwise(grids.first), strict=True):
        own, new = angles[low:high], state.copy()
        frames = quats_to_frames(state.rotation[:, 0])
        turns = vectors_to_frames(-own[:, None] * frames[:, :, 1])
        turned = rest_state(model, state.centre[:, 0], turns @ frames)
        turned = turned._replace(time=state.time)
        for f in np.flatnonzero(own).tolist():
            new.take(turned, f)
        found.append(new)
    return found


class Lowering:
    """Leads roots to where those of some states are."""

    def __init__(self, states: Sequence[State]) -> None:
        self._ends = [quats_to_frames(state.rotation[:, 0]) for state in states]

    def paths(self, part: float) -> Callable[[Sequence[State]], list[RootPath]]:
        """Paths that turn roots by a part of what is left."""

        def paths_of(states: Sequence[State]) -> list[RootPath]:
            paths = held_roots(states)
            for path, end in zip(paths, self._ends, strict=True):
                turn = end @ np.swapaxes(quats_to_frames(path.base), -1, -2)
                path.samples[:, 1, 3:] = part * rotation_vectors(turn)
            return paths

        return paths_of


meeting_kernels = KernelModule("featherfx.solver.contact.meeting_kernels")

# states, status (B,) and report of a step that was tried
_Tried = tuple[list[State], Array, ContactReport]

# lengths of the steps, s, and the most of each
_STEPS, MAX_STEPS = (0.01, 0.1, 1.0), 8
# steps of the shortest kind in which what was turned up is led down
LOWERING = 8
# what one that cannot be solved is cut to, and the shortest tried, s
CUT, SHORTEST = 0.25, 1e-5
# Newton iterations of one solve, over those of a step that is easy, in steps longer than the first
PATIENT = 4
# misfit of contacts, over the thickness, beyond which a step is cut as well, down to this, s; part
# of the feathers that go alone instead, where a step of the stage was cut, or that may be left
BAD, SHORTEST_OFF, FEW = 2.0, 5e-4, 0.05
# over the time of a stage's first step, what settling takes after each of its steps: between what
# samples/flapping_bird and pigeon/contact.toml and the creature of docs/production_shot.md took
_LEFT = (
    (4.5, 4.3, 3.9, 3.6, 3.2, 2.9, 2.5, 2.2),
    (3.5, 2.8, 2.4, 2.2, 2.1, 2.1, 2.1, 2.1),
    (2.0, 1.3, 1.0, 0.7, 0.4, 0.2, 0.1, 0.0),
)
# Newton iterations of a feather after which others pass it that it is in, or it is left as it is
MAX_ITERATIONS = 4000
# pairs named in a warning
_MAX_NAMED = 3
# what helps where feathers have no room
_HELP = (
    "in the groom, a larger thickness in [layout] gives feathers of regions more room; or let kinds"
    " or regions in [contact] name only what has to push"
)


@dataclass(frozen=True)
class Settled:
    """States of the batches, at rest; depth: m, deepest penetration, and rest_depth: before.

    moving: bodies that found no balance, what moved farthest in the last step first. hard: which
    took so many iterations that it was left where it is, if one did.
    """

    states: list[State]
    depth: float
    rest_depth: float
    moving: Indices
    hard: int | None


def settled_together(
    solver: ContactSolver,
    bodies: Bodies,
    states: Sequence[State],
    loads: Sequence[Loads],
    names: Sequence[str],
    raised: Array,
    obstacles: Obstacles,
) -> Settled:
    """The batches in balance with their loads and each other, from the given states on; obstacles,
    the batches behind all others, go along. raised: (B,) rad, how far feathers are turned up first,
    and led back down from (raised_points).

    Raises SimulationError where a feather cannot be solved. One that finds no balance is left on
    its way (warn_of_unsettled).
    """
    time = float(states[0].time[0])
    current = obstacles.beside([_stopped(state, time) for state in states], time)
    rest_depth, depth = None, 0.0
    steps, resting = (
        _Steps(solver, bodies, loads, names, obstacles),
        np.zeros(len(names), dtype=np.bool_),
    )
    quiet, moved = resting, np.zeros(len(names))
    left = _Left()
    if raised.any():
        current = steps.lowered(current, raised)
    with phase("settling", len(_STEPS) * MAX_STEPS, at_most=True) as done:
        for stage, length in enumerate(_STEPS):
            h, longest, cut, failed = length, length, False, 0
            resting[:] = False
            for number in range(MAX_STEPS):
                done(stage * MAX_STEPS + number, left.seconds)
                new, contact, lengths = steps.take(current, h, resting, cut)
                cut |= bool((lengths < h).any())
                failed += int(lengths.max() < h)
                if failed > 1:
                    longest = float(lengths.max())
                left.step(stage, number)
                new = obstacles.beside([_stopped(state, time) for state in new], time)
                moved, current = _moves(new, current), new
                bodies.begun = True
                rest_depth = contact.start_depth if rest_depth is None else rest_depth
                depth = contact.depth
                before = np.count_nonzero(~resting) if number else len(names)
                quiet = moved < solver.settings.tolerance * lengths / longest
                resting = quiet & (contact.deep < solver.settings.tolerance)
                awake = np.count_nonzero(~resting)
                few = awake <= FEW * len(names) and (longest < _STEPS[-1] or awake >= before)
                if few or not awake:
                    break
                h = min(longest, float(lengths.max()) / CUT)
    moving = np.flatnonzero(~quiet | steps.stuck)
    moving = moving[np.argsort(-moved[moving], kind="stable")]
    hard = int(np.argmax(steps.stuck)) if steps.stuck.any() else None
    return Settled(current, depth, rest_depth or 0.0, moving, hard)


class _Left:
    """Estimate of the time that settling still takes, by that of the first step of each stage."""

    def __init__(self) -> None:
        self._begin, self._first = perf_counter(), 0.0
        self.seconds: float | None = None

    def step(self, stage: int, number: int) -> None:
        """A step of a stage has been done, both counted from 0."""
        now = perf_counter()
        if number == 0:
            self._first = now - self._begin
        self._begin, self.seconds = now, _LEFT[stage][number] * self._first


class _Steps:
    """Damped steps of the batches. stuck: (B,) bodies that stay where they are, as they took too
    many iterations."""

    def __init__(
        self,
        solver: ContactSolver,
        bodies: Bodies,
        loads: Sequence[Loads],
        names: Sequence[str],
        obstacles: Obstacles,
    ) -> None:
        self._solver, self._bodies, self._loads = solver, bodies, loads
        self._names, self._obstacles = names, obstacles
        self._thickness = 2.0 * float(solver.surfaces.half.max(initial=0.0))
        self._nobody = np.zeros(len(names), dtype=np.bool_)
        self._spent, self.stuck = np.zeros(len(names)), self._nobody.copy()
        self._paths_of: Callable[[Sequence[State]], list[RootPath]] = held_roots

    def lowered(self, states: Sequence[State], raised: Array) -> list[State]:
        """Feathers turned up by angles (B,) in rad and led down again, with what touches them."""
        time, grids = float(states[0].time[0]), self._solver.grids
        models = [solver.model for solver in self._solver.solvers]
        current, lowering = turned_up(states, models, grids, raised), Lowering(states)
        nobody = self._nobody.copy()
        for number in range(LOWERING):
            self._paths_of = lowering.paths(1.0 / (LOWERING - number))
            new, _, _ = self.take(current, _STEPS[0], nobody, False)
            current = [_stopped(state, time) for state in new]
            self._bodies.begun = True
        self._paths_of = held_roots
        self._spent[:] = 0.0
        return current

    def take(
        self, states: Sequence[State], h: float, resting: Flags, apart: bool
    ) -> tuple[list[State], ContactReport, Array]:
        """One damped step of h (s), or of as much of it as can be solved; and its length (B,).

        resting: (B,) which rest. apart: whether a few whose contacts are far off go a part of it
        alone, so that all others go the whole. Forces are kept for the next step.
        """
        held, tried = self._nobody, None
        if apart:
            tried = self._try(states, h, resting, self.stuck)
            held = self._off(tried[2]) & ~self.stuck
            if tried[1].any() or held.mean() > FEW:
                held = self._nobody
            elif held.any():
                tried = None
        still = held | self.stuck
        new, contact, length = self._part(states, h, resting, still, tried)
        lengths = np.full(len(held), length)
        _put_back(new, states, still, self._solver.grids.first)
        if held.any():
            some, alone, lengths[held] = self._part(new, CUT * length, resting, ~held, None)
            _put_back(new, some, held, self._solver.grids.first)
            deep, off = (
                np.where(held, *each)
                for each in ((alone.deep, contact.deep), (alone.off, contact.off))
            )
            contact = replace(contact, deep=deep, off=off, depth=float(deep.max()))
        return new, contact, lengths

    def _part(
        self, states: Sequence[State], h: float, resting: Flags, held: Flags, tried: _Tried | None
    ) -> tuple[list[State], ContactReport, float]:
        """One step of h (s), or of as much of it as can be solved, of what is not held. tried: it,
        if it has been. Contacts of what cannot be solved at the shortest step are left out."""
        left_out: Flags | None = None
        while True:
            new, status, contact = tried or self._try(states, h, resting, held, left_out)
            tried = None
            if not status.any() and not (self._off(contact).any() and CUT * h > SHORTEST_OFF):
                self._accept()
                return new, contact, h
            if CUT * h >= SHORTEST:
                h *= CUT
            elif left_out is None:
                left_out = status != 0.0
            else:
                raise_if_failed(status, np.zeros(len(status)), self._names)

    def _accept(self) -> None:
        """Keep the forces of a step. What jams a feather that has taken too many iterations passes
        from then on; where nothing does, the feather stays where it is."""
        jammed, before = self._spent > MAX_ITERATIONS, len(self._solver.passed)
        self._solver.accept(jammed=jammed)
        self._spent[jammed] = 0.0
        if len(self._solver.passed) == before:
            self.stuck |= jammed

    def _try(
        self,
        states: Sequence[State],
        h: float,
        resting: Flags,
        held: Flags,
        left_out: Flags | None = None,
    ) -> _Tried:
        """One step of h (s) of what is not held."""
        solver, now = self._solver, float(states[0].time[0])
        led = self._obstacles.led(solver.grids, states)
        if held.any() and led is None:
            nodes = solver.grids.together([state.points.nodes for state in states])
            led = LedMotion(~held, nodes, nodes, np.zeros_like(held))
        elif held.any() and led is not None:
            led = led._replace(free=led.free & ~held)
        paths = self._paths_of(states)
        walls = self._bodies.walls(states, now, now, solver.settings.margin)
        manner = IntervalOptions(resting=resting, left_out=left_out, led=led, settling=True)
        if CUT * h >= SHORTEST:
            # what is nearly at rest is not cut for one feather that takes long
            manner = manner._replace(iterations=EASY if h <= _STEPS[0] else PATIENT * EASY)
        if CUT * h > SHORTEST_OFF:
            manner = manner._replace(lost=BAD * self._thickness)
        new, reports, contact = solver.interval(states, self._loads, paths, h, walls, manner)
        self._spent += np.concatenate([report.iterations for report in reports])
        new = [*self._obstacles.solved(new), *self._obstacles.solved(states, False)]
        return new, np.concatenate([report.status for report in reports]), contact

    def _off(self, contact: ContactReport) -> Flags:
        """(B,) bodies whose contacts are far off."""
        return np.asarray(contact.off > BAD * self._thickness)


def _put_back(
    states: Sequence[State], before: Sequence[State], held: Flags, first: Indices
) -> None:
    """Give states of batches, in place, what the held (B,) had before. first: body of each batch,
    and all."""
    for state, old, (low, high) in zip(states, before, pairwise(first), strict=True):
        for f in np.flatnonzero(held[low:high]).tolist():
            state.take(old, f)


def _moves(after: Sequence[State], before: Sequence[State]) -> NDArray[np.float64]:
    """(B,) m, how far any node of each feather moved."""
    moves = [np.zeros(len(state.time)) for state in after]
    for own, now, then in zip(moves, after, before, strict=True):
        every = np.ones(len(own), dtype=np.bool_)
        meeting_kernels.largest_moves(now.points.nodes, then.points.nodes, every, own)
    return np.concatenate(moves)


def _stopped(state: State, time: float) -> State:
    new = state.copy()
    for rate in new.rates():
        rate[:] = 0.0
    new.step[:], new.proposal[:], new.time[:] = 0.0, 0.0, time
    return new


def warn_of_unsettled(
    found: Settled, names: Sequence[str], deep: Sequence[Mapping[str, Any]]
) -> None:
    """Say which feathers start out of balance, why, and what helps (InputWarning).

    deep: pairs that are in each other, the deepest first: feather, other and depth (m).
    """
    if not len(found.moving):
        return
    first, more = names[int(found.moving[0])], len(found.moving) - 1
    who = f"feather '{first}'" + (f" and {more} more start" if more else " starts")
    said = f"settle: {who} out of balance, not at rest against the others"
    if found.hard is not None:
        said += (
            f". '{names[found.hard]}' was left where it is after {MAX_ITERATIONS} Newton iterations"
        )
    if deep and deep[0]["depth"] > found.rest_depth / 10.0:
        pairs = (
            f"'{pair['feather']}' {1e3 * pair['depth']:.2g} mm in '{pair['other']}'"
            for pair in deep[:_MAX_NAMED]
        )
        said += f". They begin in each other, still {', '.join(pairs)}"
    warnings.warn(f"{said}: {_HELP}", InputWarning, stacklevel=2)
