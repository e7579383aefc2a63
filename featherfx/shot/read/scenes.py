"""The parts of a shot that stand in scenes: skin, wind and colliders."""

from __future__ import annotations

import math
import warnings
from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from featherfx.errors import InputWarning, warn_input
from featherfx.groom.keys.problems import Place, Problems
from featherfx.groom.read.space import SceneReaders
from featherfx.groom.types import Groom
from featherfx.phases import StageRead, note_read
from featherfx.shot.frames import StageClock
from featherfx.shot.patterns import Channel, Target
from featherfx.shot.read.motion import ClockReader
from featherfx.shot.skin import SkinSurfaces
from featherfx.shot.sources import MovingSurface, OfScene, TimedCamera, TimedSurface, TimedWind
from featherfx.shot.types import LevelOfDetail

_MIN_MAP = 0.5  # value of a map at the middle of a triangle from which on it is touched
_LOOKS = 5  # frames of the shot that tell how far a surface moves


def read_skin(
    checked: dict[str, Any],
    groom: Groom,
    place: Place,
    given: SceneReaders | None,
    clocks: ClockReader,
) -> SkinSurfaces | None:
    """The skin that a shot's roots ride on; None where it has none.

    checked: the shot's keys. given: readers of scenes. Raises InputError.
    """
    at = replace(place.child("skin"), problems=Problems())
    entry = checked["skin"]
    if entry is None:
        return None
    readers = _needed(given, at)
    other = sorted({f.skin for f in groom.feathers if f.skin} - {entry["prim"]})
    # other meshes are named by feathers
    needed = {entry["prim"]: at.child("prim"), **dict.fromkeys(other, at)}
    path = readers.file(Path(place.source).parent, entry["usd"])
    motion = checked["motion"]
    is_driven = isinstance(motion, dict) and isinstance(motion.get("joints"), dict)
    surfaces = readers.meshes(path, needed, entry | {"is_driven": is_driven}, at)
    clock = clocks.clock(surfaces[0], entry, at)
    for surface in surfaces:
        _note(surface, "skin", checked, clock)
    if entry["extrapolation"] == "error":
        _check_range(surfaces, entry["rest"], checked, clock, at)
    for surface in surfaces:
        own = {surface.path, ""} if surface is surfaces[0] else {surface.path}
        placed = [f.id for f in groom.feathers if f.skin_uv is not None and f.skin in own]
        if placed and surface.st is None:
            at.fail(
                f"{surface.path} has no primvars:{entry['uv']}, "
                f"but '{placed[0]}' is placed by skin uv"
            )
    at.problems.hand_on()
    moving = tuple(_moving(each, entry, checked, clock, at) for each in surfaces)
    return SkinSurfaces(
        moving,
        clock,
        entry["tolerance"],
        at.source,
        at.key,
        entry["smoothing_radius"],
        entry["on_collapse"],
    )


def with_maps(
    channels: Sequence[Channel],
    groom: Groom,
    checked: dict[str, Any],
    place: Place,
    readers: SceneReaders | None,
) -> tuple[Channel, ...]:
    """The channels with what their maps say where the groom's roots are; problems where a map, or
    the shot's skin, is not there."""
    found, entry = [], checked["skin"]
    for index, channel in enumerate(channels):
        at = place.child("channel").item(index).child("map")
        if channel.map is not None and entry is None:
            at.fail("is of the shot's skin. Add [skin] to the shot")
        elif channel.map is not None and readers is not None:
            with place.problems.collecting():
                channel = replace(channel, factors=_factors(channel.map, groom, entry, at, readers))
        found.append(channel)
    return tuple(found)


def _factors(
    name: str, groom: Groom, entry: dict[str, Any], at: Place, readers: SceneReaders
) -> dict[str, float]:
    from featherfx.groom.skin.skin import closest

    surface, rule = _read_map(name, entry["prim"], entry, at, readers)
    roots = np.array([each.position for each in groom.feathers])
    values = rule(surface.at(*closest(roots, surface.corners)))
    ids = [each.id for each in groom.feathers]
    return dict(zip(ids, np.clip(values, 0.0, 1.0).tolist(), strict=True))


def _read_map(
    name: str, prim: str, entry: dict[str, Any], at: Place, readers: SceneReaders
) -> tuple[Any, Any]:
    """Return a mesh at rest and the rule of a primvar or picture on it."""
    from featherfx.groom.regions.rules import painted
    from featherfx.groom.skin.points import SkinSurface

    folder = Path(at.source).parent
    with warnings.catch_warnings():
        # holes matter to what grows on it, not to what is painted on it
        warnings.simplefilter("ignore", InputWarning)
        skins = readers.skin(entry, {prim: at}, folder, at)
    surface = SkinSurface(skins[prim])
    rule, _ = painted("image" if "." in name else "primvar", name, surface, folder, at)
    return surface, rule


def _mask(
    surface: MovingSurface, entry: dict[str, Any], at: Place, readers: SceneReaders
) -> MovingSurface:
    """Return the part of a collider that its map says is touched."""
    if entry["map"] is None or surface.bones is not None:
        return surface
    whole = {**entry, "rest": None}
    mesh, rule = _read_map(entry["map"], surface.path, whole, at.child("map"), readers)
    count = len(surface.triangles)
    chosen = rule(mesh.at(np.arange(count), np.full((count, 3), 1.0 / 3.0))) >= _MIN_MAP
    if not chosen.any():
        at.child("map").refuse(f"leaves no face of {surface.path}. Paint 1 where feathers touch")
    return surface.masked(chosen)


def with_shapes(
    targets: Sequence[Target], place: Place, readers: SceneReaders | None
) -> tuple[Target, ...]:
    """The targets with the meshes or curves of their files; problems where these cannot be read."""
    found = []
    for index, target in enumerate(targets):
        at = place.child("target").item(index).child("shape")
        if target.shape != "rest":
            with place.problems.collecting():
                own = _needed(readers, at)
                file = own.file(Path(at.source).parent, target.shape)
                points, lines = own.poses(file, target.frame, at)
                target = replace(target, points=points, lines=lines)
        found.append(target)
    return tuple(found)


def read_wind(
    checked: dict[str, Any], place: Place, given: SceneReaders | None, clocks: ClockReader
) -> TimedWind | None:
    """The wind that a scene adds; None where there is none. Raises InputError."""
    at = place.child("wind_usd")
    entry = checked["wind_usd"]
    if entry is None:
        return None
    readers = _needed(given, at)
    source = readers.wind(readers.file(Path(place.source).parent, entry["usd"]), entry, at)
    clock = clocks.clock(source, entry, at)
    _note(source, "wind", checked, clock)
    _warn_of_range(source, checked, clock, at)
    return TimedWind(source, clock, entry["scale"])


def read_colliders(
    checked: dict[str, Any], place: Place, given: SceneReaders | None, clocks: ClockReader
) -> tuple[TimedSurface, ...]:
    """The collider meshes of a shot; incomplete after adding problems."""
    found: list[TimedSurface] = []
    for at, entry in checked["collider"]:
        with place.problems.collecting():
            readers = _needed(given, at)
            if not entry["prims"] and entry["collection"] is None:
                at.refuse("names neither prims nor a collection. Give one of them")
            path = readers.file(Path(place.source).parent, entry["usd"])
            prims = {each: at.child("prims").item(k) for k, each in enumerate(entry["prims"])}
            for mesh in readers.meshes(path, prims, entry, at):
                if mesh.bones is not None:
                    at.fail(f"{mesh.path} is no Mesh, nothing can touch it")
                clock = clocks.clock(mesh, entry, at)
                _note(mesh, "collider", checked, clock)
                _warn_of_range(mesh, checked, clock, at)
                part = _mask(mesh, entry, at, readers)
                found.append(TimedSurface(_moving(part, entry, checked, clock, at), clock))
    return tuple(found)


def read_level_of_detail(
    checked: dict[str, Any], place: Place, given: SceneReaders | None, clocks: ClockReader
) -> LevelOfDetail | None:
    """Read how levels follow what is seen; None where they do not. Raises InputError."""
    at, values = place.child("level_of_detail"), checked["level_of_detail"]
    if values is None or not values["enabled"]:
        return None
    usd, prim, scale = (values[key] for key in ("usd", "prim", "pixels_per_metre"))
    if (usd is None) == (scale is None):
        at.refuse("needs either usd and prim of a camera, or pixels_per_metre")
    if (usd is None) != (prim is None):
        at.child("prim" if prim is None else "usd").refuse(
            "is missing. Give usd and prim of a camera"
        )
    camera = None
    if usd is not None:
        readers = _needed(given, at)
        source = readers.camera(readers.file(Path(place.source).parent, usd), prim, at)
        camera = TimedCamera(source, clocks.clock(source, values, at))
        _note(source, "camera", checked, camera.clock)
    left_out = ("enabled", "usd", "prim", "start", "time")
    rules = {name: value for name, value in values.items() if name not in left_out}
    return LevelOfDetail(camera=camera, **rules)


def _note(source: OfScene, role: str, checked: dict[str, Any], clock: StageClock) -> None:
    """Note what was read of a stage; its motion is measured where that is shown."""

    def describe() -> str:
        first, last = checked["frames"]
        codes = clock.start + clock.step * np.linspace(0, last - first, _LOOKS).round()
        rate = f"{source.time_codes_per_second:g} a second"
        told = f"frame {first} is time code {clock.start:g}, {rate}"
        return f"{told}; {source.describe_motion(np.unique(codes).tolist())}"

    note_read(StageRead(str(source.file), source.path, role, 1, source.left, describe))


def _needed(readers: SceneReaders | None, at: Place) -> SceneReaders:
    if readers is None:
        at.refuse("is a USD scene, which featherfx.read_shot and the commands read")
    return readers


def _moving(
    surface: MovingSurface,
    entry: dict[str, Any],
    checked: dict[str, Any],
    clock: StageClock,
    at: Place,
) -> MovingSurface:
    """A surface as it moves between whole frames: smoothly, unless the entry says otherwise.

    At whole frames it is as the scene has it. An InputWarning tells where it spins too fast for
    that.
    """
    if entry["interpolation"] == "linear" or surface.sampled is None:
        return surface
    knots, ends = clock.knots(surface.sampled, _span(checked)), _span(checked)
    first, last = ((clock.start + clock.step * end - knots.start) / knots.step for end in ends)
    codes = knots.start + knots.step * np.arange(math.floor(first), math.ceil(last) + 1)
    turns = [math.degrees(surface.turn(*each)) for each in pairwise(codes.tolist())]
    if max(turns, default=0.0) > 180.1:  # at half a turn, either way is as short
        k = int(np.argmax(turns))
        told = f"turns by {turns[k]:.0f} degrees from time code {codes[k]:g} to {codes[k + 1]:g}"
        told += ", and smooth motion between frames takes the short way round"
        warn_input(f'{at.source}: {at.key}: {surface.path} {told}. Give interpolation = "linear"')
    return surface.smoothed(knots)


def _span(checked: dict[str, Any]) -> tuple[int, int]:
    """Return the first and last frame of a shot with its handles, counted from its first."""
    first, last = checked["frames"]
    return -checked["handles"], last - first + checked["handles"]


def _check_range(
    surfaces: list[MovingSurface],
    rest: float | None,
    checked: dict[str, Any],
    clock: StageClock,
    at: Place,
) -> None:
    """Problems where shot or rest, a time code, run out of the samples of a moving surface."""
    for surface in surfaces:
        missing = _missing(surface, checked, clock)
        if missing:
            at.fail(f'{missing}. Add the missing frames, or extrapolation = "hold"')
        if rest is None or surface.sampled is None:
            continue
        low, high = surface.sampled
        if not low <= rest <= high:
            at.child("rest").fail(
                f"{rest:g} is outside of the samples of {surface.path}, which has {low:g} to "
                f'{high:g}. Choose one of them, or extrapolation = "hold"'
            )


def _warn_of_range(source: OfScene, checked: dict[str, Any], clock: StageClock, at: Place) -> None:
    missing = _missing(source, checked, clock)
    if missing:
        message = f"{at.source}: {at.key}: {missing}. The nearest is held beyond"
        warn_input(message)


def _missing(source: OfScene, checked: dict[str, Any], clock: StageClock) -> str:
    """Tell which samples a shot needs that a scene does not have; empty where it has all."""
    start, end = (clock.start + place * clock.step for place in _span(checked))
    low, high = source.sampled or (start, end)
    if low - 1e-6 <= start and end <= high + 1e-6:
        return ""
    return (
        f"{source.path} has samples from {low:g} to {high:g}, the shot needs {start:g} to {end:g}"
    )
