"""The plumage of a groom file: [skin], [[region]] and [layout] to drafts and a layout."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from featherfx.groom.keys.regions import LAYOUT, REGION, SKIN
from featherfx.groom.keys.values import INVALID, Place, Table
from featherfx.groom.presets.kind_store import KindStore
from featherfx.groom.read.drafts import CurveReader, Draft
from featherfx.groom.read.drawn import SceneReader
from featherfx.groom.regions.regions import SkinReader, region_drafts
from featherfx.groom.types import Layout


@dataclass(frozen=True)
class GroomReaders:
    """How a groom reads scenes; each returns None after adding problems at the place.

    feathers: groom/read/drawn.SceneReader. skin: regions.SkinReader. curves:
    groom/read/drafts.CurveReader.
    """

    feathers: SceneReader
    skin: SkinReader
    curves: CurveReader


@dataclass(frozen=True)
class Plumage:
    """What the regions of a groom make. skin: corners (T, 3, 3) m of all meshes, or None."""

    drafts: tuple[Draft, ...] = ()
    layout: Layout | None = None
    skin: Any = None


def plumage_of(
    raw: dict[str, Any],
    path: Path,
    place: Place,
    store: KindStore,
    readers: GroomReaders | None,
) -> Plumage:
    """The plumage of a groom's tables as they stand in a file at path; problems go to place."""
    layout = None
    if "layout" in raw:
        checked = Table(LAYOUT).check(raw["layout"], place.child("layout"), False)
        layout = None if checked is INVALID else Layout(**checked)
    given = raw.get("region", [])
    entries = given if isinstance(given, list) else []
    regions = []
    for number, each in enumerate(entries):
        at = place.child("region").item(number)
        checked = Table(REGION).check(each, at, False)
        if checked is not INVALID:
            regions.append((at, checked))
    if not entries:
        return Plumage(layout=layout)
    _check_names(regions)
    at = place.child("skin")
    if "skin" not in raw:
        at.fail("missing, [[region]] grows on a skin")
        return Plumage(layout=layout)
    skin = Table(SKIN).check(raw["skin"], at, False)
    if skin is INVALID or len(regions) < len(entries):
        return Plumage(layout=layout)
    drafts, corners = region_drafts(
        skin, regions, path.parent, at, store, readers.skin if readers else None
    )
    return Plumage(tuple(drafts), layout, corners)


def _check_names(regions: list[tuple[Place, dict[str, Any]]]) -> None:
    seen: dict[str, Place] = {}
    for at, entry in regions:
        if entry["id"] in seen:
            at.child("id").fail(f"'{entry['id']}' is taken by {seen[entry['id']].key}")
        seen.setdefault(entry["id"], at)
