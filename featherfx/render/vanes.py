r"""Feathers as they look: every barb a thin strip with a round face, shafts as smooth tubes.

The vertices of a vane are a grid of R rows along the shaft times C columns along a barb (`st` tells
which is which). Between them

    P(t, s) = sum_ij W_i(t) V_j(s) x_ij

with the cubic weights of featherfx/feather/density.py, t the height of the barb's root, s the place
on the barb: linear in the vertices, so feathers of one topology are one product of matrices. A
strip lies between the lines of half a spacing before and behind its barb and runs to a point at the
barb's end, which is what makes the vane's outline. As many barbs are drawn as a picture can show,
at most as many as a feather has.

A vane that may part has two points where the upper edge of a strip of the mesh meets the next row
(featherfx/feather/lips.py). Barbs between the two rows are those of P, and where the edge is d_j
away from the row they go along with it, by the part of the strip that lies below them.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from typing import NamedTuple

import numpy as np

from featherfx.algebra.types import Array, Floats, Indices
from featherfx.algebra.vectors import unit
from featherfx.feather.density import hermite_weights
from featherfx.feather.types import LEADING, RACHIS, TRAILING
from featherfx.files.content import stable_number
from featherfx.groom.looks import BarbLook
from featherfx.render.barb_looks import BarbStrips, dressed, soaked
from featherfx.render.coat import coat_fractions, coat_normals, drawn_towards, mixed
from featherfx.render.geometry import Geometry, geometry_of, joined, vertex_normals
from featherfx.render.light_kernels import SHAFT, SKIN, VANE
from featherfx.usd.read.cached_feather import CachedFeather

_SPACING = 4.5  # pixels from one barb to the next, at least
_REAL_SPACING = 5e-4  # m, where a mesh does not tell: between contour and flight feathers'
_STATION = 6.0  # pixels between two points of a barb
_MOST_BARBS = 1200.0
_STEP = 1.3  # between numbers of barbs, so that feathers of about one size share their weights
_ROUND, _ROUND_FAR = 0.90, 0.12  # how round barbs are shaded where each is drawn, and where not


class DrawnGrid(NamedTuple):
    """A vane's vertices from the shaft outwards. rows: (R, C). edges: (R - 1, C), upper edges of
    the strips between them; None where these are the rows. heights: (R,). places: (C,), on the
    barb."""

    rows: Indices
    edges: Indices | None
    heights: Array
    places: Array


@dataclass(frozen=True)
class Topology:
    """How the vertices of a mesh make up a feather.

    vanes: of each side. shaft: (R, M) vertices around the shaft and heights (R,); None where it has
    none.
    """

    vanes: tuple[DrawnGrid, ...]
    shaft: tuple[Indices, Array] | None


def topology_of(feather: CachedFeather) -> Topology | None:
    """None where the mesh is no feather with rows of barbs, such as one of another program."""
    if feather.st is None:
        return None
    vanes = []
    for side in (LEADING, TRAILING):
        if (feather.side == side).any():
            triangles = feather.triangles[feather.side == side]
            grid = _vane_grid(feather.st, triangles) or _parting_grid(feather.st, triangles)
            if grid is None:
                return None
            vanes.append(grid)
    shaft = None
    if (feather.side == RACHIS).any():
        shaft = _shaft_rings(feather.st, feather.triangles[feather.side == RACHIS])
        if shaft is None:
            return None
    return Topology(tuple(vanes), shaft) if vanes and shaft else None


def _vane_grid(st: Floats, triangles: Indices) -> DrawnGrid | None:
    """None where rows are no barbs of one number of vertices, one for each place."""
    rows = _rows(st, np.unique(triangles))
    grid = _ordered(st, rows)
    if grid is None:
        return None
    widest = int(np.argmax([len(row) for row in rows]))
    places = np.abs(st[grid[widest], 0] - 0.5).astype(float)
    places = (places - places[0]) / max(places[-1] - places[0], 1e-12)
    heights = st[grid[:, 0], 1].astype(float)
    return DrawnGrid(grid, None, heights, places) if (np.diff(places) > 0).all() else None


def _parting_grid(st: Floats, triangles: Indices) -> DrawnGrid | None:
    """As _vane_grid, of a vane that may part: each strip has edges of its own."""
    heights = st[triangles, 1]
    low, high = heights.min(axis=1), heights.max(axis=1)
    lower, upper = [], []
    for height in np.unique(low):
        strip = low == height
        vertices = np.unique(triangles[strip])
        own = st[vertices, 1]
        if len(np.unique(high[strip])) != 1 or len(np.unique(own)) != 2:
            return None
        lower.append(vertices[own == height])
        upper.append(vertices[own != height])
    rows = _ordered(st, [*lower, upper[-1]])
    edges = _ordered(st, upper)
    if rows is None or edges is None or rows.shape[1] != edges.shape[1]:
        return None
    whole = _vane_grid(st, rows)
    return None if whole is None else whole._replace(edges=edges)


def _ordered(st: Floats, rows: Sequence[Indices]) -> Indices | None:
    """(R, C) vertices of rows from the shaft outwards, or None."""
    count = max((len(row) for row in rows), default=0)
    if count < 2 or len(rows) < 2:
        return None
    ordered = []
    for row in rows:
        if len(row) == 1:
            # base or tip, where barbs have no length
            row = np.repeat(row, count)
        if len(row) != count:
            return None
        ordered.append(row[np.argsort(np.abs(st[row, 0] - 0.5), kind="stable")])
    return np.array(ordered)


def _shaft_rings(st: Floats, triangles: Indices) -> tuple[Indices, Array] | None:
    rows = _rows(st, np.unique(triangles))
    sizes = [len(row) for row in rows]
    count = max(set(sizes), key=sizes.count)
    # a cap's middle stands behind the ring that it closes
    rings = [row[:count] for row in rows if len(row) in (count, count + 1)]
    if count < 3 or len(rings) != len(rows) or len(rings) < 2:
        return None
    grid = np.array(rings)
    return grid, st[grid[:, 0], 1].astype(float)


def _rows(st: Floats, vertices: Indices) -> list[Indices]:
    """Vertices of one height each, from the base on, in their own order."""
    _, inverse = np.unique(st[vertices, 1], return_inverse=True)
    return [vertices[inverse == k] for k in range(int(inverse.max()) + 1)]


@dataclass(frozen=True)
class _Group:
    """Feathers of one topology, one number of barbs and one look. members: (n,) of the scene.
    barbs: of a vane. stations: points along a barb. fraction: of the feather's barbs that are
    drawn, at most 1. draws: (n,) by which each feather draws what is random of the look."""

    members: Indices
    topology: Topology
    barbs: int
    stations: int
    fraction: float
    look: BarbLook
    draws: Sequence[int]

    @property
    def round(self) -> float:
        """The fewer of the barbs are drawn, the less each stands out."""
        return _ROUND_FAR + (_ROUND - _ROUND_FAR) * self.fraction


def _heights(feather: CachedFeather) -> Floats:
    """(V,) of a feather with barbs, along it."""
    assert feather.st is not None
    return feather.st[:, 1]


@dataclass(frozen=True)
class DrawnPlumage:
    """The feathers of a scene, grouped once for all poses of one camera's pictures.

    feathers: as read. starts: (N + 1,) first point of each. groups: of those with barbs. plain: the
    others. colours: (N, 3) linear, of feathers without a colour of their own. shaft, skin: (3,)
    linear, of shafts, and of others without a colour of their own. coated: (N,) how far feathers
    are lit as the coat that they are of.
    """

    feathers: tuple[CachedFeather, ...]
    starts: Indices
    groups: tuple[_Group, ...]
    plain: Indices
    colours: Array
    shaft: Array
    skin: Array
    coated: Array

    @cached_property
    def _faces(self) -> tuple[Indices, Indices, Array]:
        """Triangles (T, 3) of all vanes, their feathers (T,), and how high (T,) along these."""
        barbed = np.sort(np.concatenate([group.members for group in self.groups]))
        own = [(k, self.feathers[k], self.feathers[k].side != RACHIS) for k in barbed]
        triangles = [each.triangles[vane] for _, each, vane in own]
        heights = [
            _heights(each)[faces].mean(axis=1)
            for (_, each, _), faces in zip(own, triangles, strict=True)
        ]
        return (
            np.concatenate([f + self.starts[k] for (k, *_), f in zip(own, triangles, strict=True)]),
            np.repeat(barbed, [len(faces) for faces in triangles]),
            np.concatenate(heights),
        )

    def geometry(self, points: Array, wet: Array | None = None) -> Geometry:
        """All feathers of a pose, points (V, 3) m. wet: (N, 2) of Cache.clumped_of; None: dry."""
        wet = np.zeros((len(self.feathers), 2)) if wet is None else wet
        return joined([*self._plain(points), *self._grouped(points, wet)])

    def _plain(self, points: Array) -> Iterator[Geometry]:
        for member in self.plain:
            feather, start, end = self.feathers[member], *self.starts[member : member + 2]
            mine, triangles = points[start:end], feather.triangles
            colour = self.skin if feather.colour is None else feather.colour
            normals = vertex_normals(mine, triangles)
            yield geometry_of(mine, triangles, SKIN, normals, colour)

    def _grouped(self, points: Array, wet: Array) -> Iterator[Geometry]:
        if not self.groups:
            return
        coat = coat_normals(points, *self._faces)
        for group in self.groups:
            at = self.starts[group.members]
            for grid in group.topology.vanes:
                mine = points[at[:, None, None] + grid.rows]
                parted = None
                if grid.edges is not None:
                    parted = points[at[:, None, None] + grid.edges] - mine[:, 1:]
                colours = self._colours(group.members, grid.rows)
                about = (each[group.members] for each in (wet, coat, self.coated))
                yield _strips(_PosedVane(mine, parted, colours, *about), grid, group)
            if group.topology.shaft is not None:
                rings, heights = group.topology.shaft
                shafts = self._shafts(group.members, rings)
                yield _tubes(points[at[:, None, None] + rings], heights, group.barbs, shafts)

    def _colours(self, members: Indices, grid: Indices) -> Array:
        """(n, R, C, 3) linear colours of a vane's vertices."""
        each, shape = ((k, self.feathers[k].colour) for k in members), (*grid.shape, 3)
        return np.stack(
            [np.broadcast_to(self.colours[k] if c is None else c[grid], shape) for k, c in each]
        )

    def _shafts(self, members: Indices, rings: Indices) -> Array:
        """(n, 3) linear colours of shafts: the feather's, where it is not of one colour."""
        own = [self.feathers[k].colour for k in members]
        return np.stack(
            [
                self.shaft if c is None or (c == c[0]).all() else c[rings].mean(axis=(0, 1))
                for c in own
            ]
        )


def plumage_of(
    feathers: Sequence[CachedFeather],
    starts: Indices,
    pixels: Array,
    colours: tuple[Array, Array, Array],
    own: bool,
) -> DrawnPlumage:
    """Feathers grouped by what they share.

    pixels: (N, 3): length of the feather in pixels and in metres, and of its barbs in pixels.
    starts: as of DrawnPlumage. colours: its colours, shaft and skin. own: whether feathers with
    colours of their own keep them.
    """
    known: dict[tuple[bytes, ...], Topology | None] = {}
    groups: dict[tuple[int, tuple[int, int], BarbLook], list[int]] = {}
    real = np.array(
        [f.barb_count or m / _REAL_SPACING for f, m in zip(feathers, pixels[:, 1], strict=True)]
    )
    found: dict[int, Topology] = {}
    plain = []
    for index, feather in enumerate(feathers):
        st = b"" if feather.st is None else feather.st.tobytes()
        key = (st, feather.side.tobytes(), feather.triangles.tobytes())
        if key not in known:
            known[key] = topology_of(feather)
        topology = known[key]
        if topology is None:
            plain.append(index)
            continue
        found[id(topology)] = topology
        sort = id(topology), _detail(pixels[index], real[index]), feather.look
        groups.setdefault(sort, []).append(index)
    return DrawnPlumage(
        feathers=tuple(feathers) if own else tuple(replace(f, colour=None) for f in feathers),
        starts=starts,
        groups=tuple(
            _Group(
                members=np.array(members),
                topology=found[key],
                barbs=barbs,
                stations=stations,
                fraction=min(1.0, barbs / float(np.median(real[members]))),
                look=look,
                draws=[stable_number(feathers[k].id) % look.variants for k in members],
            )
            for (key, (barbs, stations), look), members in groups.items()
        ),
        plain=np.array(plain, dtype=np.int64),
        colours=colours[0],
        shaft=colours[1],
        skin=colours[2],
        coated=coat_fractions(pixels[:, 0]),
    )


def _detail(pixels: Array, real: float) -> tuple[int, int]:
    """Barbs of a vane that has so many, and points along one, for a row of `pixels` of
    plumage_of."""
    length, _, barb = pixels
    barbs = min(length / _SPACING, real, _MOST_BARBS)
    steps = max(int(np.log(max(barbs, 1.0)) / np.log(_STEP)), 7)
    stations = np.clip(2 ** np.ceil(np.log2(max(barb, 1.0) / _STATION)), 2, 16)
    return round(_STEP**steps), int(stations) + 1


class _PosedVane(NamedTuple):
    """One vane of n feathers. grid, colours: (n, R, C, 3). parted: (n, R - 1, C, 3), how far the
    strips' upper edges are from the rows above them. wet: (n, 2) as of Cache.clumped_of. coat:
    (n, PLACES, 3) and coated: (n,) as of drawn_towards."""

    grid: Array
    parted: Array | None
    colours: Array
    wet: Array
    coat: Array
    coated: Array


def _strips(posed: _PosedVane, vane: DrawnGrid, group: _Group) -> Geometry:
    """The barbs of one vane."""
    grid, parted, colours, wet, coat, coated = posed
    heights, places = vane.heights, vane.places
    count, barbs, stations = len(grid), group.barbs, group.stations
    edges = np.linspace(heights[0], heights[-1], barbs + 1)
    middles = 0.5 * (edges[1:] + edges[:-1])
    reach = np.linalg.norm(grid[:, :, -1] - grid[:, :, 0], axis=2).max()
    spine = np.linalg.norm(grid[:, -1, 0] - grid[:, 0, 0], axis=1).max()
    taper = float(np.clip(1.5 * group.fraction * spine / barbs / max(reach, 1e-12), 1e-3, 0.25))
    inner = np.linspace(0.0, 1.0 - taper, stations)
    sheet = _patch(grid, (heights, edges), (places, inner))
    tips = _patch(grid, (heights, middles), (places, np.ones(1)))
    shades, tip_shades = (
        _blend(colours, _weights(heights, along)[0], _weights(places, across)[0]).clip(0.0, 1.0)
        for along, across in ((edges, inner), (middles, np.ones(1)))
    )

    def of_strips(between: Array, ends: Array, away: Array | float = 0.0) -> Array:
        both = np.stack([between[:, :-1], between[:, 1:]], axis=2)
        whole = both.reshape(count, barbs, 2 * stations, 3)
        return np.asarray(np.concatenate([whole, ends], axis=2) + away)

    away: Sequence[Array | float] = (0.0, 0.0, 0.0)
    if parted is not None:
        away = _away(parted, vane, edges, inner)
    strips = BarbStrips(*(of_strips(*each) for each in zip(sheet, tips, away, strict=True)))
    if group.look != BarbLook():
        strips = dressed(strips, group.look, group.draws, inner, middles)
    strips = soaked(strips, wet, inner, middles)
    facing = np.cross(strips.along, strips.tangents)
    facing = drawn_towards(facing, coat, middles, coated)
    glossy = mixed(unit(strips.tangents), unit(strips.along), coated)
    points, normals, tangents, colour = (
        each.reshape(-1, 3).astype(np.float32)
        for each in (strips.points, facing, glossy, of_strips(shades, tip_shades))
    )
    each = np.concatenate([np.repeat([-group.round, group.round], stations), [0.0]])
    triangles = _strip_triangles(stations)
    own = np.arange(count * barbs)[:, None, None] * (2 * stations + 1) + triangles
    return Geometry(
        points=points,
        triangles=own.reshape(-1, 3).astype(np.int32),
        material=np.full(count * barbs * len(triangles), VANE, dtype=np.uint8),
        normals=normals,
        tangents=tangents,
        colours=colour,
        across=np.tile(each, count * barbs).astype(np.float32),
    )


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
    (along, along_slopes), (across, across_slopes) = _weights(*rows), _weights(*columns)
    values = _blend(grid, along, np.concatenate([across, across_slopes]))
    count = len(across)
    return values[:, :, :count], _blend(grid, along_slopes, across), values[:, :, count:]


def _blend(grid: Array, along: Array, across: Array) -> Array:
    """(n, T, S, 3) of grids (n, R, C, 3) with weights along rows (T, R) and columns (S, C)."""
    count, rows, columns, _ = grid.shape
    # few large products of matrices
    by_row = grid.swapaxes(2, 3).reshape(count, rows, 3 * columns)
    between = (along @ by_row).reshape(count, len(along), 3, columns)
    return np.asarray((between @ across.T).swapaxes(2, 3))


def _weights(knots: Array, places: Array) -> tuple[Array, Array]:
    """hermite_weights, kept from pose to pose."""
    return _kept_weights(knots.tobytes(), places.tobytes())


@lru_cache(maxsize=4096)
def _kept_weights(knots: bytes, places: bytes) -> tuple[Array, Array]:
    return hermite_weights(np.frombuffer(knots), np.frombuffer(places))


def _tubes(rings: Array, heights: Array, barbs: int, colours: Array) -> Geometry:
    """Shafts of n feathers, from rings (n, R, M, 3) of vertices, as fine as the barbs are many.

    colours: (n, 3) linear.
    """
    count, rows, sides = rings.shape[:3]
    around = int(np.clip(barbs // 4, 4, 16))
    places = np.linspace(heights[0], heights[-1], int(np.clip(barbs // 2, 4, 3 * rows - 2)))
    along, along_slopes = _weights(heights, places)
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
        product(along, circle), triangles, SHAFT,
        np.cross(tangents, product(along, circle_slopes)),
        np.repeat(colours, len(places) * around, axis=0),
    )  # fmt: skip
    return replace(shape, tangents=tangents)


@lru_cache
def _circle_weights(sides: int, around: int) -> tuple[Array, Array]:
    """(around, sides) of an ellipse through vertices evenly spaced around it, and its slopes."""
    own = 2 * np.pi * np.arange(sides) / sides
    angle = 2 * np.pi * np.arange(around)[:, None] / around - own
    return (1 + 2 * np.cos(angle)) / sides, -2 * np.sin(angle) / sides
