"""The frame loop: a shot in, frames of material points out."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from featherfx.errors import SimulationError
from featherfx.feather.build import build_feather
from featherfx.feather.types import Feather
from featherfx.mechanics.batch import make_model
from featherfx.shot.loads import frame_loads, root_path
from featherfx.shot.motion import Roots, root_motion
from featherfx.shot.types import Frame, Grip, Shot
from featherfx.solver.modes import with_damping
from featherfx.solver.state import State, rest_state
from featherfx.solver.step import Settings, Solver, StepReport, raise_if_failed

Array = NDArray[np.float64]

# Newton stops where a step moves nothing by more than this share of the step's tolerance
NEWTON_SHARE = 1e-3


@dataclass
class _Group:
    """Feathers that share a grid: their places in the groom, solver, state and grips."""

    members: NDArray[np.int64]
    feathers: list[Feather]
    names: list[str]
    grips: list[tuple[int, Grip]]
    solver: Solver
    state: State
    start: Array


class Simulation:
    """Iterates over the frames of a shot; `report` is complete after the last one.

    feathers: one per placement, in groom order. report: newton_iterations and substeps per
    feather and frame (mean, max), worst_residual (m, last Newton move), skipped work by kind.
    """

    def __init__(self, shot: Shot, jobs: int, frames: tuple[int, int] | None) -> None:
        self.shot, self._jobs = shot, jobs
        self._range = frames or (shot.first_frame, shot.last_frame)
        quality = shot.quality
        self.feathers: tuple[Feather, ...] = tuple(
            build_feather(p.kind, quality.rows, quality.columns, p.mirrored)
            for p in shot.groom.feathers
        )
        self._reports: list[StepReport] = []

    @property
    def report(self) -> dict[str, Any]:
        """Counts over all feathers and frames so far."""
        return {
            "newton_iterations": _mean_and_max([r.iterations for r in self._reports]),
            "substeps": _mean_and_max([r.steps for r in self._reports]),
            "rejected_substeps": int(sum(r.rejected.sum() for r in self._reports)),
            "worst_residual": max((float(r.move.max()) for r in self._reports), default=0.0),
            "worst_step_error": max((float(r.error.max()) for r in self._reports), default=0.0),
            "skipped": {},
        }

    def __iter__(self) -> Iterator[Frame]:
        shot = self.shot
        motion = root_motion(shot)
        groups = self._groups(motion)
        try:
            for number in range(shot.first_frame, self._range[1] + 1):
                time = (number - shot.first_frame) / shot.frames_per_second
                for group in groups:
                    self._advance(group, motion, number, time)
                if number >= self._range[0]:
                    yield self._frame(groups, number, time)
        finally:
            for group in groups:
                group.solver.__exit__()

    def _groups(self, motion: Roots) -> list[_Group]:
        """Batches of feathers whose barbs have the same taper, at rest on their roots."""
        placements = self.shot.groom.feathers
        tapers: dict[float, list[int]] = {}
        for index, placement in enumerate(placements):
            tapers.setdefault(placement.kind.vane_material.barb_taper, []).append(index)
        return [self._group(np.array(members), motion) for members in tapers.values()]

    def _group(self, members: NDArray[np.int64], motion: Roots) -> _Group:
        shot, quality = self.shot, self.shot.quality
        placements = [shot.groom.feathers[i] for i in members]
        feathers = [self.feathers[i] for i in members]
        kinds = [p.kind for p in placements]
        model = with_damping(make_model(feathers, kinds, quality.coefficients), kinds)
        positions, rotations = motion.frames(0.0)
        state = rest_state(model, positions[members], rotations[members])
        place = {p.id: k for k, p in enumerate(placements)}
        settings = Settings(
            tolerance=quality.tolerance,
            newton=NEWTON_SHARE * quality.tolerance,
            max_substeps=quality.max_substeps,
        )
        return _Group(
            members=members,
            feathers=feathers,
            names=[p.id for p in placements],
            grips=[(place[g.feather], g) for g in shot.grips if g.feather in place],
            solver=Solver(model, settings, self._jobs),
            state=state,
            start=state.points.copy(),
        )

    def _advance(self, group: _Group, motion: Roots, number: int, time: float) -> None:
        """Bring a group to the frame with this number, at this time."""
        shot = self.shot
        duration = 1.0 / shot.frames_per_second
        first = number == shot.first_frame
        start = 0.0 if first else time - duration
        points = list(group.start)
        roots = None
        if shot.wind_source is not None:
            roots = motion.frames(0.5 * (start + time))[0][group.members]
        loads = frame_loads(shot, group.grips, group.feathers, points, start, time, roots)
        if first:
            if shot.settle:
                group.state, status, _ = group.solver.equilibrium(group.state, loads)
                raise_if_failed(status, group.state.time, group.names)
                group.start = group.state.points.copy()
            return
        path = root_path(motion, group.members, start, time)
        group.state, report = group.solver.step(group.state, loads, path, duration)
        self._reports.append(report)
        raise_if_failed(report.status, group.state.time, group.names)

    def _frame(self, groups: list[_Group], number: int, time: float) -> Frame:
        points: list[Array] = [np.zeros(0)] * len(self.feathers)
        velocities: list[Array] = [np.zeros(0)] * len(self.feathers)
        for group in groups:
            for k, member in enumerate(group.members):
                points[member] = group.state.points[k]
                velocities[member] = group.state.velocity[k]
                if not np.isfinite(points[member]).all():
                    raise SimulationError(group.names[k], time, "a point is not finite")
        return Frame(number, time, tuple(points), tuple(velocities))


def simulate(shot: Shot, jobs: int = 1, frames: tuple[int, int] | None = None) -> Simulation:
    """Simulate a shot.

    jobs: threads. frames: first and last of those wanted, inclusive; default: all of the shot's.
    Those before are simulated, too, because the motion depends on its past. Raises InputError
    where a feather cannot be built and, while iterating, SimulationError.
    """
    return Simulation(shot, jobs, frames)


def _mean_and_max(counts: list[Array]) -> dict[str, float]:
    if not counts:
        return {"mean": 0.0, "max": 0.0}
    joined = np.concatenate(counts)
    return {"mean": float(joined.mean()), "max": float(joined.max())}
