"""Feathers that an artist drew in a scene: what a reader of scenes hands over, and their drafts."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from featherfx.algebra.types import Array
from featherfx.algebra.vectors import frames_from, parallel
from featherfx.errors import all_of, some_of, warn_input
from featherfx.groom.keys.groom import DEFAULT_PRIMVARS
from featherfx.groom.keys.preset import FEATHER_KEYS
from featherfx.groom.keys.problems import Place, Problems
from featherfx.groom.keys.values import Table
from featherfx.groom.presets.kinds import Change
from featherfx.groom.presets.library import sourced
from featherfx.groom.presets.presets import KindChoice, KindStore
from featherfx.groom.read.drafts import Draft, DrawnShape, belonging
from featherfx.groom.read.rachis_curve import (
    MAX_LINE_DEVIATION,
    DrawnVanes,
    curved_up,
    fit_arc,
    fit_course,
    tightest,
    vanes_of,
    without_repeats,
)
from featherfx.groom.read.space import DrawnFeather, SceneReader
from featherfx.groom.types import FeatherKind

_MAX_NAMED = 10
_SHORTEST, _LONGEST = 1e-4, 10.0  # m; beyond, a stage has another unit than it says


def drawn_drafts(
    entry: dict[str, Any], folder: Path, place: Place, store: KindStore, read: SceneReader | None
) -> list[Draft]:
    """The drafts of one [[usd]], without those that add problems. Raises InputError.

    entry: checked keys.
    """
    if read is None:
        place.refuse("is a USD scene, which featherfx.read_groom and the commands read")
    path, feathers = read(entry, folder, place)
    drafts = []
    for feather, name in zip(feathers, _ids(feathers), strict=True):
        at = Place(str(path), feather.label, place.problems)
        with place.problems.collecting():
            drafts.append(_draft(feather, name, entry, at, store))
    _warn_of_bends(path, drafts)
    return drafts


def _warn_of_bends(path: Path, drafts: list[Draft]) -> None:
    """Warn of drawn curves that a shaft follows badly."""
    far = [
        (draft.shape.fit.deviation / draft.shape.fit.length, draft.id)
        for draft in drafts
        if draft.shape is not None and draft.shape.bent
    ]
    far = sorted((each for each in far if each[0] > MAX_LINE_DEVIATION), reverse=True)
    if far:
        named = [f"'{name}' {off:.1%}" for off, name in far]
        warn_input(
            f"{path}: these curves turn more often or more sharply than shaft and vanes can. What"
            f" is taken for them is off by more than {MAX_LINE_DEVIATION:.0%} of their length: "
            f"{some_of(named, _MAX_NAMED)}"
        )


def _ids(feathers: list[DrawnFeather]) -> list[str]:
    """Ids as given; else the prims' names, or their whole paths where the names are not unique."""
    names = Counter(each.id or each.name for each in feathers)
    whole = [each.label.strip("/").replace("/", "_") for each in feathers]
    return [
        each.id or (each.name if names[each.name] == 1 else path)
        for each, path in zip(feathers, whole, strict=True)
    ]


def _draft(
    feather: DrawnFeather, name: str, entry: dict[str, Any], at: Place, store: KindStore
) -> Draft:
    points = without_repeats(feather.points)
    left = (entry["side"] == "left") != feather.mirrored
    kind, start = all_of(partial(_kind, feather, entry, at), partial(_start, feather, points, at))
    vanes = None if feather.barbs is None else vanes_of(feather.points, feather.barbs, left)
    up = _up(feather, entry, points) if vanes is None else vanes.up
    if up is None or parallel(start, up):
        fault = "there is none, and the curve is straight" if up is None else "lies along the curve"
        at.child(_named(entry, "up")).refuse(f"{fault}. Give up vectors, or up in the groom")
    choice = _choice(kind, vanes, at, store)
    fit, bent = fit_arc(points, up) if len(points) >= 2 else None, entry["shape"] == "curve"
    if fit is not None and not _SHORTEST <= fit.length <= _LONGEST:
        message = f"are {fit.length:.3g} m long. Give {_SHORTEST:g} to {_LONGEST:g} m. Do unit and "
        at.child("points").refuse(message + "transforms of the stage hold?")
    if fit is not None and bent and fit.deviation > MAX_LINE_DEVIATION * fit.length:
        fit = fit_course(fit, points, up, tightest(store.kind(choice)))
    return Draft(
        id=name,
        choice=choice,
        position=points[0],
        rotation=frames_from(fit.direction if fit is not None and bent else start, up),
        scale=feather.scale * entry["scale"],
        place=at,
        shape=None if fit is None else DrawnShape(fit, choice, bent),
        skin=feather.skin,
        skin_uv=feather.skin_uv,
        **belonging(entry) | {"left": left, "region": feather.region or entry["region"]},
    )


def _kind(feather: DrawnFeather, entry: dict[str, Any], at: Place) -> str:
    kind: str = feather.kind or entry["kind"] or ""
    if not kind:
        # once for a prim, however many curves it has
        prim = Place(at.source, at.key.partition("[")[0], at.problems)
        missing = "missing. Give the primvar, or kind in the [groom] or [[usd]] that names the file"
        prim.child(_named(entry, "kind")).refuse(missing)
    return kind


def _start(feather: DrawnFeather, points: Array, at: Place) -> Array:
    """(3,) where the shaft points as it leaves the follicle."""
    if len(points) >= 2:
        return np.asarray(points[1] - points[0])
    if feather.direction is None:
        at.child("points").refuse("the curve has no length. Draw it with two points or more")
    return feather.direction


def _choice(kind: str, vanes: DrawnVanes | None, at: Place, store: KindStore) -> KindChoice:
    """The kind with vanes as they are drawn."""
    if vanes is None:
        return KindChoice((kind,), 0.0, (), at)
    found = Problems()
    checked = Table(FEATHER_KEYS).check(
        vanes.change, replace(at.child("barbs"), problems=found), True
    )
    found.hand_on()
    return KindChoice((kind,), 0.0, (store.change(sourced(checked, at.source), at),), at)


def _named(entry: dict[str, Any], what: str) -> str:
    return "primvars:" + str(entry["names"].get(what) or DEFAULT_PRIMVARS[what])


def _up(feather: DrawnFeather, entry: dict[str, Any], points: Array) -> Array | None:
    if feather.up is not None:
        return feather.up
    if entry["up"] is not None:
        return np.array(entry["up"])
    return curved_up(points) if len(points) > 2 else None


def drawn_changes(draft: Draft, kind: FeatherKind, store: KindStore) -> tuple[float, Change]:
    """Return the factor of length and the change of the rachis that fit a kind to its drawing.

    draft: with a drawn shape. Values that an override has changed stay. Raises InputError.
    """
    shape = draft.shape
    assert shape is not None
    base = store.kind(shape.choice)
    fit, rachis = shape.fit, base.rachis
    factor = fit.length / kind.length if kind.length == base.length else 1.0
    if not shape.bent:
        return factor, Change()
    side = -1.0 if draft.left else 1.0
    course = tuple((place, camber, side * sweep, 0.0) for place, camber, sweep, _ in fit.course)
    return factor, Change(
        camber=fit.camber - rachis.camber if kind.rachis.camber == rachis.camber else 0.0,
        sweep=side * fit.sweep - rachis.sweep if kind.rachis.sweep == rachis.sweep else 0.0,
        course=course if kind.rachis.course == rachis.course else None,
    )
