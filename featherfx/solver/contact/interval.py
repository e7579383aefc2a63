"""Contact between the feathers of several batches: one interval of time for all of them.

Each feather is still solved on its own. A contact is a pair of forces, one on either body; in
turn, each body is solved against the plane of the other with the force that the other felt last
and a spring about as stiff as the softer of the two (`featherfx/mechanics/contact_kernels.py`).
Where the stiffness fits, one round is enough; forces of the interval before make a good start.
Opposite forces become equal as the rounds converge. (Robin transmission conditions: Lions 1990; the
fit of the stiffness: optimised Schwarz methods, Gander 2006.)
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from featherfx.algebra.types import Flags
from featherfx.files.process import limit_threads
from featherfx.jit.compiled import KernelModule
from featherfx.mechanics.model import Loads
from featherfx.solver.contact.run import (
    BatchRun,
    RoundRules,
    Sweep,
    Team,
    islands_before,
    no_colours,
    room_for_forces,
)
from featherfx.solver.contact.search import (
    ContactSearch,
    Searcher,
    islands_of,
    neighbours,
    new_touch,
)
from featherfx.solver.contact.surfaces import (
    NEAR_ROOT_OF_OBSTACLE,
    WALL_FIT,
    as_torn,
    carried_mass,
    elastic_stiffness,
    grids_of,
    moving_bodies,
    no_memory,
    shapes_of,
    surfaces_of,
)
from featherfx.solver.contact.types import (
    FOR_GOOD,
    FOR_NOW,
    PLAIN_INTERVAL,
    Array,
    ByBody,
    Candidates,
    ContactMemory,
    ContactReport,
    ContactSettings,
    GroundSurface,
    HandoverRules,
    Indices,
    IntervalOptions,
    SearchSettings,
    Wall,
)
from featherfx.solver.solver import Solver, StepReport
from featherfx.solver.state import RootPath, State

list_kernels = KernelModule("featherfx.solver.contact.list_kernels")
meeting_kernels = KernelModule("featherfx.solver.contact.meeting_kernels")
integrator_kernels = KernelModule("featherfx.solver.step.integrator_kernels")


# springs of a round over the estimated stiffness of one node: of 2 to 16, 8 took the fewest
# iterations in a dense plumage (stiffer ones leave feathers unsolved); over the inertia of bodies
# that nothing pressed before, 2: a collision takes a third of the rounds
_FIT, _STRUCK_FIT = 8.0, 2.0
# spectral radius of steps that bodies share: only with 0 does a blow of one step return no more
# speed than it takes, as b (1 - af) / (1 - am) >= 1/2 (integrator_kernels)
_SHARED_RADIUS = 0.0
# error for which such steps are chosen, over the tolerance: forces between bodies carry it on
_SHARED_TOLERANCE_RATIO = 0.1
# frames over which what rounds leave may add up, and to what part of the tolerance
_FRAMES, _LEFT = 2.0, 0.4
# force between two bodies, over that before, beyond which it is a blow
_BLOW = 2.0
# depth that jams a feather, over that beyond which two are no longer kept apart
_JAMMED_RATIO = 0.2
# N/m, of what is led and gives way to nothing; weights of corners, and sums, have to stay finite
_RIGID = 1e150
# searches for contacts in one interval: the poses at its end are not known before; margin of the
# next, over the way that a body went against expectation
_MAX_SEARCHES, _WIDER = 4, 2.0
# margin, over the way along an axis, with which two bodies that both go so far do not touch;
# least margin of a first search, over the largest: one thickness; part of a surprise that stays
# expected for the next interval
_CLOSING_RATIO, _MIN_MARGIN_RATIO, _EXPECTED_RATIO = 2.0, 1.0 / 6.0, 0.9
_MIN_RESIDUAL = 1e-9  # m, below which rounds see no more than what is left of the solves


class ContactSolver:
    """Steps several batches together; keeps the contact forces from interval to interval.

    solvers: of the batches, whose grids may differ. candidates: what may touch, by body (all
    feathers of the first batch, then the next). halves: m, half thickness per body. passed: pairs
    (N, 2) of bodies that accept let pass, with their depths (N,), m. free: (B,) bodies that the
    last interval solved; held: (B,) those whose roots are led.
    """

    def __init__(
        self,
        solvers: Sequence[Solver],
        candidates: Candidates,
        halves: Sequence[float] | Array,
        settings: ContactSettings,
    ) -> None:
        self.solvers, self.settings = tuple(solvers), settings
        self.candidates = candidates
        self._models = models = [solver.model for solver in solvers]
        self.grids = grids_of(models)
        self.surfaces = self._whole = surfaces_of(shapes_of(models), self.grids, halves)
        self._elastic = self.grids.together([elastic_stiffness(model) for model in models])
        firm = [elastic_stiffness(model, NEAR_ROOT_OF_OBSTACLE) for model in models]
        self._firm = self.grids.together(firm)
        self._mass = self.grids.together([carried_mass(model) for model in models])
        bodies = self.grids.bodies
        widest = max(self.solvers, key=lambda solver: solver.jobs)
        self._searcher = Searcher(candidates, self.surfaces, widest.jobs, widest.for_each)
        self._team = Team(solvers, self.grids)
        self._colours = no_colours(bodies)
        thickest = float(np.max(halves, initial=np.finfo(float).tiny))
        self._thinnest = float(np.min(halves, initial=thickest))
        self._margin = settings.margin / thickest * np.asarray(halves)
        self._touching: tuple[Indices, ByBody] | None = None
        self.free = np.ones(bodies, dtype=np.bool_)
        self.held = np.concatenate([model.held for model in models])
        self._led = np.zeros(bodies, dtype=np.int8)
        self._deepest = np.broadcast_to(settings.deepest, bodies)
        self.passed: list[tuple[Indices, Array]] = []
        self.memory = no_memory(self.surfaces)
        self._surprise = self.memory.surprise
        self._searched: Array | None = None
        self.found, self._spare = ContactSearch(new_touch(), 0), new_touch()
        self._listed = ByBody(np.zeros(bodies + 1, dtype=np.int64), np.zeros(0, dtype=np.int64))

    def add_pairs(self, pairs: Indices) -> None:
        """(N, 2) bodies that may meet from now on, each pair in both roles; nothing tells on which
        side of each other they belong but where they are when they come near."""
        known = self.candidates
        self.candidates = Candidates(
            np.concatenate([known.pairs, pairs]),
            np.concatenate([known.order, np.zeros(len(pairs), dtype=np.int64)]),
            np.concatenate([known.depth, np.zeros(len(pairs))]),
        )
        self._searcher.take_on(self.candidates)

    def let_pass(self, pairs: Indices) -> None:
        """Keep some candidates (N,) apart no longer, in either role; their forces end."""
        ends = np.sort(self.candidates.pairs, axis=1) @ [self.grids.bodies, 1]
        self.candidates.depth[np.isin(ends, ends[pairs])] = np.inf

    def begin_frame(self) -> None:
        """Keep no matrix of the intervals before, so that what is stored goes on the same way."""
        self._team.forget()

    def interval(
        self,
        states: Sequence[State],
        loads: Sequence[Loads],
        paths: Sequence[RootPath],
        duration: float,
        walls: Sequence[Wall | GroundSurface] = (),
        manner: IntervalOptions = PLAIN_INTERVAL,
    ) -> tuple[list[State], list[StepReport], ContactReport]:
        """Advance all batches by a duration in s; the given states are not changed.

        walls: bodies whose motion over the duration is given; of several, a node meets each. A
        feather that cannot be solved has a status in its batch's report, and then what it presses
        is not solved either; what settles ends with it.
        """
        self._tear(states)
        substeps, resting, left_out, led, iterations, turns, settling, lost = manner
        free = np.ones(self.grids.bodies, dtype=np.bool_) if led is None else led.free
        shares = self._followed(duration)
        run = BatchRun(
            self._team, states, loads, paths, duration, substeps, iterations, free, shares
        )
        if not settling:
            run.alone = run.like_free(self.settings.newton, self.settings.frame)
        self._led = (FOR_NOW * ~free).astype(np.int8)
        if led is not None:
            run.start[~free], run.now[~free] = led.start[~free], led.end[~free]
            self._led[led.fixed] = FOR_GOOD
        self.free, memory, rounds = free, self.memory, 0
        stale = free.copy() if resting is None else free & ~resting
        before, forces = ContactSearch(new_touch(1), 0), np.zeros(self.grids.bodies)
        # what settles is stopped after each step, and headed nowhere
        surprise = np.full_like(self._margin, np.inf) if settling else memory.surprise
        run.moves[free] = np.minimum(surprise * duration**2, self.settings.margin)[free]
        expected = _WIDER * _CLOSING_RATIO * surprise * duration**2
        margin = np.clip(expected, _MIN_MARGIN_RATIO * self._margin, self._margin)
        off, trusted = np.zeros(self.grids.bodies), margin / _CLOSING_RATIO
        moved, searched = np.zeros(self.grids.bodies), self._searched_room(run.now)
        for number in range(_MAX_SEARCHES):
            np.copyto(searched, run.now)
            looked = stale if number else free
            self._find(run, walls, (memory, before), looked, margin, (turns, number > 0), left_out)
            if number:
                # forces that are new may move them far
                run.moves[free] = self.settings.margin
                stale = self._changed(stale, forces) & free
            solved = self._solve(run, stale & (off == 0.0), off > 0.0)
            rounds += int(solved.islands.rounds.max(initial=0))
            meeting_kernels.largest_moves(run.now, searched, free, moved)
            worst = solved.marks.worst
            off = np.where(worst > lost, worst, off)
            if number == 0:
                known = np.where(np.isinf(surprise), 0.0, _EXPECTED_RATIO * surprise)
                latest = np.maximum(moved / duration**2, known)
                self._surprise = np.where(free & (not settling), latest, surprise)
            stale, before = (moved >= trusted) & ~run.failed() & (off == 0.0), self.found
            if not stale.any() or (settling and run.failed().any()):
                break
            # the bodies did not go where they were headed: look again where they went, and wider
            margin[stale] = np.minimum(_WIDER * moved[stale], self.settings.margin)
            trusted = margin
            list_kernels.add_forces(*self.found, forces)
            order = self.candidates.order
            memory = self.found.remembered(order, self._found_in, self.memory)
        # what is not where contacts were searched may have missed some
        off = np.maximum(np.maximum(off, worst), np.where(stale, moved, 0.0))
        contacts = self.found.contacts
        report = ContactReport(
            contacts=int(np.count_nonzero(contacts["guest_force"] > 0.0)),
            rounds=rounds,
            solves=int(run.solves.sum()),
            residual=float(off.max()),
            depth=float(solved.marks.depth.max()),
            start_depth=float(contacts["spared"].max(initial=0.0)),
            off=off,
            deep=solved.marks.depth,
        )
        run.end_blows(self._struck())
        run.finish()
        return run.new, run.reports(), report

    def _searched_room(self, like: Array) -> Array:
        """Room for where contacts were searched, which is written over in every interval: new
        memory takes the system as long as what is done with it."""
        if self._searched is None:
            self._searched = np.empty_like(like)
        return self._searched

    def _tear(self, states: Sequence[State]) -> None:
        """Take the surfaces as the gaps of the states leave them."""
        if not any(model.hooked for model in self._models):
            return
        before = self.surfaces
        self.surfaces = as_torn(self._whole, self.grids, self._models, states)
        if (self.surfaces.exists > before.exists).any():
            self._searcher.forget()

    def accept(self, but: Flags | None = None, jammed: Flags | None = None) -> None:
        """Keep the forces of the last interval for the next one. but: (B,) bodies of which, and of
        what touches them, those before are kept. Pairs that are in each other by more than the
        settings' deepest pass from now on, and are told by passed."""
        self._let_deep_pass(but, jammed)
        kept = ~self.free if but is None else ~self.free | but
        found_in = self._found_in._replace(surprise=self._surprise)
        new = self.found.remembered(self.candidates.order, found_in)
        self.memory = self._joined(self.memory, new, kept, but) if kept.any() else new

    def _let_deep_pass(self, but: Flags | None, jammed: Flags | None) -> None:
        """Let pairs pass that are too deep in each other; but, jammed: of accept."""
        guest, host, depth = self.depths()
        most = self._deepest
        if jammed is not None:
            most = np.where(jammed, _JAMMED_RATIO * most, most)
        deep = (depth > np.minimum(most[guest], most[host])) & (host >= 0)
        if but is not None:
            deep &= ~but[guest] & ~but[host]
        if deep.any():
            pairs = self.found.contacts["pair"][deep]
            self.let_pass(pairs)
            self.passed.append((self.candidates.pairs[pairs], depth[deep]))

    def _joined(
        self, old: ContactMemory, new: ContactMemory, kept: Flags, but: Flags | None
    ) -> ContactMemory:
        """Memories as one: the old of bodies that are kept (B,), the new of the others, by which
        pairs of both kinds go, if none of them is of but (accept)."""
        _, rows, columns = old.wall.shape
        guest, host = self.candidates.pairs.T
        stays = kept[guest] & kept[host]
        if but is not None:
            stays |= but[guest] | but[host]
        parts = [
            (each, stays[each.key // (rows * columns)] == is_old)
            for each, is_old in ((old, True), (new, False))
        ]
        key = np.concatenate([each.key[chosen] for each, chosen in parts])
        order = np.argsort(key, kind="stable")
        bodies = kept[:, None, None]
        return ContactMemory(
            key=key[order],
            force=np.concatenate([each.force[chosen] for each, chosen in parts])[order],
            side=np.concatenate([each.side[chosen] for each, chosen in parts])[order],
            wall=np.where(bodies, old.wall, new.wall),
            inside=np.where(bodies, old.inside, new.inside),
            surprise=np.where(kept, old.surprise, new.surprise),
        )

    def pressed(self) -> Indices:
        """(N, 2) bodies that a force of the last interval holds apart."""
        contacts = self.found.contacts
        held = (contacts["guest_force"] > 0.0) | (contacts["host_force"] > 0.0)
        held &= contacts["host"] >= 0
        return np.unique(
            np.stack([contacts["guest"][held], contacts["host"][held]], axis=1), axis=0
        )

    def _struck(self) -> Flags:
        """(B,) bodies that another, which is solved as well, presses by more than _BLOW of the
        force before."""
        contacts, bodies = self.found.contacts, self.grids.bodies
        contacts = contacts[(contacts["host"] >= 0) & (contacts["guest_force"] > 0.0)]
        _, rows, columns = self.memory.wall.shape
        pair = np.concatenate([contacts["pair"], self.memory.key // (rows * columns)])
        force = [contacts["guest_force"], -_BLOW * self.memory.force.mean(axis=1)]
        ends = np.sort(self.candidates.pairs[pair], axis=1) @ [bodies, 1]
        both, place = np.unique(ends, return_inverse=True)
        change = np.bincount(place, np.concatenate(force), len(both))
        blows = np.stack(np.divmod(both[change > 0.0], bodies))
        struck = np.zeros(bodies, dtype=np.bool_)
        struck[blows[:, self.free[blows].all(axis=0)]] = True
        return struck

    def depths(self) -> tuple[Indices, Indices, Array]:
        """Return the last interval's contacts: guest and host (bodies; -1 for a wall), depth in
        m."""
        contacts = self.found.contacts
        return contacts["guest"], contacts["host"], contacts["spared"] - contacts["gap"]

    def _find(
        self,
        run: BatchRun,
        walls: Sequence[Wall | GroundSurface],
        known: tuple[ContactMemory, ContactSearch],
        stale: Flags,
        margin: Array,
        manner: tuple[bool, bool],
        left_out: Flags | None,
    ) -> None:
        """Search for contacts of stale bodies, those known before hold on for others; the room
        grows. margin: of Search; manner: turns and again (Search). left_out: of IntervalOptions."""
        settings, (memory, before), (turns, again) = self.settings, known, manner
        inertia = self._inertia(run.duration) * self._mass
        whole, firm = _FIT * (inertia + self._elastic), _FIT * (inertia + self._firm)
        pressing = self._count_pressing(memory)[:, None, None]
        struck = np.where(pressing > 0, _FIT, _STRUCK_FIT) * inertia
        elastic = _FIT * self._pull() / np.maximum(pressing, 1)
        impedance, leeway = struck + elastic, self._leeway(struck, elastic, run.duration)
        impedance[~self.free] = leeway[~self.free] = _RIGID
        bodies = moving_bodies(run.start, run.now, impedance)
        self._found_in = memory._replace(inside=memory.inside.copy())
        search = SearchSettings(
            self.surfaces,
            bodies._replace(whole=whole, firm=firm, led=self._led, leeway=leeway),
            self._found_in,
            margin,
            settings.margin,
            settings.recovery * run.duration,
            WALL_FIT,
            turns,
            again,
        )
        found = self._searcher.find(search, walls, before, stale, self._spare, self.free)
        if left_out is not None:
            found = found.without(left_out)
        self._spare, self.found = self.found.touch, found
        if len(self._listed.items) < 2 * found.number:
            room = np.zeros(4 * found.number, dtype=np.int64)
            self._listed = self._listed._replace(items=room)
        list_kernels.list_by_body(*found, self._listed)

    def _count_pressing(self, memory: ContactMemory) -> Indices:
        """(B,) contacts that press each body together and share its elasticity.

        With a spring as stiff as the whole body for each of N, a round would remove an N-th of what
        is amiss.
        """
        _, rows, columns = memory.wall.shape
        pair = memory.key[memory.force.max(axis=1, initial=0.0) > 0.0] // (rows * columns)
        bodies = self.candidates.pairs[pair].ravel()
        return np.bincount(bodies, minlength=self.grids.bodies)

    def left_in_frame(self) -> Array:
        """(B,) m, by which rounds may leave the motion of each body in a frame off, as others press
        it."""
        left = _LEFT / _FRAMES * self.settings.tolerance
        return np.where(self._count_pressing(self.memory) > 0, left, 0.0)

    def _followed(self, duration: float) -> Array:
        """(B, n, 1 + 2 m) part of what its root goes, beyond where a node is headed, that the node
        goes along in a duration (s): that of an implicit step of the node's mass on a spring."""
        pull, inertia = self._pull(), self._inertia(duration) * self._mass
        return np.divide(pull, pull + inertia, out=np.zeros_like(pull), where=pull > 0.0)

    def _pull(self) -> Array:
        """(B, n, 1 + 2 m) N/m, elastic stiffness of nodes towards a root that holds them."""
        return np.where(self.held[:, None, None], self._elastic, 0.0)

    def _inertia(self, duration: float) -> float:
        """1/s^2, stiffness of an implicit step over the mass."""
        return float(integrator_kernels.integrator_of(_SHARED_RADIUS, duration).inertia)

    def _changed(self, stale: Flags, forces: Array) -> Flags:
        """(B,) bodies that feel other forces (N) than before: what was found then, of another body
        or at another place, pressed as well; and those that are stale and pressed, by planes that
        may have turned. Whether others have new contacts their gaps tell."""
        found = np.zeros_like(forces)
        list_kernels.add_forces(*self.found, found)
        pressed = (found > 0.0) | (forces > 0.0)
        return np.asarray((np.abs(found - forces) > 1e-9 * forces) | (stale & pressed))

    def _solve(self, run: BatchRun, stale: Flags, lost: Flags) -> Sweep:
        """Rounds of solves with the contacts found; what they ended with.

        stale: (B,) bodies that are solved in the first round, whatever their contacts. lost:
        (B,) those that stay where they are.
        """
        settings = self.settings
        touching = self._neighbours()
        count, island = islands_of(touching)
        island[~self.free | run.failed() | lost] = -1
        marks = run.marks(island, stale, (self._led == FOR_GOOD).astype("i1"))
        islands = islands_before(count, island, limit_threads(self._team.jobs))
        room = 3 * int(np.diff(self._listed.first).max(initial=0))
        sweep = Sweep(
            batches=run.batches(room),
            step=run.step,
            alone=run.alone,
            shared=run.step._replace(
                shortest=run.duration,
                spectral_radius=_SHARED_RADIUS,
                shared=_SHARED_TOLERANCE_RATIO,
            ),
            touch=self.found.touch,
            contacts=self.found.number,
            listed=self._listed,
            touching=touching,
            handing=self._handing(run),
            rules=RoundRules(
                rounds=settings.rounds,
                thickness=2.0 * self._thinnest,
                friction=settings.friction > 0.0,
            ),
            start=run.start,
            now=run.now,
            marks=marks,
            islands=islands,
            colours=self._colours,
            joint=room_for_forces(islands, island, self._owners(island), self._listed),
        )
        self._team.solve(sweep)
        return sweep

    def _owners(self, island: Indices) -> Indices:
        """(K,) bodies whose islands (B,) the contacts are of."""
        guest, host = self.found.contacts["guest"], self.found.contacts["host"]
        return np.asarray(np.where((island[guest] >= 0) | (host < 0), guest, host))

    def _leeway(self, inertial: Array, elastic: Array, duration: float) -> Array:
        """(B, n, 1 + 2 m) N, that forces of an interval h (s) may be off by: in a time T they move
        a feather of mass m and stiffness k by dF / (m / T^2 + k).

        inertial, elastic: N/m, parts of the impedance, the former with 1 / h^2.
        """
        part = duration / max(duration, _FRAMES * self.settings.frame)
        left, least = _LEFT * self.settings.tolerance, _MIN_RESIDUAL * (inertial + elastic)
        return np.maximum(left * (part**2 * inertial + elastic), least)

    def _handing(self, run: BatchRun) -> HandoverRules:
        slip = self.settings.smoothing * run.duration
        widest, columns = self.grids.most_columns, self.surfaces.columns
        reach = np.zeros(len(columns))
        return HandoverRules(self.settings.friction, slip, reach, widest, columns)

    def _neighbours(self) -> ByBody:
        """List which bodies each has contacts with."""
        pair = self.found.contacts["pair"]
        touching = pair[(pair >= 0) & (np.diff(pair, prepend=-1) > 0)]
        if self._touching is None or not np.array_equal(touching, self._touching[0]):
            near = neighbours(self.candidates.pairs[touching], self.grids.bodies)
            self._touching = touching, near
        return self._touching[1]
