"""Shot files in: TOML to a Shot, with every problem of shot, groom and presets found at once."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from featherfx.errors import InputError, Problem
from featherfx.feather.layout.layout import lay_out
from featherfx.groom.keys.groom import GROOM_FILE
from featherfx.groom.keys.values import INVALID, Place, Problems, Table, nearest
from featherfx.groom.presets.library import Library, plain, sourced
from featherfx.groom.presets.presets import check_preset
from featherfx.groom.read.read import collect_groom, groom_of
from featherfx.groom.read.toml_file import file_kind, load_toml
from featherfx.groom.types import Groom
from featherfx.shot.read.keys import GROOM_USD, SHOT, SHOT_FILE
from featherfx.shot.read.loads import read_details, read_forces, read_grips, read_shelters
from featherfx.shot.read.scenes import read_colliders, read_level_of_detail, read_skin, read_wind
from featherfx.shot.read.sources import SceneReaders
from featherfx.shot.types import Contact, Motion, Quality, Shot, Wind


def read_shot(
    path: str | Path,
    preset_folders: Iterable[str | Path] = (),
    readers: SceneReaders | None = None,
) -> Shot:
    """The shot that a TOML file describes, with its groom.

    preset_folders: searched before the user's and the shipped presets. readers: of USD scenes.
    Raises InputError with all problems of the shot, its groom, tables, scenes and presets.
    """
    problems = Problems()
    shot = _collect(Path(path), Library(preset_folders, problems), problems, readers)
    problems.raise_any()
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
    kind = file_kind(raw, path, {"shot": SHOT_FILE, "groom": GROOM_FILE})
    if kind == "shot":
        _collect(path, library, problems, readers)
    elif kind == "groom":
        collect_groom(path, library, problems, readers)
    elif kind:
        check_preset(kind, path, library)
    else:
        problems.add(path, "", "is no shot, groom or preset: it holds no key of any")
    return problems.listed()


def _collect(
    path: Path, library: Library, problems: Problems, readers: SceneReaders | None
) -> Shot | None:
    raw = load_toml(path, problems)
    if raw is None:
        return None
    place = Place(str(path), "", problems)
    checked = SHOT_FILE.check(raw, place, False)
    groom = _groom(raw, place, library, readers)
    settings = {name: _setting(name, raw, library, place) for name in _BUILD}
    grips, forces = read_grips(raw, groom, place), read_forces(raw, groom, place)
    details = read_details(raw, groom, place)
    shelters = read_shelters(raw, groom, place)
    _check_frames(raw, place)
    _check_cycle(checked, place)
    _check_keyframes(settings["motion"], groom, place.child("motion"))
    if checked is INVALID or groom is None:
        return None
    colliders = read_colliders(raw, checked, place, readers)
    skin = read_skin(raw, checked, groom, place, readers)
    wind_source = read_wind(raw, checked, place, readers)
    level_of_detail = read_level_of_detail(raw, checked, place, readers)
    if len(problems):
        return None
    return Shot(
        name=checked["name"],
        source=path,
        groom=groom,
        first_frame=checked["frames"][0],
        last_frame=checked["frames"][1],
        frames_per_second=checked["frames_per_second"],
        motion=settings["motion"] if skin is None else Motion("skin", {}),
        wind=settings["wind"],
        quality=settings["quality"],
        gravity=np.array(checked["gravity"]),
        grips=grips,
        forces=forces,
        details=details,
        settle=checked["settle"],
        sleep=checked["sleep"],
        coast=checked["coast"],
        cycle=checked["cycle"],
        skin=skin,
        wind_source=wind_source,
        colliders=colliders,
        contact=_contact(checked["contact"]),
        level_of_detail=level_of_detail,
        shelters=shelters,
    )


def _contact(values: dict[str, Any] | None) -> Contact | None:
    if values is None or not values["enabled"]:
        return None
    return Contact(values["thickness"], values["friction"], values["steps"])


def _check_frames(raw: dict[str, Any], place: Place) -> None:
    frames = SHOT["frames"].type.check(raw.get("frames", [0, 0]), place.child("frames"), False)
    if frames is not INVALID and frames[1] < frames[0]:
        place.child("frames").fail(f"the last frame {frames[1]} comes before the first {frames[0]}")


def _check_cycle(checked: Any, place: Place) -> None:
    if checked is not INVALID and checked["cycle"] and _contact(checked["contact"]) is not None:
        message = "feathers that touch act on each other and are not replayed: leave out contact"
        place.child("cycle").fail(message)


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
    raw: dict[str, Any], place: Place, library: Library, readers: SceneReaders | None
) -> Groom | None:
    given, problems = raw.get("groom"), place.problems
    above = (raw, place) if "overrides" in raw else None
    path = Path(place.source)
    count = len(problems)
    if isinstance(given, dict):
        if Table(GROOM_USD).check(given, place.child("groom"), False) is INVALID:
            return None
        entry = {name: value for name, value in given.items() if name != "usd"}
        tables = {"name": Path(given["usd"]).stem, "usd": entry | {"file": given["usd"]}}
        groom = groom_of(tables, path, library, problems, readers, above)
        groom = groom and replace(groom, source=path.parent / given["usd"])
    elif isinstance(given, str) and given:
        groom = collect_groom(path.parent / given, library, problems, readers, above)
    else:
        return None
    if groom is None or len(problems) > count:
        return None  # half a groom would mislead later checks
    try:
        return lay_out(groom)
    except InputError as error:
        for problem in error.problems:
            problems.add(problem.source, problem.key, problem.message)
        return None


def _setting(family: str, raw: dict[str, Any], library: Library, place: Place) -> Any:
    """The motion, wind or quality of a shot; None after adding problems."""
    key = SHOT[family]
    at = place.child(family)
    written = raw.get(family, key.default)
    given = key.type.check(written, at, False)
    if given is INVALID:
        return None
    tree = library.merged(
        family, sourced(given, place.source), at, "" if isinstance(written, str) else "base"
    )
    if tree is None:
        return None
    values = plain(tree)
    return _BUILD[family](given.get("base") or "custom", values)


def _quality(name: str, values: dict[str, Any]) -> Quality:
    return Quality(name=name, **values)


def _wind(name: str, values: dict[str, Any]) -> Wind:
    return Wind(**values | {"direction": np.array(values["direction"])})


def _motion(name: str, values: dict[str, Any]) -> Motion:
    kind = values.pop("kind")
    return Motion(kind, values)


_BUILD = {"motion": _motion, "wind": _wind, "quality": _quality}
