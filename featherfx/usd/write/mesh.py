"""The mesh of one feather: topology and everything else that never changes."""

from __future__ import annotations

from typing import Any

import numpy as np
from pxr import UsdGeom, UsdShade

from featherfx.feather.types import LEADING, RACHIS, TRAILING, Surface
from featherfx.usd import arrays
from featherfx.usd.types import FeatherEntry
from featherfx.usd.write import material, primvars

SUBSETS = {"leadingVane": LEADING, "trailingVane": TRAILING, "rachis": RACHIS}


class MeshValues:
    """What all meshes of one surface have alike, made once: USD shares arrays between prims."""

    def __init__(self, surface: Surface) -> None:
        self.counts = arrays.ints(np.full(len(surface.triangles), 3))
        self.indices = arrays.ints(surface.triangles.ravel())
        self.side, self.st = arrays.ints(surface.part), arrays.vec2f(surface.st)
        self.subsets = {
            name: arrays.ints(faces)
            for name, part in SUBSETS.items()
            if len(faces := np.flatnonzero(surface.part == part))
        }


def define_mesh(
    stage: Any, path: Any, entry: FeatherEntry, values: MeshValues, rest: Any, materials: Any
) -> None:
    """Author the mesh's constant part. rest: USD array of the points, stage units."""
    mesh = UsdGeom.Mesh.Define(stage, path)
    mesh.CreateFaceVertexCountsAttr(values.counts)
    mesh.CreateFaceVertexIndicesAttr(values.indices)
    mesh.CreateSubdivisionSchemeAttr(UsdGeom.Tokens.none)
    mesh.CreateOrientationAttr(UsdGeom.Tokens.rightHanded)
    mesh.CreateDoubleSidedAttr(True)
    prim = mesh.GetPrim()
    primvars.author_labels(prim, entry)
    primvars.author_root(prim, entry.root)
    primvars.author_rest(prim, rest)
    primvars.author_st(prim, values.st)
    primvars.author_side(prim, values.side)
    primvars.author_colour(prim, material.COLOURS["vane"])
    material.bind(prim, materials["vane"])
    _define_subsets(mesh, values, materials)


def _define_subsets(mesh: Any, values: MeshValues, materials: Any) -> None:
    """Vanes and shaft as one family that covers every face once; an absent vane has no subset."""
    family = UsdShade.Tokens.materialBind
    for name, faces in values.subsets.items():
        subset = UsdGeom.Subset.CreateGeomSubset(mesh, name, UsdGeom.Tokens.face, faces, family)
        look = "rachis" if SUBSETS[name] == RACHIS else "vane"
        material.bind(subset.GetPrim(), materials[look])
    UsdGeom.Subset.SetFamilyType(mesh, family, UsdGeom.Tokens.partition)
