"""The barb grid of a cached mesh, and its export to Houdini's condensed feathers.

Texture coordinates tell the grid. A condensed feather is one polyline per rachis that carries its
barbs: every point has its two barbs as arrays, P_barbl and P_barbr, of equally many points, root to
end, without the root. featherfx reads this form back as a groom.

USD stores per-point arrays as primvars of elementSize m. displayColor_barbl and displayColor_barbr
are colours of these points. Left is as seen from dorsal with the tip ahead. Rows without a barb
have all its points on the rachis.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from pxr import Sdf, Usd, UsdGeom

from featherfx.algebra.types import Array, Floats, Indices
from featherfx.algebra.vectors import (
    face_products,
    shared_turns,
    unit,
    vectors_to_frames,
    vertex_normals,
)
from featherfx.errors import InputError, Problem
from featherfx.feather.types import LEADING, TRAILING, RowPoints
from featherfx.files.atomic_write import standing
from featherfx.phases import counted
from featherfx.shot.detail.guided import row_frames
from featherfx.usd import arrays
from featherfx.usd.read.cache import Cache
from featherfx.usd.read.cached_feather import CachedFeather
from featherfx.usd.types import BARB_COLOUR_PRIMVARS, StageSpace
from featherfx.usd.write.layers import StageInfo, author_metadata, define_root, new_layer, publish
from featherfx.usd.write.output import check_output, prim_name, refuse_inputs
from featherfx.usd.write.previous_cache import read_metadata
from featherfx.usd.write.prims import author_primvars, define_polylines, label_primvars


@dataclass(frozen=True)
class BarbGrid:
    """The barb grid of one mesh of V points, n rows and m columns.

    tube: (K,) points of the rachis's surface, row by row, and first: (n,) first index of each row
    among them; a row's rachis point is their mean. nodes: (2, n, m + 1) points of the left and
    right barbs, root first; V + i is the rachis point of row i. row, node: (V,) where each point
    is, node as of RowPoints with left barbs first.
    """

    tube: Indices
    first: Indices
    nodes: Indices
    row: Indices
    node: Indices

    def values(self, points: Array | Floats) -> tuple[Floats, Floats, Floats]:
        """Return rachis (n, 3), left and right barbs (n, m, 3) of surface points (V, 3)."""
        counts = np.diff(self.first, append=len(self.tube))
        rachis = np.add.reduceat(points[self.tube], self.first, axis=0, dtype=float)
        rachis /= counts[:, None]
        left, right = np.concatenate([points, rachis.astype(points.dtype)])[self.nodes]
        return left[:, 0], left[:, 1:], right[:, 1:]


def find_grid(path: str | Path, feather: CachedFeather, pose: Any) -> BarbGrid:
    """Return rows and columns from the texture coordinates.

    v is the row, u - 1/2 counts barb nodes.
    """
    problem = Problem(
        str(path), feather.path, "has no barb grid with st and sides. Give a cache of featherfx"
    )
    if feather.st is None:
        raise InputError(problem)
    vane = np.unique(feather.triangles[feather.side != 2])
    tube = np.unique(feather.triangles[feather.side == 2])
    if len(vane) == 0 or len(tube) == 0:
        raise InputError(problem)
    across = feather.st[vane, 0].astype(float) - 0.5
    steps = np.unique(np.round(np.abs(across[np.abs(across) > 1e-5]), 6))
    columns = round(0.5 / steps[0]) if len(steps) else 0
    node = np.round(across * 2 * columns).astype(int)
    whole = columns > 0 and np.allclose(node / (2.0 * columns), across, atol=1e-4)
    if not whole or np.abs(node).max() > columns:
        raise InputError(problem)
    stations, row = np.unique(feather.st[tube, 1], return_inverse=True)
    row_of_vane = np.searchsorted(stations, feather.st[vane, 1])
    if not np.isin(feather.st[vane, 1], stations).all():
        raise InputError(problem)
    # what no triangle uses, as in the calamus, is the row's rachis point
    rachis = len(pose.points) + np.arange(len(stations))
    nodes = np.tile(rachis[:, None], (2, 1, columns + 1))
    for side, sign in ((LEADING, 1), (TRAILING, -1)):
        # of lips at one place the barb's own, which come first, count
        own = np.flatnonzero(node * sign > 0)[::-1]
        nodes[side, row_of_vane[own], np.abs(node[own])] = vane[own]
    order = np.argsort(row, kind="stable")
    rows, numbers = np.zeros((2, len(pose.points)), dtype=np.int64)
    rows[tube], rows[vane], numbers[vane] = row, row_of_vane, node
    first = np.searchsorted(row[order], np.arange(len(stations)))
    grid = BarbGrid(tube[order], first, nodes, rows, _node_numbers(numbers, columns))
    if not _leading_is_right(grid, feather, pose):
        return grid
    return replace(grid, nodes=nodes[::-1], node=_node_numbers(-numbers, columns))


def _node_numbers(places: Indices, columns: int) -> Indices:
    """(V,) numbers of nodes in their rows from places along the barbs, of second ones below 0."""
    return np.where(places < 0, columns - places, places)


def _leading_is_right(grid: BarbGrid, feather: CachedFeather, pose: Any) -> bool:
    """Return whether the leading side of a grid is the right one, seen from dorsal."""
    points = pose.points.astype(float)
    rachis, leading, trailing = grid.values(pose.points)
    tangent, apart = np.gradient(rachis, axis=0), leading[:, -1] - trailing[:, -1]
    corners = points[feather.triangles[feather.side != 2]]
    dorsal = face_products(corners).sum(axis=0)
    return float((np.cross(dorsal, tangent) * apart).sum()) < 0.0


@dataclass(frozen=True)
class MeshRows:
    """Rows of a cached mesh of V points. grid: of its barbs. triangles: (T, 3)."""

    grid: BarbGrid
    triangles: Indices

    def rows_of(self, points: Array) -> RowPoints:
        """Nodes and directors of the rows, from points (V, 3)."""
        rachis, *sides = self.grid.values(points)
        nodes = np.concatenate([rachis[:, None], *sides], axis=1)
        # rings of the rachis begin on its leading side and turn to the dorsal one
        corners = int(np.diff(self.grid.first).min())
        ring = points[self.grid.tube[self.grid.first[:, None] + np.arange(corners)]]
        angle = 2.0 * np.pi * np.arange(corners) / corners
        weights = np.stack([np.cos(angle), np.sin(angle)])
        return RowPoints(nodes, unit(weights @ (ring - rachis[:, None])))

    def moved(self, points: Array, before: RowPoints, after: RowPoints) -> Array:
        """Points (V, 3) carried from rows to others."""
        row, node = self.grid.row, self.grid.node
        own = before.nodes[row, node], after.nodes[row, node]
        frames = [row_frames(each.directors[None])[0] for each in (before, after)]
        carried = np.einsum("nij,nkj->nik", frames[1], frames[0])[row]
        return own[1] + np.einsum("vij,vj->vi", carried, points - own[0])


class MovedRows(NamedTuple):
    """Rows of a feather at a time, as the cache has them and as they deviate. turns: barbs' turns,
    (2, n, m, 3)."""

    before: RowPoints
    after: RowPoints
    turns: Array


def carry_rachis(points: Array, before: RowPoints, after: RowPoints) -> Array:
    """Points (K, 3) near a rachis carried from its rows to others."""
    row, fraction = _locate(points, before.nodes[:, 0])
    frames = [row_frames(each.directors[None])[0] for each in (before, after)]
    carried = frames[1] @ frames[0].swapaxes(1, 2)
    ends = [
        after.nodes[k, 0] + np.einsum("kij,kj->ki", carried[k], points - before.nodes[k, 0])
        for k in (row, row + 1)
    ]
    return np.asarray(ends[0] + fraction[:, None] * (ends[1] - ends[0]))


def _locate(points: Array, line: Array) -> tuple[Indices, Array]:
    """(K,) nearest segments of a line (n, 3), and where they are nearest to points (K, 3), 0 to
    1."""
    ways = np.diff(line, axis=0)
    apart = points[:, None] - line[:-1]
    along = np.einsum("knc,nc->kn", apart, ways) / np.maximum((ways * ways).sum(axis=1), 1e-30)
    along = np.clip(along, 0.0, 1.0)
    off = np.linalg.norm(apart - along[..., None] * ways, axis=2)
    row = off.argmin(axis=1)
    return row, np.take_along_axis(along, row[:, None], axis=1)[:, 0]


def carry_barbs(points: Array, counts: Indices, sample: MovedRows) -> Array:
    """Points of barbs, curves of counts (B,) points, whose segments turn with the vane around
    them."""
    moved, starts = points.copy(), np.concatenate([[0], np.cumsum(counts)[:-1]])
    before, after, turns = sample
    frames = [row_frames(each.directors[None])[0] for each in (before, after)]
    columns = turns.shape[2]
    reach = before.nodes[:, [columns, -1]] - before.nodes[:, :1]
    lateral = before.directors[:, 0]
    first_sign = np.sign(np.einsum("nsc,nc->s", reach, lateral) @ (1.0, -1.0))
    for count in np.unique(counts):
        own = starts[counts == count][:, None] + np.arange(count)
        curves = points[own]
        row, fraction = _locate(curves[:, 0], before.nodes[:, 0])
        ahead = np.einsum("bc,bc->b", curves[:, -1] - curves[:, 0], lateral[row])
        side = np.where(first_sign * ahead > 0.0, 0, 1)
        pieces = np.diff(curves, axis=1)
        lengths = np.linalg.norm(pieces, axis=2)
        middle = np.cumsum(lengths, axis=1) - 0.5 * lengths
        place = middle / np.maximum(lengths.sum(axis=1, keepdims=True), 1e-30) * columns - 0.5
        low = np.clip(np.floor(place).astype(int), 0, max(columns - 2, 0))
        high = np.minimum(low + 1, columns - 1)
        part = np.clip(place - low, 0.0, 1.0)[..., None]
        ends = []
        for k in (row, row + 1):
            at = side[:, None], k[:, None]
            vectors = (1.0 - part) * turns[(*at, low)] + part * turns[(*at, high)]
            bent = vectors_to_frames(vectors.reshape(-1, 3)).reshape(*vectors.shape, 3)
            ends.append(frames[1][k][:, None] @ bent @ frames[0][k][:, None].swapaxes(2, 3))
        first, second = (each.reshape(-1, 3, 3) for each in ends)
        parts = np.repeat(fraction, count - 1)
        turned_pieces = shared_turns(first, second, parts) @ pieces.reshape(-1, 3, 1)
        roots = carry_rachis(curves[:, 0], before, after)
        ways = np.cumsum(turned_pieces.reshape(pieces.shape), axis=1)
        moved[own] = np.concatenate([roots[:, None], roots[:, None] + ways], axis=1)
    return moved


def find_normals(points: Array, triangles: Indices) -> Array:
    """(V, 3) unit normals, weighted by area; points at one place share theirs."""
    places, key = np.unique(points, axis=0, return_inverse=True)
    return np.asarray(vertex_normals(places, key[triangles])[key])


def carry_directions(directions: Array, before: Array, after: Array, triangles: Indices) -> Array:
    """(T, 3) directions on triangles that turn with their nearest edges."""
    edges = [each[triangles[:, [1, 2, 0]]] - each[triangles] for each in (before, after)]
    near = np.abs(np.einsum("tec,tc->te", unit(edges[0]), directions)).argmax(axis=1)
    frames = []
    for edge, points in zip(edges, (before, after), strict=True):
        along = unit(edge[np.arange(len(near)), near])
        normal = unit(face_products(points[triangles]))
        frames.append(np.stack([along, np.cross(normal, along), normal], axis=-1))
    return np.einsum("tij,tkj,tk->ti", frames[1], frames[0], directions)


_BARB_NAMES = ("P_barbl", "P_barbr")


def export_condensed(path: str | Path, output: str | Path, overwrite: bool = False) -> int:
    """Write a cache as condensed feathers and return their number.

    output: .usd, .usdc or .usda. What is written is in memory meanwhile. Raises InputError where
    the cache cannot be read, a mesh in it is not laid out on a barb grid, or the output not
    written.
    """
    target = check_output(output, overwrite)
    before = {target: standing(target)}
    cache = Cache(path)
    refuse_inputs([target], [Path(path)])
    grids = [find_grid(path, feather, cache.pose(k)) for k, feather in enumerate(cache.feathers)]
    frames = cache.frames if cache.has_frames else None
    space = StageSpace(cache.meters_per_unit, cache.up_axis)
    info = StageInfo(prim_name(target.stem), space, frames, cache.frames_per_second)
    layer, codes, root = new_layer(info), cache.codes(), info.root_path
    stage = Usd.Stage.Open(layer)
    define_root(stage, info)
    curves = [
        _define(stage, root.AppendChild(feather.name), feather, grid)
        for feather, grid in zip(cache.feathers, grids, strict=True)
    ]
    everyone = range(len(grids))
    rest = cache.points_of(everyone)
    for curve, grid, points in zip(curves, grids, rest, strict=True):
        _author_pose(curve, grid, points, None)
    moving: set[int] = set()
    # frame by frame, as many feathers share a mesh; what stands still has the rest pose alone
    for code in codes:
        still = [k for k in everyone if k not in moving]
        pairs = zip(still, cache.points_of(still, code), strict=True)
        moving |= {k for k, points in pairs if not np.array_equal(points, rest[k])}
    for code in counted("writing", codes, len(codes)):
        chosen = sorted(moving)
        for k, points in zip(chosen, cache.points_of(chosen, code), strict=True):
            _author_pose(curves[k], grids[k], points, code)
    author_metadata(layer, {**read_metadata(Path(path)), "layout": "condensed"})
    publish([(layer, target)], before)
    return len(cache.feathers)


def _define(stage: Any, path: Any, feather: CachedFeather, grid: BarbGrid) -> Any:
    rows, columns = grid.nodes.shape[1], grid.nodes.shape[2] - 1
    curve = define_polylines(stage, path, [rows])
    author_primvars(curve.GetPrim(), **label_primvars(feather.id, feather.kind, feather.region))
    primvars = UsdGeom.PrimvarsAPI(curve)
    curve.CreateExtentAttr()
    for name in _BARB_NAMES:
        kind = Sdf.ValueTypeNames.Point3fArray
        primvars.CreatePrimvar(name, kind, UsdGeom.Tokens.vertex, columns)
    if feather.colour is not None:
        rachis, *sides = grid.values(feather.colour)
        shades = dict(
            zip(BARB_COLOUR_PRIMVARS, (side.reshape(-1, 3) for side in sides), strict=True)
        )
        shades["displayColor"] = rachis.mean(axis=0, keepdims=True)
        author_primvars(
            curve.GetPrim(), **{name: arrays.vec3f(each) for name, each in shades.items()}
        )
        for name in BARB_COLOUR_PRIMVARS:
            primvars.GetPrimvar(name).SetElementSize(columns)
    return curve


def _author_pose(curve: Any, grid: BarbGrid, points: Array, code: float | None) -> None:
    """Author a pose. code: of the sample, None: the default.

    Samples go through the layer, which is faster than attributes.
    """
    rachis, left, right = grid.values(points)
    values = {
        "points": rachis,
        "extent": np.array([rachis.min(axis=0), rachis.max(axis=0)]),
        "primvars:P_barbl": left.reshape(-1, 3),
        "primvars:P_barbr": right.reshape(-1, 3),
    }
    prim = curve.GetPrim()
    path, layer = prim.GetPath(), prim.GetStage().GetRootLayer()
    for name, value in values.items():
        if code is None:
            prim.GetAttribute(name).Set(arrays.vec3f(value))
        else:
            layer.SetTimeSample(path.AppendProperty(name), code, arrays.vec3f(value))
