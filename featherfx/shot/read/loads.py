"""Grips, forces, levels of detail and shelters of a shot file."""

from __future__ import annotations

from fnmatch import fnmatchcase
from itertools import pairwise
from typing import Any

import numpy as np

from featherfx.groom.keys.values import Place, nearest
from featherfx.groom.types import Groom
from featherfx.shot.types import Detail, Force, Grip, Shelter

Entries = list[tuple[Place, dict[str, Any]]]


def read_grips(entries: Entries, groom: Groom | None) -> tuple[Grip, ...]:
    """The grips of a shot, of checked tables, without those that are wrong."""
    _check_ids(entries, groom)
    for at, entry in entries:
        if entry["end"] <= entry["start"]:
            start = entry["start"]
            at.child("end").fail(f"{entry['end']:g} is not later than start = {start:g} s")
    return tuple(
        Grip(**entry | {"displacement": np.array(entry["displacement"])}) for _, entry in entries
    )


def read_forces(entries: Entries, groom: Groom | None) -> tuple[Force, ...]:
    """The forces of a shot, of checked tables, without those that are wrong."""
    _check_ids(entries, groom)
    for at, entry in entries:
        first, last = entry["span"]
        if last <= first:
            at.child("span").fail(f"{last:g} is not above {first:g}, allowed: [first, last]")
        for index, (before, after) in enumerate(pairwise(entry["keys"])):
            if after[0] <= before[0]:
                message = f"{after[0]:g} s is not later than {before[0]:g} s of the key before"
                at.child("keys").item(index + 1).fail(message)
    return tuple(Force(**entry | {"force": np.array(entry["force"])}) for _, entry in entries)


def read_details(entries: Entries, groom: Groom | None) -> tuple[Detail, ...]:
    """Levels of detail of a shot; problems where a pattern fits no feather."""
    _check_patterns(entries, groom)
    return tuple(Detail(**entry) for _, entry in entries)


def read_shelters(entries: Entries, groom: Groom | None) -> tuple[Shelter, ...]:
    """Shelters of a shot; problems where a pattern fits no feather."""
    _check_patterns(entries, groom)
    return tuple(Shelter(**entry) for _, entry in entries)


def _check_patterns(entries: Entries, groom: Groom | None) -> None:
    feathers = groom.feathers if groom is not None else ()
    known = {
        "feathers": {feather.id for feather in feathers},
        "region": {feather.region for feather in feathers},
        "kind": {feather.kind.name for feather in feathers},
    }
    for at, entry in entries:
        for key, names in known.items():
            pattern, what = entry[key], "feather" if key == "feathers" else key
            if names and not any(fnmatchcase(each, pattern) for each in names):
                message = f"no {what} of the groom fits '{pattern}', {nearest(pattern, names)}"
                at.child(key).fail(message)


def _check_ids(entries: Entries, groom: Groom | None) -> None:
    ids = {feather.id for feather in groom.feathers} if groom is not None else set()
    for at, entry in entries:
        name = entry["feather"]
        if groom is not None and name not in ids:
            meant = nearest(name, ids)
            if not meant.startswith("did"):
                meant = "its ids are like " + ", ".join(sorted(ids)[:3])
            at.child("feather").fail(f"no feather '{name}' in the groom, {meant}")
