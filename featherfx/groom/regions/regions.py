"""The plumage of a groom, [skin], [[region]] and [layout]: where feathers grow, and how."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, replace
from functools import cached_property, partial
from itertools import accumulate
from pathlib import Path
from typing import Any
from zlib import crc32

import numpy as np

from featherfx.algebra.types import Array, Indices
from featherfx.algebra.vectors import frames_from
from featherfx.errors import all_of, some_of, warn_input
from featherfx.files.disk_cache import kept
from featherfx.groom.keys.problems import INVALID, Place
from featherfx.groom.presets.presets import KindStore
from featherfx.groom.read.drafts import Draft
from featherfx.groom.read.space import DrawnFeather, GroomReaders, Space
from featherfx.groom.regions.kinds import (
    RANDOM_STREAMS,
    RegionKinds,
    SkinBends,
    laid_along,
    normal_draws,
    region_kinds,
    shapes,
)
from featherfx.groom.regions.rules import (
    GroomSkin,
    Presence,
    Rule,
    along_skin,
    flow,
    painted_colours,
    presence,
)
from featherfx.groom.regions.scatter import (
    Scattered,
    expected_count,
    read_previous,
    scatter,
    scatter_by_density,
    take_ids,
)
from featherfx.groom.skin.field import search_tree
from featherfx.groom.skin.points import SkinSource, SkinSurface, SurfacePoints
from featherfx.phases import phase

_PLACES = "triangle", "barycentric", "position", "normal"
# between one region's colour and another's, and the width over which they pass, over that of other
# things: by eye, as on a pigeon's neck
_STEPS, _COLOUR_WIDTH = 4, 3.0
_MIN_FIT = 0.4  # of a feather's length, left where there is no room; by coverage of creases


@dataclass(frozen=True)
class Region:
    """One region, ready to grow."""

    entry: dict[str, Any]
    place: Place
    surface: SkinSurface
    kinds: RegionKinds
    presence: Presence
    tint: Presence
    flow: Rule
    space: Space
    colours: Rule | None

    def length(self, points: SurfacePoints) -> Array:
        """(N,) m, at points; of several kinds the mean."""
        given = self.entry["length"]
        if given is None:
            return self.kinds.weights(points) @ self.kinds.lengths
        return np.full(len(points), float(given))

    def fit(self, points: SurfacePoints) -> Array:
        """(N,) share of their length that feathers have room for."""
        most = self.entry["max_length_per_free_radius"]
        if most is None:
            return np.ones(len(points))
        room = points.interpolated(self.surface.room)
        return np.asarray(np.clip(most * room / self.length(points), _MIN_FIT, 1.0))

    @property
    def _densest(self) -> float:
        """Density where feathers are shortest, over that of the region."""
        keys = "density", "length", "max_length_per_free_radius"
        return 1.0 if any(self.entry[key] is None for key in keys) else 1.0 / _MIN_FIT

    @property
    def most(self) -> float:
        """Feathers per m^2 where their spread is 1; of a region with a density."""
        return float(self._densest * self.entry["density"])

    def density(self, points: SurfacePoints) -> Array:
        """(N,) feathers per m^2; of a region with a density."""
        return self.most * self.spread(points)

    @cached_property
    def spread(self) -> Presence:
        """Presence of feathers, against where they are shortest: rows are as near as feathers are
        short."""
        if self._densest == 1.0:
            return self.presence

        def closeness(points: SurfacePoints) -> Array:
            return _MIN_FIT / self.fit(points)

        def bound(surface: SkinSurface, triangles: Indices) -> Array:
            places = (np.tile(corner, (len(triangles), 1)) for corner in np.eye(3))
            return np.max([closeness(surface.at(triangles, each)) for each in places], axis=0)

        own, keys = self.presence, ("max_length_per_free_radius", "length")
        rules, bounds = (*own.rules, closeness), (*own.bounds, bound)
        inputs = *own.inputs, _MIN_FIT, *(self.entry[key] for key in keys)
        return replace(own, rules=rules, bounds=bounds, inputs=inputs)


# regions of a groom, and the skins that they grow on
GrownRegions = tuple[tuple[Region, ...], tuple[SkinSurface, ...]]
_LISTENER: ContextVar[list[GrownRegions] | None] = ContextVar("tracts", default=None)


@contextmanager
def collect_regions() -> Iterator[list[GrownRegions]]:
    """Collect the regions of grooms that are read within; they hold their stages open."""
    found: list[GrownRegions] = []
    token = _LISTENER.set(found)
    try:
        yield found
    finally:
        _LISTENER.reset(token)


def grow_regions(
    raw: dict[str, Any],
    parts: dict[str, Any],
    place: Place,
    store: KindStore,
    readers: GroomReaders | None,
    space: Space,
) -> tuple[tuple[Draft, ...], Array | None]:
    """Return feathers of all regions, and corners (T, 3, 3) m of their meshes.

    raw, parts: the groom as written and as checked. Problems go to place.
    """
    written, entries = raw.get("region", []), parts["region"]
    if not isinstance(written, list):
        return (), None
    first: dict[str, Place] = {}
    for at, entry in entries:
        if first.setdefault(entry["id"], at) is not at:
            other = first[entry["id"]].key
            at.child("id").fail(f"'{entry['id']}' is taken by {other}. Choose another")
    skin, at = parts["skin"], place.child("skin")
    if skin is None:
        at.fail("is missing. Add [skin], since [[region]] grows on a skin")
    if skin is None or skin is INVALID or len(entries) < len(written):
        return (), None
    if readers is None:
        at.fail("is a USD scene, which featherfx.read_groom and the commands read")
        return (), None
    if parts["layout"] is not None:
        entries = [(own, _unbent(entry)) for own, entry in entries]
    return _region_drafts(skin, entries, at, store, readers, space)


def _unbent(entry: dict[str, Any]) -> dict[str, Any]:
    """A region whose feathers bend as their leaves do: few shapes in all. A curl raises tips as a
    tilt by half of it does, which the chord of an arc has."""
    spread, tilt = entry["variation"], entry["tilt"] - 0.5 * entry["curl"]
    spread = spread | {"curl": 0.0, "tilt": float(np.hypot(spread["tilt"], 0.5 * spread["curl"]))}
    return entry | {"curl": 0.0, "follow": 0.0, "tilt": tilt, "variation": spread}


def _region_drafts(
    skin: dict[str, Any],
    entries: Sequence[tuple[Place, dict[str, Any]]],
    place: Place,
    store: KindStore,
    readers: GroomReaders,
    space: Space,
) -> tuple[tuple[Draft, ...], Array | None]:
    """The drafts of all [[region]]s and the corners (T, 3, 3) m of their meshes.

    No drafts, and None, after adding problems. skin: checked keys of [skin]. entries: place and
    checked keys of each region. place: of [skin].
    """
    folder = Path(place.source).parent
    count = len(place.problems)
    paths = {skin["prim"]: place.child("prim")}
    for at, entry in entries:
        if entry["prim"]:
            paths.setdefault(entry["prim"], at.child("prim"))
    sources: dict[str, SkinSource] = {}
    with place.problems.collecting():
        sources = readers.skin(skin, paths, folder, place)
    for path, source in sources.items():
        if source.is_ribbon:
            paths[path].fail(f"{path} is no Mesh, on which alone regions grow")
    # what was told before, of a bird's skin, is no further problem
    if len(place.problems) > count or len(sources) < len(paths):
        return (), None
    skins = {path: GroomSkin(SkinSurface(each), space, folder) for path, each in sources.items()}
    colours: dict[str, Rule] = {}
    for path, each in skins.items() if skin["colours"] else ():
        with place.problems.collecting():
            colours[path] = painted_colours(skin["colours"], each, place.child("colours"))
    regions, previous = [], []
    for at, entry in entries:
        with place.problems.collecting():
            path = entry["prim"] or skin["prim"]
            regions.append(_region(entry, at, skins[path], store, colours.get(path)))
        with place.problems.collecting():
            previous.append(read_previous(entry, folder, at, readers.feathers))
    counts = [_count(region) for region in regions]
    _check_total(regions, counts, skin["max_feathers"], place)
    _warn_of_nowhere(regions, counts, place)
    if len(place.problems) > count:
        return (), None
    drafts: list[Draft] = []
    with phase("growing", sum(counts)) as done:
        totals = accumulate(counts)
        for region, wanted, earlier, grown in zip(regions, counts, previous, totals, strict=True):
            drafts += _grown(region, wanted, regions, earlier)
            done(grown)
    surfaces = tuple(each.surface for each in skins.values())
    if (listeners := _LISTENER.get()) is not None:
        listeners.append((tuple(regions), surfaces))
    return tuple(drafts), np.concatenate([each.corners for each in surfaces])


def _region(
    entry: dict[str, Any], place: Place, skin: GroomSkin, store: KindStore, colours: Rule | None
) -> Region:
    """Raises InputError."""
    surface = skin.surface
    _, kinds, where, along = all_of(
        partial(_check_number, entry, place.child("density")),
        partial(region_kinds, entry, place, skin, store),
        partial(presence, entry["where"], skin, place.child("where")),
        partial(flow, entry["flow"], surface, place.child("flow")),
    )
    length = float(entry["length"] or kinds.lengths.max())
    if length > surface.diagonal:
        place.child("length").refuse(
            f"{length:g} m is longer than the whole skin {surface.source.path}, "
            f"{surface.diagonal:.3g} m. Are its units right?"
        )
    wide = tuple(each | {"soft": _COLOUR_WIDTH * each["soft"]} for each in entry["where"])
    tint = presence(wide, skin, place.child("where"))
    return Region(entry, place, surface, kinds, where, tint, along, skin.space, colours)


def _check_number(entry: dict[str, Any], place: Place) -> None:
    if (entry["density"] is None) == (entry["count"] is None):
        place.refuse("expects either density or count, one of the two")


def _count(region: Region) -> int:
    """Feathers that a region asks for; of a density kept between runs."""
    entry, source = region.entry, region.surface.source
    if entry["count"] is not None:
        return int(entry["count"])
    inputs = [source.points, source.triangles, region.spread.inputs, entry["density"]]

    def compute() -> dict[str, Any]:
        return {"count": round(expected_count(region.surface, region.density))}

    return int(kept("count", inputs, compute)["count"])


def _check_total(regions: Sequence[Region], counts: Sequence[int], most: int, at: Place) -> None:
    if sum(counts) <= most:
        return
    large = [(r, count) for r, count in zip(regions, counts, strict=True) if count > most // 4]
    for region, count in large:
        key = "density" if region.entry["count"] is None else "count"
        told = f"asks for {count} feathers of the {most} that max_feathers of [skin] allows"
        region.place.child(key).fail(f"{told}. Lower it, or raise that")
    if not large:
        told = f"the regions ask for {sum(counts)} feathers, more than {most}"
        at.child("max_feathers").fail(f"{told}. Lower a density or raise max_feathers")


def _warn_of_nowhere(regions: Sequence[Region], counts: Sequence[int], at: Place) -> None:
    """Warn of regions that ask for feathers where their rules leave no skin."""
    ids = [
        f"'{region.entry['id']}'"
        for region, count in zip(regions, counts, strict=True)
        if count == 0 and region.entry["density"]
    ]
    if ids:
        told = "has no place on the skin" if len(ids) == 1 else "have no place on the skin"
        warn_input(
            f"{at.source}: {some_of(ids)} {told} and no feathers. Check `where`, or `bare`", 3
        )


def _grown(
    region: Region, count: int, regions: Sequence[Region], previous: Sequence[DrawnFeather]
) -> list[Draft]:
    """The drafts of a region. previous: feathers whose ids they take, none to have their own."""
    entry = region.entry
    found = _scattered(region, count)
    points = found.points
    # of a density there may be some more or fewer
    if len(points) < count if entry["density"] is None else 2 * len(points) + 3 < count:
        warn_input(
            f"{region.place.source}: {region.place.key}: '{entry['id']}' has hardly any place on "
            f"the skin, which reaches {_reach(region)} as this groom's points are written: "
            f"{len(points)} of {count} feathers{'' if region.space.given else _OWN_SPACE}"
        )
    found = _above_ground(region, found)
    points = found.points
    if len(points) == 0:
        return []
    ids = [_name(entry, number) for number in found.number]
    if previous:
        found, ids = take_ids(entry, found, previous, ids)
    own = region.kinds.drawn(points, entry["seed"], found.number)
    blend = _blended(region, [r for r in regions if r.surface is region.surface], points, own)
    mixtures = blend.pop("mixtures")
    blend["length"] *= region.fit(points)
    draws = {name: normal_draws(entry, name, found.number) for name in RANDOM_STREAMS}
    direction = _directions(region, blend["flow"], points, draws["turn"])
    cambers = region.kinds.cambers[own], region.kinds.barb_cambers[own]
    width, curl, hollow = shapes(entry, blend, direction, points, found.number, cambers)
    tilt = blend["tilt"] + draws["tilt"]
    rotations = _tilted(direction, points.normal, tilt)
    if entry["follow"]:
        bends = SkinBends(cambers[0] + curl, cambers[1] + hollow)
        rotations = laid_along(points, rotations, blend["length"], tilt, bends)
    scales = blend["length"] * (1.0 + draws["length"]) / region.kinds.lengths[own]
    left = np.full(len(points), entry["side"] == "left")
    if entry["side"] == "auto":
        left = region.space.is_left(points.position)
    paint = None if region.colours is None else region.colours(points).clip(0.0, 1.0)
    return [
        Draft(
            id=ids[k],
            choice=region.kinds.choices[own[k]],
            position=points.position[k],
            rotation=rotations[k],
            region=entry["id"],
            joint=entry["joint"],
            left=bool(left[k]),
            scale=float(scales[k]),
            width=float(width[k]),
            roll=float(entry["roll"] + draws["roll"][k]),
            place=region.place,
            skin=entry["prim"] or "",
            curl=float(curl[k]),
            hollow=float(hollow[k]),
            grown=True,
            stiffness=entry["stiffness"],
            weight=entry["weight"],
            mixture=mixtures[k],
            paint=() if paint is None else tuple(paint[k].tolist()),
        )
        for k in range(len(points))
    ]


def _name(entry: dict[str, Any], number: int) -> str:
    """Return the id of the feather of a candidate."""
    return f"{entry['id']}_{number:010x}"


def _scattered(region: Region, count: int) -> Scattered:
    """Places of so many feathers or of a density, kept between runs; fewer without room."""
    surface, entry = region.surface, region.entry
    source, density = surface.source, entry["density"]
    # places of its own, or where regions pass into each other feathers would stand in pairs
    seed = entry["seed"] ^ crc32(entry["id"].encode())
    wanted = count if density is None else float(density)
    inputs: list[Any] = [source.points, source.triangles, source.own_matrix, source.stage_matrix]
    inputs += [region.spread.inputs, wanted, seed]

    def compute() -> dict[str, Any]:
        if density is None:
            found = scatter(region.spread, count, seed)
        else:
            found = scatter_by_density(region.spread, region.most, seed)
        places = {name: getattr(found.points, name) for name in _PLACES}
        return {"number": found.number, **places}

    arrays = kept("scatter", inputs, compute)
    number = arrays.pop("number")
    return Scattered(SurfacePoints(surface, **arrays), number)


def _tilted(direction: Array, normal: Array, tilt: Array) -> Array:
    """(N, 3, 3) frames of shafts along directions (N, 3) of a skin, raised by tilt (N,) deg."""
    angle = np.radians(np.clip(tilt, -89.0, 89.0))[:, None]
    shaft = np.cos(angle) * direction + np.sin(angle) * normal
    return frames_from(shaft, np.cos(angle) * normal - np.sin(angle) * direction)


def _blended(
    region: Region, others: Sequence[Region], points: SurfacePoints, own: Indices
) -> dict[str, Any]:
    """Length (m), width, curl, tilt, flow and mixtures at points, between those of overlapping
    regions.

    own: (N,) kinds of the region's feathers, which keep their own length within it.
    """
    members = [r for r in others if r.entry["blend"]] if region.entry["blend"] else [region]
    weights, tints = [], []
    result = {name: np.zeros(len(points)) for name in ("length", "width", "curl", "tilt")}
    along = np.zeros((len(points), 3))
    for each in members:
        weight = each.presence(points)
        weights.append(weight)
        tints.append(each.tint(points))
        for name, value in result.items():
            value += weight * (each.length(points) if name == "length" else each.entry[name])
        along += weight[:, None] * each.flow(points)
    total = np.sum(weights, axis=0)
    result = {name: value / total for name, value in result.items()}
    if region.entry["length"] is None:
        # a mean over its kinds that each feather departs from by its own kind
        result["length"] *= region.kinds.lengths[own] / region.length(points)
    names = [each.entry["id"] for each in members]
    return result | {"flow": along, "mixtures": _mixtures(names, np.stack(tints, axis=1))}


def _mixtures(names: Sequence[str], weights: Array) -> list[tuple[tuple[str, float], ...]]:
    """As of Draft, of the two of which there is most, in few steps, so that few shapes differ by
    their colour alone. weights: (N, K) of regions by name."""
    second = np.sort(weights, axis=1)[:, -2:][:, :1]
    weights = np.where(weights >= second, weights, 0.0)
    steps = np.round(_STEPS * weights / weights.sum(axis=1, keepdims=True))
    parts = steps / np.maximum(steps.sum(axis=1, keepdims=True), 1.0)
    return [
        tuple((names[k], round(float(row[k]), 3)) for k in range(len(names)) if row[k] > 0.0)
        for row in parts
    ]


def _above_ground(region: Region, found: Scattered) -> Scattered:
    """Without the places that lie inside the body, which are told."""
    buried = region.surface.buried(found.points)
    if not buried.any():
        return found
    ids = [_name(region.entry, number) for number in found.number[buried]]
    warn_input(
        f"{region.place.source}: {region.place.key}: {len(ids)} roots lie inside the body and are "
        f"left out: {some_of(ids)}",
        3,
    )
    return Scattered(found.points.some(~buried), found.number[~buried])


_OWN_SPACE = ". A [space] with of = 'skin' writes them in the axes of the skin itself"


def _reach(region: Region) -> str:
    """Least and greatest of the skin along the axes of the groom's space."""
    corners = region.space.local(region.surface.corners.reshape(-1, 3))
    ends = zip("xyz", corners.min(axis=0), corners.max(axis=0), strict=True)
    return ", ".join(f"{axis} {low:.3g} to {high:.3g}" for axis, low, high in ends)


def _directions(region: Region, wanted: Array, points: SurfacePoints, turn: Array) -> Array:
    """Unit directions along the skin; where the rule gives none, that of the nearest root."""
    flat = along_skin(wanted, points.normal)
    missing = ~flat.any(axis=1)
    if missing.all():
        region.place.child("flow").fail(
            "gives no direction along the skin at any root. Draw it along it"
        )
        flat = np.cross(points.normal, points.normal[:, [1, 2, 0]] + 0.1)
        return flat / np.linalg.norm(flat, axis=1, keepdims=True)
    if missing.any():
        known = np.flatnonzero(~missing)
        _, near = search_tree(points.position[known]).query(points.position[missing])
        borrowed = along_skin(flat[known[near]], points.normal[missing])
        across = along_skin(np.cross(flat[known[near]], [0.6, 0.64, 0.48]), points.normal[missing])
        flat[missing] = np.where(np.asarray(borrowed.any(axis=1))[:, None], borrowed, across)
    angle = np.radians(turn)[:, None]
    return np.asarray(np.cos(angle) * flat + np.sin(angle) * np.cross(points.normal, flat))
