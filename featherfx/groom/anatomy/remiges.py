"""The flight feathers of a wing: where they stand, which way they point, and how they bend.

The bones of a wing: where they are spread, folded and as landmarks have them.

A bone's frame: x along it, outwards, z dorsal. Angles within the wing count from a bone backwards,
so that a hand folds by a positive one; `turn` is +1 on the left, where that is about z, else -1.

Bands of a wing: marks that run straight through its feathers where the wing is folded.

Both edges of a band are lines in the plane of the folded wing. Each leads from a place on the
rachis of the innermost feather of some rows to one on that of the outermost. Another feather has
the band where its rachis crosses these lines, and as oblique as they are:

    root + t length way = inner + s (outer - inner),    tan(slant) = (line, way) / (line, beside)

beside: across the feather in the wing's plane, to its leading vane.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from featherfx.algebra.types import Array, Indices
from featherfx.algebra.vectors import frames_from, from_rotation_vector, rotation_vectors
from featherfx.groom.anatomy.sheet import Sheet
from featherfx.groom.keys.anatomy import CovertRow, WingBand, WingType
from featherfx.groom.materials import Pattern


@dataclass(frozen=True)
class WingBones:
    """Upper arm, forearm and hand.

    points: (4, 3) m, shoulder, elbow, wrist and tip. frames: (3, 3, 3) of the bones. hinges:
    (3, 3) rad, rotation vectors in the groom's frame that turn each bone against the one before it
    from spread to folded. fold: (3,) of the wing, as each has it.
    """

    points: Array
    frames: Array
    hinges: Array
    fold: Array
    left: bool

    @property
    def turn(self) -> float:
        return 1.0 if self.left else -1.0

    @property
    def lengths(self) -> Array:
        """(3,) m."""
        return np.asarray(np.linalg.norm(np.diff(self.points, axis=0), axis=1))

    @property
    def bend(self) -> float:
        """deg, of the hand against the forearm."""
        x, y = self.frames[1].T[:2] @ self.frames[2][:, 0]
        return float(np.degrees(np.arctan2(self.turn * y, x)))


def about_dorsal(degrees: float) -> Array:
    """(3, 3) rotation about z."""
    return from_rotation_vector(np.array([0.0, 0.0, np.radians(degrees)]))


def upper_arms(kind: WingType, axes: Array, left: bool) -> Array:
    """(2, 3, 3) frames of the upper arm, spread and folded. axes: (3, 3) body, x forward, z up."""
    turn = 1.0 if left else -1.0
    up = axes[:, 2]
    found = []
    for back, roof, tuck in zip(kind.shoulder, kind.roof, kind.tuck, strict=True):
        down, inwards = np.radians(roof), np.radians(tuck)
        forward = np.cos(inwards) * axes[:, 0] + np.sin(inwards) * turn * axes[:, 1]
        sideways = np.cos(inwards) * turn * axes[:, 1] - np.sin(inwards) * axes[:, 0]
        outwards = np.cos(down) * sideways - np.sin(down) * up
        dorsal = np.cos(down) * up + np.sin(down) * sideways
        angle = np.radians(back)
        found.append(frames_from(np.cos(angle) * outwards - np.sin(angle) * forward, dorsal))
    return np.stack(found)


def _turns(kind: WingType) -> tuple[tuple[float, float], tuple[float, float]]:
    """Angles of forearm and hand against the bone before, deg backwards, spread and folded."""
    elbow, wrist = kind.elbow, kind.wrist
    return (elbow[0] - 180.0, elbow[1] - 180.0), (180.0 - wrist[0], 180.0 - wrist[1])


def _joined(shoulder: Array, lengths: Array, frames: Array) -> Array:
    """(4, 3) m."""
    return np.vstack([shoulder, shoulder + np.cumsum(lengths[:, None] * frames[:, :, 0], axis=0)])


def folded(
    kind: WingType, shoulder: Array, lengths: Array, axes: Array, left: bool, fold: float
) -> WingBones:
    """A wing between spread (0) and folded (1). lengths: (3,) m. axes: as of upper_arms."""
    turn = 1.0 if left else -1.0
    spread, closed = upper_arms(kind, axes, left)
    swing = rotation_vectors(closed @ spread.T)
    frames = [from_rotation_vector(fold * swing) @ spread]
    hinges = [swing]
    for first, last in _turns(kind):
        frames.append(frames[-1] @ about_dorsal(turn * (first + fold * (last - first))))
        hinges.append(turn * np.radians(last - first) * frames[0][:, 2])
    posed = np.stack(frames)
    points = _joined(shoulder, lengths, posed)
    return WingBones(points, posed, np.stack(hinges), np.full(3, fold), left)


def as_placed(
    kind: WingType, points: Array, axes: Array, left: bool, dorsal: Array | None = None
) -> WingBones | None:
    """A wing whose joints and tip stand at points (4, 3) m; None where they are on one line.

    dorsal: (3,) of its skin; else that of the bend of its bones.
    """
    turn = 1.0 if left else -1.0
    bones = np.diff(points, axis=0)
    bend = np.cross(bones[1], bones[2]) - np.cross(bones[0], bones[1])
    sizes = np.linalg.norm(bones, axis=1)
    if np.linalg.norm(bend) <= 1e-3 * sizes.prod() ** (2.0 / 3.0):
        return None
    frames = frames_from(bones, np.tile(turn * bend if dorsal is None else dorsal, (3, 1)))
    spread, closed = upper_arms(kind, axes, left)
    hinges, fractions = [rotation_vectors(closed @ spread.T)], []
    for number, (first, last) in enumerate(_turns(kind), 1):
        x, y = frames[number - 1].T[:2] @ frames[number][:, 0]
        angle = np.degrees(np.arctan2(turn * y, x))
        fractions.append((angle - first) / (last - first) if last != first else 0.0)
        hinges.append(turn * np.radians(last - first) * frames[number][:, 2])
    fold = np.array([np.mean(fractions), *fractions])
    return WingBones(points, frames, np.stack(hinges), fold, left)


def spread_plan(kind: WingType, lengths: Array) -> Array:
    """(4, 2) m, the joints of the spread wing from above: outwards, backwards."""
    angles = np.cumsum([kind.shoulder[0], *(first for first, _ in _turns(kind))])
    ways = np.column_stack([np.cos(np.radians(angles)), np.sin(np.radians(angles))])
    return np.vstack([np.zeros(2), np.cumsum(lengths[:, None] * ways, axis=0)])


MAX_SLANT = 75.0  # deg
_BESIDE = 0.2  # of its length, from its rachis to a line along it that is on its vane
_ROUNDED = 3  # digits, so that both wings share their kinds
_MIN_SHARE = 2e-3  # of a feather's vane, of a band that counts


class FoldedRow(NamedTuple):
    """Feathers of a folded wing from the innermost outwards, in its plane. roots, ways: (n, 2) m
    and units. lengths: (n,) m. calamus: share of the rachis without a vane."""

    roots: Array
    ways: Array
    lengths: Array
    calamus: float


def marks_of(band: WingBand, rows: Sequence[FoldedRow]) -> list[list[Pattern | float | None]]:
    """The mark of each feather of each row; None where the band passes it by, and deg by which it
    leans where that is too much for a mark."""
    ends = np.array([_vane(rows[0], 0, band.inner), _vane(rows[-1], -1, band.outer)])
    inner, lines = ends[0], ends[1] - ends[0]
    return [[_mark(band, row, k, inner, lines) for k in range(len(row.roots))] for row in rows]


def _vane(row: FoldedRow, k: int, shares: tuple[float, float]) -> Array:
    """(2, 2) m, places at shares of a vane."""
    along = row.calamus + (1.0 - row.calamus) * np.array(shares)
    return np.asarray(row.roots[k] + row.lengths[k] * along[:, None] * row.ways[k])


def _mark(
    band: WingBand, row: FoldedRow, k: int, inner: Array, lines: Array
) -> Pattern | float | None:
    way, line = row.ways[k], lines.mean(axis=0)
    beside = np.array([-way[1], way[0]])
    beside *= np.sign(beside @ line) or 1.0
    places = []
    for start, edge in zip(inner, lines, strict=True):
        across = np.array([-edge[1], edge[0]])
        if abs(way @ across) < 1e-9 * np.linalg.norm(edge):
            away = abs((start - row.roots[k]) @ beside)
            return 90.0 if away < _BESIDE * row.lengths[k] else None  # along the feather
        along = ((start - row.roots[k]) @ across) / (way @ across) / row.lengths[k]
        places.append((along - row.calamus) / (1.0 - row.calamus))
    low, high = (round(float(each), _ROUNDED) for each in np.clip(np.sort(places), 0.0, 1.0))
    slant = float(np.degrees(np.arctan2(line @ way, line @ beside)))
    if high - low < _MIN_SHARE:
        return None
    if abs(slant) > MAX_SLANT:
        return abs(slant)
    return Pattern(
        kind="bars", colour=band.colour, start=low, end=high, count=1, size=1.0,
        soft=band.soft, slant=round(slant, 1),
    )  # fmt: skip


REMEX_ROWS = ("tertials", "secondaries", "primaries")  # from the body outwards, and the bones below
# of the upper arm, from the elbow inwards, that tertials stand on; of the hand, primaries
_TERTIALS, _PRIMARIES = (0.04, 0.55), (0.03, 0.98)
# of a shut wing, by eye: places of the row that the coat before it rises onto, and of the first
# that is a coat itself; and gaps of rows against an open wing's
_LOOSE, _COATED, _SHUT_GAP = 0.2, 0.4, 0.77
_BELOW = 1.0, 0.5  # lengths of the first rows below on the skin of a wing; by eye
_ALONG = np.linspace(0.0, 1.0, 6)  # of shafts, places that are told
_FLATTEST = 1e-6  # rad, so that vanes are as flat as a sheet without a bow
_PARALLEL = 1.0  # deg, between the innermost feather of a shut arm and the outermost
_HAND_ASIDE = 2.0  # deg, of the hand of a shut wing against its outermost primary; by eye


@dataclass(frozen=True)
class Remiges:
    """The flight feathers of a wing from the innermost outwards.

    rows: the row that each belongs to. numbers: in it, as ornithology counts them: primaries and
    secondaries from the wrist. bone: of each. roots: (N, 3) m, on the bones. angles: (N,) deg
    against the forearm as the wing is. fractions: (N,) of the hand's turn that each takes. lengths:
    (N,) m. forward: (N,) m, from the root to the leading edge. widening: (N,) of vanes, that are
    shorter than their type has them.
    """

    rows: tuple[str, ...]
    numbers: tuple[int, ...]
    bone: Indices
    roots: Array
    angles: Array
    fractions: Array
    lengths: Array
    forward: Array
    widening: Array


def remiges_of(kind: WingType, bones: WingBones, scale: float) -> Remiges:
    """Those of a wing of bones. scale: of their lengths."""
    counts = [getattr(kind, name).count for name in REMEX_ROWS]
    shoulder, elbow, wrist, tip = bones.points
    half = 0.5 / max(counts[1], 1)
    spots = (
        along(elbow, shoulder, _TERTIALS, counts[0])[::-1],
        along(elbow, wrist, (half, 1.0 - half), counts[1]),
        along(wrist, tip, _PRIMARIES, counts[2]),
    )
    spread, closed = 180.0 - kind.wrist[0], 180.0 - kind.wrist[1]
    inner, middle = np.array(kind.innermost), np.array(kind.middle)
    outer = np.array(kind.outermost) + np.array([spread, closed])
    arm = np.linspace(0.0, 1.0, counts[0] + counts[1])[:, None]
    hand = np.linspace(0.0, 1.0, counts[2] + 1)[1:, None]
    ends = np.concatenate([inner + arm * (middle - inner), middle + hand * (outer - middle)])
    fractions = (ends[:, 1] - ends[:, 0]) / ((closed - spread) or 1.0)
    lengths = [
        spread_evenly(getattr(kind, name).lengths, count)
        for name, count in zip(REMEX_ROWS, counts, strict=True)
    ]
    rows = [name for name, count in zip(REMEX_ROWS, counts, strict=True) for _ in range(count)]
    numbers = [*range(counts[0], 0, -1), *range(counts[1], 0, -1), *range(1, counts[2] + 1)]
    return Remiges(
        rows=tuple(rows),
        numbers=tuple(numbers),
        bone=np.repeat(np.arange(3), counts),
        roots=np.concatenate(spots),
        angles=ends[:, 0] + fractions * (bones.bend - spread),
        fractions=fractions,
        lengths=scale * np.concatenate(lengths),
        forward=_to_leading_edge(kind, bones.lengths, counts, ends[:, 0]),
        widening=np.ones(len(rows)),
    )


def along(first: Array, last: Array, between: tuple[float, float], count: int) -> Array:
    """(count, 3) evenly between two shares of the way."""
    return np.asarray(first + np.linspace(*between, count)[:, None] * (last - first))


def spread_evenly(values: tuple[float, ...], count: int) -> Array:
    """(count,) values between those given, these evenly spread."""
    places = np.linspace(0.0, 1.0, len(values)) if len(values) > 1 else np.zeros(1)
    return np.interp(np.linspace(0.0, 1.0, count), places, values)


def _to_leading_edge(kind: WingType, lengths: Array, counts: list[int], angles: Array) -> Array:
    """(N,) m, against the shafts of the spread wing to the line from shoulder to wrist.

    On the hand, and where that is nearer, `depth` lengths of the hand. angles: (N,) deg.
    """
    plan = spread_plan(kind, lengths)
    least = kind.depth * lengths[2]
    shoulder, elbow, wrist, _ = plan
    roots = np.concatenate(
        [
            along(elbow, shoulder, _TERTIALS, counts[0])[::-1],
            along(elbow, wrist, (0.0, 1.0), counts[1]),
        ]
    )
    forearm = np.degrees(np.arctan2(*(wrist - elbow)[::-1]))
    turned = np.radians(angles[: len(roots)] + forearm)
    back = np.column_stack([np.cos(turned), np.sin(turned)])
    edge = wrist - shoulder
    square = back[:, 0] * edge[1] - back[:, 1] * edge[0]
    away = roots - shoulder
    distance = (away[:, 0] * edge[1] - away[:, 1] * edge[0]) / np.where(square == 0, 1, square)
    result = np.full(sum(counts), least)
    result[: len(roots)] = np.clip(distance, least, lengths[1])
    return result


def frames_at(bones: WingBones, angles: Array) -> Array:
    """(n, 3, 3) frames of feathers at angles (n,) deg against the forearm."""
    forearm, turned = bones.frames[1], np.radians(angles)[:, None]
    ways = np.cos(turned) * forearm[:, 0] + bones.turn * np.sin(turned) * forearm[:, 1]
    return frames_from(ways, np.tile(forearm[:, 2], (len(ways), 1)))


def curvature_of(kind: WingType, scale: float) -> float:
    """1/m, of all shafts of a wing."""
    longest = max(max(getattr(kind, name).lengths) for name in REMEX_ROWS)
    return math.radians(kind.camber) / (scale * longest)


def shut(kind: WingType) -> WingType:
    """The type as a wing shows it that stays folded: the hand under the secondaries, as nearly
    along its primaries as quills have room, and without what these hide."""
    turned = kind.outermost[1] - _HAND_ASIDE
    return replace(
        kind,
        innermost=(kind.innermost[0], kind.middle[1] - _PARALLEL),
        wrist=(kind.wrist[0], kind.wrist[1] - turned),
        outermost=(kind.outermost[0], _HAND_ASIDE),
        alula=replace(kind.alula, count=0),
        coverts=tuple(
            replace(row, hand=0.0, loose=row.chord_position >= _LOOSE, gap=_SHUT_GAP * row.gap)
            for row in kind.coverts
            if row.side == "above" and row.chord_position < _COATED
        ),
    )


def on_skin(kind: WingType) -> WingType:
    """The type as it lies on a wing that a skin has: without small coverts, which are a coat there,
    and with a row below that reaches the edge behind, as what is above does."""
    rows = [
        replace(row, loose=row.chord_position >= _LOOSE)
        for row in kind.coverts
        if row.chord_position < _COATED
    ]
    below = [k for k, row in enumerate(rows) if row.side == "below"]
    for k, length in zip(below, _BELOW, strict=False):
        rows[k] = replace(rows[k], length=length, hand=1.0)
    return replace(kind, coverts=tuple(rows), alula=replace(kind.alula, count=0))


def coated_rows(kind: WingType) -> list[CovertRow]:
    """The small coverts of a type that are a coat where its wing is shut."""
    return [row for row in kind.coverts if row.side == "above" and row.chord_position >= _COATED]


def lying(kind: WingType, bones: WingBones, scale: float, sheet: Sheet | None) -> Array:
    """(N, K, 3) m, of each feather of a folded wing of bones a point of the leading edge, then some
    along its shaft, from the innermost outwards. sheet: that it lies on; None: that of its type."""
    remiges = remiges_of(kind, bones, scale)
    sheet = sheet or sheet_of(kind, bones, remiges, scale)
    frames = frames_at(bones, remiges.angles)
    roots = remiges.roots - scale * kind.lift * depths(remiges)[:, None] * frames[:, :, 2]
    ways = np.column_stack([-remiges.forward, np.outer(remiges.lengths, _ALONG)])
    points = roots[:, None] + ways[:, :, None] * frames[:, None, :, 0]
    if sheet is None:
        return points
    plan = sheet.plan(points.reshape(-1, 3))
    laid, over = sheet.places(plan[:, :2])
    return np.asarray((laid + plan[:, 2:] * over[:, :, 2]).reshape(points.shape))


def plan_axes(bones: WingBones, remiges: Remiges, shafts: Array) -> Array:
    """(3, 3) columns along the shafts (N, 3) of a folded arm, across to its outer feathers, and
    dorsal."""
    arm = remiges.bone < 2
    dorsal, along = bones.frames[1][:, 2], shafts[arm].sum(axis=0)
    along = along / np.linalg.norm(along)
    across = bones.turn * np.cross(along, dorsal)
    return np.stack([along, across, dorsal], axis=1)


def sheet_of(kind: WingType, bones: WingBones, remiges: Remiges, scale: float) -> Sheet | None:
    """The sheet of a folded wing without a body; None for a flat one."""
    arm, curvature = remiges.bone < 2, curvature_of(kind, scale)
    if arm.sum() < 2 or (kind.bow == 0.0 and curvature == 0.0):
        return None
    shafts = frames_at(bones, remiges.angles)[:, :, 0]
    axes = plan_axes(bones, remiges, shafts)
    middles = (remiges.roots + 0.5 * remiges.lengths[:, None] * shafts)[arm]
    half = 0.5 * float((middles[-1] - middles[0]) @ axes[:, 1])
    origin = middles[0] + half * axes[:, 1]
    bend = 0.5 * max(math.radians(kind.bow), _FLATTEST) / half
    return Sheet(origin, axes, bend, half, curvature, np.zeros(3))


def depths(remiges: Remiges) -> Array:
    """(N,) how many feathers deeper than the innermost primary each lies."""
    return np.arange(len(remiges.rows), dtype=float) - sum(
        each != "primaries" for each in remiges.rows
    )
