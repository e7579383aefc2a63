"""Moving feathers about their roots until they clear each other and the skin.

A feather at rest: points at root + lift * n + frame Ry(-raise) Rx(roll) size s, for the samples s
of its shape, n its dorsal side as placed. Its vane is a height map over the x-y plane of its own
frame. A point between two feathers has the gap g = (upper surface) - (lower surface) along the
dorsal side of the one whose map is read; where g falls short of the clearance, the upper feather
moves by the least weighted change of raise, roll and lift that makes it up (projection onto one
constraint after the other, Kaczmarz 1937; position based dynamics, Mueller 2007). The lower one
stays, so that a feather depends on those beneath it alone: pushing each other, they would hand on
every change to all that hang together.

feathers: an Arrangement (arrangement.py). planes: (F, Q, 4) of the skin near the samples, unit
normal n and n . c. What a sweep calls for every pair and feather is a loop kernel: handing so many
arrays on would take as long as what is done with them.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from featherfx.algebra.thread_team import say_done, ticket, wait_for
from featherfx.algebra.vector_kernels import copy_values, dot, sub
from featherfx.jit.compiled import kernel, loop_kernel

# how readily a feather moves: squares of raise and roll, as a way of the tip, and of lift
_RAISE_EASE, _ROLL_EASE, _LIFT_EASE = 1.0, 3.0, 0.02
# travel, as a share of the length, before feathers beside each other are looked at again
_BESIDE = 0.02
# how often a feather is raised off the skin in a sweep
_SKIN_TRIES = 4
# m, travel after which feathers that could not be parted are looked at again: any
MIN_TRAVEL = 1e-300


class Neighbours(NamedTuple):
    """order: (F,) feathers, those beneath first. pairs: (K, 2) upper and lower; those of the upper
    feather f are pairs[starts[f]] to pairs[starts[f + 1] - 1]."""

    order: NDArray[np.int64]
    starts: NDArray[np.int64]
    pairs: NDArray[np.int64]


class Limits(NamedTuple):
    """clearance: (K,) m, wanted between the feathers of each pair; ground: (F,) m, over the skin.
    slack: m, what may lack of either. least, most: (F, 3) bounds of raise (rad), roll (rad) and
    lift (m), and grain: (F, 3), of which moves are multiples. So what a feather is moved by others,
    far away, dies out, instead of fading over all that hang together."""

    clearance: NDArray[np.float64]
    ground: NDArray[np.float64]
    slack: float
    least: NDArray[np.float64]
    most: NDArray[np.float64]
    grain: NDArray[np.float64]


class Travel(NamedTuple):
    """gone: (F,) m, the way that any point of a feather may have gone; landed: (F,) m, how far it
    had when the skin beneath was last looked at. room, seen: (K,) m, how far the two feathers of a
    pair may travel before they can lack clearance, and how far they had when that was found."""

    gone: NDArray[np.float64]
    landed: NDArray[np.float64]
    room: NDArray[np.float64]
    seen: NDArray[np.float64]


@kernel
def follow_moves(feathers, f):
    """Rotation and place of feather f from its moves."""
    raised, rolled, lift = feathers.moves[f, 0], feathers.moves[f, 1], feathers.moves[f, 2]
    cosine, sine = math.cos(raised), math.sin(raised)
    cosine_roll, sine_roll = math.cos(rolled), math.sin(rolled)
    rotation = feathers.rotation[f]
    for c in range(3):
        x, y, z = feathers.frame[f, c, 0], feathers.frame[f, c, 1], feathers.frame[f, c, 2]
        dorsal = cosine * z - sine * x
        rotation[c, 0] = cosine * x + sine * z
        rotation[c, 1] = cosine_roll * y + sine_roll * dorsal
        rotation[c, 2] = cosine_roll * dorsal - sine_roll * y
        feathers.place[f, c] = feathers.root[f, c] + lift * z


@kernel
def height_at(x, y, heights, window):
    """Height of a shape's map (H, W) at a place, NaN beside the vane."""
    u, v = (x - window[0]) / window[2], (y - window[1]) / window[3]
    if not (0.0 <= u < heights.shape[0] - 1.0 and 0.0 <= v < heights.shape[1] - 1.0):
        return math.nan
    i, j = int(u), int(v)
    u, v = u - i, v - j
    low = (1.0 - v) * heights[i, j] + v * heights[i, j + 1]
    high = (1.0 - v) * heights[i + 1, j] + v * heights[i + 1, j + 1]
    return (1.0 - u) * low + u * high


@kernel
def _column(matrix, k):
    return matrix[0, k], matrix[1, k], matrix[2, k]


@kernel
def relate(feathers, of, on):
    """Rotation and shift (3, 4) from samples of `of` to lengths of `on` in its frame."""
    place, rotation, size = feathers.place, feathers.rotation, feathers.size
    for i in range(3):
        axis = _column(rotation[on], i)
        feathers.relation[i, 3] = dot(sub(place[of], place[on]), axis) / size[on]
        for j in range(3):
            feathers.relation[i, j] = dot(axis, _column(rotation[of], j)) * size[of] / size[on]


@kernel
def _along(axis, sample):
    """Coordinate of a sample by a row (4,) of a relation."""
    return dot(axis, sample) + axis[3]


@kernel
def least_gap(feathers, upper, lower):
    """Least gap (m) of two feathers, NaN where they do not lie over each other.

    nearest becomes where it is: x and y (m) in the frame of the upper, then in that of the lower.
    """
    maps, relation, nearest = feathers.maps, feathers.relation, feathers.nearest
    least = math.nan
    for side in range(2):
        of, on = (upper, lower) if side == 0 else (lower, upper)
        relate(feathers, of, on)
        own, other = feathers.shape[of], feathers.shape[on]
        size, own_size = feathers.size[on], feathers.size[of]
        for point in range(maps.used[own]):
            s = maps.samples[own, point]
            x, y = _along(relation[0], s), _along(relation[1], s)
            height = height_at(x, y, maps.heights[other], maps.window[other])
            if math.isnan(height):
                continue
            z = _along(relation[2], s)
            gap = size * (z - height) if side == 0 else size * (height - z)
            if math.isnan(least) or gap < least:
                least = gap
                nearest[side, 0], nearest[side, 1] = own_size * s[0], own_size * s[1]
                nearest[1 - side, 0], nearest[1 - side, 1] = size * x, size * y
    return least


@kernel
def ease(at, size):
    """Return how far a point at x and y moves for one unit of effort: the sum of weighted
    squares."""
    inverse = 1.0 / (size * size)
    return _RAISE_EASE * inverse * at[0] * at[0] + _ROLL_EASE * inverse * at[1] * at[1] + _LIFT_EASE


@kernel
def shift(feathers, f, at, effort, limits, travel):
    """Move a feather so that its point at x and y rises by effort * ease(at), within limits.

    By a grain at the least: what is less raises it, or lifts it where it can be raised no more.
    """
    size, before = feathers.size[f], travel.gone[f]
    inverse = 1.0 / (size * size)
    changes = _RAISE_EASE * inverse * at[0], _ROLL_EASE * inverse * at[1], _LIFT_EASE
    for k in range(3):
        _change(feathers, f, k, effort * changes[k], limits, travel)
    for k in (0, 2):
        if travel.gone[f] == before:
            _change(feathers, f, k, limits.grain[f, k], limits, travel)
    follow_moves(feathers, f)


@kernel
def _change(feathers, f, k, change, limits, travel):
    """Raise, roll or lift a feather by the multiple of the grain that is nearest to a change."""
    before, grain = feathers.moves[f, k], limits.grain[f, k]
    value = grain * math.floor((before + change) / grain + 0.5)
    value = min(max(value, limits.least[f, k]), limits.most[f, k])
    arm = 1.0 if k == 2 else feathers.size[f]
    travel.gone[f] += arm * abs(value - before)
    feathers.moves[f, k] = value


@loop_kernel
def part(feathers, neighbours, pair, limits, travel):
    """Move the upper of two feathers off the lower where they are closest.

    Feathers beside each other count as apart by a share of their size. Those that could not be
    moved are left until one of them has.
    """
    upper, lower = neighbours.pairs[pair, 0], neighbours.pairs[pair, 1]
    gone = travel.gone[upper] + travel.gone[lower]
    if gone - travel.seen[pair] < travel.room[pair]:
        return
    gap, above = least_gap(feathers, upper, lower), feathers.nearest[0]
    lack = limits.clearance[pair] - gap
    travel.seen[pair] = gone
    beside = math.isnan(gap)
    room = _BESIDE * feathers.size[upper] if beside else limits.slack - lack
    travel.room[pair] = max(room, MIN_TRAVEL)
    if beside or lack <= limits.slack:
        return
    effort = lack / ease(above, feathers.size[upper])
    shift(feathers, upper, above, effort, limits, travel)


@kernel
def skin_gap(feathers, f, planes):
    """Least height (m) of a feather's samples over the skin; nearest[0] becomes where (x, y), m."""
    least, maps = math.inf, feathers.maps
    place, rotation, size = feathers.place[f], feathers.rotation[f], feathers.size[f]
    for point in range(maps.used[feathers.shape[f]]):
        s, plane = maps.samples[feathers.shape[f], point], planes[f, point]
        gap = -plane[3]
        for c in range(3):
            way = rotation[c, 0] * s[0] + rotation[c, 1] * s[1]
            way = size * (way + rotation[c, 2] * s[2])
            gap += plane[c] * (place[c] + way)
        if gap < least:
            least = gap
            feathers.nearest[0, 0], feathers.nearest[0, 1] = size * s[0], size * s[1]
    return least


@loop_kernel
def clear_skin(feathers, f, planes, limits, travel):
    """Raise a feather off the skin where it lacks clearance, if it has moved since it was looked
    at."""
    if travel.gone[f] <= travel.landed[f]:
        return
    travel.landed[f] = travel.gone[f]
    at = feathers.nearest[0]
    for _ in range(_SKIN_TRIES):
        lack = limits.ground[f] - skin_gap(feathers, f, planes)
        if lack <= limits.slack:
            break
        shift(feathers, f, at, lack / ease(at, feathers.size[f]), limits, travel)


@kernel
def sweep(team, feathers, neighbours, planes, limits, travel):
    """One pass over all feathers, those beneath first, by a team of threads that all call this:
    each takes the next one, and moves it off another when that has been moved, so that their number
    changes nothing.

    team: counters, and (F,) zeros, 1 for what has been moved. feathers: with scratch of this
    thread. planes: of size 0 without a skin. travel: gone and seen 0 at first; room and landed -1
    for what is to be looked at, 0 for what only is if it moves.
    """
    counters, moved = team
    while True:
        place = ticket(counters, 0)
        if place >= neighbours.order.shape[0]:
            return
        upper = neighbours.order[place]
        for pair in range(neighbours.starts[upper], neighbours.starts[upper + 1]):
            wait_for(moved, neighbours.pairs[pair, 1], 1)
            part(feathers, neighbours, pair, limits, travel)
        if planes.shape[0] > 0:
            clear_skin(feathers, upper, planes, limits, travel)
        say_done(moved, upper)


@kernel
def all_gaps(feathers, pairs, gaps, places):
    """least_gap of every pair, to gaps (K,), and nearest, to places (K, 2, 2)."""
    for pair in range(pairs.shape[0]):
        gaps[pair] = least_gap(feathers, pairs[pair, 0], pairs[pair, 1])
        copy_values(feathers.nearest, places[pair])


@kernel
def count_cover(feathers, pairs, counts):
    """Adds to counts (F, Q) how many other feathers every sample lies over or under."""
    maps, relation = feathers.maps, feathers.relation
    for pair in range(pairs.shape[0]):
        for side in range(2):
            of, on = pairs[pair, side], pairs[pair, 1 - side]
            relate(feathers, of, on)
            own, other = feathers.shape[of], feathers.shape[on]
            for point in range(maps.used[own]):
                s = maps.samples[own, point]
                x, y = _along(relation[0], s), _along(relation[1], s)
                if not math.isnan(height_at(x, y, maps.heights[other], maps.window[other])):
                    counts[of, point] += 1
