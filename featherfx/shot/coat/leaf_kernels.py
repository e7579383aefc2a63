"""Feathers on their leaves over a skin that moves, each node over its own place of the skin.

A node at rest has a foot on the carrier and a place o in the frame of its leaf y there. Its image
over a pose is

    y(foot) + F o,   F = (t, n x t, n),  t along a side of the triangle

A feather bridges creases of the skin. The farther its images fold against its shape at rest in any
pose of a shot, the nearer they are, in every pose, to where the root alone carries it: a share that
changed with the pose would let it jump.

Images are stretched as the skin is, so they give directions. The rachis runs along the polyline of
its images in chords of its own lengths, from a quill that does not bend. A barb runs likewise along
images of barbs where its row comes to lie, at its own angle: where skin is squeezed, vanes follow
that beneath them. Turns within the vane are about the normals of the rows, rolls about their
tangents.
"""

from math import atan2, cos, sin, sqrt
from typing import NamedTuple

from featherfx.algebra.types import Array, Indices
from featherfx.algebra.vector_kernels import (
    add,
    combined,
    cross,
    dot,
    length,
    normal_of,
    scale,
    store,
    sub,
)
from featherfx.algebra.views import COUNT as LANES
from featherfx.algebra.views import load, put, transposed
from featherfx.coat.coat import PlaneForms
from featherfx.coat.leaf_kernels import leaf_point, rounded, unit, without
from featherfx.jit.compiled import kernel

_NO_LENGTH = 1e-12  # m, of a piece that has no direction
_NEARER = 1.0 - 1e-9  # of a chord: images at its end but for rounding are not passed
# share of its length that the image of a piece has at least, where folds are sought
_SHORTEST = 0.3


class LeafFeet(NamedTuple):
    """Feathers over a carrier at rest, F of them.

    values: (F,) m, p. feet: (F, P) triangles under the n (1 + 2 m) nodes row by row, the last one
    repeated to fill lanes. places: (F, 9, P) barycentric weights, shares of T, a and r in h, and
    o (m). directors: (F, n, 2, 3) in the frames of their rows. steps: (F, n - 1) m and pieces:
    (F, 2, n, m) m, lengths.
    """

    values: Array
    feet: Indices
    places: Array
    directors: Array
    steps: Array
    pieces: Array


class CarriedShapes(NamedTuple):
    """K feathers as their roots alone carry them.

    nodes: (K, n, 1 + 2 m, 3) m and directors: (K, n, 2, 3), at rest from their roots. shares: (K,)
    of the way to these that images go. positions: (K, 3) m and rotations: (K, 3, 3), of the roots.
    """

    nodes: Array
    directors: Array
    shares: Array
    positions: Array
    rotations: Array


class VaneMotion(NamedTuple):
    """Turns within the vanes of B of K feathers.

    nodes: (B, n, 1 + 2 m, 3) m. directors: (B, n, 2, 3). order: (K,) number of each among B, -1 for
    one as at rest. roll: (K,) rad, of the vane about the rachis. rest: plane forms (K) at rest.
    """

    nodes: Array
    directors: Array
    order: Indices
    roll: Array
    rest: PlaneForms


class ImageRoom(NamedTuple):
    """Scratch memory. image: (n, 1 + 2 m, 4) m, the last means nothing; flat: the same, (P, 4). up:
    (n, 3) normals at the rachis. rachis: (n, 3) m, in its own lengths. row: (n,) image before each
    row. part: (n,) how far on to the next it is. turns: (n, 2) rad, of rows and of the chords of
    the rachis after them, from rest."""

    image: Array
    flat: Array
    up: Array
    rachis: Array
    row: Indices
    part: Array
    turns: Array


@kernel
def _leaf_frame(start, end, n):
    """The frame F over a triangle by two of its corners, with the normal n there."""
    side = unit(without(sub(end, start), n))
    return side, cross(n, side), n


@kernel
def carry_points(skin, corners, weights, away, points):
    """Points (V, 3) m over triangles (V, 3) of a skin (S, 3) m, by barycentric weights (V, 3) and
    ways from there (V, 3) m in the frames of these."""
    for v in range(points.shape[0]):
        a, b, c = skin[corners[v, 0]], skin[corners[v, 1]], skin[corners[v, 2]]
        frame = _leaf_frame(a, b, unit(normal_of(a, b, c)))
        store(points[v], add(_blended(weights[v], a, b, c), _from_axes(away[v], frame)))


@kernel
def _barycentric(leaves, f, node):
    own = leaves.places[f]
    return own[0, node], own[1, node], own[2, node]


@kernel
def find_offsets(carrier, leaves, nodes, low, high):
    """Places of nodes (F, P, 3) m in the frames of their leaves. Written: shares and o."""
    for f in range(low, high):
        for node in range(nodes.shape[1]):
            t, leaf = leaves.feet[f, node], (leaves.values[f], 0.0)
            b = _barycentric(leaves, f, node)
            point, n, _, _, shares = leaf_point(carrier, t, b, leaf)
            face = carrier.faces[t]
            frame = _leaf_frame(carrier.vertices[face[0]], carrier.vertices[face[1]], n)
            away = _seen(sub(nodes[f, node], point), frame)
            for k in range(3):
                leaves.places[f, 3 + k, node], leaves.places[f, 6 + k, node] = shares[k], away[k]


@kernel
def _seen(vector, axes):
    """A vector's components along three axes."""
    return dot(vector, axes[0]), dot(vector, axes[1]), dot(vector, axes[2])


@kernel
def _from_axes(parts, axes):
    """The inverse of _seen."""
    return add(combined(parts[0], axes[0], parts[1], axes[1]), scale(parts[2], axes[2]))


@kernel
def _corners(carrier, feet, first, k):
    """Corners k of the triangles under four nodes: point, normals, and T, a and r."""
    at, width, faces = carrier.vertices, carrier.vertices.shape[1], carrier.faces
    u, v = width * faces[feet[first], k], width * faces[feet[first + 1], k]
    w, x = width * faces[feet[first + 2], k], width * faces[feet[first + 3], k]
    a = transposed(load(at, u), load(at, v), load(at, w), load(at, x))
    b = transposed(load(at, u + 4), load(at, v + 4), load(at, w + 4), load(at, x + 4))
    c = transposed(load(at, u + 8), load(at, v + 8), load(at, w + 8), load(at, x + 8))
    return (a[0], a[1], a[2]), (a[3], b[0], b[1]), (b[2], b[3], c[0]), (c[1], c[2], c[3])


@kernel
def _three(line, first, count):
    return load(line, first), load(line, first + count), load(line, first + 2 * count)


@kernel
def _blended(weights, a, b, c):
    return combined(1.0, combined(weights[0], a, weights[1], b), weights[2], c)


@kernel
def _draw_images(carrier, leaves, f, room):
    feet, line, count = leaves.feet[f], leaves.places[f], leaves.feet.shape[1]
    for first in range(0, count, LANES):
        w, shares = _three(line, first, count), _three(line, first + 3 * count, count)
        one, two = _corners(carrier, feet, first, 0), _corners(carrier, feet, first, 1)
        three = _corners(carrier, feet, first, 2)
        n = unit(_blended(w, one[1], two[1], three[1]))
        x = _blended(w, one[0], two[0], three[0])
        point = rounded(x, x, w[0], one[0], one[2])
        point = rounded(point, x, w[1], two[0], two[2])
        point = rounded(point, x, w[2], three[0], three[2])
        height = dot(shares, _blended(w, one[3], two[3], three[3]))
        frame = _leaf_frame(one[0], two[0], n)
        away = _from_axes(_three(line, first + 6 * count, count), frame)
        x, y, z = add(combined(1.0, point, height, n), away)
        points = transposed(x, y, z, z)
        for k in range(LANES):
            put(room.flat, 4 * (first + k), points[k])
    for i in range(room.up.shape[0]):
        node = i * room.image.shape[1]
        b, leaf = _barycentric(leaves, f, node), (leaves.values[f], 0.0)
        _, n, slope, _, _ = leaf_point(carrier, feet[node], b, leaf)
        # of triangles that a pose squeezes the slope has no bound
        slope = scale(1.0 / sqrt(1.0 + dot(slope, slope)), slope)
        store(room.up[i], unit(sub(n, slope)))


@kernel
def _seen_chord(image, rest, start, end):
    """A chord between two nodes (row, column) at rest, of length 1, and what is seen of its image:
    of length 1 at most, and shorter where that is short. None has a length where there is none."""
    chord = sub(rest[end[0], end[1]], rest[start[0], start[1]])
    now = sub(image[end[0], end[1]], image[start[0], start[1]])
    size = max(length(chord), _NO_LENGTH)
    return scale(1.0 / size, chord), scale(1.0 / max(length(now), _SHORTEST * size), now)


@kernel
def _loss(before, after):
    """Loss of the cosine between two chords, each at rest and now."""
    return dot(before[0], after[0]) - dot(before[1], after[1])


@kernel
def _find_fold(image, up, rest):
    """The largest loss along the rachis, along barbs, and between rows; and that of what stands
    square on the rachis."""
    rows, m, worst, lean = image.shape[0], (image.shape[1] - 1) // 2, 0.0, 0.0
    for i in range(1, rows):
        chord = _seen_chord(image, rest, (i - 1, 0), (i, 0))
        along = dot(chord[1], up[i])
        lean = max(lean, 1.0 - sqrt(max(1.0 - along * along, 0.0)))
        if i + 1 < rows:
            worst = max(worst, _loss(chord, _seen_chord(image, rest, (i, 0), (i + 1, 0))))
        wide = _seen_chord(image, rest, (i - 1, m), (i - 1, 2 * m))
        worst = max(worst, _loss(wide, _seen_chord(image, rest, (i, m), (i, 2 * m))))
        for side in range(2):
            barb = _seen_chord(image, rest, (i, 0), (i, 1 + side * m))
            for j in range(1 + side * m, m + side * m):
                piece = _seen_chord(image, rest, (i, j), (i, j + 1))
                worst = max(worst, _loss(barb, piece))
                barb = piece
    return worst, lean


@kernel
def find_folds(carrier, leaves, rest, room, folds, low, high):
    """Raise the folds (K, 2) of feathers low to high - 1 to those of their images over a carrier,
    as of _find_fold.

    rest: (K, n, 1 + 2 m, 3) m.
    """
    for f in range(low, high):
        _draw_images(carrier, leaves, f, room)
        worst, lean = _find_fold(room.image, room.up, rest[f])
        folds[f, 0], folds[f, 1] = max(folds[f, 0], worst), max(folds[f, 1], lean)


@kernel
def _column(matrix, k):
    return matrix[0, k], matrix[1, k], matrix[2, k]


@kernel
def _find_rise(images, nodes, start, axes):
    """Angle (rad) by which a rachis (n, 1 + 2 m, 3), m, turns up about its root so that none of it
    is below its images."""
    rise = 0.0
    for i in range(1, nodes.shape[0]):
        x, y, z = _seen(sub(images[i, 0], start), axes)
        u, v, w = nodes[i, 0, 0], nodes[i, 0, 1], nodes[i, 0, 2]
        rise = max(rise, atan2(z, sqrt(x * x + y * y)) - atan2(w, sqrt(u * u + v * v)))
    return rise


@kernel
def _bridge(carried, f, room):
    """Bring images nearer to where the root carries them, and turns them up over what has folded
    towards them."""
    share, start, turn = carried.shares[f], carried.positions[f], carried.rotations[f]
    if share <= 0.0:
        return
    start = start[0], start[1], start[2]
    x, y, z = _column(turn, 0), _column(turn, 1), _column(turn, 2)
    rise = _find_rise(room.image, carried.nodes[f], start, (x, y, z))
    c, s = cos(rise), sin(rise)
    axes = combined(c, x, s, z), y, combined(c, z, -s, x)
    for i in range(room.image.shape[0]):
        for j in range(room.image.shape[1]):
            there = add(start, _from_axes(carried.nodes[f, i, j], axes))
            store(room.image[i, j], combined(1.0 - share, room.image[i, j], share, there))
        own = _from_axes(carried.directors[f, i, 1], axes)
        store(room.up[i], unit(combined(1.0 - share, room.up[i], share, own)))


@kernel
def _direction(vector, other):
    """Unit vector along a vector, or another one where that has no length."""
    size = length(vector)
    return scale(1.0 / size, vector) if size > _NO_LENGTH else other


@kernel
def _chord(start, end, size, other):
    """Part of the way from one point to another, and on, at which it is `size` (m) from the origin,
    and the unit vector to there, or another one where that has no length."""
    along = sub(end, start)
    # |start + part along| = size
    a, b, c = dot(along, along), dot(start, along), dot(start, start) - size * size
    part = 1.0
    if a > _NO_LENGTH * _NO_LENGTH:
        part = (sqrt(max(b * b - a * c, 0.0)) - b) / a
    return part, _direction(combined(1.0, start, part, along), other)


@kernel
def _draw_quill(carried, f, last, at, way, room):
    """Rows before the last of a quill, which is as at rest, from at along a unit vector."""
    nodes, turn = carried.nodes[f], carried.rotations[f]
    axes = _column(turn, 0), _column(turn, 1), _column(turn, 2)
    before = unit(_from_axes(sub(nodes[last, 0], nodes[0, 0]), axes))
    about, near = cross(before, way), max(1.0 + dot(before, way), _NO_LENGTH)
    for i in range(1, last):
        own = _from_axes(sub(nodes[i, 0], nodes[0, 0]), axes)
        aside = cross(about, own)
        moved = add(own, combined(1.0, aside, 1.0 / near, cross(about, aside)))
        store(room.rachis[i], combined(1.0, at, 1.0, moved))
        room.row[i], room.part[i] = i, 0.0


@kernel
def _draw_rachis(steps, carried, f, bare, room):
    """Rachis along the polyline of its images, in chords of its own lengths (n - 1), the first of
    them that of its quill, before row bare."""
    rows, k, way = room.rachis.shape[0], 0, (1.0, 0.0, 0.0)
    store(room.rachis[0], room.image[0, 0])
    room.row[0], room.part[0] = 0, 0.0
    for i in range(max(bare, 1), rows):
        at, size = room.rachis[i - 1], steps[i - 1]
        if i == bare:
            at, size = room.rachis[0], length(sub(carried.nodes[f, i, 0], carried.nodes[f, 0, 0]))
        while k < rows - 2 and length(sub(room.image[k + 1, 0], at)) < _NEARER * size:
            k += 1
        start, end = room.image[k, 0], room.image[k + 1, 0]
        room.part[i], way = _chord(sub(start, at), sub(end, at), size, way)
        store(room.rachis[i], combined(1.0, at, size, way))
        room.row[i] = k
        if i == bare:
            _draw_quill(carried, f, bare, (at[0], at[1], at[2]), way, room)


@kernel
def _frame(along, up):
    """Tangent, side and normal, unit vectors."""
    along = unit(along)
    side = unit(cross(up, along))
    return along, side, cross(along, side)


@kernel
def _find_barbed(pieces):
    """First and last row whose barbs have pieces (2, n, m) of a length."""
    first, last = 0, pieces.shape[1] - 1
    while first < last and pieces[0, first, 0] + pieces[1, first, 0] == 0.0:
        first += 1
    while first < last and pieces[0, last, 0] + pieces[1, last, 0] == 0.0:
        last -= 1
    return first, last


@kernel
def _place_of(room, i, barbed):
    """Image row before a drawn row, and how far on to the next it is; within barbed rows."""
    place = room.row[i] + min(room.part[i], 1.0)
    place = min(max(place, float(barbed[0])), float(barbed[1]))
    k = min(int(place), barbed[1] - 1)
    return k, place - k


@kernel
def _stretch(room, steps, k):
    """Length of the images around row k over that of steps (n - 1) there."""
    own = size = 0.0
    for i in range(max(k - 1, 0), min(k + 1, room.up.shape[0] - 1)):
        own += steps[i]
        size += length(sub(room.image[i + 1, 0], room.image[i, 0]))
    return size / own


@kernel
def _row_frame(room, i):
    """Frame of a row of the drawn rachis."""
    rows, k, part = room.up.shape[0], room.row[i], min(room.part[i], 1.0)
    low, high = max(i - 1, 0), min(i + 1, rows - 1)
    up = combined(1.0 - part, room.up[k], part, room.up[k + 1])
    return _frame(sub(room.rachis[high], room.rachis[low]), up)


@kernel
def _rolled(axes, angle):
    """Three axes turned about the first by an angle, rad."""
    along, side, normal = axes
    c, s = cos(angle), sin(angle)
    return along, combined(c, side, s, normal), combined(c, normal, -s, side)


@kernel
def _turned(vector, axes, angle):
    """A vector turned about the third of three axes by an angle, rad."""
    x, y, z = _seen(vector, axes)
    c, s = cos(angle), sin(angle)
    return _from_axes((c * x - s * y, s * x + c * y, z), axes)


@kernel
def _angle(way, lateral, dorsal):
    """Angle of a vector to a row within the vane, towards d2, rad."""
    return atan2(dot(way, lateral), dot(way, cross(lateral, dorsal)))


@kernel
def _find_turns(motion, f, b, turns):
    """Turns of rows and of the chords after them from rest. Written: turns (n, 2) rad."""
    turns[:] = 0.0
    if b < 0:
        return
    nodes, directors, rest = motion.nodes[b], motion.directors[b], motion.rest
    for i in range(nodes.shape[0] - 1):
        way = sub(nodes[i + 1, 0], nodes[i, 0])
        ahead = _angle(way, directors[i, 0], directors[i, 1]) - rest.ahead[f, i]
        behind = _angle(way, directors[i + 1, 0], directors[i + 1, 1]) - rest.behind[f, i]
        turns[i, 1] = turns[i, 0] + ahead
        turns[i + 1, 0] = turns[i, 1] - behind


@kernel
def _barb_turn(motion, f, b, i, side, j):
    """Turn of a barb's piece j within the vane from rest, rad."""
    m = motion.rest.angles.shape[3]
    nodes, directors, column = motion.nodes[b, i], motion.directors[b, i], 1 + side * m + j
    now = sub(nodes[column], nodes[column - 1 if j > 0 else 0])
    return _angle(now, directors[0], directors[1]) - motion.rest.angles[f, side, i, j]


@kernel
def _imaged_barb(room, place, column, imaged, axes, angle):
    """Way (m) from the rachis to images of a column at a place (row, part), from the frame imaged
    to that of a row, whose own barb is turned by an angle (rad) from there."""
    k, part = place
    own = combined(1.0 - part, room.image[k, column], part, room.image[k + 1, column])
    foot = combined(1.0 - part, room.image[k, 0], part, room.image[k + 1, 0])
    return _turned(_from_axes(_seen(sub(own, foot), imaged), axes), axes, angle)


@kernel
def draw_over(carrier, leaves, carried, motion, made, room, low, high):
    """Draw feathers low to high - 1 over a carrier. carried: CarriedShapes. motion: VaneMotion.
    room: ImageRoom. Written: made, nodes (F, n, 1 + 2 m, 3) m and directors (F, n, 2, 3)."""
    nodes, directors = made
    rows, m = nodes.shape[1], leaves.pieces.shape[3]
    for f in range(low, high):
        b, roll = motion.order[f], motion.roll[f]
        _draw_images(carrier, leaves, f, room)
        _bridge(carried, f, room)
        barbed = _find_barbed(leaves.pieces[f])
        _draw_rachis(leaves.steps[f], carried, f, barbed[0], room)
        _find_turns(motion, f, b, room.turns)
        first = room.rachis[0]
        at = first[0], first[1], first[2]
        for i in range(rows):
            frame = _row_frame(room, i)
            axes, turn = _rolled(frame, roll), room.turns[i, 0]
            store(nodes[f, i, 0], at)
            for k in range(2):
                own = _from_axes(leaves.directors[f, i, k], axes)
                store(directors[f, i, k], _turned(own, axes, turn))
            k, part = _place_of(room, i, barbed)
            one, two = (_stretch(room, leaves.steps[f], k), _stretch(room, leaves.steps[f], k + 1))
            ahead = scale(1.0 / ((1.0 - part) * one + part * two), frame[0])
            imaged = ahead, frame[1], frame[2]
            for side in range(2):
                angles, last = motion.rest.angles[f, side], side * m + m
                angle = angles[i, 0] - (1.0 - part) * angles[k, 0] - part * angles[k + 1, 0]
                end, way, place, column = at, axes[1], (0.0, 0.0, 0.0), 1 + side * m
                before = place
                ahead = _imaged_barb(room, (k, part), column, imaged, axes, angle)
                for j in range(m):
                    size = leaves.pieces[f, side, i, j]
                    while column < last and length(sub(ahead, place)) < _NEARER * size:
                        before, column = ahead, column + 1
                        ahead = _imaged_barb(room, (k, part), column, imaged, axes, angle)
                    _, way = _chord(sub(before, place), sub(ahead, place), size, way)
                    place, piece = combined(1.0, place, size, way), way
                    if b >= 0:
                        piece = _turned(way, axes, turn + _barb_turn(motion, f, b, i, side, j))
                    end = combined(1.0, end, size, piece)
                    store(nodes[f, i, 1 + side * m + j], end)
            if i + 1 < rows:
                way = sub(room.rachis[i + 1], room.rachis[i])
                at = add(at, _turned(way, axes, room.turns[i, 1]))
