"""How a layout moves, shortens and drops feathers until none pass through each other."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from featherfx.feather.layout.overlap import Strips, shingle_pairs
from featherfx.feather.layout.pose import Array, Indices, Mask, Pose, Skin
from featherfx.groom.types import Layout

_MOST_SWEEPS = 30
_SWEEPS_PER_SEARCH = 10  # after which the skin's tangent planes are looked up again
_SETTLED = 0.05  # share of the clearance that may be lacking
# shortening: by how much in one round, rounds, and sweeps after each
_SHORTER, _MOST_ROUNDS, _SWEEPS_PER_ROUND = 0.9, 12, 5
_DROPS = 3  # how often feathers are dropped and the others let settle


def solve(pose: Pose, strips: Strips, skin: Skin | None, layout: Layout) -> tuple[Indices, Indices]:
    """Move the feathers of a pose apart. strips: as they are placed.

    Returns pairs and order of shingle_pairs, of the feathers as they are moved.
    """
    pairs, order = shingle_pairs(strips)
    _settle(pose, pairs, order, skin, layout, _MOST_SWEEPS)
    strips = replace(strips, rank=np.argsort(order))
    pairs = _search(pose, strips)
    _settle(pose, pairs, order, skin, layout, _SWEEPS_PER_SEARCH)
    _shorten(pose, pairs, order, skin, layout)
    pairs = _search(pose, strips)
    if layout.drop is None:
        return pairs, order
    for number in range(_DROPS):
        if not _drop(pose, pairs, skin, layout.drop):
            break
        if number == 0:
            pose.put_back()  # what was in the way of others is gone
        _settle(pose, pairs, order, skin, layout, _MOST_SWEEPS)
        pairs = _search(pose, strips)
    _drop(pose, pairs, skin, layout.drop)
    return pairs, order


def _search(pose: Pose, strips: Strips) -> Indices:
    """The pairs of feathers as they are moved, in the order that strips have."""
    pairs, _ = shingle_pairs(pose.moved(strips))
    return pairs


def _settle(
    pose: Pose, pairs: Indices, order: Indices, skin: Skin | None, layout: Layout, sweeps: int
) -> None:
    from featherfx.feather.layout.kernels import sweep

    order, pairs = order[pose.kept[order]], pairs[pose.kept[pairs].all(axis=1)]
    starts = np.searchsorted(pairs[:, 0], np.arange(len(pose.size) + 1))
    turn = np.radians(np.where(pose.grown, layout.most_tilt, layout.most_tilt_placed))
    least = np.stack([-0.5 * turn, -turn, np.zeros(len(turn))], axis=1)
    most = np.stack([turn, turn, np.full(len(turn), layout.most_lift)], axis=1)
    planes = np.zeros((0, 1, 4))
    travel, room = np.zeros(len(pose.size)), np.full((len(pairs), 2), -1.0)
    for number in range(sweeps):
        if skin is not None and number % _SWEEPS_PER_SEARCH == 0:
            planes = skin.planes(pose.world())
        place, turned, *shapes, relation, worst = pose.surfaces
        lack = sweep(
            order, starts, pairs, layout.clearance, pose.root, pose.frame, pose.moves, least,
            most, place, turned, *shapes, planes, relation, worst, travel, room,
        )  # fmt: skip
        if lack < _SETTLED * layout.clearance:
            break


def _shorten(pose: Pose, pairs: Indices, order: Indices, skin: Skin | None, layout: Layout) -> None:
    """Shorten grown feathers that do not come clear, each the one whose tip is at fault."""
    if layout.least_size >= 1.0:
        return
    least = layout.least_size * pose.size
    for _ in range(_MOST_ROUNDS):
        gaps, places = pose.gaps(pairs)
        through = np.flatnonzero(gaps < 0.0)
        upper, lower = pairs[through].T
        share = np.stack(
            [places[through, 0] / pose.size[upper], places[through, 2] / pose.size[lower]], axis=1
        )
        may = (pose.grown & (pose.size > least))[pairs[through]]
        share = np.where(may, share, -np.inf)
        chosen = pairs[through, share.argmax(axis=1)][may.any(axis=1)]
        low = np.flatnonzero((pose.heights(skin) < 0.0) & pose.grown & (pose.size > least))
        chosen = np.union1d(chosen, low)
        if len(chosen) == 0:
            return
        pose.size[chosen] = np.maximum(_SHORTER * pose.size[chosen], least[chosen])
        _settle(pose, pairs, order, skin, layout, _SWEEPS_PER_ROUND)


def _drop(pose: Pose, pairs: Indices, skin: Skin | None, depth: float) -> bool:
    """Drop grown feathers that pass through others or the skin by more than depth; if any."""
    before = int(pose.kept.sum())
    pose.kept &= ~(pose.grown & (pose.heights(skin) < -depth))
    pairs = pairs[pose.kept[pairs].all(axis=1)]
    gaps, _ = pose.gaps(pairs)
    deep = gaps < -depth
    pose.kept &= ~_covering(pairs[deep], -gaps[deep], pose.grown)
    return int(pose.kept.sum()) < before


def _covering(pairs: Indices, depths: Array, grown: Mask) -> Mask:
    """(F,) grown feathers of which every pair (K, 2) with one holds one: those in most first."""
    chosen = np.zeros(len(grown), dtype=np.bool_)
    keep = grown[pairs].any(axis=1)
    pairs, depths = pairs[keep], depths[keep]
    while len(pairs):
        # the depth decides between feathers of as many pairs
        weight = np.repeat(1.0 + depths / (depths.max() * (len(depths) + 1)), 2)
        count = np.bincount(pairs.ravel(), weights=weight, minlength=len(grown))
        worst = int(np.argmax(np.where(grown, count, -1.0)))
        chosen[worst] = True
        left = (pairs != worst).all(axis=1)
        pairs, depths = pairs[left], depths[left]
    return chosen
