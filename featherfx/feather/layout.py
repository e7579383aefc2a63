"""The layout of plumage at rest: feathers over each other like shingles, and over the skin.

Feathers are raised and rolled about their roots, and lifted a little, until they clear the skin and
each other by the layout's clearance (featherfx/feather/layout_kernels.py), those beneath first.
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from featherfx.errors import InputWarning
from featherfx.feather.height_map import HeightMaps, height_maps
from featherfx.feather.overlap import shingle_pairs, strips_of
from featherfx.feather.scaled import repeated_shapes
from featherfx.groom.types import Groom, Layout, Placement

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

_MOST_SWEEPS = 30
_SWEEPS_PER_SEARCH = 10  # after which the skin's tangent planes are looked up again
_SETTLED = 0.05  # share of the clearance that may be lacking


@dataclass(frozen=True)
class Penetration:
    """Two feathers that pass through each other, or a feather and the skin (lower "")."""

    upper: str
    lower: str
    depth: float


@dataclass(frozen=True)
class LayoutReport:
    """What a layout came to.

    pairs: (K, 2) numbers of feathers that lie over each other, the upper one first. gaps: (K,) m,
    the least distance of each pair; negative where they pass through each other. skin_gaps: (F,) m,
    least height over the skin, NaN without one. raised, rolled: (F,) deg, and lifted: (F,) m.
    unresolved: all that is left, the worst first.
    """

    pairs: Indices
    gaps: Array
    skin_gaps: Array
    raised: Array
    rolled: Array
    lifted: Array
    unresolved: tuple[Penetration, ...]


@dataclass
class _Pose:
    """F feathers as they are moved; arrays as in featherfx/feather/layout_kernels.py."""

    maps: HeightMaps
    root: Array
    frame: Array
    moves: Array
    place: Array
    turned: Array
    size: Array
    shape: Indices

    @property
    def shapes(self) -> tuple[Any, ...]:
        """What the kernels take after the roots."""
        return self.size, self.shape, self.maps.samples, self.maps.used

    @property
    def surfaces(self) -> tuple[Any, ...]:
        """All that a gap depends on, and scratch."""
        maps = (self.maps.heights, self.maps.window)
        return (self.place, self.turned, *self.shapes, *maps, np.zeros((3, 4)), np.zeros(4))

    def world(self) -> Array:
        """(F, Q, 3) m, the samples."""
        samples = self.maps.samples[self.shape] * self.size[:, None, None]
        return self.place[:, None] + np.einsum("fij,fqj->fqi", self.turned, samples)


def lay_out(groom: Groom) -> Groom:
    """The groom with its feathers laid over each other, where it asks for that.

    Gives one InputWarning where feathers are left that pass through each other or the skin. Raises
    InputError for shapes that cannot be built.
    """
    result, report = laid_out(groom)
    if report is not None and report.unresolved:
        worst = report.unresolved[0]
        over = f"'{worst.lower}'" if worst.lower else "the skin"
        warnings.warn(
            f"{groom.source}: layout: {len(report.unresolved)} of {len(report.pairs)} pairs of "
            f"feathers still pass through each other or the skin; the worst is '{worst.upper}', "
            f"{1e3 * worst.depth:.2g} mm below {over}",
            InputWarning,
            stacklevel=2,
        )
    return result


def laid_out(groom: Groom) -> tuple[Groom, LayoutReport | None]:
    """The groom with its feathers laid over each other, and how far that went.

    Unchanged, without a report, where the groom asks for no layout. Raises InputError for shapes
    that cannot be built.
    """
    if groom.layout is None or not groom.feathers:
        return groom, None
    skin = None if groom.skin is None else _Skin(groom.skin)
    pose, (pairs, order) = _pose(groom.feathers), shingle_pairs(strips_of(groom.feathers))
    _settle(pose, pairs, order, skin, groom.layout)
    rank = np.empty(len(order), dtype=np.int64)
    rank[order] = np.arange(len(order))
    feathers = tuple(
        replace(
            feather,
            position=pose.place[k].copy(),
            rotation=pose.turned[k].copy(),
            rank=int(rank[k]),
        )
        for k, feather in enumerate(groom.feathers)
    )
    return replace(groom, feathers=feathers), _report(groom, pose, pairs, skin)


def measured(groom: Groom) -> LayoutReport:
    """What lies over what in a groom as it is, without any change to it."""
    skin = None if groom.skin is None else _Skin(groom.skin)
    pairs, _ = shingle_pairs(strips_of(groom.feathers))
    return _report(groom, _pose(groom.feathers), pairs, skin)


def cover(groom: Groom) -> float:
    """Mean number of feathers over a point of a vane, itself included."""
    from featherfx.feather.layout_kernels import count_cover

    pose, (pairs, _) = _pose(groom.feathers), shingle_pairs(strips_of(groom.feathers))
    counts = np.zeros((len(groom.feathers), pose.maps.samples.shape[1]), dtype=np.int64)
    count_cover(pairs, *pose.surfaces, counts)
    inner = pose.maps.inner[pose.shape]
    within = np.arange(counts.shape[1]) < inner[:, None]
    return 1.0 + float(counts[within].sum() / inner.sum())


def _settle(
    pose: _Pose, pairs: Indices, order: Indices, skin: _Skin | None, layout: Layout
) -> None:
    from featherfx.feather.layout_kernels import sweep

    starts = np.searchsorted(pairs[:, 0], np.arange(len(order) + 1))
    turn = np.radians(layout.most_tilt)
    least = np.array([-0.5 * turn, -turn, 0.0])
    most = np.array([turn, turn, layout.most_lift])
    planes = np.zeros((0, 1, 4))
    travel, room = np.zeros(len(order)), np.full((len(pairs), 2), -1.0)
    for number in range(_MOST_SWEEPS):
        if skin is not None and number % _SWEEPS_PER_SEARCH == 0:
            planes = skin.planes(pose.world())
        place, turned, *shapes, relation, worst = pose.surfaces
        lack = sweep(
            order, starts, pairs, layout.clearance, pose.root, pose.frame, pose.moves, least,
            most, place, turned, *shapes, planes, relation, worst, travel, room,
        )  # fmt: skip
        if lack < _SETTLED * layout.clearance:
            break


def _pose(feathers: Sequence[Placement]) -> _Pose:
    first, shape = repeated_shapes(feathers)
    shapes = [(feathers[k].prototype or feathers[k].kind, feathers[k].mirrored) for k in first]
    frame = np.array([feather.rotation for feather in feathers])
    root = np.array([feather.position for feather in feathers])
    return _Pose(
        maps=height_maps(shapes),
        root=root,
        frame=frame,
        moves=np.zeros((len(feathers), 3)),
        place=root.copy(),
        turned=frame.copy(),
        size=np.array([feather.kind.length for feather in feathers]),
        shape=np.array(shape),
    )


class _Skin:
    """Tangent planes of a skin: those of the nearest triangle's middle."""

    def __init__(self, corners: Array) -> None:
        from scipy.spatial import cKDTree

        normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-300)
        centres = corners.mean(axis=1)
        offsets = np.einsum("tc,tc->t", centres, normals)
        self._planes = np.concatenate([normals, offsets[:, None]], axis=1)
        self._tree = cKDTree(centres)

    def planes(self, points: Array) -> Array:
        """(..., 4) unit normal and offset, m, near points (..., 3)."""
        _, near = self._tree.query(points.reshape(-1, 3), workers=-1)
        return self._planes[near].reshape(*points.shape[:-1], 4)

    def gaps(self, points: Array) -> Array:
        """(...) m, heights of points (..., 3) over the skin; negative inside."""
        planes = self.planes(points)
        return np.asarray(np.einsum("...c,...c->...", points, planes[..., :3]) - planes[..., 3])


def _report(groom: Groom, pose: _Pose, pairs: Indices, skin: _Skin | None) -> LayoutReport:
    from featherfx.feather.layout_kernels import all_gaps

    gaps = np.full(len(pairs), np.nan)
    all_gaps(pairs, *pose.surfaces, gaps)
    over = ~np.isnan(gaps)
    pairs, gaps = pairs[over], gaps[over]
    skin_gaps = np.full(len(groom.feathers), np.nan)
    if skin is not None:
        heights = skin.gaps(pose.world())
        unused = np.arange(heights.shape[1]) >= pose.maps.used[pose.shape][:, None]
        skin_gaps = np.where(unused, np.inf, heights).min(axis=1)
    ids = [feather.id for feather in groom.feathers]
    left = [
        Penetration(ids[pairs[k, 0]], ids[pairs[k, 1]], float(-gaps[k]))
        for k in np.flatnonzero(gaps < 0.0)
    ]
    left += [Penetration(ids[k], "", float(-skin_gaps[k])) for k in np.flatnonzero(skin_gaps < 0.0)]
    return LayoutReport(
        pairs=pairs,
        gaps=gaps,
        skin_gaps=skin_gaps,
        raised=np.degrees(pose.moves[:, 0]),
        rolled=np.degrees(pose.moves[:, 1]),
        lifted=pose.moves[:, 2],
        unresolved=tuple(sorted(left, key=lambda each: (-each.depth, each.upper, each.lower))),
    )
