"""Contact pairs of a groom: feathers that may touch, and which of two lies over the other.

At rest the groom's layers tell the order: where one feather's nodes lie over another's vane, their
sides are counted, and the clear majority holds for the shot. Where both feathers have leaves in a
coat, their stacking values tell the order instead. What does not overlap at rest gets its order
through feathers between, paired with both (over the one that is over the other). Where two cut
through each other, about half of each on either side, the larger half tells, unless that would
close a ring: without an order each node would stay on its side, and the two crossed. Feathers that
are far from each other at rest and come near later have no order: each stays on its side. Two that
grow back to back, as on both sides of a wing, each belong under the other, whatever their poses
say; where these are through each other, `raised` says how far to turn them up before they settle.

Feathers of a coat are at rest as they are drawn. A pair with one of them, or without an order,
keeps the depth that it has at rest: contact stores no energy in the drawn pose, and pushes nothing
out of it.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import groupby, pairwise
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from featherfx.algebra.types import Array, Indices
from featherfx.feather.placed_feathers import build_feathers
from featherfx.feather.types import Feather
from featherfx.files.disk_cache import kept
from featherfx.groom.types import Placement
from featherfx.jit.compiled import KernelModule
from featherfx.shot.frames import place
from featherfx.shot.types import Contact
from featherfx.solver.contact.search import Searcher
from featherfx.solver.contact.surfaces import (
    WALL_FIT,
    Grids,
    VaneShapes,
    moving_bodies,
    no_memory,
    surfaces_of,
)
from featherfx.solver.contact.types import Candidates, SearchSettings, VaneSurfaces
from featherfx.solver.state import RootPath, State

meeting_kernels = KernelModule("featherfx.solver.contact.meeting_kernels")


# feathers are paired at rest where their boxes meet when each is larger by this, over its length
PAIR_REACH_RATIO = 0.25
# nodes within this, over the length, count for the order at rest
_NEAR = 0.1
# part of the nodes by which one side must lead
_CLEAR = 0.2
# depth at rest, over the shorter feather's length, that an order may ask to be undone
DEEP = 0.05
# the same where the larger half of two that cut through each other is all that tells: some row
# of feathers came apart at 0.020, one at 0.029 found no balance
LEANING = 0.025
# times that feathers become fine where they are through each other at rest: a pigeon needs two
_REFINEMENTS = 2
# cosine between the backs of two feathers that grow on both sides of something; rad, most that such
# are turned up by
OPPOSED, MAX_RAISED = -0.5, 1.0


# rows and columns
Grid = tuple[int, int]


class FeathersAtRest(NamedTuple):
    """nodes: per feather (n, 1 + 2 m, 3) m, in the world. lengths: (F,) m. ranks: (F,) places in
    the order of the stacking values of a coat, upwards, -1 without a leaf. dorsal: (F, 3) unit
    vectors at the roots."""

    nodes: Sequence[Array]
    lengths: Array
    ranks: Indices
    dorsal: Array


class Layered(NamedTuple):
    """Feathers that may meet. pairs, order, depth: as Candidates', each pair in both roles.
    crossed: (N,) m, how far at rest both feathers of a pair that stays so are through each other:
    without an order on the side where it is less, else how far points are beyond the other; 0 of
    all others. raised: (F,) rad, how far feathers have to be turned up about their roots to be
    clear of those that they grow back to back with and are through."""

    pairs: Indices
    order: Indices
    depth: Array
    crossed: Array
    raised: Array

    def through(self, thickness: Array) -> NDArray[np.bool_]:
        """(N,) which pairs are through each other by more than the thinner vane of (F,) m."""
        found = self.crossed > thickness[self.pairs].min(axis=1)
        return np.asarray(found | np.roll(found, len(found) // 2))  # in either role


def at_rest(feathers: Sequence[Feather], placements: Sequence[Placement]) -> FeathersAtRest:
    """Placed feathers at rest."""
    return FeathersAtRest(
        nodes=[
            place(feather.rest, placement.position, placement.rotation).nodes
            for feather, placement in zip(feathers, placements, strict=True)
        ],
        lengths=np.array([feather.station[-1] for feather in feathers]),
        ranks=np.array([placement.rank for placement in placements]),
        dorsal=np.stack([placement.rotation[:, 2] for placement in placements]),
    )


def thicknesses(placements: Sequence[Placement], contact: Contact) -> Array:
    """(F,) m, of vanes as contact has them."""
    own = [each.kind.vane_material.thickness for each in placements]
    return np.array(own if contact.thickness is None else [contact.thickness] * len(own))


def finer_where_crossed(
    placements: Sequence[Placement], contact: Contact, grids: Sequence[Grid], fine: Grid
) -> list[Grid]:
    """Return the grids of feathers, a fine one of those that are through others at rest on theirs.

    The chords of neighbours on one grid lie alike: where one becomes finer, others may have to.
    """
    found, built = list(grids), dict[Grid, list[Feather]]()
    for _ in range(_REFINEMENTS):
        for grid in {*found} - {*built}:
            built[grid] = build_feathers(placements, *grid)
        order = sorted(range(len(found)), key=lambda f: found[f])
        feathers, own = [built[found[f]][f] for f in order], [placements[f] for f in order]
        thickness = thicknesses(own, contact)
        batches = [[*some] for _, some in groupby(feathers, key=lambda f: (f.rows, f.columns))]
        every = layered_pairs(at_rest(feathers, own), *_surfaces(batches, 0.5 * thickness))
        for k in np.unique(every.pairs[every.through(thickness)]):
            found[order[k]] = fine
    return found


def _surfaces(batches: Sequence[Sequence[Feather]], halves: Array) -> tuple[VaneSurfaces, Grids]:
    """Surfaces of feathers, by batches on one grid each. halves: m, of all."""
    shapes = [
        VaneShapes(
            np.stack([each.cell for each in some]),
            np.stack([each.barb_length / each.columns for each in some]),
            np.stack([np.diff(each.station) for each in some]),
        )
        for some in batches
    ]
    grids = Grids(
        np.concatenate([[0], np.cumsum([len(some) for some in batches])]),
        np.array([some[0].rows for some in batches]),
        np.array([some[0].columns for some in batches]),
    )
    return surfaces_of(shapes, grids, halves), grids


def layered_pairs(rest: FeathersAtRest, surfaces: VaneSurfaces, grids: Grids) -> Layered:
    """Feathers that may meet, and which of two lies over the other."""

    def compute() -> dict[str, Any]:
        pairs = _near_pairs(rest.nodes, rest.lengths)
        return _order_at_rest(pairs, rest, surfaces, grids)._asdict()

    return Layered(**kept("pairs", [rest, surfaces, grids], compute))


def _near_pairs(rest: Sequence[Array], lengths: Array) -> Indices:
    """(N, 2) guest and host of feathers that may meet, each pair in both roles."""
    nodes = [each.reshape(-1, 3) for each in rest]
    reach = PAIR_REACH_RATIO * lengths[:, None]
    low = np.stack([points.min(axis=0) for points in nodes]) - reach
    high = np.stack([points.max(axis=0) for points in nodes]) + reach
    pairs = meeting(low, high)
    return np.concatenate([pairs, pairs[:, ::-1]])


class Encounters:
    """Feathers that come to meet although they were far from each other at rest.

    pairs: (N, 2) that are known, in both roles. bodies: number of feathers.
    """

    def __init__(self, pairs: Indices, bodies: int) -> None:
        self._bodies = bodies
        self._known = np.sort(self._codes(pairs))

    def _codes(self, pairs: Indices) -> Indices:
        """(N,) a number for each pair."""
        return pairs[:, 0] * self._bodies + pairs[:, 1]

    def know(self, pairs: Indices) -> None:
        """Take pairs (N, 2) for known."""
        codes = np.sort(self._codes(pairs))
        self._known = np.insert(self._known, np.searchsorted(self._known, codes), codes)

    def new(
        self, states: Sequence[State], paths: Sequence[RootPath], duration: float, margin: float
    ) -> Indices:
        """(N, 2) pairs, in both roles, of feathers that were not known to meet, and may within a
        duration (s) as they and their roots move; they are known from now on. margin: m."""
        low, high = np.empty((2, self._bodies, 3))
        first = 0
        for state, path in zip(states, paths, strict=True):
            nodes, velocity = state.points.nodes, state.velocity.nodes
            own = slice(first, first := first + len(nodes))
            meeting_kernels.cover_ways(
                nodes, velocity, path.samples, duration, margin, low[own], high[own]
            )
        fresh = meeting(low, high)
        codes = self._codes(fresh)
        place = np.minimum(np.searchsorted(self._known, codes), len(self._known) - 1)
        fresh = fresh[self._known[place] != codes] if len(self._known) else fresh
        both = np.concatenate([fresh, fresh[:, ::-1]])
        if len(both):
            self.know(both)
        return both


def _order_at_rest(
    pairs: Indices, rest: FeathersAtRest, surfaces: VaneSurfaces, grids: Grids
) -> Layered:
    """Pairs (N, 2) with the side of the host where the guest belongs, 0 where nothing tells.

    An order that would have a feather deeper in another than a layout ever leaves it is no order.
    """
    ranks, shorter = rest.ranks, rest.lengths[pairs].min(axis=1)
    normals = np.stack([_normal_of(points) for points in rest.nodes])
    batches = pairwise(grids.first)
    points = grids.together([np.stack(rest.nodes[low:high]) for low, high in batches])
    votes = _votes(pairs, points, surfaces, shorter)
    half = len(pairs) // 2
    guest, host = pairs[:half].T
    agree = _agree(normals[guest], normals[host])
    # the guest is over its host where the host is under the guest, seen from equal normals
    both = votes.side[:half] - agree * votes.side[half:]
    total = votes.number[:half] + votes.number[half:]
    clear = np.abs(both) > _CLEAR * np.maximum(total, 1.0)
    seen = np.where(clear, np.sign(both), 0.0).astype(np.int64)
    laid = (ranks[guest] >= 0) & (ranks[host] >= 0)
    upward = _agree(normals, rest.dorsal)[host] * np.sign(ranks[guest] - ranks[host])
    order = np.where(laid, upward, seen)
    for other in (seen, np.zeros_like(seen)):
        order = np.where(_depths(order, agree, votes) > DEEP * shorter[:half], other, order)
    least = np.minimum(votes.over, votes.under)
    cut = least[:half] > 0.0
    lean = np.where(cut & (order == 0), np.sign(both), 0.0).astype(np.int64)
    lean = np.where(_depths(lean, agree, votes) > LEANING * shorter[:half], 0, lean)
    order = _through_others(pairs[:half], order, agree, lean)
    beneath = -_agree(normals, rest.dorsal)[host]
    coat = (ranks[guest] >= 0) | (ranks[host] >= 0)
    apart = _back_to_back(pairs[:half], rest) & (total > 0.0)
    passed = apart & (_depths(beneath, agree, votes) > DEEP * shorter[:half])
    order = np.where(apart & ~(passed & coat), beneath, order)
    raised = _raised(pairs[:half][passed & ~coat], rest)
    order, coat = np.concatenate([order, -agree * order]), np.tile(coat, 2)
    both = np.tile(np.minimum(least[:half], least[half:]), 2)
    deep = np.where(order > 0, votes.over, np.where(order < 0, votes.under, both))
    keeps = coat | (order == 0)
    crossed = np.where(keeps, np.maximum(deep, 0.0), 0.0)
    thickness = surfaces.half.max(axis=(1, 2))[pairs].sum(axis=1)
    depth = thickness + np.where(order == 0, np.minimum(least, 0.0), deep)
    return Layered(pairs, order, np.where(keeps, np.maximum(depth, 0.0), 0.0), crossed, raised)


def _back_to_back(pairs: Indices, rest: FeathersAtRest) -> NDArray[np.bool_]:
    """(P,) which of some pairs (P, 2) have roots beneath each other, or nearly so, and backs turned
    away."""
    dorsal, roots = rest.dorsal, np.stack([points[0, 0] for points in rest.nodes])
    guest, host = pairs.T
    way = roots[guest] - roots[host]
    away = np.einsum("pk,pk->p", dorsal[guest], dorsal[host]) < OPPOSED
    slack = DEEP * rest.lengths[pairs].min(axis=1)
    beneath = np.einsum("pk,pk->p", dorsal[host], way) <= slack
    return np.asarray(away & beneath & (np.einsum("pk,pk->p", dorsal[guest], way) >= -slack))


def _raised(pairs: Indices, rest: FeathersAtRest) -> Array:
    """(F,) rad, Layered.raised of pairs (P, 2) that are back to back and through each other: what
    brings a feather's nodes over the plane between them that goes through its root."""
    up, angle = np.zeros((len(rest.lengths), 3)), np.zeros(len(rest.lengths))
    apart = rest.dorsal[pairs[:, 0]] - rest.dorsal[pairs[:, 1]]
    np.add.at(up, pairs[:, 0], apart)
    np.add.at(up, pairs[:, 1], -apart)
    for k in np.unique(pairs):
        normal = up[k] / np.linalg.norm(up[k])
        from_root = (rest.nodes[k] - rest.nodes[k][0, 0]).reshape(-1, 3)
        height = from_root @ normal
        along = np.linalg.norm(from_root - height[:, None] * normal, axis=1)
        far = along > DEEP * rest.lengths[k]
        angle[k] = np.arctan2(-height[far], along[far]).max(initial=0.0)
    return np.minimum(angle, MAX_RAISED)


def _depths(order: Indices, agree: Indices, votes: _Votes) -> Array:
    """(P,) m, how deep at rest the pairs are that an order (P,) puts apart. agree: (P,)."""
    half = len(order)
    deep = [
        np.where(side > 0, over, np.where(side < 0, under, 0.0))
        for side, over, under in (
            (order, votes.over[:half], votes.under[:half]),
            (-agree * order, votes.over[half:], votes.under[half:]),
        )
    ]
    return np.maximum(*deep)


class _Votes(NamedTuple):
    """Sides of N pairs: sum of the sides of the guest's nodes over the host, their number, and m,
    how far its deepest is beyond the host if the guest belongs over it, and under."""

    side: Array
    number: Array
    over: Array
    under: Array


def _votes(pairs: Indices, rest: Array, surfaces: VaneSurfaces, shorter: Array) -> _Votes:
    """shorter: (N,) m, length of the shorter feather of each pair."""
    bodies = moving_bodies(rest, rest, np.ones(rest.shape[:3]))
    memory, count = no_memory(surfaces), len(pairs)
    votes = _Votes(*(np.full(count, each) for each in (0.0, 0.0, -np.inf, -np.inf)))
    octaves = np.floor(np.log2(shorter))
    for octave in np.unique(octaves):
        some = np.flatnonzero(octaves == octave)
        free = Candidates(pairs[some], np.zeros(len(some), dtype=np.int64), np.zeros(len(some)))
        margin = float(_NEAR * 2.0 ** (octave + 1.0))
        margins = np.full(len(rest), margin)
        search = SearchSettings(surfaces, bodies, memory, margins, margin, 0.0, WALL_FIT)
        found = Searcher(free, surfaces).find(search).contacts
        pair, side = some[found["pair"]], found["side"]
        height = side * (found["start_gap"] + found["thickness"] - found["spared"])
        np.add.at(votes.side, pair, side)
        np.add.at(votes.number, pair, 1.0)
        np.maximum.at(votes.over, pair, -height)
        np.maximum.at(votes.under, pair, height)
    return votes


def _normal_of(points: Array) -> Array:
    """(3,) normal of a feather's surface (n, 1 + 2 m, 3), on the whole; not of unit length."""
    m = points.shape[1] // 2
    across = points[:, m] - points[:, 2 * m]
    normal: Array = np.cross(np.gradient(points[:, 0], axis=0), across).sum(axis=0)
    return normal


def _agree(first: Array, second: Array) -> Indices:
    """(N,) 1 where vectors (N, 3) point alike, -1 where they are opposite."""
    return np.where(np.einsum("pk,pk->p", first, second) >= 0.0, 1, -1)


def _through_others(pairs: Indices, order: Indices, agree: Indices, lean: Indices) -> Indices:
    """Orders of pairs that have none, by the feathers between where all are oriented alike. lean:
    (P,) how pairs lie of which these tell nothing; 0: they have no order then.

    A feather is between two if it is paired with both: around a body, chains of others close.
    """
    over: dict[int, set[int]] = {}
    paired: dict[int, set[int]] = {}
    for (guest, host), side, same in zip(
        pairs.tolist(), order.tolist(), agree.tolist(), strict=True
    ):
        paired.setdefault(guest, set()).add(host)
        paired.setdefault(host, set()).add(guest)
        if side and same > 0:
            _add(over, (guest, host), side)
    found = order.copy()
    leaning = np.flatnonzero((order == 0) & (lean != 0))
    for k in [*leaning, *np.flatnonzero((order == 0) & (lean == 0) & (agree > 0))]:
        guest, host = pair = pairs[k].tolist()
        side, between = 0, paired[guest] & paired[host]
        if agree[k] > 0:
            side = _lies_over(guest, host, between, over) - _lies_over(host, guest, between, over)
        found[k] = side or lean[k]
        if lean[k] and agree[k] > 0:
            _add(over, pair, found[k])
    return found


def _add(over: dict[int, set[int]], pair: Sequence[int], side: int) -> None:
    """Take a pair's order to what each feather lies over."""
    upper, lower = pair if side > 0 else pair[::-1]
    over.setdefault(upper, set()).add(lower)


def _lies_over(upper: int, lower: int, between: set[int], over: dict[int, set[int]]) -> bool:
    """Return whether a feather lies over another, directly or by some between."""
    left, edge = between - {upper}, [upper]
    while edge:
        beneath = over.get(edge.pop(), set())
        if lower in beneath:
            return True
        edge += beneath & left
        left -= beneath
    return False


def meeting(low: Array, high: Array) -> Indices:
    """(N, 2) pairs of boxes that meet, the smaller number first, in ascending order.

    low, high: (B, 3) m, corners of the boxes.
    """
    order = np.argsort(low[:, 0], kind="stable")
    found = np.zeros((max(1024, 8 * len(low)), 2), dtype=np.int64)
    count = meeting_kernels.list_meeting(order, low, high, found)
    if count > len(found):
        found = np.zeros((count, 2), dtype=np.int64)
        meeting_kernels.list_meeting(order, low, high, found)
    # as one number each, which sorts many times as fast
    codes = np.sort(found[:count, 0] * len(low) + found[:count, 1])
    return np.stack(np.divmod(codes, max(len(low), 1)), axis=1)


def joined(parts: Indices, low: Array, high: Array) -> Indices:
    """(B,) part of each box, in the order of their first, those made one of which boxes meet.

    Boxes that meet are not listed: of thousands at one place there are millions of pairs.
    parts: (B,) of each box before. low, high: (B, 3) m, corners of the boxes.
    """
    _, first, number = np.unique(parts, return_index=True, return_inverse=True)
    leader = first[number]
    order = np.argsort(low[:, 0], kind="stable")
    meeting_kernels.join_meeting(order, low, high, leader, np.empty_like(order))
    return np.unique(leader, return_inverse=True)[1]
