"""The batches within one interval of contact: feathers are solved several times over."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from featherfx.algebra.rotation import vectors_to_frames
from featherfx.jit.team import new_team
from featherfx.jit.views import Held, Kind, Views, views_of
from featherfx.mechanics.model import Contacts, Loads, wind_of_each
from featherfx.solver.contact.surfaces import Grids
from featherfx.solver.contact.sweep_kernels import (
    KINDS,
    Batches,
    Colours,
    Islands,
    Marks,
    Sweep,
    solve_rounds,
)
from featherfx.solver.settle.take_up import carry_to
from featherfx.solver.solver import COARSE, HARD, NEWTON_ITERATIONS, Solver
from featherfx.solver.state import State, StepReport, no_steps
from featherfx.solver.step.retry_kernels import StepSettings
from featherfx.solver.step.root_path import RootPath
from featherfx.solver.work import kept_matrices, make_work

Array = NDArray[np.float64]
Indices = NDArray[np.int64]
Flags = NDArray[np.bool_]
Bytes = NDArray[np.int8]

# bodies of an island that one thread solves by itself, over its share of all, at most
UNEVEN = 1.2


class Team:
    """Threads that sweep over batches, and what each of them and each batch needs for that.

    solvers: of the batches, with the same settings. grids: theirs. jobs: threads.
    """

    def __init__(self, solvers: Sequence[Solver], grids: Grids, jobs: int) -> None:
        self.solvers, self.grids, self.jobs = tuple(solvers), grids, jobs
        self._pool = ThreadPoolExecutor(jobs - 1) if jobs > 1 else None
        models = [solver.model for solver in solvers]
        self.models = views_of(models)
        self.works = views_of([make_work(model) for _ in range(jobs) for model in models])
        self.kept = views_of([kept_matrices(model) for model in models])
        counts = np.diff(grids.first)
        self.batch = np.repeat(np.arange(len(models)), counts)
        self.place = np.concatenate([np.arange(count) for count in counts])
        self._entries: dict[tuple[Kind, ...], Callable[..., None]] = {}

    def forget(self) -> None:
        """Begin anew with all matrices, as a bake does that goes on from here."""
        for kept in self.kept.tuples:
            kept.matrices.pace[:], kept.hard[:] = 0.0, 0

    def solve(self, sweep: Sweep) -> None:
        """All rounds of a sweep, by all threads."""
        counters, size = new_team(KINDS), self.jobs
        # of the types in a sweep only those of views may change, and it takes long to tell them
        kinds = tuple(each.kind for each in sweep.batches if isinstance(each, Views))
        if kinds not in self._entries:
            types = tuple(map(solve_rounds.typeof_pyval, (0, counters, size, sweep)))
            self._entries[kinds] = solve_rounds.compile(types)
        rounds = self._entries[kinds]
        pool = self._pool
        others = [pool.submit(rounds, k, counters, size, sweep) for k in range(1, size) if pool]
        rounds(0, counters, size, sweep)
        for other in others:
            other.result()

    def loads(self, loads: Sequence[Loads], room: int) -> Held:
        """The loads of the batches, for each thread with room for contacts of one feather."""
        windy = [
            wind_of_each(each, solver.model.feathers)
            for each, solver in zip(loads, self.solvers, strict=True)
        ]
        found = []
        for _ in range(self.jobs):
            planes = _planes(room)
            for each, solver in zip(windy, self.solvers, strict=True):
                first = np.zeros(solver.model.feathers + 1, dtype=np.int64)
                found.append(each._replace(contacts=planes._replace(first=first)))
        return views_of(found)


class Run:
    """Where the batches started, and where the last iterate stands.

    duration: s. substeps: most regular steps of a feather within it. iterations: of Newton in one
    solve of a feather, at most. free: (B,) feathers that are solved; the states of others are
    zero. shares: (B, n, 1 + 2 m), part of its root's way that a node goes along by itself. start,
    now: (B, n, 1 + 2 m, 3) m, nodes of all bodies on the widest grid, now at first where they are
    headed. report: of all solves and bodies. alone: settings of feathers that nothing presses.
    """

    def __init__(
        self,
        team: Team,
        states: Sequence[State],
        loads: Sequence[Loads],
        paths: Sequence[RootPath],
        duration: float,
        substeps: int,
        iterations: int,
        free: Flags,
        shares: Array,
    ) -> None:
        self._team, self.duration, self._loads = team, duration, loads
        grids, bodies = team.grids, pairwise(team.grids.first)
        own = [free[low:high] for low, high in bodies]
        self.old = [_rows_of(state, some) for state, some in zip(states, own, strict=True)]
        for solver, state, path, some in zip(team.solvers, self.old, paths, own, strict=True):
            carry_to(solver.model, state, path, some)
        self.new = [_rows_of(state, some) for state, some in zip(self.old, own, strict=True)]
        self.start = grids.together([state.points.nodes for state in self.old], free)
        velocity = grids.together([state.velocity.nodes for state in self.old], free)
        carried = grids.together(
            [_carried(*each) for each in zip(self.old, paths, own, strict=True)], free
        )
        ahead, self.now = self.start[free] + duration * velocity[free], self.start.copy()
        self.now[free] = ahead + shares[free, ..., None] * (carried[free] - ahead)
        self.solves = np.zeros(grids.bodies, dtype=np.int64)
        self.report = no_steps(grids.bodies)
        self._step = self.alone = self._step_settings(substeps, iterations)
        self._old, self._new = views_of(self.old), views_of(self.new)
        self._rows = [views_of([_rows(each) for each in states]) for states in (self.old, self.new)]
        self._paths, self._reports = views_of(paths), views_of(self.reports())

    def _step_settings(self, substeps: int, iterations: int) -> StepSettings:
        every = [solver.settings for solver in self._team.solvers]
        settings = every[0]  # which differ in nothing but how far steps may err
        return StepSettings(
            duration=float(self.duration),
            shortest=float(self.duration / substeps),
            spectral_radius=float(settings.spectral_radius),
            tolerance=min(float(each.tolerance) for each in every),
            coarse=COARSE,
            newton=min(float(each.newton) for each in every),
            iterations=NEWTON_ITERATIONS,
            hard=HARD,
            most_iterations=min(settings.max_iterations, iterations),
        )

    def marks(self, island: Indices, fresh: Flags, soft: Bytes) -> Marks:
        """Bodies of some islands (B,), -1 for those that are not solved. fresh, soft: of Marks."""
        return Marks(
            mine=(island >= 0).astype(np.int8),
            island=island,
            fresh=fresh.astype(np.int8),
            soft=soft,
            active=np.zeros(len(island), dtype=np.int8),
            worst=np.zeros(len(island)),
            depth=np.zeros(len(island)),
            solves=self.solves,
            status=self.report.status,
        )

    def batches(self, room: int) -> tuple[Batches, Held]:
        """All batches, with room for so many contacts of one feather; and the loads, which must be
        held as long as these are used."""
        team, loads = self._team, self._team.loads(self._loads, room)
        batches = Batches(
            batch=team.batch,
            place=team.place,
            model=team.models.views,
            old=self._old.views,
            new=self._new.views,
            rows_old=self._rows[0].views,
            rows_new=self._rows[1].views,
            path=self._paths.views,
            report=self._reports.views,
            kept=team.kept.views,
            loads=loads.views,
            work=team.works.views,
        )
        return batches, loads

    @property
    def step(self) -> StepSettings:
        """Of the feathers within the interval; coarse over the feather's length."""
        return self._step

    def failed(self) -> Flags:
        """(B,) feathers that could not be solved."""
        return np.asarray(self.report.status != 0.0)

    def reports(self) -> list[StepReport]:
        """Per batch, all solves of the interval as one report: counts add, the last error holds."""
        return [
            StepReport(*(each[low:high] for each in self.report))
            for low, high in pairwise(self._team.grids.first)
        ]


def islands_before(count: int, island: Indices, jobs: int) -> Islands:
    """So many islands with all rounds before them. island: (B,) of each body, -1 for none. jobs:
    threads."""
    bodies = np.argsort(island, kind="stable")[np.count_nonzero(island < 0) :]
    sizes = np.bincount(island[bodies], minlength=count)
    order = np.argsort(-sizes, kind="stable")
    return Islands(
        rounds=np.zeros(count, dtype=np.int64),
        worst=np.zeros(count),
        open=np.ones(count, dtype=np.int8),
        bodies=bodies,
        first=np.concatenate([[0], np.cumsum(sizes)]),
        alone=order[sizes[order] * jobs <= UNEVEN * max(1, len(bodies))] if jobs > 1 else order,
    )


def no_colours(bodies: int) -> Colours:
    """Scratch for the colours of so many bodies."""
    return Colours(
        bodies=np.zeros(bodies, dtype=np.int64),
        first=np.zeros(bodies + 2, dtype=np.int64),
        number=np.zeros(1, dtype=np.int64),
        colour=np.zeros(bodies, dtype=np.int64),
        taken_by=np.zeros(bodies + 1, dtype=np.int64),
    )


def _rows_of(state: State, free: Flags) -> State:
    """A copy of some feathers (F,) of a state; the others are zero, and cost nothing."""
    if free.all():
        return state.copy()
    arrays = {}
    for name, array in state.arrays().items():
        # unlike zeros_like, this touches no memory yet
        arrays[name] = np.zeros(array.shape, array.dtype)
        arrays[name][free] = array[free]
    return State.of(arrays)


def _carried(state: State, path: RootPath, free: Flags) -> Array:
    """(F, n, 1 + 2 m, 3) m, nodes of some feathers (F,) carried rigidly to where their roots' paths
    end, as if every feather had one; zero of the others."""
    nodes, samples = state.points.nodes[free], path.samples[free]
    turns = vectors_to_frames(samples[:, -1, 3:])
    away = (nodes - samples[:, :1, None, :3]) @ turns.swapaxes(1, 2)[:, None]
    found = np.zeros(state.points.nodes.shape)
    found[free] = away + samples[:, -1:, None, :3]
    return found


def _rows(state: State) -> tuple[Array, ...]:
    """All arrays of a state, a row of numbers per feather."""
    return tuple(array.reshape(len(array), -1) for array in state.arrays().values())


def _planes(room: int) -> Contacts:
    return Contacts(
        first=np.zeros(0, dtype=np.int64),
        node=np.zeros((room, 2), dtype=np.int64),
        normal=np.zeros((room, 3)),
        offset=np.zeros((room, 2)),
        target=np.zeros((room, 2, 3)),
        strength=np.zeros((room, 4)),
    )
