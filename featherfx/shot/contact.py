"""Contact in the frame loop: all feathers of a shot in common steps.

Within a frame the feathers that touch must know of each other at the same times, so they take
common steps: a given number per frame, or as many as most of them need to keep to the quality's
tolerance; the others divide these into steps of their own, while what they touch moves evenly.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from featherfx.feather.types import Feather
from featherfx.mechanics.model import Loads
from featherfx.shot.contact_bodies import Bodies
from featherfx.shot.contact_pairs import candidate_pairs, normal_of, order_at_rest
from featherfx.shot.contact_settle import settled_together
from featherfx.shot.placement import place
from featherfx.shot.sleep import asleep
from featherfx.shot.types import Shot
from featherfx.solver.contact import ContactReport, ContactSettings, ContactSolver
from featherfx.solver.contact_surfaces import Memory, grids_of_models, skin_of
from featherfx.solver.newton_kernels import TOO_MUCH_WORK
from featherfx.solver.root_path import RootPath
from featherfx.solver.state import State
from featherfx.solver.step import Solver, StepReport, raise_if_failed

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]
LoadsOf = Callable[[float, float], Sequence[Loads]]
PathsOf = Callable[[float, float], Sequence[RootPath]]

# a step that cannot be solved is cut by this share, to that of the shortest regular one at least
CUT, SMALLEST_SHARE = 0.25, 1.0 / 16.0
# misfit of a step's contacts, over the thickness, beyond which it is cut to the shortest regular
# one, and beyond which it is cut further
WRONG_SHARE, BAD_SHARE = 0.5, 2.0
# what a gap may be off: a share of the quality's tolerance, between these of the thickness
OFF_SHARE, LEAST_SHARE, MOST_SHARE = 0.05, 0.1, 0.4
# smallest followed gap, in thicknesses
MARGIN_SHARE = 6.0
# share of the feathers that should need no more than one step of their own in a common one
FEW_STEPS = 0.8
# Newton iterations of a feather in a frame, over Settings.max_iterations: it is solved in rounds
MORE_ITERATIONS = 8
# pairs named in a report
MOST_NAMED = 10


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

    def add(self, report: ContactReport, step: float) -> None:
        self.contacts = max(self.contacts, report.contacts)
        self.intervals += 1
        self.rounds += report.rounds
        self.solves += report.solves
        self.depth = max(self.depth, report.depth)
        self.residual = max(self.residual, report.residual)
        self.shortest = min(self.shortest, step)


class ShotContact:
    """Advances all batches of a shot together.

    solvers: of the batches. members: per batch, places in the groom. feathers: as simulated, batch
    after batch.
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
            tolerance=self._tolerance(),
        )
        self.solver = ContactSolver(solvers, pairs, sides, halves, settings)
        self.tally = Tally()
        self._bodies = Bodies(shot, float(lengths.max()))
        self._proposal = 0.0
        self._unresolved: list[dict[str, Any]] = []

    def _tolerance(self) -> float:
        """m, what a gap may be off."""
        least, most = LEAST_SHARE * self._thickness, MOST_SHARE * self._thickness
        return float(np.clip(OFF_SHARE * self.shot.quality.tolerance, least, most))

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
        quality, duration = self.shot.quality, end - start
        steps = self.contact.steps
        shortest = duration / (steps or quality.max_substeps)
        h = shortest if steps else min(self._proposal or duration, duration)
        time, current, parts = start, list(states), []
        spent, resting = np.zeros(len(self.names)), resting.copy()
        yielding: Flags | None = None
        while time < end - 1e-9 * duration:
            left = end - time
            step = left if h > 0.999 * left else (0.5 * left if h > 0.6 * left else h)
            stop = end if step == left else time + step
            substeps = 1 if steps else max(1, round(step / shortest))
            walls = self._bodies.walls(current, time, stop, self.solver.settings.margin)
            loads, paths = loads_of(time, stop), paths_of(time, stop)
            new, reports, contact = self.solver.interval(
                current, loads, paths, stop - time, walls, substeps, resting, yielding
            )
            spent += np.concatenate([report.iterations for report in reports])
            status = np.concatenate([report.status for report in reports])
            if self._again(status, contact, step, shortest):
                self._stop_at_limit(spent, time)
                self.tally.repeated += 1
                h = CUT * step if status.any() else 0.5 * step
                if h < SMALLEST_SHARE * shortest:
                    if yielding is not None:
                        raise_if_failed(status, np.full(len(status), time), self.names)
                    yielding, h = status != 0.0, step
                continue
            self._stop_at_limit(spent, time)
            current, time = _slept(new, reports, paths, stop - time), stop
            resting &= np.concatenate([report.steps for report in reports]) == 0.0
            self.solver.accept()
            self._bodies.begun = True
            self.tally.add(contact, step)
            self.tally.forced += int(contact.residual > WRONG_SHARE * self._thickness)
            yielding = None
            parts.append(reports)
            easy = contact.rounds <= self.solver.settings.rounds
            h = min(shortest, 2.0 * step if easy else step)
            if not steps:
                h = max(h, step * self._change(reports))
        self._proposal = h
        return current, [_summed(batch) for batch in zip(*parts, strict=True)]

    def _again(self, status: Array, contact: ContactReport, step: float, shortest: float) -> bool:
        """Whether a step is to be tried again, shorter."""
        wrong, bad = contact.residual > np.array([WRONG_SHARE, BAD_SHARE]) * self._thickness
        least = 1.001 * shortest
        if bad:
            least = 2.0 * SMALLEST_SHARE * shortest
        return bool(status.any()) or (bool(wrong) and step > least)

    def _stop_at_limit(self, spent: Array, time: float) -> None:
        """SimulationError for a feather that took too many Newton iterations in a frame."""
        most = MORE_ITERATIONS * self.solver.solvers[0].settings.max_iterations
        raise_if_failed(
            np.where(spent > most, TOO_MUCH_WORK, 0), np.full(len(spent), time), self.names, most
        )

    def _change(self, reports: Sequence[StepReport]) -> float:
        """Factor from this common step to the next: most feathers should need one of their own."""
        steps = np.concatenate([report.steps for report in reports])
        error = np.concatenate([report.error for report in reports])
        awake = steps > 0.0
        if not awake.any():
            return 2.0
        need = float(np.quantile(steps[awake], FEW_STEPS))
        if need > 1.0:
            return max(0.25, 1.0 / need)
        off = max(float(np.quantile(error[awake], FEW_STEPS)), 1e-30)
        change = 0.9 * (self.shot.quality.tolerance / off) ** (1.0 / 3.0)
        return float(min(2.0, max(0.5, change)))

    def settle(self, states: Sequence[State], loads: Sequence[Loads]) -> list[State]:
        """Bring layered feathers to rest against each other by long damped steps."""
        found = settled_together(self.solver, self._bodies, states, loads, self.names)
        self.tally.rest_depth, self.tally.settled_depth = found.rest_depth, found.depth
        self._unresolved = self._still_deep()
        return found.states

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
            "repeated_steps": tally.repeated,
            "steps_with_contacts_off": tally.forced,
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


def _slept(
    states: Sequence[State],
    reports: Sequence[StepReport],
    paths: Sequence[RootPath],
    duration: float,
) -> list[State]:
    """The states after a step (s) in which some feathers were not solved: their time goes on."""
    return [
        asleep(state, report.steps == 0.0, path, duration)
        for state, report, path in zip(states, reports, paths, strict=True)
    ]


def _summed(parts: Sequence[StepReport]) -> StepReport:
    """Reports of one batch's steps within a frame as one: counts add, the rest is the largest."""
    columns = {}
    for name in StepReport.__dataclass_fields__:
        values = np.stack([getattr(part, name) for part in parts])
        largest = name in ("error", "move", "status")
        columns[name] = values.max(axis=0) if largest else values.sum(axis=0)
    return StepReport(**columns)
