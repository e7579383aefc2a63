"""The mesh of one feather: topology and everything else that never changes."""

from __future__ import annotations

from typing import Any

import numpy as np
from pxr import UsdGeom, UsdShade

from featherfx.feather.types import LEADING, RACHIS, TRAILING
from featherfx.usd import arrays, material, primvars
from featherfx.usd.types import FeatherEntry

SUBSETS = {"leadingVane": LEADING, "trailingVane": TRAILING, "rachis": RACHIS}


def define_mesh(stage: Any, path: Any, entry: FeatherEntry, rest: Any, materials: Any) -> None:
    """Author the mesh's constant part. rest: (V, 3) stage units."""
    mesh = UsdGeom.Mesh.Define(stage, path)
    triangles = entry.feather.surface.triangles
    mesh.CreateFaceVertexCountsAttr(arrays.ints(np.full(len(triangles), 3)))
    mesh.CreateFaceVertexIndicesAttr(arrays.ints(triangles.ravel()))
    mesh.CreateSubdivisionSchemeAttr(UsdGeom.Tokens.none)
    mesh.CreateOrientationAttr(UsdGeom.Tokens.rightHanded)
    mesh.CreateDoubleSidedAttr(True)
    prim = mesh.GetPrim()
    primvars.author_labels(prim, entry)
    primvars.author_root(prim, entry.root)
    primvars.author_rest(prim, rest)
    primvars.author_surface(prim, entry)
    primvars.author_colour(prim, material.COLOURS["vane"])
    material.bind(prim, materials["vane"])
    _define_subsets(mesh, entry, materials)


def _define_subsets(mesh: Any, entry: FeatherEntry, materials: Any) -> None:
    """Vanes and shaft as one family that covers every face once; an absent vane has no subset."""
    family = UsdShade.Tokens.materialBind
    for name, part in SUBSETS.items():
        faces = np.flatnonzero(entry.feather.surface.part == part)
        if len(faces) == 0:
            continue
        subset = UsdGeom.Subset.CreateGeomSubset(
            mesh, name, UsdGeom.Tokens.face, arrays.ints(faces), family
        )
        material.bind(subset.GetPrim(), materials["rachis" if part == RACHIS else "vane"])
    UsdGeom.Subset.SetFamilyType(mesh, family, UsdGeom.Tokens.partition)
