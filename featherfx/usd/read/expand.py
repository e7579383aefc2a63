"""Meshes and barbs of condensed feathers, at any density.

A condensed feather (featherfx/usd/write/forms.py) has the nodes that its mesh stands on, all or
half of the rows and columns with codes of the others (featherfx/feather/detail.py), and its shape.
At its own density the mesh is the one that a bake would have written, to single precision, or to
0.065 % of its length. Other densities, and barbs, are built from the shape. They follow the nodes
by the map that a bake draws finer meshes with (featherfx/feather/density.py).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from numbers import Integral
from pathlib import Path
from typing import Any

import numpy as np
import scipy
from pxr import Usd, UsdGeom

from featherfx.algebra.types import Array, Flags, Indices
from featherfx.algebra.vectors import quats_to_frames
from featherfx.errors import InputError, Problem, require, require_type
from featherfx.feather.barb_looks import (
    BARB_SEGMENTS,
    ExpandedShape,
    clumped,
    drawn_barbs,
    expand_shape,
)
from featherfx.feather.carry_kernels import keep_lengths
from featherfx.feather.colours import FeatherColours, colour_feather
from featherfx.feather.density import density_map
from featherfx.feather.detail import ThinnedGrid, choose_rows_and_nodes, restored
from featherfx.feather.shapes import decode_shape, scaled_map, scaled_points
from featherfx.feather.types import BarbCurves, RowPoints, scale_feather, stacked
from featherfx.groom.materials import BarbLook, colour_of
from featherfx.groom.types import FeatherKind, shading_of
from featherfx.limits import MAX_BARBS, MAX_CLUMPS, MAX_COLUMNS, MAX_ROWS
from featherfx.usd.read.cached_feather import (
    FeatherMember,
    parse_texts,
    read_members,
    single_member,
)
from featherfx.usd.read.stage import transform_points
from featherfx.usd.read.values import (
    DEFAULT_TIME,
    INTEGER_ARRAY,
    NUMBER_ARRAY,
    VECTOR_ARRAY,
    ArrayKind,
    describe_time,
    fault,
    open_stage,
    read_array,
    read_sized_array,
    read_times,
)
from featherfx.usd.types import (
    BARB_NODE_PRIMVARS,
    COLOUR_PRIMVAR,
    DETAIL_ATTRIBUTE,
    DETAIL_GRID_ATTRIBUTE,
    ORIENT_PRIMVAR,
    SHAPE_PRIMVAR,
    SHAPE_SIZE_PRIMVAR,
    WET_PRIMVARS,
    refuse_unfit_usd,
)

_ROTATIONS = ArrayKind("f", (4,), "an array of rotations")
_PAIRS = ArrayKind("i", (2,), "an array of pairs of integers")
# of a swan all at once takes 400 MB
_POINTS_AT_ONCE = 100_000


@dataclass(frozen=True)
class ExpandedFeather:
    """One feather of an expansion.

    points: its range among all points, and barbs: among all barbs. triangles: (T, 3) into its own
    points. side: (T,) 0 leading, 1 trailing, 2 rachis. st: (V, 2). barb_side: (B,) of its barbs.
    look: of these in images. barb_count: real ones along each vane.
    """

    id: str
    kind: str
    region: str
    points: slice
    triangles: Indices
    side: Indices
    st: Array
    barbs: slice
    barb_side: Indices
    look: BarbLook
    barb_count: int


def expand(
    stage: Any, *, rows: int | None = None, columns: int | None = None, barbs: int | None = None
) -> Expansion:
    """Return the condensed feathers of a stage, or of a file by its path, as meshes and barbs.

    rows, columns: of the meshes, at least 3 and 1; default: as written. barbs: along each vane;
    None: none. Raises InputError where the file cannot be opened, holds no condensed feathers of
    featherfx, or they are damaged; and for a density out of range.
    """
    require_type("stage", stage, str | Path | Usd.Stage, "a stage, or the path of a cache")
    for name, number in (("rows", rows), ("columns", columns), ("barbs", barbs)):
        require_type(name, number, Integral | None, "a whole number, or None")
    allowed = {"rows": (rows, 3, MAX_ROWS), "columns": (columns, 1, MAX_COLUMNS)}
    allowed["barbs"] = (barbs, 1, MAX_BARBS)
    problems = [
        Problem("expand", name, f"{value} is not allowed. Give {low} to {high}")
        for name, (value, low, high) in allowed.items()
        if value is not None and not low <= value <= high
    ]
    require(*problems)
    refuse_unfit_usd()
    opened = open_stage(stage) if isinstance(stage, str | Path) else stage
    return Expansion(opened, rows, columns, barbs or 0)


def condensed_prims(stage: Any) -> list[Any]:
    """Return the curves prims of a stage with condensed feathers of a bake."""
    return [
        prim
        for prim in Usd.PrimRange(stage.GetPseudoRoot(), Usd.TraverseInstanceProxies())
        if prim.IsA(UsdGeom.BasisCurves)
        and all(
            prim.HasAttribute(name)
            for name in (*BARB_NODE_PRIMVARS, ORIENT_PRIMVAR, f"primvars:{SHAPE_SIZE_PRIMVAR}")
        )
    ]


class Expansion:
    """Condensed feathers as one mesh of V points and one set of B barbs.

    feathers: each, in the order of the stage. frames: first and last time code.
    """

    def __init__(self, stage: Any, rows: int | None, columns: int | None, barbs: int) -> None:
        self._stage = stage
        self.frames = (stage.GetStartTimeCode(), stage.GetEndTimeCode())
        self._prims = [
            _CondensedPrim(prim, rows, columns, barbs) for prim in condensed_prims(stage)
        ]
        if not self._prims:
            name = stage.GetRootLayer().identifier
            raise InputError(Problem(name, "", "holds no condensed feathers (bake --as condensed)"))
        self.feathers: tuple[ExpandedFeather, ...] = tuple(self._counted())

    def _counted(self) -> Iterator[ExpandedFeather]:
        points = barbs = 0
        for rachises in self._prims:
            for each in rachises.feathers:
                yield replace(
                    each,
                    points=slice(points + each.points.start, points + each.points.stop),
                    barbs=slice(barbs + each.barbs.start, barbs + each.barbs.stop),
                )
            points, barbs = points + rachises.point_count, barbs + rachises.barb_count

    @cached_property
    def triangles(self) -> Indices:
        """Return (T, 3) of all feathers, into all points."""
        return np.concatenate([each.triangles + each.points.start for each in self.feathers])

    @property
    def path(self) -> str:
        """Return the path of the first prim."""
        return str(self._prims[0].prim.GetPath())

    @cached_property
    def colours(self) -> tuple[FeatherColours, ...] | None:
        """Return linear colours of each feather's points, rachis and barbs, and its SHADING."""
        if not all(each.is_coloured for each in self._prims):
            return None
        shading = shading_of(kind for each in self._prims for kind in each.kinds)
        return tuple(found for each in self._prims for found in each.colours(shading))

    def codes(self) -> list[float]:
        """Return time codes at which any of the feathers has samples."""
        return sorted({code for each in self._prims for code in each.codes()})

    def points(self, time: float | Usd.TimeCode | None = None) -> Array:
        """Return (V, 3) points of all meshes at a time code, None: at rest; stage units, world."""
        return np.concatenate([each.points(_code(time)) for each in self._prims])

    def barbs(self, time: float | Usd.TimeCode | None = None) -> Array:
        """Return (B, K, 3) points of all barbs, root to end, as `points`; in clumps where wet."""
        return np.concatenate([each.barbs(_code(time)) for each in self._prims])

    @cached_property
    def is_wet(self) -> bool:
        """Return whether barbs of any feather form clumps at times."""
        return any(each.is_wet for each in self._prims)

    def clumped(self, time: float | Usd.TimeCode | None = None) -> Array:
        """Return (N, 2) how far water draws the ends of barbs together, and into how many clumps.

        The former is 0 to 1, the latter counted along a vane.
        """
        return np.concatenate([each.clumped(_code(time)) for each in self._prims])


def _code(time: float | Usd.TimeCode | None) -> Any:
    return DEFAULT_TIME if time is None else Usd.TimeCode(time)


@dataclass(frozen=True)
class _ThinnedFeathers:
    """Feathers of a prim that have one grid.

    members: their numbers. rest, and lengths of their rachises: in stage units.
    """

    members: Indices
    rest: RowPoints
    lengths: Array
    thin: ThinnedGrid


class _CondensedPrim:
    """Feathers of one curves prim."""

    def __init__(self, prim: Any, rows: int | None, columns: int | None, barbs: int) -> None:
        self.prim = prim
        self._curves = UsdGeom.BasisCurves(prim)
        counts = self._array("curveVertexCounts", DEFAULT_TIME, INTEGER_ARRAY).astype(np.int64)
        element = UsdGeom.PrimvarsAPI(prim).GetPrimvar(BARB_NODE_PRIMVARS[0]).GetElementSize()
        self._starts, self._columns = np.concatenate([[0], np.cumsum(counts)]), element
        self._grids_written = self._written_grids(counts)
        rows_written = self._grids_written[:, 0]
        members = read_members(prim) or [single_member(prim)]
        if len(members) != len(counts):
            raise self._fault("curveVertexCounts", f"tell of {len(counts)}, {len(members)} named")
        shapes = parse_texts(prim, SHAPE_PRIMVAR, decode_shape, len(counts))
        self.kinds = self._coloured([kind for kind, _ in shapes])
        self._looks = [kind.drawn_look for kind, _ in shapes]
        sizes = self._shaped(
            f"primvars:{SHAPE_SIZE_PRIMVAR}", DEFAULT_TIME, NUMBER_ARRAY, counts.shape
        )
        self._counts = [
            kind.count_barbs(float(size)) for (kind, _), size in zip(shapes, sizes, strict=True)
        ]
        # of the values of this prim, which are in the units of its stage
        scales = sizes.astype(float) / UsdGeom.GetStageMetersPerUnit(prim.GetStage())
        grown = [
            expand_shape(shape, (n, m), (rows or n, columns or m))
            for shape, (n, m) in zip(shapes, self._grids_written.tolist(), strict=True)
        ]
        self._thinned = list(self._thinnings(counts, grown, scales)) if self._has_detail else []
        self._drawn, self._scales = [each.fine for each in grown], scales
        self._surfaces = [each.surface for each in self._drawn]
        self._grids = [(each.rows, 1 + 2 * each.columns) for each in self._drawn]
        self._map = None
        if any(each.to_fine is not None for each in grown):
            maps = [
                scaled_map(each.to_fine or density_map(each.fine, each.fine), float(s), int(n))
                for each, s, n in zip(grown, scales, rows_written, strict=True)
            ]
            joined = [
                scipy.sparse.vstack([part.matrix.of_scipy(part.width) for part in each[:2]])
                for each in maps
            ]
            self._pieces = np.concatenate([each.pieces for each in maps])
            self._map = scipy.sparse.block_diag(joined, format="csr")
        self._barb_sides, self._to_barbs = [np.zeros(0, dtype=np.int64)] * len(counts), None
        self._barbs: list[BarbCurves] = []
        if barbs:
            self._barbs = curves = [
                drawn_barbs(kind, (n, m), barbs, mirrored, member.id)
                for (kind, mirrored), (n, m), member in zip(
                    shapes, self._grids_written.tolist(), members, strict=True
                )
            ]
            self._barb_sides = [each.side for each in curves]
            parts = [
                scaled_points(each.points_map, float(s), int(n)).matrix.of_scipy(
                    each.points_map.width
                )
                for each, s, n in zip(curves, scales, rows_written, strict=True)
            ]
            self._to_barbs = scipy.sparse.block_diag(parts, format="csr")
        self.feathers = list(self._told(members))
        self.point_count = sum(len(each.row) for each in self._surfaces)
        self.barb_count = sum(map(len, self._barb_sides))
        starts = np.cumsum([0, *(rows for rows, _ in self._grids[:-1])])
        row = [each.row + start for each, start in zip(self._surfaces, starts, strict=True)]
        self._row = np.concatenate(row)
        self._node = np.concatenate([each.node for each in self._surfaces])
        offset = [each.offset * s for each, s in zip(self._surfaces, scales, strict=True)]
        self._offset = np.concatenate(offset)

    def _written_grids(self, counts: Indices) -> Indices:
        """Return (M, 2) rows and columns of the coded grid of each feather."""
        some = np.stack([counts, np.full_like(counts, self._columns)], axis=1)
        self._has_detail = self.prim.HasAttribute(DETAIL_ATTRIBUTE)
        if not self._has_detail:
            return some
        grids = self._shaped(DETAIL_GRID_ATTRIBUTE, DEFAULT_TIME, _PAIRS, some.shape).astype(
            np.int64
        )
        if (grids < some).any() or (grids > (MAX_ROWS, MAX_COLUMNS)).any() or (some < (3, 1)).any():
            raise self._fault(
                DETAIL_GRID_ATTRIBUTE, "is not of more rows and columns than the curves have"
            )
        return grids

    def _thinnings(
        self, counts: Indices, grown: Sequence[ExpandedShape], scales: Array
    ) -> Iterator[_ThinnedFeathers]:
        """Yield feathers of one grid and one thinning together."""
        alike: dict[tuple[int, ...], list[int]] = {}
        for k, key in enumerate(np.column_stack([counts, self._grids_written]).tolist()):
            alike.setdefault(tuple(key), []).append(k)
        for (some, rows, columns), own in alike.items():
            shapes = stacked([grown[k].own.rest for k in own])
            rest = RowPoints(shapes.nodes * scales[own, None, None, None], shapes.directors)
            lengths = scales[own] * [grown[k].own.station[-1] for k in own]
            thin = choose_rows_and_nodes(rows, columns, (some, self._columns))
            yield _ThinnedFeathers(np.array(own), rest, lengths, thin)

    def _coloured(self, kinds: list[FeatherKind]) -> list[FeatherKind]:
        """Return kinds of each feather with its colours, where they are stored."""
        self.is_coloured = self.prim.HasAttribute(f"primvars:{COLOUR_PRIMVAR}")
        if not self.is_coloured:
            return kinds
        colours = parse_texts(self.prim, COLOUR_PRIMVAR, colour_of, len(kinds))
        return [replace(kind, colour=own) for kind, own in zip(kinds, colours, strict=True)]

    def colours(self, shading: Sequence[str]) -> Iterator[FeatherColours]:
        """Yield colours of each feather. shading: names of SHADING that are wanted."""
        barbs: Sequence[BarbCurves | None] = self._barbs or [None] * len(self.feathers)
        for kind, unit, scale, own, each in zip(
            self.kinds, self._drawn, self._scales, barbs, self.feathers, strict=True
        ):
            yield colour_feather(kind, scale_feather(unit, float(scale)), own, each.id, shading)

    def codes(self) -> list[float]:
        return read_times(self._curves.GetPointsAttr())

    def points(self, code: Any) -> Array:
        nodes, directors = self._pose(code)
        if self._map is not None:
            flat = self._map @ self._flat(nodes, directors)
            nodes, directors = self._split(flat)
            keep_lengths(self._pieces, nodes, np.zeros_like(nodes), np.zeros_like(nodes))
        points = np.empty((self.point_count, 3))
        for start in range(0, len(points), _POINTS_AT_ONCE):
            own = slice(start, start + _POINTS_AT_ONCE)
            row = self._row[own]
            along, up = (self._offset[own, k, None] * directors[row, k] for k in range(2))
            points[own] = nodes[row, self._node[own]] + along + up
        return self._placed(points, code)

    def barbs(self, code: Any) -> Array:
        if self._to_barbs is None:
            return np.zeros((0, BARB_SEGMENTS + 1, 3))
        curves = self._to_barbs @ self._flat(*self._pose(code))
        if self.is_wet:
            ends = np.cumsum([each.widths.size for each in self._barbs])
            each = zip(self._barbs, np.split(curves, ends[:-1]), self.clumped(code), strict=True)
            curves = np.concatenate(
                [clumped(drawn, own, float(amount), int(n)) for drawn, own, (amount, n) in each]
            )
        return self._placed(curves, code).reshape(-1, BARB_SEGMENTS + 1, 3)

    @property
    def is_wet(self) -> bool:
        return all(self.prim.HasAttribute(name) for name in WET_PRIMVARS)

    def clumped(self, code: Any) -> Array:
        shape = (len(self._counts),)
        if not self.is_wet:
            return np.zeros((*shape, 2))
        amount, clumps = (
            self._shaped(name, code, NUMBER_ARRAY, shape).astype(float) for name in WET_PRIMVARS
        )
        mosts = (1.0, MAX_CLUMPS)
        for values, name, most in zip((amount, clumps), WET_PRIMVARS, mosts, strict=True):
            if not ((values >= 0.0) & (values <= most)).all():
                raise self._fault(name, f"holds values beyond 0 to {most:g} {describe_time(code)}")
        return np.stack([amount, clumps], axis=1)

    def _placed(self, points: Array, code: Any) -> Array:
        matrix = np.array(self._curves.ComputeLocalToWorldTransform(code))
        return transform_points(points, matrix)

    def _pose(self, code: Any) -> RowPoints:
        """Return nodes, leading first, and directors of all rows, feather after feather."""
        rachis = self._array("points", code, VECTOR_ARRAY).astype(float)
        if len(rachis) != self._starts[-1]:
            raise self._fault(
                "points", f"are {len(rachis)}, not {self._starts[-1]}, {describe_time(code)}"
            )
        shape = (len(rachis), self._columns, 3)
        left, right = (self._shaped(name, code, VECTOR_ARRAY, shape) for name in BARB_NODE_PRIMVARS)
        swapped = self._leading_is_right[:, None, None]
        leading, trailing = np.where(swapped, right, left), np.where(swapped, left, right)
        turns = self._shaped(ORIENT_PRIMVAR, code, _ROTATIONS, (len(rachis), 4)).astype(float)
        turns = np.roll(turns, 1, axis=1)
        frames = quats_to_frames(turns / np.linalg.norm(turns, axis=1, keepdims=True))
        nodes = np.concatenate([rachis[:, None], leading, trailing], axis=1)
        kept = RowPoints(nodes, np.stack([frames[..., 1], frames[..., 2]], axis=1))
        return self._whole(kept, code) if self._has_detail else kept

    def _whole(self, kept: RowPoints, code: Any) -> RowPoints:
        """Return all nodes and directors of all rows, from the kept ones."""
        rows, wide = self._grids_written[:, 0], 1 + 2 * self._grids_written[:, 1]
        sizes, counts = rows * wide * 3, np.diff(self._starts)
        detail = self._shaped(DETAIL_ATTRIBUTE, code, INTEGER_ARRAY, (int(sizes.sum()),))
        nodes = np.empty((int(rows.sum()), int(wide.max(initial=1)), 3))
        whole = RowPoints(nodes, np.empty((len(nodes), 2, 3)))
        for own in self._thinned:
            mine = np.zeros(len(sizes), dtype=np.bool_)
            mine[own.members] = True
            few, number = np.repeat(mine, counts), len(own.members)
            some = RowPoints(*(p[few].reshape(number, -1, *p.shape[1:]) for p in kept))
            steps = detail[np.repeat(mine, sizes)]
            steps = steps.reshape(number, 3, *own.rest.nodes.shape[1:3])
            found = restored(some, own.rest, own.lengths, steps, own.thin)
            for part, values in zip(whole, found, strict=True):
                part[np.repeat(mine, rows)] = values.reshape(-1, *part.shape[1:])
        return whole

    @cached_property
    def _leading_is_right(self) -> Flags:
        """Return (N,) of the feather of each row."""
        counts = np.diff(self._starts)
        flags = self._shaped("primvars:leadingIsRight", DEFAULT_TIME, INTEGER_ARRAY, (len(counts),))
        return np.repeat(flags.astype(np.bool_), counts)

    def _flat(self, nodes: Array, directors: Array) -> Array:
        """Return all nodes and directors as the maps take them, feather after feather."""
        starts = np.concatenate([[0], np.cumsum(self._grids_written[:, 0])])
        each = (RowPoints(nodes[a:b], directors[a:b]) for a, b in pairwise(starts))
        return np.concatenate([part.reshape(-1, 3) for points in each for part in points])

    def _split(self, flat: Array) -> tuple[Array, Array]:
        nodes, directors, start = [], [], 0
        for rows, size in self._grids:
            middle, end = start + rows * size, start + rows * (size + 2)
            nodes.append(flat[start:middle].reshape(rows, size, 3))
            directors.append(flat[middle:end].reshape(rows, 2, 3))
            start = end
        return np.concatenate(nodes), np.concatenate(directors)

    def _told(self, members: Sequence[FeatherMember]) -> Iterator[ExpandedFeather]:
        points = barbs = 0
        for k, (member, surface) in enumerate(zip(members, self._surfaces, strict=True)):
            side = self._barb_sides[k]
            yield ExpandedFeather(
                id=member.id,
                kind=member.kind,
                region=member.region,
                points=slice(points, points + len(surface.row)),
                triangles=surface.triangles,
                side=surface.part,
                st=surface.st,
                barbs=slice(barbs, barbs + len(side)),
                barb_side=side,
                look=self._looks[k],
                barb_count=self._counts[k],
            )
            points, barbs = points + len(surface.row), barbs + len(side)

    def _array(self, name: str, code: Any, kind: ArrayKind) -> Any:
        return read_sized_array(self.prim.GetAttribute(name), code, kind)

    def _shaped(self, name: str, code: Any, kind: ArrayKind, shape: tuple[int, ...]) -> Any:
        found = read_array(self.prim.GetAttribute(name), code, kind)
        if found is None or found.size != np.prod(shape):
            told = (
                "has no value" if found is None else f"holds {len(found)} values, too many or few"
            )
            raise self._fault(name, f"{told} {describe_time(code)}")
        return found.reshape(shape)

    def _fault(self, name: str, told: str) -> InputError:
        return fault(self.prim.GetAttribute(name), told)
