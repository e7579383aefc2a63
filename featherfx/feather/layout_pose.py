"""Plumage as a layout moves it, and the skin beneath it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from featherfx.feather.height_map import HeightMaps, height_maps
from featherfx.feather.overlap import Strips
from featherfx.feather.scaled import repeated_shapes
from featherfx.groom.types import Placement

Array = NDArray[np.float64]
Indices = NDArray[np.int64]
Mask = NDArray[np.bool_]


@dataclass
class Pose:
    """F feathers as they are moved; arrays as in featherfx/feather/layout_kernels.py.

    grown: (F,) whether a feather may be shortened and dropped. kept: (F,) False once dropped.
    """

    maps: HeightMaps
    root: Array
    frame: Array
    moves: Array
    place: Array
    turned: Array
    size: Array
    shape: Indices
    grown: Mask
    kept: Mask
    placed_size: Array

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

    def put_back(self) -> None:
        """As placed, though as short as they are now."""
        self.moves[:] = 0.0
        self.place[:], self.turned[:] = self.root, self.frame

    def moved(self, strips: Strips) -> Strips:
        """Strips of the feathers as placed, moved and shortened as they are."""
        turn = self.turned @ self.frame.transpose(0, 2, 1)
        share = self.size / self.placed_size
        return replace(
            strips,
            root=self.place,
            shaft=share[:, None] * np.einsum("fij,fj->fi", turn, strips.shaft),
            dorsal=self.turned[:, :, 2],
            reach=share * strips.reach,
        )

    def heights(self, skin: Skin | None) -> Array:
        """(F,) m, least height over the skin; NaN without one."""
        if skin is None:
            return np.full(len(self.size), np.nan)
        heights = skin.gaps(self.world())
        unused = np.arange(heights.shape[1]) >= self.maps.used[self.shape][:, None]
        return np.asarray(np.where(unused, np.inf, heights).min(axis=1))

    def gaps(self, pairs: Indices) -> tuple[Array, Array]:
        """Gaps (K,) m of pairs, NaN where they are not over each other, and where they are least.

        The places (K, 4) m are x and y in the frame of the upper, then of the lower feather.
        """
        from featherfx.feather.layout_kernels import all_gaps

        gaps, places = np.full(len(pairs), np.nan), np.zeros((len(pairs), 4))
        all_gaps(pairs, *self.surfaces, gaps, places)
        return gaps, places


def pose_of(feathers: Sequence[Placement]) -> Pose:
    """Feathers as they are placed. Raises InputError for shapes that cannot be built."""
    first, shape = repeated_shapes(feathers)
    shapes = [(feathers[k].prototype or feathers[k].kind, feathers[k].mirrored) for k in first]
    frame = np.array([feather.rotation for feather in feathers])
    root = np.array([feather.position for feather in feathers])
    size = np.array([feather.kind.length for feather in feathers])
    return Pose(
        maps=height_maps(shapes),
        root=root,
        frame=frame,
        moves=np.zeros((len(feathers), 3)),
        place=root.copy(),
        turned=frame.copy(),
        size=size,
        shape=np.array(shape),
        grown=np.array([feather.grown for feather in feathers]),
        kept=np.ones(len(feathers), dtype=np.bool_),
        placed_size=size.copy(),
    )


class Skin:
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
