"""The bones of a wing: where they are spread, folded and as landmarks have them.

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

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from featherfx.algebra.types import Array
from featherfx.algebra.vectors import frames_from, from_rotation_vector, rotation_vectors
from featherfx.groom.keys.anatomy import WingBand, WingType
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
