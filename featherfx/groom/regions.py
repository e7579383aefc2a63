"""Feathers that grow in regions of a skin: where, which way, and how they differ."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from featherfx.errors import InputWarning
from featherfx.groom.drafts import Draft
from featherfx.groom.frames import frames_from
from featherfx.groom.kind_store import KindChoice, KindStore
from featherfx.groom.library import sourced
from featherfx.groom.region_rules import Rule, along_skin, flow, presence
from featherfx.groom.scatter import Scattered, expected_count, hashed, scatter, uniform
from featherfx.groom.schema import Place
from featherfx.groom.surface_points import Array, Indices, SkinSource, SkinSurface, SurfacePoints
from featherfx.groom.types import FeatherKind

# (checked keys of [skin], paths of meshes, folder, place) to the meshes; None after problems.
SkinReader = Callable[
    [dict[str, Any], tuple[str, ...], Path, Place], "dict[str, SkinSource] | None"
]

LIMIT = 3.0  # standard deviations
# steps in which a blend between regions passes, so that shapes repeat there, too
_WIDTH_STEP = 0.1
_CURL_STEP = 10.0  # deg
_HOLLOW_STEP = 10.0  # deg
# a skin that falls off further is not followed; and where a vane's side is, in feather lengths
_MOST_TURNING = 45.0  # deg
_SIDE = 0.2
_MOST_NAMED = 5
_LEAST_FIT = 0.25  # of a feather's length, left where there is no room
_STREAMS = {"length": 10, "width": 12, "curl": 14, "tilt": 16, "turn": 18, "roll": 20}
_VARIANT_STREAM = 22


@dataclass(frozen=True)
class _Region:
    """One region, ready to grow."""

    entry: dict[str, Any]
    place: Place
    surface: SkinSurface
    choice: KindChoice
    presence: Rule
    flow: Rule
    kind: FeatherKind

    @property
    def length(self) -> float:
        return float(self.entry["length"] or self.kind.length)

    def density(self, points: SurfacePoints) -> Array:
        """(N,) feathers per m^2, 1 where the region is whole if it has a count instead."""
        density = self.entry["density"]
        return self.presence(points) * (1.0 if density is None else density)


def region_drafts(
    skin: dict[str, Any],
    entries: Sequence[tuple[Place, dict[str, Any]]],
    folder: Path,
    place: Place,
    store: KindStore,
    read: SkinReader | None,
) -> tuple[list[Draft], Array | None]:
    """The drafts of all [[region]]s and the corners (T, 3, 3) m of their meshes.

    No drafts, and None, after adding problems. skin: checked keys of [skin]. entries: place and
    checked keys of each region. folder: of the groom. place: of [skin].
    """
    if read is None:
        place.fail("is a USD scene, which featherfx.read_groom and the commands read")
        return [], None
    count = len(place.problems)
    paths = tuple(dict.fromkeys([skin["prim"], *(e["prim"] for _, e in entries if e["prim"])]))
    sources = read(skin, paths, folder, place)
    if sources is None:
        return [], None
    surfaces = {path: SkinSurface(source) for path, source in sources.items()}
    built = [
        _region(entry, at, surfaces[entry["prim"] or skin["prim"]], folder, store)
        for at, entry in entries
    ]
    regions = [region for region in built if region is not None]
    counts = [_count(region) for region in regions]
    _check_total(regions, counts, skin["most"], place)
    if len(place.problems) > count:
        return [], None
    drafts: list[Draft] = []
    for region, wanted in zip(regions, counts, strict=True):
        drafts += _grown(region, wanted, regions, region.entry["prim"] or "")
    return drafts, np.concatenate([surface.corners for surface in surfaces.values()])


def _region(
    entry: dict[str, Any], place: Place, surface: SkinSurface, folder: Path, store: KindStore
) -> _Region | None:
    count = len(place.problems)
    if (entry["density"] is None) == (entry["count"] is None):
        place.child("density").fail("expects either density or count, one of the two")
    changes: tuple[int, ...] = ()
    if entry["overrides"]:
        at = place.child("overrides")
        changes = (store.change(sourced(entry["overrides"], place.source), at),)
    choice = KindChoice((entry["kind"],), 0.0, changes, place)
    kind = store.kind(choice)
    where = presence(entry["where"], surface, folder, place.child("where"))
    along = flow(entry["flow"], surface, place.child("flow"))
    if where is None or along is None or kind is None or len(place.problems) > count:
        return None
    length = float(entry["length"] or kind.length)
    if length > surface.diagonal:
        place.child("length").fail(
            f"{length:g} m is longer than the whole skin {surface.source.path}, "
            f"{surface.diagonal:.3g} m; are its units right?"
        )
        return None
    return _Region(entry, place, surface, choice, where, along, kind)


def _count(region: _Region) -> int:
    if region.entry["count"] is not None:
        return int(region.entry["count"])
    return round(expected_count(region.surface, region.density))


def _check_total(regions: Sequence[_Region], counts: Sequence[int], most: int, at: Place) -> None:
    if sum(counts) <= most:
        return
    for region, count in zip(regions, counts, strict=True):
        if count > most // 4:
            key = "density" if region.entry["count"] is None else "count"
            region.place.child(key).fail(f"asks for {count} feathers of the {most} that may be")
    at.child("most").fail(
        f"the regions ask for {sum(counts)} feathers, allowed {most}; lower a density or raise most"
    )


def _grown(region: _Region, count: int, regions: Sequence[_Region], prim: str) -> list[Draft]:
    entry = region.entry
    found = scatter(region.surface, region.presence, count, entry["seed"])
    points = found.points
    if len(points) < count:
        warnings.warn(
            f"{region.place.source}: {region.place.key}: '{entry['id']}' has hardly any place on "
            f"the skin: {len(points)} of {count} feathers",
            InputWarning,
            stacklevel=2,
        )
    found = _above_ground(region, found)
    points = found.points
    if len(points) == 0:
        return []
    blend = _blended(region, [r for r in regions if r.surface is region.surface], points)
    blend["length"] = _fitted(blend["length"], points, entry["fit"])
    draws = {name: _normal(entry, name, found.number) for name in _STREAMS}
    direction = _directions(region, blend["flow"], points, draws["turn"])
    shapes = _shapes(region, blend, direction, found)
    tilt = np.radians(np.clip(blend["tilt"] + draws["tilt"], -89.0, 89.0))[:, None]
    shaft = np.cos(tilt) * direction + np.sin(tilt) * points.normal
    dorsal = np.cos(tilt) * points.normal - np.sin(tilt) * direction
    rotations = frames_from(shaft, dorsal)
    scales = blend["length"] * (1.0 + draws["length"]) / region.kind.length
    left = np.full(len(points), entry["side"] == "left")
    if entry["side"] == "auto":
        left = np.asarray(points.position[:, 1] > 0.0)
    return [
        Draft(
            id=f"{entry['id']}_{found.number[k]:06d}",
            choice=region.choice,
            position=points.position[k],
            rotation=rotations[k],
            region=entry["id"],
            joint=entry["joint"],
            left=bool(left[k]),
            scale=float(scales[k]),
            width=float(shapes[0][k]),
            roll=float(entry["roll"] + draws["roll"][k]),
            place=region.place,
            skin=prim,
            curl=float(shapes[1][k]),
            hollow=float(shapes[2][k]),
            layer=entry["layer"],
            grown=True,
        )
        for k in range(len(points))
    ]


def _blended(region: _Region, others: Sequence[_Region], points: SurfacePoints) -> dict[str, Array]:
    """Length (m), width, curl, tilt and flow at points, between those of overlapping regions."""
    members = [r for r in others if r.entry["blend"]] if region.entry["blend"] else [region]
    total = np.zeros(len(points))
    result = {name: np.zeros(len(points)) for name in ("length", "width", "curl", "tilt")}
    along = np.zeros((len(points), 3))
    for each in members:
        weight = each.presence(points)
        total += weight
        for name, value in result.items():
            value += weight * (each.length if name == "length" else each.entry[name])
        along += weight[:, None] * each.flow(points)
    return {name: value / total for name, value in result.items()} | {"flow": along}


def _above_ground(region: _Region, found: Scattered) -> Scattered:
    """Without the places that lie inside the body, which are told."""
    buried = region.surface.buried(found.points)
    if not buried.any():
        return found
    ids = [f"{region.entry['id']}_{number:06d}" for number in found.number[buried]]
    more = f" and {len(ids) - _MOST_NAMED} more" if len(ids) > _MOST_NAMED else ""
    warnings.warn(
        f"{region.place.source}: {region.place.key}: {len(ids)} roots lie inside the body and are "
        f"left out: {', '.join(ids[:_MOST_NAMED])}{more}",
        InputWarning,
        stacklevel=3,
    )
    return Scattered(found.points.some(~buried), found.number[~buried])


def _fitted(length: Array, points: SurfacePoints, fit: float | None) -> Array:
    """Lengths (N,) m that the room above the skin allows."""
    if fit is None:
        return length
    room = points.interpolated(points.surface.room)
    return np.asarray(np.clip(fit * room, _LEAST_FIT * length, length))


def _normal(entry: dict[str, Any], name: str, numbers: Indices) -> Array:
    """(N,) normal draws of one quantity (Box and Muller 1958), by its deviation, limited."""
    stream, seed = _STREAMS[name], entry["seed"]
    radius = np.sqrt(-2.0 * np.log(uniform(seed, stream, numbers)))
    wave = np.cos(2.0 * np.pi * uniform(seed, stream + 1, numbers))
    return np.asarray(entry["variation"][name] * np.clip(radius * wave, -LIMIT, LIMIT))


def _shapes(
    region: _Region, blend: dict[str, Array], direction: Array, found: Scattered
) -> tuple[Array, Array, Array]:
    """Factors of the width, changes of the camber of shafts and of barbs (deg).

    They take few different values where the region has variants.
    """
    entry, variants, follow = region.entry, region.entry["variants"], region.entry["follow"]
    own, points, length = found.number, found.points, blend["length"]
    width, curl = blend["width"], blend["curl"]
    hollow = np.zeros(len(points))
    if follow:
        along, across = _turning(points, direction, length)
        curl = curl + follow * (along - region.kind.rachis.camber)
        hollow = follow * (across - _mean_barb_camber(region.kind))
    if variants:
        own = (hashed(entry["seed"], _VARIANT_STREAM, own) % np.uint64(variants)).astype(np.int64)
        width = entry["width"] + _stepped(width - entry["width"], _WIDTH_STEP)
        curl = entry["curl"] + _stepped(curl - entry["curl"], _CURL_STEP)
        hollow = _stepped(hollow, _HOLLOW_STEP)
    width = width * (1.0 + _normal(entry, "width", own))
    return np.maximum(width, 0.01), curl + _normal(entry, "curl", own), hollow


def _mean_barb_camber(kind: FeatherKind) -> float:
    """deg, of the guides of both vanes."""
    return float(np.mean([guide.camber for guide in kind.leading.guides + kind.trailing.guides]))


def _stepped(values: Array, step: float) -> Array:
    return np.asarray(step * np.round(values / step))


def _turning(points: SurfacePoints, direction: Array, length: Array) -> tuple[Array, Array]:
    """(N,) deg, by which the skin falls off beneath feathers: to the tip, and to their sides.

    At least 0. Where the skin ends before the tip does, what the first half shows counts.
    """
    half = _fall(points, 0.5 * length[:, None] * direction)
    along = np.minimum(_fall(points, length[:, None] * direction), 2.0 * half)
    side = _SIDE * length[:, None] * np.cross(points.normal, direction)
    across = 0.5 * (_fall(points, side) + _fall(points, -side))
    return along, across


def _fall(points: SurfacePoints, way: Array) -> Array:
    """(N,) deg, by which the skin's normal leans towards a way (N, 3) m, at its end."""
    normals = points.surface.normals_near(points.position + way)
    ahead = np.einsum("nc,nc->n", normals, way) / np.linalg.norm(way, axis=1)
    up = np.einsum("nc,nc->n", normals, points.normal)
    return np.clip(np.degrees(np.arctan2(ahead, up)), 0.0, _MOST_TURNING)


def _directions(region: _Region, wanted: Array, points: SurfacePoints, turn: Array) -> Array:
    """Unit directions along the skin; where the rule gives none, that of the nearest root."""
    flat = along_skin(wanted, points.normal)
    missing = ~flat.any(axis=1)
    if missing.all():
        region.place.child("flow").fail("gives no direction along the skin at any root")
        flat = np.cross(points.normal, points.normal[:, [1, 2, 0]] + 0.1)
        return flat / np.linalg.norm(flat, axis=1, keepdims=True)
    if missing.any():
        from scipy.spatial import cKDTree

        known = np.flatnonzero(~missing)
        _, near = cKDTree(points.position[known]).query(points.position[missing])
        borrowed = along_skin(flat[known[near]], points.normal[missing])
        across = along_skin(np.cross(flat[known[near]], [0.6, 0.64, 0.48]), points.normal[missing])
        flat[missing] = np.where(np.asarray(borrowed.any(axis=1))[:, None], borrowed, across)
    angle = np.radians(turn)[:, None]
    return np.asarray(np.cos(angle) * flat + np.sin(angle) * np.cross(points.normal, flat))
