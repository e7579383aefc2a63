"""Which feathers an entry of a shot is about, by patterns of ids, regions and kinds."""

from __future__ import annotations

from fnmatch import fnmatchcase

from featherfx.groom.types import Placement
from featherfx.shot.types import Contact, SomeFeathers


def fits(entry: SomeFeathers, placement: Placement) -> bool:
    """Whether an entry is about a feather."""
    return (
        fnmatchcase(placement.id, entry.feathers)
        and fnmatchcase(placement.region, entry.region)
        and fnmatchcase(placement.kind.name, entry.kind)
    )


def touches(contact: Contact, placement: Placement) -> bool:
    """Whether a feather touches others and colliders."""
    return any(fnmatchcase(placement.region, each) for each in contact.regions) and any(
        fnmatchcase(placement.kind.name, each) for each in contact.kinds
    )
