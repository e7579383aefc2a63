"""Stacking values of feathers that start side by side: overlapping leaves a gap apart.

dh / dp = T g'(s) / q at the far end of an overlap, so two leaves are a gap apart there if their
values differ by

    (gap l + sagitta) q / (T g'(s))

The sagitta is what chords of both grids cut off the carrier's curvature, kappa piece^2 / 4.
What a feather deviates from its leaf takes a part of the room to those that it overlaps. A lift c
at the tip grows with s^2, so under a feather that is earlier by D = (p - p') / q

    c s^2 <= c' (s + D)^2 + part T g'(s + D) D

Feathers overlap if nodes of both lie in one cell of a grid of cubes. In the order of phi each takes
the value nearest to its own that is far enough from those before it (tie_kernels).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from featherfx.algebra.types import Array, Flags, Indices
from featherfx.coat.fields import Fields, slope_of_leaf
from featherfx.coat.leaf_kernels import LeafArrays
from featherfx.coat.tie_kernels import count_pairs, fit_values

# side of the cubes over the length of the feathers there
_CELL = 0.1
# of a feather's gain that its value may be earlier and later: later lays the base into the skin
_MAX_EARLIER, _MAX_LATER = 0.35, 0.16
# of the room between two leaves, that lifts of tips take, and the roll of either
_LIFT_PART, _ROLL_PART = 0.3, 0.15
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
    """Pairs of feathers that overlap. pairs: (K, 2), the lower number first. places: (K,) the
    greatest s of either where both are."""

    pairs: Indices
    places: Array


def find_overlaps(drawn: LeafArrays, covered: Flags, length: Array) -> Overlaps:
    """Find the pairs of drawn feathers that overlap. covered: (F, n) rows that lie in the skin.
    length: (T,) m, of the feathers around each triangle."""
    count, across = len(drawn.nodes), drawn.nodes.shape[2]
    shown = np.repeat(~covered.ravel(), across)
    feather = np.repeat(np.arange(count), covered.shape[1] * across)[shown]
    place = drawn.places.ravel()[shown]
    cells = _cells(drawn.nodes.reshape(-1, 3)[shown], length[drawn.feet.ravel()[shown]])
    # by cell, and as they were by feather: of each the greatest s in a cell
    order = np.argsort(cells, kind="stable")
    feather, cells = feather[order], cells[order]
    first = np.flatnonzero(np.diff(cells, prepend=-1) | np.diff(feather, prepend=-1))
    place = np.maximum.reduceat(place[order], first) if len(first) else place
    feather, cells = feather[first], cells[first]
    starts = np.append(np.flatnonzero(np.diff(cells, prepend=-1)), len(cells))
    sizes = np.diff(starts)
    found = np.zeros((int((sizes * (sizes - 1) // 2).sum()), 3))
    count_pairs(starts, feather, place, found)
    key = found[:, 0].astype(np.int64) * count + found[:, 1].astype(np.int64)
    order = np.argsort(key, kind="stable")
    first = np.flatnonzero(np.diff(key[order], prepend=-1))
    places = np.maximum.reduceat(found[order, 2], first) if len(first) else found[:, 2]
    return Overlaps(np.stack(np.divmod(key[order][first], count), axis=1), places)


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


def fit_ties(values: Array, gain: Array, gaps: Array, overlaps: Overlaps) -> Fit:
    """Keep overlapping leaves apart. values: (F,) m, phi at the follicles. gain: (F,) m. gaps:
    (K,) m, of the values of each pair."""
    pairs = overlaps.pairs
    ends, other = np.append(pairs[:, 0], pairs[:, 1]), np.append(pairs[:, 1], pairs[:, 0])
    order = np.argsort(ends, kind="stable")
    starts = np.searchsorted(ends[order], np.arange(len(values) + 1))
    neighbours = OverlapLists(starts, other[order], np.tile(gaps, 2)[order])
    limits = np.stack([_MAX_EARLIER * gain, _MAX_LATER * gain], axis=1)
    found, shares = values.copy(), np.ones(len(values))
    fixed = np.zeros(len(values), dtype=np.bool_)
    first = np.argsort(values, kind="stable")
    fit_values(first, neighbours, limits, found, fixed, shares)
    return Fit(found, shares)


def find_gaps(fields: Fields, at: Indices, overlaps: Overlaps, sagitta: Array) -> Array:
    """Return (K,) m, by how much the values of pairs are to differ. at: (F,) a vertex of each
    feather. sagitta: (F,) m."""
    own = overlaps.pairs
    vertex = at[own]

    def mean(values: Array) -> Array:
        return np.asarray(values[vertex].mean(axis=1))

    room = mean(fields.gap * fields.length) + sagitta[own].sum(axis=1)
    rate = slope_of_leaf(overlaps.places, mean(fields.steepness)) * mean(fields.thickness)
    return np.asarray(room * mean(fields.gain) / rate)


class StackedLeaves(NamedTuple):
    """F leaves. values, gain, thickness: (F,) m, p, q and T. steepness: (F,) k."""

    values: Array
    gain: Array
    thickness: Array
    steepness: Array


def _find_rooms(leaves: StackedLeaves, overlaps: Overlaps) -> tuple[Array, Array]:
    """Return D and the room (m) between the leaves (K,) of each pair, where it is least."""
    _, gain, thickness, steepness = (each[overlaps.pairs].mean(axis=1) for each in leaves)
    apart = np.abs(np.diff(leaves.values[overlaps.pairs], axis=1))[:, 0] / gain
    return apart, slope_of_leaf(overlaps.places, steepness) * thickness * apart


def limit_lifts(wanted: Array, leaves: StackedLeaves, overlaps: Overlaps) -> Array:
    """Return (F,) m, lifts of tips that keep leaves in order. wanted: (F,) m."""
    apart, room = _find_rooms(leaves, overlaps)
    own = np.maximum(overlaps.places - apart, _CELL)
    swap = np.argsort(leaves.values[overlaps.pairs], axis=1)
    upper, lower = np.take_along_axis(overlaps.pairs, swap, axis=1).T
    order = np.argsort(leaves.values[lower], kind="stable")
    columns = upper, lower, (1.0 + apart / own) ** 2, _LIFT_PART * room / own**2
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
