"""Grips, forces, levels of detail and shelters of a shot file."""

from __future__ import annotations

from fnmatch import fnmatchcase
from itertools import pairwise
from typing import Any

import numpy as np

from featherfx.groom.keys.values import INVALID, Place, Table, nearest
from featherfx.groom.types import Groom
from featherfx.shot.read.keys import DETAIL, FORCE, GRIP, SHELTER
from featherfx.shot.types import Detail, Force, Grip, Shelter


def read_grips(raw: dict[str, Any], groom: Groom | None, place: Place) -> tuple[Grip, ...]:
    """The grips of a shot, without those that are wrong, whose problems are added."""
    grips = []
    for checked, at in _entries("grip", GRIP, raw, groom, place):
        if checked["end"] <= checked["start"]:
            start = checked["start"]
            at.child("end").fail(f"{checked['end']:g} is not later than start = {start:g} s")
        grips.append(Grip(**checked | {"displacement": np.array(checked["displacement"])}))
    return tuple(grips)


def read_forces(raw: dict[str, Any], groom: Groom | None, place: Place) -> tuple[Force, ...]:
    """The forces of a shot, without those that are wrong, whose problems are added."""
    forces = []
    for checked, at in _entries("force", FORCE, raw, groom, place):
        first, last = checked["span"]
        if last <= first:
            at.child("span").fail(f"{last:g} is not above {first:g}, allowed: [first, last]")
        for index, (before, after) in enumerate(pairwise(checked["keys"])):
            if after[0] <= before[0]:
                message = f"{after[0]:g} s is not later than {before[0]:g} s of the key before"
                at.child("keys").item(index + 1).fail(message)
        keys = tuple(tuple(key) for key in checked["keys"])
        values = {"force": np.array(checked["force"], float), "span": (first, last), "keys": keys}
        forces.append(Force(**checked | values))
    return tuple(forces)


def read_details(raw: dict[str, Any], groom: Groom | None, place: Place) -> tuple[Detail, ...]:
    """Levels of detail of a shot; problems where a pattern fits no feather."""
    return tuple(Detail(**each) for each in _of_some("detail", DETAIL, raw, groom, place))


def read_shelters(raw: dict[str, Any], groom: Groom | None, place: Place) -> tuple[Shelter, ...]:
    """Shelters of a shot; problems where a pattern fits no feather."""
    return tuple(Shelter(**each) for each in _of_some("shelter", SHELTER, raw, groom, place))


def _of_some(
    name: str, keys: dict[str, Any], raw: dict[str, Any], groom: Groom | None, place: Place
) -> list[dict[str, Any]]:
    """Checked tables of one name, each about the feathers that its patterns fit."""
    feathers = groom.feathers if groom is not None else ()
    known = {
        "feathers": {feather.id for feather in feathers},
        "region": {feather.region for feather in feathers},
        "kind": {feather.kind.name for feather in feathers},
    }
    found = _tables(name, keys, raw, place)
    for checked, at in found:
        for key, names in known.items():
            pattern, what = checked[key], "feather" if key == "feathers" else key
            if names and not any(fnmatchcase(each, pattern) for each in names):
                message = f"no {what} of the groom fits '{pattern}', {nearest(pattern, names)}"
                at.child(key).fail(message)
    return [checked for checked, _ in found]


def _entries(
    name: str, keys: dict[str, Any], raw: dict[str, Any], groom: Groom | None, place: Place
) -> list[tuple[dict[str, Any], Place]]:
    """Checked tables of one name and their places; ids must be the groom's."""
    ids = {feather.id for feather in groom.feathers} if groom is not None else None
    found = _tables(name, keys, raw, place)
    for checked, at in found:
        if ids is not None and checked["feather"] not in ids:
            at.child("feather").fail(
                f"no feather '{checked['feather']}' in the groom, {_likely(checked, ids)}"
            )
    return found


def _tables(
    name: str, keys: dict[str, Any], raw: dict[str, Any], place: Place
) -> list[tuple[dict[str, Any], Place]]:
    """Tables of one name that hold what they may, and their places."""
    entries = raw.get(name, [])
    found = []
    for index, entry in enumerate(entries if isinstance(entries, list) else []):
        at = place.child(name).item(index)
        checked = Table(keys).check(entry, at, False)
        if checked is not INVALID:
            found.append((checked, at))
    return found


def _likely(checked: dict[str, Any], ids: set[str]) -> str:
    meant = nearest(checked["feather"], ids)
    return meant if meant.startswith("did") else "its ids are like " + ", ".join(sorted(ids)[:3])
