"""Shot files in: TOML to a Shot, with every problem of shot, groom and presets found at once."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from featherfx.errors import Problem
from featherfx.groom.keys.groom import GROOM_FILE
from featherfx.groom.keys.preset import FAMILIES
from featherfx.groom.keys.values import INVALID, Place, Problems, nearest
from featherfx.groom.presets.library import Library, plain, sourced
from featherfx.groom.presets.presets import check_preset
from featherfx.groom.read.read import collect_groom, groom_of
from featherfx.groom.read.toml_file import load_toml
from featherfx.groom.types import Groom
from featherfx.shot.read.keys import SHOT_FILE
from featherfx.shot.read.loads import read_details, read_forces, read_grips, read_shelters
from featherfx.shot.read.scenes import read_colliders, read_level_of_detail, read_skin, read_wind
from featherfx.shot.read.sources import SceneReaders
from featherfx.shot.types import Contact, Motion, Quality, Shot, Wind


def read_shot(
    path: str | Path,
    preset_folders: Iterable[str | Path] = (),
    readers: SceneReaders | None = None,
) -> Shot:
    """The shot that a TOML file describes, with its groom as its files have it.

    Feathers are not yet laid over each other, nor roots bound to a skin: featherfx.shot.placement.
    preset_folders: searched before the user's and the shipped presets. readers: of USD scenes.
    Raises InputError with all problems of the shot, its groom, tables, scenes and presets.
    """
    library = Library(preset_folders, Problems())
    shot = _collect(Path(path), library, readers)
    library.problems.raise_any()
    assert shot is not None
    return shot


def check_file(
    path: str | Path,
    preset_folders: Iterable[str | Path] = (),
    readers: SceneReaders | None = None,
) -> list[Problem]:
    """What is wrong with a shot, groom or preset file; empty when nothing is."""
    problems = Problems()
    path = Path(path)
    library = Library(preset_folders, problems)
    raw = load_toml(path, problems)
    if raw is None:
        return problems.listed()
    kind = _file_kind(raw, path)
    if kind == "shot":
        _collect(path, library, readers)
    elif kind == "groom":
        collect_groom(path, library, readers)
    elif kind:
        check_preset(kind, path, library)
    else:
        problems.add(path, "", "is no shot, groom or preset: it holds no key of any")
    return problems.listed()


def _file_kind(raw: dict[str, Any], path: Path) -> str:
    """What knows most of the keys: "shot", "groom" or a preset family; "" where nothing does.

    A file in a folder named like a family is a preset of that family.
    """
    folder = path.absolute().parent.as_posix()
    for family in FAMILIES:
        if folder.endswith(f"/{family}"):
            return family
    tables = {"shot": SHOT_FILE, "groom": GROOM_FILE}
    tables |= {name: family.extended for name, family in FAMILIES.items()}
    known = {name: sum(key in table.keys for key in raw) for name, table in tables.items()}
    best = max(known, key=lambda name: known[name])
    return best if known[best] else ""


def _collect(path: Path, library: Library, readers: SceneReaders | None) -> Shot | None:
    problems = library.problems
    raw = load_toml(path, problems)
    if raw is None:
        return None
    place = Place(str(path), "", problems)
    parts = SHOT_FILE.parts(raw, place)
    sound = not len(problems)
    groom = _groom(raw, parts, place, library, readers)
    motion, wind, quality = (
        _preset(name, raw, parts, place, library) for name in ("motion", "wind", "quality")
    )
    grips, forces = read_grips(parts["grip"], groom), read_forces(parts["force"], groom)
    details = read_details(parts["detail"], groom)
    shelters = read_shelters(parts["shelter"], groom)
    _check_frames(parts["frames"], place.child("frames"))
    contact = _contact(parts["contact"]) if sound else None
    if sound and parts["cycle"] and contact is not None:
        message = "feathers that touch act on each other and are not replayed: leave out contact"
        place.child("cycle").fail(message)
    _check_keyframes(motion, groom, place.child("motion"))
    if not sound or groom is None:
        return None
    colliders = read_colliders(parts, place, readers)
    skin = read_skin(raw, parts, groom, place, readers)
    wind_source = read_wind(parts, place, readers)
    level_of_detail = read_level_of_detail(parts, place, readers)
    if len(problems):
        return None
    first, last = parts["frames"]
    as_they_are = ("name", "frames_per_second", "settle", "sleep", "coast", "cycle")
    return Shot(
        **{name: parts[name] for name in as_they_are},
        source=path,
        groom=groom,
        first_frame=first,
        last_frame=last,
        motion=motion if skin is None else Motion("skin", {}),
        wind=wind,
        quality=quality,
        gravity=np.array(parts["gravity"]),
        grips=grips,
        forces=forces,
        details=details,
        surfaces=skin,
        wind_source=wind_source,
        colliders=colliders,
        contact=contact,
        level_of_detail=level_of_detail,
        shelters=shelters,
    )


def _contact(values: dict[str, Any] | None) -> Contact | None:
    if values is None or not values["enabled"]:
        return None
    return Contact(values["thickness"], values["friction"], values["steps"])


def _check_frames(frames: Any, place: Place) -> None:
    if frames is not INVALID and frames[1] < frames[0]:
        place.fail(f"the last frame {frames[1]} comes before the first {frames[0]}")


def _check_keyframes(motion: Motion | None, groom: Groom | None, place: Place) -> None:
    """Joints exist, times of one joint differ, quaternions are not zero."""
    if motion is None or motion.kind != "keys":
        return
    joints = {joint.name for joint in groom.joints} if groom is not None else set()
    taken: set[tuple[str, str, float]] = set()
    for index, frame in enumerate(motion.values["keyframes"]):
        at = place.child("keyframes").item(index)
        joint, time = frame["joint"], frame["time"]
        if groom is not None and joint and joint not in joints:
            at.child("joint").fail(f"no joint '{joint}' in the groom, {nearest(joint, joints)}")
        for what in ("position", "rotation"):
            if frame[what] is not None and (joint, what, time) in taken:
                at.child("time").fail(f"{time:g} s has a {what} of this joint already")
            if frame[what] is not None:
                taken.add((joint, what, time))
        rotation = frame["rotation"]
        if rotation is None and frame["position"] is None:
            at.fail("holds neither position nor rotation")
        if rotation is not None and len(rotation) == 4 and np.linalg.norm(rotation) < 1e-9:
            at.child("rotation").fail("the quaternion is zero")


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
    if isinstance(given, str):
        groom = collect_groom(path.parent / given, library, readers, above)
    else:
        usd = given["usd"]
        entry = {name: value for name, value in raw["groom"].items() if name != "usd"}
        tables = {"name": Path(usd).stem, "usd": entry | {"file": usd}}
        groom = groom_of(tables, path, library, readers, above)
        groom = groom and replace(groom, source=path.parent / usd)
    if groom is None or len(library.problems) > count:
        return None  # half a groom would mislead later checks
    return groom


def _preset(
    family: str, raw: dict[str, Any], parts: dict[str, Any], place: Place, library: Library
) -> Any:
    """The Motion, Wind or Quality of a shot; None after adding problems."""
    given, at = parts[family], place.child(family)
    if given is INVALID:
        return None
    table = {"base": given} if isinstance(given, str) else given
    named = isinstance(raw.get(family, given), str)
    tree = library.merged(family, sourced(table, at.source), at, "" if named else "base")
    if tree is None:
        return None
    values = plain(tree)
    if family == "quality":
        return Quality(name=table.get("base") or "custom", **values)
    if family == "wind":
        return Wind(**values | {"direction": np.array(values["direction"])})
    return Motion(values.pop("kind"), values)
