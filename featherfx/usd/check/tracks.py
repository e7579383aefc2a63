"""Points that a cache writes, prim by prim, with the lines whose lengths its feathers keep.

A node is the mean of some points: of a ring of a rachis' tube, or a point itself. A strand is a
chain of nodes: a rachis or a barb. Strands are found in topology and texture coordinates alone.
Points of one row of a vane share v; u is 0.5 on the rachis and grows to 1 or falls to 0 along a
barb (featherfx/feather/types.py). Edges of a vane within a row are the segments of its barbs.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from pxr import Usd, UsdGeom

from featherfx import usd
from featherfx.algebra.triangulation import triangulate
from featherfx.algebra.types import Array, Floats, Indices
from featherfx.errors import InputError
from featherfx.feather.types import RACHIS_PART
from featherfx.usd.check.judge_kernels import Strands
from featherfx.usd.read.animated_mesh import read_topology
from featherfx.usd.read.cached_feather import FeatherMember, read_members
from featherfx.usd.read.drawn_meshes import DrawnMesh, drawn_meshes, is_drawn
from featherfx.usd.read.stage import transform_points
from featherfx.usd.read.values import (
    DEFAULT_TIME,
    EARLIEST_TIME,
    INTEGER_ARRAY,
    PAIR_ARRAY,
    VECTOR_ARRAY,
    fault,
    read_array,
    read_matrix,
    read_sized_array,
    read_text,
    read_times,
)
from featherfx.usd.types import DETAIL_ATTRIBUTE, HALF_VELOCITIES

if TYPE_CHECKING:
    from featherfx.usd.read.expand import Expansion

RACHIS, BARB = 0, 1
_ON_RACHIS = 0.5  # u of points of the rachis


@dataclass(frozen=True)
class MeshShape:
    """Constant part of a mesh or of curves, which have no triangles.

    rest: (V, 3) in the space of the prim. triangles: (T, 3). part: (T,) side of the vane, or
    rachis. st: (V, 2).
    """

    rest: Floats
    triangles: Indices
    part: Indices
    st: NDArray[Any]


@dataclass(frozen=True)
class Track:
    """F feathers of one prim: V points over time.

    ids and regions of the feathers. owner: (V,) feather of each point. reader: of its values.
    """

    ids: Sequence[str]
    regions: Sequence[str]
    owner: Indices
    shape: MeshShape
    strands: Strands
    reader: Any


def find_tracks(stage: Any) -> Iterator[Track]:
    """Yield the tracks of all feathers that a stage draws; condensed ones as the meshes they are.

    Raises InputError where a prim contradicts itself.
    """
    has_mesh = False
    for drawn in drawn_meshes(stage):
        if drawn.labels or drawn.mesh.GetPrim().HasAttribute("primvars:featherId"):
            has_mesh = True
            yield _mesh_track(drawn)
    if not has_mesh and usd.expand.condensed_prims(stage):
        yield _condensed_track(stage)
    for prim in stage.Traverse():
        is_own = prim.IsA(UsdGeom.BasisCurves) and prim.HasAttribute("primvars:featherId")
        if is_own and not prim.HasAttribute(DETAIL_ATTRIBUTE) and is_drawn(prim):
            yield _curves_track(prim)


def _mesh_track(drawn: DrawnMesh) -> Track:
    mesh, prim = drawn.mesh, drawn.mesh.GetPrim()
    counts, indices = read_topology(mesh)
    rest = _read_rest(mesh)
    if indices.size and not 0 <= indices.min() <= indices.max() < len(rest):
        raise fault(mesh.GetFaceVertexIndicesAttr(), "do not fit the mesh's points")
    corners, face = triangulate(counts, rest[indices].astype(np.float64))
    members = [drawn.labels] if drawn.labels else read_members(prim) or [_read_labels(prim)]
    st = read_array(prim.GetAttribute("primvars:st"), EARLIEST_TIME, PAIR_ARRAY)
    side = read_sized_array(prim.GetAttribute("primvars:side"), EARLIEST_TIME, INTEGER_ARRAY)
    if st is None or len(st) != len(rest) or len(side) != len(counts):
        # each point is a row of its own, so that there are no strands
        st = np.stack([np.full(len(rest), _ON_RACHIS), np.arange(len(rest))], axis=1)
        side = np.zeros(len(counts))
    shape = MeshShape(rest, indices[corners], side.astype(np.int64)[face], st)
    owner = _find_owners(prim, members, len(rest))
    return _track(members, owner, shape, _Reader(prim, drawn.matrix))


def _condensed_track(stage: Any) -> Track:
    expansion = usd.expand.expand(stage)
    each, rest = expansion.feathers, expansion.points().astype(np.float32)
    shape = MeshShape(
        rest,
        np.concatenate([feather.triangles + feather.points.start for feather in each]),
        np.concatenate([feather.side for feather in each]),
        np.concatenate([feather.st for feather in each]),
    )
    owner = np.repeat(np.arange(len(each)), [len(feather.st) for feather in each])
    return _track(each, owner, shape, _ExpansionReader(expansion))


def _track(members: Sequence[Any], owner: Indices, shape: MeshShape, reader: Any) -> Track:
    ids, regions = [each.id for each in members], [each.region for each in members]
    return Track(ids, regions, owner, shape, _find_strands(shape, owner), reader)


def _curves_track(prim: Any) -> Track:
    rest = _read_rest(UsdGeom.BasisCurves(prim))
    counts = read_sized_array(
        prim.GetAttribute("curveVertexCounts"), EARLIEST_TIME, INTEGER_ARRAY
    ).astype(np.int64)
    if (counts < 1).any() or counts.sum() != len(rest):
        raise fault(prim.GetAttribute("curveVertexCounts"), "do not fit the points")
    members = read_members(prim) or [_read_labels(prim)]
    owner, points = _find_owners(prim, members, len(rest)), np.arange(len(rest))
    last = np.cumsum(counts) - 1
    start = np.delete(points, last)
    strands = Strands(
        node_first=np.arange(len(rest) + 1),
        node_points=points,
        first=np.concatenate([[0], np.cumsum(counts - 1)]),
        start=start,
        end=start + 1,
        feather=owner[last],
        kind=np.full(len(counts), BARB if prim.HasAttribute("primvars:side") else RACHIS),
        root=np.searchsorted(owner, np.arange(len(members))),
    )
    none = np.zeros(0, dtype=np.int64)
    shape = MeshShape(rest, none.reshape(0, 3), none, np.zeros((len(rest), 2)))
    ids, regions = [each.id for each in members], [each.region for each in members]
    return Track(ids, regions, owner, shape, strands, _Reader(prim, partial(read_matrix, prim)))


def _read_rest(gprim: Any) -> Floats:
    """Return (V, 3) points at rest: the primvar, else the first that there are."""
    for name in ("primvars:rest", "primvars:Pref", "points"):
        found = read_array(gprim.GetPrim().GetAttribute(name), EARLIEST_TIME, VECTOR_ARRAY)
        if found is not None:
            return np.ascontiguousarray(found, np.float32)
    raise fault(gprim.GetPrim(), "has no points")


def _read_labels(prim: Any) -> FeatherMember:
    """Return the labels of a prim's only feather."""
    names = ("featherId", "featherKind", "region")
    id, kind, region = (read_text(prim.GetAttribute(f"primvars:{name}")) for name in names)
    return FeatherMember(id or prim.GetName(), kind, region)


def _find_owners(prim: Any, members: Sequence[Any], count: int) -> Indices:
    """Return (V,) the number of the feather of each point of a prim."""
    sizes = [own[1] for each in members if (own := getattr(each, "points", None))]
    sizes = sizes or [count]
    if sum(sizes) != count or len(sizes) != len(members):
        raise fault(prim, f"tells of {sum(sizes)} points and has {count}")
    return np.repeat(np.arange(len(members)), sizes)


class _Reader:
    """Values of a prim over time, in its space at rest.

    codes: time codes of its points, else of its place.
    """

    def __init__(self, prim: Any, matrix: Callable[[Any], Array]) -> None:
        self._prim, self._matrix, self.at_rest = prim, matrix, matrix(DEFAULT_TIME)
        self.codes = read_times(prim.GetAttribute("points"))
        self.codes = self.codes or list(UsdGeom.Xformable(prim).GetTimeSamples())

    def fault(self, code: float | None) -> InputError:
        """Return the error of points that are not as many as at rest."""
        when = "" if code is None else f" at time code {code:g}"
        return fault(self._prim.GetAttribute("points"), f"are not as many{when} as at rest")

    def read(self, name: str, code: float | None) -> Floats | None:
        """Return (V, 3) points or velocities; None where there are none."""
        time = DEFAULT_TIME if code is None else Usd.TimeCode(code)
        found = read_array(self._prim.GetAttribute(name), time, VECTOR_ARRAY)
        if found is None and name == "velocities":
            found = read_array(self._prim.GetAttribute(HALF_VELOCITIES), time, VECTOR_ARRAY)
        matrix = self._matrix(time)
        if found is None:
            return None
        if (matrix == self.at_rest).all():
            return np.ascontiguousarray(found, np.float32)
        relative = matrix @ np.linalg.inv(self.at_rest)
        if name == "velocities":
            relative[3, :3] = 0.0
        return transform_points(found, relative).astype(np.float32)


class _ExpansionReader:
    """Points of condensed feathers over time."""

    def __init__(self, expansion: Expansion) -> None:
        self._expansion, self.at_rest, self.codes = expansion, np.eye(4), expansion.codes()

    def read(self, name: str, code: float | None) -> Floats | None:
        """Return (V, 3) points; condensed feathers carry no velocities of these."""
        return self._expansion.points(code).astype(np.float32) if name == "points" else None


def _find_strands(shape: MeshShape, owner: Indices) -> Strands:
    """Return rachises and barbs of a mesh."""
    tube = shape.part == RACHIS_PART
    on_tube = np.unique(shape.triangles[tube])
    row = shape.st[:, 1].astype(np.float64)
    on_tube = on_tube[np.lexsort((row[on_tube], owner[on_tube]))]
    new = np.diff(owner[on_tube], prepend=-1) + np.abs(np.diff(row[on_tube], prepend=-1.0)) > 0
    rings = np.flatnonzero(new)
    of_ring = owner[on_tube[rings]]
    along = np.flatnonzero(np.diff(of_ring) == 0)  # from one ring to the next
    # of the vanes, edges between points of one row, outwards
    corners = shape.triangles[~tube]
    edges = np.concatenate([corners[:, [0, 1]], corners[:, [1, 2]], corners[:, [2, 0]]])
    edges = edges[row[edges[:, 0]] == row[edges[:, 1]]]
    out = np.abs(shape.st[:, 0].astype(np.float64) - _ON_RACHIS)
    edges = np.unique(np.take_along_axis(edges, np.argsort(out[edges], axis=1), axis=1), axis=0)
    # a point's barb is told by its first point, which follows the rachis
    barb = np.arange(len(row))
    inner = out[edges[:, 0]] > 0.0
    barb[edges[inner, 1]] = edges[inner, 0]
    while (before := barb[barb]).tolist() != barb.tolist():
        barb = before
    edges = edges[np.argsort(barb[edges[:, 1]], kind="stable")]
    barbs, first = np.unique(barb[edges[:, 1]], return_index=True)
    first = np.append(first, len(edges))
    rachises = np.unique(of_ring[along])
    points = len(row)
    # the first ring of a feather, else its first point
    root = np.searchsorted(owner, np.arange(owner.max(initial=-1) + 1))
    with_tube, ring = np.unique(of_ring, return_index=True)
    root[with_tube] = points + ring
    return Strands(
        # the points themselves, then the rings
        node_first=np.concatenate([np.arange(points), points + rings, [points + len(on_tube)]]),
        node_points=np.concatenate([np.arange(points), on_tube]),
        first=np.concatenate([np.searchsorted(of_ring[along], rachises), len(along) + first]),
        start=np.concatenate([points + along, edges[:, 0]]),
        end=np.concatenate([points + along + 1, edges[:, 1]]),
        feather=np.concatenate([rachises, owner[barbs]]),
        kind=np.repeat([RACHIS, BARB], [len(rachises), len(barbs)]),
        root=root,
    )
