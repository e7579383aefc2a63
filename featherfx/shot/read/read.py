"""Shot files in: TOML to a Shot, with every problem of shot, groom and presets found at once."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import fields, replace
from fnmatch import fnmatchcase
from itertools import pairwise
from operator import truediv
from pathlib import Path
from typing import Any

import numpy as np

from featherfx.errors import Problem
from featherfx.groom.keys.groom import GROOM_FILE
from featherfx.groom.keys.problems import INVALID, Place, Problems
from featherfx.groom.presets.library import Library, plain, sourced
from featherfx.groom.presets.presets import check_preset
from featherfx.groom.read.read import SCENE_SUFFIXES, collect_groom, groom_of
from featherfx.groom.read.space import SceneReaders
from featherfx.groom.read.toml_file import file_kind, load_toml, told
from featherfx.groom.types import Groom
from featherfx.shot.motion.joints import with_body_joints
from featherfx.shot.patterns import (
    CHANNELS,
    Channel,
    Detachment,
    Detail,
    Force,
    Grip,
    Preen,
    Shelter,
    Target,
    Wet,
    fits,
)
from featherfx.shot.read.keys import SHOT_FILE
from featherfx.shot.read.motion import (
    DEFAULT_RATE,
    ClockReader,
    check_driven,
    check_rates,
    read_motion,
    warn_of_aliases,
    warn_of_length,
)
from featherfx.shot.types import Contact, Motion, Quality, Shot, Wind

Entries = list[tuple[Place, dict[str, Any]]]


def read_shot(
    path: str | Path,
    preset_folders: Iterable[str | Path] = (),
    readers: SceneReaders | None = None,
    tables: Mapping[str, Any] | None = None,
) -> Shot:
    """The shot that a TOML file describes, with its groom as its files have it.

    Feathers are not yet laid over each other, nor roots bound to a skin: shot/loop/placement.py.
    preset_folders: searched before the user's and the shipped presets. readers: of USD scenes.
    tables: instead of the file's. Raises InputError with all problems of the shot, its groom,
    tables, scenes and presets.
    """
    library, shot = Library(preset_folders, Problems()), None
    with library.problems.collecting():
        shot = _collect(Path(path), library, readers, tables)
    library.problems.raise_any()
    assert shot is not None
    return shot


def check_file(
    path: str | Path, preset_folders: Iterable[str | Path] = (), readers: SceneReaders | None = None
) -> list[Problem]:
    """List what is wrong with a shot, groom or preset file; empty when nothing is."""
    problems = Problems()
    path = Path(path)
    library = Library(preset_folders, problems)
    with problems.collecting():
        kind = file_kind(load_toml(path), path, {"shot": SHOT_FILE})
        if kind == "shot":
            _collect(path, library, readers)
        elif kind == "groom":
            collect_groom(path, library, readers)
        elif kind:
            check_preset(kind, path, library)
        else:
            problems.add(path, "", "is no shot, groom or preset: it holds no key of any")
    return problems.listed()


def _collect(
    path: Path,
    library: Library,
    readers: SceneReaders | None,
    tables: Mapping[str, Any] | None = None,
) -> Shot | None:
    problems = library.problems
    place = Place(str(path), "", problems)
    if path.suffix.lower() in SCENE_SUFFIXES and path.is_file():
        place.refuse("is a USD file, expects a shot, which may name it as its groom")
    raw = load_toml(path) if tables is None else dict(tables)
    _refuse_other_kinds(raw, path, place)
    place.problems.file_keys = SHOT_FILE.keys - raw.keys()
    place.problems.groom_keys = GROOM_FILE.keys
    parts = SHOT_FILE.parts(raw, place)
    sound = not len(problems)
    groom = _groom(raw, parts, place, library, readers)
    wind = quality = motion = None
    with problems.collecting():
        wind = read_preset("wind", raw, parts, place, library)
    with problems.collecting():
        quality = read_preset("quality", raw, parts, place, library)
    if (given := parts["motion"]) is not INVALID:
        with problems.collecting():
            at = place.child("motion")
            motion = read_motion(raw.get("motion"), given, at, library, groom, readers)
    loads = _loads(parts, groom)
    _check_frames(parts["frames"], place.child("frames"))
    _check_cuts(parts, place.child("cuts"))
    contact = _contact(parts["contact"], groom, place.child("contact"), sound)
    if not sound or groom is None:
        return None
    scenes = _scenes(parts, groom, place, readers)
    limbs = motion is not None and motion.of_limbs
    moves_skin = motion is not None and motion.moves_skin
    limbs &= moves_skin or any(feather.turning is not None for feather in groom.feathers)
    if motion is not None and moves_skin:
        surfaces = scenes["surfaces"] and scenes["surfaces"].surfaces
        if surfaces or parts["skin"] is None:  # else it could not be read, and is told
            check_driven(motion, groom, surfaces, place.child("motion").child("joints"))
        groom = with_body_joints(groom, motion.values["joints"], surfaces or ())
    if motion is not None and "motion" in raw and parts["skin"] is not None and not limbs:
        message = (
            "stands beside [skin], which moves the roots. A fold, flap or act of wings, tails "
        )
        place.child("motion").fail(message + "and crests may, where the groom has any")
    if loads["channels"] or loads["targets"]:
        from featherfx.shot.read.scenes import with_maps, with_shapes

        loads["channels"] = with_maps(loads["channels"], groom, parts, place, readers)
        loads["targets"] = with_shapes(loads["targets"], place, readers)
    if motion is not None:
        check_rates(motion, scenes["frames_per_second"], place.child("motion"))
    if len(problems) or motion is None:
        return None
    first, last = parts["frames"]
    warn_of_aliases(motion, scenes["frames_per_second"], str(path))
    warn_of_length(motion, (first, last), scenes["frames_per_second"], str(path))
    as_they_are = ("name", "settle", "preroll", "handles", "cuts", "sleep", "cycle")
    return Shot(
        **{name: parts[name] for name in as_they_are},
        source=path,
        groom=groom,
        first_frame=first,
        last_frame=last,
        motion=Motion("skin", {}) if scenes["surfaces"] and not limbs else motion,
        wind=wind,
        quality=quality,
        gravity=np.array(parts["gravity"]),
        contact=contact,
        inputs=dict(groom.inputs) | _said(raw, library, path.parent),
        **loads,
        **scenes,
    )


def _refuse_other_kinds(raw: dict[str, Any], path: Path, place: Place) -> None:
    if "flock" in raw:
        place.refuse("is a flock, expects a shot. featherfx bake and bake_flock take flocks")
    kind = "shot" if {"groom", "frames"} & raw.keys() else file_kind(raw, path, {"shot": SHOT_FILE})
    if kind not in ("shot", ""):
        told = "a groom" if kind == "groom" else f"a {kind} preset"
        more = f', a file with groom = "{path.name}" and frames' if kind == "groom" else ""
        place.refuse(f"is {told}, expects a shot{more}")


def _said(raw: dict[str, Any], library: Library, folder: Path) -> dict[str, str]:
    values = raw if isinstance(raw["groom"], str) else raw | {"groom": "in the shot"}
    own = told(values, folder)
    return library.said | {f"shot.{key}": text for key, text in own.items()}


def _scenes(
    parts: dict[str, Any], groom: Groom, place: Place, readers: SceneReaders | None
) -> dict[str, Any]:
    """Fields of a shot that stand in scenes; None after adding problems."""
    clocks = ClockReader(parts["frames"][0], parts["frames_per_second"])
    found: dict[str, Any] = {"surfaces": None, "colliders": (), "wind_source": None}
    found["level_of_detail"] = None
    if any(parts[name] for name in ("skin", "collider", "wind_usd", "level_of_detail")):
        from featherfx.shot.read import scenes

        ways: dict[str, Callable[[], Any]] = {
            "surfaces": lambda: scenes.read_skin(parts, groom, place, readers, clocks),
            "colliders": lambda: scenes.read_colliders(parts, place, readers, clocks),
            "wind_source": lambda: scenes.read_wind(parts, place, readers, clocks),
            "level_of_detail": lambda: scenes.read_level_of_detail(parts, place, readers, clocks),
        }
        for name, way in ways.items():
            found[name] = None
            with place.problems.collecting():
                found[name] = way()
    rate = clocks.frames_per_second or DEFAULT_RATE
    written = clocks.written_rate or rate
    return found | {"frames_per_second": rate, "time_codes_per_second": written}


def _contact(
    values: dict[str, Any] | None, groom: Groom | None, place: Place, sound: bool
) -> Contact | None:
    if not sound or values is None or not values["enabled"]:
        return None
    known = _names(groom)
    for key, one in (("regions", "region"), ("kinds", "kind")):
        for i, pattern in enumerate(values[key] or ()):
            _check_pattern(pattern, one, known[one], place.child(key).item(i))
    return Contact(**{each.name: values[each.name] for each in fields(Contact)})


def _check_frames(frames: Any, place: Place) -> None:
    if frames is not INVALID and frames[1] < frames[0]:
        place.fail(f"the last frame {frames[1]} comes before the first {frames[0]}")


def _check_cuts(parts: dict[str, Any], place: Place) -> None:
    """Refuse cuts at frames that are not written."""
    if INVALID in (parts["frames"], parts["cuts"], parts["handles"]):
        return
    (first, last), handles = parts["frames"], parts["handles"]
    for index, frame in enumerate(parts["cuts"] or ()):
        if not first - handles <= frame <= last + handles:
            place.item(index).fail(f"{frame} is not of the shot. Give {first} to {last}")


def _groom(
    raw: dict[str, Any],
    parts: dict[str, Any],
    place: Place,
    library: Library,
    readers: SceneReaders | None,
) -> Groom | None:
    given = parts["groom"]
    above = [(parts["overrides"], place)]
    path = Path(place.source)
    count = len(library.problems)
    if given is INVALID:
        return None
    file = readers.file if readers is not None else truediv
    groom = None
    with library.problems.collecting():
        if isinstance(given, str):
            groom = collect_groom(file(path.parent, given), library, readers, above)
        elif "name" not in given:
            usd = given["usd"]
            entry = {name: value for name, value in raw["groom"].items() if name != "usd"}
            tables = {"name": Path(usd).stem, "usd": entry | {"file": usd}}
            groom = groom_of(tables, path, library, readers, above)
            groom = groom and replace(groom, source=file(path.parent, usd))
        else:
            groom = groom_of(given, path, library, readers, above, "groom")
    if groom is None or len(library.problems) > count:
        return None  # half a groom would mislead later checks
    return groom


def read_preset(
    family: str, raw: dict[str, Any], parts: dict[str, Any], place: Place, library: Library
) -> Any:
    """The Wind or Quality of a checked file; None where its key is wrong. Raises InputError."""
    given, at = parts[family], place.child(family)
    if given is INVALID:
        return None
    table = {"base": given} if isinstance(given, str) else given
    named = isinstance(raw.get(family, given), str)
    tree = library.merged(family, sourced(table, at.source), at, "" if named else "base")
    values = plain(tree)
    if family == "quality":
        if (rows := values.get("simulated_rows", 0)) in (1, 2):  # a mesh has three
            at.child("simulated_rows").fail(f"{rows} is out of range. Give -1, 0, or 3 to 400")
        return Quality(name=table.get("base") or "custom", **values)
    return Wind(**values | {"direction": np.array(values["direction"])})


def _loads(parts: dict[str, Any], groom: Groom | None) -> dict[str, Any]:
    """Fields of a shot that are about some of its feathers; problems where these are not there."""
    names = ("grip", "force", "detail", "shelter", "preen", "wet", "detach", "channel", "target")
    grips, forces, details, shelters, preens, wets, detachments, channels, targets = (
        parts[name] for name in names
    )
    _check_ids(grips, groom)
    _check_times([*grips, *preens])
    _check_ids(forces, groom)
    _check_forces(forces)
    _check_patterns([*details, *shelters, *preens, *wets, *detachments, *channels, *targets], groom)
    _check_preens(preens, groom)
    _check_fractions(wets, "{:g} s")
    _check_frames_of([*detachments, *targets], parts["frames"])
    _check_channels(channels)
    _check_fractions(targets)
    return {
        "grips": tuple(
            Grip(**entry | {"displacement": np.array(entry["displacement"])}) for _, entry in grips
        ),
        "forces": tuple(
            Force(**entry | {"force": np.array(entry["force"])}) for _, entry in forces
        ),
        "details": tuple(Detail(**entry) for _, entry in details),
        "shelters": tuple(Shelter(**entry) for _, entry in shelters),
        "preens": tuple(Preen(**entry) for _, entry in preens),
        "wets": tuple(Wet(**entry) for _, entry in wets),
        "detachments": tuple(Detachment(**entry) for _, entry in detachments),
        "channels": tuple(Channel(**entry) for _, entry in channels),
        "targets": tuple(Target(**entry) for _, entry in targets),
    }


def _check_preens(entries: Entries, groom: Groom | None) -> None:
    for at, entry in entries:
        stroke = Preen(**entry)
        found = [each for each in groom.feathers if fits(stroke, each)] if groom else []
        held = [k for k in (each.kind for each in found) if k.vane_material.hooks == "closed"]
        if found and len(held) == len(found) and not any(kind.is_split for kind in held):
            at.fail(
                'closes nothing: vane_material.hooks is "closed" in all feathers that it fits, and '
                "none has splits. Give slip or open there"
            )


def _check_fractions(entries: Entries, said: str = "frame {:g}") -> None:
    """Keys with values from 0 to 1, in order."""
    for at, entry in entries:
        for index, (_, fraction) in enumerate(entry["keys"]):
            if not 0.0 <= fraction <= 1.0:
                place = at.child("keys").item(index).item(1)
                place.fail(f"{fraction:g} is out of range. Give 0 to 1")
        _check_later(at.child("keys"), entry["keys"], said)


def _check_frames_of(entries: Entries, frames: Any) -> None:
    for at, entry in entries:
        frame = entry["frame"]
        if frames is not INVALID and frame is not None and not frames[0] <= frame <= frames[1]:
            at.child("frame").fail(f"{frame} is not of the shot. Give {frames[0]} to {frames[1]}")


def _check_channels(entries: Entries) -> None:
    for at, entry in entries:
        least, most, _ = CHANNELS[entry["name"]]
        for index, (_, value) in enumerate(entry["keys"]):
            if not least <= value <= most:
                place = at.child("keys").item(index).item(1)
                allowed = f"Give {entry['name']} {least:g} to {most:g}"
                place.fail(f"{value:g} is out of range. {allowed}")
        _check_later(at.child("keys"), entry["keys"], "frame {:g}")


def _check_later(at: Place, keys: Sequence[Sequence[float]], said: str = "{:g} s") -> None:
    for index, (before, after) in enumerate(pairwise(keys)):
        if after[0] <= before[0]:
            now, earlier = said.format(after[0]), said.format(before[0])
            at.item(index + 1).fail(f"{now} is not later than {earlier} of the key before")


def _check_times(entries: Entries) -> None:
    for at, entry in entries:
        if entry["end"] <= entry["start"]:
            start = entry["start"]
            at.child("end").fail(f"{entry['end']:g} is not later than start = {start:g} s")


def _check_forces(entries: Entries) -> None:
    for at, entry in entries:
        first, last = entry["span"]
        if last <= first:
            at.child("span").fail(f"{last:g} is not above {first:g}. Give [first, last]")
        _check_later(at.child("keys"), entry["keys"])


def _names(groom: Groom | None) -> dict[str, set[str]]:
    """Return the names that patterns of ids, regions and kinds may stand for."""
    feathers = groom.feathers if groom is not None else ()
    return {
        "feathers": {feather.id for feather in feathers},
        "region": {feather.region for feather in feathers},
        "kind": {feather.kind.name for feather in feathers},
    }


def _check_patterns(entries: Entries, groom: Groom | None) -> None:
    known = _names(groom)
    for at, entry in entries:
        for key, names in known.items():
            what = "feather" if key == "feathers" else key
            _check_pattern(entry[key], what, names, at.child(key))
        for index, pattern in enumerate(entry["exclude"]):
            _check_pattern(pattern, "feather", known["feathers"], at.child("exclude").item(index))


def _check_pattern(pattern: str, what: str, names: set[str], place: Place) -> None:
    fits = pattern in names or any(fnmatchcase(each, pattern) for each in names)
    if names and not fits:
        message, named = f"no {what} of the groom fits '{pattern}'", names - {""}
        if named:
            place.unknown(message, pattern, named)
        else:
            place.fail(f"{message}: no feather has one")


def _check_ids(entries: Entries, groom: Groom | None) -> None:
    ids = {feather.id for feather in groom.feathers} if groom is not None else set()
    examples = ", ".join(sorted(ids)[:3]) if entries else ""
    for at, entry in entries:
        name = entry["feather"]
        if groom is not None and name not in ids:
            meant = at.problems.nearest(name, ids)
            if not meant.startswith("did"):
                meant = f"its ids are like {examples}"
            at.child("feather").fail(f"no feather '{name}' in the groom, {meant}")
