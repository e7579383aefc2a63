"""Grooms drawn in USD: curves as rachises, condensed feathers, and instanced templates."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from pxr import Usd, UsdGeom

from featherfx.algebra.types import Array
from featherfx.errors import all_of
from featherfx.groom.keys.problems import Place, Problems
from featherfx.groom.read.rachis_curve import DrawnBarbs
from featherfx.groom.read.space import DrawnFeather
from featherfx.phases import LeftOut, StageRead, note_read
from featherfx.usd.read.curves import CurveElement, PrimvarReader, is_curves, read_prim_curves
from featherfx.usd.read.drawn_meshes import Instances, find_hidden, instance_matrices, refuse_rings
from featherfx.usd.read.stage import (
    SourceScene,
    check_transforms,
    describe_broken,
    describe_prims,
    find_prim,
    open_chosen,
    prims_below,
    rest_time,
    transform_points,
)
from featherfx.usd.read.values import (
    DEFAULT_TIME,
    INTEGER_ARRAY,
    compute,
    errors_at,
    locate_file,
    read_array,
    read_inverse,
    read_matrix,
    read_sized_array,
    read_targets,
)


@dataclass(frozen=True)
class _Curve:
    """One curve of a prim in the prim's own space, points (k, 3), with its primvars."""

    prim: Any
    points: Array
    barbs: DrawnBarbs | None
    own: CurveElement


def read_feathers(
    entry: dict[str, Any], folder: Path, place: Place
) -> tuple[Path, list[DrawnFeather]]:
    """Return the file and the feathers of one checked [[usd]] entry. Raises InputError.

    folder: that relative files start from. Problems of prims name the file and the prim.
    """
    path, at, problems = locate_file(folder, entry["file"]), place.child("prims"), Problems()
    scene = open_chosen(path, entry, place.child("file"), place)
    paths, roots = entry["prims"] or ("/",), []
    for each in paths:
        with problems.collecting():
            whole = each == "/"
            root = scene.stage.GetPseudoRoot()
            roots += [root if whole else find_prim(scene, each, at, "curves", "instancer")]
    feathers: list[DrawnFeather] = []
    left: list[LeftOut] = []
    at_file = Place(str(path), "", problems)
    with problems.collecting(), errors_at(place):
        for prim in [prim for root in roots for prim in _sources(root, entry, left)]:
            with problems.collecting(), errors_at(place):
                feathers += _read_prim(scene, prim, entry, at_file)
    problems.hand_on()
    if not feathers:
        nothing = f"{path}: no curves and no instances at {', '.join(paths)} or below"
        there = describe_prims(scene, ("curves", "instancer"), paths[0])
        hidden = "".join(f". {each.path} {each.reason}" for each in left[:1])
        at.refuse(nothing + hidden + there + describe_broken(scene))
    named = ", ".join(paths)
    note_read(StageRead(str(path), named, "feather", len(feathers), tuple(left)))
    return path, feathers


def _sources(root: Any, entry: dict[str, Any], left: list[LeftOut]) -> Iterator[Any]:
    """Yield curves and instancers at a prim or below, as they are drawn.

    Prototypes of instancers are part of these. left: takes those that are not read.
    """
    found = [
        prim
        for prim in prims_below(root)
        if prim.IsA(UsdGeom.Curves) or prim.IsA(UsdGeom.PointInstancer)
    ]
    prototypes = [
        target
        for prim in found
        if prim.IsA(UsdGeom.PointInstancer)
        for target in read_targets(UsdGeom.PointInstancer(prim).GetPrototypesRel())
    ]
    for prim in found:
        path, kind = str(prim.GetPath()), str(prim.GetTypeName())
        if any(prim.GetPath().HasPrefix(each) for each in prototypes):
            continue
        if not (is_curves(prim) or prim.IsA(UsdGeom.PointInstancer)):
            left.append(LeftOut(path, kind, "is of a kind of curves that is not known"))
        elif path not in entry["prims"] and (reason := _find_reason(prim, entry)):
            left.append(LeftOut(path, kind, reason))
        else:
            yield prim


def _find_reason(prim: Any, entry: dict[str, Any]) -> str:
    """Return why a prim that no path names is not read; empty where it is."""
    if not prim.HasAttribute("primvars:featherId"):
        return find_hidden(prim, entry)
    # rachises of a cache are guides, and feathers by their ids
    every = ("default", "render", "proxy", "guide")
    return find_hidden(prim, {**entry, "purposes": every})


def _read_prim(
    scene: SourceScene, prim: Any, entry: dict[str, Any], place: Place
) -> Iterator[DrawnFeather]:
    check_transforms(scene, prim, place.child(str(prim.GetPath())))
    if prim.IsA(UsdGeom.PointInstancer):
        yield from _instances(scene, prim, entry, place)
        return
    for curve in _read_curves(prim, entry, place):
        code = _rest_time(UsdGeom.Curves(prim).GetPointsAttr(), entry)
        matrix = scene.matrix(prim, code)
        path = str(prim.GetPath())
        alone, number = curve.own.of == 1, curve.own.number
        label = path if alone else f"{path}[{number}]"
        name = prim.GetName() + ("" if alone else f"_{number:04d}")
        yield _drawn_feather(curve, matrix, label, name, None)


def _rest_time(attribute: Any, entry: dict[str, Any]) -> Any:
    return rest_time(attribute) if entry["time"] is None else Usd.TimeCode(entry["time"])


def _read_curves(prim: Any, entry: dict[str, Any], place: Place) -> Iterator[_Curve]:
    """Yield the curves of a prim."""
    at = place.child(str(prim.GetPath()))
    code = _rest_time(UsdGeom.Curves(prim).GetPointsAttr(), entry)
    curves = read_prim_curves(prim, code, at)
    values, count = PrimvarReader(prim, entry["names"], code, curves.starts, at), len(curves.points)
    left, right = values.barbs("left_barbs", count), values.barbs("right_barbs", count)
    if (left is None) != (right is None):
        at.fail("has barbs on one side only. Give P_barbl and P_barbr")
    for number in range(len(curves)):
        own = CurveElement(values, number, len(curves))
        if left is None or right is None:
            yield _Curve(prim, curves.line(number), None, own)
        else:
            part = curves.own(number)
            barbs = DrawnBarbs(left[part], right[part])
            yield _Curve(prim, curves.points[part], barbs, own)


def _drawn_feather(
    curve: _Curve, matrix: Array, label: str, name: str, instance: CurveElement | None
) -> DrawnFeather:
    """Return a curve carried into the world by a matrix (4, 4).

    instance: of the instancer; its values win.
    """
    sources = [curve.own] if instance is None else [instance, curve.own]

    def text(what: str) -> str:
        return next((found for each in sources if (found := each.text(what))), "")

    scale = math.prod(each.scale() for each in sources)
    barbs = curve.barbs
    if barbs is not None:
        sides = [transform_points(side, matrix) for side in (barbs.left, barbs.right)]
        mirrored = np.linalg.det(matrix[:3, :3]) < 0.0
        # left and right change places in a mirror; scale is about the root
        root = transform_points(curve.points[:1], matrix)
        sides = [root + scale * (side - root) for side in sides]
        barbs = DrawnBarbs(*(reversed(sides) if mirrored else sides))
    points = transform_points(curve.points, matrix)
    drawn = (place for each in sources if (place := each.vector("skin_uv", 2)) is not None)
    skin_uv = _pair(next(drawn, None))
    return DrawnFeather(
        label=label,
        name=name,
        id=sources[0].text("id"),
        kind=text("kind"),
        region=text("region"),
        points=points[:1] + scale * (points - points[:1]),
        direction=None,
        up=_read_up(curve.own, matrix),
        scale=1.0,
        mirrored=bool(np.linalg.det(matrix[:3, :3]) < 0.0),
        skin=text("skin"),
        skin_uv=skin_uv,
        barbs=barbs,
    )


def _pair(values: Array | None) -> tuple[float, float] | None:
    return None if values is None else (float(values[0]), float(values[1]))


def _read_up(source: CurveElement, matrix: Array) -> Array | None:
    """Return (3,) dorsal in the world, from a frame or an up vector."""
    frame = source.frame()
    up = source.vector("up", 3) if frame is None else frame[2]
    if up is None:
        return None
    turned = up @ matrix[:3, :3]
    size = np.linalg.norm(turned)
    return np.asarray(turned / size) if size > 0.0 else None


def _instances(
    scene: SourceScene, prim: Any, entry: dict[str, Any], place: Place
) -> Iterator[DrawnFeather]:
    """Yield feathers of a point instancer, each of a template with curves, or of a kind."""
    instancer, at = UsdGeom.PointInstancer(prim), place.child(str(prim.GetPath()))
    refuse_rings(prim)
    code = _rest_time(instancer.GetPositionsAttr(), entry)
    numbers = read_sized_array(instancer.GetProtoIndicesAttr(), code, INTEGER_ARRAY).astype(
        np.int64
    )
    targets = read_targets(instancer.GetPrototypesRel())
    wrong = numbers[(numbers < 0) | (numbers >= len(targets))]
    if len(wrong):
        at.child("protoIndices").refuse(f"name prototype {wrong[0]} of {len(targets)}")
    matrices = instance_matrices(instancer, code)
    if len(numbers) == 0 or len(matrices) != len(numbers):
        at.refuse(f"has {len(numbers)} protoIndices and {len(matrices)} instance transforms")
    if not np.isfinite(matrices).all():
        at.refuse("holds instances whose positions are not finite. Remove them")
    templates = all_of(*(partial(_template, scene, path, entry, at, place) for path in targets))
    to_stage = scene.matrix(prim, code)
    ids = read_array(instancer.GetIdsAttr(), code, INTEGER_ARRAY)
    if ids is not None and len(ids) != len(numbers):
        at.child("ids").refuse(f"has {len(ids)} values for {len(numbers)} instances")
    mask = compute(prim, instancer.ComputeMaskAtTime, code)
    values = PrimvarReader(prim, entry["names"], code, None, at)
    for k, number in enumerate(numbers):
        if len(mask) and not mask[k]:
            continue
        whole = matrices[k] @ to_stage
        mark = k if ids is None else ids[k]
        label, name = f"{prim.GetPath()}[{k}]", f"{prim.GetName()}_{mark:04d}"
        own = CurveElement(values, k, len(numbers))
        yield from _instanced(templates[number], whole, scene.meters_per_unit, label, name, own)


def _template(scene: SourceScene, path: Any, entry: dict[str, Any], at: Place, place: Place) -> Any:
    """Return [(curve, matrix to the space of the prototype, suffix)], and the prototype itself."""
    prim = find_prim(scene, str(path), at.child("prototypes"))
    values = PrimvarReader(prim, entry["names"], DEFAULT_TIME, None, place.child(str(path)))
    return list(_template_curves(prim, entry, place)), CurveElement(values, 0, 1)


def _template_curves(
    root: Any, entry: dict[str, Any], place: Place
) -> Iterator[tuple[_Curve, Array, str]]:
    """Yield curves at or below a prototype, with those that instancers place there."""
    code = DEFAULT_TIME if entry["time"] is None else Usd.TimeCode(entry["time"])
    back = read_inverse(root, code)
    for prim in prims_below(root):
        if is_curves(prim):
            relative = read_matrix(prim, code) @ back
            for curve in _read_curves(prim, entry, place):
                yield curve, relative, f"_{prim.GetName()}_{curve.own.number}"
        elif prim.IsA(UsdGeom.PointInstancer):
            inner = Instances(prim)
            for index, own in inner.drawn():
                placed = inner.matrix(index, code) @ back
                curves = list(_template_curves(own, entry, place))
                if not curves:
                    told = "holds no curves, which an instancer in another one needs. Add a curve"
                    place.child(str(own.GetPath())).refuse(told)
                for curve, relative, suffix in curves:
                    yield curve, relative @ placed, f"_{prim.GetName()}_{index}{suffix}"


def _instanced(
    template: Any, matrix: Array, unit: float, label: str, name: str, own: CurveElement
) -> Iterator[DrawnFeather]:
    curves, prototype = template
    for curve, relative, suffix in curves:
        several = "" if len(curves) == 1 else suffix
        yield _drawn_feather(curve, relative @ matrix, label + several, name + several, own)
    if curves:
        return
    # a template without a curve: its kind at its own size, rachis along x, dorsal along z
    size = float(abs(np.linalg.det(matrix[:3, :3]))) ** (1.0 / 3.0) / unit
    skin_uv = _pair(own.vector("skin_uv", 2))
    yield DrawnFeather(
        label=label,
        name=name,
        id=own.text("id"),
        kind=own.text("kind") or prototype.text("kind"),
        region=own.text("region") or prototype.text("region"),
        points=matrix[None, 3, :3],
        direction=matrix[0, :3],
        up=matrix[2, :3],
        scale=size * own.scale(),
        mirrored=bool(np.linalg.det(matrix[:3, :3]) < 0.0),
        skin=own.text("skin"),
        skin_uv=skin_uv,
        barbs=None,
    )
