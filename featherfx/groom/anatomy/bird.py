"""[bird]: wings, tail, crest and the coat of a whole bird, from landmarks of its body.

A part of the body is where one of its sites is nearer than those of all other parts; sites stand
between landmarks, so they fit any skin. What a bird becomes are tables of a groom like all others.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from featherfx.algebra.rotation import from_rotation_vector
from featherfx.algebra.types import Array
from featherfx.algebra.vectors import unit
from featherfx.errors import all_of, warn_input
from featherfx.groom.anatomy.drape import Beneath, Body, beneath, lie_on
from featherfx.groom.anatomy.fans import TAIL_THINNING, closed_fan
from featherfx.groom.anatomy.landmarks import Points, axes_of, check_on_skin, distance
from featherfx.groom.anatomy.remiges import coated_rows, on_skin, shut
from featherfx.groom.anatomy.wing import BENT_HEIGHT, skin_of_wing, wing_type
from featherfx.groom.anatomy.wing_skin import WingSkin
from featherfx.groom.frames import along_polyline
from featherfx.groom.keys.anatomy import TRACTS, CovertRow, PartOfBody, WingType
from featherfx.groom.keys.limbs import CREST_KEYS, TAIL_KEYS, WING_KEYS
from featherfx.groom.keys.problems import INVALID, Place
from featherfx.groom.keys.regions import (
    FLOW_KEYS,
    LAYOUT_KEYS,
    REGION_KEYS,
    SPREAD_KEYS,
    WHERE_KEYS,
)
from featherfx.groom.keys.values import Key
from featherfx.groom.presets.library import Library, plain, sourced
from featherfx.groom.read.readers import SkinsReader

_TAIL_LIFT = 0.006  # of the longest, from pair to pair: the pigeon's as counted free of crossings
_TAIL_DEEP = 0.4  # of the width of the root, all pairs together at most, as in trains; by eye
_SMALL_DENSITY = 12.0  # relative, of the small coverts of shut wings; by eye
_UNEVEN = 0.04  # of feathers of a disc
_UNEVEN_WIDTH = 0.07  # of the widths of feathers of the coat; by eye
_RIMLESS = 0.5  # of a disc's radius, around the tip of the beak, which its rim would hide; by eye
_SPREAD = 0.1  # fold, up to which a wing that does not open stands at its landmark, not as it lies
_HIDES = 0.9  # fold, from which on a wing hides the flank
_BORDER = 0.5  # of a feather's length, over which parts pass into each other
_BORDERS = {"crural": 0.1}  # where legs are bare below, no single feathers
_LEG = ("thigh", "crural")
_CRURAL = 0.45, 0.5  # of length and relative density on the thigh, those of thin legs; by eye
_ROOM = 0.3, 0.4  # of a length, free beneath; where legs move, more
# of relative densities, below which feathers stand closer in creases: that room, and their length
# over it, which is 1 elsewhere; by coverage
_SPARSE, _CREASES = 20.0, {"thigh": (0.2, 2.0), "flank": (0.3, 2.0), "belly": (0.3, 1.5)}
_SIDEWAYS = 55.0  # deg from upwards, beyond which skin bears no scapulars
_OVER_EDGE = -1.0, 0.0, 1.0  # forward, left and up, of small coverts over a wing's front; by eye
_UP = 0.0, 0.0, 1.0
_ON_CREST = 9  # points of its line that are put onto the skin
_NAPE = 0.4  # of the way to the shoulders, from the lowest site of the nape to the mantle's first
_HORN, _FACE = -0.2, 0.2  # sites on either side of where the bill ends, of the way to the crown
_CHEEK = 0.5  # of the way from the middle of both eyes to the nape


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
    sites = _sites(points, axes, kind["bill"], kind["neck"])
    sites |= _cheeks(points) if kind["tracts"]["cheek"] is not None else {}
    shoulders = {}
    if body is not None and entry["fold"] > _HIDES and not entry["opens"]:
        found = {each["side"]: _beneath(each, body) for each in wings}
        sites["below_wing"] = np.concatenate([each.well for each in found.values()])
        low = [each.low for each in found.values()]
        sites["flank"] = np.concatenate([sites["flank"], *low])
        shoulders = {
            f"{side}_wing_{coats[0].name}": each.front for side, each in found.items() if coats
        }
        sites |= shoulders
    bare = tuple({**rule, "invert": not rule["invert"]} for rule in entry["bare"])
    above = (_filled(WHERE_KEYS, facing=tuple(axes[:, 2]), angle=_SIDEWAYS, soft_angle=10.0),)
    disc = _disc(kind["disc"], points, scale)
    parts["region"] += [
        (at.child("type.disc"), {**each, "where": each["where"] + bare}) for each in disc.regions
    ]
    parts_of = kind["tracts"] | dict.fromkeys(shoulders, _small_coverts(wing, coats))
    parts_of["crural"] = _crural(parts_of["thigh"])
    off_wings = tuple(_off_wing(each["on"]) for each in wings if "on" in each)
    for name in (*TRACTS, "crural", "cheek", *shoulders):
        if len(sites.get(name, ())) and parts_of[name]["relative_density"] > 0.0:
            region = _region(name, parts_of[name], sites, points, scale)
            region["where"] += bare + disc.outside + off_wings
            region["where"] += above if name == "scapular" else ()
            if off_wings and name not in _LEG:  # a current would turn back on wings
                back = tuple(points["tail"] - points["beak"])
                region["flow"] = _filled(FLOW_KEYS, direction=back)
            parts["region"].append((at.child(f"type.tracts.{name}"), region))
    if off_wings and coats:
        small, back = _small_coverts(wing, coats), axes @ _OVER_EDGE
        parts["region"] += [
            (at.child("type.wing"), _wing_coat(coats[0].name, small, scale, each, back))
            for each in wings
        ]
    if parts["layout"] is None:
        parts["layout"] = _filled(LAYOUT_KEYS)
    return {
        pattern: {"colour": {key: value for key, value in each.items() if value is not None}}
        for pattern, each in kind["colours"].items()
    }


def _filled(keys: Mapping[str, Key], **values: Any) -> dict[str, Any]:
    """A checked table: values, and the defaults of other keys."""
    return {name: key.default for name, key in keys.items()} | values


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
    return _filled(
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


def _off_wing(skin: WingSkin) -> dict[str, Any]:
    """A rule that leaves out the skin of a wing."""
    own = np.concatenate(skin.parts[:2])
    return _filled(WHERE_KEYS, nearest={"to": _tuples(skin.parts.rest), "than": _tuples(own)})


def _crural(thigh: dict[str, Any]) -> dict[str, Any]:
    """The lower leg, as the thigh is."""
    factors = zip(("length", "relative_density"), _CRURAL, strict=True)
    return thigh | {key: factor * thigh[key] for key, factor in factors}


def _wing_coat(
    row: str, kind: dict[str, Any], scale: float, wing: dict[str, Any], back: Array
) -> dict[str, Any]:
    """Small coverts on the front of a wing that the skin has. back: (3,)."""
    length, parts, name = scale * kind["length"], wing["on"].parts, f"{wing['side']}_wing_{row}"
    near = {"to": _tuples(parts.front), "than": _tuples(np.concatenate(parts[1:]))}
    where = (_filled(WHERE_KEYS, nearest=near, soft=0.2 * length),)
    own = {key: kind[key] for key in ("kind", "relative_density", "width", "tilt", "curl")}
    return _coat(name, where, {"direction": tuple(back)}, length, kind["length_variation"], **own)


def _beneath(wing: dict[str, Any], body: Body) -> Beneath:
    """Places of a folded wing, between which and below which parts of the body are told."""
    if wing["fold"] is None:
        return Beneath(*np.zeros((3, 0, 3)))
    left = wing["side"] == "left"
    place, sheet = np.array(wing["shoulder"]), wing.get("sheet")
    return beneath(wing["type"], place, wing["scale"], body, left, sheet)


def _small_coverts(kind: WingType, rows: Sequence[CovertRow]) -> dict[str, Any]:
    """Rows of coverts of a shut wing as a part of the coat; empty without any."""
    if not rows:
        return {}
    arm = np.mean([*kind.secondaries.lengths, *kind.tertials.lengths])
    length = float(arm * np.mean([row.length for row in rows]))
    return asdict(PartOfBody(rows[0].kind, length, _SMALL_DENSITY, width=rows[0].width))


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
    return _filled(
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
    return _filled(
        CREST_KEYS,
        id="crest",
        path=_tuples(path),
        direction=tuple(-axes[:, 0]),
        up=tuple(axes[:, 2]),
        lengths=tuple(scale * np.array(kind["lengths"])),
        joint=entry["joint"],
        **{"raise": entry["raise"]},
        **own,
    )


def _sites(points: Points, axes: Array, bill: float, neck: float) -> dict[str, Array]:
    """(k, 3) m, the sites of each part, of the bare beak and feet, and of where the tail leaves.

    bill: where it ends, of the way from the tip of the beak to the crown. neck: where the mantle
    begins, of the way from the nape to the shoulders. Shares are chosen by eye.
    """
    p = points
    right, left = p["right_shoulder"], p["left_shoulder"]
    high = 0.5 * np.linalg.norm(left - right) * axes[:, 2]
    top = 0.5 * (right + left) + high

    def between(first: Array, second: Array, fraction: float) -> Array:
        return np.asarray(first + fraction * (second - first))

    found = {
        "beak": [p["beak"], between(p["beak"], p["crown"], bill + _HORN)],
        "face": [between(p["beak"], p["crown"], bill + _FACE)],
        "crown": [p["crown"]],
        "nape": [p["nape"], between(p["nape"], top, neck - _NAPE)],
        "throat": [between(p["beak"], p["breast"], 0.35)],
        "foreneck": [between(p["beak"], p["breast"], 0.7)],
        "breast": [
            p["breast"],
            *(between(p["breast"], each, way) for each in (right, left) for way in (0.55, 0.85)),
        ],
        "mantle": [top, between(p["nape"], top, neck)],
        "scapular": [
            between(between(each, top, 0.3), p["tail"], fraction)
            for each in (right, left)
            for fraction in (0.0, 0.2)
        ],
        "back": [between(top, p["tail"], fraction) for fraction in (0.3, 0.55)],
        "rump": [between(top, p["tail"], 0.85)],
        "belly": [between(p["breast"], p["vent"], fraction) for fraction in (0.4, 0.7)],
        "flank": [
            between(between(each, p["tail"], 0.35), between(p["breast"], p["vent"], 0.5), 0.5)
            for each in (right, left)
        ],
        # where its upper coverts stand
        "stump": [p["tail"], between(top, p["tail"], 0.93)],
        "vent": [p["vent"], between(p["vent"], p["tail"], 0.5)],
    }
    for side in ("right", "left"):
        heel = p.get(f"{side}_heel")
        if heel is not None:
            hip = between(p["breast"], p["vent"], 0.65)
            found.setdefault("thigh", []).append(between(heel, hip, 0.5))
            found.setdefault("crural", []).append(between(heel, hip, 0.25))
            found.setdefault("foot", []).append(heel)
    return {name: np.array(each) for name, each in found.items()}


def _cheeks(points: Points) -> dict[str, Array]:
    """Sites of the cheeks, below and behind either eye; none without eyes. By eye."""
    if not {"right_eye", "left_eye"} <= points.keys():
        return {}
    right, left = points["right_eye"], points["left_eye"]
    back = _CHEEK * (points["nape"] - 0.5 * (right + left))
    down = 0.5 * (right + left) - points["crown"]
    sites = [eye + way for eye in (right, left) for way in (0.9 * down, 0.7 * down + back)]
    return {"cheek": np.array(sites)}


def _region(
    name: str, kind: dict[str, Any], sites: dict[str, Array], points: Points, scale: float
) -> dict[str, Any]:
    length = scale * kind["length"]
    than = np.concatenate([each for other, each in sites.items() if other != name])
    near = {"to": _tuples(sites[name]), "than": _tuples(than)}
    flow = {"away": tuple(points["beak"]), "towards": tuple(points["tail"])}
    if name in _LEG:  # down the leg, and back where the belly faces down itself
        down, back = (sites["foot"] - sites["thigh"]).mean(axis=0), points["tail"] - points["beak"]
        flow = {"direction": tuple(down + length * unit(back))}
    room, fit = _ROOM[name in _LEG], 1.0
    if kind["relative_density"] < _SPARSE:
        room, fit = _CREASES.get(name, (room, fit))
    where = (
        _filled(WHERE_KEYS, nearest=near, soft=_BORDERS.get(name, _BORDER) * length),
        _filled(WHERE_KEYS, free_radius=room * length, soft=0.2 * length),
    )
    own = {key: kind[key] for key in ("kind", "relative_density", "width", "tilt", "curl")}
    fits = {"max_length_per_free_radius": fit}
    return _coat(name, where, flow, length, kind["length_variation"], **own) | fits


def _coat(
    name: str,
    where: tuple[dict[str, Any], ...],
    flow: dict[str, Any],
    length: float,
    uneven: float,
    relative_density: float,
    **own: Any,
) -> dict[str, Any]:
    """A region of the coat. length: m. uneven: as of a part of the body."""
    return _filled(
        REGION_KEYS,
        id=name,
        length=length,
        density=relative_density / length**2,
        where=where,
        flow=_filled(FLOW_KEYS, **flow),
        follow=1.0,
        max_length_per_free_radius=1.0,
        variants=6,
        variation=_filled(
            SPREAD_KEYS,
            length=uneven,
            width=_UNEVEN_WIDTH,
            **dict.fromkeys(("turn", "roll", "curl"), 50.0 * uneven),
        ),
        **own,
    )


class _Disc(NamedTuple):
    """regions: of the disc and its rim, around either eye. outside: rules of other regions."""

    regions: tuple[dict[str, Any], ...] = ()
    outside: tuple[dict[str, Any], ...] = ()


def _disc(kind: dict[str, Any], points: Points, scale: float) -> _Disc:
    """None of it without eyes, or for a bird that has none."""
    sides = ("right", "left")
    if not kind["radius"] or any(f"{side}_eye" not in points for side in sides):
        return _Disc()
    eyes = [tuple(points[f"{side}_eye"]) for side in sides]
    radius, rim = scale * kind["radius"], scale * kind["rim_length"]

    def ball(eye: tuple[float, ...], size: float, invert: bool = False) -> dict[str, Any]:
        return _filled(
            WHERE_KEYS, sphere={"centre": eye, "radius": size}, soft=0.15 * radius, invert=invert
        )

    bill = ball(tuple(points["beak"]), _RIMLESS * radius, invert=True)
    regions = []
    for side, own, other in zip(sides, eyes, eyes[::-1], strict=True):
        near = _filled(WHERE_KEYS, nearest={"to": (own,), "than": (other,)})
        within = ball(own, radius)
        edge = (ball(own, radius + 0.5 * rim), ball(own, radius - 0.25 * rim, invert=True), bill)
        for part, where, prefix in (("disc", (within,), ""), ("rim", edge, "rim_")):
            regions.append(
                _coat(
                    part,
                    (near, *where),
                    length=scale * kind[f"{prefix}length"],
                    relative_density=kind[f"{prefix}relative_density"],
                    tilt=kind[f"{prefix}tilt"],
                    kind=kind["rim" if prefix else "kind"],
                    flow={"away": own},
                    uneven=_UNEVEN,
                    width=1.0,
                    curl=0.0,
                )
                | {"id": f"{side}_{part}", "blend": False}
            )
    return _Disc(tuple(regions), tuple(ball(eye, radius, invert=True) for eye in eyes))


def _tuples(points: Array) -> tuple[tuple[float, ...], ...]:
    return tuple(tuple(each) for each in points.tolist())
