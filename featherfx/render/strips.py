"""Barbs in thin strips and shafts as smooth tubes: what is drawn of posed vanes.

The vertices of a vane are a grid of R rows along the shaft times C columns along a barb (`st` tells
which is which). Between them

    P(t, s) = sum_ij W_i(t) V_j(s) x_ij

with the cubic weights of featherfx/feather/density.py, t the height of the barb's root, s the place
on the barb: linear in the vertices, so feathers of one topology are one product of matrices. A
strip lies between two lines of one t and ends where barbs do. There are as many as a picture can
show, at most as many as a feather has barbs; each carries the numbers of the barbs in it, by which
rays find these one by one, with their ends (barb_kernels.py).

A vane that may part has two points where the upper edge of a strip of the mesh meets the next row
(splits.py). Barbs between the two rows are those of P, and where the edge is d_j
away from the row they go along with it, by the part of the strip that lies below them.

The look of barbs and plumage adds clumps, frizz, water, and shading as one surface. Light that
enters plumage is scattered by many vanes before it leaves, so that neighbours are lit alike. Each
feather has a normal of the plumage about it at a few places along its rachis, the mean over vanes
near there that look the same way, towards which its own normals are drawn. Barbs have the look of
their feather as in feather/barb_looks.py, with the slopes that shading needs.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from featherfx.algebra.interpolation import faded
from featherfx.algebra.types import Array, Floats, Indices
from featherfx.algebra.vectors import unit
from featherfx.feather.barb_looks import WET_SHAPE, clump_fraction, draws_of, middle_barbs
from featherfx.feather.density import hermite_weights
from featherfx.groom.materials import BarbLook
from featherfx.render.barb_kernels import colour_vanes
from featherfx.render.geometry import DrawnGrid, Geometry, Topology, geometry_of
from featherfx.render.light_kernels import RACHIS_MATERIAL, VANE

_ROOT_PLACE = 0.05  # place on a barb, up to which its slope is that here


class BarbStrips(NamedTuple):
    """Strips of n feathers, (n, B, 2 S + 1, 3) each: points of the one edge, of the other, the tip.

    along, tangents: derivatives of points along the shaft and along the barb.
    """

    points: Array
    along: Array
    tangents: Array


def dressed(
    strips: BarbStrips, look: BarbLook, draws: Sequence[int], inner: Array, roots: Array
) -> BarbStrips:
    """Strips with a look. draws: (n,) numbers by which each feather draws. inner: (S,) places of
    the edges' points on a barb, the tip at 1. roots: (B,) places of barbs on the shaft."""
    random = [draws_of(look, draw, len(roots)) for draw in draws]
    lengths = np.stack([each.lengths for each in random])
    waves = 2.0 * np.pi * np.stack([each.waves for each in random])
    phases = np.stack([each.phases for each in random], axis=1)
    strips = BarbStrips(*(_shortened(each, inner, lengths) for each in strips))
    strips = strips._replace(tangents=strips.tangents * lengths[..., None])
    place = np.concatenate([inner, inner, [1.0]])
    points, tangents = _clumped(strips, look, place, roots)
    angle = waves * place + phases
    far = look.frizz * place * np.sin(angle)
    rate = look.frizz * (np.sin(angle) + place * waves * np.cos(angle))
    for way, own, change in zip(_ways(strips), far, rate, strict=True):
        points, tangents = points + own[..., None] * way, tangents + change[..., None] * way
    return BarbStrips(points, strips.along, tangents)


def soaked(strips: BarbStrips, wet: Array, inner: Array, roots: Array) -> BarbStrips:
    """Strips whose ends water draws together. wet: (n, 2) how far, and in how many clumps. inner,
    roots: as of dressed."""
    some = wet[wet[:, 0] > 0.0]
    if not len(some):
        return strips
    place, drawn = np.concatenate([inner, inner, [1.0]]), BarbStrips(*(s.copy() for s in strips))
    for amount, clumps in np.unique(some, axis=0):
        own = (wet == (amount, clumps)).all(axis=1)
        look = BarbLook(clump=amount, clump_count=int(clumps), clump_shape=WET_SHAPE)
        mine = BarbStrips(*(each[own] for each in strips))
        drawn.points[own], drawn.tangents[own] = _clumped(mine, look, place, roots)
    return drawn


def _shortened(values: Array, inner: Array, lengths: Array) -> Array:
    """Values of strips of which only the first part is left. lengths: (n, B, 1) parts."""
    knots, stations = np.append(inner, 1.0), len(inner)
    place = lengths * knots
    low = np.clip(np.searchsorted(knots, place, side="right") - 1, 0, stations - 1)
    part = ((place - knots[low]) / np.diff(knots)[low])[..., None]
    edges = []
    for edge in (values[:, :, :stations], values[:, :, stations:-1]):
        whole = np.concatenate([edge, values[:, :, -1:]], axis=2)
        below, above = (np.take_along_axis(whole, (low + k)[..., None], axis=2) for k in (0, 1))
        edges.append(below + part * (above - below))
    tips = 0.5 * (edges[0] + edges[1])[:, :, -1:]
    return np.concatenate([edges[0][:, :, :-1], edges[1][:, :, :-1], tips], axis=2)


def _clumped(strips: BarbStrips, look: BarbLook, place: Array, roots: Array) -> tuple[Array, Array]:
    """Points and tangents of strips drawn towards the line of the middle barb of their clump."""
    middle = middle_barbs(np.zeros(len(roots), dtype=np.int64), roots, look.clump_count)
    fraction = clump_fraction(look, place)[:, None]
    # barbs that leave the shaft towards each other have no finite slope there
    slope = np.maximum(place, _ROOT_PLACE) ** (look.clump_shape - 1.0)
    rate = (look.clump * look.clump_shape * slope)[:, None]
    lines = [_line(each)[:, middle] - each for each in (strips.points, strips.tangents)]
    points = strips.points + fraction * lines[0]
    return points, strips.tangents + fraction * lines[1] + rate * lines[0]


def _line(values: Array) -> Array:
    """Mean of both edges."""
    stations = values.shape[2] // 2
    middle = 0.5 * (values[:, :, :stations] + values[:, :, stations:-1])
    return np.concatenate([middle, middle, values[:, :, -1:]], axis=2)


def _ways(strips: BarbStrips) -> tuple[Array, Array]:
    """Unit vectors across the barbs in the vane, and out of it."""
    barb = unit(strips.tangents)
    across = strips.along - (strips.along * barb).sum(axis=-1, keepdims=True) * barb
    return unit(across), unit(np.cross(strips.along, strips.tangents))


_PLACES = 4  # along a feather, at the middles of as many equal parts of it
_NEAR = 32  # places of vanes that are looked at
_MOST = 0.75  # how far normals are drawn towards the coat's, at most
_SMALL = 120.0  # pixels, length of a feather up to which they are


def coat_fractions(pixels: Array) -> Array:
    """(N,) how far the normals of feathers are drawn towards the coat's. pixels: (N,) lengths."""
    return np.asarray(_MOST * np.minimum(_SMALL / np.maximum(pixels, 1e-9), 1.0))


def coat_normals(points: Array, triangles: Indices, owner: Indices, heights: Array) -> Array:
    """(N, _PLACES, 3) units, dorsal, of the coat about each feather; zero where it has no vane.

    points: (V, 3) m. triangles: (T, 3) of vanes. owner: (T,) feather, ascending, N of the last and
    1. heights: (T,) of the triangles' middles, 0 to 1 along the feather.
    """
    first, second, third = (points[triangles[:, k]] for k in range(3))
    crossed = np.cross(second - first, third - first)
    count = _PLACES * (int(owner[-1]) + 1)
    cell = _PLACES * owner + np.minimum((heights * _PLACES).astype(np.int64), _PLACES - 1)
    area = np.linalg.norm(crossed, axis=1)
    middles = _summed((first + second + third) / 3.0 * area[:, None], cell, count)
    own = unit(_summed(crossed, cell, count))
    total = np.bincount(cell, area, count)
    there = np.flatnonzero(total > 0.0)
    places = middles[there] / total[there, None]
    distance, near = cKDTree(places).query(places, k=min(_NEAR, len(places)))
    distance, near = distance.reshape(len(places), -1), near.reshape(len(places), -1)
    reach = np.maximum(distance[:, [-1]], 1e-12)
    alike = np.einsum("nc,nkc->nk", own[there], own[there][near])
    weight = (1.0 - 0.9 * (distance / reach) ** 2) * np.maximum(alike, 0.0)
    result = np.zeros((count, 3))
    result[there] = unit(np.einsum("nk,nkc->nc", weight, own[there][near]))
    return result.reshape(-1, _PLACES, 3)


def _summed(values: Array, cell: Indices, count: int) -> Array:
    """(count, 3) sums of values (T, 3) by cell."""
    return np.stack([np.bincount(cell, values[:, k], count) for k in range(3)], axis=1)


def drawn_towards(normals: Array, coat: Array, heights: Array, fractions: Array) -> Array:
    """Normals (n, B, S, 3) of barbs at heights (B,) of n feathers, drawn towards those of the coat.

    coat: (n, _PLACES, 3). fractions: (n,).
    """
    at = np.clip(heights * _PLACES - 0.5, 0.0, _PLACES - 1.0)
    low = np.minimum(at.astype(int), _PLACES - 2)
    part = (at - low)[:, None]
    there = ((1.0 - part) * coat[:, low] + part * coat[:, low + 1])[:, :, None]
    own = unit(normals)
    own = np.where((own * there).sum(axis=-1, keepdims=True) < 0.0, -own, own)
    return mixed(own, there, fractions)


def mixed(first: Array, second: Array, fractions: Array) -> Array:
    """(n, ...) units between first and second (n, B, S, 3). fractions: (n,) of the second."""
    part = fractions[:, None, None, None]
    return np.asarray(unit((1.0 - part) * first + part * second))


# by eye: how round barbs are shaded where each is as wide as so many pixels; barbs' distances over
# which ends are free where they hook, parts of a barb that this may be, and where they do not
_ROUND, _ROUND_FROM, _ROUND_AT = 0.85, 1.2, 5.0
_FREE, _MIN_FREE, _MAX_FREE, _UNHOOKED = 4.5, 0.02, 0.24, 1.2
_TAPER = 1e-3  # part of a strip's length that is its blunt end
_DRAWS = 61  # of numbers of barbs, by which feathers' ends differ


@dataclass(frozen=True)
class StripGroup:
    """Feathers of one topology, one number of strips and one look. members: (n,) of the scene.
    barbs: strips of a vane. stations: points along a barb. real: barbs of a vane. wide: pixels of
    each. draws: (n,) by which each feather draws what is random of the look."""

    members: Indices
    topology: Topology
    barbs: int
    stations: int
    real: int
    wide: float
    look: BarbLook
    draws: Sequence[int]
    numbers: Sequence[int]

    @property
    def round(self) -> float:
        """The finer barbs are, the less each stands out."""
        return _ROUND * float(faded((self.wide - _ROUND_FROM) / (_ROUND_AT - _ROUND_FROM)))


def shades_of(colours: Array, ahead: Array | None, vane: DrawnGrid, group: StripGroup) -> Floats:
    """(n, B, 2 S + 1, 3) colours of strips.

    colours: (n, R, C, 3) linear, of a vane's vertices. ahead: (n, R, C) how far along the shaft
    these are, as a share of its length, or None: colours are interpolated within the grid.
    """
    edges, middles, inner = _places(vane, group)
    parts = []
    for along, across in ((edges, inner), (middles, np.ones(1))):
        rows, columns = weights_at(vane.heights, along)[0], weights_at(vane.places, across)[0]
        if ahead is None:
            parts.append(_blend(colours, rows, columns).clip(0.0, 1.0))
            continue
        distances = np.ascontiguousarray(_blend(ahead[..., None], rows, columns)[..., 0])
        place = np.interp(across, vane.places, np.arange(len(vane.places)))
        found = np.zeros((*distances.shape, 3))
        colour_vanes(ahead, np.ascontiguousarray(colours, dtype=float), distances, place, found)
        parts.append(found)
    return _of_strips(*parts).astype(np.float32)


def _places(vane: DrawnGrid, group: StripGroup) -> tuple[Array, Array, Array]:
    """Heights (B + 1,) between strips and (B,) of their middles, places (S,) on a barb."""
    edges = np.linspace(vane.heights[0], vane.heights[-1], group.barbs + 1)
    return edges, 0.5 * (edges[1:] + edges[:-1]), np.linspace(0.0, 1.0 - _TAPER, group.stations)


def _of_strips(between: Array, ends: Array, away: Array | float = 0.0) -> Array:
    """(n, B, 2 S + 1, K) of strips, of values between them (n, B + 1, S, K) and at their ends (n,
    B, 1, K)."""
    both = np.stack([between[:, :-1], between[:, 1:]], axis=2)
    whole = both.reshape(len(between), ends.shape[1], 2 * between.shape[2], -1)
    return np.asarray(np.concatenate([whole, ends], axis=2) + away)


class PosedVane(NamedTuple):
    """One vane of n feathers. grid: (n, R, C, 3). shades: of shades_of. parted: (n, R - 1, C, 3),
    how far the strips' upper edges are from the rows above them. loose: (n, R, C) share of hooks
    that are open. film: (n, R, C) nm. wet: (n, 2) as of Cache.clumped_of. coat:
    (n, PLACES, 3) and coated: (n,) as of drawn_towards."""

    grid: Array
    parted: Array | None
    shades: Floats
    loose: Array
    film: Floats | None
    wet: Array
    coat: Array
    coated: Array


def strips_of(posed: PosedVane, vane: DrawnGrid, group: StripGroup) -> Geometry:
    """The barbs of one vane."""
    grid, parted, shades, loose, film, wet, coat, coated = posed
    heights, places, stations = vane.heights, vane.places, group.stations
    edges, middles, inner = _places(vane, group)
    sheet = _patch(grid, (heights, edges), (places, inner))
    tips = _patch(grid, (heights, middles), (places, np.ones(1)))
    away: Sequence[Array | float] = (0.0, 0.0, 0.0)
    if parted is not None:
        away = _away(parted, vane, edges, inner)
    strips = BarbStrips(*(_of_strips(*each) for each in zip(sheet, tips, away, strict=True)))
    if group.look.moves_barbs:
        strips = dressed(strips, group.look, group.draws, inner, middles)
    strips = soaked(strips, wet, inner, middles)
    facing = np.cross(strips.along, strips.tangents)
    facing = drawn_towards(facing, coat, middles, coated)
    glossy = mixed(unit(strips.tangents), unit(strips.along), coated)
    points, normals, tangents, colours = (
        each.reshape(-1, 3).astype(np.float32) for each in (strips.points, facing, glossy, shades)
    )
    triangles, strip = _strip_triangles(stations), 2 * stations + 1
    own = np.arange(len(points) // strip)[:, None, None] * strip + triangles
    open_share = np.zeros((len(grid), group.barbs, strip))
    if loose.any():
        rows, columns = weights_at(heights, middles)[0], weights_at(places, inner)[0]
        there = _blend(loose[..., None], rows, columns)[..., 0].clip(0.0, 1.0)
        open_share = np.concatenate([there, there, there[:, :, -1:]], axis=2)
    reach = np.linalg.norm(grid[:, :, -1] - grid[:, :, 0], axis=2).max()
    spine = np.linalg.norm(grid[:, -1, 0] - grid[:, 0, 0], axis=1).max()
    return Geometry(
        points=points,
        triangles=own.reshape(-1, 3).astype(np.int32),
        material=np.full(own.size // 3, VANE, dtype=np.uint8),
        normals=normals,
        tangents=tangents,
        colours=colours,
        barbs=_numbered(group, inner, open_share, float(spine / max(reach, 1e-9)), film),
    )


def _numbered(
    group: StripGroup, inner: Array, loose: Array, slender: float, film: Floats | None
) -> Floats:
    """(n B (2 S + 1), 5) barbs of Geometry. inner: (S,) places on a barb. loose: (n, B, 2 S + 1)
    and film: (n, R, C) as of PosedVane. slender: length of a vane over that of its barbs."""
    stations, step = len(inner), group.real / group.barbs
    strip = step * np.arange(group.barbs)[:, None]
    found = np.zeros((*loose.shape, 5), np.float32)
    offset = (group.real + 2) * (np.array(group.numbers) % _DRAWS)
    up = np.concatenate([np.zeros(stations), np.full(stations, step), [0.5 * step]])
    found[..., 0] = offset[:, None, None] + strip + up
    found[..., 1] = np.concatenate([inner, inner, [1.0]])
    found[..., 2] = group.round
    least = min(max(_FREE * slender / group.real, _MIN_FREE), _MAX_FREE)
    least = max(least, group.look.loose)
    found[..., 3] = least + (_UNHOOKED - least) * loose
    if film is not None:
        # none between two, which would have other colours
        row = np.linspace(0, film.shape[1] - 1, group.barbs).round().astype(int)
        column = (found[0, 0, :, 1] * (film.shape[2] - 1)).round().astype(int)
        found[..., 4] = film[:, row[:, None], column]
    return found.reshape(-1, 5)


def _away(parted: Array, vane: DrawnGrid, edges: Array, inner: Array) -> tuple[Array, Array, Array]:
    """(n, B, 2 S + 1, 3) m, how far the points of drawn barbs go along with their strips, and its
    derivatives along rows and columns. parted: of _strips. edges: (B + 1,) heights between barbs.
    inner: (S,) places on a barb."""
    heights, stations = vane.heights, len(inner)
    middle = 0.5 * (edges[1:] + edges[:-1])
    strip = np.searchsorted(heights, middle, side="right") - 1
    strip = np.clip(strip, 0, len(heights) - 2)
    size = np.diff(heights)[strip]
    at = np.stack([edges[:-1], edges[1:], middle], axis=1)
    part = np.clip((at - heights[strip, None]) / size[:, None], 0.0, 1.0)
    # of the points of a strip: its one edge, the other, and the tip
    part = np.repeat(part, [stations, stations, 1], axis=1)[None, :, :, None]
    weights, slopes = hermite_weights(vane.places, np.concatenate([inner, inner, [1.0]]))
    whole, turned = (np.einsum("nbcx,sc->nbsx", parted[:, strip], w) for w in (weights, slopes))
    return part * whole, whole / size[:, None, None], part * turned


@lru_cache
def _strip_triangles(stations: int) -> Indices:
    """(T, 3) of a strip: the points of its one edge, of the other, and its tip."""
    low = np.arange(stations - 1)
    high = low + stations
    first = np.stack([low, high, low + 1], axis=1)
    second = np.stack([high, high + 1, low + 1], axis=1)
    tip = np.array([[stations - 1, 2 * stations - 1, 2 * stations]])
    return np.concatenate([first, second, tip])


def _patch(
    grid: Array, rows: tuple[Array, Array], columns: tuple[Array, Array]
) -> tuple[Array, Array, Array]:
    """(n, T, S, 3) values, and derivatives along rows and columns, of grids (n, R, C, 3).

    rows, columns: knots of the grid, and places to evaluate at.
    """
    along, along_slopes = weights_at(*rows)
    across, across_slopes = weights_at(*columns)
    values = _blend(grid, along, np.concatenate([across, across_slopes]))
    count = len(across)
    return values[:, :, :count], _blend(grid, along_slopes, across), values[:, :, count:]


def _blend(grid: Array, along: Array, across: Array) -> Array:
    """(n, T, S, K) of grids (n, R, C, K) with weights along rows (T, R) and columns (S, C)."""
    count, rows, columns, each = grid.shape
    # few large products of matrices
    by_row = grid.swapaxes(2, 3).reshape(count, rows, each * columns)
    between = (along @ by_row).reshape(count, len(along), each, columns)
    return np.asarray((between @ across.T).swapaxes(2, 3))


def weights_at(knots: Array, places: Array) -> tuple[Array, Array]:
    """hermite_weights, kept from pose to pose."""
    return _kept_weights(knots.tobytes(), places.tobytes())


@lru_cache(maxsize=4096)
def _kept_weights(knots: bytes, places: bytes) -> tuple[Array, Array]:
    return hermite_weights(np.frombuffer(knots), np.frombuffer(places))


def tubes_of(rings: Array, heights: Array, barbs: int, colours: Array) -> Geometry:
    """Shafts of n feathers, from rings (n, R, M, 3) of vertices, as fine as the barbs are many.

    colours: (n, R, 3) linear.
    """
    count, rows, sides = rings.shape[:3]
    around = int(np.clip(barbs // 4, 4, 16))
    places = np.linspace(heights[0], heights[-1], int(np.clip(barbs // 2, 4, 3 * rows - 2)))
    along, along_slopes = weights_at(heights, places)
    circle, circle_slopes = _circle_weights(sides, around)

    def product(first: Array, second: Array) -> Floats:
        return _blend(rings, first, second).reshape(-1, 3).astype(np.float32)

    tangents = product(along_slopes, circle)
    ring = np.arange(around)
    after = (ring + 1) % around
    cell = np.concatenate(
        [
            np.stack([ring, after, ring + around], 1),
            np.stack([after, after + around, ring + around], 1),
        ]
    )
    start = np.arange(count)[:, None] * len(places) + np.arange(len(places) - 1)
    triangles = (start.reshape(-1, 1, 1) * around + cell).reshape(-1, 3)
    shape = geometry_of(
        product(along, circle), triangles, RACHIS_MATERIAL,
        np.cross(tangents, product(along, circle_slopes)),
        np.repeat((along @ colours).clip(0.0, 1.0).reshape(-1, 3), around, axis=0),
    )  # fmt: skip
    return replace(shape, tangents=tangents)


@lru_cache
def _circle_weights(sides: int, around: int) -> tuple[Array, Array]:
    """(around, sides) of an ellipse through vertices evenly spaced around it, and its slopes."""
    own = 2 * np.pi * np.arange(sides) / sides
    angle = 2 * np.pi * np.arange(around)[:, None] / around - own
    return (1 + 2 * np.cos(angle)) / sides, -2 * np.sin(angle) / sides
