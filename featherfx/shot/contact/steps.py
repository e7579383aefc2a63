"""Lengths of the common steps of feathers that touch, within a frame.

Where a step leaves a feather unsolved, contacts far off, or too large an error where feathers press
each other, an island around these is stepped again in shorter steps (local_retry). In the
shortest that is allowed, what finds no balance keeps its pose, at rest.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from math import ceil, inf
from typing import NamedTuple

import numpy as np

from featherfx.algebra.types import Array, Flags
from featherfx.solver.contact.types import ContactReport
from featherfx.solver.solver import StepReport, raise_if_failed
from featherfx.solver.state import State
from featherfx.solver.types import TOO_MUCH_WORK

# what a step that cannot be solved is cut to at the least, over the shortest regular one
SMALLEST = 1.0 / 16.0
# misfit of a step's contacts, over the thickness, beyond which it is cut to the shortest regular
# one, and beyond which it is cut further
_WRONG, BAD = 0.5, 2.0
# over the first of these, misfit after the rounds of one search beyond which a feather is searched
# for no more in a step that is cut: one in nine ends within bounds
_LOST = 2.0
# part of the feathers that should need no more than one step of their own in a common one, as each
# costs a search of all; the next common step over the last, at least
FEW_STEPS, SHRINK = 0.25, 0.25
# work of what is done again of a common step, over that of its first try, beyond which the next may
# be half as long at most; how what they may be grows from step to step; and Newton iterations that
# take as long as what a try costs a feather beside them, most of all the search
DEAR, GROW, SEARCH = 1.0, 1.1, 3.0
# Newton iterations of a feather in a frame, over MAX_ITERATIONS, until its contacts are left out:
# it is solved in rounds; and, over those, until the bake ends
MORE_ITERATIONS, MAX_WORK = 4, 8
# the least of the former: where contacts were left out, the next frame has half as many
_FEWEST_ITERATIONS = 0.25


@dataclass(frozen=True)
class StepSpan:
    """From start to end, s. shortest: s, regular step of the frame. own: whether feathers may
    divide it into steps of their own."""

    start: float
    end: float
    shortest: float
    own: bool

    @property
    def length(self) -> float:
        """s."""
        return self.end - self.start

    @property
    def substeps(self) -> int:
        """Most regular steps of a feather within it."""
        return max(1, round(self.length / self.shortest)) if self.own else 1

    def can_be_cut(self) -> bool:
        """Return whether two steps that are long enough fit into it."""
        return round(self.length / (SMALLEST * self.shortest)) > 1

    def parts(self, count: int) -> list[StepSpan]:
        """The span in so many parts, or fewer where they would be too short."""
        count = min(count, round(self.length / (SMALLEST * self.shortest)))
        times = np.linspace(self.start, self.end, count + 1).tolist()
        return [replace(self, start=low, end=high) for low, high in pairwise(times)]


@dataclass(frozen=True)
class StepRules:
    """Rules of the steps of a shot.

    steps: common steps of a frame, 0: as many as are needed. substeps: most regular steps of a
    feather in a frame. tolerance: (B,) m, error of a step. thickness: (B,) m, of each vane, or
    twice what rounds may leave in a frame. rounds: of a step that was easy, at most. iterations:
    MAX_ITERATIONS. names: ids.
    """

    steps: int
    substeps: int
    tolerance: Array
    thickness: Array
    rounds: int
    iterations: int
    names: list[str]

    def wrong(self, contact: ContactReport) -> Flags:
        """(B,) bodies whose contacts are off by more than they should be."""
        return np.asarray(contact.off > _WRONG * self.thickness)

    def hopeless(self, reports: Sequence[StepReport], contact: ContactReport) -> Flags:
        """(B,) bodies that a step which is not cut leaves unsolved, or with contacts far off."""
        status = np.concatenate([report.status for report in reports])
        return np.asarray((status != 0.0) | (contact.off > BAD * self.thickness))

    def off(self, reports: Sequence[StepReport], contact: ContactReport, span: StepSpan) -> Flags:
        """(B,) bodies that are to be stepped over a span again, in shorter steps: not solved, with
        contacts that are off by more than a step of its length may have, or with too large an error
        in a step that they may not divide, as others press them."""
        status, steps, error = (
            np.concatenate([getattr(report, name) for report in reports])
            for name in ("status", "steps", "error")
        )
        off = (contact.off > self._most_off(span)) | (status != 0.0)
        if span.own and self.is_long(span):
            off |= (steps == 1.0) & (error > self.tolerance)
        return np.asarray(off)

    def is_long(self, span: StepSpan) -> bool:
        """Return whether a span is longer than a regular step: cut for contacts that are a little
        off."""
        return span.length > 1.001 * span.shortest

    def _most_off(self, span: StepSpan) -> Array:
        """(B,) m, misfit of contacts beyond which a step over a span is cut."""
        if self.is_long(span):
            return _WRONG * self.thickness
        last = span.length <= 2.0 * SMALLEST * span.shortest
        return np.full_like(self.thickness, np.inf) if last else BAD * self.thickness

    def lost(self, span: StepSpan) -> Array:
        """(B,) m, misfit of contacts with which a feather waits for shorter steps than a span."""
        return np.maximum(_LOST * _WRONG * self.thickness, self._most_off(span))

    def give_up(self, reports: Sequence[StepReport], time: float) -> None:
        """SimulationError for a feather that cannot be solved at a time (s)."""
        status = np.concatenate([report.status for report in reports])
        raise_if_failed(status, np.full(len(status), time), self.names)


class StepPacing(NamedTuple):
    """State of common steps between two frames. proposal: s, the next length; 0: none. bound: s,
    most that it may be."""

    proposal: float = 0.0
    bound: float = inf


class FrameSteps:
    """The steps from start to end (s). pace, patience: that the frame before left, the latter (B,)
    iterations of each feather until its contacts are left out, over MAX_ITERATIONS.

    time: s, where the feathers are. span: the step to try.
    """

    def __init__(
        self, rules: StepRules, start: float, end: float, pace: StepPacing, patience: Array
    ) -> None:
        self.rules, self.time, self.end, self._patience = rules, start, end, patience
        duration = end - start
        self.shortest = duration / (rules.steps or rules.substeps)
        self.proposal = self.shortest if rules.steps else min(pace.proposal or duration, duration)
        self._bound, self._done = pace.bound, 1e-9 * duration
        self._spent, self._tries = np.zeros(len(rules.names)), list[float]()

    @property
    def pace(self) -> StepPacing:
        """Return the state for the next frame."""
        return StepPacing(self.proposal, self._bound)

    def left(self) -> bool:
        """Return whether the end is not reached; chooses the next step."""
        left = self.end - self.time
        if left <= self._done:
            return False
        # where one at most has contacts left, all divide the rest by themselves
        tired = self.tired()
        one = tired.any() and (~tired & (self._spent > 0.0)).sum() <= 1
        h = left if one and not self.rules.steps else self.proposal
        # even steps: feathers keep their matrices from one to the next
        count = max(1, ceil(0.999 * left / h))
        stop = self.end if count == 1 else self.time + left / count
        self.span = StepSpan(self.time, stop, self.shortest, not self.rules.steps)
        return True

    def accepted(
        self,
        states: Sequence[State],
        reports: Sequence[StepReport],
        contact: ContactReport,
        tried: bool,
    ) -> None:
        """Go on to the step's end, where these states are, and propose the next one's length.

        tried: whether all feathers had to be stepped again, in shorter steps.
        """
        length, easy = self.span.length, contact.rounds <= self.rules.rounds and not tried
        self.proposal = min(self.shortest, (2.0 if easy else 1.0) * length)
        if not self.rules.steps:
            wanted = max(self.proposal, self._wanted(states, reports))
            self._learn()
            self.proposal = min(wanted, self._bound)
        self.time = self.span.end

    def _learn(self) -> None:
        """Bound the next steps where this one was too long: solved in vain, and then in parts.
        Where that concerns few feathers, shorter steps of all would take more."""
        length, tries, self._tries = self.span.length, self._tries, []
        dear = sum(tries[1:]) > DEAR * sum(tries[:1])
        bound = 0.5 * length if dear else GROW * max(self._bound, length)
        self._bound = max(bound, self.shortest)

    def spend(self, reports: Sequence[StepReport], time: float) -> None:
        """Count the iterations of a try that began at a time (s). SimulationError for a feather
        that took too many in the frame, although its contacts were left out (tired)."""
        iterations = np.concatenate([report.iterations for report in reports])
        self._spent += iterations
        self._tries.append(float(iterations.sum() + SEARCH * np.count_nonzero(iterations)))
        most = MAX_WORK * MORE_ITERATIONS * self.rules.iterations
        status = np.where(self._spent > most, TOO_MUCH_WORK, 0)
        raise_if_failed(status, np.full(len(status), time), self.rules.names, most)

    def tired(self) -> Flags:
        """(B,) feathers that took so many iterations in this frame that their contacts are left out
        for the rest of it."""
        return self._spent > self._patience * self.rules.iterations

    def next_patience(self) -> Array:
        """Return (B,) patience in the next frame: half where it was spent, else twice as much."""
        next_one = np.where(self.tired(), 0.5, 2.0) * self._patience
        return np.clip(next_one, _FEWEST_ITERATIONS, MORE_ITERATIONS)

    def _wanted(self, states: Sequence[State], reports: Sequence[StepReport]) -> float:
        """s, the length of which most feathers that were solved would make one step of their own.

        Their errors alone would not tell: their own steps grow no faster than they may, and a
        common step that grows faster is divided by all of them.
        """
        awake = np.concatenate([report.steps for report in reports]) > 0.0
        length = self.span.length
        if not awake.any():
            return 2.0 * length
        own = np.concatenate([state.proposal for state in states])[awake]
        return max(SHRINK * length, float(np.quantile(own, 1.0 - FEW_STEPS, method="lower")))
