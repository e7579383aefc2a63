"""Feather kinds from merged presets, checked for outlines and guides that cannot be built."""

from __future__ import annotations

from dataclasses import fields, is_dataclass, replace
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np

from featherfx.groom.course import barbs_cross, crossing_segments
from featherfx.groom.keys.problems import Place, Problems
from featherfx.groom.keys.values import expected
from featherfx.groom.materials import (
    MAX_LOSS_BAND_RATIO,
    MAX_PROFILE_FACTOR,
    MIN_PROFILE_FACTOR,
    SHADING,
    BarbLook,
    Colour,
    Curve,
    Pattern,
    Profile,
    RachisMaterial,
    VaneMaterial,
)
from featherfx.groom.presets.library import Sourced, Tree, plain
from featherfx.groom.presets.scaling import change_materials
from featherfx.groom.types import (
    BARB_ANGLE,
    BarbGuide,
    FeatherKind,
    Hooked,
    RachisShape,
    Splits,
    VaneShape,
)

# tables of a vane's material, of a curve along the shaft and one along the barbs
_PROFILES = "thickness_profile", "across_barbs_profile", "along_barbs_profile"
_ALONG = "rachis", "barb"


def _source(tree: Tree, *path: str) -> str:
    """File that the value at a path came from."""
    value: Any = tree
    for name in path:
        value = value[name]
    return value.source if isinstance(value, Sourced) else ""


def _at(tree: Tree, place: Place, *path: str) -> Place:
    """Return the place of the value at a path, written or not."""
    source = _source(tree, *path)
    source = place.source if source in ("", "default") else source
    return Place(source, place.child(".".join(path)).key, place.problems)


def _guide(values: dict[str, Any], place: Place) -> BarbGuide:
    """Return a guide of its checked keys. place: of the guide, for faults."""
    own = {name: each for name, each in values.items() if name != "line"}
    if values["line"]:
        from featherfx.groom.presets.lines import follow_barb_line

        return follow_barb_line(own, values["line"], place.child("line"))
    if own["angle"] is None:
        place.child("angle").fail(f"missing, expects {expected(BARB_ANGLE)}, or a line")
        own["angle"] = 60.0  # any: the fault is reported
    return BarbGuide(**own)


def _vane(tree: Tree, side: str, place: Place) -> VaneShape:
    values, at = plain(tree[side]), _at(tree, place, side, "guides")
    guides = enumerate(values["guides"])
    return VaneShape(
        outline=tuple(values["outline"]),
        guides=tuple(_guide(each, at.item(index)) for index, each in guides),
        rounded_base=values["rounded_base"],
        rounded_tip=values["rounded_tip"],
        hooked=Hooked(**values["hooked"]),
        splits=Splits(**values["splits"]),
    )


def _vane_material(values: dict[str, Any]) -> VaneMaterial:
    profiles = {name: Profile(**values[name]) for name in _PROFILES}
    return VaneMaterial(**{**values, **profiles})


def _colour(values: dict[str, Any]) -> Colour:
    patterns = (Pattern(**each) for each in values["patterns"])
    return Colour(**{**values, "patterns": tuple(patterns)})


def kind_of(name: str, tree: Tree, place: Place) -> FeatherKind:
    """The kind that a finished feather tree describes. Raises InputError."""
    values, problems = plain(tree), Problems()
    line = values["rachis"].pop("line")
    place = replace(place, problems=problems)
    leading, trailing = (_vane(tree, side, place) for side in ("leading", "trailing"))
    problems.hand_on()
    kind = FeatherKind(
        name=name,
        length=values["length"],
        calamus=values["calamus"],
        barb_spacing=values["barb_spacing"],
        barb_spacing_exponent=values["barb_spacing_exponent"],
        thickness_exponent=values["thickness_exponent"],
        scaling=values["scaling"],
        rachis=RachisShape(**values["rachis"]),
        leading=leading,
        trailing=trailing,
        vane_material=_vane_material(values["vane_material"]),
        rachis_material=RachisMaterial(**values["rachis_material"]),
        colour=_colour(values["colour"]),
        barbs=BarbLook(**values["barbs"]),
    )
    for index, pattern in enumerate(kind.colour.patterns):
        if pattern.colour is None and all(getattr(pattern, name) is None for name in SHADING):
            at = _at(tree, place, "colour", "patterns").item(index).child("colour")
            at.fail(f"missing. Give a colour, or one of {', '.join(SHADING)}")
        if pattern.end <= pattern.start:
            file = _source(tree, "colour", "patterns")
            key = place.child(f"colour.patterns[{index}].end").key
            where = Place(place.source if file == "default" else file, key, place.problems)
            where.fail(f"{pattern.end:g} is not above start = {pattern.start:g}")
    for side, vane in (("leading", kind.leading), ("trailing", kind.trailing)):
        for key, message in _vane_faults(kind, vane):
            source = _source(tree, side, *key.partition("[")[0].split("."))
            source = place.source if source == "default" else source
            Place(source, place.child(f"{side}.{key}").key, place.problems).fail(message)
    if not (kind.leading.outline or kind.trailing.outline):
        place.child("leading.outline").fail("both vanes are empty, a feather needs one at least")
    for index, (before, after) in enumerate(pairwise(kind.rachis.course), start=1):
        if after[0] <= before[0]:
            at = Place(_source(tree, "rachis", "course"), place.child("rachis").key, place.problems)
            message = f"{after[0]:g} is not above the point before it ({before[0]:g})"
            at.child("course").item(index).item(0).fail(f"{message}. Points ascend")
    if kind.rachis.diameter_tip > kind.rachis.diameter_base:
        tip, base = kind.rachis.diameter_tip, kind.rachis.diameter_base
        source = _source(tree, "rachis", "diameter_tip")
        at = Place(source, place.child("rachis.diameter_tip").key, place.problems)
        at.fail(f"{tip:g} is out of range. Give up to diameter_base = {base:g} m")
    if line and not len(problems):
        from featherfx.groom.presets.lines import follow_rachis_line

        kind = follow_rachis_line(kind, line, _at(tree, place, "rachis", "line"))
    _check_hooks(kind.vane_material, tree, place)
    for name in ("rachis_material", "vane_material"):
        _check_band(getattr(kind, name), _at(tree, place, name, "loss_band"))
    _check_profiles(kind, tree, place)
    if kind.vane_material.ribbon:
        _check_ribbon(kind, tree, place)
    problems.hand_on()
    return replace(kind, **change_materials(kind, 1.0, values["stiffness"], values["weight"]))


def _check_band(material: RachisMaterial | VaneMaterial, place: Place) -> None:
    lowest, highest = material.loss_band
    if not lowest < highest <= MAX_LOSS_BAND_RATIO * lowest:
        message = "a band is a lowest and a highest frequency. Give the second above the first"
        place.fail(f"{message} and up to {MAX_LOSS_BAND_RATIO:g} times as high")


def _check_hooks(vane: VaneMaterial, tree: Tree, place: Place) -> None:
    strength, limit = vane.hook_strength, vane.hook_yield_across
    if strength >= limit:
        return
    files = [_source(tree, "vane_material", f"hook_{k}") for k in ("strength", "yield_across")]
    # whoever overrode one of the two made them disagree
    source = place.source if place.source in files else files[files[0] == "default"]
    message = f"{strength:g} is out of range. Give at least the yield stress, "
    message += f"hook_yield_across = {limit:g} Pa"
    key = place.child("vane_material.hook_strength").key
    Place(source, key, place.problems).fail(message)


def _check_profiles(kind: FeatherKind, tree: Tree, place: Place) -> None:
    """Points of curves of factors ascend within 0 to 1, and no figure vanishes anywhere."""
    curves = {
        "rachis.diameter_profile": kind.rachis.diameter_profile,
        "rachis_material.modulus_profile": kind.rachis_material.modulus_profile,
    }
    for name in _PROFILES:
        profile = getattr(kind.vane_material, name)
        curves |= {f"vane_material.{name}.{each}": getattr(profile, each) for each in _ALONG}
    for key, curve in curves.items():
        at = _at(tree, place, *key.split("."))
        for index, (share, factor) in enumerate(curve):
            before = curve[index - 1][0] if index else -1.0
            if not before < share <= 1.0:
                told = "Give 0 to 1, each above the one before it"
                at.item(index).item(0).fail(f"{share:g} is out of order or range. {told}")
            if factor < MIN_PROFILE_FACTOR:
                told = f"Give {MIN_PROFILE_FACTOR:g} to {MAX_PROFILE_FACTOR:g}"
                at.item(index).item(1).fail(f"{factor:g} is out of range. {told}")


def _check_ribbon(kind: FeatherKind, tree: Tree, place: Place) -> None:
    """A ribbon is one sheet, which bends."""
    sheet, sides = "vane_material.ribbon = true, a strip without gaps", ("leading", "trailing")
    vane, shapes = kind.vane_material, [getattr(kind, side) for side in sides]
    faults = [
        (f"{side}.{key}", f"is not for {sheet}. Leave it out")
        for side, shape in zip(sides, shapes, strict=True)
        for key, there in (("splits", shape.is_split), ("hooked", shape.hooked != Hooked()))
        if there
    ]
    faults += [
        (f"vane_material.{name}", f"is not for {sheet}. Leave it out")
        for name in _PROFILES
        if getattr(vane, name) != Profile()
    ]
    if vane.hooks != "closed":
        message = f"'{vane.hooks}' is not for {sheet}. Give closed"
        faults.append(("vane_material.hooks", message))
    if vane.bending_across == 0.0:
        message = "0 is out of range for a ribbon, which bends with it. Give a value above 0 N m"
        faults.append(("vane_material.bending_across", message))
    for key, message in faults:
        _at(tree, place, *key.split(".")).fail(message)


def _vane_faults(kind: FeatherKind, vane: VaneShape) -> list[tuple[str, str]]:
    """(key, message) of everything that keeps one vane from being built."""
    faults: list[tuple[str, str]] = []
    if vane.is_split:
        from featherfx.groom.splits import split_faults

        faults = split_faults(kind, vane)
    if not vane.outline:
        return faults
    faults = _outline_faults(vane) + _hooked_faults(vane) + faults
    positions = [guide.position for guide in vane.guides]
    if not positions:
        faults.append(("guides", "there is an outline but no guide, expects one at least"))
    for index in range(1, len(positions)):
        if positions[index] <= positions[index - 1]:
            message = (
                f"{positions[index]:g} is not above the guide before it "
                f"({positions[index - 1]:g}). Guides are in ascending position"
            )
            faults.append((f"guides[{index}].position", message))
    for index, guide in enumerate(vane.guides):
        for point, (before, after) in enumerate(pairwise(guide.course), start=1):
            if after[0] <= before[0]:
                message = f"{after[0]:g} is not above the point before it ({before[0]:g})"
                key = f"guides[{index}].course[{point}][0]"
                faults.append((key, f"{message}. Points ascend"))
    if faults:
        return faults
    for index in barbs_cross(vane, 1.0 - kind.calamus):
        message = (
            f"the barbs of guides {index} and {index + 1} cross within the vane. "
            "Bring their angle and curl closer together, or their positions apart"
        )
        faults.append((f"guides[{index + 1}]", message))
    return faults


def _hooked_faults(vane: VaneShape) -> list[tuple[str, str]]:
    return [
        (
            f"hooked.{name}[{index}][0]",
            f"{place[0]:g} is not above the point before it ({before[0]:g}). Points ascend",
        )
        for name, curve in (("rachis", vane.hooked.rachis), ("barb", vane.hooked.barb))
        for index, (before, place) in enumerate(pairwise(curve), start=1)
        if place[0] <= before[0]
    ]


def _outline_faults(vane: VaneShape) -> list[tuple[str, str]]:
    outline = vane.outline
    faults = []
    if len(outline) < 3:
        faults.append(("outline", f"has {len(outline)} points. Give 3 to 200 (or none)"))
    for index, (_, y) in enumerate(outline):
        if y < 0:
            faults.append((f"outline[{index}][1]", f"{y:g} is out of range. Give 0 to 1.5"))
    if all(y == 0 for _, y in outline):
        faults.append(("outline", "is 0 wide everywhere. Give a point with y above 0 (or none)"))
    if len(outline) >= 2 and outline[0][0] >= outline[-1][0]:
        faults.append(("outline", "ends at or before its start; it runs from base to tip"))
    for first, second in crossing_segments(outline):
        message = f"the outline crosses itself: segments {first} and {second} meet"
        faults.append((f"outline[{second}]", message))
    return faults


class Change(NamedTuple):
    """Changes of a kind for one feather.

    scale: factor of the size; materials follow the kind's `scaling`. width: factor of the vanes'
    widths. camber, sweep: deg, added to the shaft's. course: in place of its own, where not None.
    hollow: deg, added to the camber of all barbs.
    wrap: of the leading and the trailing vane, as of VaneShape; 0 leaves them. stiffness, weight:
    factors of all stiffnesses and all masses. patterns: of the splits that the leading and the
    trailing vane draw. angle: deg, added to all barb angles. across, along, thickness: factors of
    the vane's figures.
    """

    scale: float = 1.0
    width: float = 1.0
    camber: float = 0.0
    sweep: float = 0.0
    course: tuple[tuple[float, float, float, float], ...] | None = None
    hollow: float = 0.0
    wrap: tuple[float, float] = (0.0, 0.0)
    stiffness: float = 1.0
    weight: float = 1.0
    patterns: tuple[int, int] = (0, 0)
    angle: float = 0.0
    across: float = 1.0
    along: float = 1.0
    thickness: float = 1.0


def adjusted(kind: FeatherKind, change: Change) -> FeatherKind:
    """The kind with a change."""
    scale = change.scale
    rachis = replace(
        kind.rachis,
        diameter_base=kind.rachis.diameter_base * scale,
        diameter_tip=kind.rachis.diameter_tip * scale,
        camber=kind.rachis.camber + change.camber,
        sweep=kind.rachis.sweep + change.sweep,
        twist=kind.rachis.twist + 0.25 * kind.rachis.sweep * sum(change.wrap),
        course=kind.rachis.course if change.course is None else change.course,
    )
    drawn = change.across, change.along, change.thickness
    return replace(
        kind,
        length=kind.length * scale,
        rachis=rachis,
        leading=_reshaped(kind.leading, change, 0),
        trailing=_reshaped(kind.trailing, change, 1),
        **change_materials(kind, scale, change.stiffness, change.weight, drawn),
    )


def _reshaped(vane: VaneShape, change: Change, side: int) -> VaneShape:
    pattern = change.patterns[side]
    vane = _hollowed(_widened(vane, change.width), change.hollow, change.angle)
    vane = replace(vane, wrap=change.wrap[side]) if change.wrap[side] else vane
    if pattern == vane.splits.pattern or pattern == 0:
        return vane
    return replace(vane, splits=replace(vane.splits, pattern=pattern))


def _hollowed(vane: VaneShape, hollow: float, angle: float) -> VaneShape:
    if hollow == 0.0 and angle == 0.0:
        return vane
    guides = tuple(
        replace(guide, camber=guide.camber + hollow, angle=guide.angle + angle)
        for guide in vane.guides
    )
    return replace(vane, guides=guides)


def _widened(vane: VaneShape, width: float) -> VaneShape:
    if width == 1.0:
        return vane
    return replace(vane, outline=tuple((x, y * width) for x, y in vane.outline))


def blended(first: Any, second: Any, weight: float) -> Any:
    """Halfway kinds: numbers interpolated, names from the nearer of the two.

    weight: of the second, 0 to 1. Raises ValueError where the two hold tuples of different lengths.
    """
    if isinstance(first, (str, Splits, BarbLook)) or None in (first, second):
        return _nearer(first, second, weight)  # half of a split, or of a clump, is none
    if isinstance(first, Colour):
        return _blended_colour(first, second, weight)
    if isinstance(first, (Hooked, Profile)):
        return type(first)(
            _blended_curve(first.rachis, second.rachis, weight),
            _blended_curve(first.barb, second.barb, weight),
        )
    if isinstance(first, tuple) or isinstance(second, tuple):
        # one number stands for both vanes
        pair = [each if isinstance(each, tuple) else (each, each) for each in (first, second)]
        return tuple(blended(a, b, weight) for a, b in zip(*pair, strict=True))
    if is_dataclass(first) and not isinstance(first, type):
        return type(first)(
            **{
                each.name: _BLENDS.get(each.name, blended)(
                    getattr(first, each.name), getattr(second, each.name), weight
                )
                for each in fields(first)
            }
        )
    return (1.0 - weight) * first + weight * second


def _blended_colour(first: Colour, second: Colour, weight: float) -> Colour:
    """Halfway colours; those that only one has, and marks of other sorts, from the nearer."""
    nearer = first if weight < 0.5 else second
    found: dict[str, Any] = {
        name: blended(getattr(first, name), getattr(second, name), weight)
        for name in ("base", "rachis", "brightness_variation", *SHADING)
    }
    sorts = [[(p.kind, p.count, p.film) for p in each.patterns] for each in (first, second)]
    found["patterns"] = nearer.patterns
    if sorts[0] == sorts[1]:
        marks = zip(blended(first.patterns, second.patterns, weight), nearer.patterns, strict=True)
        found["patterns"] = tuple(
            replace(mark, count=own.count, film=own.film) for mark, own in marks
        )
    return Colour(**found)


def _blended_curve(first: Curve, second: Curve, weight: float) -> Curve:
    """Halfway values, at the places of both."""
    if not first and not second:
        return ()
    places = np.unique([place for place, _ in (*first, *second)])
    ends = [
        np.interp(places, *np.transpose(curve)) if curve else np.ones(len(places))
        for curve in (first, second)
    ]
    halfway = (1.0 - weight) * ends[0] + weight * ends[1]
    return tuple(zip(places.tolist(), halfway.tolist(), strict=True))


def _nearer(first: Any, second: Any, weight: float) -> Any:
    return first if weight < 0.5 else second


# fields whose points may differ in number
_BLENDS = {"diameter_profile": _blended_curve, "modulus_profile": _blended_curve, "course": _nearer}
