"""Contact in the frame loop: all feathers of a shot in common steps.

Within a frame the feathers that touch must know of each other at the same times, so they take the
same steps: a given number per frame, or as many as keep the largest local error of any feather
below the quality's tolerance.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from featherfx.errors import InputError, Problem
from featherfx.feather.types import Feather
from featherfx.mechanics.model import Loads
from featherfx.shot.contact_bodies import Bodies
from featherfx.shot.contact_pairs import candidate_pairs, normal_of, order_at_rest
from featherfx.shot.detail import CARRIED, Resolution
from featherfx.shot.placement import place
from featherfx.shot.types import Shot
from featherfx.solver.contact import ContactReport, ContactSettings, ContactSolver
from featherfx.solver.contact_surfaces import Memory, grids_of_models, skin_of
from featherfx.solver.root_path import RootPath, hold_roots
from featherfx.solver.state import State
from featherfx.solver.step import Solver, StepReport, raise_if_failed

Array = NDArray[np.float64]
LoadsOf = Callable[[float, float], Sequence[Loads]]
PathsOf = Callable[[float, float], Sequence[RootPath]]

# a step that cannot be solved is cut to this share of the shortest regular one at least
SMALLEST_SHARE = 1.0 / 32.0
# a tolerable gap, and the smallest followed one, as shares of the thickness
TOLERANCE_SHARE, MARGIN_SHARE = 0.1, 8.0
# misfit of a step's contacts, as a share of the thickness, beyond which it is cut
WRONG_SHARE = 0.5
# pairs named in a report
MOST_NAMED = 10
# quasi-static steps that bring layered feathers into balance, s, and the most of each
SETTLING, SETTLING_STEPS = (0.01, 0.03, 0.1, 0.3, 1.0), 6
# what one that cannot be solved is cut to, and the shortest tried, s
SETTLING_CUT, SHORTEST_SETTLING = 0.25, 1e-5


@dataclass
class Tally:
    """Sums over a shot. contacts: most at once. depth: m, deepest penetration, after settling and
    in motion. residual: m, worst of an interval. rounds, intervals, solves: totals."""

    contacts: int = 0
    intervals: int = 0
    rounds: int = 0
    solves: int = 0
    depth: float = 0.0
    residual: float = 0.0
    settled_depth: float = 0.0
    rest_depth: float = 0.0
    shortest: float = field(default=np.inf)

    def add(self, report: ContactReport, step: float) -> None:
        self.contacts = max(self.contacts, report.contacts)
        self.intervals += 1
        self.rounds += report.rounds
        self.solves += report.solves
        self.depth = max(self.depth, report.depth)
        self.residual = max(self.residual, report.residual)
        self.shortest = min(self.shortest, step)


def common_grid(shot: Shot, resolutions: Sequence[Resolution]) -> list[Resolution]:
    """Resolutions of feathers that touch: all on the finest grid of any.

    Those that are not simulated touch nothing and are left as they are.

    Raises InputError where a feather is to be simulated more coarsely than the others.
    """
    moving = [each for each in resolutions if each.level not in CARRIED]
    if any(each.level != "full" for each in moving):
        message = "feathers that touch are simulated on one grid: use full, guided or rigid only"
        raise InputError(Problem(str(shot.source), "detail", message))
    rows = max((each.rows for each in moving), default=0)
    return [each if each.level in CARRIED else replace(each, rows=rows) for each in resolutions]


class ShotContact:
    """Advances all batches of a shot together.

    solvers: of the batches, with one step per call (max_substeps = 1). members: per batch, places
    in the groom. feathers: as simulated, batch after batch, all on one grid.
    """

    def __init__(
        self,
        shot: Shot,
        solvers: Sequence[Solver],
        members: Sequence[NDArray[np.int64]],
        feathers: Sequence[Feather],
    ) -> None:
        assert shot.contact is not None
        self.shot, self.contact = shot, shot.contact
        order = np.concatenate(members)
        placements = [shot.groom.feathers[k] for k in order]
        self.names = [placement.id for placement in placements]
        thickness = np.array([p.kind.vane_material.thickness for p in placements])
        if self.contact.thickness is not None:
            thickness[:] = self.contact.thickness
        rest = [
            place(f.points, p.position, p.rotation)
            for f, p in zip(feathers, placements, strict=True)
        ]
        normals = np.stack([normal_of(points) for points in rest])
        lengths = np.array([f.station[-1] for f in feathers])
        pairs = candidate_pairs(rest, lengths)
        halves = 0.5 * thickness
        models = [solver.model for solver in solvers]
        grids = grids_of_models(models)
        skin = skin_of(models, grids, halves)
        ranks = np.array([placement.rank for placement in placements])
        dorsal = np.stack([placement.rotation[:, 2] for placement in placements])
        batches = zip(grids.first[:-1], grids.first[1:], strict=True)
        together = grids.together([np.stack(rest[low:high]) for low, high in batches])
        sides = order_at_rest(pairs, together, normals, skin, lengths, ranks, dorsal)
        self._thickness = float(thickness.min())
        settings = ContactSettings(
            friction=self.contact.friction,
            margin=MARGIN_SHARE * float(thickness.max()),
            tolerance=TOLERANCE_SHARE * self._thickness,
        )
        self.solver = ContactSolver(solvers, pairs, sides, halves, settings)
        self.tally = Tally()
        self._bodies = Bodies(shot, float(lengths.max()))
        self._proposal = 0.0
        self._unresolved: list[dict[str, Any]] = []

    def advance(
        self,
        states: Sequence[State],
        loads_of: LoadsOf,
        paths_of: PathsOf,
        start: float,
        end: float,
    ) -> tuple[list[State], list[StepReport]]:
        """Advance all batches from start to end (s); the given states are not changed.

        loads_of, paths_of: what acts from one time to another, per batch.
        """
        quality, duration = self.shot.quality, end - start
        steps = self.contact.steps
        shortest = duration / (steps or quality.max_substeps)
        h = shortest if steps else min(self._proposal or duration, duration)
        smallest = SMALLEST_SHARE * shortest
        time, current, parts = start, list(states), []
        while time < end - 1e-9 * duration:
            left = end - time
            step = left if h > 0.999 * left else (0.5 * left if h > 0.6 * left else h)
            stop = end if step == left else time + step
            walls = self._bodies.walls(current, time, stop, self.solver.settings.margin)
            new, reports, contact = self.solver.interval(
                current, loads_of(time, stop), paths_of(time, stop), stop - time, walls
            )
            status = np.concatenate([report.status for report in reports])
            if status.any():
                h = 0.5 * step
                if h < smallest:
                    raise_if_failed(status, np.full(len(status), time), self.names)
                continue
            if contact.residual > WRONG_SHARE * self._thickness and step > smallest:
                # too much happens in the step for the rounds to converge
                h = 0.5 * step
                continue
            error = max(float(report.error.max()) for report in reports)
            change = 0.9 * (quality.tolerance / max(error, 1e-30)) ** (1.0 / 3.0)
            if not steps and error > quality.tolerance and step > 1.001 * shortest:
                h = max(shortest, step * max(0.2, change))
                continue
            current, time = new, stop
            self.solver.accept()
            self._bodies.begun = True
            self.tally.add(contact, step)
            parts.append(reports)
            h = shortest if steps else max(shortest, step * min(2.0, max(0.5, change)))
        self._proposal = h
        return current, [_summed(batch) for batch in zip(*parts, strict=True)]

    def settle(self, states: Sequence[State], loads: Sequence[Loads]) -> list[State]:
        """Bring layered feathers to rest against each other by long damped steps."""
        current = [_stopped(state) for state in states]
        first = True
        for longest in SETTLING:
            h = longest
            for _ in range(SETTLING_STEPS):
                new, contact, h = self._settling_step(current, loads, h)
                moved = max(
                    float(np.abs(a.points - b.points).max())
                    for a, b in zip(new, current, strict=True)
                )
                current = [_stopped(state) for state in new]
                self.solver.accept()
                self._bodies.begun = True
                if first:
                    self.tally.rest_depth, first = contact.start_depth, False
                self.tally.settled_depth = contact.depth
                if moved < self.solver.settings.tolerance and h == longest:
                    break
                h = min(longest, h / SETTLING_CUT)
        self._unresolved = self._still_deep()
        return current

    def _settling_step(
        self, states: Sequence[State], loads: Sequence[Loads], h: float
    ) -> tuple[list[State], ContactReport, float]:
        """One damped step of h (s), or of as much of it as can be solved; and its length."""
        while True:
            paths = [hold_roots(state) for state in states]
            walls = self._bodies.walls(states, 0.0, 0.0, self.solver.settings.margin)
            new, reports, contact = self.solver.interval(states, loads, paths, h, walls)
            status = np.concatenate([report.status for report in reports])
            if not status.any():
                return new, contact, h
            h *= SETTLING_CUT
            if h < SHORTEST_SETTLING:
                raise_if_failed(status, np.zeros(len(status)), self.names)

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
        left = sorted((-depth, *pair) for pair, depth in worst.items())
        tolerance = self.solver.settings.tolerance
        return [
            {"feather": feather, "other": other, "depth": -depth}
            for depth, feather, other in left
            if -depth > tolerance
        ]

    def report(self) -> dict[str, Any]:
        """Figures of the contact so far, in SI units."""
        tally = self.tally
        return {
            "bodies": len(self.shot.colliders),
            "nodes_grown_into_bodies": int(self.solver.memory.inside.sum()),
            "pairs": len(self.solver.pairs) // 2,
            "ordered_pairs": int(np.count_nonzero(self.solver.order)) // 2,
            "most_contacts": tally.contacts,
            "steps": tally.intervals,
            "shortest_step": tally.shortest if tally.intervals else 0.0,
            "mean_rounds": tally.rounds / max(tally.intervals, 1),
            "feather_solves": tally.solves,
            "depth_at_rest": tally.rest_depth,
            "depth_after_settling": tally.settled_depth,
            "unresolved_pairs": len(self._unresolved),
            "unresolved": self._unresolved[:MOST_NAMED],
            "worst_depth": tally.depth,
            "worst_residual": tally.residual,
        }

    def memory(self) -> dict[str, Any]:
        """What is kept between frames, for checkpoints."""
        return self.solver.memory._asdict() | {"step": np.array(self._proposal)}

    def restore(self, memory: dict[str, Any]) -> None:
        """Take over what `memory` gave."""
        self.solver.memory = Memory(*(memory[name] for name in Memory._fields))
        self._proposal = float(memory["step"])
        self._bodies.begun = True


def _stopped(state: State) -> State:
    new = state.copy()
    for rate in (new.velocity, new.acceleration, new.smoothed, new.spin, new.coefficient_rate):
        rate[:] = 0.0
    new.step[:] = 0.0
    new.time[:] = 0.0
    return new


def _summed(parts: Sequence[StepReport]) -> StepReport:
    """Reports of one batch's steps within a frame as one: counts add, the rest is the largest."""
    columns = {}
    for name in StepReport.__dataclass_fields__:
        values = np.stack([getattr(part, name) for part in parts])
        largest = name in ("error", "move", "status")
        columns[name] = values.max(axis=0) if largest else values.sum(axis=0)
    return StepReport(**columns)
