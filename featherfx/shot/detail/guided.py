"""Feathers that follow simulated guides: deformation carried in rachis frames.

Of every guide, at its relative arc lengths, three kinds of rotation vectors are taken in its own
root and row frames, against its rest shape; A_i is row i's frame seen from the root:

    k_i   turn from row to row      A_i^T A_(i+1) = K0_i exp(k_i)
    c_i   turn of the shaft's chord from row i to row i + 1, in A_i
    b_ij  turn of a barb's segment j, in A_i

Rotation vectors of different guides are added with weights; as each is one row's part of the
bending only, none comes near half a turn, where such sums flip. The follower's pose is the chain

    A_(i+1) = A_i K0_i exp(k_i),   r_(i+1) = r_i + A_i exp(c_i) chord_i,
    x_ij = x_i(j-1) + A_i exp(b_ij) segment_ij

with its own rest shape and root, so that every chord and segment keeps its length, and a rigid
motion of guides and followers moves the followers rigidly. k and c belong to intervals and are
spread by how far those of guide and follower overlap; b is interpolated along the shaft.

Feathers that are not solved: rigid ones follow their roots, guided ones their guides.

Guides are seen from their moving roots, and what follows them is carried back into the world.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cached_property
from math import cos, sin, sqrt
from typing import Any, NamedTuple

import numpy as np
import scipy

from featherfx.algebra.interpolation import linear_weights
from featherfx.algebra.types import Array, Flags, Indices
from featherfx.algebra.vectors import rotation_vectors
from featherfx.feather.types import LEADING, TRAILING, Feather, RowPoints, barb_slice, both, stacked
from featherfx.jit.compiled import kernel
from featherfx.shot.detail.guides import guide_weights
from featherfx.shot.frames import FeatherPose
from featherfx.shot.loop.run import Guidance, ShotRun, Stage
from featherfx.shot.roots import RootFrames, Roots, root_rates


@kernel
def turned(vector, piece):
    """A piece (3,) turned by a rotation vector (3,)."""
    x, y, z = vector[0], vector[1], vector[2]
    square = x * x + y * y + z * z
    if square < 1e-8:
        sine, versine = 1.0 - square / 6.0, 0.5 - square / 24.0
    else:
        angle = sqrt(square)
        sine, versine = sin(angle) / angle, (1.0 - cos(angle)) / square
    a, b, c = piece[0], piece[1], piece[2]
    p, q, r = y * c - z * b, z * a - x * c, x * b - y * a
    return (
        a + sine * p + versine * (y * r - z * q),
        b + sine * q + versine * (z * p - x * r),
        c + sine * r + versine * (x * q - y * p),
    )


@kernel
def add_applied(frame, vector, start, out):
    """start + frame vector, to out (3,). frame: (3, 3)."""
    for k in range(3):
        out[k] = (
            start[k] + frame[k, 0] * vector[0] + frame[k, 1] * vector[1] + frame[k, 2] * vector[2]
        )


@kernel
def mirror(nodes, directors):
    """Mirror one feather (guided.py), in place: nodes (n, 1 + 2 m, 3), directors (n, 2, 3)."""
    for i in range(nodes.shape[0]):
        for j in range(nodes.shape[1]):
            nodes[i, j, 1] = -nodes[i, j, 1]
        for k in range(0, 3, 2):
            directors[i, 0, k] = -directors[i, 0, k]
        directors[i, 1, 1] = -directors[i, 1, 1]


@kernel
def chains(turns, rest, mirrored, scratch, points):
    """Nodes and directors of all feathers, in their root frames.

    turns: Turns, rest: FeatherPieces, of F feathers at rest. mirrored: (F,). scratch: (3, 3, 3).
    Written: points (RowPoints).
    """
    rows, columns = turns.barbs.shape[2], turns.barbs.shape[3]
    step, none = scratch[2, 0], (0.0, 0.0, 0.0)
    nodes, directors = points.nodes, points.directors
    for f in range(nodes.shape[0]):
        now, after = scratch[0], scratch[1]
        for k in range(3):
            nodes[f, 0, 0, k] = rest.origins[f, k]
            for c in range(3):
                now[k, c] = 1.0 if k == c else 0.0
        for i in range(rows):
            at = nodes[f, i]
            for k in range(3):
                directors[f, i, 0, k], directors[f, i, 1, k] = now[k, 1], now[k, 2]
            for side in range(2):
                start = at[0]
                for j in range(columns):
                    piece = turned(turns.barbs[f, side, i, j], rest.segments[f, side, i, j])
                    end = at[1 + side * columns + j]
                    add_applied(now, piece, start, end)
                    start = end
            if i == rows - 1:
                break
            chord = turned(turns.along[f, i, 3:], rest.chords[f, i])
            add_applied(now, chord, at[0], nodes[f, i + 1, 0])
            # columns of the next frame: A K exp(k) e_c
            for c in range(3):
                unit = (1.0 if c == 0 else 0.0, 1.0 if c == 1 else 0.0, 1.0 if c == 2 else 0.0)
                add_applied(rest.steps[f, i], turned(turns.along[f, i, :3], unit), none, step)
                add_applied(now, step, none, after[:, c])
            now, after = after, now
        if mirrored[f]:
            mirror(nodes[f], directors[f])


@kernel
def carry_to_world(posed, step, shifted, roots, world):
    """Vectors of F feathers in the world, with their first and second rates.

    posed: three (F, K, 3) in root frames that move: now, and step (s) later and earlier. shifted:
    1 for places, 0 for directions. roots: three pairs of positions (F, 3) and rotations (F, 3, 3),
    now and their rates. Written: world, three (F, K, 3).

    With x = p + R y:  x' = p' + R' y + R y',  x'' = p'' + R'' y + 2 R' y' + R y''.
    """
    now, after, before = posed
    (p, turn), (p1, turn1), (p2, turn2) = roots
    points, rates, seconds = world
    for f in range(now.shape[0]):
        r, r1, r2 = turn[f], turn1[f], turn2[f]
        for k in range(now.shape[1]):
            a, b, c = now[f, k, 0], now[f, k, 1], now[f, k, 2]
            later, earlier = after[f, k], before[f, k]
            u = (later[0] - earlier[0]) / (2.0 * step)
            v = (later[1] - earlier[1]) / (2.0 * step)
            w = (later[2] - earlier[2]) / (2.0 * step)
            x = (later[0] - 2.0 * a + earlier[0]) / (step * step)
            y = (later[1] - 2.0 * b + earlier[1]) / (step * step)
            z = (later[2] - 2.0 * c + earlier[2]) / (step * step)
            for i in range(3):
                points[f, k, i] = shifted * p[f, i] + r[i, 0] * a + r[i, 1] * b + r[i, 2] * c
                rates[f, k, i] = (
                    shifted * p1[f, i]
                    + (r1[i, 0] * a + r1[i, 1] * b + r1[i, 2] * c)
                    + (r[i, 0] * u + r[i, 1] * v + r[i, 2] * w)
                )
                seconds[f, k, i] = (
                    shifted * p2[f, i]
                    + (r2[i, 0] * a + r2[i, 1] * b + r2[i, 2] * c)
                    + 2.0 * (r1[i, 0] * u + r1[i, 1] * v + r1[i, 2] * w)
                    + (r[i, 0] * x + r[i, 1] * y + r[i, 2] * z)
                )


# rates come from poses that far apart in time, as a fraction of the time between two samples
INSTANT = 1e-3
# relative arc lengths are compared to that many digits, so that equal shapes map one to one
_DIGITS = 12


class Turns(NamedTuple):
    """Rotation vectors that deform F feathers in their own frames, rad.

    along: (F, n - 1, 6) k and c of the intervals. barbs: (F, 2, n, m, 3) of the segments.
    """

    along: Array
    barbs: Array


class FeatherPieces(NamedTuple):
    """Pieces of F feathers: chords of their rachises and segments of their barbs.

    origins: (F, 3) m, first rachis points in the root frames. steps: (F, n - 1, 3, 3) from row
    frame to row frame. chords: (F, n - 1, 3) and segments: (F, 2, n, m, 3) m, in row frames.
    """

    origins: Array
    steps: Array
    chords: Array
    segments: Array


class Chains:
    """F feathers of n rows and m columns in a pose, rest: (F, ...), from which turns count."""

    def __init__(self, rest: RowPoints, mirrored: Sequence[bool]) -> None:
        self._mirrored = np.array(mirrored, dtype=np.bool_)
        self._rest = _pieces(self._unmirrored(rest))
        self.size = rest.nodes.shape[1], rest.nodes.shape[2] // 2

    def turns(self, points: RowPoints) -> Turns:
        """Find how F feathers, seen from their root frames, are deformed."""
        now = _pieces(self._unmirrored(points))
        bends = rotation_vectors(np.ascontiguousarray(_transposed(self._rest.steps) @ now.steps))
        along = np.concatenate([bends, _turn_between(self._rest.chords, now.chords)], axis=2)
        return Turns(along, _turn_between(self._rest.segments, now.segments))

    def posed(self, turns: Turns) -> RowPoints:
        """The F feathers in their root frames."""
        rows, columns = self.size
        count = len(self._rest.origins)
        nodes = np.empty((count, rows, 1 + 2 * columns, 3))
        points = RowPoints(nodes, np.empty((count, rows, 2, 3)))
        chains(turns, self._rest, self._mirrored, np.empty((3, 3, 3)), points)
        return points

    def _unmirrored(self, points: RowPoints) -> RowPoints:
        """Mirrored feathers as their mirror images (featherfx/feather/types.py)."""
        if not self._mirrored.any():
            return points
        flipped = np.where(self._mirrored[:, None, None, None], [1.0, -1.0, 1.0], 1.0)
        turned_round = np.where(self._mirrored[:, None, None, None], [[-1.0], [1.0]], 1.0)
        return RowPoints(points.nodes * flipped, points.directors * flipped * turned_round)


class Shapes(Chains):
    """Rest shapes of F feathers.

    stations: (n,) relative arc lengths, and grown: (2, n) which barbs there are, of each.
    """

    def __init__(self, feathers: Sequence[Feather], mirrored: Sequence[bool]) -> None:
        super().__init__(stacked([feather.rest for feather in feathers]), mirrored)
        self.stations = [np.round(each.station / each.station[-1], _DIGITS) for each in feathers]
        self.grown = [np.asarray(each.barb_length > 0.0) for each in feathers]


class Followers:
    """F feathers that follow G guides. weights: (F, G), rows add up to 1."""

    def __init__(self, shapes: Shapes, guides: Shapes, weights: Any) -> None:
        self.shapes, self.guides = shapes, guides
        self._along, self._sides = _blends(shapes, guides, weights)

    def points(self, guides: RowPoints) -> RowPoints:
        """The F feathers in their root frames from the G guides in theirs."""
        taken = self.guides.turns(guides)
        rows, columns = self.shapes.size
        count = len(self.shapes.stations)
        along = self._along @ taken.along.reshape(-1, 6)
        barbs = np.empty((count, 2, rows, columns, 3))
        for side, blend in enumerate(self._sides):
            mixed = blend @ taken.barbs[:, side].reshape(-1, 3 * columns)
            barbs[:, side] = mixed.reshape(count, rows, columns, 3)
        return self.shapes.posed(Turns(along.reshape(count, rows - 1, 6), barbs))

    def moving(
        self, guides: RowPoints, rate: RowPoints, second: RowPoints, span: float
    ) -> tuple[list[RowPoints], float]:
        """Points in root frames, from those of the guides and their rates: now, and the time (s)
        that is returned later and earlier. span: s, time between samples; 0: nothing moves."""
        now = self.points(guides)
        if not span > 0.0:
            return [now, now, now], 1.0
        h = INSTANT * span

        def at(step: float) -> RowPoints:
            moved = both(lambda x, v, a: x + step * v + 0.5 * h * h * a, guides, rate, second)
            return self.points(moved)

        return [now, at(h), at(-h)], h


def _blends(shapes: Shapes, guides: Shapes, weights: Any) -> tuple[Any, list[Any]]:
    """Sparse maps of the intervals' turns, and for each side of the rows' barb turns."""
    weights = weights.tocoo()
    rows = shapes.size[0]
    first, own = _alike([each.tobytes() for each in shapes.stations])
    pairs = zip(guides.stations, guides.grown, strict=True)
    first_guide, other = _alike([station.tobytes() + grown.tobytes() for station, grown in pairs])
    kind = own[weights.row] * len(first_guide) + other[weights.col]
    order = np.argsort(kind, kind="stable")
    kinds, start = np.unique(kind[order], return_index=True)
    parts: list[list[tuple[Array, Array, Array]]] = [[], [], []]
    for number, some in zip(kinds.tolist(), np.split(order, start[1:]), strict=True):
        f, g = first[number // len(first_guide)], first_guide[number % len(first_guide)]
        station, guide = shapes.stations[f], guides.stations[g]
        maps = [overlaps(station, guide)]
        maps += [_interpolation(station, guide, grown) for grown in guides.grown[g]]
        followers, leaders, fractions = (
            values[some, None] for values in (weights.row, weights.col, weights.data)
        )
        for part, own_map, size in zip(parts, maps, (rows - 1, rows, rows), strict=True):
            each = scipy.sparse.coo_array(own_map)
            row, column = followers * size + each.row, leaders * size + each.col
            part.append((row.ravel(), column.ravel(), (fractions * each.data).ravel()))
    found = []
    for part, size in zip(parts, (rows - 1, rows, rows), strict=True):
        row, column, data = (np.concatenate(column) for column in zip(*part, strict=True))
        shape = len(shapes.stations) * size, len(guides.stations) * size
        found.append(scipy.sparse.coo_array((data, (row, column)), shape=shape).tocsr())
    return found[0], found[1:]


def _alike(keys: Sequence[bytes]) -> tuple[list[int], Indices]:
    """The first place of each key, and (N,) the number of every one's."""
    first: dict[bytes, int] = {}
    for place, key in enumerate(keys):
        first.setdefault(key, place)
    number = {key: n for n, key in enumerate(first)}
    return list(first.values()), np.array([number[key] for key in keys], dtype=np.int64)


def overlaps(own: Array, other: Array) -> Array:
    """(n - 1, n - 1) how much of each of the other's intervals lies within each of the own."""
    low = np.maximum(own[:-1, None], other[None, :-1])
    high = np.minimum(own[1:, None], other[None, 1:])
    return np.maximum(high - low, 0.0) / np.diff(other)


def _interpolation(own: Array, other: Array, grown: Flags) -> Array:
    """(n, n) linear weights of the other's rows with barbs at the own places."""
    found = np.zeros((len(own), len(other)))
    places = np.flatnonzero(grown)
    if len(places):
        found[:, places] = linear_weights(other[places], own)
    return found


def row_frames(directors: Array) -> Array:
    """(F, n, 3, 3) row frames from the directors, made orthonormal."""
    second, third = directors[:, :, 0], directors[:, :, 1]
    second = second / np.linalg.norm(second, axis=-1, keepdims=True)
    third = third - np.einsum("fnk,fnk->fn", third, second)[..., None] * second
    third = third / np.linalg.norm(third, axis=-1, keepdims=True)
    return np.stack([np.cross(second, third), second, third], axis=-1)


def _pieces(points: RowPoints) -> FeatherPieces:
    """Take F feathers, seen from their root frames, apart."""
    frames, every = row_frames(points.directors), points.nodes
    back = _transposed(frames[:, :-1])
    chords = (back @ np.diff(every[:, :, 0], axis=1)[..., None])[..., 0]
    sides = []
    for side in (LEADING, TRAILING):
        barb = every[:, :, barb_slice(side, every.shape[2] // 2)]
        nodes = np.concatenate([every[:, :, :1], barb], axis=2)
        sides.append(np.diff(nodes, axis=2) @ frames)
    pieces = every[:, 0, 0], back @ frames[:, 1:], chords, np.stack(sides, axis=1)
    return FeatherPieces(*map(np.ascontiguousarray, pieces))


def _transposed(frames: Array) -> Array:
    return frames.swapaxes(-1, -2)


def _turn_between(before: Array, after: Array) -> Array:
    """(..., 3) smallest rotation vectors that turn pieces into the direction of others; 0 where a
    piece has no length."""
    axis = np.cross(before, after)
    sine = np.linalg.norm(axis, axis=-1, keepdims=True)
    cosine = np.einsum("...k,...k->...", before, after)[..., None]
    angle = np.arctan2(sine, cosine)
    return axis * np.divide(angle, sine, out=np.zeros_like(sine), where=sine > 0.0)


def rigid_poses(
    feathers: Mapping[int, Feather], motion: Roots, start: float, end: float
) -> dict[int, FeatherPose]:
    """Poses of feathers at their rest shape at a time `end` (s), by their number in the groom.

    start: s, of the sample before (see root_rates).
    """
    members = np.array(list(feathers), dtype=np.int64)
    local = stacked([feather.rest for feather in feathers.values()])
    world = [turned_by(r, local).shifted(p) for p, r in rates_of(motion, members, start, end)]
    return _by_number(members, world)


class FollowerStage(Stage):
    """The rigid and the guided feathers of a shot: nothing is solved of them.

    Of feathers whose poses are not needed nothing is computed, but whom a feather follows does not
    depend on these.
    """

    def __init__(self, run: ShotRun) -> None:
        super().__init__(run)
        rigid, guided = (run.options.at_level(level) for level in ("rigid", "guided"))
        run.rigid, run.guided = (int(np.isin(each, run.wanted).sum()) for each in (rigid, guided))
        if len(guided):
            weights = guide_weights(run.shot, guided, run.options.leading)
            run.guidance = Guidance(guided, *weights)
            run.pose_also(run.wanted)

    @cached_property
    def _rigid(self) -> dict[int, Feather]:
        """Rigid feathers, by number."""
        rigid = np.intersect1d(self.run.options.at_level("rigid"), self.run.posed)
        return {f: self.run.drawn[f] for f in rigid.tolist()}

    @cached_property
    def _followed(self) -> tuple[Guidance, Followers] | None:
        """Guided feathers that follow points of their guides, not a coat's field."""
        found, run = self.run.guidance, self.run
        if found is not None:
            unasked = np.setdiff1d(found.members, run.posed)
            found = found.without(np.union1d(unasked, run.lifted))
        if found is None:
            return None
        placements = run.shot.groom.feathers
        own, others = (
            Shapes([run.drawn[f] for f in members], [placements[f].mirrored for f in members])
            for members in (found.members, found.guides)
        )
        return found, Followers(own, others, found.weights)

    def follow(self, index: int, poses: dict[int, FeatherPose]) -> None:
        """Add the poses of rigid and guided feathers at a sample."""
        motion, start, end = self.run.motion, self.run.time(index - 1), self.run.time(index)
        if self._rigid:
            poses |= rigid_poses(self._rigid, motion, start, end)
        if self._followed is not None:
            poses |= _guided_poses(*self._followed, poses, motion, (start, end))


def _guided_poses(
    guidance: Guidance,
    followers: Followers,
    solved: Mapping[int, FeatherPose],
    motion: Roots,
    span: tuple[float, float],
) -> dict[int, FeatherPose]:
    """Poses of guided feathers at the end of a span (s) between two samples, by number."""
    (start, end), members = span, guidance.members
    poses = [solved[int(f)] for f in guidance.guides]
    given = [
        stacked([getattr(pose, name) for pose in poses])
        for name in ("points", "velocities", "accelerations")
    ]
    points, rates, seconds = seen_from_roots(given, rates_of(motion, guidance.guides, start, end))
    posed, step = followers.moving(points, rates, seconds, end - start)
    roots = tuple(map(tuple, rates_of(motion, members, start, end)))
    # each place is read before it is written over
    world = posed if posed[0] is not posed[1] else [both(np.copy, each) for each in posed]
    for part, shifted in enumerate((1.0, 0.0)):  # nodes, directors
        vectors = [tuple(_flat(each[part]) for each in many) for many in (posed, world)]
        carry_to_world(vectors[0], step, shifted, roots, vectors[1])
    return _by_number(members, world)


def rates_of(motion: Roots, members: Indices, start: float, end: float) -> list[RootFrames]:
    """Root frames of some feathers at end, and their first and second rates."""
    return [
        RootFrames(*(values[members] for values in each)) for each in root_rates(motion, start, end)
    ]


def _by_number(members: Indices, world: Sequence[RowPoints]) -> dict[int, FeatherPose]:
    return dict(zip(members.tolist(), FeatherPose.each(world), strict=True))


def seen_from_roots(world: Sequence[RowPoints], roots: Sequence[RootFrames]) -> list[RowPoints]:
    """Points and their first and second rates in moving root frames.

    With x = p + R y:  R y' = x' - p' - R' y,  R y'' = x'' - p'' - R'' y - 2 R' y'.
    """
    (p, r), (p1, r1), (p2, r2) = roots
    back = r.swapaxes(1, 2)
    x, x1, x2 = (values.shifted(-place) for values, place in zip(world, (p, p1, p2), strict=True))
    y = turned_by(back, x)
    y1 = turned_by(back, both(np.subtract, x1, turned_by(r1, y)))
    turning = turned_by(r2, y), turned_by(r1, y1)
    y2 = turned_by(back, both(lambda x, second, first: x - second - 2.0 * first, x2, *turning))
    return [y, y1, y2]


def in_world(local: Sequence[RowPoints], roots: Sequence[RootFrames]) -> list[RowPoints]:
    """The inverse of seen_from_roots."""
    (p, r), (p1, r1), (p2, r2) = roots
    y, y1, y2 = local
    first = turned_by(r1, y).shifted(p1), turned_by(r, y1)
    second = turned_by(r2, y).shifted(p2), turned_by(r1, y1), turned_by(r, y2)
    return [
        turned_by(r, y).shifted(p),
        both(np.add, *first),
        both(lambda a, b, c: a + 2.0 * b + c, *second),
    ]


def _flat(vectors: Array) -> Array:
    """(F, ..., 3) vectors of each feather in one axis."""
    return vectors.reshape(len(vectors), -1, 3)


def turned_by(matrices: Array, points: RowPoints) -> RowPoints:
    """Points of F feathers times matrices (F, 3, 3)."""
    back = matrices.swapaxes(1, 2)
    return both(lambda part: (_flat(part) @ back).reshape(part.shape), points)
