"""What roots ride on where there is no skin: ribbons along the bones of a skeleton, or a curve."""

from __future__ import annotations

from typing import Any

import numpy as np
from pxr import Sdf, UsdGeom, UsdSkel

from featherfx.groom.keys.values import Place
from featherfx.groom.skin.skin import is_flat
from featherfx.usd.read.animated_mesh import AnimatedMesh, open_mesh
from featherfx.usd.read.bone_ribbons import BoneRibbons
from featherfx.usd.read.curve_ribbon import CurveRibbon, curve_fault
from featherfx.usd.read.stage import SourceScene, find_prim, sampled_range, transform_fault
from featherfx.usd.read.values import collecting, reading


class RibbonMesh(AnimatedMesh):
    """Ribbons as a mesh that roots ride on. Its faces are bones, or pieces of a curve."""

    def __init__(
        self,
        scene: SourceScene,
        prim: Any,
        ribbons: BoneRibbons | CurveRibbon,
        rest: float | None,
    ) -> None:
        self._begin(scene, prim, ribbons, rest)
        self.sampled = sampled_range(prim, ribbons.attributes())
        sound = ~is_flat(self.rest, ribbons.triangles)
        self.triangles, self.st = ribbons.triangles[sound], None
        self.face = ribbons.faces[sound]
        # in metres: the bind pose may be scaled by the prim's transforms
        scale = float(np.cbrt(np.abs(np.linalg.det(self.rest_matrix[:3, :3]))))
        self.bones = scale * ribbons.lengths[sound]


def open_carrier(
    scene: SourceScene, path: str, rest: float | None, place: Place
) -> AnimatedMesh | None:
    """A mesh, or the ribbons of a skeleton or a curve, by its path; as of open_mesh."""
    prim = scene.stage.GetPrimAtPath(path) if Sdf.Path.IsValidPathString(path) else None
    for kind, opener in ((UsdSkel.Skeleton, open_bones), (UsdGeom.BasisCurves, open_curve)):
        if prim and prim.IsA(kind):
            return opener(scene, prim, rest, place) if find_prim(scene, path, place) else None
    return open_mesh(scene, path, rest, place)


def open_curve(
    scene: SourceScene, prim: Any, rest: float | None, place: Place
) -> RibbonMesh | None:
    """A curve as a mesh that moves; None after adding problems."""
    count = len(place.problems)
    with collecting(place), reading(prim):
        fault = curve_fault(scene, prim, place)
        fault = (
            f"{prim.GetPath()} in {scene.path} {fault}" if fault else transform_fault(scene, prim)
        )
        if fault:
            return place.fail(fault) and None
        if len(place.problems) == count:
            return RibbonMesh(scene, prim, CurveRibbon(scene, prim), rest)
    return None


def open_bones(
    scene: SourceScene, prim: Any, rest: float | None, place: Place
) -> RibbonMesh | None:
    """A skeleton as a mesh that moves; None after adding problems."""
    path = f"{prim.GetPath()} in {scene.path}"
    with collecting(place), reading(prim):
        fault = transform_fault(scene, prim)
        if fault:
            return place.fail(fault) and None
        query = UsdSkel.Cache().GetSkelQuery(UsdSkel.Skeleton(prim))
        if not query or not query.HasBindPose() or not len(query.GetJointOrder()):
            return place.fail(f"{path} has no joints with bind transforms") and None
        opened = RibbonMesh(scene, prim, BoneRibbons(prim), rest)
        if not len(opened.triangles):
            return place.fail(f"{path} has no bone of any length") and None
        return opened
    return None
