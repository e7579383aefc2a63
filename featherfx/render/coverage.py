"""Bare skin of a groom, tract by tract, and its picture. Independent of how feathers were laid.

A place of the skin is covered where a ray along its normal meets any feather, no farther off than
the longest feather of a region is long. A tract is the skin where its region is most present. Of
each, and of `all`:

    area            m^2
    bare            fraction of the area that is not covered
    count           feathers
    largest_hole    m, diameter of the largest disc of bare skin
    overlap         L sqrt(n / A): mean length, number, area
    exposed         median fraction of the vanes of a feather over which no other feather lies

Places are random and even by area, `spacing` m apart: narrower holes may be missed, and diameters
are off by as much.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from embreex import rtcore_scene
from embreex.mesh_construction import TriangleMesh
from scipy.spatial import cKDTree

from featherfx.algebra.types import Array, Flags, Indices
from featherfx.algebra.vectors import face_products, unit
from featherfx.feather.types import RACHIS_PART, Feather
from featherfx.files.atomic_write import standing
from featherfx.groom.regions.regions import GrownRegions, Region
from featherfx.groom.skin.points import SkinSurface
from featherfx.groom.types import Groom
from featherfx.render.camera import tile_size
from featherfx.render.subject import CROSSED, Legend
from featherfx.usd.check.measures import measure_overlap
from featherfx.usd.check.skins import sample_triangles

if TYPE_CHECKING:
    from featherfx.render.draw import Picture

_SPACING = 2.5e-4  # m
_MIN_PLACES, _MAX_PLACES = 100_000, 2_000_000
_VANE_PLACES = 32  # of a feather
_OFFSET = 1e-5  # of the size of all: by which rays start off a surface
_TILE_SCALE = 1.25  # of the pixels of a sheet's tiles
_NO_REGION = np.array([0.35, 0.38, 0.42])
_DARKEST = 0.35  # of skin that is seen edge on
# right and up of views of a creature that looks to +x
_VIEWS = {
    "right": ((1, 0, 0), (0, 0, 1)),
    "left": ((-1, 0, 0), (0, 0, 1)),
    "front": ((0, 1, 0), (0, 0, 1)),
    "back": ((0, -1, 0), (0, 0, 1)),
    "above": ((1, 0, 0), (0, 1, 0)),
    "below": ((1, 0, 0), (0, -1, 0)),
}


@dataclass(frozen=True)
class _Tracts:
    """Skin that regions grow on, T triangles, in the order of the regions' meshes."""

    _regions: tuple[Region, ...]
    _surfaces: tuple[SkinSurface, ...]

    @property
    def names(self) -> list[str]:
        """Ids of the regions."""
        return [each.entry["id"] for each in self._regions]

    @cached_property
    def corners(self) -> Array:
        """(T, 3, 3) m."""
        return np.concatenate([each.corners for each in self._surfaces])

    @cached_property
    def owners(self) -> Indices:
        """(T,) number of the region that is most present at each triangle's middle, -1 where all
        together are not by half."""
        found = []
        for surface in self._surfaces:
            middles = surface.samples[-1]
            own = [each.surface is surface for each in self._regions]
            present = np.zeros((len(own), len(middles)))
            for number in np.flatnonzero(own):
                present[number] = self._regions[number].presence(middles)
            found.append(np.where(present.sum(axis=0) < 0.5, -1, present.argmax(axis=0)))
        return np.concatenate(found)

    def at(self, triangle: Indices, barycentric: Array) -> tuple[Array, Array]:
        """Points (N, 3) m and smooth unit normals within triangles (N,)."""
        places, first = np.zeros((2, len(triangle), 3)), 0
        for surface in self._surfaces:
            last = first + len(surface.areas)
            own = (triangle >= first) & (triangle < last)
            found = surface.at(triangle[own] - first, barycentric[own])
            places[:, own], first = (found.position, found.normal), last
        return places[0], places[1]


class _Places(NamedTuple):
    """Places on a skin. points, normals: (N, 3). tract: (N,) number, -1 where none is."""

    points: Array
    normals: Array
    tract: Indices


class _Rays:
    """Triangles (T, 3) of points (V, 3) m that rays meet."""

    def __init__(self, points: Array, triangles: Indices) -> None:
        self._middle = 0.5 * (points.min(axis=0) + points.max(axis=0))
        self._offset = _OFFSET * float(np.ptp(points, axis=0).max())
        self._scene = rtcore_scene.EmbreeScene()
        near = np.ascontiguousarray(points - self._middle, dtype=np.float32)
        self._mesh = TriangleMesh(self._scene, near, triangles.astype(np.int32))

    def meet(self, points: Array, ways: Array, reach: Array | float) -> dict[str, Any]:
        """Meet triangles from points (N, 3) along unit ways (N, 3), up to reach m."""
        starts = (points - self._middle + self._offset * ways).astype(np.float32)
        far = np.broadcast_to(np.asarray(reach, dtype=np.float32), len(points)).copy()
        found: dict[str, Any] = self._scene.run(
            starts, ways.astype(np.float32), dists=far, query="INTERSECT", output=True
        )
        return found


class Coverage:
    """Coverage of the skin of a groom that has regions. feathers: built, as the groom has them."""

    def __init__(self, groom: Groom, grown: GrownRegions, feathers: Sequence[Feather]) -> None:
        self._groom, self._skin = groom, _Tracts(*grown)
        self._names: list[str] = self._skin.names
        own = [each.region for each in groom.feathers]
        self._tract = np.array([self._names.index(r) if r in self._names else -1 for r in own])
        self._length = np.array([each.kind.length for each in groom.feathers])
        surfaces = [each.surface for each in feathers]
        points = [
            surface.points(feather.rest) @ placed.rotation.T + placed.position
            for placed, feather, surface in zip(groom.feathers, feathers, surfaces, strict=True)
        ]
        starts = np.cumsum([0, *map(len, points)])
        counts = [len(each.triangles) for each in surfaces]
        self._points, self._owner = (
            np.concatenate(points),
            np.repeat(np.arange(len(counts)), counts),
        )
        self._triangles = np.concatenate(
            [each.triangles + start for each, start in zip(surfaces, starts, strict=False)]
        )
        self._is_vane = np.concatenate([each.part != RACHIS_PART for each in surfaces])
        self._rays = _Rays(self._points, self._triangles)
        self._reach = float(self._length[self._tract >= 0].max())

    def measure(self) -> dict[str, Any]:
        """Return the measures of each tract, and of `all`, and the spacing of places."""
        area = 0.5 * float(np.linalg.norm(face_products(self._skin.corners), axis=1).sum())
        count = int(np.clip(area / _SPACING**2, _MIN_PLACES, _MAX_PLACES))
        samples = sample_triangles(self._skin.corners, count)
        places = self._places(samples.face, samples.weights)
        bare = ~self._is_covered(places)
        hole = np.zeros(count)
        inside = places.tract >= 0
        open_skin = np.flatnonzero(bare & inside)
        if len(open_skin) < count:
            closed = cKDTree(places.points[~(bare & inside)])
            hole[open_skin] = 2.0 * closed.query(places.points[open_skin])[0]
        exposed = self._exposed()
        tracts = {}
        for number, name in enumerate(["all", *self._names], start=-1):
            here = inside if number < 0 else places.tract == number
            own = self._tract >= 0 if number < 0 else self._tract == number
            if not here.any() and not own.any():
                continue
            size = samples.area * float(here.sum())
            tracts[name] = {
                "area": size,
                "bare": float(bare[here].mean()) if here.any() else 0.0,
                "count": int(own.sum()),
                "largest_hole": float(hole[here].max(initial=0.0)),
                "overlap": measure_overlap(self._length[own], size),
                "exposed": float(np.median(exposed[own])) if own.any() else 0.0,
            }
        return {
            "tracts": tracts,
            "featherless_area": samples.area * float((~inside).sum()),
            "spacing": float(np.sqrt(area / count)),
        }

    def draw(self, output: Path) -> None:
        """Write a sheet of the skin from six sides. Raises InputError where it cannot be."""
        from featherfx.render.draw import add_key, contact_sheet, label, save

        before = {output: standing(output)}
        x, y = self._groom.forward[:2]
        turn = np.array([[x, -y, 0.0], [y, x, 0.0], [0.0, 0.0, 1.0]])
        corners = self._skin.corners.reshape(-1, 3)
        skin = _Rays(corners, np.arange(len(corners)).reshape(-1, 3))
        views = {name: np.array(axes) @ turn.T for name, axes in _VIEWS.items()}
        sizes = [tile_size(axes[0], axes[1], corners) for axes in views.values()]
        shape = np.round(_TILE_SCALE * np.max(sizes, axis=0)).astype(int)
        tiles = [label(self._view(skin, axes, shape), name) for name, axes in views.items()]
        colours = (("bare", CROSSED[1]), ("covered", CROSSED[0]), ("no region", _NO_REGION))
        key = Legend(tuple((name, tuple(colour)) for name, colour in colours))
        save([add_key(contact_sheet(tiles), key)], before, 1.0)

    def _view(self, skin: _Rays, axes: Array, shape: Array) -> Picture:
        """Draw the skin along a view's axes, without perspective."""
        axes = np.stack([*axes, np.cross(*axes)])
        local = self._skin.corners.reshape(-1, 3) @ axes.T
        low, high = local.min(axis=0), local.max(axis=0)
        step = 1.1 * float(((high - low)[:2] / shape).max())
        width, height = shape
        across = 0.5 * (low + high)[0] + step * (np.arange(width) - 0.5 * (width - 1))
        up = 0.5 * (low + high)[1] - step * (np.arange(height) - 0.5 * (height - 1))
        grid = np.stack([*np.meshgrid(across, up), np.full((height, width), high[2] + step)], -1)
        starts, back = grid.reshape(-1, 3) @ axes, axes[2]
        found = skin.meet(starts, np.broadcast_to(-back, starts.shape), np.inf)
        hit = np.flatnonzero(found["primID"] >= 0)
        u, v = (found[name][hit].astype(float) for name in "uv")
        places = self._places(found["primID"][hit], np.stack([1.0 - u - v, u, v], axis=1))
        covered = self._is_covered(places)
        colours = CROSSED[np.where(covered, 0, 1)]
        colours[places.tract < 0] = _NO_REGION
        light = _DARKEST + (1.0 - _DARKEST) * np.abs(places.normals @ back)
        picture = np.full((height * width, 3), 255, np.uint8)
        picture[hit] = np.round(255 * colours * light[:, None])
        return picture.reshape(height, width, 3)

    def _places(self, face: Indices, weights: Array) -> _Places:
        """Places within triangles (N,) of the skin, by weights (N, 3) of their corners."""
        points, normals = self._skin.at(face, weights)
        return _Places(points, normals, self._skin.owners[face])

    def _is_covered(self, places: _Places) -> Flags:
        found = self._rays.meet(places.points, places.normals, self._reach)
        return np.asarray(found["primID"] >= 0)

    def _exposed(self) -> Array:
        """(F,) fraction of the vanes of feathers that no other feather lies over."""
        corners = self._points[self._triangles[self._is_vane]]
        owner = self._owner[self._is_vane]
        products = face_products(corners)
        area = np.bincount(owner, np.linalg.norm(products, axis=1), len(self._length))
        # of feathers of one area each has as many places
        scale = 1.0 / np.sqrt(np.maximum(area, 1e-300))[owner, None, None]
        samples = sample_triangles(scale * corners, _VANE_PLACES * int((area > 0.0).sum()))
        points = np.einsum("nk,nkc->nc", samples.weights, corners[samples.face])
        own, ways = owner[samples.face], unit(products[samples.face])
        hit = self._rays.meet(points, ways, self._length[own])["primID"]
        hidden = (hit >= 0) & (self._owner[hit] != own)
        counts = np.maximum(np.bincount(own, minlength=len(area)), 1)
        return 1.0 - np.bincount(own, hidden, len(area)) / counts
