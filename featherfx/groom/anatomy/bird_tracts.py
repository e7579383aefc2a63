"""Tracts of a whole bird: regions of the coat, from landmarks of its body.

A part of the body is where one of its sites is nearer than those of all other parts; sites stand
between landmarks, so they fit any skin.

Landmarks tell which way a body looks. They are checked here.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict
from typing import Any, NamedTuple

import numpy as np

from featherfx.algebra.types import Array
from featherfx.algebra.vectors import frames_from, parallel, unit
from featherfx.groom.anatomy.drape import Beneath
from featherfx.groom.anatomy.wing_skin import WingSkin
from featherfx.groom.keys.anatomy import TRACTS, CovertRow, PartOfBody, WingType
from featherfx.groom.keys.plumage import FLOW_KEYS, REGION_KEYS, SPREAD_KEYS, WHERE_KEYS
from featherfx.groom.keys.problems import Place
from featherfx.groom.keys.values import Key
from featherfx.groom.skin.skin import closest

Points = dict[str, Array]

# ways from beak to tail, that a landmark may be away from the nearer of them
_FARTHEST = 1.5
# of that way, that a landmark may be off the skin: joints lie within it; by eye
_OFF = 0.25
# median distances from the median landmark, that one may be away from it: another unit is farther
_STRAY = 50.0
# axes (forward, left, up) along which a landmark has to be ahead of another
_AHEAD = (
    (1, "left_shoulder", "right_shoulder"),
    (1, "left_heel", "right_heel"),
    (1, "left_eye", "right_eye"),
    (0, "breast", "vent"),
    (0, "beak", "nape"),
    (0, "crown", "nape"),
    (0, "vent", "tail"),
    (2, "nape", "breast"),
)
# of both sides or of none
_PAIRED = "wing", "heel", "eye"


def distance(points: Points, first: str, second: str) -> float:
    """m, between two landmarks."""
    return float(np.linalg.norm(points[first] - points[second]))


def axes_of(points: Points, up: tuple[float, ...], place: Place) -> Array:
    """(3, 3) forward along the trunk, left and up. Raises InputError."""
    _check_pairs(points, place)
    flat = _single(points)
    _refuse_strays(flat, place)
    size = max(distance(points, "beak", "tail"), 1e-9)
    for k, (name, point) in enumerate(flat):
        for other, there in flat[:k]:
            if np.linalg.norm(point - there) < 1e-3 * size:
                place.child(name).refuse(f"is at the place of {other}")
    shoulders = 0.5 * (points["right_shoulder"] + points["left_shoulder"])
    forward = shoulders - points["tail"]
    if parallel(forward, up):
        place.child("tail").refuse("is right below or above the shoulders. Set `up`")
    axes = frames_from(forward, up)
    for name, point in flat:
        away = min(float(np.linalg.norm(point - points[end])) for end in ("beak", "tail"))
        if away > _FARTHEST * size:
            told = f"is {away:.3g} m from beak and tail, which are {size:.3g} m apart"
            place.child(name).refuse(f"{told}. Move it within {_FARTHEST:g} times that")
    _check_order(points, axes, place)
    return axes


def _refuse_strays(flat: list[tuple[str, Array]], place: Place) -> None:
    """Raise InputError for a landmark in another unit than the others."""
    every = np.array([point for _, point in flat])
    away = np.linalg.norm(every - np.median(every, axis=0), axis=1)
    near = float(np.median(away))
    if away.max() > _STRAY * near:
        told = f"is {away.max():.3g} m from the middle of the landmarks, most within {near:.3g} m"
        place.child(flat[int(away.argmax())][0]).refuse(f"{told}. Give all in one unit")


def _single(points: Points) -> list[tuple[str, Array]]:
    """Landmarks that are one point."""
    return [(name, point) for name, point in points.items() if point.ndim == 1]


def _check_pairs(points: Points, place: Place) -> None:
    for part in _PAIRED:
        sides = f"right_{part}", f"left_{part}"
        given = [name for name in sides if name in points]
        if len(given) == 1:
            missing = sides[1] if given[0] == sides[0] else sides[0]
            told = f"{given[0]} is there" if part != "wing" else f"{given[0]} has its landmarks"
            place.child(missing).refuse(f"missing, {told}")


def _check_order(points: Points, axes: Array, place: Place) -> None:
    """That landmarks are ahead of each other as they are on a bird, but for what is beside it: a
    neck that is stretched out is as low as the breast. Raises InputError."""
    gaps = {
        each: (points[each[1]] - points[each[2]]) @ axes
        for each in _AHEAD
        if {*each[1:]} <= points.keys()
    }
    wrong = [each for each, gap in gaps.items() if -gap[each[0]] >= (each[0] == 2) * abs(gap[0])]
    if {"left_shoulder", "breast"} <= {name for _, name, _ in wrong}:
        # forward is from the tail to the shoulders
        place.child("beak").refuse("is behind tail: are the two exchanged?")
    for axis, name, back in wrong:
        side = ("behind", "to the right of", "below")[axis]
        place.child(name).refuse(f"is {side} {back}: are the two exchanged?")


def check_on_skin(points: Points, corners: Array, place: Place) -> None:
    """That landmarks are near a skin of triangles (T, 3, 3) m. Raises InputError."""
    flat, most = _single(points), _OFF * distance(points, "beak", "tail")
    places = np.array([point for _, point in flat])
    triangle, weights = closest(places, corners)
    away = np.linalg.norm(np.einsum("nk,nkc->nc", weights, corners[triangle]) - places, axis=1)
    worst = int(np.argmax(away))
    if away[worst] > most:
        size = float(np.linalg.norm(np.ptp(corners.reshape(-1, 3), axis=0)))
        told = (
            f"is {away[worst]:.3g} m off the skin, whose box has a diagonal of {size:.3g} m. Give"
        )
        told += f" it in the same unit, within {most:.3g} m, a quarter of the way from beak to tail"
        place.child(flat[worst][0]).refuse(told)


_SMALL_DENSITY = 12.0  # relative, of the small coverts of shut wings; by eye
_UNEVEN = 0.04  # of feathers of a disc
_UNEVEN_WIDTH = 0.08  # of the widths of feathers of the coat; by eye
_RIMLESS = 0.5  # of a disc's radius, around the tip of the beak, which its rim would hide; by eye
_BORDER = 0.35  # of a feather's length, over which parts pass into each other
_BORDERS = {"crural": 0.1}  # where legs are bare below, no single feathers
_LEG = ("thigh", "crural")
_CRURAL = 0.45, 0.5  # of length and relative density on the thigh, those of thin legs; by eye
_SIDEWAYS = 55.0  # deg from upwards, beyond which skin bears no scapulars
# forward, outwards and up, of small coverts over a wing's front; by eye
_OVER_EDGE = -1.0, 1.2, 1.0
_NAPE = 0.4  # of the way to the shoulders, from the lowest site of the nape to the mantle's first
_HORN, _FACE = -0.2, 0.2  # sites on either side of where the bill ends, of the way to the crown
_CHEEK = 0.5  # of the way from the middle of both eyes to the nape


class WingCover(NamedTuple):
    """Wings over a coat. type: of both. rows: small coverts that are a coat. wings: tables of
    [[wing]], with `on` where the skin has them. hidden: by side, where folded wings lie."""

    type: WingType
    rows: Sequence[CovertRow]
    wings: Sequence[dict[str, Any]]
    hidden: Mapping[str, Beneath]


def find_tracts(
    kind: dict[str, Any],
    points: Points,
    axes: Array,
    scale: float,
    cover: WingCover,
    bare: Sequence[dict[str, Any]],
) -> Iterator[tuple[str, dict[str, Any]]]:
    """Find the regions of a bird's coat, each with the key of its type that it is of.

    kind: the type. axes: (3, 3). bare: rules of where no feathers are.
    """
    sites = _sites(points, axes, kind["bill"], kind["neck"])
    sites |= _cheeks(points) if kind["tracts"]["cheek"] is not None else {}
    hidden, shoulders = cover.hidden, {}
    if hidden:
        sites["below_wing"] = np.concatenate([each.well for each in hidden.values()])
        sites["flank"] = np.concatenate([sites["flank"], *(each.low for each in hidden.values())])
        for row in cover.rows[:1]:
            shoulders = {f"{side}_wing_{row.name}": each.front for side, each in hidden.items()}
        sites |= shoulders
    feathered = tuple({**rule, "invert": not rule["invert"]} for rule in bare)
    above = (filled(WHERE_KEYS, facing=tuple(axes[:, 2]), angle=_SIDEWAYS, soft_angle=10.0),)
    disc = _disc(kind["disc"], points, scale)
    for each in disc.regions:
        yield "disc", {**each, "where": each["where"] + feathered}
    small = _small_coverts(cover.type, cover.rows)
    tracts = kind["tracts"] | dict.fromkeys(shoulders, small)
    tracts["crural"] = _crural(tracts["thigh"])
    off_wings = tuple(_off_wing(each["on"]) for each in cover.wings if "on" in each)
    for name in (*TRACTS, "crural", "cheek", *shoulders):
        if len(sites.get(name, ())) and tracts[name]["relative_density"] > 0.0:
            region = _region(name, tracts[name], sites, points, scale)
            region["where"] += feathered + disc.outside + off_wings
            region["where"] += above if name == "scapular" else ()
            if off_wings and name not in _LEG:  # a current would turn back on wings
                region["flow"] = filled(FLOW_KEYS, away=tuple(points["beak"]))
            yield f"tracts.{name}", region
    if off_wings and cover.rows:
        for each in cover.wings:
            over = np.array(_OVER_EDGE) * (1.0, 1.0 if each["side"] == "left" else -1.0, 1.0)
            yield "wing", _wing_coat(cover.rows[0].name, small, scale, each, axes @ over)


def _off_wing(skin: WingSkin) -> dict[str, Any]:
    """A rule that leaves out the skin of a wing."""
    own = np.concatenate(skin.parts[:2])
    return filled(WHERE_KEYS, nearest={"to": tuples(skin.parts.rest), "than": tuples(own)})


def _crural(thigh: dict[str, Any]) -> dict[str, Any]:
    """The lower leg, as the thigh is."""
    factors = zip(("length", "relative_density"), _CRURAL, strict=True)
    return thigh | {key: factor * thigh[key] for key, factor in factors}


def _wing_coat(
    row: str, kind: dict[str, Any], scale: float, wing: dict[str, Any], back: Array
) -> dict[str, Any]:
    """Small coverts on the front of a wing that the skin has. back: (3,)."""
    length, parts, name = scale * kind["length"], wing["on"].parts, f"{wing['side']}_wing_{row}"
    near = {"to": tuples(parts.front), "than": tuples(np.concatenate(parts[1:]))}
    where = (filled(WHERE_KEYS, nearest=near, soft=0.2 * length),)
    own = {key: kind[key] for key in ("kind", "relative_density", "width", "tilt", "curl")}
    return _coat(name, where, {"direction": tuple(back)}, length, kind["length_variation"], **own)


def _small_coverts(kind: WingType, rows: Sequence[CovertRow]) -> dict[str, Any]:
    """Rows of coverts of a shut wing as a part of the coat; empty without any."""
    if not rows:
        return {}
    arm = np.mean([*kind.secondaries.lengths, *kind.tertials.lengths])
    length = float(arm * np.mean([row.length for row in rows]))
    return asdict(PartOfBody(rows[0].kind, length, _SMALL_DENSITY, width=rows[0].width))


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
    near = {"to": tuples(sites[name]), "than": tuples(than)}
    flow = {"away": tuple(points["beak"]), "towards": tuple(points["tail"])}
    if name in _LEG:  # down the leg, and back where the belly faces down itself
        down, back = (sites["foot"] - sites["thigh"]).mean(axis=0), points["tail"] - points["beak"]
        flow = {"direction": tuple(down + length * unit(back))}
    where = (filled(WHERE_KEYS, nearest=near, soft=_BORDERS.get(name, _BORDER) * length),)
    own = {key: kind[key] for key in ("kind", "relative_density", "width", "tilt", "curl")}
    return _coat(name, where, flow, length, kind["length_variation"], **own)


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
    return filled(
        REGION_KEYS,
        id=name,
        length=length,
        density=relative_density / length**2,
        where=where,
        flow=filled(FLOW_KEYS, **flow),
        follow=1.0,
        max_length_per_free_radius=1.0,
        variants=6,
        variation=filled(
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
        return filled(
            WHERE_KEYS, sphere={"centre": eye, "radius": size}, soft=0.15 * radius, invert=invert
        )

    bill = ball(tuple(points["beak"]), _RIMLESS * radius, invert=True)
    regions = []
    for side, own, other in zip(sides, eyes, eyes[::-1], strict=True):
        near = filled(WHERE_KEYS, nearest={"to": (own,), "than": (other,)})
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


def filled(keys: Mapping[str, Key], **values: Any) -> dict[str, Any]:
    """A checked table: values, and the defaults of other keys."""
    return {name: key.default for name, key in keys.items()} | values


def tuples(points: Array) -> tuple[tuple[float, ...], ...]:
    """Points (N, k) as tables have them."""
    return tuple(tuple(each) for each in points.tolist())
