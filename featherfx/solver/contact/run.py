"""The batches within one interval of contact: feathers are solved several times over."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from featherfx.algebra.types import Array, Flags, Indices
from featherfx.algebra.vectors import vectors_to_frames
from featherfx.algebra.views import ViewedTuples, Views, new_team, views_of
from featherfx.files.process import limit_threads
from featherfx.jit.compiled import KernelModule
from featherfx.mechanics.model import Contacts, Loads, expand_wind
from featherfx.solver.contact.surfaces import Grids, StateBuffers, put
from featherfx.solver.contact.types import ByBody, HandoverRules, JointForces
from featherfx.solver.scratch import make_matrices, make_scratch
from featherfx.solver.solver import (
    COARSE_ERROR_RATIO,
    HARD_STEP_WORK,
    MAX_NEWTON_ITERATIONS,
    UNSOLVED_DISTANCE_RATIO,
    Solver,
)
from featherfx.solver.state import RootPath, State, StepReport, carry_to, make_report
from featherfx.solver.types import StepSettings

sweep_kernels = KernelModule("featherfx.solver.contact.sweep_kernels")

Bytes = NDArray[np.int8]

# bodies of an island that one thread solves by itself, over its share of all, at most: of many
# bodies, whose rounds may take it longer than all else takes the others, and of fewer than those,
# of which threads that share them often wait for each other
_UNEVEN, _UNEVEN_OF_FEW, _MANY = 0.75, 1.2, 32
# bodies from which on threads make states of batches ready, and those of a batch at once
_WORTH_IT, _AT_ONCE = 300, 256

# contacts of a body whose forces are solved together, and weights of an island, at most
_MOST_TOGETHER, _MOST_WEIGHTS = 64, 4_000_000

# what a team takes tickets for: two kinds, in turns
STEP_KINDS = 2


class Batches(NamedTuple):
    """Batches of feathers as the sweep takes them. batch, place: (B,) of each body. Views: model,
    old and new states, rows_old and rows_new (theirs, by feather), path, report and kept (matrices)
    by batch; loads and work by thread and batch, loads with room for the contacts of one
    feather."""

    batch: Indices
    place: Indices
    model: Views
    old: Views
    new: Views
    rows_old: Views
    rows_new: Views
    path: Views
    report: Views
    kept: Views
    loads: Views
    work: Views


class Marks(NamedTuple):
    """B bodies of an interval. mine: which are solved, as long as they can be. island: (B,) of
    those, -1 of others. fresh: to be solved in the first round, whatever contacts.
    active: to be solved in this round. moves: m, how far they are expected to go in a solve; way:
    m, how far they went in all, and as much for what turned. moved: or what they touch, since worst
    and depth, m, of their contacts were looked at, and open_by, how much farther they are off than
    rounds may leave. solves: of each. status: of the solves. fixed: led for good (LedMotion)."""

    mine: Bytes
    island: Indices
    fresh: Bytes
    active: Bytes
    moves: Array
    way: Array
    moved: Bytes
    worst: Array
    open_by: Array
    depth: Array
    solves: Indices
    status: Array
    fixed: Bytes


class Islands(NamedTuple):
    """I islands. rounds: taken. worst: most that bodies are open by (Marks). open: whether rounds
    go on. bodies: of island i bodies[first[i]] to bodies[first[i + 1] - 1], ascending. alone: those
    that one thread solves by itself, the largest first."""

    rounds: Indices
    worst: Array
    open: Bytes
    bodies: Indices
    first: Indices
    alone: Indices


class BodyColours(NamedTuple):
    """The bodies of a round by colours: bodies[first[c]] to bodies[first[c + 1] - 1]; first
    (B + 2,), number: (1,) of colours. colour: (B,) of each, -1 of others. done: (B,) whether it is
    solved in this round. taken_by: (B + 1,) scratch."""

    bodies: Indices
    first: Indices
    number: Indices
    colour: Indices
    done: Indices
    taken_by: Indices


class RoundRules(NamedTuple):
    """rounds: most of an island. thickness: m, of the thinnest. friction: whether there is any."""

    rounds: int
    thickness: float
    friction: bool


class Sweep(NamedTuple):
    """Data that the team works on. step, alone, shared: settings of a body, of one that nothing
    presses, and of one that another presses that is solved as well."""

    batches: Batches
    step: StepSettings
    alone: StepSettings
    shared: StepSettings
    touch: NDArray[np.void]
    contacts: int
    listed: ByBody
    touching: ByBody
    handing: HandoverRules
    rules: RoundRules
    start: Array
    now: Array
    marks: Marks
    islands: Islands
    colours: BodyColours
    joint: JointForces


class Team:
    """Threads that sweep over batches, and what each of them and each batch needs for that.

    solvers: of the batches, with the same settings, of which one that has most threads lends them.
    grids: theirs.
    """

    def __init__(self, solvers: Sequence[Solver], grids: Grids) -> None:
        self.solvers, self.grids = tuple(solvers), grids
        self._lender = max(solvers, key=lambda solver: solver.jobs)
        self.jobs = jobs = self._lender.jobs
        self._pool = ThreadPoolExecutor(jobs - 1) if jobs > 1 else None
        models = [solver.model for solver in solvers]
        self.models = views_of(models)
        self.works = views_of([make_scratch(model) for _ in range(jobs) for model in models])
        self.kept = views_of([make_matrices(model) for model in models])
        counts = np.diff(grids.first)
        self.batch = np.repeat(np.arange(len(models)), counts)
        self.place = np.concatenate([np.arange(count) for count in counts])
        self._rooms: StateBuffers | None = None

    def rooms(self, states: Sequence[State]) -> StateBuffers:
        """Allocate memory for states of the batches; given some."""
        if self._rooms is None:
            self._rooms = StateBuffers(states)
        return self._rooms

    def for_each_part(self, function: Callable[[tuple[int, slice]], None]) -> None:
        """Call a function with the number of each batch and some of its feathers, until it had all,
        by all threads where that is worth it."""
        parts = [
            (batch, slice(low, min(low + _AT_ONCE, count)))
            for batch, count in enumerate(np.diff(self.grids.first).tolist())
            for low in range(0, count, _AT_ONCE)
        ]
        if self.grids.bodies < _WORTH_IT:
            for part in parts:
                function(part)
        else:
            self._lender.for_each(function, parts)

    def forget(self) -> None:
        """Begin anew with all matrices, as a bake does that goes on from here."""
        for kept in self.kept.tuples:
            kept.matrices.pace[:], kept.hard[:] = 0.0, 0

    def solve(self, sweep: Sweep) -> None:
        """All rounds of a sweep, by all threads."""
        counters, size = new_team(STEP_KINDS), limit_threads(self.jobs)
        pool = self._pool
        others = [
            pool.submit(sweep_kernels.solve_rounds, k, counters, size, sweep)
            for k in range(1, size)
            if pool
        ]
        sweep_kernels.solve_rounds(0, counters, size, sweep)
        for other in others:
            other.result()

    def loads(self, loads: Sequence[Loads], room: int) -> ViewedTuples:
        """The loads of the batches, for each thread with room for contacts of one feather."""
        windy = [
            expand_wind(each, solver.model.feathers)
            for each, solver in zip(loads, self.solvers, strict=True)
        ]
        found = []
        for _ in range(self.jobs):
            planes = _planes(room)
            for each, solver in zip(windy, self.solvers, strict=True):
                first = np.zeros(solver.model.feathers + 1, dtype=np.int64)
                found.append(each._replace(contacts=planes._replace(first=first)))
        return views_of(found)


class BatchRun:
    """Starts of the batches, and the state of the last iterate.

    duration: s. substeps: most regular steps of a feather within it. iterations: of Newton in one
    solve of a feather, at most. free: (B,) feathers that are solved; the states of others are
    zero. old, new: states, the new ones of feathers that are not solved after all from finish on.
    shares: (B, n, 1 + 2 m), part of its root's way that a node goes along by itself. start, now:
    (B, n, 1 + 2 m, 3) m, nodes of all bodies on the widest grid, now at first where they are
    headed. moves: of Marks. report: of all solves and bodies. alone: settings of feathers
    that nothing presses.
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
        self._team, self.duration, self._loads, self._free = team, duration, loads, free
        rooms, grids = team.rooms(states), team.grids
        self._before = rooms.before
        # neither touches memory yet
        self._after = rooms.made(np.empty if free.all() else np.zeros)
        self.old, self.new = self._before.states, self._after.states
        self.start, self.now = np.zeros((*shares.shape, 3)), np.zeros((*shares.shape, 3))

        def begin(part: tuple[int, slice]) -> None:
            batch, some = part
            first = int(grids.first[batch])
            own = free[first + some.start : first + some.stop]
            if not own.any():
                return
            state, path = self.old[batch].part(some), paths[batch].part(some)
            put(states[batch].part(some), state, own)
            carry_to(team.solvers[batch].model.held[some] & own, state, path)
            chosen = slice(None) if own.all() else np.flatnonzero(own)
            nodes, velocity = state.points.nodes[chosen], state.velocity.nodes[chosen]
            bodies = some if own.all() else some.start + chosen
            own_shares = grids.of(shares, batch, bodies)
            grids.put(nodes, batch, bodies, self.start)
            headed = _headed(nodes, velocity, path.samples[chosen], own_shares, duration)
            grids.put(headed, batch, bodies, self.now)

        team.for_each_part(begin)
        self._acting: ViewedTuples | None = None
        self._room = 0
        self.solves = np.zeros(grids.bodies, dtype=np.int64)
        self.moves = np.zeros(grids.bodies)
        self.report = make_report(grids.bodies)
        self._step = self.alone = self._step_settings(substeps, iterations)
        self._paths, self._reports = views_of(paths), views_of(self.reports())

    def _step_settings(self, substeps: int, iterations: int) -> StepSettings:
        every = [solver.settings for solver in self._team.solvers]
        settings = every[0]  # which differ in nothing but how far steps may err
        return StepSettings(
            duration=float(self.duration),
            shortest=float(self.duration / substeps),
            spectral_radius=float(settings.spectral_radius),
            tolerance=min(float(each.tolerance) for each in every),
            coarse=COARSE_ERROR_RATIO,
            newton=min(float(each.newton) for each in every),
            iterations=MAX_NEWTON_ITERATIONS,
            hard=HARD_STEP_WORK,
            most_iterations=min(settings.max_iterations, iterations),
            unsolved=0.0,
        )

    def like_free(self, newton: float, frame: float) -> StepSettings:
        """Return the step settings of feathers that nothing presses: they end as free ones do, with
        their part of the work of a frame (s), since shorter common steps would not help them.
        newton: m, at least, distance from the solution."""
        own, part = self._step, self.duration / max(self.duration, frame)
        whole = self._team.solvers[0].settings.max_iterations
        return own._replace(
            newton=max(own.newton, newton),
            most_iterations=max(own.most_iterations, int(part * whole)),
            unsolved=UNSOLVED_DISTANCE_RATIO,
        )

    def marks(self, island: Indices, fresh: Flags, fixed: Bytes) -> Marks:
        """Bodies of some islands (B,), -1 for those that are not solved. The others: of Marks."""
        return Marks(
            mine=(island >= 0).astype(np.int8),
            island=island,
            fresh=fresh.astype(np.int8),
            active=np.zeros(len(island), dtype=np.int8),
            moves=self.moves,
            way=np.zeros(len(island)),
            moved=np.ones(len(island), dtype=np.int8),
            worst=np.zeros(len(island)),
            open_by=np.zeros(len(island)),
            depth=np.zeros(len(island)),
            solves=self.solves,
            status=self.report.status,
            fixed=fixed,
        )

    def batches(self, room: int) -> Batches:
        """All batches, with room for so many contacts of one feather."""
        team = self._team
        if self._acting is None or room > self._room:
            self._room = 2 * room
            self._acting = team.loads(self._loads, self._room)
        return Batches(
            batch=team.batch,
            place=team.place,
            model=team.models.views,
            old=self._before.views,
            new=self._after.views,
            rows_old=self._before.rows,
            rows_new=self._after.rows,
            path=self._paths.views,
            report=self._reports.views,
            kept=team.kept.views,
            loads=self._acting.views,
            work=team.works.views,
        )

    @property
    def step(self) -> StepSettings:
        """Return the step settings of the feathers within the interval; coarse over the feather's
        length."""
        return self._step

    def end_blows(self, struck: Flags) -> None:
        """Leave bodies (B,) that others struck the accelerations of before.

        A blow is an impulse: to go on with its acceleration in a step of another length would give
        a part of it once more, and energy with it.
        """
        struck, first = struck & (self.report.steps == 1.0), self._team.grids.first
        for g, (old, new) in enumerate(zip(self.old, self.new, strict=True)):
            own = np.flatnonzero(struck[first[g] : first[g + 1]])
            for before, to in zip(
                (*old.acceleration, *old.smoothed), (*new.acceleration, *new.smoothed), strict=True
            ):
                to[own] = before[own]

    def finish(self) -> None:
        """Feathers that were not solved stay as they were."""
        left = self._free & (self.solves == 0)

        def stay(part: tuple[int, slice]) -> None:
            batch, some = part
            first = int(self._team.grids.first[batch])
            own = left[first + some.start : first + some.stop]
            if own.any():
                put(self.old[batch].part(some), self.new[batch].part(some), own)

        if left.any():
            self._team.for_each_part(stay)

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
    most = np.where(sizes < _MANY, _UNEVEN_OF_FEW, _UNEVEN) * max(1, len(bodies))
    return Islands(
        rounds=np.zeros(count, dtype=np.int64),
        worst=np.zeros(count),
        open=np.ones(count, dtype=np.int8),
        bodies=bodies,
        first=np.concatenate([[0], np.cumsum(sizes)]),
        alone=order[(sizes * jobs <= most)[order]] if jobs > 1 else order,
    )


def room_for_forces(
    islands: Islands, island: Indices, owners: Indices, listed: ByBody
) -> JointForces:
    """Room for contact forces of islands that are solved together. island: (B,) of each body.
    owners: (K,) of each contact, a body of its island."""
    count, bodies = len(islands.rounds), len(island)
    each = np.minimum(np.diff(listed.first), _MOST_TOGETHER) ** 2
    solved = island >= 0
    weights = np.bincount(island[solved], each[solved], minlength=count).astype(np.int64)
    own = island[owners]
    places = np.cumsum(np.bincount(own[own >= 0], minlength=count))
    room = np.concatenate([[0], np.cumsum(np.minimum(weights, _MOST_WEIGHTS))])
    total = int(places[-1]) if count else 0
    first = np.concatenate([[0], places]).astype(np.int64)[:count]
    return JointForces(
        on=np.zeros(count, dtype=np.int8),
        fresh=np.zeros(count, dtype=np.int8),
        first=first,
        last=np.zeros(count, dtype=np.int64),
        room=room.astype(np.int64),
        chosen=np.empty(total, dtype=np.int64),
        counts=np.zeros(bodies, dtype=np.int64),
        items_at=np.zeros(bodies, dtype=np.int64),
        weights_at=np.zeros(bodies, dtype=np.int64),
        items=np.empty(2 * total, dtype=np.int64),
        weights=np.empty(int(room[-1])),
        moves=np.zeros(bodies, dtype=np.int8),
        force=np.empty(total),
        ahead=np.empty((total, 2)),
        lines=np.empty((6, total)),
    )


def no_colours(bodies: int) -> BodyColours:
    """Scratch for the colours of so many bodies."""
    return BodyColours(
        bodies=np.zeros(bodies, dtype=np.int64),
        first=np.zeros(bodies + 2, dtype=np.int64),
        number=np.zeros(1, dtype=np.int64),
        colour=np.zeros(bodies, dtype=np.int64),
        done=np.zeros(bodies, dtype=np.int64),
        taken_by=np.zeros(bodies + 1, dtype=np.int64),
    )


def _headed(nodes: Array, velocity: Array, samples: Array, shares: Array, duration: float) -> Array:
    """(F, n, 1 + 2 m, 3) m, where nodes are headed in a duration (s): on with their velocity, and
    a share (F, n, 1 + 2 m) of what they are then from where their roots would carry them rigidly,
    along samples (F, K, 6)."""
    turns = vectors_to_frames(samples[:, -1, 3:])
    # one product a feather: many times as fast as one a row
    flat = len(nodes), nodes.shape[1] * nodes.shape[2], 3
    away = (nodes - samples[:, :1, None, :3]).reshape(flat) @ turns.swapaxes(1, 2)
    found = away.reshape(nodes.shape)
    found += samples[:, -1:, None, :3]
    ahead = velocity * duration
    ahead += nodes
    found -= ahead
    found *= shares[..., None]
    found += ahead
    return np.asarray(found)


def _planes(room: int) -> Contacts:
    return Contacts(
        first=np.zeros(0, dtype=np.int64),
        node=np.zeros((room, 2), dtype=np.int64),
        normal=np.zeros((room, 3)),
        offset=np.zeros((room, 2)),
        target=np.zeros((room, 2, 3)),
        strength=np.zeros((room, 4)),
    )
