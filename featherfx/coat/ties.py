"""Stacking values of feathers that start side by side: overlapping leaves a gap apart.

Two leaves are a gap apart over a place if their values differ by gap q / T there. What a feather
deviates from its leaf takes a part of the room to those that it overlaps. A lift c at the tip
grows with s^2, so under a feather that is earlier by D = (p - p') / q

    c s^2 <= c' (s + D)^2 + part T D

which is hardest at tips. Feathers overlap if nodes of both lie in one cell of a grid of cubes. In
the order of phi each takes the value nearest to its own that is far enough from those around it
(tie_kernels).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from featherfx.algebra.types import Array, Flags, Indices
from featherfx.coat.fields import Fields
from featherfx.coat.leaf_kernels import LeafArrays
from featherfx.coat.tie_kernels import count_pairs, fit_values

# side of the cubes over the length of the feathers there
_CELL = 0.1
# of a feather's gain that its value may be earlier and later: later lays the base into the skin
_MAX_EARLIER, _MAX_LATER = 0.35, 0.16
_ROUNDS = 3  # in which feathers move to where there is most room
# of the room between two leaves, that lifts of tips take, and the roll of either
_LIFT_PART, _ROLL_PART = 0.15, 0.15
_BITS = 19  # of a cube's number along an axis


class OverlapLists(NamedTuple):
    """Feathers that overlap, as kernels take them.

    starts: (F + 1,) first entry of each feather. feather: (N,) which. gap: (N,) m, by which their
    values are to differ.
    """

    starts: Indices
    feather: Indices
    gap: Array


class Overlaps(NamedTuple):
    """Pairs of feathers that overlap. pairs: (K, 2), the lower number first. gaps: (K,) m, by which
    their values are to differ."""

    pairs: Indices
    gaps: Array


def find_overlaps(drawn: LeafArrays, covered: Flags, fields: Fields, faces: Indices) -> Overlaps:
    """Find the pairs of drawn feathers that overlap. covered: (F, n) rows that lie in the skin."""
    length, gain, thickness = (
        each[faces].mean(axis=1) for each in (fields.length, fields.gain, fields.thickness)
    )
    count, across = len(drawn.nodes), drawn.nodes.shape[2]
    shown = np.repeat(~covered.ravel(), across)
    feather = np.repeat(np.arange(count), covered.shape[1] * across)[shown]
    feet = drawn.feet.ravel()[shown]
    gap = (fields.gap * gain / thickness)[feet]
    cells = _cells(drawn.nodes.reshape(-1, 3)[shown], length[feet])
    # by cell, and as they were by feather: of each the greatest gap in a cell
    order = np.argsort(cells, kind="stable")
    feather, cells = feather[order], cells[order]
    first = np.flatnonzero(np.diff(cells, prepend=-1) | np.diff(feather, prepend=-1))
    gap = np.maximum.reduceat(gap[order], first) if len(first) else gap
    feather, cells = feather[first], cells[first]
    starts = np.append(np.flatnonzero(np.diff(cells, prepend=-1)), len(cells))
    sizes = np.diff(starts)
    found = np.zeros((int((sizes * (sizes - 1) // 2).sum()), 3))
    count_pairs(starts, feather, gap, found)
    key = found[:, 0].astype(np.int64) * count + found[:, 1].astype(np.int64)
    order = np.argsort(key, kind="stable")
    first = np.flatnonzero(np.diff(key[order], prepend=-1))
    gaps = np.maximum.reduceat(found[order, 2], first) if len(first) else found[:, 2]
    return Overlaps(np.stack(np.divmod(key[order][first], count), axis=1), gaps)


def _cells(nodes: Array, length: Array) -> Indices:
    """Number the cubes (N,) of nodes (N, 3); their side follows the length in octaves."""
    octave = np.round(np.log2(length)).astype(np.int64)
    steps = np.floor(nodes / (_CELL * 2.0**octave)[:, None]).astype(np.int64)
    found = octave & 31
    for axis in range(3):
        found = (found << _BITS) + (steps[:, axis] & ((1 << _BITS) - 1))
    return found


class Fit(NamedTuple):
    """Stacking values. values: (F,) m. shares: (F,) of its gaps that each feather has got."""

    values: Array
    shares: Array


def fit_ties(values: Array, gain: Array, overlaps: Overlaps) -> Fit:
    """Keep overlapping leaves apart. values: (F,) m, phi at the follicles. gain: (F,) m."""
    pairs, gaps = overlaps
    ends, other = np.append(pairs[:, 0], pairs[:, 1]), np.append(pairs[:, 1], pairs[:, 0])
    order = np.argsort(ends, kind="stable")
    starts = np.searchsorted(ends[order], np.arange(len(values) + 1))
    neighbours = OverlapLists(starts, other[order], np.tile(gaps, 2)[order])
    limits = np.stack([_MAX_EARLIER * gain, _MAX_LATER * gain], axis=1)
    order, found = np.argsort(values, kind="stable"), np.full_like(values, np.inf)
    near = np.empty((int(np.diff(starts).max(initial=0)), 2))
    for _ in range(_ROUNDS):
        fit_values(order, neighbours, values, limits, found, near)
    apart, shares = np.abs(np.diff(found[pairs], axis=1))[:, 0], np.ones(len(values))
    np.minimum.at(shares, pairs, (apart / gaps)[:, None])
    return Fit(found, shares)


class StackedLeaves(NamedTuple):
    """F leaves. values, gain, thickness: (F,) m, p, q and T."""

    values: Array
    gain: Array
    thickness: Array


def _find_rooms(leaves: StackedLeaves, overlaps: Overlaps) -> tuple[Array, Array]:
    """Return D and the room (m) between the leaves (K,) of each pair."""
    _, gain, thickness = (each[overlaps.pairs].mean(axis=1) for each in leaves)
    apart = np.abs(np.diff(leaves.values[overlaps.pairs], axis=1))[:, 0] / gain
    return apart, thickness * apart


def limit_lifts(wanted: Array, leaves: StackedLeaves, overlaps: Overlaps) -> Array:
    """Return (F,) m, lifts of tips that keep leaves in order. wanted: (F,) m."""
    apart, room = _find_rooms(leaves, overlaps)
    swap = np.argsort(leaves.values[overlaps.pairs], axis=1)
    upper, lower = np.take_along_axis(overlaps.pairs, swap, axis=1).T
    order = np.argsort(leaves.values[lower], kind="stable")
    columns = upper, lower, (1.0 + apart) ** 2, _LIFT_PART * room
    found = np.maximum(wanted, 0.0).tolist()
    # from the uppermost down
    for above, below, ratio, most in zip(*(each[order].tolist() for each in columns), strict=True):
        found[below] = min(found[below], ratio * found[above] + most)
    return np.array(found)


def find_roll_rooms(width: Array, leaves: StackedLeaves, overlaps: Overlaps) -> Array:
    """Return (F,) rad, rolls by which edges stay between the leaves around. width: (F,) m."""
    _, room = _find_rooms(leaves, overlaps)
    least = np.full(len(width), np.inf)
    np.minimum.at(least, overlaps.pairs.ravel(), np.repeat(room, 2))
    return np.asarray(_ROLL_PART * least / (0.5 * width))
