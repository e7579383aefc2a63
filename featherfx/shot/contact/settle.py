"""Feathers that touch brought to rest together, before the first frame.

Long damped steps: after each one all motion is taken away, and what has come to rest, no deeper in
others than is left, is only solved again where others push it.
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from time import perf_counter

import numpy as np
from numpy.typing import NDArray

from featherfx.errors import InputWarning
from featherfx.mechanics.model import Loads
from featherfx.phases import phase
from featherfx.shot.contact.aside import aside, put_back
from featherfx.shot.contact.bodies import Bodies
from featherfx.shot.contact.mend import EASY
from featherfx.solver.contact.interval import ContactReport, ContactSolver, Manner
from featherfx.solver.solver import raise_if_failed
from featherfx.solver.state import State
from featherfx.solver.step.root_path import hold_roots

Flags = NDArray[np.bool_]

# lengths of the steps, s, and the most of each
STEPS, MOST_STEPS = (0.01, 0.1, 1.0), 8
# what one that cannot be solved is cut to, and the shortest tried, s
CUT, SHORTEST = 0.25, 1e-5
# Newton iterations of one solve, over those of a step that is easy, in steps longer than the first
PATIENT = 4
# misfit of contacts, over the thickness, beyond which a step is cut as well, down to this, s
BAD, SHORTEST_OFF = 2.0, 5e-4
# over the time of a stage's first step, what settling takes after each of its steps: between what
# samples/flapping_bird and pigeon/contact.toml and the creature of docs/production_shot.md took
LEFT = (
    (4.5, 4.3, 3.9, 3.6, 3.2, 2.9, 2.5, 2.2),
    (3.5, 2.8, 2.4, 2.2, 2.1, 2.1, 2.1, 2.1),
    (2.0, 1.3, 1.0, 0.7, 0.4, 0.2, 0.1, 0.0),
)
# Newton iterations of a feather after which settling ends, in balance or not
MOST_ITERATIONS = 4000


@dataclass(frozen=True)
class Settled:
    """States of the batches, at rest; depth: m, deepest penetration, and rest_depth: before."""

    states: list[State]
    depth: float
    rest_depth: float


def settled_together(
    solver: ContactSolver,
    bodies: Bodies,
    states: Sequence[State],
    loads: Sequence[Loads],
    names: Sequence[str],
    idle: Flags,
) -> Settled:
    """The batches in balance with their loads and each other, from the given states on, but for the
    idle (B,), which are computed in other batches.

    Raises SimulationError where a feather cannot be solved. One that finds no balance is left on
    its way, with a warning (InputWarning) that names the first.
    """
    time = float(states[0].time[0])
    current = [_stopped(state, time) for state in states]
    rest_depth, depth = None, 0.0
    spent, resting = np.zeros(len(names)), np.zeros(len(names), dtype=np.bool_)
    quiet = resting
    left = _Left()
    with phase("settling", len(STEPS) * MOST_STEPS, at_most=True) as done:
        for stage, longest in enumerate(STEPS):
            h = longest
            resting[:] = False
            for number in range(MOST_STEPS):
                done(stage * MOST_STEPS + number, left.seconds)
                if spent.max() > MOST_ITERATIONS:
                    break
                some = resting, idle
                new, contact, h = _step(solver, bodies, current, loads, names, h, some, spent)
                left.step(stage, number)
                put_back(new, current, idle, solver.grids.first)
                moved = _moves(new, current)
                current = [_stopped(state, time) for state in new]
                solver.accept()
                bodies.begun = True
                rest_depth = contact.start_depth if rest_depth is None else rest_depth
                depth = contact.depth
                quiet = (moved < solver.settings.tolerance) & (h == longest)
                resting = quiet & (contact.deep < solver.settings.tolerance)
                if resting.all():
                    break
                h = min(longest, h / CUT)
    if not quiet.all():
        _warn(names, quiet)
    return Settled(current, depth, rest_depth or 0.0)


class _Left:
    """How long settling still takes, by how long the first step of each stage took."""

    def __init__(self) -> None:
        self._begin, self._first = perf_counter(), 0.0
        self.seconds: float | None = None

    def step(self, stage: int, number: int) -> None:
        """A step of a stage has been done, both counted from 0."""
        now = perf_counter()
        if number == 0:
            self._first = now - self._begin
        self._begin, self.seconds = now, LEFT[stage][number] * self._first


def _step(
    solver: ContactSolver,
    bodies: Bodies,
    states: Sequence[State],
    loads: Sequence[Loads],
    names: Sequence[str],
    h: float,
    some: tuple[Flags, Flags],
    spent: NDArray[np.float64],
) -> tuple[list[State], ContactReport, float]:
    """One damped step of h (s), or of as much of it as can be solved; and its length.

    some: (B,) which rest, and which are idle. spent: (B,) Newton iterations, added to. What cannot
    be solved at the shortest step yields.
    """
    yielding: Flags | None = None
    resting, idle = some
    led = aside(solver.grids, states, idle)
    while True:
        paths = [hold_roots(state) for state in states]
        now = float(states[0].time[0])
        walls = bodies.walls(states, now, now, solver.settings.margin)
        manner = Manner(resting=resting, yielding=yielding, led=led, settling=True)
        if CUT * h >= SHORTEST:
            # what is nearly at rest is not cut for one feather that takes long
            manner = manner._replace(iterations=EASY if h <= STEPS[0] else PATIENT * EASY)
        new, reports, contact = solver.interval(states, loads, paths, h, walls, manner)
        spent += np.concatenate([report.iterations for report in reports])
        status = np.concatenate([report.status for report in reports])
        far_off = contact.residual > BAD * 2.0 * float(solver.surfaces.half.max(initial=0.0))
        if not status.any() and not (far_off and CUT * h > SHORTEST_OFF):
            return new, contact, h
        if CUT * h >= SHORTEST:
            h *= CUT
        elif yielding is None:
            yielding = status != 0.0
        else:
            raise_if_failed(status, np.zeros(len(status)), names)


def _moves(after: Sequence[State], before: Sequence[State]) -> NDArray[np.float64]:
    """(B,) m, how far any node of each feather moved."""
    moves = [
        np.abs(a.points.nodes - b.points.nodes).max(axis=(1, 2, 3))
        for a, b in zip(after, before, strict=True)
    ]
    return np.concatenate(moves)


def _stopped(state: State, time: float) -> State:
    new = state.copy()
    for rate in new.rates():
        rate[:] = 0.0
    new.step[:], new.proposal[:], new.time[:] = 0.0, 0.0, time
    return new


def _warn(names: Sequence[str], quiet: Flags) -> None:
    moving = np.flatnonzero(~quiet)
    more = f" and {len(moving) - 1} more" if len(moving) > 1 else ""
    warnings.warn(
        f"settle: feather '{names[int(moving[0])]}'{more} had not come to rest against the others"
        " and starts out of balance",
        InputWarning,
        stacklevel=2,
    )
