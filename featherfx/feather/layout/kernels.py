"""Moving feathers about their roots until they clear each other and the skin.

A feather at rest: points at root + lift * n + frame Ry(-raise) Rx(roll) size s, for the samples s
of its shape, n its dorsal side as placed. Its vane is a height map over the x-y plane of its own
frame. A point between two feathers has the gap g = (upper surface) - (lower surface) along the
dorsal side of the one whose map is read; where g falls short of the clearance, both feathers move
by the least weighted change of raise, roll and lift that makes it up (projection onto one
constraint after the other, Kaczmarz 1937; position based dynamics, Mueller 2007).

root: (F, 3) m and frame: (F, 3, 3) as placed. moves: (F, 3) raise (rad), roll (rad), lift (m);
least, most: (F, 3) their bounds. place: (F, 3) and turned: (F, 3, 3), root and frame as moved.
size: (F,) m. shape: (F,) number of the shape. samples: (S, Q, 3), used: (S,) how many there are.
heights: (S, H, W), NaN beside the vane; window: (S, 4) first x and y of the nodes, and steps.
"""

from __future__ import annotations

import math

from featherfx.jit.compiled import kernel

# how readily a feather moves: squares of raise and roll, as a way of the tip, and of lift
RAISE_EASE, ROLL_EASE, LIFT_EASE = 1.0, 3.0, 0.02
# of the lower feather against the upper: there is more room above than below
LOWER_EASE = 0.1
# travel, as a share of the length, before feathers beside each other are looked at again
BESIDE = 0.02


@kernel
def pose(feather, root, frame, moves, place, turned):
    """Frame and root of a feather as it is moved."""
    raised, rolled, lift = moves[feather, 0], moves[feather, 1], moves[feather, 2]
    cosine, sine = math.cos(raised), math.sin(raised)
    cosine_roll, sine_roll = math.cos(rolled), math.sin(rolled)
    for c in range(3):
        x, y, z = frame[feather, c, 0], frame[feather, c, 1], frame[feather, c, 2]
        dorsal = cosine * z - sine * x
        turned[feather, c, 0] = cosine * x + sine * z
        turned[feather, c, 1] = cosine_roll * y + sine_roll * dorsal
        turned[feather, c, 2] = cosine_roll * dorsal - sine_roll * y
        place[feather, c] = root[feather, c] + lift * z


@kernel
def height_at(x, y, heights, window):
    """Height of a shape's map at a place, NaN beside the vane."""
    u, v = (x - window[0]) / window[2], (y - window[1]) / window[3]
    if not (0.0 <= u < heights.shape[0] - 1.0 and 0.0 <= v < heights.shape[1] - 1.0):
        return math.nan
    i, j = int(u), int(v)
    u, v = u - i, v - j
    low = (1.0 - v) * heights[i, j] + v * heights[i, j + 1]
    high = (1.0 - v) * heights[i + 1, j] + v * heights[i + 1, j + 1]
    return (1.0 - u) * low + u * high


@kernel
def relate(of, on, place, turned, size, relation):
    """Rotation and shift (3, 4) from samples of `of` to feather lengths in the frame of `on`."""
    for i in range(3):
        total = 0.0
        for c in range(3):
            total += (place[of, c] - place[on, c]) * turned[on, c, i]
        relation[i, 3] = total / size[on]
        for j in range(3):
            total = 0.0
            for c in range(3):
                total += turned[on, c, i] * turned[of, c, j]
            relation[i, j] = total * size[of] / size[on]


@kernel
def least_gap(upper, lower, place, turned, size, shape, samples, used, heights, window, relation,
              worst):  # fmt: skip
    """Least gap (m) of two feathers, NaN where they do not lie over each other.

    worst becomes x and y (m) of the place in the frame of the upper, then in that of the lower.
    """
    least = math.nan
    for side in range(2):
        of, on = (upper, lower) if side == 0 else (lower, upper)
        relate(of, on, place, turned, size, relation)
        own, other = shape[of], shape[on]
        for point in range(used[own]):
            sx, sy, sz = samples[own, point, 0], samples[own, point, 1], samples[own, point, 2]
            x = relation[0, 0] * sx + relation[0, 1] * sy + relation[0, 2] * sz + relation[0, 3]
            y = relation[1, 0] * sx + relation[1, 1] * sy + relation[1, 2] * sz + relation[1, 3]
            height = height_at(x, y, heights[other], window[other])
            if math.isnan(height):
                continue
            z = relation[2, 0] * sx + relation[2, 1] * sy + relation[2, 2] * sz + relation[2, 3]
            gap = size[on] * (z - height) if side == 0 else size[on] * (height - z)
            if math.isnan(least) or gap < least:
                least = gap
                first = 0 if side == 0 else 2
                worst[first], worst[first + 1] = size[of] * sx, size[of] * sy
                worst[2 - first], worst[3 - first] = size[on] * x, size[on] * y
    return least


@kernel
def ease(x, y, size):
    """How far a point at x and y moves for one unit of effort: the sum of weighted squares."""
    scale = 1.0 / (size * size)
    return RAISE_EASE * scale * x * x + ROLL_EASE * scale * y * y + LIFT_EASE


@kernel
def shift(feather, x, y, share, size, moves, least, most, travel):
    """Move a feather so that its point at x and y rises by share * ease(x, y), within bounds.

    travel (F,) grows by the way that any of its points may have gone (m).
    """
    scale = 1.0 / (size[feather] * size[feather])
    changes = (RAISE_EASE * scale * x, ROLL_EASE * scale * y, LIFT_EASE)
    for k in range(3):
        value = min(
            max(moves[feather, k] + share * changes[k], least[feather, k]), most[feather, k]
        )
        arm = 1.0 if k == 2 else size[feather]
        travel[feather] += arm * abs(value - moves[feather, k])
        moves[feather, k] = value


@kernel
def part(upper, lower, clearance, root, frame, moves, least, most, place, turned, size, shape,
         samples, used, heights, window, relation, worst, travel, pair, room):  # fmt: skip
    """Move two feathers apart where they are closest; returns the clearance they lacked (m).

    room: (K, 2) of each pair, how far the two may travel before they can lack any, and how far
    they had when that was found. Pairs beside each other count as apart by a share of their size.
    """
    gone = travel[upper] + travel[lower]
    if gone - room[pair, 1] < room[pair, 0]:
        return 0.0
    gap = least_gap(
        upper, lower, place, turned, size, shape, samples, used, heights, window, relation, worst
    )
    room[pair, 1] = gone
    room[pair, 0] = BESIDE * size[upper] if math.isnan(gap) else gap - clearance
    if math.isnan(gap) or gap >= clearance:
        return 0.0
    room[pair, 0] = 0.0
    lack = clearance - gap
    total = ease(worst[0], worst[1], size[upper])
    total += LOWER_EASE * ease(worst[2], worst[3], size[lower])
    down = LOWER_EASE * lack / total
    shift(upper, worst[0], worst[1], lack / total, size, moves, least, most, travel)
    shift(lower, worst[2], worst[3], -down, size, moves, least, most, travel)
    pose(upper, root, frame, moves, place, turned)
    pose(lower, root, frame, moves, place, turned)
    return lack


@kernel
def skin_gap(feather, place, turned, size, shape, samples, used, planes, worst):
    """Least height (m) of a feather's samples over the planes of the skin (F, Q, 4): n, n . c."""
    least = math.inf
    for point in range(used[shape[feather]]):
        s, plane = samples[shape[feather], point], planes[feather, point]
        gap = -plane[3]
        for c in range(3):
            way = turned[feather, c, 0] * s[0] + turned[feather, c, 1] * s[1]
            way = size[feather] * (way + turned[feather, c, 2] * s[2])
            gap += plane[c] * (place[feather, c] + way)
        if gap < least:
            least = gap
            worst[0], worst[1] = size[feather] * s[0], size[feather] * s[1]
    return least


@kernel
def clear_skin(feather, clearance, root, frame, moves, least, most, place, turned, size, shape,
               samples, used, planes, worst, travel):  # fmt: skip
    """Raise a feather off the skin where it lacks clearance; returns how much it lacked (m)."""
    first = 0.0
    for turn in range(4):
        gap = skin_gap(feather, place, turned, size, shape, samples, used, planes, worst)
        lack = clearance - gap
        if turn == 0:
            first = max(lack, 0.0)
        if lack <= 0.0:
            break
        total = ease(worst[0], worst[1], size[feather])
        shift(feather, worst[0], worst[1], lack / total, size, moves, least, most, travel)
        pose(feather, root, frame, moves, place, turned)
    return first


@kernel
def sweep(order, starts, pairs, clearance, root, frame, moves, least, most, place, turned, size,
          shape, samples, used, heights, window, planes, relation, worst, travel,
          room):  # fmt: skip
    """One pass over all feathers, those beneath first; returns the greatest lack of clearance (m).

    order: (F,). starts: (F + 1,) where the pairs of each upper feather begin. planes: of the skin,
    of size 0 without one. travel, room: as in shift and part; 0 and -1 at first.
    """
    greatest = 0.0
    for k in range(order.shape[0]):
        upper = order[k]
        for pair in range(starts[upper], starts[upper + 1]):
            lack = part(
                upper, pairs[pair, 1], clearance, root, frame, moves, least, most, place, turned,
                size, shape, samples, used, heights, window, relation, worst, travel, pair, room,
            )  # fmt: skip
            greatest = max(greatest, lack)
        if planes.shape[0] > 0:
            lack = clear_skin(
                upper, clearance, root, frame, moves, least, most, place, turned, size, shape,
                samples, used, planes, worst, travel,
            )  # fmt: skip
            greatest = max(greatest, lack)
    return greatest


@kernel
def all_gaps(pairs, place, turned, size, shape, samples, used, heights, window, relation, worst,
             gaps, places):  # fmt: skip
    """Least gap (m) of every pair (K,), NaN where the two do not lie over each other.

    places: (K, 4), what `worst` becomes in least_gap.
    """
    for pair in range(pairs.shape[0]):
        gaps[pair] = least_gap(
            pairs[pair, 0], pairs[pair, 1], place, turned, size, shape, samples, used, heights,
            window, relation, worst,
        )  # fmt: skip
        for c in range(4):
            places[pair, c] = worst[c]


@kernel
def count_cover(pairs, place, turned, size, shape, samples, used, heights, window, relation,
                worst, counts):  # fmt: skip
    """Adds to counts (F, Q) how many other feathers every sample lies over or under."""
    for pair in range(pairs.shape[0]):
        for side in range(2):
            of, on = pairs[pair, side], pairs[pair, 1 - side]
            relate(of, on, place, turned, size, relation)
            own, other = shape[of], shape[on]
            for point in range(used[own]):
                x, y = relation[0, 3], relation[1, 3]
                for c in range(3):
                    x += relation[0, c] * samples[own, point, c]
                    y += relation[1, c] * samples[own, point, c]
                if not math.isnan(height_at(x, y, heights[other], window[other])):
                    counts[of, point] += 1
