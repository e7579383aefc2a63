"""Contact in the frame loop: all feathers of a shot in common steps.

Within a frame the feathers that touch must know of each other at the same times, so they take
common steps: a given number per frame, or as many as most of them need to keep to the quality's
tolerance. The others divide these into steps of their own, but for feathers that press each other:
what both feel in one step is one impulse, equal and opposite.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from featherfx.algebra.types import Array, Flags, Indices
from featherfx.errors import InputWarning
from featherfx.feather.types import Feather
from featherfx.mechanics.model import Loads
from featherfx.shot.contact.bodies import Bodies, FeathersOver
from featherfx.shot.contact.local_retry import SpanInputs, Stepper
from featherfx.shot.contact.obstacles import Obstacles
from featherfx.shot.contact.pairs import DEEP, Encounters, at_rest, layered_pairs, thicknesses
from featherfx.shot.contact.settle import raised_points, settled_together, warn_of_unsettled
from featherfx.shot.contact.steps import MORE_ITERATIONS, FrameSteps, StepPacing, StepRules
from featherfx.shot.loop.free_group import skip_frame
from featherfx.shot.options import ShotOptions
from featherfx.shot.types import Shot
from featherfx.solver.contact.interval import ContactSolver
from featherfx.solver.contact.surfaces import grids_of, shapes_of, surfaces_of
from featherfx.solver.contact.types import (
    GROWN_IN,
    Candidates,
    ContactMemory,
    ContactReport,
    ContactSettings,
)
from featherfx.solver.solver import Solver, StepReport
from featherfx.solver.state import LARGEST_FIGURES, RootPath, State
from featherfx.solver.types import MAX_INTERVAL_WORK

LoadsOf = Callable[[float, float], Sequence[Loads]]
PathsOf = Callable[[float, float], Sequence[RootPath]]

# smallest followed gap, in thicknesses
MARGIN = 6.0
# pairs named in a report
MAX_NAMED = 10


@dataclass
class Tally:
    """Sums over a shot. contacts: most at once. depth: m, deepest penetration, after settling and
    in motion. residual: m, worst of an interval. rounds, intervals, solves: totals. repeated:
    intervals that were tried again, shorter. forced: those accepted although their contacts are
    off by more than they should be, because none shorter is allowed."""

    contacts: int = 0
    intervals: int = 0
    rounds: int = 0
    solves: int = 0
    repeated: int = 0
    forced: int = 0
    depth: float = 0.0
    residual: float = 0.0
    settled_depth: float = 0.0
    rest_depth: float = 0.0
    shortest: float = field(default=np.inf)

    def add(self, report: ContactReport, step: float, off: bool) -> None:
        self.contacts = max(self.contacts, report.contacts)
        self.intervals += 1
        self.rounds += report.rounds
        self.solves += report.solves
        self.depth = max(self.depth, report.depth)
        self.residual = max(self.residual, report.residual)
        self.shortest = min(self.shortest, step)
        self.forced += int(off)


class ShotContact:
    """Advances all batches of a shot together.

    options: of all feathers. solvers: of the batches. members: per batch, places in the groom.
    feathers: as simulated, batch after batch. obstacles: what else they meet, bodies behind all
    others.
    """

    def __init__(
        self,
        shot: Shot,
        options: ShotOptions,
        solvers: Sequence[Solver],
        members: Sequence[NDArray[np.int64]],
        feathers: Sequence[Feather],
        obstacles: Obstacles,
    ) -> None:
        assert shot.contact is not None
        self.shot, self.contact, self._obstacles = shot, shot.contact, obstacles
        solvers = [*solvers, *(each.solver for each in obstacles.batches)]
        members = [*members, *(each.members for each in obstacles.batches)]
        feathers = [*feathers, *(one for each in obstacles.batches for one in each.feathers)]
        self._order = order = np.concatenate(members)
        placements = [shot.groom.feathers[k] for k in order]
        own = [options.feathers[k] for k in order]
        self.names = [placement.id for placement in placements]
        thickness = thicknesses(placements, self.contact)
        rest = at_rest(feathers, placements)
        models, halves = [solver.model for solver in solvers], 0.5 * thickness
        grids = grids_of(models)
        every = layered_pairs(rest, surfaces_of(shapes_of(models), grids, halves), grids)
        crossed = every.through(thickness)
        self._crossed = self._through_each_other(every.pairs[crossed], every.crossed[crossed])
        others = obstacles.may_touch(every.pairs, order) & ~crossed
        candidates = Candidates(every.pairs[others], every.order[others], every.depth[others])
        self._thickness = thickness
        _warn_of_crossed(self._crossed, bool((rest.ranks >= 0).any()))
        settings = ContactSettings(
            friction=self.contact.friction,
            margin=MARGIN * float(thickness.max()),
            tolerance=min(each.contact_tolerance or 0.0 for each in own),
            newton=own[0].unpressed_newton_tolerance or 0.0,
            frame=1.0 / shot.frames_per_second,
            deepest=np.maximum(4.0 * thickness, DEEP * rest.lengths),
        )
        self.solver = ContactSolver(solvers, candidates, halves, settings)
        led = np.arange(len(order)) >= len(order) - obstacles.count
        self._at_rest = len(candidates.pairs)
        self._raised = np.where(led, 0.0, every.raised)
        self._encounters = Encounters(every.pairs, len(placements))
        self.tally = Tally()
        above = [
            raised_points(*each)
            for each in zip(rest.nodes, placements, self._raised.tolist(), strict=True)
        ]
        nodes = [np.stack(above[low:high]) for low, high in pairwise(grids.first)]
        up = np.where(self._raised[:, None] > 0.0, rest.dorsal, 0.0)
        over = FeathersOver(np.where(led, -1, order), grids.together(nodes), rest.lengths, up)
        self.bodies = Bodies(shot, over)
        self._rules = self._step_rules(own[0].max_substeps)
        self._pace, self._patience = StepPacing(), np.full(len(self.names), float(MORE_ITERATIONS))
        self._unresolved: list[dict[str, Any]] = []
        self._has_passed = False
        self._yielded = np.zeros(len(self.names), dtype=np.bool_)

    def _step_rules(self, substeps: int) -> StepRules:
        return StepRules(
            steps=self.contact.steps,
            substeps=substeps,
            tolerance=np.repeat(
                [solver.settings.tolerance for solver in self.solver.solvers],
                np.diff(self.solver.grids.first),
            ),
            thickness=np.maximum(self._thickness, 2.0 * self.solver.settings.tolerance),
            rounds=self.solver.settings.rounds,
            iterations=MAX_INTERVAL_WORK,
            names=self.names,
        )

    @property
    def limits(self) -> dict[str, int]:
        """Return the limits of the number of steps, by keys of the shot."""
        if self.contact.steps:
            return {"[contact] steps": self.contact.steps}
        substeps = self._rules.substeps
        is_own = substeps == self.contact.max_steps
        return {"[contact] max_steps" if is_own else "max_substeps": substeps}

    def advance(
        self,
        states: Sequence[State],
        loads_of: LoadsOf,
        paths_of: PathsOf,
        start: float,
        end: float,
        resting: Flags,
    ) -> tuple[list[State], list[StepReport]]:
        """Advance all batches from start to end (s); the given states are not changed.

        loads_of, paths_of: what acts from one time to another, per batch. resting: (B,) feathers at
        rest on which nothing acts anew; they are stepped when others push them.
        """
        steps = FrameSteps(self._rules, start, end, self._pace, self._patience)
        obstacles, grids = self._obstacles, self.solver.grids
        around = SpanInputs(
            lambda begin, stop: [*loads_of(begin, stop), *obstacles.loads()],
            lambda begin, stop: [*paths_of(begin, stop), *obstacles.paths()],
            self.bodies,
        )
        self.solver.begin_frame()
        stepper = Stepper(self.solver, self._rules, around, steps.spend, steps.tired)
        current, parts = list(states), []
        resting = np.concatenate([resting, np.ones(obstacles.count, dtype=np.bool_)])
        while steps.left():
            span = steps.span
            ends = obstacles.go(current, span.start, span.end)
            whole = [*current, *obstacles.states]
            self._meet(whole, around.paths(span.start, span.end), span.length)
            done = stepper.step(whole, span, resting, obstacles.led(grids, whole, ends))
            obstacles.arrive(ends)
            steps.accepted(done.states, done.reports, done.contact[0][1], done.tries > 0)
            current, reports = obstacles.solved(done.states), done.reports[: len(states)]
            current = _slept(current, reports, span.length)
            resting &= np.concatenate([report.steps for report in done.reports]) == 0.0
            self.bodies.begun = True
            for length, contact in done.contact:
                self.tally.add(contact, length, bool(self._rules.wrong(contact).any()))
            self.tally.repeated += done.tries
            parts.append(reports)
        self._pace, self._patience = steps.pace, steps.next_patience()
        self._note_passed(f"in the frame from {start:.4g} s on")
        _warn_of(stepper.yielded & ~self._yielded, self.names, start)
        self._yielded |= stepper.yielded
        return current, [_summed(batch) for batch in zip(*parts, strict=True)]

    def _meet(self, states: Sequence[State], paths: Sequence[RootPath], duration: float) -> None:
        """Take on pairs of feathers that come to meet within a duration (s)."""
        pairs = self._encounters.new(states, paths, duration, self.solver.settings.margin)
        pairs = pairs[self._obstacles.may_touch(pairs, self._order)]
        if len(pairs):
            self.solver.add_pairs(pairs)

    def stirred(self, states: Sequence[State], start: float, end: float) -> bool:
        """Return whether a moving body comes near any feather from start to end (s), or an
        obstacle's root moves."""
        margin = self.solver.settings.margin
        return not self._obstacles.still(start, end) or self.bodies.approach(
            states, start, end, margin
        )

    def settle(self, states: Sequence[State], loads: Sequence[Loads]) -> list[State]:
        """Bring layered feathers to rest against each other by long damped steps."""
        obstacles = self._obstacles
        found = settled_together(
            self.solver,
            self.bodies,
            [*states, *obstacles.states],
            [*loads, *obstacles.loads()],
            self.names,
            self._raised,
            obstacles,
        )
        self._note_passed("where the shot begins")
        self.tally.rest_depth, self.tally.settled_depth = found.rest_depth, found.depth
        self._unresolved = self._still_deep()
        warn_of_unsettled(found, self.names, self._unresolved)
        return obstacles.solved(found.states)

    def _note_passed(self, when: str) -> None:
        """Take pairs that passed to those that are through each other, and say so of those of
        settling and of the first that follow."""
        passed = self.solver.passed
        if passed:
            pairs, depths = (np.concatenate(each) for each in zip(*passed, strict=True))
            passed.clear()
            crossed = self._through_each_other(pairs, depths)
            self._crossed = sorted([*self._crossed, *crossed], key=lambda each: -each["depth"])
            if not self._has_passed:
                _warn_of_passing(crossed, when)
            self._has_passed = self.tally.intervals > 0

    def _still_deep(self) -> list[dict[str, Any]]:
        """Pairs that are in each other by more than the tolerance, the deepest first."""
        guests, hosts, depths = self.solver.depths()
        worst: dict[tuple[str, str], float] = {}
        for guest, host, depth in zip(
            guests.tolist(), hosts.tolist(), depths.tolist(), strict=True
        ):
            first, second = sorted((guest, host)) if host >= 0 else (guest, host)
            pair = self.names[first], self.names[second] if second >= 0 else "a collider"
            worst[pair] = max(worst.get(pair, 0.0), depth)
        return _deepest_first(worst, self.solver.settings.tolerance)

    def _through_each_other(self, pairs: Indices, depth: Array) -> list[dict[str, Any]]:
        """Pairs (N, 2) that are through each other at rest by a depth (N,), in m, and stay so."""
        worst: dict[tuple[str, str], float] = {}
        for both, own in zip(np.sort(pairs, axis=1).tolist(), depth, strict=True):
            pair = self.names[both[0]], self.names[both[1]]
            worst[pair] = max(worst.get(pair, 0.0), float(own))
        return _deepest_first(worst, 0.0)

    def report(self) -> dict[str, Any]:
        """Figures of the contact so far, in SI units."""
        tally = self.tally
        return {
            "bodies": self.bodies.count,
            "nodes_grown_into_bodies": int(np.count_nonzero(self.solver.memory.inside & GROWN_IN)),
            "obstacles": self._obstacles.count,
            "pairs": len(self.solver.candidates.pairs) // 2,
            "ordered_pairs": int(np.count_nonzero(self.solver.candidates.order)) // 2,
            "most_contacts": tally.contacts,
            "steps": tally.intervals,
            "repeated_steps": tally.repeated,
            "steps_with_contacts_off": tally.forced,
            "feathers_whose_contacts_yielded": int(np.count_nonzero(self._yielded)),
            "shortest_step": tally.shortest if tally.intervals else 0.0,
            "mean_rounds": tally.rounds / max(tally.intervals, 1),
            "feather_solves": tally.solves,
            "feathers_raised_before_settling": int(np.count_nonzero(self._raised)),
            "depth_at_rest": tally.rest_depth,
            "depth_after_settling": tally.settled_depth,
            "crossed_pairs": len(self._crossed),
            "crossed": self._crossed[:MAX_NAMED],
            "unresolved_pairs": len(self._unresolved),
            "unresolved": self._unresolved[:MAX_NAMED],
            "worst_depth": tally.depth,
            "worst_residual": tally.residual,
        }

    def memory(self) -> dict[str, Any]:
        """Return the arrays that are kept between frames, for checkpoints."""
        known = {
            "pace": np.array(self._pace),
            "patience": self._patience,
            "met": self.solver.candidates.pairs[self._at_rest :],
            "passing": np.flatnonzero(np.isinf(self.solver.candidates.depth)),
        }
        return self.solver.memory._asdict() | known | self._obstacles.memory()

    def restore(self, memory: dict[str, Any]) -> None:
        """Take over what `memory` gave."""
        if len(memory["met"]):
            self.solver.add_pairs(memory["met"])
            self._encounters.know(memory["met"])
        self.solver.let_pass(memory["passing"])
        self.go_on(memory)
        self.bodies.begun = True

    def go_on(self, memory: dict[str, Any]) -> None:
        """Go on as after an earlier step of this run, whose `memory` it was; pairs that have met
        since stay known."""
        self.solver.memory = ContactMemory(*(memory[name] for name in ContactMemory._fields))
        self._pace, self._patience = StepPacing(*memory["pace"].tolist()), memory["patience"]
        self._obstacles.restore(memory)


def _deepest_first(depths: Mapping[tuple[str, str], float], least: float) -> list[dict[str, Any]]:
    """Pairs by name that are deeper than the least (m), as a report has them."""
    left = sorted((-depth, *pair) for pair, depth in depths.items() if depth > least)
    return [{"feather": one, "other": other, "depth": -depth} for depth, one, other in left]


def _warn_of_crossed(crossed: Sequence[Mapping[str, Any]], laid: bool) -> None:
    """Say which feathers stay through each other. laid: whether a layout laid any."""
    helps = (
        "Move or turn one, or take a finer quality, which draws a [layout] more closely"
        if laid
        else "Move one, or give a row a larger `roll`, so that each lies over the next. A [layout]"
        " lays feathers of regions"
    )
    if crossed:
        first, more = crossed[0], len(crossed) - 1
        warnings.warn(
            f"contact: feathers '{first['feather']}' and '{first['other']}' pass through each other"
            f" at rest, by {1e3 * first['depth']:.2g} mm"
            + (f", and so do {more} more pairs" if more else "")
            + f". They stay as they are drawn, and nothing pushes them apart. {helps}",
            InputWarning,
            stacklevel=2,
        )


def _warn_of_passing(crossed: Sequence[Mapping[str, Any]], when: str) -> None:
    """Say which feathers are let pass, and when they came to be through each other."""
    first, more = crossed[0], len(crossed) - 1
    warnings.warn(
        f"contact: feathers '{first['feather']}' and '{first['other']}' are"
        f" {1e3 * first['depth']:.2g} mm through each other {when}"
        + (f", and so are {more} more pairs" if more else "")
        + ". Nothing pushes them apart from there on. The report counts all that follow. Keep the"
        " skin and their roots apart there, or let kinds or regions in [contact] name only what has"
        " to push",
        InputWarning,
        stacklevel=2,
    )


def _warn_of(yielded: Flags, names: Sequence[str], time: float) -> None:
    """Warn of feathers (B,) without balance, or contacts, first in the frame from a time (s) on."""
    if yielded.any():
        more = f" and {int(yielded.sum()) - 1} more" if yielded.sum() > 1 else ""
        warnings.warn(
            f"contact: feather '{names[int(np.flatnonzero(yielded)[0])]}'{more} found no balance"
            f" with what touches it in the frame from {time:.4g} s on. It kept its pose there for"
            " a while, or went on without contacts: others may pass it. Less wind or slower roots"
            " help",
            InputWarning,
            stacklevel=2,
        )


def _slept(states: Sequence[State], reports: Sequence[StepReport], duration: float) -> list[State]:
    """The states after a step (s) in which some feathers were not solved: their time goes on."""
    return [
        state if report.steps.all() else skip_frame(state, report.steps == 0.0, duration)
        for state, report in zip(states, reports, strict=True)
    ]


def _summed(parts: Sequence[StepReport]) -> StepReport:
    """Reports of one batch's steps within a frame as one: counts add, the rest is the largest."""
    columns = {}
    for name in StepReport._fields:
        values = np.stack([getattr(part, name) for part in parts])
        columns[name] = values.max(axis=0) if name in LARGEST_FIGURES else values.sum(axis=0)
    return StepReport(**columns)
