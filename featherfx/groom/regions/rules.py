"""Rules on a skin: presence of a region at a place, and directions of its feathers.

A picture in texture space is one, or the tiles of a UDIM set, with the way it goes on outside.
Tile 1001 + i + 10 j holds texture coordinates from (i, j) to (i + 1, j + 1), i below 10. A picture
without <UDIM> in its name is tile 1001 alone, which wraps as USD's textures do.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, partial
from pathlib import Path
from typing import Any

import numpy as np

from featherfx.algebra.interpolation import faded
from featherfx.algebra.triangulation import factorise, make_elements, make_stiffness, weld
from featherfx.algebra.types import Array, Flags, Indices
from featherfx.algebra.vectors import unit
from featherfx.errors import all_of, warn_input
from featherfx.files.disk_cache import kept
from featherfx.groom.keys.places import the_one
from featherfx.groom.keys.problems import Place
from featherfx.groom.materials import displayed
from featherfx.groom.read.space import Space
from featherfx.groom.skin.field import search_tree
from featherfx.groom.skin.points import SkinSurface, SurfacePoints
from featherfx.groom.skin.skin import closest

_UDIM = "<UDIM>"
_FIRST, _COLUMNS, _ROWS = 1001, 10, 900  # number of the first tile; tiles in a row, and rows
_ROUNDING = 1e-6  # of texture coordinates at the edge of a picture

Tiles = dict[int, Array]  # (H, W) grey or (H, W, 3) values, top row first, by number; -1: no set


def read_tiles(path: Path, read: Callable[[Path], Array], place: Place) -> Tiles:
    """Return the tiles of a picture by number: all of a UDIM set that are there, or one as -1.

    Raises InputError for a set without tiles.
    """
    if _UDIM not in path.name:
        return {-1: read(path)}
    before, after = map(re.escape, path.name.split(_UDIM, 1))
    form = re.compile(f"{before}([1-9][0-9]{{3}}){after}")
    there = sorted(path.parent.iterdir()) if path.parent.is_dir() else []
    found = {int(match[1]): each for each in there if (match := form.fullmatch(each.name))}
    if not found:
        place.refuse(f"{path}: there is no tile, such as {path.name.replace(_UDIM, '1001')}")
    return {number: read(each) for number, each in found.items()}


def name_tiles(st: Array) -> set[int]:
    """Return the numbers of the tiles that texture coordinates (N, 2) are in; 0 for none."""
    column, row = np.floor(st).astype(np.int64).T
    sound = (column >= 0) & (column < _COLUMNS) & (row >= 0) & (row < _ROWS)
    return set(np.where(sound, _FIRST + column + _COLUMNS * row, 0).tolist())


def find_tiles(tiles: Tiles, st: Array, wrap: str) -> tuple[Indices, Array]:
    """Return (N,) where among sorted tiles texture coordinates (N, 2) lie, -1 for none, and (N, 2)
    their places within the tile, 0 to 1.

    wrap: black, clamp, repeat or mirror, of a single picture; a set of tiles is black outside.
    """
    if -1 in tiles:
        if wrap == "repeat":
            return np.zeros(len(st), np.int64), st - np.floor(st)
        if wrap == "mirror":
            return np.zeros(len(st), np.int64), 1.0 - np.abs(1.0 - st % 2.0)
        inside = (wrap == "clamp") | (np.abs(st - 0.5) <= 0.5 + _ROUNDING).all(axis=1)
        return np.where(inside, 0, -1), np.clip(st, 0.0, 1.0)
    known = np.array(sorted(tiles))
    corner = np.floor(st)
    column, row = corner.T
    sound = (column >= 0) & (column < _COLUMNS) & (row >= 0) & (row < _ROWS)
    number = np.where(sound, _FIRST + column + _COLUMNS * row, 0).astype(np.int64)
    place = np.minimum(np.searchsorted(known, number), len(known) - 1)
    return np.where(known[place] == number, place, -1), st - corner


def sample_tiles(tiles: Tiles, st: Array, wrap: str) -> Array:
    """Return values of tiles, grey or in colours, at texture coordinates (N, 2); 0 outside."""
    number, inner = find_tiles(tiles, st, wrap)
    first = tiles[min(tiles)]
    found = np.zeros((len(st), *first.shape[2:]))
    for place, key in enumerate(sorted(tiles)):
        own = number == place
        found[own] = _interpolate(tiles[key], inner[own], wrap if key == -1 else "clamp")
    return found


def _interpolate(picture: Array, st: Array, wrap: str) -> Array:
    """(N, ...) values of a picture between the middles of its pixels; its lower left corner is
    (0, 0)."""
    size = np.array(picture.shape[1::-1])
    place = np.column_stack([st[:, 0], 1.0 - st[:, 1]]) * size - 0.5
    low = np.floor(place).astype(np.int64)
    ends = low, low + 1
    if wrap == "repeat":
        (left, top), (right, bottom) = (each.T % size[:, None] for each in ends)
    else:
        (left, top), (right, bottom) = (np.clip(each, 0, size - 1).T for each in ends)
    u, v = ((place - low)[:, k].reshape(-1, *[1] * (picture.ndim - 2)) for k in (0, 1))
    upper = (1.0 - u) * picture[top, left] + u * picture[top, right]
    lower = (1.0 - u) * picture[bottom, left] + u * picture[bottom, right]
    return np.asarray((1.0 - v) * upper + v * lower)


Rule = Callable[[SurfacePoints], Array]
# (N,) upper bounds of a rule on triangles (N,) of a skin
Bound = Callable[[SkinSurface, Indices], Array]


@dataclass(frozen=True)
class Presence:
    """Presence of a region at points of a skin, within 0 and 1: the product of rules.

    bounds: of the rules. inputs: all that these depend on, besides points and surface.
    """

    surface: SkinSurface
    rules: tuple[Rule, ...]
    bounds: tuple[Bound, ...] = ()
    inputs: tuple[Any, ...] = ()

    def __call__(self, points: SurfacePoints) -> Array:
        result, left = np.zeros(len(points)), np.arange(len(points))
        # bounds on all triangles cost more than they save where points are fewer
        if len(points) > len(self.surface.areas) or "_most" in vars(self):
            left = np.flatnonzero(self._most[points.triangle] > 0.0)
        result[left] = 1.0
        for rule in self.rules:
            result[left] *= rule(points if len(left) == len(points) else points.some(left))
            # what one rule leaves out no other brings back
            left = left[result[left] > 0.0]
        return result

    @cached_property
    def _most(self) -> Array:
        """(T,) upper bounds on triangles."""
        found = np.ones(len(self.surface.areas))
        for bound in self.bounds:
            left = np.flatnonzero(found > 0.0)
            found[left] *= bound(self.surface, left)
        return found

    def reached(self, reach: float, share: float, outside: bool) -> Flags:
        """(T,) triangles no farther than a reach, m, from where it may be above a share. outside:
        and all where it is 0."""
        (middles, radii), own = self.surface.spheres, self._most > share
        found = own | (self._most <= 0.0) if outside else own.copy()
        if found.all() or not own.any():
            return found
        most, asked = reach + radii[own].max(), np.flatnonzero(~found)
        distance, _ = search_tree(middles[own]).query(
            middles[asked], distance_upper_bound=np.nextafter(most + radii.max(), np.inf)
        )
        found[asked] = distance <= most + radii[asked]
        return found


@dataclass(frozen=True)
class GroomSkin:
    """A skin that regions grow on. space: that their ranges and boxes are in. folder: of the
    groom, where pictures are."""

    surface: SkinSurface
    space: Space
    folder: Path


_PLACES = (
    *("primvar", "subset", "image", "box", "sphere", "x", "y", "z"),
    *("nearest", "facing", "free_radius"),
)
_FLOWS = ("direction", "away", "towards", "primvar", "curves")
_MAX_NAMED = 5  # tiles that a warning names
_GUIDES = 8  # guide points that a direction is interpolated from
# a direction whose part along the skin is a smaller share of it says nothing
_MIN_ALONG = 1e-3
# of a triangle's radius, by which a depth may change on it: axes of a space are sheared a little
_REACH_RATIO = 1.001
_HOLD = 1e-9  # relative hold of a potential at 0: parts of a skin without poles have none


def presence(rules: tuple[dict[str, Any], ...], skin: GroomSkin, place: Place) -> Presence:
    """The product of all rules. rules: checked tables. Raises InputError."""
    built = all_of(*(partial(_presence, each, skin, place.item(k)) for k, each in enumerate(rules)))
    values, bounds, inputs = zip(*built, strict=True) if built else ((), (), ())
    return Presence(skin.surface, values, bounds, (skin.space, rules, *inputs))


def _presence(rule: dict[str, Any], skin: GroomSkin, place: Place) -> tuple[Rule, Bound, Any]:
    """A rule, its bound, and the values of the skin that it was made of."""
    name, soft, inverted = the_one(_PLACES, rule, place), rule["soft"], rule["invert"]
    value, inputs, depth = rule[name], None, None
    if name in ("primvar", "subset", "image"):
        plain, inputs = painted(name, value, skin.surface, skin.folder, place.child(name))
    elif name == "facing":
        plain = _facing(rule)
    elif name == "free_radius":
        plain = _within(lambda points: points.interpolated(points.surface.room) - value, soft)
    else:
        depth = _depth(name, value, skin.space, place.child(name))
        plain = _within(lambda points: depth(points.position), soft)

    def bound(surface: SkinSurface, triangles: Indices) -> Array:
        if depth is None:
            return np.ones(len(triangles))
        middles, radii = (each[triangles] for each in surface.spheres)
        if inverted:
            return 1.0 - _fade(depth(middles) - _REACH_RATIO * radii, soft)
        return _fade(depth(middles) + _REACH_RATIO * radii, soft)

    return ((lambda points: 1.0 - plain(points)) if inverted else plain), bound, inputs


def _within(depth: Rule, soft: float) -> Rule:
    return lambda points: _fade(depth(points), soft)


def painted(
    name: str, value: str, surface: SkinSurface, folder: Path, at: Place
) -> tuple[Rule, Any]:
    """Return the rule of a map on a skin, and its values. Raises InputError.

    name: primvar, subset or image; value: its name, or the picture's file as seen from the folder.
    """
    if name == "image":
        return _image(folder / value, surface, at)
    if name == "subset":
        members = surface.source.subset(value, at)
        return (lambda points: members[points.triangle].astype(np.float64)), members
    corners = surface.source.weights(value, at)
    return (lambda points: np.clip(points.interpolated(corners), 0.0, 1.0)), corners


def painted_colours(value: str, skin: GroomSkin, at: Place) -> Rule:
    """(N, 3) sRGB at points of a skin, by a primvar or a picture. Raises InputError."""
    if "." in value:
        return _image(skin.folder / value, skin.surface, at, "RGB")[0]
    corners = skin.surface.source.colours(value, at)
    return lambda points: displayed(points.interpolated(corners))


def _image(path: Path, surface: SkinSurface, at: Place, mode: str = "L") -> tuple[Rule, Any]:
    corners, tiles = all_of(
        partial(_texture_places, surface, at),
        partial(read_tiles, path, partial(surface.source.image, place=at, mode=mode), at),
    )
    wrap = surface.source.wrap
    _warn_of_outside(path, tiles, corners, surface, at)
    inputs = corners, wrap, tuple(sorted(tiles)), *(tiles[key] for key in sorted(tiles))
    return (lambda points: sample_tiles(tiles, points.interpolated(corners), wrap)), inputs


def _texture_places(surface: SkinSurface, at: Place) -> Array:
    if surface.source.st is None:
        at.refuse(f"{surface.source.path} has no primvars:{surface.source.uv}")
    return surface.source.st


def _warn_of_outside(
    path: Path, tiles: Tiles, corners: Array, surface: SkinSurface, at: Place
) -> None:
    """Warn of the part of a skin that no tile of a picture covers."""
    wanted = np.stack([points.interpolated(corners) for points in surface.samples])
    number, _ = find_tiles(tiles, wanted.reshape(-1, 2), surface.source.wrap)
    missing = number < 0
    if not missing.any():
        return
    part = float(np.tile(surface.areas, len(wanted))[missing].sum() / len(wanted))
    named = ", ".join(map(str, sorted(name_tiles(wanted.reshape(-1, 2)[missing]))[:_MAX_NAMED]))
    warn_input(
        f"{at.source}: {at.key}: {100.0 * part / surface.areas.sum():.2g} % of "
        f"{surface.source.path} lies outside of the tiles of {path.name} and counts as 0. "
        f"Its texture coordinates are in tiles {named}"
    )


def _facing(rule: dict[str, Any]) -> Rule:
    toward, angle, fade = np.array(rule["facing"]), rule["angle"], rule["soft_angle"]

    def facing(points: SurfacePoints) -> Array:
        cosine = np.clip(points.normal @ toward, -1.0, 1.0)
        return _fade(angle - np.degrees(np.arccos(cosine)), fade)

    return facing


def _depth(name: str, value: Any, space: Space, at: Place) -> Callable[[Array], Array]:
    """Return the depth within a shape, m, of points (N, 3) m: it grows by no more than the way."""
    if name == "nearest":
        own, others = search_tree(np.array(value["to"])), search_tree(np.array(value["than"]))
        return lambda points: 0.5 * (others.query(points)[0] - own.query(points)[0])
    if name == "sphere":
        centre, radius = np.array(value["centre"]), value["radius"]
        return lambda points: radius - np.linalg.norm(points - centre, axis=1)
    if name == "box":
        low, high = space.local(np.array(value))
    else:
        low, high = np.full(3, -np.inf), np.full(3, np.inf)
        low["xyz".index(name)], high["xyz".index(name)] = value
    if (low >= high).any():
        at.refuse("is empty. Give the lower bound first")

    def box(points: Array) -> Array:
        local = space.local(points)
        return space.unit * np.minimum(local - low, high - local).min(axis=1)

    return box


def _fade(depth: Array, width: float) -> Array:
    """1 deep inside, 0 far outside, smooth over `width` around the border."""
    if width == 0.0:
        return (depth >= 0.0).astype(np.float64)
    return faded(depth / width + 0.5)


def flow(entry: dict[str, Any], surface: SkinSurface, place: Place) -> Rule:
    """Unit directions along the skin, (N, 3); zero where the rule gives none.

    entry: checked table. Raises InputError.
    """
    if [name for name in _FLOWS if entry[name] is not None] == ["away", "towards"]:
        field = _current(surface, np.array([entry["away"], entry["towards"]]))
    else:
        name = the_one(_FLOWS, entry, place)
        field = _field(name, entry[name], surface, place.child(name))
    cosine, sine = np.cos(np.radians(entry["turn"])), np.sin(np.radians(entry["turn"]))

    def along(points: SurfacePoints) -> Array:
        wanted = field(points)
        flat = along_skin(wanted, points.normal)
        return cosine * flat + sine * np.cross(points.normal, flat)

    return along


def along_skin(wanted: Array, normal: Array) -> Array:
    """Parts of directions along the skin, made unit vectors; zero where there is hardly any."""
    flat = wanted - (wanted * normal).sum(axis=1, keepdims=True) * normal
    size = np.linalg.norm(flat, axis=1, keepdims=True)
    whole = np.linalg.norm(wanted, axis=1, keepdims=True)
    clear = size > _MIN_ALONG * np.maximum(whole, 1e-300)
    return np.where(clear, flat / np.where(clear, size, 1.0), 0.0)


def _field(name: str, value: Any, surface: SkinSurface, place: Place) -> Rule:
    if name == "direction":
        return lambda points: np.broadcast_to(np.array(value), (len(points), 3))
    if name in ("away", "towards"):
        pole, sign = np.array(value), 1.0 if name == "away" else -1.0
        return lambda points: sign * (points.position - pole)
    if name == "primvar":
        corners = surface.source.vectors(value, place)
        return lambda points: points.interpolated(corners)
    curves = surface.source.curves(value, place)
    # tangents of the nearest points of guide curves, by one over the squared distance
    middles = np.concatenate([0.5 * (curve[1:] + curve[:-1]) for curve in curves])
    steps = np.concatenate([np.diff(curve, axis=0) for curve in curves])
    tangents = unit(steps)
    tree, count = search_tree(middles), min(_GUIDES, len(middles))

    def along(points: SurfacePoints) -> Array:
        distance, near = tree.query(points.position, k=count)
        distance, near = distance.reshape(-1, count), near.reshape(-1, count)
        weight = 1.0 / np.maximum(distance, 1e-9) ** 2
        return np.asarray(np.einsum("nk,nkc->nc", weight, tangents[near]))

    return along


def _current(surface: SkinSurface, poles: Array) -> Rule:
    """Currents over a skin from one point to another, poles (2, 3) m.

        -div grad u = delta(source) - delta(sink),   j = -grad u

    u has no extremum between the poles (maximum principle), so flows meet nowhere else.
    """

    def compute() -> dict[str, Array]:
        from scipy.sparse import diags_array

        points, faces = weld(surface.corners)
        elements = make_elements(points, faces)
        stiff = make_stiffness(elements, faces)
        hold = _HOLD * stiff.diagonal().mean() / elements.masses.mean()
        triangle, place = closest(poles, surface.corners)
        charge = np.bincount(
            faces[triangle].ravel(), (place * [[1.0], [-1.0]]).ravel(), len(points)
        ).astype(float)
        potential = factorise(stiff + hold * diags_array(elements.masses))(charge)
        slope = np.einsum("tki,tk->ti", elements.gradients, potential[faces])
        current = np.repeat(-elements.areas[:, None] * slope, 3, axis=0)
        summed = [np.bincount(faces.ravel(), each, len(points)) for each in current.T]
        return {"current": unit(np.stack(summed, axis=1))[faces]}

    corners = kept("current", [surface.corners, poles], compute)["current"]
    return lambda points: points.interpolated(corners)
