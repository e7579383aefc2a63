"""Stages that others made, checked as what they may be to a bake: feathers, skins, colliders."""

from __future__ import annotations

import warnings
from collections import Counter
from pathlib import Path
from typing import Any

from pxr import Tf, Usd, UsdGeom, UsdUtils

from featherfx.errors import InputWarning, Problem
from featherfx.groom.groom_keys import USD
from featherfx.groom.read import SCENE_SUFFIXES
from featherfx.groom.schema import Place, Problems, Table
from featherfx.usd.animated_mesh import open_mesh
from featherfx.usd.check_geometry import GeometryCheck
from featherfx.usd.read_groom import read_feathers
from featherfx.usd.scene import Scene, broken_clips, broken_files, open_scene, prims_below


def check_scene(path: Path) -> list[Problem]:
    """Every problem that keeps a stage, or what is in it, from being used.

    Meshes are opened as skins and colliders are; curves and instancers are read as feathers; and
    of every point set sizes, indices and values are checked. What only caches promise (extents
    that fit, a kind, the range of time codes) is said as InputWarning where it is not so.
    """
    problems = Problems()
    place = Place(str(path), "", problems)
    scene = open_scene(path, place)
    if scene is None:
        return problems.listed()
    for each in missing_files(path):
        place.child(each.key).fail(each.message)
    bad = _meshes(scene, place)
    _feathers(scene, path, place)
    for prim in prims_below(scene, scene.stage.GetPseudoRoot()):
        if not prim.IsA(UsdGeom.PointBased) or str(prim.GetPath()) in bad:
            continue
        check = GeometryCheck(prim)
        for attribute, message in check.faults():
            place.child(f"{prim.GetPath()}.{attribute}").fail(message)
        for attribute, message in check.habits():
            text = f"{path}: {prim.GetPath()}.{attribute}: {message}"
            warnings.warn(text, InputWarning, stacklevel=2)
    return problems.listed()


def _meshes(scene: Scene, place: Place) -> set[str]:
    """Paths of the meshes that cannot be followed, after adding their problems."""
    bad = set()
    for prim in prims_below(scene, scene.stage.GetPseudoRoot()):
        if prim.IsA(UsdGeom.Mesh) and prim.IsDefined() and not prim.IsAbstract():
            path = str(prim.GetPath())
            if open_mesh(scene, path, None, place) is None:
                bad.add(path)
    return bad


def _feathers(scene: Scene, path: Path, place: Place) -> None:
    kinds = (UsdGeom.BasisCurves, UsdGeom.PointInstancer)
    prims = list(prims_below(scene, scene.stage.GetPseudoRoot()))
    if not any(prim.IsA(kind) for prim in prims for kind in kinds):
        return
    entry = Table(USD).check({"file": path.name}, place, False)
    found = read_feathers(entry, path.parent, place)
    if found is None:
        return
    ids = Counter(feather.id for feather in found[1] if feather.id)
    for name, count in ids.items():
        if count > 1:
            labels = ", ".join(feather.label for feather in found[1] if feather.id == name)
            place.child(labels).fail(f"featherId '{name}' is used {count} times; ids are unique")


def missing_files(path: Path) -> list[Problem]:
    """USD files that a stage names, as sublayer, payload or clip, and that are not to be had."""
    stage = Usd.Stage.Open(str(path))
    found = broken_files(stage) | broken_clips(stage)
    if not found:  # USD 24.3 ends the process where it looks into a file that it cannot open
        try:
            _, _, unresolved = UsdUtils.ComputeAllDependencies(str(path))
            names = [str(each) for each in unresolved]
        except Tf.ErrorException as error:
            reason = f"USD cannot open a file that it names: {_reason(error)}"
            return [Problem(str(path), "", reason)]
        found = {name: "is missing" for name in names if Path(name).suffix in SCENE_SUFFIXES}
    return [Problem(str(path), name, message) for name, message in sorted(found.items())]


def _reason(error: Any) -> str:
    return "; ".join(str(part.commentary) for part in error.args)
