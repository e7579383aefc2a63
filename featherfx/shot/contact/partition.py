"""Contact groups: feathers that may ever touch, simulated as if the others were not there.

Feathers are of one island where their boxes meet at rest, each a quarter of its length larger, or
where, at any frame, the balls about their roots meet in which they stay however they bend. What
grips or forces of the shot drag farther than that is not looked for. An island takes common steps
of its own (shot/contact), so its motion does not depend on what else the shot holds, and it is what
shares of a shot are made of. Small ones are put together, since steps cost something by themselves.

A share of a shot's feathers: disjoint work for several workers.

Feathers that nothing follows are dealt out in turn. A feather that follows guides needs these
simulated in its own share, so followers and guides are cut by where they stand: in halves of equal
work across the longest side of their box, and these again. Only guides near a cut are simulated in
more than one share.

Where feathers push each other, islands of those that may touch are dealt out, the largest first,
each to the share that has the fewest feathers. An island stays whole. Feathers that push nothing
are dealt out beside them as above.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import scipy

from featherfx.algebra.types import Array, Flags, Indices
from featherfx.errors import InputError, Problem, warn_input
from featherfx.feather.placed_feathers import build_feathers
from featherfx.feather.types import Feather
from featherfx.files.disk_cache import digest
from featherfx.mechanics.resolution import may_slip
from featherfx.shot.contact.pairs import PAIR_REACH_RATIO, joined, meeting
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
    from featherfx.shot.detail.guides import guide_weights  # only where some are guided

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


# work of a feather that follows guides, over that of one that is simulated
FOLLOWING = 0.1
# feathers of the largest share, over those of a fair one, from which on it is said
_UNEVEN = 1.5


def share_numbers(shot: Shot, index: int, count: int) -> Indices:
    """Numbers (K,), ascending, of the feathers of a share, index from 1 to count.

    Raises InputError where there are none.
    """
    most, islands = len(shot.groom.feathers), None
    if shot.contact is not None and count > 1:
        islands = shot_islands(shot)
        most = _most(islands)
    if not 1 <= index <= count <= most:
        message = f"{index}/{count} is no share. Give I/N, I from 1 to N, and N at most {most}"
        if islands is not None:
            message += ", the number of islands of feathers that may touch"
        raise InputError(Problem(str(shot.source), "feathers", message))
    return np.flatnonzero(_share_of_each(shot, count, islands) == index - 1)


def _share_of_each(shot: Shot, count: int, islands: Indices | None) -> Indices:
    """(F,) share of every feather, from 0. islands: (F,), where feathers push each other."""
    from featherfx.shot.detail.guides import uses_guides  # only for shares

    total = len(shot.groom.feathers)
    free = np.ones(total, dtype=np.bool_) if islands is None else islands < 0
    if not uses_guides(shot) or count == 1:
        share = (np.cumsum(free) - 1) % count
    else:
        share = _shares(shot, count)
    if islands is not None:
        share[~free] = _dealt(islands[~free], count)
    return _none_empty(share, count, free)


def share_count(shot: Shot, wanted: int) -> int:
    """Into how many shares a shot is cut where so many are wanted, at most one a feather; says so
    (InputWarning) where feathers that may touch, and stay together, make them fewer or uneven."""
    islands = None
    count = min(wanted, len(shot.groom.feathers))
    if shot.contact is not None:
        islands = shot_islands(shot)
        count = min(wanted, _most(islands))
    share, told = _share_of_each(shot, count, islands), ""
    pushing = share[islands >= 0] if islands is not None else share[:0]
    largest = int(np.bincount(pushing).max(initial=0))
    if largest > _UNEVEN * len(pushing) / wanted:
        told = (
            f"feathers that may touch stay in one share: {count} instead of {wanted}, the largest"
            f" with {largest} of {len(pushing)} feathers that push others"
        )
    if told:
        warn_input(f"{shot.source}: contact: {told}")
    return count


def share_sizes(shot: Shot, count: int) -> list[int]:
    """Feathers of each share of a shot that is cut into so many."""
    islands = shot_islands(shot) if shot.contact is not None and count > 1 else None
    found: list[int] = np.bincount(_share_of_each(shot, count, islands), minlength=count).tolist()
    return found


def most_shares(shot: Shot) -> int:
    """Into how many shares a shot can be cut."""
    if shot.contact is None:
        return len(shot.groom.feathers)
    return _most(shot_islands(shot))


def _most(islands: Indices) -> int:
    """Into how many shares a shot with islands (F,) can be cut."""
    return max(int(islands.max()) + 1, int((islands < 0).sum()))


def _dealt(islands: Indices, count: int) -> Indices:
    """(F,) share of every feather, from 0, by islands (F,)."""
    sizes = np.bincount(islands)
    share, load = np.empty(len(sizes), dtype=np.int64), np.zeros(count)
    for each in np.argsort(-sizes, kind="stable"):
        share[each] = np.argmin(load)
        load[share[each]] += sizes[each]
    return share[islands]


def shot_islands(shot: Shot) -> Indices:
    """(F,) island of every feather of a shot whose feathers push each other, below 0 for those that
    push nothing."""
    # compiled code, which shares without contact do without
    from featherfx.shot.motion.motion import root_motion
    from featherfx.shot.options import resolve_options

    drawn, motion = _drawn(shot), root_motion(shot)
    return pushing_islands(shot, drawn, motion, resolve_options(shot, drawn, motion))


def _drawn(shot: Shot) -> list[Feather]:
    from featherfx.feather.placed_feathers import build_feathers

    return build_feathers(shot.groom.feathers, shot.quality.rows, shot.quality.columns)


def _shares(shot: Shot, count: int) -> Indices:
    """(F,) share of every feather, from 0."""
    # compiled code, which what is not shared out by guides does without
    from featherfx.shot.motion.motion import root_motion
    from featherfx.shot.options import resolve_options

    placements = shot.groom.feathers
    options = resolve_options(shot, _drawn(shot), root_motion(shot))
    guided = options.at_level("guided")
    share = np.arange(len(placements)) % count
    if not len(guided):
        return share
    from featherfx.shot.detail.guides import guide_weights

    guides, weights = guide_weights(shot, guided, options.leading)
    together = np.union1d(guided, guides)
    roots = np.array([placements[f].position for f in together])
    work = np.where(np.isin(together, guided), FOLLOWING, 1.0)
    share[together] = _cut(roots, work, count)
    # guides of other shares that each simulates, too
    load = np.bincount(share[together], work, count)
    for k in range(count):
        followed = guides[np.unique(weights[share[guided] == k].indices)]
        load[k] += float((share[followed] != k).sum())
    for f in np.setdiff1d(np.arange(len(placements)), together):
        share[f] = int(np.argmin(load))
        load[share[f]] += 1.0
    return share


def _cut(roots: Array, work: Array, count: int) -> Indices:
    """(N,) parts of roots (N, 3), from 0, of about equal work (N,)."""
    if count == 1 or len(roots) < 2:
        return np.zeros(len(roots), dtype=np.int64)
    first = count // 2
    axis = int(np.argmax(np.ptp(roots, axis=0)))
    order = np.argsort(roots[:, axis], kind="stable")
    done = np.cumsum(work[order])
    place = int(np.searchsorted(done, done[-1] * first / count))
    low, high = order[:place], order[place:]
    part = np.empty(len(roots), dtype=np.int64)
    part[low] = _cut(roots[low], work[low], first)
    part[high] = first + _cut(roots[high], work[high], count - first)
    return part


def _none_empty(share: Indices, count: int, free: Flags) -> Indices:
    """With one of the free feathers (F,) of the share that has most of them for each that has no
    feather."""
    for k in range(count):
        if not (share == k).any():
            most = np.argmax(np.bincount(share[free]))
            share[np.flatnonzero((share == most) & free)[-1]] = k
    return share
