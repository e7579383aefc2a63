"""What is written of a frame, computed for all feathers of a cache at once.

Points, velocities, normals and barb directions of every feather stand one after the other in
flat arrays, so that a frame costs a few numpy calls and not a few hundred per feather.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from featherfx.feather.types import Surface
from featherfx.usd.space import StageSpace
from featherfx.usd.types import FeatherEntry

Array = NDArray[np.float64]
Floats = NDArray[np.float32]
Indices = NDArray[np.int64]


@dataclass(frozen=True)
class SurfaceFrame:
    """One pose of all feathers, stage units and axes, as it is written (float32).

    points, normals, velocities: (V, 3) surface points. barb_direction: (T, 3).
    rachis_points, rachis_velocities: (R, 3). extent: (N, 2, 3) and rachis_extent: (N, 2, 3), the
    latter padded by half the width. Velocities in stage units per second.
    """

    points: Floats
    normals: Floats
    velocities: Floats
    barb_direction: Floats
    rachis_points: Floats
    rachis_velocities: Floats
    extent: Floats
    rachis_extent: Floats


def barb_edges(surface: Surface, points: Array) -> Indices:
    """(T, 2) the edge of each triangle that runs along its barb, directed as barb_direction.

    points: (V, 3) surface points at rest, feather frame.
    """
    starts, ends = surface.triangles, np.roll(surface.triangles, -1, axis=1)
    along = points[ends] - points[starts]
    length = np.linalg.norm(along, axis=2)
    cosine = np.einsum("tec,tc->te", along, surface.barb_direction) / np.maximum(length, 1e-300)
    triangle = np.arange(len(cosine))
    edge = np.argmax(np.abs(cosine), axis=1)
    pair = np.stack([starts[triangle, edge], ends[triangle, edge]], axis=1)
    return np.where((cosine[triangle, edge] < 0)[:, None], pair[:, ::-1], pair)


def _normalised(vectors: Array, fallback: Array) -> Array:
    length = np.linalg.norm(vectors, axis=-1, keepdims=True)
    safe = np.where(length > 0, length, 1.0)
    return np.where(length > 0, vectors / safe, fallback)


class SurfaceSet:
    """The constant arrays of all feathers of a cache, and their evaluation.

    point_slices, face_slices, rachis_slices: where each feather stands in the flat arrays.
    widths: per feather (n,) stage units, diameter of the circle of the shaft's section area.
    rest: the rest pose.
    """

    def __init__(self, entries: Sequence[FeatherEntry], space: StageSpace) -> None:
        from scipy.sparse import csr_array

        self._entries, self._space = tuple(entries), space
        surfaces = [entry.feather.surface for entry in entries]
        self.point_slices, self._point_starts = _slices([len(s.row) for s in surfaces])
        self.face_slices, _ = _slices([len(s.triangles) for s in surfaces])
        self.rachis_slices, self._rachis_starts = _slices([e.feather.rows for e in entries])
        offsets = [s.start for s in self.point_slices]
        self._triangles = np.concatenate(
            [s.triangles + offset for s, offset in zip(surfaces, offsets, strict=True)]
        )
        self._barb_edges = np.concatenate(
            [
                barb_edges(e.feather.surface, e.feather.surface.points(e.feather.points)) + offset
                for e, offset in zip(entries, offsets, strict=True)
            ]
        )
        faces, total = len(self._triangles), self.point_slices[-1].stop
        columns = np.repeat(np.arange(faces), 3)
        entries_of_ones = (np.ones(3 * faces), (self._triangles.ravel(), columns))
        self._faces_of_point = csr_array(entries_of_ones, shape=(total, faces))
        sections = [np.sqrt(e.feather.width * e.feather.height) for e in entries]
        self.widths = [space.lengths(section) for section in sections]
        # The widest point pads all, as in USD's own computation of the extent of curves.
        self._half_width = np.array([0.5 * w.max() for w in self.widths], np.float32)[:, None]
        points = [np.asarray(e.rest_points) for e in entries]
        self.rest = self.evaluate(points, [np.zeros_like(p) for p in points])

    def evaluate(self, points: Sequence[Array], velocities: Sequence[Array]) -> SurfaceFrame:
        """A pose from per-feather (n, P, 3) material points and rates; static feathers: at rest."""
        positions, rates, shafts, shaft_rates = [], [], [], []
        for entry, given, rate in zip(self._entries, points, velocities, strict=True):
            pose = entry.rest_points if entry.static else given
            motion = np.zeros_like(pose) if entry.static else rate
            positions.append(entry.feather.surface.points(pose))
            rates.append(entry.feather.surface.points(motion))
            shafts.append(pose[:, 0])
            shaft_rates.append(motion[:, 0])
        return self._frame(*(np.concatenate(a) for a in (positions, rates, shafts, shaft_rates)))

    def _frame(
        self, points: Array, rates: Array, shafts: Array, shaft_rates: Array
    ) -> SurfaceFrame:
        a, b, c = (points[self._triangles[:, k]] for k in range(3))
        # Area-weighted; a point without faces (calamus) is given the up axis, a unit vector.
        summed = self._faces_of_point @ np.cross(b - a, c - a)
        tail, head = self._barb_edges.T
        turned = self._space.directions
        moved = self._space.positions
        written = moved(points).astype(np.float32)
        shaft = moved(shafts).astype(np.float32)
        return SurfaceFrame(
            points=written,
            normals=turned(_normalised(summed, np.array([0.0, 0.0, 1.0]))).astype(np.float32),
            velocities=moved(rates).astype(np.float32),
            barb_direction=turned(
                _normalised(points[head] - points[tail], np.array([1.0, 0.0, 0.0]))
            ).astype(np.float32),
            rachis_points=shaft,
            rachis_velocities=moved(shaft_rates).astype(np.float32),
            extent=_extents(written, self._point_starts),
            rachis_extent=_extents(shaft, self._rachis_starts, self._half_width),
        )

    def moved(self, frame: SurfaceFrame) -> NDArray[np.bool_]:
        """(N,) whether a feather, as written, differs from its rest pose or has a velocity."""
        surface = (frame.points != self.rest.points) | (frame.velocities != 0)
        shaft = (frame.rachis_points != self.rest.rachis_points) | (frame.rachis_velocities != 0)
        return np.logical_or.reduceat(
            surface.any(axis=1), self._point_starts
        ) | np.logical_or.reduceat(shaft.any(axis=1), self._rachis_starts)

    def not_finite(self, frame: SurfaceFrame) -> NDArray[np.bool_]:
        """(N,) whether a feather, as written, has a value that is not finite."""
        surface = ~(np.isfinite(frame.points) & np.isfinite(frame.velocities)).all(axis=1)
        return np.logical_or.reduceat(surface, self._point_starts)


def _slices(counts: Sequence[int]) -> tuple[list[slice], Indices]:
    ends = np.cumsum(counts)
    starts = ends - np.asarray(counts)
    return [slice(int(a), int(b)) for a, b in zip(starts, ends, strict=True)], starts


def _extents(points: Floats, starts: Indices, padding: Floats | float = 0.0) -> Floats:
    """(N, 2, 3) least and greatest corner of each feather."""
    low = np.minimum.reduceat(points, starts, axis=0) - padding
    return np.stack([low, np.maximum.reduceat(points, starts, axis=0) + padding], axis=1)
