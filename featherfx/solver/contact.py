"""Contact between the feathers of several batches: one interval of time for all of them.

Each feather is still solved on its own. A contact is a pair of forces, one on either body; in
turn, each body is solved against the plane of the other with the force that the other felt last
and a spring as stiff as the other body is (`featherfx/mechanics/contact_kernels.py`). Where the
stiffnesses fit, one round is enough; forces of the interval before make a good start. Opposite
forces become equal as the rounds converge. (Robin transmission conditions: Lions 1990; the fit of
the stiffness: optimised Schwarz methods, Gander 2006.)
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from featherfx.mechanics.model import Contacts, Loads, Model
from featherfx.solver.contact_list_kernels import (
    GUEST_FORCE,
    INTEGERS,
    PAIR,
    SPARED,
    VALUES,
    count_contacts,
    find_contacts,
    hand_out,
    measure,
    remember,
    residuals,
    update_forces,
)
from featherfx.solver.contact_search_kernels import RIM_PARTS, row_boxes
from featherfx.solver.contact_wall import Wall
from featherfx.solver.contact_wall_kernels import find_wall_contacts
from featherfx.solver.integrator_kernels import integrator_coefficients
from featherfx.solver.root_path import RootPath
from featherfx.solver.state import State
from featherfx.solver.step import Solver, StepReport

Array = NDArray[np.float64]
Indices = NDArray[np.int64]
Bytes = NDArray[np.int8]

FIRST_ROOM = 1024
# springs of a round over the estimated stiffness of one node; of 0.5 to 8, 4 took the fewest
# iterations in a wing beat (5.9, 4.7, 2.9, 2.3 rounds at 0.5, 1, 3, 8; stiffer ones cost Newton)
FIT = 4.0
# a body whose contacts are off by less than this share of the tolerance is not solved again
QUIET_SHARE = 0.3
# searches for contacts in one interval: the poses at its end are not known before
SEARCHES = 4
# FIT for a wall, which does not yield, over that of the node
WALL_FIT = 4.0


@dataclass(frozen=True)
class ContactSettings:
    """How contact is solved.

    friction: Coulomb's coefficient. smoothing: m/s, slip speed below which friction is partial.
    margin: m, gap below which a node is followed. tolerance: m, what a gap that should be closed
    may be off. rounds: most rounds over all feathers in an interval. recovery: m/s, speed at which
    what begins too deep comes apart.
    """

    friction: float = 0.3
    smoothing: float = 0.02
    margin: float = 1e-3
    tolerance: float = 1.2e-5
    rounds: int = 8
    recovery: float = 0.1


class Skin(NamedTuple):
    """Constant surfaces of B bodies. present: (B, n, 2 m + 1), which nodes a triangle has. guests:
    (B, n, W) points that may touch others (contact_search_kernels.guest_point). exists:
    (B, 2, n-1, m, 2) triangles. half: (B, n, P) m, half thickness at the material points."""

    present: Bytes
    guests: Bytes
    exists: Bytes
    half: Array


class Scene(NamedTuple):
    """B bodies in an interval. start: (B, n, P, 3) m, its begin; ahead: where they will be about
    its end. boxes: (B, n, 6) and bounds: (B, 6) m, around both. impedance: (B, n, P) N/m."""

    start: Array
    ahead: Array
    boxes: Array
    bounds: Array
    impedance: Array


class Memory(NamedTuple):
    """What is kept between intervals, for N pairs and the nodes of their guests. force: (N, n,
    W, 2) N, on guest and host. side: (N, n, W) of the host, 0 where there is none.
    wall: (B, n, W) N, forces of walls. inside: (B, n, W), those grown into one."""

    force: Array
    side: Bytes
    wall: Array
    inside: Bytes


def no_memory(pairs: int, skin: Skin) -> Memory:
    """Nothing touched yet."""
    bodies, rows, strip = skin.guests.shape
    return Memory(
        force=np.zeros((pairs, rows, strip, 2)),
        side=np.zeros((pairs, rows, strip), dtype=np.int8),
        wall=np.zeros((bodies, rows, strip)),
        inside=np.zeros((bodies, rows, strip), dtype=np.int8),
    )


class Touch(NamedTuple):
    """Room for K contacts (contact_list_kernels): index (K, 8), corner (K, 3, 2) row and material
    point, weight (K, 3), normal (K, 3), value (K, 9), place_start and place_now (K, 3) m, of the
    host's point; place (4,), guest and guest_ahead (3,) are scratch."""

    index: Indices
    corner: Indices
    weight: Array
    normal: Array
    value: Array
    place_start: Array
    place_now: Array
    place: Indices
    guest: Array
    guest_ahead: Array


@dataclass(frozen=True)
class ContactReport:
    """What an interval took.

    contacts: closed ones at its end. rounds: over the feathers. solves: feathers solved. residual:
    m, largest gap that should be closed, or misfit of the two forces over the stiffness. depth: m,
    deepest penetration of a node below the sum of half thicknesses, at the interval's end.
    start_depth: m, what the interval spared of the depth that it began with.
    """

    contacts: int
    rounds: int
    solves: int
    residual: float
    depth: float
    start_depth: float


def skin_of(models: Sequence[Model], halves: Sequence[float]) -> Skin:
    """Surfaces of all feathers of some batches. halves: m, half thickness of each body's vane."""
    exists = np.concatenate([model.cell_stiffness[..., 0] != 0.0 for model in models])
    bodies, _, cells, m, _ = exists.shape
    present = np.zeros((bodies, cells + 1, 2 * m + 1), dtype=np.int8)
    for side in range(2):
        node = np.zeros((bodies, cells + 1, m + 1), dtype=bool)
        first, second = exists[:, side, :, :, 0], exists[:, side, :, :, 1]
        node[:, :-1, :-1] |= first
        node[:, :-1, 1:] |= first | second
        node[:, 1:, :-1] |= first | second
        node[:, 1:, 1:] |= second
        if side == 0:
            present[:, :, m:] |= node
        else:
            present[:, :, m::-1] |= node
    half = np.broadcast_to(np.asarray(halves)[:, None, None], (bodies, cells + 1, 3 + 2 * m))
    return Skin(present, _guests(present), exists.astype(np.int8), np.array(half, dtype=float))


def _guests(present: Bytes) -> Bytes:
    """(B, n, W): all nodes, and points of the rims between rows that both have one."""
    parts = []
    for end in (0, -1):
        rim = np.zeros(present.shape[:2], dtype=np.int8)
        rim[:, :-1] = present[:, :-1, end] & present[:, 1:, end]
        parts.append(np.repeat(rim[:, :, None], RIM_PARTS - 1, axis=2))
    return np.concatenate([present, *parts], axis=2)


def elastic_stiffness(model: Model) -> Array:
    """(F, n, P) N/m, how stiff a feather is at its nodes, apart from inertia.

    Between that of a single force, 3 B / s^3 on a barb at s from its root, and that of a force on
    all nodes of the barb, 8 B / (L^3 m): their geometric mean; shaft and barb in series.
    """
    m, count = model.columns, model.coefficients
    station = np.cumsum(model.length, axis=1)
    bending = (model.rachis_stiffness[:, :, 4:] * model.length[:, :, None]).min(axis=2)
    shaft = np.full(model.mass.shape[:2], np.inf)
    shaft[:, 1:] = 3.0 * bending[:, :1] / station**3
    stiffness = np.repeat(shaft[:, :, None], 3 + 2 * m, axis=2)
    if m and count:
        length = model.segment * m
        root = model.barb_stiffness[..., 0] / np.where(length > 0.0, length, np.inf) ** 2
        nodes = np.arange(1, m + 1)
        barb = np.sqrt(24.0 * m**2 / nodes**3) * root[..., None]
        for side in range(2):
            part = stiffness[:, :, 3 + side * m : 3 + (side + 1) * m]
            soft = barb[:, side]
            with np.errstate(divide="ignore"):
                part[...] = 1.0 / (1.0 / part + 1.0 / soft)
    return np.where(np.isfinite(stiffness), stiffness, 0.0)


class ContactSolver:
    """Steps several batches together; keeps the contact forces from interval to interval.

    solvers: of the batches; all share a grid. pairs: (N, 2) guest and host by body (all feathers
    of the first batch, then the next). order: (N,) side of the host where the guest belongs (1:
    that of its normal, -1), 0 where only the poses tell. halves: m, half thickness per body.
    """

    def __init__(
        self,
        solvers: Sequence[Solver],
        pairs: Indices,
        order: Indices,
        halves: Sequence[float],
        settings: ContactSettings,
    ) -> None:
        self.solvers, self.settings = tuple(solvers), settings
        self.pairs, self.order = np.asarray(pairs).reshape(-1, 2), np.asarray(order)
        models = [solver.model for solver in solvers]
        self.first = np.cumsum([0, *(model.feathers for model in models)])
        self.skin = skin_of(models, halves)
        self._elastic = np.concatenate([elastic_stiffness(model) for model in models])
        self._mass = np.concatenate([model.mass for model in models])
        bodies, rows, _ = self.skin.present.shape
        self.memory = no_memory(len(self.pairs), self.skin)
        self._boxes = np.zeros((bodies, rows, 6)), np.zeros((bodies, 6))
        self._touch = _room(FIRST_ROOM)
        self._count = 0

    def interval(
        self,
        states: Sequence[State],
        loads: Sequence[Loads],
        paths: Sequence[RootPath],
        duration: float,
        walls: Sequence[Wall] = (),
    ) -> tuple[list[State], list[StepReport], ContactReport]:
        """Advance all batches by a duration in s; the given states are not changed.

        walls: bodies whose motion over the duration is given; of several, a node meets each. A feather that cannot be solved has a status in its batch's report, and then the other
        results mean nothing.
        """
        run = _Run(self, states, loads, paths, duration)
        rounds, depth, residual = 0, 0.0, 0.0
        for _ in range(SEARCHES):
            searched = run.now.copy()
            count = self._find(run, duration, walls)
            begun = float(self._touch.value[:count, SPARED].max(initial=0.0))
            more, depth, residual = self._solve(run, count)
            rounds += more
            self._count = count
            if run.failed() or np.abs(run.now - searched).max() < self.settings.margin:
                break
            # the bodies did not go where they were headed: look again where they went
            remember(self._touch, count, self.memory)
        force = self._touch.value[:count, GUEST_FORCE]
        closed = int(np.count_nonzero(force > 0.0))
        report = ContactReport(closed, rounds, run.solves, residual, depth, begun)
        return run.new, run.reports(), report

    def _solve(self, run: _Run, count: int) -> tuple[int, float, float]:
        """Rounds of solves with the contacts found; (rounds, depth, residual)."""
        settings, touch = self.settings, self._touch
        measure(touch, count, run.now)
        colours = self._colours(count)
        worst = np.full(self.first[-1], np.inf)
        depth = 0.0
        for number in range(1, settings.rounds + 1):
            again = worst > QUIET_SHARE * settings.tolerance
            for colour in colours:
                mine = again & colour
                if not mine.any():
                    continue
                run.solve(mine, self._contacts(run, count, mine))
                measure(touch, count, run.now)
                update_forces(touch, count, mine.astype(np.int8))
            if count == 0 or run.failed():
                return number, 0.0, 0.0
            depth = float(residuals(touch, count, worst))
            if worst.max() < settings.tolerance:
                break
        return number, depth, float(worst.max())

    def accept(self) -> None:
        """Keep the forces of the last interval for the next one."""
        remember(self._touch, self._count, self.memory)

    def _find(self, run: _Run, duration: float, walls: Sequence[Wall]) -> int:
        """Search for contacts; the room for them grows until they fit."""
        settings = self.settings
        inertia = integrator_coefficients(self.solvers[0].settings.radius, duration)[0]
        boxes, bounds = self._boxes
        impedance = FIT * (inertia * self._mass + self._elastic)
        scene = Scene(run.start, run.now, boxes, bounds, impedance)
        self._touch, count = list_contacts(
            self.pairs,
            self.order,
            self.skin,
            scene,
            self.memory,
            settings.margin,
            settings.recovery * duration,
            self._touch,
            walls,
        )
        return count

    def _colours(self, count: int) -> list[NDArray[np.bool_]]:
        """Bodies in groups that do not touch each other, greedily; all bodies in one of them."""
        bodies = int(self.first[-1])
        found = np.unique(self._touch.index[:count, PAIR])
        pairs = self.pairs[found[found >= 0]]
        near: list[set[int]] = [set() for _ in range(bodies)]
        for guest, host in pairs.tolist():
            near[guest].add(host)
            near[host].add(guest)
        colour = np.full(bodies, -1)
        for body in range(bodies):
            taken = {int(colour[other]) for other in near[body]}
            colour[body] = next(c for c in range(bodies) if c not in taken)
        return [colour == c for c in range(int(colour.max()) + 1)]

    def _contacts(self, run: _Run, count: int, mine: NDArray[np.bool_]) -> list[Contacts]:
        """The plane contacts of the bodies mine, per batch."""
        settings, bodies = self.settings, int(self.first[-1])
        flags = mine.astype(np.int8)
        per_body = np.zeros(bodies, dtype=np.int64)
        count_contacts(self._touch, count, flags, per_body)
        first = np.concatenate([[0], np.cumsum(per_body)])
        total = int(first[-1])
        everything = Contacts(
            first=first,
            node=np.zeros((total, 2), dtype=np.int64),
            normal=np.zeros((total, 3)),
            offset=np.zeros((total, 2)),
            target=np.zeros((total, 2, 3)),
            strength=np.zeros((total, 4)),
        )
        hand_out(
            self._touch,
            count,
            flags,
            first[:-1].copy(),
            run.start,
            run.now,
            settings.friction,
            settings.smoothing * run.duration,
            everything,
        )
        return [
            everything._replace(first=first[low : high + 1])
            for low, high in zip(self.first[:-1], self.first[1:], strict=True)
        ]


class _Run:
    """The batches within one interval: where they started, where the last iterate stands."""

    def __init__(
        self,
        solver: ContactSolver,
        states: Sequence[State],
        loads: Sequence[Loads],
        paths: Sequence[RootPath],
        duration: float,
    ) -> None:
        self.solvers, self.first, self.duration = solver.solvers, solver.first, duration
        self.loads, self.paths = loads, paths
        self.old = [state.copy() for state in states]
        for state in self.old:
            state.proposal[:] = 0.0
        self.new = [state.copy() for state in self.old]
        self.start = np.concatenate([state.points for state in self.old])
        velocity = np.concatenate([state.velocity for state in self.old])
        self.now = self.start + duration * velocity
        self.solves = 0
        self._counts: list[list[StepReport]] = [[] for _ in states]
        self._seen = np.zeros(int(self.first[-1]), dtype=np.bool_)

    def solve(self, mine: NDArray[np.bool_], contacts: Sequence[Contacts]) -> None:
        """Solve the bodies mine anew from the interval's start."""
        for g, solver in enumerate(self.solvers):
            low, high = self.first[g], self.first[g + 1]
            feathers = np.flatnonzero(mine[low:high])
            if len(feathers) == 0:
                continue
            loads = self.loads[g]._replace(contacts=contacts[g])
            new, report = solver.step(
                self.old[g], loads, self.paths[g], self.duration, feathers.tolist()
            )
            for current, solved in zip(self.new[g], new, strict=True):
                current[feathers] = solved[feathers]
            self.now[low + feathers] = new.points[feathers]
            self.solves += len(feathers)
            # the next try starts from this pose: rates that lead there
            self.old[g].spin[feathers] = new.spin[feathers]
            self.old[g].coefficient_rate[feathers] = new.coefficient_rate[feathers]
            self._counts[g].append(_only(report, feathers))

    def failed(self) -> bool:
        return any((report.status != 0.0).any() for parts in self._counts for report in parts)

    def reports(self) -> list[StepReport]:
        """Per batch, all solves of the interval as one report: counts add, the last error holds."""
        return [_joined(parts, solver.model.feathers) for parts, solver in zip(
            self._counts, self.solvers, strict=True)]


def _only(report: StepReport, feathers: Indices) -> StepReport:
    kept = {}
    for name, value in vars(report).items():
        part = np.zeros_like(value)
        part[feathers] = value[feathers]
        kept[name] = part
    return StepReport(**kept)


def _joined(parts: Sequence[StepReport], count: int) -> StepReport:
    zero = np.zeros(count)
    total = {name: zero.copy() for name in StepReport.__dataclass_fields__}
    for part in parts:
        solved = (part.steps > 0.0) | (part.status != 0.0)
        for name in ("iterations", "rejected", "failed", "fallbacks"):
            total[name] = total[name] + getattr(part, name)
        for name in ("steps", "error", "move"):
            total[name] = np.where(solved, getattr(part, name), total[name])
        total["status"] = np.maximum(total["status"], part.status)
    return replace(StepReport(**total))


def list_contacts(
    pairs: Indices,
    order: Indices,
    skin: Skin,
    scene: Scene,
    memory: Memory,
    margin: float,
    recovery: float,
    touch: Touch | None = None,
    walls: Sequence[Wall] = (),
) -> tuple[Touch, int]:
    """Contacts of pairs (N, 2), guest and host, and how many; boxes of the scene are refitted.

    order, margin, touch as in ContactSolver. recovery: m, that a depth is reduced by.
    """
    touch = touch or _room(FIRST_ROOM)
    _refit(scene, skin)
    limits = np.array([margin, recovery, WALL_FIT])
    while True:
        count = int(find_contacts(pairs, order, skin, scene, memory, limits, touch))
        for wall in walls:
            if count <= len(touch.index):
                count = int(find_wall_contacts(wall, skin, scene, memory, limits, touch, count))
        if count <= len(touch.index):
            return touch, count
        touch = _room(2 * count)


def _room(count: int) -> Touch:
    return Touch(
        index=np.zeros((count, INTEGERS), dtype=np.int64),
        corner=np.zeros((count, 3, 2), dtype=np.int64),
        weight=np.zeros((count, 3)),
        normal=np.zeros((count, 3)),
        value=np.zeros((count, VALUES)),
        place_start=np.zeros((count, 3)),
        place_now=np.zeros((count, 3)),
        place=np.zeros(4, dtype=np.int64),
        guest=np.zeros(3),
        guest_ahead=np.zeros(3),
    )


def _refit(scene: Scene, skin: Skin) -> None:
    """Boxes around each body's rows at both ends of the interval."""
    boxes, bounds = np.zeros_like(scene.boxes), np.zeros_like(scene.bounds)
    for body in range(len(scene.start)):
        row_boxes(scene.start[body], skin.present[body], boxes[body], bounds[body])
        row_boxes(scene.ahead[body], skin.present[body], scene.boxes[body], scene.bounds[body])
    for mine, other in ((scene.boxes, boxes), (scene.bounds, bounds)):
        np.minimum(mine[..., :3], other[..., :3], out=mine[..., :3])
        np.maximum(mine[..., 3:], other[..., 3:], out=mine[..., 3:])
