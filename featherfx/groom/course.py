"""The course of shafts and barbs at rest: turnings to frames and places.

Barbs at rest are curves whose frame turns at a constant rate, and so is a rachis without a course.
A frame R(s) with dR/ds = R [k] for a constant k turns to R(s) = exp(s [k]), and its first
axis sweeps out the position s V(s k) e1, both in closed form (Rodrigues), so that a curve is exact
at any number of points. A rachis with a course is made of such pieces, always the same ones.

Besides: mirror images of feathers, places along a polyline (batches first), and checks of one vane
on the flattened feather: outlines that cross themselves, barbs that cross. There lengths are shares
of the feather's; x runs along the rachis from the first barb on, y away from it. A guide's barb
leaves the rachis at its angle and turns by `curl` over the way to the outline, at constant
curvature, and by its course besides.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise

import numpy as np

from featherfx.algebra.interpolation import monotone
from featherfx.algebra.types import Array, Flags
from featherfx.algebra.vectors import arc_lengths
from featherfx.groom.types import BarbGuide, RachisShape, VaneShape


@dataclass(frozen=True)
class Mirror:
    """A plane. normal: (3,) unit. distance: m, from the origin along the normal."""

    normal: Array
    distance: float = 0.0

    def points(self, points: Array) -> Array:
        """(..., 3) points mirrored."""
        above = points @ self.normal - self.distance
        return np.asarray(points - 2.0 * above[..., None] * self.normal)

    def directions(self, vectors: Array) -> Array:
        """(3,) direction mirrored."""
        return np.asarray(vectors - 2.0 * (vectors @ self.normal) * self.normal)

    def rotation_vectors(self, vectors: Array) -> Array:
        """(3,) rotation vector mirrored: it changes its sense, too."""
        return -self.directions(vectors)

    def screw(self, screw: Array) -> Array:
        """(6,) rotation vector and velocity of the origin, mirrored."""
        turning = screw[:3]
        there = 2.0 * self.distance * self.normal  # whose image the origin is
        velocity = screw[3:] + np.cross(turning, there)
        return np.concatenate([self.rotation_vectors(turning), self.directions(velocity)])

    def frames(self, rotation: Array) -> Array:
        """(..., 3, 3) frames of feathers mirrored, right-handed, dorsal still dorsal.

        x and z of the feather are mirrored, and y follows from them, so that the leading vane
        changes to the other side of its frame.
        """
        reflection = np.eye(3) - 2.0 * np.outer(self.normal, self.normal)
        return np.asarray(reflection @ rotation * (1.0, -1.0, 1.0))


def along_polyline(points: Array, fraction: Array) -> Array:
    """(n, 3) points at fractions of a polyline's length. points: (k, 3), k >= 2."""
    station = arc_lengths(points)
    at = np.asarray(fraction, dtype=float) * station[-1]
    return np.column_stack([np.interp(at, station, points[:, axis]) for axis in range(3)])


# Below this angle the closed form of (angle - sin(angle)) / angle^3 loses digits to cancellation;
# five terms of its series are exact to rounding there.
_SERIES_BELOW = 0.25
# pieces of constant rate that a shaft with a course of its own is made of
_PIECES = 256
# the same of a barb
BARB_PIECES = 64


def shaft(shape: RachisShape, along: Array) -> tuple[Array, Array]:
    """(K, 3, 3) frames, and (K, 3) mean tangents as of `turn`, at shares (K,) of the length."""
    if not shape.course:
        return turn(along[:, None] * _arc(shape))
    knots = np.linspace(0.0, 1.0, _PIECES + 1)
    turnings = knots[:, None] * _arc(shape) + _course(shape, knots)
    frames, places = wound(turnings)
    piece = np.clip((along * _PIECES).astype(int), 0, _PIECES - 1)
    rest = along[:, None] * _arc(shape) + _course(shape, along) - turnings[piece]
    turned, mean = turn(rest)
    before = frames[piece]
    way = (along - knots[piece])[:, None]
    ends = places[piece] + way * np.einsum("kij,kj->ki", before, mean)
    straight = np.where(along[:, None] > 0.0, ends, [1.0, 0.0, 0.0])
    return before @ turned, straight / np.where(along > 0.0, along, 1.0)[:, None]


def wound(turnings: Array) -> tuple[Array, Array]:
    """Frames (..., P + 1, 3, 3) and places (..., P + 1, 3) in lengths along curves of even pieces.

    turnings: (..., P + 1, 3) rad, from the curve's start; each piece turns at a constant rate.
    """
    steps, means = turn(np.diff(turnings, axis=-2))
    pieces = steps.shape[-3]
    frames = np.zeros((*turnings.shape[:-1], 3, 3))
    places = np.zeros(turnings.shape)
    frames[..., 0, :, :] = np.eye(3)
    for k in range(pieces):
        before = frames[..., k, :, :]
        way = (before @ means[..., k, :, None])[..., 0] / pieces
        places[..., k + 1, :] = places[..., k, :] + way
        frames[..., k + 1, :, :] = before @ steps[..., k, :, :]
    return frames, places


def bends(guide: BarbGuide, along: Array) -> Array:
    """(K, 2) rad, curl and camber of a barb's course from its root to shares (K,) of its length."""
    if len(guide.course) < 2:
        return np.zeros((len(along), 2))
    return _from_the_first(guide.course, np.radians(np.array(guide.course)[:, 1:]), along)


def chord(angle: Array, curl: Array, bent: Array | None = None) -> tuple[Array, Array]:
    """(n,) rad, the way that flat barbs go from root to end, and (n,) its share of their lengths.

    angle, curl: (n,) rad. bent: (n, P + 1) rad, curl of their courses at even shares.
    """
    if bent is None:
        return angle - 0.5 * curl, np.sinc(curl / (2.0 * np.pi))
    along = np.linspace(0.0, 1.0, bent.shape[1])
    ways = np.exp(1j * (angle[:, None] - curl[:, None] * along - bent))
    mean = 0.5 * (ways[:, 1:] + ways[:, :-1]).mean(axis=1)
    return np.angle(mean), np.abs(mean)


def chord_angle(guide: BarbGuide) -> float:
    """deg, the way that a flat barb goes from root to end."""
    if not guide.course:
        return guide.angle - 0.5 * guide.curl
    bent = bends(guide, np.linspace(0.0, 1.0, BARB_PIECES + 1))[None, :, 0]
    (way,), _ = chord(np.radians([guide.angle]), np.radians([guide.curl]), bent)
    return float(np.degrees(way))


def turned(shape: RachisShape, start: Array, way: Array) -> Array:
    """(K, 3) rad by which the frame turns from shares (K,) of the length on, over ways (K,) in
    lengths; past the tip the arc goes on."""
    arc = way[:, None] * _arc(shape)
    if not shape.course:
        return arc
    places = _course(shape, np.concatenate([start, start + way]))
    return arc + places[len(start) :] - places[: len(start)]


def _arc(shape: RachisShape) -> Array:
    """(3,) rad that the frame turns by from base to tip, without its course.

    Positive rotation about d2 lowers the tangent (ventral), about d3 turns it to the leading side:
    hence the sign of the sweep.
    """
    return np.radians([shape.twist, shape.camber, -shape.sweep])


def _course(shape: RachisShape, along: Array) -> Array:
    """(K, 3) rad, turnings of the course from the base to shares (K,) of the length."""
    places, camber, sweep, twist = np.array(shape.course).T
    values = np.radians(np.stack([twist, camber, -sweep], axis=1))
    if len(places) == 1:
        return np.zeros((len(along), 3))
    return _from_the_first(shape.course, values, along)


def _from_the_first(course: Sequence[Sequence[float]], values: Array, along: Array) -> Array:
    """(K, c) what values (n, c) at the shares of a course have changed by from 0 to shares (K,)."""
    places = np.array([point[0] for point in course])
    at = np.clip(np.concatenate([[0.0], along]), places[0], places[-1])
    found = monotone(places, values, at)
    return found[1:] - found[0]


def turn(rotation_vector: Array) -> tuple[Array, Array]:
    """Frames and mean tangents after turning steadily by the given rotation vectors.

    rotation_vector: (..., 3) rad, in the frame of the curve's start.
    Returns (..., 3, 3) frames, columns d1, d2, d3, and (..., 3) the mean of d1 on the way: arc
    length times mean tangent is the position.
    """
    x, y, z = np.moveaxis(np.asarray(rotation_vector, dtype=np.float64), -1, 0)
    skew = np.zeros((*x.shape, 3, 3))
    skew[..., 0, 1], skew[..., 0, 2], skew[..., 1, 2] = -z, y, -x
    skew[..., 1, 0], skew[..., 2, 0], skew[..., 2, 1] = z, -y, x
    squared = skew @ skew
    angle = np.sqrt(x * x + y * y + z * z)
    first = np.sinc(angle / np.pi)[..., None, None]
    second = 0.5 * np.sinc(angle / (2.0 * np.pi))[..., None, None] ** 2
    # (angle - sin(angle)) / angle^3, accurate down to zero
    q = angle * angle
    series = (1.0 - q / 20.0 * (1.0 - q / 42.0 * (1.0 - q / 72.0 * (1.0 - q / 110.0)))) / 6.0
    safe = np.maximum(angle, _SERIES_BELOW)
    third = np.where(angle < _SERIES_BELOW, series, (safe - np.sin(safe)) / safe**3)[..., None]
    frame = np.eye(3) + first * skew + second * squared
    mean_tangent = second[..., 0] * skew[..., 0] + third * squared[..., 0]
    mean_tangent[..., 0] += 1.0
    return frame, mean_tangent


_STEPS = 48


def _intersections(first: Array, second: Array) -> Flags:
    """(..., a, b) whether segment i of polylines first (..., a + 1, 2) meets j of second."""
    start_a, step_a = first[..., :-1, None, :], np.diff(first, axis=-2)[..., None, :]
    start_b, step_b = second[..., None, :-1, :], np.diff(second, axis=-2)[..., None, :, :]
    offset = start_b - start_a
    determinant = step_a[..., 0] * step_b[..., 1] - step_a[..., 1] * step_b[..., 0]
    with np.errstate(divide="ignore", invalid="ignore"):
        along_a = (offset[..., 0] * step_b[..., 1] - offset[..., 1] * step_b[..., 0]) / determinant
        along_b = (offset[..., 0] * step_a[..., 1] - offset[..., 1] * step_a[..., 0]) / determinant
    inside = (along_a >= 0) & (along_a <= 1) & (along_b >= 0) & (along_b <= 1)
    return np.asarray(inside & (np.abs(determinant) > 1e-14))


def crossing_segments(outline: Sequence[tuple[float, float]] | Array) -> list[tuple[int, int]]:
    """Pairs of segments of an outline, not neighbours, that meet."""
    points = np.asarray(outline, dtype=float).reshape(-1, 2)
    meets = np.triu(_intersections(points, points), 2)
    return [(int(i), int(j)) for i, j in np.argwhere(meets)]


def _arcs(guides: Sequence[BarbGuide], vane_length: float, lengths: Array) -> Array:
    """(G, _STEPS + 1, 2) points of the guides' barbs of given lengths (G,)."""
    along = np.linspace(0.0, 1.0, _STEPS + 1)
    middle = 0.5 * (along[1:] + along[:-1])
    heading = np.radians([guide.angle - guide.curl * middle for guide in guides])
    if any(guide.course for guide in guides):
        heading -= [bends(guide, middle)[:, 0] for guide in guides]
    steps = np.stack((np.cos(heading), np.sin(heading)), axis=2)
    steps *= (lengths / _STEPS)[:, None, None]
    start = [[[guide.position * vane_length, 0.0]] for guide in guides]
    return np.cumsum(np.concatenate((start, steps), axis=1), axis=1)


def _barbs(guides: Sequence[BarbGuide], edge: Array, vane_length: float) -> list[Array | None]:
    """The guides' barbs up to the outline (edge), None for one that never gets there.

    A barb's curvature depends on its length, so the length is found by bisection: the longest
    that has not yet met the edge.
    """

    def meets(lengths: Array) -> Flags:
        found = _intersections(_arcs(guides, vane_length, lengths), edge).any(axis=(1, 2))
        return np.asarray(found)

    short, long = np.zeros(len(guides)), np.full(len(guides), 3.0)
    ends = meets(long)
    for _ in range(40):
        middle = 0.5 * (short + long)
        met = meets(middle)
        short, long = np.where(met, short, middle), np.where(met, middle, long)
    barbs = _arcs(guides, vane_length, short)
    return [barb if end else None for barb, end in zip(barbs, ends, strict=True)]


@lru_cache(maxsize=1000)
def barbs_cross(vane: VaneShape, vane_length: float) -> tuple[int, ...]:
    """Numbers i of guides whose barb meets that of guide i + 1 within the vane.

    vane_length: share of the feather's length that carries barbs. Kept: kinds that differ in other
    things, and files that are read again, ask for the same.
    """
    edge = np.asarray(vane.outline, dtype=float) * (vane_length, 1.0)
    barbs = _barbs(vane.guides, edge, vane_length)
    return tuple(
        index
        for index, (first, second) in enumerate(pairwise(barbs))
        if first is not None and second is not None and _intersections(first, second).any()
    )
