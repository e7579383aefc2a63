"""A share of a shot's feathers: disjoint work for several workers.

Feathers that nothing follows are dealt out in turn. A feather that follows guides needs these
simulated in its own share, so followers and guides are cut by where they stand: in halves of equal
work across the longest side of their box, and these again. Only guides near a cut are simulated in
more than one share.

Where feathers push each other, islands of those that may touch (islands.py) are dealt out, the
largest first, each to the share that has the fewest feathers. An island stays whole. Feathers that
push nothing are dealt out beside them as above.
"""

from __future__ import annotations

import numpy as np

from featherfx.algebra.types import Array, Flags, Indices
from featherfx.errors import InputError, Problem, warn_input
from featherfx.feather.types import Feather
from featherfx.shot.detail.guides import guide_weights, uses_guides
from featherfx.shot.types import Shot

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
    from featherfx.shot.contact.islands import pushing_islands
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
