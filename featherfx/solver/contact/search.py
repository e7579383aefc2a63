"""The search for what touches: over blocks of bodies and pairs, by several threads.

Contacts stand in the order of their pairs, whatever the blocks, so they do not depend on the
number of threads. Which pairs need no look (clearance_kernels) changes no contact.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from featherfx.algebra.vectors import distinct
from featherfx.jit.compiled import KernelModule
from featherfx.solver.contact.types import (
    CONTACT_DTYPE,
    WALL_BITS,
    ByBody,
    Bytes,
    Candidates,
    Clearance,
    ContactMemory,
    EarlierContacts,
    GroundSurface,
    Indices,
    SearchSettings,
    Touch,
    VaneSurfaces,
    Wall,
)

find_kernels = KernelModule("featherfx.solver.contact.find_kernels")
list_kernels = KernelModule("featherfx.solver.contact.list_kernels")
wall_kernels = KernelModule("featherfx.solver.contact.wall_kernels")

_FIRST_CAPACITY = 1024
# points of guests that are one piece of work, at the least, and pieces for each thread
_MIN_POINTS, _PIECES = 5_000, 20
# contacts that threads put together beside each other, at the least
_MANY = 5_000
# walls that have bits of their own in ContactMemory.inside; all after them share the next
_MAX_WALLS = 19

ForEach = Callable[[Callable[[Any], None], Iterable[Any]], None]


class ContactSearch(NamedTuple):
    """Contacts found: the first number of touch."""

    touch: Touch
    number: int

    @property
    def contacts(self) -> Touch:
        """(number,) of CONTACT_DTYPE."""
        return self.touch[: self.number]

    def without(self, bodies: NDArray[np.bool_]) -> ContactSearch:
        """Return it with no contact of some bodies (B,); touch is written over."""
        contacts = self.contacts
        gone = bodies[contacts["guest"]] | ((contacts["host"] >= 0) & bodies[contacts["host"]])
        left = contacts[~gone]
        self.touch[: len(left)] = left
        return ContactSearch(self.touch, len(left))

    def remembered(
        self, order: Indices, memory: ContactMemory, start: ContactMemory | None = None
    ) -> ContactMemory:
        """Return what the next search needs of them: forces, and sides that an order does not tell,
        or that poses tell otherwise.

        start: of an interval that goes on. Its poses so far tell no sides but where a force held
        them; all others are as they were.
        """
        wall, number = np.zeros_like(memory.wall), self.number
        key, force, side = np.empty(number, "i8"), np.empty((number, 2)), np.empty(number, "i1")
        count = list_kernels.remember(
            self.touch, number, order, start is not None, key, force, side, wall
        )
        key, force, side = key[:count], force[:count], side[:count]
        if start is not None:
            idle = ~np.isin(start.key, key)
            key = np.concatenate([key, start.key[idle]])
            along = np.argsort(key, kind="stable")
            force = np.concatenate([force, np.zeros((int(idle.sum()), 2))])[along]
            key, side = key[along], np.concatenate([side, start.side[idle]])[along]
        return ContactMemory(key, force, side, wall, memory.inside.copy(), memory.surprise)


class Searcher:
    """Searches for contacts between the same bodies again and again.

    candidates: what may touch. surfaces: of the bodies. jobs: threads; for_each: calls a function
    with each of some numbers, by these threads. looked_at: pairs that the last search could not
    leave out.
    """

    def __init__(
        self,
        candidates: Candidates,
        surfaces: VaneSurfaces,
        jobs: int = 1,
        for_each: ForEach | None = None,
    ) -> None:
        self._for_each, self._jobs = for_each or _one_by_one, jobs
        self._points = int(np.count_nonzero(surfaces.guests)) / len(surfaces.far)
        self.looked_at, self._on_walls, self._rooms = 0, list[Touch](), list[Touch]()
        self._clearance = _no_clearance(surfaces)
        self.take_on(candidates)

    def take_on(self, candidates: Candidates) -> None:
        """Search these from now on: those before, and behind them some that are new."""
        pairs, bodies = len(candidates.pairs), len(self._clearance.half)
        known, points = len(self._clearance.until), int(pairs * self._points)
        jobs = self._jobs
        pieces = 1 if jobs == 1 else max(1, min(_PIECES * jobs, points // _MIN_POINTS))
        self.candidates = candidates
        self._spans = np.linspace(0, pairs, pieces + 1).astype(np.int64).tolist()
        self._bodies = np.linspace(0, bodies, pieces + 1).astype(np.int64).tolist()
        # rooms that have grown are needed again
        self._rooms = [
            *self._rooms[:pieces],
            *(new_touch() for _ in range(pieces - len(self._rooms))),
        ]
        until, wait = np.full(pairs, -np.inf), np.zeros(pairs, dtype=np.int8)
        pose = np.zeros((pairs, 12))
        until[:known], wait[:known] = self._clearance.until, self._clearance.wait
        pose[:known] = self._clearance.pose
        self._clearance = self._clearance._replace(until=until, pose=pose, wait=wait)

    def forget(self) -> None:
        """Look at all pairs again: there are surfaces that were not there before."""
        self._clearance.until[:] = -np.inf

    def find(
        self,
        search: SearchSettings,
        walls: Sequence[Wall | GroundSurface] = (),
        before: ContactSearch | None = None,
        stale: NDArray[np.bool_] | None = None,
        room: Touch | None = None,
        free: NDArray[np.bool_] | None = None,
    ) -> ContactSearch:
        """Find what touches; boxes of the bodies are refitted.

        before: contacts that hold on for pairs of bodies that are not stale (B,). room: to be
        written over; not before. free: (B,) bodies that may touch walls, all by default.
        """
        before = before or ContactSearch(new_touch(1), 0)
        anew = np.ones(len(search.surfaces.far), dtype=bool) if stale is None else stale
        earlier = EarlierContacts(before.touch, before.number, anew.astype(np.int8))
        every = np.ones(len(anew), dtype=np.int8) if free is None else free.astype(np.int8)
        near = np.ones_like(every) if anew.all() else self._near(anew)
        pieces, counts = range(len(self._rooms)), np.zeros((len(self._rooms), 2), dtype=np.int64)
        clearance, bodies, spans = self._clearance, self._bodies, self._spans

        def fit(k: int) -> None:
            find_kernels.refit(search, clearance, near, bodies[k], bodies[k + 1])

        def look(k: int) -> None:
            low, high = spans[k], spans[k + 1]
            while True:
                counts[k] = find_kernels.find_contacts(
                    self.candidates, search, earlier, clearance, low, high, self._rooms[k]
                )
                if counts[k, 0] <= len(self._rooms[k]):
                    break
                self._rooms[k] = new_touch(int(1.25 * counts[k, 0]))

        self._for_each(fit, pieces)
        meet, numbers = self._meeting(search, walls, every & anew.astype(np.int8))
        # what takes longest first, and no waiting between
        works = [partial(look, k) for k in pieces] + [partial(meet, k) for k in pieces]
        self._for_each(_call, works)
        self.looked_at = int(counts[:, 1].sum())
        # as with pairs, what is not stale keeps its contacts with walls
        kept = _on_walls_still(before.contacts, anew)
        parts = [self._rooms[k][: counts[k, 0]] for k in pieces]
        met = [self._on_walls[k][:count] for k, count in enumerate(numbers.tolist())]
        return self._joined([*parts, kept, *met], new_touch() if room is None else room)

    def _near(self, stale: NDArray[np.bool_]) -> Bytes:
        """(B,) bodies that are stale, or may touch one that is."""
        guest, host = self.candidates.pairs.T
        near = stale.copy()
        near[guest[stale[host]]] = True
        near[host[stale[guest]]] = True
        return near.astype(np.int8)

    def _meeting(
        self, search: SearchSettings, walls: Sequence[Wall | GroundSurface], free: Bytes
    ) -> tuple[Callable[[int], None], Indices]:
        """Return a function that finds contacts with all walls of bodies that are free (B,), called
        with the number of a piece; and how many it finds, wall after wall, in each piece.

        Of one body a thread looks at one wall after the other: they share what it has grown into.
        """
        pieces = len(self._rooms)
        while len(self._on_walls) < pieces * len(walls):
            self._on_walls.append(new_touch())
        counts = np.zeros(pieces * len(walls), dtype=np.int64)

        def meet(piece: int) -> None:
            low, high = self._bodies[piece], self._bodies[piece + 1]
            for number, wall in enumerate(walls):
                k, bit = number * pieces + piece, 1 << WALL_BITS * min(number, _MAX_WALLS)
                find = wall_kernels.find_wall_contacts
                if isinstance(wall, GroundSurface):
                    find = wall_kernels.find_ground_contacts
                while True:
                    counts[k] = find(wall, bit, search, free, low, high, self._on_walls[k])
                    if counts[k] <= len(self._on_walls[k]):
                        break
                    self._on_walls[k] = new_touch(int(1.25 * counts[k]))

        return meet, counts

    def _joined(self, parts: Sequence[Touch], touch: Touch) -> ContactSearch:
        """The contacts of all parts, one after the other."""
        first = np.concatenate([[0], np.cumsum([len(part) for part in parts])]).tolist()
        if first[-1] > len(touch):
            touch = new_touch(2 * first[-1])

        def put(k: int) -> None:
            _copy(parts[k], touch[first[k] : first[k + 1]])

        for_each = self._for_each if first[-1] > _MANY else _one_by_one
        for_each(put, range(len(parts)))
        return ContactSearch(touch, first[-1])


def _on_walls_still(contacts: Touch, anew: NDArray[np.bool_]) -> Touch:
    """Contacts with walls of bodies that are not searched anew (B,)."""
    if anew.all():
        return contacts[:0]
    walls = np.flatnonzero(contacts["pair"] < 0)
    return contacts[walls[~anew[contacts["guest"][walls]]]]


def _copy(contacts: Touch, to: Touch) -> None:
    # as bytes, which takes no lock and goes through no fields
    to.view(np.uint8)[:] = contacts.view(np.uint8)


def new_touch(count: int = _FIRST_CAPACITY) -> Touch:
    """Room for that many contacts."""
    return np.zeros(count, dtype=CONTACT_DTYPE)


def _call(work: Callable[[], None]) -> None:
    work()


def _one_by_one(function: Callable[[Any], None], numbers: Iterable[Any]) -> None:
    for number in numbers:
        function(number)


def _no_clearance(surfaces: VaneSurfaces) -> Clearance:
    """Nothing looked at yet, and no pairs."""
    bodies, _, rows, columns, _ = surfaces.exists.shape
    return Clearance(
        frame=np.zeros((bodies, 4, 3)),
        nodes=np.zeros((*surfaces.half.shape, 3)),
        half=surfaces.half.max(axis=(1, 2), initial=0.0),
        facets=np.zeros((bodies, 17, 4 * rows * columns)),
        facet_count=np.zeros(bodies, dtype=np.int64),
        size=np.zeros(bodies),
        extent=np.zeros(bodies),
        as_guest=np.zeros(bodies),
        as_host=np.zeros(bodies),
        until=np.zeros(0),
        pose=np.zeros((0, 12)),
        wait=np.zeros(0, dtype=np.int8),
    )


def neighbours(pairs: Indices, bodies: int) -> ByBody:
    """List which bodies each touches. pairs: (N, 2) bodies that touch."""
    both = np.concatenate([pairs, pairs[:, ::-1]])
    body, other = np.divmod(distinct(both[:, 0] * bodies + both[:, 1]), bodies)
    return ByBody(np.searchsorted(body, np.arange(bodies + 1)).astype(np.int64), other)


def islands_of(touching: ByBody) -> tuple[int, Indices]:
    """Count the islands of bodies that touch, directly or through others; return also (B,) in which
    each body is."""
    from scipy.sparse import csr_array
    from scipy.sparse.csgraph import connected_components

    bodies = len(touching.first) - 1
    parts = np.ones(len(touching.items)), touching.items, touching.first
    graph = csr_array(parts, shape=(bodies, bodies))
    count, island = connected_components(graph, directed=False)
    return int(count), island.astype(np.int64)
