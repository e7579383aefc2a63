"""Feathers as they look: grouped once by what they share, drawn in each pose (strips.py)."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from featherfx.algebra.interpolation import faded
from featherfx.algebra.types import Array, Floats, Indices
from featherfx.algebra.vectors import unit, vertex_normals
from featherfx.feather.types import RACHIS_PART
from featherfx.files.disk_cache import stable_number
from featherfx.groom.materials import BarbLook
from featherfx.render.geometry import (
    DrawnGrid,
    Geometry,
    Topology,
    geometry_of,
    joined,
    topology_of,
)
from featherfx.render.light_kernels import SKIN_MATERIAL
from featherfx.render.strips import (
    PosedVane,
    StripGroup,
    coat_fractions,
    coat_normals,
    shades_of,
    strips_of,
    tubes_of,
    weights_at,
)
from featherfx.usd.read.cached_feather import CachedFeather

_SPACING = 4.5  # pixels from one barb to the next, at least
_REAL_SPACING = 5e-4  # m, where a mesh does not tell: between contour and flight feathers'
_STATION = 6.0  # pixels between two points of a barb
_MAX_BARBS = 1200.0
# of a vane that are told apart: their numbers are kept in single precision
_MAX_REAL = 1e5
_STEP = 1.3  # between numbers of barbs, so that feathers of about one size share their weights
_SLIM, _STOUT = 0.6, 2.5  # pixels: shafts are not drawn below, and have their own colour above


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
    groups: tuple[StripGroup, ...]
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
        own = [(k, self.feathers[k], self.feathers[k].side != RACHIS_PART) for k in barbed]
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
            [shades_of(*self._coloured(group.members, grid), grid, group) for grid in vanes]
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
            yield geometry_of(mine, triangles, SKIN_MATERIAL, normals, colour)

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
                yield strips_of(PosedVane(mine, parted, shade, free, film, *about), grid, group)
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

    def _shafts(self, group: StripGroup, points: Array) -> Iterator[Geometry]:
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
        beside = weights_at(vane.heights, along)[0] @ self._colours(members, vane.rows)[:, :, 1]
        own = np.stack(
            [
                np.broadcast_to(self.shaft, (len(heights), 3))
                if c is None or (c == c[0]).all()
                else c[rings].mean(axis=1)
                for c in (self.feathers[k].colour for k in members)
            ]
        )
        colours = beside + faded(part)[:, None, None] * (own - beside)
        yield tubes_of(mine[drawn], heights, group.barbs, colours.clip(0.0, 1.0))


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
    real = np.minimum(real, _MAX_REAL)
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
            StripGroup(
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
    barbs = min(length / _SPACING, real, _MAX_BARBS)
    steps = max(int(np.log(max(barbs, 1.0)) / np.log(_STEP)), 7)
    stations = np.clip(2 ** np.ceil(np.log2(max(barb, 1.0) / _STATION)), 2, 16)
    return round(_STEP**steps), int(stations) + 1
