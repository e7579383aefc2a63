"""Patterns of ids, regions and kinds, by which an entry of a shot selects feathers."""

from __future__ import annotations

from collections.abc import Sequence
from fnmatch import fnmatchcase

from featherfx.groom.types import Placement
from featherfx.shot.types import Contact, Shot, SomeFeathers


def fits(entry: SomeFeathers, placement: Placement) -> bool:
    """Return whether an entry is about a feather."""
    return (
        fnmatchcase(placement.id, entry.feathers)
        and fnmatchcase(placement.region, entry.region)
        and fnmatchcase(placement.kind.name, entry.kind)
        and not any(fnmatchcase(placement.id, each) for each in entry.exclude)
    )


def last_fitting(entries: Sequence[SomeFeathers], placements: Sequence[Placement]) -> list[int]:
    """Find the number of the last entry that is about each feather; -1 for none."""
    found = [-1] * len(placements)
    for number, entry in enumerate(entries):
        for f, placement in enumerate(placements):
            if fits(entry, placement):
                found[f] = number
    return found


def may_touch(shot: Shot, contact: Contact) -> list[bool]:
    """Return of every feather whether it touches others: not those that leave their roots."""
    placements = shot.groom.feathers
    detachments = last_fitting(shot.detachments, placements)
    return [
        touches(contact, p) and rule < 0 for p, rule in zip(placements, detachments, strict=True)
    ]


def touches(contact: Contact, placement: Placement) -> bool:
    """Return whether a feather touches others and colliders."""
    return any(fnmatchcase(placement.region, each) for each in contact.regions) and any(
        fnmatchcase(placement.kind.name, each) for each in contact.kinds
    )
