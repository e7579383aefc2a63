"""What never changes of a feather's prims: mesh, curves, materials, primvars.

Preview materials stand until look development binds others. The shaft's centre line is for grooming
tools and constraints, and the whole feather where only rachises are drawn; purposes are those of
the scopes above (define.py). Primvars are always arrays, since some readers drop scalars.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from pxr import Gf, Sdf, UsdGeom, UsdShade

from featherfx.feather.types import LEADING, RACHIS, TRAILING, Surface
from featherfx.shot.motion.skin import SkinRoot
from featherfx.usd import arrays
from featherfx.usd.types import FeatherEntry

BARB_DIRECTION = "primvars:barbDirection"
COLOURS = {"vane": (0.80, 0.76, 0.69), "rachis": (0.42, 0.33, 0.24)}
SUBSETS = {"leadingVane": LEADING, "trailingVane": TRAILING, "rachis": RACHIS}
_ROUGHNESS = {"vane": 0.65, "rachis": 0.4}

# type, interpolation and numbers of an element
_TYPES, _CONSTANT = Sdf.ValueTypeNames, UsdGeom.Tokens.constant
_PRIMVARS = {
    # of the feather
    **dict.fromkeys(("featherId", "featherKind", "region"), (_TYPES.StringArray, _CONSTANT, 1)),
    # where it sits on its skin: at the sum of three skin points by their barycentric coordinates
    "skinPrim": (_TYPES.StringArray, _CONSTANT, 1),
    "skinFace": (_TYPES.IntArray, _CONSTANT, 1),
    "skinPoints": (_TYPES.IntArray, _CONSTANT, 3),
    "skinBarycentric": (_TYPES.FloatArray, _CONSTANT, 3),
    # the rest points, for RenderMan and Arnold, and for Houdini
    "Pref": (_TYPES.Point3fArray, UsdGeom.Tokens.vertex, 1),
    "rest": (_TYPES.Point3fArray, UsdGeom.Tokens.vertex, 1),
    # the dorsal side at the root, at rest, as grooms have it; object space
    "up": (_TYPES.Vector3fArray, _CONSTANT, 1),
    "st": (_TYPES.TexCoord2fArray, UsdGeom.Tokens.vertex, 1),
    # 0 leading, 1 trailing, 2 rachis
    "side": (_TYPES.IntArray, UsdGeom.Tokens.uniform, 1),
    # share of barbules that are hooked, of vanes whose hooks all hold
    "hooked": (_TYPES.FloatArray, UsdGeom.Tokens.uniform, 1),
    # for viewers that ignore materials
    "displayColor": (_TYPES.Color3fArray, _CONSTANT, 1),
}


def author_primvars(prim: Any, **values: Any) -> None:
    """Author primvars of a prim, USD arrays by their names."""
    for name, value in values.items():
        kind, interpolation, element = _PRIMVARS[name]
        primvar = UsdGeom.PrimvarsAPI(prim).CreatePrimvar(name, kind, interpolation)
        primvar.Set(value)
        if element > 1:
            primvar.SetElementSize(element)


def replace_primvars(layer: Any, path: Any, **values: Any) -> None:
    """Other values of primvars that a prim of a layer has already."""
    for name, value in values.items():
        attribute = layer.GetAttributeAtPath(path.AppendProperty(f"primvars:{name}"))
        attribute.default = value


def seat(root: SkinRoot) -> dict[str, Any]:
    """The primvars that tell where a feather sits on a skin."""
    return {
        "skinPrim": arrays.strings(root.path),
        "skinFace": arrays.ints([root.face]),
        "skinPoints": arrays.ints(root.points),
        "skinBarycentric": arrays.floats(root.barycentric),
    }


def labels(id: str, kind: str, region: str) -> dict[str, Any]:
    """The primvars that tell whose a prim is."""
    values = {"featherId": id, "featherKind": kind, "region": region}
    return {name: arrays.strings(value) for name, value in values.items()}


def define_materials(stage: Any, scope: Any) -> dict[str, Any]:
    """UsdPreviewSurface materials "vane" and "rachis" under the path scope."""
    UsdGeom.Scope.Define(stage, scope)
    return {name: _define_material(stage, scope.AppendChild(name), name) for name in COLOURS}


def _define_material(stage: Any, path: Any, name: str) -> Any:
    material = UsdShade.Material.Define(stage, path)
    shader = UsdShade.Shader.Define(stage, path.AppendChild("surface"))
    shader.CreateIdAttr("UsdPreviewSurface")
    colour = shader.CreateInput("diffuseColor", Sdf.ValueTypeNames.Color3f)
    colour.Set(Gf.Vec3f(*COLOURS[name]))
    shader.CreateInput("roughness", Sdf.ValueTypeNames.Float).Set(_ROUGHNESS[name])
    output = shader.CreateOutput("surface", Sdf.ValueTypeNames.Token)
    material.CreateSurfaceOutput().ConnectToSource(output)
    return material


def _look(prim: Any, name: str, materials: Any) -> None:
    """Display colour and material "vane" or "rachis"."""
    author_primvars(prim, displayColor=arrays.vec3f([COLOURS[name]]))
    UsdShade.MaterialBindingAPI.Apply(prim).Bind(materials[name])


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
    author_primvars(prim, **labels(entry.id, entry.kind, entry.region))
    if entry.root is not None:
        author_primvars(prim, **seat(entry.root))
    author_primvars(prim, Pref=rest, rest=rest, st=values.st, side=values.side)
    if entry.held is not None and not entry.hooked:
        author_primvars(prim, hooked=arrays.floats(entry.held))
    _look(prim, "vane", materials)
    # vanes and shaft as one family that covers every face once; an absent vane has no subset
    family = UsdShade.Tokens.materialBind
    for name, faces in values.subsets.items():
        subset = UsdGeom.Subset.CreateGeomSubset(mesh, name, UsdGeom.Tokens.face, faces, family)
        look = materials["rachis" if SUBSETS[name] == RACHIS else "vane"]
        UsdShade.MaterialBindingAPI.Apply(subset.GetPrim()).Bind(look)
    UsdGeom.Subset.SetFamilyType(mesh, family, UsdGeom.Tokens.partition)


def define_rachis(
    stage: Any, path: Any, entry: FeatherEntry, rest: Any, widths: Any, up: Any, materials: Any
) -> None:
    """Author the curve's constant part.

    rest: USD array of n points. widths: (n,) diameters. up: (3,) dorsal direction of the root.
    """
    prim = _define_curves(stage, path, entry, [len(rest)], rest, widths)
    author_primvars(prim, up=arrays.vec3f([up]))
    _look(prim, "rachis", materials)


def define_barbs(
    stage: Any, path: Any, entry: FeatherEntry, rest: Any, widths: Any, materials: Any
) -> None:
    """Author the constant part of a feather's barbs. rest: USD array, (B K,), widths: as many."""
    assert entry.barbs is not None
    count, points = entry.barbs.widths.shape
    prim = _define_curves(stage, path, entry, np.full(count, points), rest, widths)
    st = arrays.vec2f(entry.barbs.st.reshape(-1, 2))
    author_primvars(prim, side=arrays.ints(entry.barbs.side), st=st)
    _look(prim, "vane", materials)


def _define_curves(
    stage: Any, path: Any, entry: FeatherEntry, counts: Any, rest: Any, widths: Any
) -> Any:
    curve = define_polylines(stage, path, counts)
    curve.CreateWidthsAttr(arrays.floats(widths))
    curve.SetWidthsInterpolation(UsdGeom.Tokens.vertex)
    prim = curve.GetPrim()
    author_primvars(prim, Pref=rest, rest=rest, **labels(entry.id, entry.kind, entry.region))
    return prim


def define_polylines(stage: Any, path: Any, counts: Any) -> Any:
    """Linear curves of so many points each."""
    curve = UsdGeom.BasisCurves.Define(stage, path)
    curve.CreateTypeAttr(UsdGeom.Tokens.linear)
    curve.CreateWrapAttr(UsdGeom.Tokens.nonperiodic)
    curve.CreateCurveVertexCountsAttr(arrays.ints(counts))
    return curve
