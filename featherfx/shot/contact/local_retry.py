"""A part of the feathers that touch is stepped again, in shorter steps than the others.

Where a step leaves some feathers unsolved, or contacts far off, these and what they press form an
island: it goes the same way again in shorter steps, while all others keep what they got and move
evenly from their old pose to their new one (multirate, the slowest first: Gear and Wells 1984). An
island in which something is off again has smaller ones of its own, down to the shortest step. There
what finds no balance keeps its pose for the step, at rest.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from featherfx.algebra.types import Flags
from featherfx.mechanics.model import Loads
from featherfx.shot.contact.bodies import Bodies
from featherfx.shot.contact.steps import StepRules, StepSpan
from featherfx.solver.contact.interval import ContactSolver
from featherfx.solver.contact.types import (
    MAX_CONTACT_ITERATIONS,
    ContactReport,
    IntervalOptions,
    LedMotion,
)
from featherfx.solver.solver import StepReport
from featherfx.solver.state import LARGEST_FIGURES, LONG_STEP_COUNTS, RootPath, State

LoadsOf = Callable[[float, float], Sequence[Loads]]
PathsOf = Callable[[float, float], Sequence[RootPath]]

# Newton iterations of a feather in one solve, beyond which a shorter step is tried
EASY = 120
# contacts from what is off to the rim of its island
RINGS = 2
# part of the feathers that an island may have without taking in all that moves
LARGE = 0.5


@dataclass(frozen=True)
class SpanInputs:
    """Loads, root paths and bodies from one time to another (s), of all batches."""

    loads: LoadsOf
    paths: PathsOf
    bodies: Bodies


@dataclass
class Stepped:
    """Outcome of a span: states and reports of all batches; contact: of the tries that were taken,
    with the span (s) of each; tries: number of those that were not."""

    states: list[State]
    reports: list[StepReport]
    contact: list[tuple[float, ContactReport]]
    tries: int


class Stepper:
    """Steps all feathers over a span, islands of trouble in shorter steps.

    spend: told the iterations of every try. tired: tells whose contacts are left out. yielded: (B,)
    feathers that found no balance, or whose contacts were left out so far.
    """

    def __init__(
        self,
        solver: ContactSolver,
        rules: StepRules,
        around: SpanInputs,
        spend: Callable[[Sequence[StepReport], float], None],
        tired: Callable[[], Flags],
    ) -> None:
        self._solver, self._rules, self._around = solver, rules, around
        self._spend, self._tired, self.yielded = spend, tired, tired()

    def step(
        self, states: Sequence[State], span: StepSpan, resting: Flags, led: LedMotion | None = None
    ) -> Stepped:
        """The states after a span, of what is not led; its contact forces are kept."""
        solver, around = self._solver, self._around
        walls = around.bodies.walls(states, span.start, span.end, solver.settings.margin)
        tired = self._tired()
        loads, paths = around.loads(span.start, span.end), around.paths(span.start, span.end)
        new, reports, contact = solver.interval(
            states,
            loads,
            paths,
            span.length,
            walls,
            IntervalOptions(
                span.substeps,
                resting,
                tired if tired.any() else None,
                led,
                EASY if span.can_be_cut() else MAX_CONTACT_ITERATIONS,
                around.bodies.begun,
                lost=self._rules.lost(span),
            ),
        )
        self._spend(reports, span.start)
        self.yielded |= self._tired()
        off = self._rules.off(reports, contact, span)
        if not off.any() or not span.can_be_cut():
            stays = solver.held & solver.free & self._rules.hopeless(reports, contact)
            self.yielded |= stays
            _stay(new, reports, states, stays, span.length)
            self._rules.give_up(reports, span.start)
            solver.accept(but=stays)
            return Stepped(new, reports, [(span.length, contact.but(stays))], 0)
        if led is None:
            nowhere = np.zeros((1, 1, 1, 3))
            free = np.ones(len(off), dtype=np.bool_)
            led = LedMotion(free, nowhere, nowhere, ~free)
        island = self._island(off, led.free)
        rest = [(span.length, contact.of(led.free & ~island))]
        return self._in_parts(states, Stepped(new, reports, rest, 1), span, resting, island, led)

    def _in_parts(
        self,
        states: Sequence[State],
        whole: Stepped,
        span: StepSpan,
        resting: Flags,
        island: Flags,
        led: LedMotion,
    ) -> Stepped:
        """The span once more for an island, in shorter steps. whole: the try that failed, which
        holds for the others; led: as in that."""
        solver, grids = self._solver, self._solver.grids
        failed = any(report.status.any() for report in whole.reports)
        solver.accept(but=island)
        start = grids.together([state.points.nodes for state in states])
        end = grids.together([state.points.nodes for state in whole.states])
        if not led.free.all():
            start[~led.free], end[~led.free] = led.start[~led.free], led.end[~led.free]
        current, done = list(states), whole
        for part in span.parts(4 if failed else 2):
            fractions = [(time - span.start) / span.length for time in (part.start, part.end)]
            begin, stop = (start + fraction * (end - start) for fraction in fractions)
            own = LedMotion(island, begin, stop, led.fixed)
            done_part = self.step(current, part, resting & ~island, own)
            current = done_part.states
            done.contact += done_part.contact
            done.tries += done_part.tries
            _put(done.reports, done_part.reports, island, grids.first, part.start == span.start)
        for g, (low, high) in enumerate(pairwise(grids.first)):
            for f in np.flatnonzero(island[low:high]):
                done.states[g].take(current[g], int(f))
        return done

    def _island(self, off: Flags, free: Flags) -> Flags:
        """(B,) what is off and what it presses, directly or through others."""
        pressed, island = self._solver.pressed(), off & free
        for _ in range(RINGS):
            near = island[pressed].any(axis=1)
            island[pressed[near].ravel()] = True
            island &= free
        return free.copy() if island.sum() > LARGE * free.sum() else island


def _stay(
    new: Sequence[State],
    reports: Sequence[StepReport],
    states: Sequence[State],
    stays: Flags,
    duration: float,
) -> None:
    """Put bodies (B,) back to the pose from which a step (s) began, at rest; the next begins with
    that pose seen from their roots. Thrown by forces that balance nothing, they would leap."""
    first = 0
    for to, report, state in zip(new, reports, states, strict=True):
        own = np.flatnonzero(stays[first : first + len(state.time)])
        first += len(state.time)
        for f in own.tolist():
            to.take(state, f)
        for rates in to.rates():
            rates[own] = 0.0
        to.step[own], report.status[own] = 0.0, 0.0
        to.time[own] += duration


def _put(
    reports: Sequence[StepReport],
    more: Sequence[StepReport],
    island: Flags,
    first: NDArray[np.int64],
    anew: bool,
) -> None:
    """Put what an island's feathers did into the reports: counts add, the rest is the largest."""
    for g, (low, high) in enumerate(pairwise(first)):
        own = island[low:high]
        for name, total, new in zip(StepReport._fields, reports[g], more[g], strict=True):
            if name in ("steps", *LONG_STEP_COUNTS, *LARGEST_FIGURES) and anew:
                total[own] = new[own]
            elif name in LARGEST_FIGURES:
                total[own] = np.maximum(total[own], new[own])
            else:
                total[own] += new[own]
