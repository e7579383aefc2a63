"""Contact groups: feathers that may ever touch, simulated as if the others were not there.

Feathers are of one island where their boxes meet at rest, each a quarter of its length larger, or
where, at any frame, the balls about their roots meet in which they stay however they bend. What
grips or forces of the shot drag farther than that is not looked for. An island takes common steps
of its own (shot/contact), so its motion does not depend on what else the shot holds, and it is what
shares of a shot are made of. Small ones are put together, since steps cost something by themselves.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import scipy

from featherfx.algebra.types import Array, Indices
from featherfx.feather.placed_feathers import build_feathers
from featherfx.feather.types import Feather
from featherfx.files.content import digest
from featherfx.mechanics.batch import may_slip
from featherfx.shot.contact.pairs import PAIR_REACH_RATIO, joined, meeting
from featherfx.shot.detail.guides import guide_weights
from featherfx.shot.frames import place
from featherfx.shot.loop.groups import ALONE
from featherfx.shot.motion.motion import root_motion
from featherfx.shot.options import ShotOptions
from featherfx.shot.roots import Roots
from featherfx.shot.types import Shot, may_touch

# feathers of an island that is put together with others, and into how many islands at most
SMALL, MAX_OF_SMALL = 8, 16


def pushing_islands(
    shot: Shot, drawn: Sequence[Feather], motion: Roots, options: ShotOptions
) -> Indices:
    """(F,) number of every feather's island in a shot with contact, from 0, in the order of their
    first feathers; ALONE for feathers that its contact leaves out, which join no islands either.

    drawn: all feathers of the shot on one grid. motion: of their roots. options: of all feathers.
    """
    assert shot.contact is not None
    found = np.full(len(drawn), ALONE)
    some = np.flatnonzero(may_touch(shot, shot.contact))
    if len(some):
        found[some] = _few(_led_together(shot, options, some, _near(shot, drawn, motion, some)))
    return found


def _led_together(shot: Shot, options: ShotOptions, some: Indices, island: Indices) -> Indices:
    """The islands (S,) of some feathers, those made one of which one follows guides in the other:
    it pushes feathers of both."""
    assert shot.contact is not None
    guided = options.at_level("guided")
    if not shot.contact.obstacles or not len(guided) or island.max() == 0:
        return island
    guides, weights = guide_weights(shot, guided, options.leading)
    pairs, own = weights.tocoo(), np.full(len(shot.groom.feathers), ALONE)
    own[some] = island
    ends = own[guided[pairs.row]], own[guides[pairs.col]]
    both = (ends[0] != ALONE) & (ends[1] != ALONE)
    links = np.ones(int(both.sum())), (ends[0][both], ends[1][both])
    count = int(island.max()) + 1
    graph = scipy.sparse.coo_array(links, shape=(count, count))
    joint = scipy.sparse.csgraph.connected_components(graph, directed=False)[1][island]
    _, first, number = np.unique(joint, return_index=True, return_inverse=True)
    return np.asarray(np.argsort(np.argsort(first))[number])


def _near(shot: Shot, drawn: Sequence[Feather], motion: Roots, some: Indices) -> Indices:
    """(S,) island of some feathers, by their numbers: of those that come near each other."""
    chosen = [(drawn[f], shot.groom.feathers[f]) for f in some.tolist()]
    nodes = [
        place(feather.rest, own.position, own.rotation).nodes.reshape(-1, 3)
        for feather, own in chosen
    ]
    roots = np.array([own.position for _, own in chosen])
    margin = PAIR_REACH_RATIO * np.array([feather.station[-1] for feather, _ in chosen])[:, None]
    low = np.stack([each.min(axis=0) for each in nodes]) - margin
    high = np.stack([each.max(axis=0) for each in nodes]) + margin
    island = joined(np.arange(len(nodes)), low, high)
    radius = margin + np.array(
        [np.linalg.norm(each - root, axis=1).max() for each, root in zip(nodes, roots, strict=True)]
    ).reshape(-1, 1)
    for frame in range(shot.last_frame - shot.first_frame + 1):
        if island.max() == 0:
            break
        now = motion.frames(frame / shot.frames_per_second)[0][some]
        island = _come_near(island, now - radius, now + radius)
    return island


def _come_near(island: Indices, low: Array, high: Array) -> Indices:
    """The islands, those made one of which feathers' boxes (F, 3) meet."""
    count = int(island.max()) + 1
    least, most = np.full((count, 3), np.inf), np.full((count, 3), -np.inf)
    np.minimum.at(least, island, low)
    np.maximum.at(most, island, high)
    if not len(meeting(least, most)):
        return island
    return joined(island, low, high)


def _few(island: Indices) -> Indices:
    """The islands, small ones put together in their order."""
    sizes = np.bincount(island)
    small = np.flatnonzero(sizes < SMALL)
    room = max(SMALL, -(-int(sizes[small].sum()) // MAX_OF_SMALL))
    number, filled = np.arange(len(sizes)), room
    for each in small.tolist():
        if filled + sizes[each] > room:
            first, filled = each, 0
        number[each] = first
        filled += int(sizes[each])
    return np.unique(number[island], return_inverse=True)[1]


def add_islands(shot: Shot, options: ShotOptions, own: Sequence[str]) -> list[str]:
    """Texts of what feathers depend on, with those of all feathers of their islands."""
    drawn = build_feathers(shot.groom.feathers, shot.quality.rows, shot.quality.columns)
    islands = pushing_islands(shot, drawn, root_motion(shot), options)
    slips = any(may_slip(each.kind) for each in shot.groom.feathers)
    placements, result = shot.groom.feathers, list(own)
    for number in np.unique(islands[islands != ALONE]).tolist():
        members = np.flatnonzero(islands == number).tolist()
        some = [placements[f] for f in members]
        labels = [(each.id, each.region, each.kind.name) for each in some]
        # places in the order of the layout, as far as these feathers go
        order = np.unique([each.rank for each in some], return_inverse=True)[1]
        laid = order, [each.rank < 0 for each in some]
        parts = [own[f] for f in members], labels, *laid
        together = digest(*parts, shot.contact, shot.colliders, slips)
        for f in members:
            result[f] = digest(own[f], together)
    return result
