"""What is written of a frame, computed for all feathers of a cache at once.

Points, velocities, normals and barb directions of every feather stand one after the other in
flat arrays, so that a frame is a few calls of compiled code, which leave the interpreter to the
simulation meanwhile.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, fields, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from featherfx.feather.types import Surface
from featherfx.usd import surface_kernels
from featherfx.usd.barbs import BarbFrame, BarbSet
from featherfx.usd.space import StageSpace
from featherfx.usd.types import FeatherEntry

Array = NDArray[np.float64]
Floats = NDArray[np.float32]
Indices = NDArray[np.int64]

_ROUNDING = float(np.finfo(np.float32).eps)


@dataclass(frozen=True)
class SurfaceFrame:
    """One pose of all feathers, stage units and axes, as it is written (float32).

    points, normals, velocities: (V, 3) surface points. barb_direction: (T, 3).
    rachis_points, rachis_velocities: (R, 3). extent: (N, 2, 3) and rachis_extent: (N, 2, 3), the
    latter padded by half the width. Velocities in stage units per second. accelerations: (V, 3)
    and rachis_accelerations: (R, 3), stage units per second squared, None where not asked for.
    barbs: those drawn as curves.
    """

    points: Floats
    normals: Floats
    velocities: Floats
    barb_direction: Floats
    rachis_points: Floats
    rachis_velocities: Floats
    extent: Floats
    rachis_extent: Floats
    barbs: BarbFrame
    accelerations: Floats | None = None
    rachis_accelerations: Floats | None = None

    def corners(self) -> tuple[Floats, Floats]:
        """(3,) least and (3,) greatest corner of surfaces and barbs."""
        drawn = np.concatenate([self.extent, self.barbs.extent[self.barbs.extent.any(axis=(1, 2))]])
        return drawn[:, 0].min(axis=0), drawn[:, 1].max(axis=0)


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


class SurfaceSet:
    """The constant arrays of all feathers of a cache, and their evaluation.

    point_slices, face_slices, rachis_slices: where each feather stands in the flat arrays.
    widths: per feather (n,) stage units, diameter of the circle of the shaft's section area.
    rest: the rest pose.
    """

    def __init__(self, entries: Sequence[FeatherEntry], space: StageSpace) -> None:
        self._entries, self._space = tuple(entries), space
        surfaces = [entry.feather.surface for entry in entries]
        self.point_slices, self._point_starts = _slices([len(s.row) for s in surfaces])
        self.face_slices, _ = _slices([len(s.triangles) for s in surfaces])
        self.rachis_slices, self._rachis_starts = _slices([e.feather.rows for e in entries])
        offsets = self._point_starts
        self._triangles = _joined(s.triangles + o for s, o in zip(surfaces, offsets, strict=False))
        self._barb_edges = _joined(
            barb_edges(e.feather.surface, e.feather.surface.points(e.feather.points)) + offset
            for e, offset in zip(entries, offsets, strict=False)
        )
        sizes = [e.feather.points.shape[:2] for e in entries]
        _, nodes = _slices([n * size for n, size in sizes])
        self._terms = _joined(
            s.row[:, None] * size + s.terms + node
            for s, (_, size), node in zip(surfaces, sizes, nodes, strict=False)
        )
        self._weights = np.concatenate([s.weights for s in surfaces])
        self._shaft_nodes = _joined(
            np.arange(n) * size + node for (n, size), node in zip(sizes, nodes, strict=False)
        )
        sections = [np.sqrt(e.feather.width * e.feather.height) for e in entries]
        self.widths = [space.lengths(section) for section in sections]
        # The widest point pads all, as in USD's own computation of the extent of curves.
        self._half_width = np.array([0.5 * w.max() for w in self.widths], np.float32)
        self._scratch = np.zeros((2, len(self._terms), 3))
        self.barbs = BarbSet(entries, space)
        rest = np.concatenate([np.reshape(e.rest_points, (-1, 3)) for e in entries])
        self.rest = self._frame(rest, np.zeros_like(rest), self.barbs.rest)

    @property
    def bytes_per_sample(self) -> int:
        """Bytes of one pose of all feathers."""
        values = (getattr(self.rest, each.name) for each in fields(self.rest))
        surface = sum(value.nbytes for value in values if isinstance(value, np.ndarray))
        return surface + self.rest.barbs.bytes

    def evaluate(
        self,
        points: Sequence[Array],
        velocities: Sequence[Array],
        accelerations: Sequence[Array] = (),
    ) -> SurfaceFrame:
        """A pose from per-feather (n, P, 3) material points and rates; static feathers: at rest."""
        poses, rates = [], []
        for entry, given, rate in zip(self._entries, points, velocities, strict=True):
            rest = np.reshape(entry.rest_points, (-1, 3))
            poses.append(rest if entry.static else _drawn(entry, given))
            rates.append(np.zeros_like(rest) if entry.static else _drawn(entry, rate))
        barbs = self.barbs.evaluate(points, velocities, accelerations)
        frame = self._frame(np.concatenate(poses), np.concatenate(rates), barbs)
        return self._with_accelerations(frame, accelerations) if len(accelerations) else frame

    def _with_accelerations(self, frame: SurfaceFrame, given: Sequence[Array]) -> SurfaceFrame:
        pairs = zip(self._entries, given, strict=True)
        rates = np.concatenate([_drawn(entry, each) for entry, each in pairs])
        space, surface = self._space, np.empty_like(frame.velocities)
        quarter, scale = space.up_axis == "Y", 1.0 / space.meters_per_unit
        surface_kernels.combine(
            rates, self._terms, self._weights, scale, quarter, self._scratch[0], surface
        )
        shaft = space.positions(rates[self._shaft_nodes]).astype(np.float32)
        return replace(frame, accelerations=surface, rachis_accelerations=shaft)

    def _frame(self, material: Array, rates: Array, barbs: BarbFrame) -> SurfaceFrame:
        space, (world, scratch) = self._space, self._scratch
        quarter, scale = space.up_axis == "Y", 1.0 / space.meters_per_unit
        count = len(world)
        shaft = space.positions(material[self._shaft_nodes]).astype(np.float32)
        frame = SurfaceFrame(
            points=np.empty((count, 3), np.float32),
            normals=np.empty((count, 3), np.float32),
            velocities=np.empty((count, 3), np.float32),
            barb_direction=np.empty((len(self._barb_edges), 3), np.float32),
            rachis_points=shaft,
            rachis_velocities=space.positions(rates[self._shaft_nodes]).astype(np.float32),
            extent=np.empty((len(self._entries), 2, 3), np.float32),
            rachis_extent=np.empty((len(self._entries), 2, 3), np.float32),
            barbs=barbs,
        )
        kernels, weights = surface_kernels, self._weights
        kernels.combine(rates, self._terms, weights, scale, quarter, world, frame.velocities)
        kernels.combine(material, self._terms, weights, scale, quarter, world, frame.points)
        kernels.vertex_normals(world, self._triangles, quarter, scratch, frame.normals)
        kernels.edge_directions(world, self._barb_edges, quarter, frame.barb_direction)
        unpadded = np.zeros_like(self._half_width)
        kernels.extents(frame.points, self._point_starts, unpadded, frame.extent)
        kernels.extents(shaft, self._rachis_starts, self._half_width, frame.rachis_extent)
        return frame

    def changed(
        self, frame: SurfaceFrame, reference: SurfaceFrame, seconds: float
    ) -> NDArray[np.bool_]:
        """(N,) whether a feather, as written, differs from a reference pose, or is on its way.

        seconds: to the next sample. A velocity that until then carries no point farther than its
        rounding, at the feather's greatest coordinate, does not count.
        """
        slow = _ROUNDING * np.abs(frame.extent).max(axis=(1, 2)) / seconds
        result = np.zeros(len(self._entries), dtype=np.bool_)
        for name, starts in (("", self._point_starts), ("rachis_", self._rachis_starts)):
            points, rates = (getattr(frame, name + what) for what in ("points", "velocities"))
            before = getattr(reference, f"{name}points")
            surface_kernels.changed(points, rates, before, starts, slow, result)
        now, before = frame.barbs, reference.barbs.points
        starts = self.barbs.starts
        surface_kernels.changed(now.points, now.velocities, before, starts, slow, result)
        return result

    def not_finite(self, frame: SurfaceFrame) -> NDArray[np.bool_]:
        """(N,) whether a feather, as written, has a value that is not finite."""
        surface = ~(np.isfinite(frame.points) & np.isfinite(frame.velocities)).all(axis=1)
        return np.logical_or.reduceat(surface, self._point_starts[:-1])


def _drawn(entry: FeatherEntry, values: Array) -> Array:
    """(n P, 3) material points or rates of what is drawn, from those of a frame."""
    return np.reshape(entry.points_map(values) if entry.points_map else values, (-1, 3))


def _slices(counts: Sequence[int]) -> tuple[list[slice], Indices]:
    """Slices of runs that follow each other, and (N + 1,) where each starts."""
    starts = np.concatenate([[0], np.cumsum(counts)])
    return [slice(int(a), int(b)) for a, b in pairwise(starts)], starts


def _joined(parts: Iterable[Indices]) -> NDArray[np.int32]:
    """All parts in one array, as the 32-bit numbers that USD has for points, too."""
    return np.concatenate([part.astype(np.int32) for part in parts])
