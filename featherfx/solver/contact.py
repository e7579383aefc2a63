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

from featherfx.mechanics.model import Contacts, Loads
from featherfx.solver.contact_list_kernels import (
    GAP,
    GUEST,
    GUEST_FORCE,
    HOST,
    PAIR,
    SPARED,
    count_contacts,
    hand_out,
    measure,
    remember,
    residuals,
    update_forces,
)
from featherfx.solver.contact_run import Run
from featherfx.solver.contact_surfaces import (
    Scene,
    elastic_stiffness,
    list_contacts,
    new_touch,
    no_memory,
    skin_of,
)
from featherfx.solver.contact_wall import Wall
from featherfx.solver.integrator_kernels import integrator_coefficients
from featherfx.solver.root_path import RootPath
from featherfx.solver.state import State
from featherfx.solver.step import Solver, StepReport

Array = NDArray[np.float64]
Indices = NDArray[np.int64]
Bytes = NDArray[np.int8]

# springs of a round over the estimated stiffness of one node; of 0.5 to 8, 4 took the fewest
# iterations in a wing beat (5.9, 4.7, 2.9, 2.3 rounds at 0.5, 1, 3, 8; stiffer ones cost Newton)
FIT = 4.0
# a body whose contacts are off by less than this share of the tolerance is not solved again
QUIET_SHARE = 0.3
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

    solvers: of the batches; all share a grid. pairs: (N, 2) guest and host by body (all feathers
    of the first batch, then the next). order: (N,) side of the host where the guest belongs (1:
    that of its normal, -1), 0 where only the poses tell. halves: m, half thickness per body.
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
        self.first = np.cumsum([0, *(model.feathers for model in models)])
        self.skin = skin_of(models, halves)
        self._elastic = np.concatenate([elastic_stiffness(model) for model in models])
        self._mass = np.concatenate([model.mass for model in models])
        bodies, rows, _ = self.skin.present.shape
        self.memory = no_memory(len(self.pairs), self.skin)
        self._boxes = np.zeros((bodies, rows, 6)), np.zeros((bodies, 6))
        self._touch = new_touch()
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

        walls: bodies whose motion over the duration is given; of several, a node meets each.
        A feather that cannot be solved has a status in its batch's report, and then the other
        results mean nothing.
        """
        run = Run(self.solvers, self.first, states, loads, paths, duration)
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

    def _solve(self, run: Run, count: int) -> tuple[int, float, float]:
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

    def depths(self) -> tuple[Indices, Indices, Array]:
        """Of the last interval's contacts: guest and host (bodies; -1 for a wall), depth in m."""
        who, value = self._touch.who[: self._count], self._touch.value[: self._count]
        return who[:, GUEST], who[:, HOST], value[:, SPARED] - value[:, GAP]

    def _find(self, run: Run, duration: float, walls: Sequence[Wall]) -> int:
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
        found = np.unique(self._touch.who[:count, PAIR])
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

    def _contacts(self, run: Run, count: int, mine: NDArray[np.bool_]) -> list[Contacts]:
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
