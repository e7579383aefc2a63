"""The flight feathers of a wing: where they stand, which way they point, and how they bend."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from featherfx.algebra.types import Array, Indices
from featherfx.algebra.vectors import frames_from
from featherfx.groom.anatomy.pose import WingBones, spread_plan
from featherfx.groom.anatomy.sheet import Sheet
from featherfx.groom.keys.anatomy import CovertRow, WingType

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
