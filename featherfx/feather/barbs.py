"""Barbs of one vane at rest, traced on the flattened feather and carried onto the rachis.

A barb leaves its row's rachis point at the barb angle and turns at a constant rate, by `curl`
within the vane and by `camber` towards ventral over its whole length, and besides by the courses
of its guides. Because the whole turning is given, and not its rate, the end of a flat barb of any
length lies on one ray from its root: the chord, of an arc half a curl off the root's direction.
Where that ray meets the outline gives the length without iteration. The outline near a vane's base
is steeper than barbs are, so the first ones would cut it off in a straight edge; where the base is
rounded they grow to the outline instead, as a quarter of an ellipse of the way.

A barb is carried onto the curved rachis by turning it, on top of its own curl and camber, as much
as the rachis turns over the stretch that the flat barb reaches forward. Its length and its angle at
the root stay exact, and the vane follows camber, sweep and twist of the rachis without being
squeezed or folded (docs/barb_grid.md compares three ways).

The edge of a vane on the flattened feather, and where barbs meet it.

The control points are joined in their order by a monotone cubic (PCHIP) of the chord length in
each coordinate: it passes through every point, has no corner and never swings beyond its
neighbours, so an outline drawn at y >= 0 stays there. An outline that starts or ends away from
the rachis is closed by a straight edge at right angles to it; a rounded tip is led to the rachis
instead, its distance from there falling off as a quarter of an ellipse. The vane lies to the right
of the curve, between it and the rachis.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from featherfx.algebra.interpolation import monotone
from featherfx.algebra.vectors import arc_lengths
from featherfx.feather.profiles import Rachis
from featherfx.feather.types import LEADING, Array
from featherfx.groom.course import BARB_PIECES, bends, chord, turn, turned, wound
from featherfx.groom.types import BarbGuide, FeatherKind

if TYPE_CHECKING:
    from featherfx.groom.splits import Split

# Shares of the feather's length: shorter barbs are dropped, and this much of a barb may bulge
# over the outline between its root and its end.
_MIN_BARB_LENGTH = 1e-3
_LARGEST_BULGE = 0.02
# until points of a barb that is no arc are equally far apart, to about 1e-4 of it
_CHORD_ROUNDS = 6


@dataclass(frozen=True)
class Barbs:
    """Barbs of one vane at n rows, m segments each, as if the vane were the leading one.

    arc_length: (n,) m, zero where there is no barb.
    local: (n, m + 1, 3) m, nodes in the frame of their own row, root first.
    dorsal: (n, m + 1, 3) unit, the vane's upper side at the nodes, in the same frame.
    flat: (n, m + 1, 3) m, nodes on the flattened feather, x from the end of the calamus.
    """

    arc_length: Array
    local: Array
    dorsal: Array
    flat: Array


class _Shapes(NamedTuple):
    """Turns of the barbs. angles: (3, n) rad, angle, curl and camber. course: (n, P + 1, 2) rad,
    curl and camber besides at even fractions of their lengths; None where all are arcs."""

    angles: Array
    course: Array | None = None


def interpolate_guides(guides: tuple[BarbGuide, ...], position: Array) -> Array:
    """(3, n) rad: barb angle, curl and camber at positions (n,), 0 to 1 along the vane.

    Monotone cubic between guides, constant before the first and after the last.
    """
    values = np.radians([[g.angle, g.curl, g.camber] for g in guides])
    return np.ascontiguousarray(_between(guides, values, position).T)


def interpolate_courses(guides: tuple[BarbGuide, ...], position: Array) -> Array | None:
    """(n, P + 1, 2) rad: curl and camber of the courses of barbs at positions (n,), at even shares
    of their lengths; None where all are arcs."""
    if not any(guide.course for guide in guides):
        return None
    along = np.linspace(0.0, 1.0, BARB_PIECES + 1)
    values = np.stack([bends(guide, along).ravel() for guide in guides])
    return _between(guides, values, position).reshape(len(position), len(along), 2)


def _between(guides: tuple[BarbGuide, ...], values: Array, position: Array) -> Array:
    """(n, c) at positions (n,) of what guides have, (G, c)."""
    if len(guides) == 1:
        return np.repeat(values, len(position), axis=0)
    places = np.array([guide.position for guide in guides])
    return monotone(places, values, np.clip(position, places[0], places[-1]))


def trace_barbs(
    kind: FeatherKind, side: int, rachis: Rachis, columns: int, splits: Sequence[Split]
) -> tuple[Barbs, list[str]]:
    """Trace the barbs of one vane (LEADING or TRAILING) at the rows of the rachis.

    splits: beside which the barbs give way. Returns the barbs and what is wrong with them (messages
    with the position along the vane).
    """
    vane = kind.leading if side == LEADING else kind.trailing
    # The trailing vane is traced as its mirror image, in which rotations in y alone keep sign.
    signs = np.array([1.0, 1.0, 1.0] if side == LEADING else [-1.0, 1.0, -1.0])
    x = rachis.station - rachis.station[rachis.first_vane_row]

    def turning(way: Array) -> Array:
        return signs * turned(kind.rachis, rachis.station / kind.length, way / kind.length)

    if not vane.outline:
        return _place(_Shapes(np.zeros((3, len(x)))), np.zeros(len(x)), x, turning, columns), []
    vane_length = (1.0 - kind.calamus) * kind.length
    angles = interpolate_guides(vane.guides, x / vane_length)
    course = interpolate_courses(vane.guides, x / vane_length)
    curve = outline_curve(vane.outline, vane.rounded_tip) * [vane_length, kind.length]
    if splits:
        angles[1] += _splay(kind, splits, x, angles, curve)
    shapes = _Shapes(angles, course)
    chord_angle, part = chord(angles[0], angles[1], None if course is None else course[..., 0])
    backward = (np.sin(chord_angle) <= 0.0) & (x >= 0.0)
    messages = [
        f"barbs turn back across the rachis at position {x[i] / vane_length:.3g}: "
        f"angle {np.degrees(angles[0, i]):g} deg, curl {np.degrees(angles[1, i]):g} deg. "
        "Keep 0 < angle - curl / 2 < 180 deg"
        for i in np.flatnonzero(backward)[:1]
    ]
    arc_length = ray_lengths(curve, x, chord_angle, 1e-9 * kind.length) / part
    if vane.rounded_base > 0.0:
        begin = max(vane.outline[0][0], 0.0)
        arc_length = arc_length * opening((x / vane_length - begin) / vane.rounded_base)
    if vane.wrap:
        angles[2] = _wrapped(kind, vane.wrap, rachis.station, arc_length, chord_angle)
    kept = (x >= 0.0) & ~backward & (arc_length >= _MIN_BARB_LENGTH * kind.length)
    barbs = _place(shapes, np.where(kept, arc_length, 0.0), x, turning, columns)
    return barbs, messages + _bulges(barbs, curve, x / vane_length, kind.length)


def _wrapped(kind: FeatherKind, wrap: float, station: Array, length: Array, way: Array) -> Array:
    """(n,) rad, camber of barbs that lie on a surface of revolution, whose profile is the rachis.

    wrap: as of VaneShape, where the middle of the rachis touches it. station, length: (n,) m, of
    roots and barbs. way: (n,) rad, of their chords. A barb follows the normal curvature in its
    direction (Meusnier); `_place` adds the part along the rachis.
    """
    # bent most by its first half: its mean lever is a third of it
    middle = (station + length * np.cos(way) / 3.0) / kind.length - 0.5
    arch = math.radians(kind.rachis.camber)
    turned = arch * middle
    sunk = 0.5 * turned * middle * np.sinc(0.5 * turned / np.pi) ** 2
    across = wrap * np.cos(turned) / (1.0 - wrap * sunk)
    return np.asarray(across * length / kind.length * np.sin(way) ** 2)


def _splay(
    kind: FeatherKind, splits: Sequence[Split], x: Array, angles: Array, curve: Array
) -> Array:
    """(n,) rad, curl that splits add to barbs with roots at x (n,) m; angles: as in _place."""
    from featherfx.feather.splits import splay, strips_of

    straight = angles[0] - 0.5 * angles[1]
    length = ray_lengths(curve, x, straight, 1e-9 * kind.length)
    grown = (x >= 0.0) & (length >= _MIN_BARB_LENGTH * kind.length)
    strips = strips_of(splits, x / ((1.0 - kind.calamus) * kind.length), grown)
    across = np.concatenate(([0.0], np.cumsum(np.diff(x) * np.sin(straight[1:]))))
    return splay(strips, across, np.where(grown, length, 0.0), kind.length)


def without_barb(barbs: Barbs, row: int) -> Barbs:
    """The same barbs with the one of a row shrunk to its root."""
    arc_length, local, flat = barbs.arc_length.copy(), barbs.local.copy(), barbs.flat.copy()
    arc_length[row], local[row], flat[row] = 0.0, 0.0, flat[row, 0]
    return replace(barbs, arc_length=arc_length, local=local, flat=flat)


def _place(
    shapes: _Shapes, arc_length: Array, x: Array, turning: Callable[[Array], Array], columns: int
) -> Barbs:
    """Barbs from their shapes, lengths (n,) m and roots (n,) m.

    turning: (n, 3) rad that the rachis turns by from the roots on over ways (n,) m.
    """
    angle, curl, camber = shapes.angles
    none = np.zeros_like(angle)
    root_frame, _ = turn(np.stack((none, none, angle), axis=-1))
    rate = np.stack((none, none, -curl), axis=-1)
    course = shapes.course
    level = None if course is None else course * [1.0, 0.0]
    flat_way, _ = _nodes(rate, level, arc_length, columns)
    flat = np.einsum("nab,njb->nja", root_frame, flat_way)
    forward = flat[:, -1, 0]
    followed = np.einsum("nba,nb->na", root_frame, turning(forward))
    rate = np.stack((none, camber, -curl), axis=-1) + followed
    way, dorsal = _nodes(rate, course, arc_length, columns)
    flat[..., 0] += x[:, None]
    return Barbs(
        arc_length=arc_length,
        local=np.einsum("nab,njb->nja", root_frame, way),
        dorsal=np.einsum("nab,njb->nja", root_frame, dorsal),
        flat=flat,
    )


def _nodes(
    rate: Array, course: Array | None, arc_length: Array, columns: int
) -> tuple[Array, Array]:
    """(n, m + 1, 3) m, nodes of barbs in the frames of their roots, and the vane's upper side.

    rate: (n, 3) rad that they turn by evenly. course: (n, P + 1, 2) as in _Shapes.
    """
    along = np.linspace(0.0, 1.0, columns + 1)[:, None]
    if course is None:
        frames, tangent = turn(rate[:, None] * along)
        return arc_length[:, None, None] * along * tangent, frames[..., 2]
    turnings = rate[:, None] * np.linspace(0.0, 1.0, course.shape[1])[:, None]
    turnings[..., 1:] += np.stack((course[..., 1], -course[..., 0]), axis=-1)
    frames, places = wound(turnings)
    shares = _even_chords(places, columns)
    nodes, dorsal = _sampled(places, shares), _sampled(frames[..., 2], shares)
    steps = np.diff(nodes, axis=1)
    chords = np.linalg.norm(steps, axis=2, keepdims=True)
    # equal to the last digit, as segments of a barb are
    steps *= chords.mean(axis=1, keepdims=True) / chords
    nodes = np.concatenate((nodes[:, :1], np.cumsum(steps, axis=1)), axis=1)
    dorsal /= np.linalg.norm(dorsal, axis=2, keepdims=True)
    return arc_length[:, None, None] * nodes, dorsal


def _even_chords(places: Array, columns: int) -> Array:
    """(n, m + 1) shares of curves (n, P + 1, 3) whose points are equally far apart."""
    even = np.linspace(0.0, 1.0, columns + 1)
    shares = np.repeat(even[None], len(places), axis=0)
    for _ in range(_CHORD_ROUNDS):
        chords = np.linalg.norm(np.diff(_sampled(places, shares), axis=1), axis=2)
        gone = np.concatenate((np.zeros((len(places), 1)), np.cumsum(chords, axis=1)), axis=1)
        gone /= gone[:, -1:]
        shares = np.stack([np.interp(even, *pair) for pair in zip(gone, shares, strict=True)])
    return shares


def _sampled(values: Array, shares: Array) -> Array:
    """(n, K, 3) of values (n, P + 1, 3) at even shares, straight between, at shares (n, K)."""
    at = shares * (values.shape[1] - 1)
    low = np.clip(at.astype(int), 0, values.shape[1] - 2)
    rows, part = np.arange(len(values))[:, None], (at - low)[..., None]
    return np.asarray((1.0 - part) * values[rows, low] + part * values[rows, low + 1])


def _bulges(barbs: Barbs, curve: Array, position: Array, length: float) -> list[str]:
    """A message for the barb that bulges farthest over the outline, if it does so visibly."""
    grown = np.flatnonzero(barbs.arc_length > 0.0)
    inner = barbs.flat[grown, 1:-1, :2]
    if inner.size == 0:
        return []
    outside = distance_outside(curve, inner.reshape(-1, 2)).reshape(inner.shape[:2]).max(axis=1)
    worst = int(np.argmax(outside))
    if outside[worst] <= _LARGEST_BULGE * length:
        return []
    return [
        f"the barb at position {position[grown[worst]]:.3g} leaves the outline by "
        f"{outside[worst] / length:.3g} of the feather's length, more than {_LARGEST_BULGE:g}"
    ]


Outline = tuple[tuple[float, float], ...]

_SAMPLES_PER_SPAN = 24
_END_SAMPLES = 49
_PARALLEL = 1e-14
_END_SLACK = 1e-9


def describe_outline_fault(control: Outline) -> str:
    """Describe what is wrong with the control points themselves; empty if nothing is."""
    points = np.asarray(control, dtype=np.float64)
    if points.ndim != 2 or points.shape[1] != 2 or len(points) < 2:
        return "an outline needs at least two points (x, y)"
    if not np.isfinite(points).all():
        return "the outline holds a number that is not finite"
    if points[:, 1].min() < 0.0:
        return f"the outline has y = {points[:, 1].min():g}. Give y >= 0"
    repeated = np.flatnonzero(np.all(np.diff(points, axis=0) == 0.0, axis=1))
    if len(repeated):
        x, y = control[int(repeated[0])]
        return f"the outline repeats the point ({x:g}, {y:g})"
    crossing = _self_crossing(outline_curve(control))
    if crossing is not None:
        return f"the outline crosses itself near ({crossing[0]:g}, {crossing[1]:g})"
    return ""


@lru_cache(maxsize=1024)
def outline_curve(control: Outline, rounded_tip: float = 0.0) -> Array:
    """(K, 2) the outline as a fine polyline, base to tip, closed to the rachis; read-only.

    Same coordinates as the control points: x in lengths of the vane, y in lengths of the
    feather. rounded_tip: share of the vane's length over which an open tip is closed.
    """
    points = np.asarray(control, dtype=np.float64)
    chord = arc_lengths(points)
    fine = np.linspace(chord[:-1], chord[1:], _SAMPLES_PER_SPAN, endpoint=False, axis=1).ravel()
    blunt = points[-1, 1] > 0.0
    if blunt and rounded_tip > 0.0:
        near = chord[-1] - min(rounded_tip, chord[-1]) * np.linspace(1.0, 0.0, _END_SAMPLES) ** 2
        fine = np.unique(np.concatenate((fine, near[:-1])))
    curve = np.concatenate((monotone(chord, points, fine), points[-1:]))
    if blunt and rounded_tip > 0.0:
        curve[:, 1] *= opening((curve[-1, 0] - curve[:, 0]) / rounded_tip)
    base = [[points[0, 0], 0.0]] if points[0, 1] > 0.0 else np.empty((0, 2))
    tip = [[points[-1, 0], 0.0]] if curve[-1, 1] > 0.0 else np.empty((0, 2))
    curve = np.concatenate((base, curve, tip))
    curve.flags.writeable = False
    return curve


def opening(way: Array) -> Array:
    """Return how far a vane has opened, 0 to 1, after fractions of a rounded end: a quarter of an
    ellipse."""
    within = np.clip(way, 0.0, 1.0)
    return np.sqrt(within * (2.0 - within))


def _self_crossing(curve: Array) -> Array | None:
    """(2,) a point near which the polyline properly crosses itself, None if it does not."""
    start, step = curve[:-1], np.diff(curve, axis=0)
    offset = start[None] - start[:, None]
    den = _cross(step[:, None], step[None])
    with np.errstate(divide="ignore", invalid="ignore"):
        along = _cross(offset, step[None]) / den
        other = _cross(offset, step[:, None]) / den
    hit = (along > 0.0) & (along < 1.0) & (other > 0.0) & (other < 1.0) & (den != 0.0)
    first, second = np.nonzero(hit)
    apart = second > first + 1
    return start[first[apart][0]] if apart.any() else None


def ray_lengths(curve: Array, root: Array, angle: Array, smallest: float) -> Array:
    """(n,) m, how far rays from the rachis stay within the vane.

    curve: (K, 2) m, from `outline_curve`. root: (n,) m, x of the rays' starts (y = 0).
    angle: (n,) rad, from the rachis, in (0, pi). smallest: m, crossings nearer to the root than
    this do not count. A ray that starts outside the vane, or leaves it at once, has length zero.
    """
    step = np.diff(curve, axis=0)
    ray = np.stack((np.cos(angle), np.sin(angle)), axis=-1)[:, None]
    offset = np.stack((curve[:-1, 0] - root[:, None], curve[:-1, 1] + 0.0 * root[:, None]), -1)
    den = _cross(ray, step)
    parallel = np.abs(den) <= _PARALLEL * np.linalg.norm(step, axis=1)
    den = np.where(parallel, 1.0, den)
    distance = _cross(offset, step) / den
    along = _cross(offset, ray) / den
    met = ~parallel & (distance > smallest)
    met &= (along >= -_END_SLACK) & (along <= 1.0 + _END_SLACK)
    distance = np.where(met, distance, np.inf)
    nearest = np.argmin(distance, axis=1)
    rows = np.arange(len(root))
    # The vane is on the right of the curve: a ray that crosses it from left to right comes in.
    leaves = met[rows, nearest] & (den[rows, nearest] < 0.0)
    return np.where(leaves, np.where(leaves, distance[rows, nearest], 0.0), 0.0)


def distance_outside(curve: Array, points: Array) -> Array:
    """(N,) m, how far points (N, 2) lie outside the vane; zero for those within.

    curve: (K, 2) m, from `outline_curve`.
    """
    start, end = curve[:-1], curve[1:]
    x, y = points[:, :1], points[:, 1:]
    straddles = (start[:, 1] > y) != (end[:, 1] > y)
    rise = np.where(straddles, end[:, 1] - start[:, 1], 1.0)
    crossing = start[:, 0] + (y - start[:, 1]) / rise * (end[:, 0] - start[:, 0])
    inside = np.count_nonzero(straddles & (x < crossing), axis=1) % 2 == 1
    distance = np.zeros(len(points))
    strays = points[~inside]
    if len(strays):
        step = end - start
        offset = strays[:, None] - start
        along = np.sum(offset * step, axis=-1) / np.sum(step * step, axis=-1)
        gap = offset - np.clip(along, 0.0, 1.0)[..., None] * step
        nearest = np.sqrt(np.sum(gap * gap, axis=-1).min(axis=1))
        # The rachis closes the vane.
        low, high = curve[[0, -1], 0]
        rachis = np.hypot(strays[:, 0] - np.clip(strays[:, 0], low, high), strays[:, 1])
        distance[~inside] = np.minimum(nearest, rachis)
    return distance


def _cross(first: Array, second: Array) -> Array:
    return first[..., 0] * second[..., 1] - first[..., 1] * second[..., 0]
