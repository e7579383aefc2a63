r"""Feathers as they look: barbs in thin strips, shafts as smooth tubes.

The vertices of a vane are a grid of R rows along the shaft times C columns along a barb (`st` tells
which is which). Between them

    P(t, s) = sum_ij W_i(t) V_j(s) x_ij

with the cubic weights of featherfx/feather/density.py, t the height of the barb's root, s the place
on the barb: linear in the vertices, so feathers of one topology are one product of matrices. A
strip lies between two lines of one t and ends where barbs do. There are as many as a picture can
show, at most as many as a feather has barbs; each carries the numbers of the barbs in it, by which
rays find these one by one, with their ends (barb_kernels.py).

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

from featherfx.algebra.ease import faded
from featherfx.algebra.types import Array, Floats, Indices
from featherfx.algebra.vectors import unit
from featherfx.feather.density import hermite_weights
from featherfx.feather.types import RACHIS
from featherfx.files.content import stable_number
from featherfx.groom.looks import BarbLook
from featherfx.render.barb_looks import BarbStrips, dressed, soaked
from featherfx.render.coat import coat_fractions, coat_normals, drawn_towards, mixed
from featherfx.render.geometry import Geometry, geometry_of, joined, vertex_normals
from featherfx.render.grids import DrawnGrid, Topology, topology_of
from featherfx.render.light_kernels import SHAFT, SKIN, VANE
from featherfx.render.pattern_kernels import colour_vanes
from featherfx.usd.read.cached_feather import CachedFeather

_SPACING = 4.5  # pixels from one barb to the next, at least
_REAL_SPACING = 5e-4  # m, where a mesh does not tell: between contour and flight feathers'
_STATION = 6.0  # pixels between two points of a barb
_MOST_BARBS = 1200.0
_STEP = 1.3  # between numbers of barbs, so that feathers of about one size share their weights
# by eye: how round barbs are shaded where each is as wide as so many pixels; barbs' distances over
# which ends are free where they hook, parts of a barb that this may be, and where they do not
_ROUND, _ROUND_FROM, _ROUND_AT = 0.85, 1.2, 5.0
_FREE, _LEAST_FREE, _MOST_FREE, _UNHOOKED = 4.5, 0.02, 0.24, 1.2
_TAPER = 1e-3  # part of a strip's length that is its blunt end
_SLIM, _STOUT = 0.6, 2.5  # pixels: shafts are not drawn below, and have their own colour above
_DRAWS = 61  # of numbers of barbs, by which feathers' ends differ


@dataclass(frozen=True)
class _Group:
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
    are lit as the coat that they are of. scales: (N,) pixels a metre.
    """

    feathers: tuple[CachedFeather, ...]
    starts: Indices
    groups: tuple[_Group, ...]
    plain: Indices
    colours: Array
    shaft: Array
    skin: Array
    coated: Array
    scales: Array

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

    @cached_property
    def _shades(self) -> list[list[Floats]]:
        """(n, B, 2 S + 1, 3) linear colours of the strips of each group's vanes."""
        return [
            [_shades_of(*self._coloured(group.members, grid), grid, group) for grid in vanes]
            for group in self.groups
            for vanes in (group.topology.vanes,)
        ]

    def geometry(
        self, points: Array, wet: Array | None = None, hooked: Array | None = None
    ) -> Geometry:
        """All feathers of a pose, points (V, 3) m. wet: (N, 2) of Cache.clumped_of; None: dry.
        hooked: of all triangles, of Cache.hooked_of; None: all are."""
        wet = np.zeros((len(self.feathers), 2)) if wet is None else wet
        loose = np.zeros(len(points))
        if hooked is not None:
            corners = np.concatenate(
                [f.triangles + k for f, k in zip(self.feathers, self.starts[:-1], strict=True)]
            ).ravel()
            around = np.maximum(np.bincount(corners, minlength=len(points)), 1)
            loose = np.bincount(corners, np.repeat(1.0 - hooked, 3), len(points)) / around
        return joined([*self._plain(points), *self._grouped(points, wet, loose)])

    def _plain(self, points: Array) -> Iterator[Geometry]:
        for member in self.plain:
            feather, start, end = self.feathers[member], *self.starts[member : member + 2]
            mine, triangles = points[start:end], feather.triangles
            colour = self.skin if feather.colour is None else feather.colour
            normals = vertex_normals(mine, triangles)
            yield geometry_of(mine, triangles, SKIN, normals, colour)

    def _grouped(self, points: Array, wet: Array, loose: Array) -> Iterator[Geometry]:
        if not self.groups:
            return
        coat = coat_normals(points, *self._faces)
        for group, shades in zip(self.groups, self._shades, strict=True):
            at = self.starts[group.members]
            for grid, shade in zip(group.topology.vanes, shades, strict=True):
                mine = points[at[:, None, None] + grid.rows]
                parted = None
                if grid.edges is not None:
                    parted = points[at[:, None, None] + grid.edges] - mine[:, 1:]
                about = (each[group.members] for each in (wet, coat, self.coated))
                free = loose[at[:, None, None] + grid.rows]
                film = self._film(group.members, grid.rows)
                yield _strips(_PosedVane(mine, parted, shade, free, film, *about), grid, group)
            if group.topology.shaft is not None:
                yield from self._shafts(group, points)

    def _film(self, members: Indices, grid: Indices) -> Floats | None:
        """(n, R, C) nm, of a vane's vertices; None where none of the feathers has a film."""
        each = [self.feathers[k].film for k in members]
        if all(film is None for film in each):
            return None
        return np.stack([np.zeros(grid.shape) if f is None else f[grid] for f in each])

    def _colours(self, members: Indices, grid: Indices) -> Array:
        """(n, R, C, 3) linear colours of a vane's vertices."""
        each, shape = ((k, self.feathers[k].colour) for k in members), (*grid.shape, 3)
        return np.stack(
            [np.broadcast_to(self.colours[k] if c is None else c[grid], shape) for k, c in each]
        )

    def _coloured(self, members: Indices, grid: DrawnGrid) -> tuple[Array, Array | None]:
        """Colours of a vane's vertices, and (n, R, C) how far along the shaft these are at rest, as
        a share of its length; None where a mesh does not tell, or all is of one colour."""
        colours, rests = self._colours(members, grid.rows), [self.feathers[k].rest for k in members]
        if (colours == colours[:, :1, :1]).all() or any(each is None for each in rests):
            return colours, None
        rest = np.stack([np.asarray(each, dtype=float)[grid.rows] for each in rests])
        roots = rest[:, :, 0]
        along = np.gradient(roots, axis=1)
        length = np.linalg.norm(along, axis=2).sum(axis=1) / np.ptp(grid.heights)
        ahead = np.einsum("nrcx,nrx->nrc", rest - roots[:, :, None], unit(along))
        ahead = grid.heights[:, None] + ahead / np.maximum(length, 1e-12)[:, None, None]
        return colours, np.maximum.accumulate(ahead, axis=1)

    def _shafts(self, group: _Group, points: Array) -> Iterator[Geometry]:
        """Those that are as wide as pixels; slim ones in the colour of the vane beside them."""
        assert group.topology.shaft is not None
        (rings, heights), vane = group.topology.shaft, group.topology.vanes[0]
        mine = points[self.starts[group.members][:, None, None] + rings]
        radius = np.linalg.norm(mine - mine.mean(axis=2, keepdims=True), axis=3).mean(axis=(1, 2))
        wide = 2.0 * radius * self.scales[group.members]
        # slim ones are seen where no vane is
        if not (drawn := (wide > _SLIM) | (vane.heights[0] > 0.5)).any():
            return
        members, part = group.members[drawn], (wide[drawn] - _SLIM) / (_STOUT - _SLIM)
        along = np.clip(heights, vane.heights[0], vane.heights[-1])
        beside = _weights(vane.heights, along)[0] @ self._colours(members, vane.rows)[:, :, 1]
        own = np.stack(
            [
                np.broadcast_to(self.shaft, (len(heights), 3))
                if c is None or (c == c[0]).all()
                else c[rings].mean(axis=1)
                for c in (self.feathers[k].colour for k in members)
            ]
        )
        colours = beside + faded(part)[:, None, None] * (own - beside)
        yield _tubes(mine[drawn], heights, group.barbs, colours.clip(0.0, 1.0))


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
                real=max(round(float(np.median(real[members]))), 1),
                wide=float(np.median(pixels[members, 0] / real[members])),
                look=look,
                draws=[stable_number(feathers[k].id) % look.variants for k in members],
                numbers=[stable_number(feathers[k].id) for k in members],
            )
            for (key, (barbs, stations), look), members in groups.items()
        ),
        plain=np.array(plain, dtype=np.int64),
        colours=colours[0],
        shaft=colours[1],
        skin=colours[2],
        coated=coat_fractions(pixels[:, 0]),
        scales=pixels[:, 0] / np.maximum(pixels[:, 1], 1e-12),
    )


def _detail(pixels: Array, real: float) -> tuple[int, int]:
    """Barbs of a vane that has so many, and points along one, for a row of `pixels` of
    plumage_of."""
    length, _, barb = pixels
    barbs = min(length / _SPACING, real, _MOST_BARBS)
    steps = max(int(np.log(max(barbs, 1.0)) / np.log(_STEP)), 7)
    stations = np.clip(2 ** np.ceil(np.log2(max(barb, 1.0) / _STATION)), 2, 16)
    return round(_STEP**steps), int(stations) + 1


def _shades_of(colours: Array, ahead: Array | None, vane: DrawnGrid, group: _Group) -> Floats:
    """(n, B, 2 S + 1, 3) colours of strips. colours, ahead: of _coloured."""
    edges, middles, inner = _places(vane, group)
    parts = []
    for along, across in ((edges, inner), (middles, np.ones(1))):
        rows, columns = _weights(vane.heights, along)[0], _weights(vane.places, across)[0]
        if ahead is None:
            parts.append(_blend(colours, rows, columns).clip(0.0, 1.0))
            continue
        distances = np.ascontiguousarray(_blend(ahead[..., None], rows, columns)[..., 0])
        place = np.interp(across, vane.places, np.arange(len(vane.places)))
        found = np.zeros((*distances.shape, 3))
        colour_vanes(ahead, np.ascontiguousarray(colours, dtype=float), distances, place, found)
        parts.append(found)
    return _of_strips(*parts).astype(np.float32)


def _places(vane: DrawnGrid, group: _Group) -> tuple[Array, Array, Array]:
    """Heights (B + 1,) between strips and (B,) of their middles, places (S,) on a barb."""
    edges = np.linspace(vane.heights[0], vane.heights[-1], group.barbs + 1)
    return edges, 0.5 * (edges[1:] + edges[:-1]), np.linspace(0.0, 1.0 - _TAPER, group.stations)


def _of_strips(between: Array, ends: Array, away: Array | float = 0.0) -> Array:
    """(n, B, 2 S + 1, K) of strips, of values between them (n, B + 1, S, K) and at their ends (n,
    B, 1, K)."""
    both = np.stack([between[:, :-1], between[:, 1:]], axis=2)
    whole = both.reshape(len(between), ends.shape[1], 2 * between.shape[2], -1)
    return np.asarray(np.concatenate([whole, ends], axis=2) + away)


class _PosedVane(NamedTuple):
    """One vane of n feathers. grid: (n, R, C, 3). shades: of _shades_of. parted: (n, R - 1, C, 3),
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


def _strips(posed: _PosedVane, vane: DrawnGrid, group: _Group) -> Geometry:
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
        rows, columns = _weights(heights, middles)[0], _weights(places, inner)[0]
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
    group: _Group, inner: Array, loose: Array, slender: float, film: Floats | None
) -> Floats:
    """(n B (2 S + 1), 5) barbs of Geometry. inner: (S,) places on a barb. loose: (n, B, 2 S + 1)
    and film: (n, R, C) as of _PosedVane. slender: length of a vane over that of its barbs."""
    stations, step = len(inner), group.real / group.barbs
    strip = step * np.arange(group.barbs)[:, None]
    found = np.zeros((*loose.shape, 5), np.float32)
    offset = (group.real + 2) * (np.array(group.numbers) % _DRAWS)
    up = np.concatenate([np.zeros(stations), np.full(stations, step), [0.5 * step]])
    found[..., 0] = offset[:, None, None] + strip + up
    found[..., 1] = np.concatenate([inner, inner, [1.0]])
    found[..., 2] = group.round
    least = min(max(_FREE * slender / group.real, _LEAST_FREE), _MOST_FREE)
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
    (along, along_slopes), (across, across_slopes) = _weights(*rows), _weights(*columns)
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


def _weights(knots: Array, places: Array) -> tuple[Array, Array]:
    """hermite_weights, kept from pose to pose."""
    return _kept_weights(knots.tobytes(), places.tobytes())


@lru_cache(maxsize=4096)
def _kept_weights(knots: bytes, places: bytes) -> tuple[Array, Array]:
    return hermite_weights(np.frombuffer(knots), np.frombuffer(places))


def _tubes(rings: Array, heights: Array, barbs: int, colours: Array) -> Geometry:
    """Shafts of n feathers, from rings (n, R, M, 3) of vertices, as fine as the barbs are many.

    colours: (n, R, 3) linear.
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
        np.repeat((along @ colours).clip(0.0, 1.0).reshape(-1, 3), around, axis=0),
    )  # fmt: skip
    return replace(shape, tangents=tangents)


@lru_cache
def _circle_weights(sides: int, around: int) -> tuple[Array, Array]:
    """(around, sides) of an ellipse through vertices evenly spaced around it, and its slopes."""
    own = 2 * np.pi * np.arange(sides) / sides
    angle = 2 * np.pi * np.arange(around)[:, None] / around - own
    return (1 + 2 * np.cos(angle)) / sides, -2 * np.sin(angle) / sides
