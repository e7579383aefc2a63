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
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from featherfx.feather.types import without_directors
from featherfx.mechanics.model import Contacts, Loads
from featherfx.solver.contact.list_kernels import (
    GAP,
    GUEST,
    GUEST_FORCE,
    HOST,
    PAIR,
    SPARED,
    add_forces,
    closed_on_walls,
    hand_out,
    list_by_body,
    measure,
    residuals,
    soften,
    update,
)
from featherfx.solver.contact.run import Run
from featherfx.solver.contact.surfaces import (
    Found,
    Memory,
    elastic_stiffness,
    grids_of_models,
    list_contacts,
    new_planes,
    new_touch,
    no_memory,
    remembered,
    scene_of,
    skin_of,
)
from featherfx.solver.contact.wall import Wall
from featherfx.solver.solver import Solver, StepReport
from featherfx.solver.state import State
from featherfx.solver.step.integrator_kernels import integrator_of
from featherfx.solver.step.root_path import RootPath

Array = NDArray[np.float64]
Indices = NDArray[np.int64]
Flags = NDArray[np.bool_]

# springs of a round over the estimated stiffness of one node; of 0.5 to 8, 4 took the fewest
# iterations in a wing beat (5.9, 4.7, 2.9, 2.3 rounds at 0.5, 1, 3, 8; stiffer ones cost Newton)
FIT = 4.0
# a body whose contacts are off by less than this share of the tolerance is not solved again
QUIET_SHARE = 0.3
# gap, as a share of the margin, beyond which a contact without a force is not handed to a feather
FAR_SHARE = 0.5
# stiffness of contacts that yield, over what it would be
SOFT = 1e-2
# searches for contacts in one interval: the poses at its end are not known before
SEARCHES = 4


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


class ContactSolver:
    """Steps several batches together; keeps the contact forces from interval to interval.

    solvers: of the batches, whose grids may differ. pairs: (N, 2) guest and host by body (all
    feathers of the first batch, then the next). order: (N,) side of the host where the guest
    belongs (1: that of its normal, -1), 0 where only the poses tell. halves: m, half thickness per
    body.
    """

    def __init__(
        self,
        solvers: Sequence[Solver],
        pairs: Indices,
        order: Indices,
        halves: Sequence[float] | Array,
        settings: ContactSettings,
    ) -> None:
        self.solvers, self.settings = tuple(solvers), settings
        self.pairs, self.order = np.asarray(pairs).reshape(-1, 2), np.asarray(order)
        models = [solver.model for solver in solvers]
        self.grids = grids_of_models(models)
        self.skin = skin_of(models, self.grids, halves)
        self._elastic = self.grids.together([elastic_stiffness(model) for model in models])
        self._mass = self.grids.together([model.mass for model in models])
        bodies = self.grids.bodies
        self.memory = no_memory(self.skin)
        self._touch, self._spare, self._planes = new_touch(), new_touch(), new_planes(bodies)
        self._count = 0
        self._listed = np.zeros(bodies + 1, dtype=np.int64), np.zeros(0, dtype=np.int64)

    def interval(
        self,
        states: Sequence[State],
        loads: Sequence[Loads],
        paths: Sequence[RootPath],
        duration: float,
        walls: Sequence[Wall] = (),
        substeps: int = 1,
        resting: Flags | None = None,
        yielding: Flags | None = None,
    ) -> tuple[list[State], list[StepReport], ContactReport]:
        """Advance all batches by a duration in s; the given states are not changed.

        substeps: most regular steps that a feather may divide the interval into by itself, to keep
        to its tolerance. resting: (B,) bodies that are solved only if what touches them asks for
        it; the report counts no steps of those that were not. yielding: (B,) bodies whose contacts
        are soft, because they cannot be solved otherwise; what goes too deep comes out later, at
        the recovery speed. walls: bodies whose motion over the
        duration is given; of several, a node meets each.
        A feather that cannot be solved has a status in its batch's report, and then the other
        results mean nothing.
        """
        run = Run(self.solvers, self.grids, states, loads, paths, duration, substeps)
        memory = self.memory
        rounds, depth, residual = 0, 0.0, 0.0
        stale = np.ones(self.grids.bodies, dtype=np.bool_) if resting is None else ~resting
        forces = np.zeros(self.grids.bodies)
        for search in range(SEARCHES):
            searched = run.now.copy()
            count = self._find(run, duration, walls, memory, stale if search else None)
            if yielding is not None:
                soften(self._touch, count, yielding.astype(np.int8), SOFT)
            begun = float(self._touch.value[:count, SPARED].max(initial=0.0))
            if search:
                # what was found before, of another body or at another place, pressed as well
                found = np.zeros_like(forces)
                add_forces(self._touch, count, found)
                stale |= np.abs(found - forces) > 1e-9 * forces
            more, depth, residual = self._solve(run, count, stale)
            rounds += more
            moved = _largest_moves(run.now, searched)
            if run.failed() or moved.max() < self.settings.margin:
                break
            # the bodies did not go where they were headed: look again where they went
            stale = moved >= self.settings.margin
            add_forces(self._touch, count, forces)
            memory = remembered(self._touch, count, self.order, self.skin, memory)
        force = self._touch.value[:count, GUEST_FORCE]
        closed = int(np.count_nonzero(force > 0.0))
        report = ContactReport(closed, rounds, run.solves, residual, depth, begun)
        return run.new, run.reports(), report

    def _solve(self, run: Run, count: int, stale: Flags) -> tuple[int, float, float]:
        """Rounds of solves with the contacts found; (rounds, depth, residual).

        stale: (B,) bodies that are solved in the first round, whatever their contacts.
        """
        settings, touch = self.settings, self._touch
        measure(touch, count, run.now)
        colours = self._colours(count)
        worst = np.zeros(self.grids.bodies)
        depth = float(residuals(touch, count, worst))
        worst[stale] = np.inf
        number = 0
        while number < settings.rounds and worst.max() >= settings.tolerance:
            number += 1
            again = worst > QUIET_SHARE * settings.tolerance
            for colour in colours:
                mine = again & colour
                if not mine.any():
                    continue
                # at first they may still go far
                reach = np.inf if number == 1 else FAR_SHARE * settings.margin
                run.solve(mine, self._contacts(run, mine, reach))
                update(touch, *self._listed, mine.astype(np.int8), run.now)
            if run.failed():
                break
            depth = float(residuals(touch, count, worst))
            if number == 1 < settings.rounds and settings.friction > 0.0:
                closed = np.zeros(len(worst), dtype=np.bool_)
                closed_on_walls(touch, count, closed)
                worst[closed] = np.inf
        return number, depth, float(worst.max())

    def accept(self) -> None:
        """Keep the forces of the last interval for the next one."""
        self.memory = remembered(self._touch, self._count, self.order, self.skin, self._found_in)

    def depths(self) -> tuple[Indices, Indices, Array]:
        """Of the last interval's contacts: guest and host (bodies; -1 for a wall), depth in m."""
        who, value = self._touch.who[: self._count], self._touch.value[: self._count]
        return who[:, GUEST], who[:, HOST], value[:, SPARED] - value[:, GAP]

    def _find(
        self,
        run: Run,
        duration: float,
        walls: Sequence[Wall],
        memory: Memory,
        stale: Flags | None,
    ) -> int:
        """Search for contacts, again only for stale bodies; the room for them grows."""
        settings = self.settings
        inertia = integrator_of(self.solvers[0].settings.spectral_radius, duration).inertia
        impedance = FIT * (inertia * self._mass + self._elastic)
        self._found_in = memory._replace(inside=memory.inside.copy())
        found = list_contacts(
            self.pairs,
            self.order,
            self.skin,
            scene_of(run.start, run.now, impedance),
            self._found_in,
            settings.margin,
            settings.recovery * duration,
            walls,
            None if stale is None else Found(self._touch, self._count),
            stale,
            self._spare,
        )
        self._spare, self._touch, self._count = self._touch, found.touch, found.number
        first, items = self._listed
        if len(items) < 2 * found.number:
            items = np.zeros(4 * found.number, dtype=np.int64)
        list_by_body(self._touch, found.number, first, items)
        self._listed = first, items
        return found.number

    def _colours(self, count: int) -> list[Flags]:
        """Bodies in groups that do not touch each other, greedily; all bodies in one of them."""
        bodies = self.grids.bodies
        found = np.unique(self._touch.who[:count, PAIR])
        pairs = self.pairs[found[found >= 0]]
        near: list[set[int]] = [set() for _ in range(bodies)]
        for guest, host in pairs.tolist():
            near[guest].add(host)
            near[host].add(guest)
        colour = [-1] * bodies
        for body in range(bodies):
            taken = {colour[other] for other in near[body]}
            colour[body] = next(c for c in range(bodies) if c not in taken)
        every = np.array(colour)
        return [every == c for c in range(int(every.max()) + 1)]

    def _contacts(self, run: Run, mine: Flags, reach: float) -> Contacts:
        """The plane contacts of the bodies mine, by body; overwritten by the next call.

        reach: m, gap beyond which those without a force are left out.
        """
        settings, flags = self.settings, mine.astype(np.int8)
        while True:
            planes = self._planes
            count = hand_out(
                self._touch,
                *self._listed,
                flags,
                run.start,
                run.now,
                settings.friction,
                settings.smoothing * run.duration,
                reach,
                self.grids.most_columns,
                self.skin.columns,
                planes,
            )
            if count <= len(planes.node):
                return planes
            self._planes = new_planes(self.grids.bodies, 2 * count)


def _largest_moves(after: Array, before: Array) -> Array:
    """(B,) m, how far any node of each body is in one pose (B, n, P, 3) from the other."""
    away = np.abs(without_directors(after - before))
    return np.asarray(away.max(axis=(1, 2, 3)))
