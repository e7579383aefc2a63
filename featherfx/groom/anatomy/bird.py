"""[bird]: wings, tail, crest and the coat of a whole bird, from landmarks of its body.

A bird becomes tables of a groom like all others.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from featherfx.algebra.types import Array
from featherfx.algebra.vectors import from_rotation_vector, unit
from featherfx.errors import all_of, warn_input
from featherfx.groom.anatomy.bird_tracts import (
    Points,
    WingCover,
    axes_of,
    check_on_skin,
    distance,
    filled,
    find_tracts,
    tuples,
)
from featherfx.groom.anatomy.drape import Beneath, beneath, lie_on
from featherfx.groom.anatomy.fans import TAIL_THINNING, closed_fan
from featherfx.groom.anatomy.remiges import coated_rows, on_skin, shut
from featherfx.groom.anatomy.wing import BENT_HEIGHT, skin_of_wing, wing_type
from featherfx.groom.course import along_polyline
from featherfx.groom.keys.anatomy import WingType
from featherfx.groom.keys.plumage import CREST_KEYS, LAYOUT_KEYS, TAIL_KEYS, WING_KEYS
from featherfx.groom.keys.problems import INVALID, Place
from featherfx.groom.presets.library import Library, plain, sourced
from featherfx.groom.read.space import SkinsReader
from featherfx.groom.skin.skin import Body

_TAIL_LIFT = 0.006  # of the longest, from pair to pair: the pigeon's as counted free of crossings
_TAIL_DEEP = 0.4  # of the width of the root, all pairs together at most, as in trains; by eye
_SPREAD = 0.1  # fold, up to which a wing that does not open stands at its landmark, not as it lies
_HIDES = 0.9  # fold, from which on a wing hides the flank
_UP = 0.0, 0.0, 1.0
_ON_CREST = 9  # points of its line that are put onto the skin


def hatch(
    parts: dict[str, Any], place: Place, library: Library, read: SkinsReader | None
) -> dict[str, dict[str, Any]]:
    """Adds what a groom's checked [bird] becomes to its other tables; problems go to place.

    read: of skins; without one folded wings stay where the type has them. Returns overrides by
    patterns of ids, its colours, of which some may match no feather.
    """
    entry, at = parts["bird"], place.child("bird")
    if entry is None or entry is INVALID or len(place.problems):
        return {}
    if parts["skin"] is None:
        at.refuse("stands without [skin]. Add [skin], which it covers with feathers")
    points = {k: np.array(v) for k, v in entry["landmarks"].items() if v is not None}
    given = sourced(entry["type"], at.source)
    axes, tree = all_of(
        partial(axes_of, points, entry["up"] or _UP, at.child("landmarks")),
        partial(library.merged, "bird", given, at.child("type")),
    )
    kind = plain(tree)
    scale = entry["scale"] or distance(points, "beak", "tail") / kind["length"]
    wing = wing_type(kind["wing"], at.child("type.wing"), library)
    stays = "right_wing" not in points and entry["fold"] == 1.0 and not entry["opens"]
    coats = coated_rows(wing) if stays else []
    wing = shut(wing) if stays else wing
    tail = _tail(entry, kind["tail"], points, axes, scale) if kind["tail"]["count"] else None
    skin = _skin(parts["skin"], place, read, points["tail"], axes, entry["bare"])
    if len(place.problems):
        return {}
    if skin is not None:
        check_on_skin(points, skin.corners, at.child("landmarks"))
    body = skin if skin is None or tail is None else _with_tail(skin, tail)
    wings = [_wing(entry, wing, side, points, axes, scale) for side in ("right", "left")]
    if body is not None and (entry["fold"] > _SPREAD or entry["opens"]):
        wings = _lying(wings, body, at)
    wings = _on_skin(wings, skin, at, axes)
    coats = coats or (coated_rows(wing) if "on" in wings[0] else [])
    parts["wing"] += [(at, each) for each in wings]
    if tail is not None:
        parts["tail"].append((at, tail))
    if kind["crest"]["count"]:
        parts["crest"].append((at, _crest(entry, kind["crest"], points, axes, scale, skin)))
    hidden = {}
    if body is not None and entry["fold"] > _HIDES and not entry["opens"]:
        hidden = {each["side"]: _beneath(each, body) for each in wings}
    cover = WingCover(wing, coats, wings, hidden)
    parts["region"] += [
        (at.child(f"type.{key}"), region)
        for key, region in find_tracts(kind, points, axes, scale, cover, entry["bare"])
    ]
    if parts["layout"] is None:
        parts["layout"] = filled(LAYOUT_KEYS)
    return {
        pattern: {"colour": {key: value for key, value in each.items() if value is not None}}
        for pattern, each in kind["colours"].items()
    }


def _skin(
    skin: dict[str, Any],
    place: Place,
    read: SkinsReader | None,
    middle: Array,
    axes: Array,
    bare: Sequence[dict[str, Any]],
) -> Body | None:
    """The skin, as what things lie on; None without a reader, or after problems.

    bare: rules of [bird], whose maps the skin must have.
    """
    if read is None or skin is INVALID:
        return None
    with place.problems.collecting():
        at = place.child("skin")
        found = read(skin, {skin["prim"]: at.child("prim")}, Path(place.source).parent, at)
        source, rules = found[skin["prim"]], place.child("bird.bare")
        for number, rule in enumerate(bare):
            if rule["primvar"] is not None:
                source.weights(rule["primvar"], rules.item(number).child("primvar"))
        return Body(source.points[source.triangles], axes, middle)
    return None


def _with_tail(skin: Body, tail: dict[str, Any]) -> Body:
    """Add the closed tail to the body that folded wings lie on."""
    return replace(skin, corners=np.concatenate([skin.corners, closed_fan(tail)]))


def _wing(
    entry: dict[str, Any], kind: WingType, side: str, points: Points, axes: Array, scale: float
) -> dict[str, Any]:
    joints = points.get(f"{side}_wing", (None, None, None))
    posed = joints[0] is not None
    return filled(
        WING_KEYS,
        id=f"{side}_wing",
        type=kind,
        shoulder=tuple(points[f"{side}_shoulder"]),
        elbow=joints[0],
        wrist=joints[1],
        tip=joints[2],
        fold=None if posed else entry["fold"],
        forward=tuple(axes[:, 0]),
        up=tuple(axes[:, 2]),
        scale=scale,
        side=side,
        joint=entry["joint"],
        skeleton=entry["skeleton"],
        below=any(row.side == "below" for row in kind.coverts),
    )


def _lying(wings: list[dict[str, Any]], body: Body, at: Place) -> list[dict[str, Any]]:
    """Both wings with a folded pose that lies on the body, the left one as the right one; those
    that landmarks pose stay as they are."""
    right = wings[0]
    if right["fold"] is None:
        return wings
    shoulder = np.array(right["shoulder"])
    rows = right["type"].coverts if right["below"] else ()
    below = BENT_HEIGHT * right["scale"] * sum(row.gap for row in rows if row.side == "below")
    kind, sheet, misses = lie_on(right["type"], shoulder, right["scale"], body, below)
    if misses:
        warn_input(
            f"{at.source}: {at.child('type.wing').key}: on this body folded wings lie with "
            f"{', '.join(misses)}, in lengths of the longest feather. Give these values, or "
            "move the landmarks of the shoulders",
            3,
        )
    sheets = sheet, sheet.mirrored(body.middle, body.axes[:, 1])
    return [wing | {"type": kind, "sheet": own} for wing, own in zip(wings, sheets, strict=True)]


def _on_skin(
    wings: list[dict[str, Any]], skin: Body | None, at: Place, axes: Array
) -> list[dict[str, Any]]:
    """Both wings on the skin, where landmarks pose them and it has both."""
    if skin is None or wings[0]["fold"] is not None:
        return wings
    found = {each["side"]: skin_of_wing(each, at, axes, skin.corners) for each in wings}
    if missing := [side for side, each in found.items() if each is None]:
        if len(missing) == 1:
            warn_input(
                f"{at.source}: {at.key}: the skin has no {missing[0]} wing beneath its flight "
                "feathers, so both wings stand as without. Check the landmarks of that wing",
                3,
            )
        return wings
    return [
        wing | {"type": on_skin(wing["type"]), "on": own}
        for wing, own in zip(wings, found.values(), strict=True)
    ]


def _beneath(wing: dict[str, Any], body: Body) -> Beneath:
    """Places of a folded wing, between which and below which parts of the body are told."""
    if wing["fold"] is None:
        return Beneath(*np.zeros((3, 0, 3)))
    left = wing["side"] == "left"
    place, sheet = np.array(wing["shoulder"]), wing.get("sheet")
    return beneath(wing["type"], place, wing["scale"], body, left, sheet)


def _tail(
    entry: dict[str, Any], kind: dict[str, Any], points: Points, axes: Array, scale: float
) -> dict[str, Any]:
    turned = from_rotation_vector(-np.radians(kind["droop"]) * axes[:, 1]) @ axes
    own = {name: kind[name] for name in ("kind", "count", "width", "angles", "arch", "coverts")}
    # rows of a train lie on each other along their whole length, others end where the tail does
    rows = 1.0 + TAIL_THINNING * sum(
        row["side"] == "above" and row["length"] > 1 for row in kind["coverts"]
    )
    pairs = max(kind["count"] // 2, 1) * rows
    lift = min(_TAIL_LIFT * max(kind["lengths"]), _TAIL_DEEP * kind["root_width"] / pairs)
    return filled(
        TAIL_KEYS,
        id="tail",
        position=tuple(points["tail"]),
        direction=tuple(-turned[:, 0]),
        up=tuple(turned[:, 2]),
        lengths=tuple(scale * np.array(kind["lengths"])),
        root_width=scale * kind["root_width"],
        fan=entry["fan"],
        lift=scale * lift,
        joint=entry["joint"],
        **own,
    )


def _crest(
    entry: dict[str, Any],
    kind: dict[str, Any],
    points: Points,
    axes: Array,
    scale: float,
    skin: Body | None,
) -> dict[str, Any]:
    front = points["beak"] + 0.7 * (points["crown"] - points["beak"])
    path = along_polyline(
        np.array([front, points["crown"], points["nape"]]), np.linspace(0.0, 1.0, _ON_CREST)
    )
    if skin is not None:  # landmarks are few, and skulls round
        outwards = unit(path - points["crown"] + distance(points, "crown", "nape") * axes[:, 2])
        most = distance(points, "beak", "crown")
        ways = [skin.way_out(*each, most) for each in zip(path, outwards, strict=True)]
        path = path + np.array(ways)[:, None] * outwards
    own = {name: kind[name] for name in ("kind", "count", "width", "angles")}
    return filled(
        CREST_KEYS,
        id="crest",
        path=tuples(path),
        direction=tuple(-axes[:, 0]),
        up=tuple(axes[:, 2]),
        lengths=tuple(scale * np.array(kind["lengths"])),
        joint=entry["joint"],
        **{"raise": entry["raise"]},
        **own,
    )
