"""Meshes and barbs from condensed feathers, at any density.

A condensed feather (featherfx/usd/write/forms.py) has the nodes that its mesh stands on, so at its
own density the mesh is the one that a bake would have written, to single precision. At others rows
are interpolated along the shaft, and barbs between rows, by the map that a bake draws finer
meshes with (featherfx/feather/density.py); what lies between rows of the outline is interpolated,
too, since a cache does not hold it.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pxr import Usd, UsdGeom
from scipy import sparse

from featherfx.algebra.rotation import quats_to_frames
from featherfx.errors import InputError, Problem
from featherfx.feather.density import density_map, hermite_weights
from featherfx.feather.rachis import Rachis, row_stations
from featherfx.feather.render import BARB_SEGMENTS
from featherfx.feather.surface import build_surface
from featherfx.feather.types import (
    LEADING,
    TRAILING,
    Array,
    Feather,
    Indices,
    RowPoints,
    barb_slice,
)
from featherfx.limits import MOST_BARBS, MOST_COLUMNS, MOST_ROWS
from featherfx.usd.installed import refuse_unfit_usd
from featherfx.usd.read.members import Member, members_of
from featherfx.usd.read.opening import open_stage
from featherfx.usd.read.values import (
    DEFAULT,
    INTEGERS,
    NUMBERS,
    PAIRS,
    VECTORS,
    Kind,
    array_of,
    at,
    fault,
    sized_array,
    text_of,
    times_of,
)
from featherfx.usd.types import ORIENT, P_BARB

_ROTATIONS = Kind("f", (4,), "an array of rotations")
_TUBE_SIDES = 6  # as build_feather has it


@dataclass(frozen=True)
class ExpandedFeather:
    """One feather of an expansion. points: its own among all points, and barbs: among all barbs.

    triangles: (T, 3) into its own points. side: (T,) 0 leading, 1 trailing, 2 rachis. st: (V, 2).
    barb_side: (B,) of its barbs.
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


def expand(
    stage: Any,
    *,
    rows: int | None = None,
    columns: int | None = None,
    barbs: int | None = None,
) -> Expansion:
    """The condensed feathers of a stage (or of a file, by its path) as meshes, and as barbs.

    rows, columns: of the meshes, at least 3 and 1; default: as written. barbs: along each vane;
    None: none. Raises InputError where the file cannot be opened, holds no condensed feathers of
    featherfx, or they are damaged; and for a density out of range.
    """
    allowed = {"rows": (rows, 3, MOST_ROWS), "columns": (columns, 1, MOST_COLUMNS)}
    allowed["barbs"] = (barbs, 1, MOST_BARBS)
    problems = [
        Problem("expand", name, f"{value}; allowed: {low} to {high}")
        for name, (value, low, high) in allowed.items()
        if value is not None and not low <= value <= high
    ]
    if problems:
        raise InputError(*problems)
    refuse_unfit_usd()
    opened = open_stage(stage) if isinstance(stage, str | Path) else stage
    return Expansion(opened, rows, columns, barbs or 0)


def condensed_prims(stage: Any) -> list[Any]:
    """The curves prims of a stage that hold condensed feathers as a bake writes them."""
    return [
        prim
        for prim in Usd.PrimRange(stage.GetPseudoRoot(), Usd.TraverseInstanceProxies())
        if prim.IsA(UsdGeom.BasisCurves)
        and all(prim.HasAttribute(name) for name in (*P_BARB, ORIENT, "primvars:firstVaneRow"))
    ]


class Expansion:
    """Condensed feathers as one mesh of V points and one set of B barbs.

    feathers: each, in the order of the stage. frames: first and last time code.
    """

    def __init__(self, stage: Any, rows: int | None, columns: int | None, barbs: int) -> None:
        self._stage = stage
        self.frames = (stage.GetStartTimeCode(), stage.GetEndTimeCode())
        self._prims = [_Shafts(prim, rows, columns, barbs) for prim in condensed_prims(stage)]
        if not self._prims:
            name = stage.GetRootLayer().identifier
            raise InputError(Problem(name, "", "holds no condensed feathers (bake --as condensed)"))
        self.feathers: tuple[ExpandedFeather, ...] = tuple(self._counted())

    def _counted(self) -> Iterator[ExpandedFeather]:
        points = barbs = 0
        for shafts in self._prims:
            for each in shafts.feathers:
                yield replace(
                    each,
                    points=slice(points + each.points.start, points + each.points.stop),
                    barbs=slice(barbs + each.barbs.start, barbs + each.barbs.stop),
                )
            points, barbs = points + shafts.point_count, barbs + shafts.barb_count

    @cached_property
    def triangles(self) -> Indices:
        """(T, 3) of all feathers, into all points."""
        return np.concatenate([each.triangles + each.points.start for each in self.feathers])

    @property
    def path(self) -> str:
        """Of the first prim."""
        return str(self._prims[0].prim.GetPath())

    def codes(self) -> list[float]:
        """Time codes at which any of the feathers has samples."""
        return sorted({code for each in self._prims for code in each.codes()})

    def points(self, time: float | Usd.TimeCode | None = None) -> Array:
        """(V, 3) points of all meshes at a time code, None: at rest; stage units, world space."""
        return np.concatenate([each.points(_code(time)) for each in self._prims])

    def barbs(self, time: float | Usd.TimeCode | None = None) -> Array:
        """(B, K, 3) points of all barbs, root to end, as `points`."""
        return np.concatenate([each.barbs(_code(time)) for each in self._prims])


def _code(time: float | Usd.TimeCode | None) -> Any:
    return DEFAULT if time is None else Usd.TimeCode(time)


class _Shafts:
    """The feathers of one curves prim."""

    def __init__(self, prim: Any, rows: int | None, columns: int | None, barbs: int) -> None:
        self.prim = prim
        self._curves = UsdGeom.BasisCurves(prim)
        counts = self._array("curveVertexCounts", DEFAULT, INTEGERS).astype(np.int64)
        element = UsdGeom.PrimvarsAPI(prim).GetPrimvar(P_BARB[0]).GetElementSize()
        self._starts, self._columns = np.concatenate([[0], np.cumsum(counts)]), element
        members = members_of(prim) or [_only(prim)]
        if len(members) != len(counts):
            raise self._fault("curveVertexCounts", f"tell of {len(counts)}, {len(members)} named")
        coarse = self._feathers_at_rest()
        drawn = [_drawn(each, rows, columns) for each in coarse]
        self._surfaces = [each.surface for each in drawn]
        same = rows is None and columns is None
        self._map = None if same else self._mapped(coarse, drawn)
        self._barbs = [_barb_rows(each, barbs) for each in coarse] if barbs else []
        self._to_barbs = _barb_map(coarse, self._barbs) if barbs else None
        self.feathers = list(self._told(members))
        self.point_count = sum(len(each.row) for each in self._surfaces)
        self.barb_count = sum(len(each.side) for each in self._barbs)
        self._row, self._node, self._offset = self._joined(drawn)

    def codes(self) -> list[float]:
        return times_of(self._curves.GetPointsAttr())

    def points(self, code: Any) -> Array:
        nodes, directors = self._pose(code)
        if self._map is not None:
            flat = self._map @ self._flat(nodes, directors)
            nodes, directors = self._split(flat)
        along, up = (self._offset[:, k, None] * directors[self._row, k] for k in range(2))
        return self._placed(nodes[self._row, self._node] + along + up, code)

    def barbs(self, code: Any) -> Array:
        if self._to_barbs is None:
            return np.zeros((0, BARB_SEGMENTS + 1, 3))
        curves = self._to_barbs @ self._flat(*self._pose(code))
        return self._placed(curves, code).reshape(-1, BARB_SEGMENTS + 1, 3)

    def _placed(self, points: Array, code: Any) -> Array:
        matrix = np.array(self._curves.ComputeLocalToWorldTransform(code))
        return np.asarray(points @ matrix[:3, :3] + matrix[3, :3])

    def _pose(self, code: Any) -> tuple[Array, Array]:
        """(N, 1 + 2 m, 3) nodes, leading first, and (N, 2, 3) directors of all rows."""
        shaft = self._array("points", code, VECTORS).astype(float)
        if len(shaft) != self._starts[-1]:
            raise self._fault("points", f"are {len(shaft)}, not {self._starts[-1]}, {at(code)}")
        shape = (len(shaft), self._columns, 3)
        left, right = (self._shaped(name, code, VECTORS, shape) for name in P_BARB)
        swapped = self._leading_is_right[:, None, None]
        leading, trailing = np.where(swapped, right, left), np.where(swapped, left, right)
        turns = self._shaped(ORIENT, code, _ROTATIONS, (len(shaft), 4)).astype(float)
        turns = np.roll(turns, 1, axis=1)
        frames = quats_to_frames(turns / np.linalg.norm(turns, axis=1, keepdims=True))
        nodes = np.concatenate([shaft[:, None], leading, trailing], axis=1)
        return nodes, np.stack([frames[..., 1], frames[..., 2]], axis=1)

    @cached_property
    def _leading_is_right(self) -> NDArray[np.bool_]:
        """(N,) of the feather of each row."""
        counts = np.diff(self._starts)
        flags = self._shaped("primvars:leadingIsRight", DEFAULT, INTEGERS, (len(counts),))
        return np.repeat(flags.astype(np.bool_), counts)

    def _feathers_at_rest(self) -> list[Feather]:
        nodes, directors = self._pose(DEFAULT)
        counts, total = np.diff(self._starts), self._starts[-1]
        first = self._shaped("primvars:firstVaneRow", DEFAULT, INTEGERS, (len(counts),))
        section = self._shaped("primvars:section", DEFAULT, PAIRS, (total, 2)).astype(float)
        shape = (total, self._columns)
        along = self._shaped("primvars:uv_barbl", DEFAULT, PAIRS, (*shape, 2))[:, 0, 1].astype(
            float
        )
        grown = [
            self._shaped(f"primvars:width_barb{end}", DEFAULT, NUMBERS, shape)[:, 0] > 0.0
            for end in "lr"
        ]
        swapped = self._leading_is_right
        sides = np.stack([np.where(swapped, *grown[::-1]), np.where(swapped, *grown)])
        return [
            _feather(
                RowPoints(nodes[own], directors[own]),
                along[own],
                section[own],
                sides[:, own],
                int(first[k]),
                bool(swapped[own.start]),
            )
            for k, own in enumerate(self._rows())
        ]

    def _rows(self) -> list[slice]:
        return [slice(*ends) for ends in zip(self._starts[:-1], self._starts[1:], strict=True)]

    def _flat(self, nodes: Array, directors: Array) -> Array:
        """All nodes and directors as the maps take them, feather after feather."""
        each = (RowPoints(nodes[own], directors[own]) for own in self._rows())
        return np.concatenate([part.reshape(-1, 3) for points in each for part in points])

    def _mapped(self, coarse: Sequence[Feather], drawn: Sequence[Feather]) -> Any:
        """From the nodes and directors of all feathers to those of other grids."""
        self._grids = [(each.rows, 1 + 2 * each.columns) for each in drawn]
        maps = [density_map(*pair) for pair in zip(coarse, drawn, strict=True)]
        joined = [sparse.vstack([part.matrix for part in each]) for each in maps]
        return sparse.block_diag(joined, format="csr")

    def _split(self, flat: Array) -> tuple[Array, Array]:
        nodes, directors, start = [], [], 0
        for rows, size in self._grids:
            middle, end = start + rows * size, start + rows * (size + 2)
            nodes.append(flat[start:middle].reshape(rows, size, 3))
            directors.append(flat[middle:end].reshape(rows, 2, 3))
            start = end
        return np.concatenate(nodes), np.concatenate(directors)

    def _joined(self, drawn: Sequence[Feather]) -> tuple[Indices, Indices, Array]:
        starts = np.cumsum([0, *(each.rows for each in drawn)])
        row = [each.row + start for each, start in zip(self._surfaces, starts, strict=False)]
        node, offset = ([getattr(s, name) for s in self._surfaces] for name in ("node", "offset"))
        return np.concatenate(row), np.concatenate(node), np.concatenate(offset)

    def _told(self, members: Sequence[Member]) -> Iterator[ExpandedFeather]:
        points = barbs = 0
        for k, (member, surface) in enumerate(zip(members, self._surfaces, strict=True)):
            side = self._barbs[k].side if self._barbs else np.zeros(0, dtype=np.int64)
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
            )
            points, barbs = points + len(surface.row), barbs + len(side)

    def _array(self, name: str, code: Any, kind: Kind) -> Any:
        return sized_array(self.prim.GetAttribute(name), code, kind)

    def _shaped(self, name: str, code: Any, kind: Kind, shape: tuple[int, ...]) -> Any:
        found = array_of(self.prim.GetAttribute(name), code, kind)
        if found is None or found.size != np.prod(shape):
            told = (
                "has no value" if found is None else f"holds {len(found)} values, too many or few"
            )
            raise self._fault(name, f"{told} {at(code)}")
        return found.reshape(shape)

    def _fault(self, name: str, told: str) -> InputError:
        return fault(self.prim.GetAttribute(name), told)


def _only(prim: Any) -> Member:
    """The feather of a prim of its own."""
    primvars = UsdGeom.PrimvarsAPI(prim)
    names = ("featherId", "featherKind", "region")
    id, kind, region = (text_of(primvars.GetPrimvar(name).GetAttr()) or "" for name in names)
    return Member(id, kind, region)


def _feather(
    rest: RowPoints,
    along: Array,
    section: Array,
    grown: NDArray[np.bool_],
    first_vane_row: int,
    mirrored: bool,
) -> Feather:
    """A feather from what a cache has of it. along: (n,) share of the shaft. section: (n, 2).
    grown: (2, n) whether a row has a barb."""
    nodes, rows = rest.nodes, len(along)
    columns = nodes.shape[1] // 2
    length = float(np.linalg.norm(np.diff(nodes[:, 0], axis=0), axis=1).sum())
    station = along * length
    barb_length = np.zeros((2, rows))
    cell = np.zeros((2, rows - 1, columns, 2), dtype=np.bool_)
    for side in (LEADING, TRAILING):
        barbs = np.concatenate([nodes[:, :1], nodes[:, barb_slice(side, columns)]], axis=1)
        sizes = np.linalg.norm(np.diff(barbs, axis=1), axis=2).sum(axis=1)
        barb_length[side] = np.where(grown[side], sizes, 0.0)
        # a triangle has an area where the row of its edge has a barb
        cell[side] = np.stack([grown[side, :-1], grown[side, 1:]], axis=1)[:, None]
        cell[side, :first_vane_row] = False
    width, height = section.T
    frame = np.concatenate(
        [np.cross(rest.directors[:, 0], rest.directors[:, 1])[:, None], rest.directors], axis=1
    ).swapaxes(1, 2)
    rachis = Rachis(station, nodes[:, 0], frame, width, height, first_vane_row)
    surface = build_surface(nodes, rachis, barb_length, cell, _TUBE_SIDES, False)
    if mirrored:
        surface = replace(
            surface,
            offset=surface.offset * [-1.0, 1.0],
            triangles=surface.triangles[:, [0, 2, 1]],
        )
    spans = np.zeros_like(barb_length)
    return Feather(rest, station, width, height, barb_length, spans, cell, surface)


def _drawn(feather: Feather, rows: int | None, columns: int | None) -> Feather:
    """A feather on another grid; itself where that is its own."""
    wanted = rows or feather.rows, columns or feather.columns
    return feather if wanted == (feather.rows, feather.columns) else _resampled(feather, *wanted)


def _first_row(feather: Feather) -> int:
    rows = np.flatnonzero(feather.cell.any(axis=(0, 2, 3)))
    return int(rows[0]) if len(rows) else feather.rows - 1


def _is_mirrored(feather: Feather) -> bool:
    """Whether the surface was turned round: the first corner of a tube stands off by +width / 2."""
    tube = feather.surface.offset[feather.surface.row == 0]
    return bool(tube[np.abs(tube[:, 0]).argmax(), 0] < 0.0)


def _resampled(feather: Feather, rows: int, columns: int) -> Feather:
    """A feather's rest shape at other rows and columns, interpolated as poses are."""
    length, first = float(feather.station[-1]), _first_row(feather)
    station, bare = row_stations(length, float(feather.station[first]) / length, rows)
    weights = hermite_weights(feather.station, station)[0]
    shaft = weights @ feather.rest.nodes[:, 0]
    lateral, dorsal = (weights @ feather.rest.directors[:, k] for k in range(2))
    lateral /= np.linalg.norm(lateral, axis=1, keepdims=True)
    dorsal -= lateral * (lateral * dorsal).sum(axis=1, keepdims=True)
    dorsal /= np.linalg.norm(dorsal, axis=1, keepdims=True)
    nodes = np.repeat(shaft[:, None], 1 + 2 * columns, axis=1)
    places = (np.linspace(0.0, 1.0, k + 1) for k in (feather.columns, columns))
    across = hermite_weights(*places)[0]
    grown = np.zeros((2, rows), dtype=np.bool_)
    for side in (LEADING, TRAILING):
        own = np.flatnonzero(feather.barb_length[side] > 0.0)
        if not len(own):
            continue
        # lengths go to zero at the next rows without a barb, and are interpolated between
        ends = np.unique(np.clip([own[0] - 1, *own, own[-1] + 1], first, feather.rows - 1))
        reach = hermite_weights(feather.station[ends], station)[0] @ feather.barb_length[side, ends]
        inside = (station >= feather.station[ends[0]]) & (station <= feather.station[ends[-1]])
        reach = np.where(inside & (reach > 1e-6 * length), reach, 0.0)
        barbs = feather.rest.nodes[own][:, barb_slice(side, feather.columns)]
        offsets = barbs - feather.rest.nodes[own, :1]
        offsets = np.concatenate([np.zeros_like(offsets[:, :1]), offsets], axis=1)
        offsets /= feather.barb_length[side, own, None, None]
        between = hermite_weights(feather.station[own], station)[0]
        spread = np.einsum("ni,jk,ikc->njc", between, across[1:], offsets)
        nodes[:, barb_slice(side, columns)] += reach[:, None, None] * spread
        grown[side] = reach > 0.0
    section = weights @ np.stack([feather.width, feather.height], axis=-1)
    rest = RowPoints(nodes, np.stack([lateral, dorsal], axis=1))
    mirrored = _is_mirrored(feather)
    return _feather(rest, station / length, section, grown, bare, mirrored)


@dataclass(frozen=True)
class _Barbs:
    """Barbs of a feather on a dense grid of it. picked: (B, K) numbers of nodes."""

    dense: Feather
    picked: Indices
    side: Indices


def _barb_rows(feather: Feather, count: int) -> _Barbs:
    calamus = feather.station[_first_row(feather)] / feather.station[-1]
    rows = max(3, round(count / max(1.0 - float(calamus), 1e-3)) + 2)
    dense = _resampled(feather, min(rows, MOST_ROWS), BARB_SEGMENTS)
    grown = [np.flatnonzero(dense.barb_length[side] > 0.0) for side in (LEADING, TRAILING)]
    nodes = np.arange(1 + 2 * BARB_SEGMENTS)
    each = [np.append(0, nodes[barb_slice(side, BARB_SEGMENTS)]) for side in (LEADING, TRAILING)]
    picked = [row[:, None] * len(nodes) + barb for row, barb in zip(grown, each, strict=True)]
    side = np.repeat([LEADING, TRAILING], [len(row) for row in grown])
    return _Barbs(dense, np.concatenate(picked), side)


def _barb_map(coarse: Sequence[Feather], barbs: Sequence[_Barbs]) -> Any:
    """From the nodes and directors of all feathers to the points of all barbs."""
    pairs = zip(coarse, barbs, strict=True)
    maps = [density_map(own, each.dense).nodes.matrix[each.picked.ravel()] for own, each in pairs]
    return sparse.block_diag(maps, format="csr")
