"""A cache that is drawn: what stands in its pictures, and how far it reaches over all frames.

It is coloured by value or region, with the key to these.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import pairwise
from pathlib import Path

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from featherfx.algebra.types import Array, Flags, Indices
from featherfx.algebra.vectors import vertex_normals
from featherfx.groom.materials import VANE_COLOUR, linear
from featherfx.phases import StageRead, note_read
from featherfx.render.camera import Eye
from featherfx.render.geometry import (
    DrawnPose,
    DrawnScene,
    Geometry,
    apart,
    chosen_feathers,
    geometry_of,
    joined,
    load_points,
    load_pose,
    load_scene,
)
from featherfx.render.light_kernels import EYE, SKIN_MATERIAL
from featherfx.render.options import PictureOptions
from featherfx.render.vanes import DrawnPlumage, plumage_of
from featherfx.usd.read.cache import Cache
from featherfx.usd.read.contents import SceneryMesh, find_scenery, list_beside, list_meshes

# linear: of shafts, and of other meshes without a colour of their own
PLAIN_RACHIS_COLOUR, SKIN_COLOUR = (0.47, 0.36, 0.22), (0.31, 0.25, 0.22)
COLLIDER_COLOUR = (0.24, 0.26, 0.29)
_MUTED = (0.45, 0.45, 0.45)
# Anchors of perceptually even ramps: viridis, and a blue-white-red diverging one.
SEQUENTIAL = np.array(
    [[68, 1, 84], [59, 82, 139], [33, 145, 140], [94, 201, 98], [253, 231, 37]]
) / 255  # fmt: skip
DIVERGING = np.array(
    [[33, 102, 172], [146, 197, 222], [245, 245, 245], [244, 165, 130], [178, 24, 43]]
) / 255  # fmt: skip
# open, weak, whole
HOOKS = np.array([[178, 24, 43], [244, 165, 130], [203, 194, 176]]) / 255
# free, passing through another
CROSSED = np.array([[203, 194, 176], [214, 39, 40]]) / 255
_CATEGORIES = np.array(
    [[68, 119, 170], [238, 102, 119], [34, 136, 51], [204, 187, 68], [102, 204, 238],
     [170, 51, 119], [187, 187, 187], [238, 153, 51]]
) / 255  # fmt: skip


@dataclass(frozen=True)
class Bar:
    """A colour bar: title with unit, least and greatest value, (K, 3) colours from low to high."""

    title: str
    low: float
    high: float
    ramp: Array


@dataclass(frozen=True)
class Legend:
    """Named colours."""

    entries: tuple[tuple[str, tuple[float, ...]], ...]


def look_colours(scene: DrawnScene, mode: str) -> tuple[Array, Legend | None]:
    """Linear colours (N, 3) of feathers in a look ("shaded" or "region"), and the key to them."""
    if mode != "region":
        return np.tile(VANE_COLOUR, (len(scene.feathers), 1)), None
    names = sorted(set(scene.regions))
    palette = [tuple(_CATEGORIES[k % len(_CATEGORIES)]) for k in range(len(names))]
    labels = tuple((name or "(none)", c) for name, c in zip(names, palette, strict=True))
    found = np.array([palette[names.index(region)] for region in scene.regions])
    return linear(found), Legend(labels)


def value_colours(
    scene: DrawnScene, poses: Sequence[DrawnPose], mode: str
) -> tuple[list[Array], Bar]:
    """Colours (T, 3) of each pose by values ("barb", "strain" or "hooked"), 0 to 1, and the key."""
    if mode == "hooked":
        fractions = [pose.hooked for pose in poses]
        return _coloured(scene, fractions, Bar("hooks that hold", 0.0, 1.0, HOOKS))
    if mode == "barb":
        values = [barb_angle(scene, pose) for pose in poses]
        return _by_value(scene, values, "barb angle (deg)", SEQUENTIAL, symmetric=False)
    rest = scene.rest
    values = [
        100 * strain_across_barbs(rest.points, pose.points, scene.triangles, rest.barbs)
        for pose in poses
    ]
    title = "Green-Lagrange strain across barbs (%)"
    return _by_value(scene, values, title, DIVERGING, symmetric=True)


def ramp_colours(ramp: Array, fraction: Array) -> Array:
    """Colours (N, 3) at fractions 0..1 of a ramp."""
    steps = np.linspace(0, 1, len(ramp))
    return np.stack([np.interp(fraction, steps, ramp[:, k]) for k in range(3)], axis=-1)


def _by_value(
    scene: DrawnScene, values: list[Array], title: str, ramp: Array, symmetric: bool
) -> tuple[list[Array], Bar]:
    shown = _shown(scene)
    low, high = value_limits(np.concatenate([v[shown] for v in values]), symmetric)
    return _coloured(scene, values, Bar(title, low, high, ramp))


def _coloured(scene: DrawnScene, values: list[Array], bar: Bar) -> tuple[list[Array], Bar]:
    shown, colours = _shown(scene), []
    for value in values:
        fraction = np.clip((value - bar.low) / (bar.high - bar.low), 0, 1)
        colours.append(np.where(shown[:, None], ramp_colours(bar.ramp, fraction), _MUTED))
    return colours, bar


def _shown(scene: DrawnScene) -> Flags:
    """(T,) triangles that have values."""
    return ~scene.rachis & np.asarray(scene.rest.barbs.any(axis=1))


def value_limits(values: Array, symmetric: bool) -> tuple[float, float]:
    """The range of a bar: 99 % of the values, so that one odd triangle does not grey the rest."""
    if len(values) == 0:
        return 0.0, 1.0
    if symmetric:
        reach = max(float(np.percentile(np.abs(values), 99)), 1e-4)
        return -reach, reach
    low, high = (float(v) for v in np.percentile(values, [0.5, 99.5]))
    return (low, high) if high - low > 0.1 else (low - 1.0, high + 1.0)


def barb_angle(scene: DrawnScene, pose: DrawnPose) -> Array:
    """(T,) deg, between the barb and the shaft at the same height of the feather."""
    angle = np.zeros(len(scene.triangles))
    ends = np.searchsorted(scene.owner, np.arange(len(scene.regions) + 1))
    for mine in (slice(*own) for own in pairwise(ends)):
        shaft = scene.rachis[mine]
        if not shaft.any():
            continue
        heights, place = np.unique(scene.along_feather[mine][shaft], return_inverse=True)
        tangent = np.zeros((len(heights), 3))
        np.add.at(tangent, place, pose.barbs[mine][shaft])
        at = scene.along_feather[mine]
        here = np.stack([np.interp(at, heights, tangent[:, k]) for k in range(3)], axis=1)
        here /= np.maximum(np.linalg.norm(here, axis=1, keepdims=True), 1e-300)
        cosine = np.clip((here * pose.barbs[mine]).sum(axis=1), -1, 1)
        angle[mine] = np.degrees(np.arccos(cosine))
    return angle


def strain_across_barbs(rest: Array, points: Array, triangles: Indices, along: Array) -> Array:
    """(T,) Green-Lagrange strain across the barb, no unit: half of (stretch squared - 1).

    rest, points: (V, 3) of any one unit. triangles: (T, 3). along: (T, 3) rest direction of the
    barb. Triangles without area have strain 0.
    """
    rest_edges = rest[triangles[:, 1:]] - rest[triangles[:, :1]]
    edges = points[triangles[:, 1:]] - points[triangles[:, :1]]
    normal = np.cross(rest_edges[:, 0], rest_edges[:, 1])
    area = np.linalg.norm(normal, axis=1)
    valid = area > 0
    across = np.cross(normal / np.where(valid, area, 1)[:, None], along)
    size = np.linalg.norm(across, axis=1)
    valid &= size > 0
    across /= np.where(size > 0, size, 1)[:, None]
    # The material direction "across" in terms of the two edges: solved in the triangle's plane.
    gram = np.einsum("tik,tjk->tij", rest_edges, rest_edges)
    gram[~valid] = np.eye(2)
    parts = np.linalg.solve(gram, np.einsum("tik,tk->ti", rest_edges, across)[..., None])
    stretched = np.einsum("ti,tik->tk", parts[..., 0], edges)
    strain = 0.5 * ((stretched**2).sum(axis=1) - 1)
    return np.where(valid, strain, 0.0)


def scenery_colours(mesh: SceneryMesh) -> Array:
    """Return (V, 3) colours of the points of a mesh beside the feathers."""
    return mesh.colours(np.array(SKIN_COLOUR if mesh.is_framed else COLLIDER_COLOUR))


def scenery_geometry(mesh: SceneryMesh, time: float | None) -> Geometry:
    """Return a mesh beside the feathers at a time code of the cache. Eyes, told by their names,
    shine."""
    points, triangles = mesh.points(time), mesh.surface.triangles
    is_eye = "eye" in mesh.surface.path.rpartition("/")[2].lower()
    material = EYE if is_eye else SKIN_MATERIAL
    normals = vertex_normals(points, triangles)
    return geometry_of(points, triangles, material, normals, scenery_colours(mesh))


def scenery_of_shot(cache: Cache, path: Path) -> list[SceneryMesh]:
    """Return the skin and the colliders that a cache names, and with a skin the meshes beside it
    under the same prim, such as eyes. A warning tells what is not there."""
    found: dict[tuple[Path, str], SceneryMesh] = {}
    for each in find_scenery(cache.scenery, path, ["skin", "collider"], "drawn"):
        for mesh in (each, *(list_beside(each) if each.is_framed else ())):
            found.setdefault(mesh.name, mesh)
    for file, prim in found:
        note_read(StageRead(str(file), prim, "drawn surface", 1))
    return list(found.values())


def scenery_of_files(
    cache: Cache, files: Iterable[Path], known: Iterable[SceneryMesh]
) -> list[SceneryMesh]:
    """Return all meshes of other files, at the same seconds. known: what is drawn already."""
    found, drawn = [], {each.name for each in known}
    for file in files:
        meshes = list(list_meshes(file, cache.frames_per_second))
        found += [each for each in meshes if each.name not in drawn]
    return found


_POSES_FRAMED = 30_000  # of single feathers; of larger caches frames are left out evenly


@dataclass
class Subject:
    """One cache of a picture. name: of its file. scene: what is drawn. close: what is looked at,
    of the same cache. scenery: what stands beside it.

    plumage, values: how it is coloured, after `colour`; values by time.
    """

    name: str
    cache: Cache
    scene: DrawnScene
    close: DrawnScene
    scenery: Sequence[SceneryMesh]
    plumage: DrawnPlumage | None = None
    values: dict[float | None, Array] = field(default_factory=dict)

    @cached_property
    def whole_reach(self) -> list[tuple[float, Array]]:
        """As reach, over the whole file."""
        if not self.cache.has_frames:
            return self.reach([None])
        codes = self.cache.whole_frames() or [self.cache.frames[0]]
        most = max(_POSES_FRAMED // len(self.close.chosen), 9)
        kept = np.unique(np.linspace(0, len(codes) - 1, min(len(codes), most)).astype(int))
        return self.reach([codes[k] for k in kept])

    def reach(self, times: Sequence[float | None]) -> list[tuple[float, Array]]:
        """Hulls (N, 3) m of what is looked at, with their time codes; at rest the time is 0."""
        whole = len(self.close.chosen) == len(self.cache.feathers)
        framed = [each for each in self.scenery if each.is_framed and whole]
        return [
            (
                time or 0.0,
                np.concatenate(
                    [
                        _hull(load_points(self.cache, self.close, time)),
                        *(_hull(each.points(time)) for each in framed),
                    ]
                ),
            )
            for time in times
        ]

    def shape(self, times: Sequence[float | None] | None = None) -> tuple[Array, Indices]:
        """Points (V, 3) m and triangles (T, 3) of what is looked at, first or at rest."""
        time = times[0] if times else None
        return load_points(self.cache, self.close, time), self.close.triangles

    def colour(self, eye: Eye, times: Sequence[float | None], mode: str) -> Bar | Legend | None:
        """Choose colours of a mode, and as many barbs as a camera sees at the first of the times;
        returns the key to the colours."""
        if mode not in ("shaded", "region"):
            poses = [load_pose(self.cache, self.scene, time) for time in times]
            colours, bar = value_colours(self.scene, poses, mode)
            self.values = dict(zip(times, colours, strict=True))
            return bar
        base, legend = look_colours(self.scene, mode)
        pixels = self._pixels(eye, load_points(self.cache, self.scene, times[0]))
        feathers = self.scene.feathers
        own = mode == "shaded"
        self.plumage = plumage_of(
            feathers,
            self.scene.starts,
            pixels,
            (base, np.array(PLAIN_RACHIS_COLOUR), np.array(SKIN_COLOUR)),
            own,
        )
        return legend

    def geometry(self, time: float | None) -> Geometry:
        """All that is drawn at a time code."""
        others = [scenery_geometry(each, time) for each in self.scenery]
        if self.plumage is None:
            pose = load_pose(self.cache, self.scene, time)
            colours = self.values[time]
            own = apart(pose.points, self.scene.triangles, pose.normals, colours)
        else:
            chosen = self.scene.chosen.tolist()
            about = (get(chosen, time) for get in (self.cache.clumped_of, self.cache.hooked_of))
            own = self.plumage.geometry(load_points(self.cache, self.scene, time), *about)
        return joined([own, *others])

    def _pixels(self, eye: Eye, points: Array) -> Array:
        """(N, 3): of each feather its length in pixels and metres, and half its width in pixels."""
        starts = self.scene.starts[:-1]
        low, high = (f.reduceat(points, starts, axis=0) for f in (np.minimum, np.maximum))
        scale = eye.pixels_per_metre(0.5 * (low + high))
        extents = self._extents(points)
        return np.stack([extents[:, 0] * scale, extents[:, 0], extents[:, 1] * scale], axis=1)

    def _extents(self, points: Array) -> Array:
        """(N, 2) m, length and half the width of each feather, by its own axes."""
        found = np.zeros((len(self.scene.feathers), 2))
        for k, (start, end) in enumerate(
            zip(self.scene.starts[:-1], self.scene.starts[1:], strict=True)
        ):
            mine = points[start:end]
            spread = mine - mine.mean(axis=0)
            axes = np.linalg.eigh(spread.T @ spread)[1]
            size = np.ptp(spread @ axes, axis=0)
            found[k] = size[2], 0.5 * size[1]
        return found


def open_subject(path: Path, options: PictureOptions) -> Subject:
    """A cache to draw. Raises InputError where it cannot be read, or lacks what is chosen."""
    cache = Cache(path)
    near = chosen_feathers(cache, str(path), options.feathers, options.regions)
    close = load_scene(cache, near)
    every = options.surroundings and len(near) < len(cache.feathers)
    scene = load_scene(cache) if every else close
    scenery: list[SceneryMesh] = []
    if len(near) == len(cache.feathers) or options.surroundings:
        scenery = [] if options.bare else scenery_of_shot(cache, path)
        scenery += scenery_of_files(cache, [Path(file) for file in options.scenery], scenery)
    return Subject(path.stem, cache, scene, close, scenery)


def _hull(points: Array) -> Array:
    """(N, 3) points on the convex hull; all where these lie in a plane."""
    try:
        return np.asarray(points[ConvexHull(points).vertices])
    except (QhullError, ValueError):
        return points
