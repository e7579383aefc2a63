"""Prims of feathers: their constant attributes, primvars and materials.

The rachis's centre line serves grooming tools and constraints, and stands for the feather where
only rachises are drawn. Purposes are those of the scopes above (prims.py). Primvars are always
arrays, since some readers drop scalars.

A value per feather is constant on a prim of one feather. On a shared prim it is uniform, with a
value for each face or curve, and tables list the points, faces and curves of each feather:
featherRange:points and so on, first and number, in the order of featherId's values.

Materials (materials.py) stand until look development binds others.

Definition of the prims of a cache with their constant values.

A variant set of the root prim chooses the drawn representation:

    variant   feathers (meshes)   barbs (curves)   rachises (curves)
    vane      drawn               hidden           guide
    barbs     proxy               render           render
    rachis    hidden              hidden           drawn

Prims and their samples are the same in every variant; only purpose and visibility of the scopes
above them change. Both are inherited, so that single feathers need neither.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from pxr import Sdf, UsdGeom, UsdShade

from featherfx.algebra.types import Array, Indices
from featherfx.feather.types import LEADING, RACHIS_PART, TRAILING, BarbCurves
from featherfx.files.disk_cache import stable_number
from featherfx.groom.materials import PIGMENTS
from featherfx.usd import arrays
from featherfx.usd.types import (
    BARB_COLOUR_PRIMVARS,
    BARB_COUNT_PRIMVAR,
    BARB_PRIM,
    COLOUR_PRIMVAR,
    HOOKED_PRIMVAR,
    LOOK_PRIMVAR,
    MESH_PRIM,
    RACHIS_PRIM,
    RANGES_PREFIX,
    SHAPE_PRIMVAR,
    SHAPE_SIZE_PRIMVAR,
    FeatherEntry,
)
from featherfx.usd.write.materials import MATERIAL_COLOURS

if TYPE_CHECKING:
    from featherfx.usd.write.posed_groups import PosedGroup


from pxr import Usd

from featherfx import usd
from featherfx.usd.types import BARB_NODE_PRIMVARS
from featherfx.usd.write.chunks import AnimatedPrims
from featherfx.usd.write.layers import (
    BARBS_SCOPE,
    FEATHERS_SCOPE,
    MATERIALS_SCOPE,
    RACHISES_SCOPE,
    SCOPES,
    StageInfo,
    define_root,
)
from featherfx.usd.write.materials import choose_inputs, define_materials
from featherfx.usd.write.posed_groups import PosedGroup

# primvars of SHADING by their keys, with units of theirs in one of the key's
SHADING_PRIMVARS = {"film": ("filmThickness", 1e9), "barbule_tilt": ("barbuleTilt", 1.0)}
SHADING_PRIMVARS |= {name: (name, 1.0) for name in PIGMENTS}
SUBSETS = {"leadingVane": LEADING, "trailingVane": TRAILING, "rachis": RACHIS_PART}

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
    # places in the images, and of rachises u, v, du, dv of the feather's own chart
    "atlas": (_TYPES.TexCoord2fArray, UsdGeom.Tokens.vertex, 1),
    "chart": (_TYPES.Float4Array, _CONSTANT, 1),
    # nm, degrees, and 0 to 1
    **dict.fromkeys(
        ("filmThickness", "barbuleTilt", *PIGMENTS), (_TYPES.FloatArray, UsdGeom.Tokens.vertex, 1)
    ),
    # 0 leading, 1 trailing, 2 rachis
    "side": (_TYPES.IntArray, UsdGeom.Tokens.uniform, 1),
    # of barbs: a number of each, its place on its vane from the base, and st of its root
    **dict.fromkeys(("barbId", "barbIndex"), (_TYPES.IntArray, UsdGeom.Tokens.uniform, 1)),
    "rootUv": (_TYPES.TexCoord2fArray, UsdGeom.Tokens.uniform, 1),
    # of barbules that are drawn: 1 distal, 2 proximal; 0 of barbs
    "barbule": (_TYPES.IntArray, UsdGeom.Tokens.uniform, 1),
    # part of a width that the barb itself has, without its barbules
    "ramus": (_TYPES.FloatArray, UsdGeom.Tokens.vertex, 1),
    # share of barbules that are hooked, of vanes whose hooks all hold; of barbs at their points
    "hooked": (_TYPES.FloatArray, UsdGeom.Tokens.uniform, 1),
    # of condensed feathers, at the nodes of left and right barbs, as many a point as P_barbl has; a
    # diameter of 0 says that there is no barb
    **dict.fromkeys(("uv_barbl", "uv_barbr"), (_TYPES.TexCoord2fArray, UsdGeom.Tokens.vertex, 1)),
    **dict.fromkeys(("width_barbl", "width_barbr"), (_TYPES.FloatArray, UsdGeom.Tokens.vertex, 1)),
    **dict.fromkeys(("rest_barbl", "rest_barbr"), (_TYPES.Point3fArray, UsdGeom.Tokens.vertex, 1)),
    # of the feather: whether its leading vane is the right one; what it is built of, as text, and
    # how many times as large it is
    "leadingIsRight": (_TYPES.IntArray, _CONSTANT, 1),
    SHAPE_PRIMVAR: (_TYPES.StringArray, _CONSTANT, 1),
    COLOUR_PRIMVAR: (_TYPES.StringArray, _CONSTANT, 1),
    **dict.fromkeys(BARB_COLOUR_PRIMVARS, (_TYPES.Color3fArray, UsdGeom.Tokens.vertex, 1)),
    LOOK_PRIMVAR: (_TYPES.StringArray, _CONSTANT, 1),
    BARB_COUNT_PRIMVAR: (_TYPES.IntArray, _CONSTANT, 1),
    SHAPE_SIZE_PRIMVAR: (_TYPES.FloatArray, _CONSTANT, 1),
    # for viewers that ignore materials
    "displayColor": (_TYPES.Color3fArray, _CONSTANT, 1),
}


def author_primvars(prim: Any, interpolation: str = "", **values: Any) -> None:
    """Author primvars, USD arrays by their names. interpolation: empty for the default."""
    for name, value in values.items():
        kind, usual, element = _PRIMVARS[name]
        primvar = UsdGeom.PrimvarsAPI(prim).CreatePrimvar(name, kind, interpolation or usual)
        primvar.Set(value)
        if element > 1:
            primvar.SetElementSize(element)


def author_shared(
    prim: Any, name: str, values: Sequence[Any], interpolation: str, counts: Any = 1
) -> None:
    """Author a primvar of texts or numbers, each stored once.

    counts: elements of each value.
    """
    place = {value: number for number, value in enumerate(dict.fromkeys(values))}
    told = arrays.ints([*place]) if isinstance(values[0], int) else arrays.strings(*place)
    author_primvars(prim, interpolation, **{name: told})
    indices = np.repeat([place[value] for value in values], counts)
    if len(indices) > len(place):
        UsdGeom.PrimvarsAPI(prim).GetPrimvar(name).SetIndices(arrays.ints(indices))


def skin_primvars(entries: Sequence[FeatherEntry]) -> dict[str, Any]:
    """Return the primvars with the places of feathers on a skin; each must have one."""
    roots = [entry.root for entry in entries if entry.root is not None]
    return {
        "skinPrim": arrays.strings(*(root.path for root in roots)),
        "skinFace": arrays.ints([root.face for root in roots]),
        "skinPoints": arrays.ints(np.ravel([root.points for root in roots])),
        "skinBarycentric": arrays.floats(np.ravel([root.barycentric for root in roots])),
    }


def label_primvars(id: str, kind: str, region: str) -> dict[str, Any]:
    """Return the primvars with id, kind and region of a feather."""
    values = {"featherId": id, "featherKind": kind, "region": region}
    return {name: arrays.strings(value) for name, value in values.items()}


def _author_owners(
    prim: Any, group: PosedGroup, entries: Sequence[FeatherEntry], **starts: Indices
) -> None:
    """Author the labels of a feather, or the tables of feathers; starts as of author_ranges."""
    if group.alone:
        author_primvars(prim, **label_primvars(entries[0].id, entries[0].kind, entries[0].region))
    else:
        author_ranges(prim, entries, **starts)


def author_ranges(prim: Any, feathers: Sequence[Any], **starts: Indices) -> None:
    """Author the ranges of feathers with an id, kind and region on a shared prim.

    starts: (M + 1,) of points, then of faces or curves, first element of each feather, and all.
    """
    *_, elements = starts.values()
    texts = {
        "featherId": [each.id for each in feathers],
        "featherKind": [each.kind for each in feathers],
        "region": [each.region for each in feathers],
    }
    for name, values in texts.items():
        author_shared(prim, name, values, UsdGeom.Tokens.uniform, np.diff(elements))
    for name, first in starts.items():
        table = prim.CreateAttribute(f"{RANGES_PREFIX}:{name}", Sdf.ValueTypeNames.Int2Array)
        table.SetVariability(Sdf.VariabilityUniform)
        table.Set(arrays.vec2i(np.stack([first[:-1], np.diff(first)], axis=1)))


def paint_primvars(entries: Sequence[FeatherEntry], part: str) -> dict[str, Any]:
    """Return the primvars that shaders take besides colours, as far as there are any.

    These are places in the images (materials.py) and SHADING. part: MESH_PRIM or BARB_PRIM.
    """
    values: dict[str, Any] = {}
    if entries[0].chart is not None:
        places = [
            _st(entry, part) * chart[2:] + chart[:2]
            for entry in entries
            if (chart := entry.chart) is not None
        ]
        values["atlas"] = arrays.vec2f(np.concatenate(places))
    colours = [each.colours for each in entries if each.colours is not None]
    own = [each.shading if part == MESH_PRIM else each.barb_shading for each in colours]
    for name in dict.fromkeys(name for each in own for name in each):
        primvar, units = SHADING_PRIMVARS[name]
        found = [each[name] for each in own if name in each]  # feathers without barbs have none
        values[primvar] = arrays.floats(units * np.concatenate(found))
    return values


def _st(entry: FeatherEntry, part: str) -> Any:
    if part == MESH_PRIM:
        return entry.feather.surface.st
    return np.zeros((0, 2)) if (own := entry.barbs) is None else own.drawn(own.st.reshape(-1, 2))


def _author_look(
    prim: Any, name: str, materials: Any, shades: Any = None, interpolation: str = ""
) -> None:
    """Author display colour and material "vane" or "rachis". shades: (K, 3) linear, or None."""
    plain = [MATERIAL_COLOURS[name]] if shades is None else shades
    author_primvars(prim, interpolation, displayColor=arrays.vec3f(plain))
    UsdShade.MaterialBindingAPI.Apply(prim).Bind(materials[name])


def join_shades(entries: Sequence[FeatherEntry], name: str, counts: Sequence[int]) -> Array | None:
    """Return (K, 3) linear colours of feathers that share a prim; None where they have none.

    name: of Colours' points, rachis or barbs. counts: of each feather's elements.
    """
    found = [getattr(entry.colours, name) for entry in entries if entry.colours is not None]
    if len(found) < len(entries):
        return None
    return np.concatenate(
        [np.broadcast_to(each, (count, 3)) for each, count in zip(found, counts, strict=True)]
    )


def define_mesh(
    stage: Any,
    path: Any,
    group: PosedGroup,
    entries: Sequence[FeatherEntry],
    rest: Any,
    materials: Any,
) -> None:
    """Author the constant part of a mesh. entries: of the group. rest: USD array of the points."""
    surfaces = [entry.feather.surface for entry in entries]
    starts = group.points[MESH_PRIM]
    triangles = [each.triangles + start for each, start in zip(surfaces, starts, strict=False)]
    part = np.concatenate([each.part for each in surfaces])
    mesh = UsdGeom.Mesh.Define(stage, path)
    mesh.CreateFaceVertexCountsAttr(arrays.ints(np.full(len(part), 3)))
    mesh.CreateFaceVertexIndicesAttr(arrays.ints(np.concatenate(triangles).ravel()))
    mesh.CreateSubdivisionSchemeAttr(UsdGeom.Tokens.none)
    mesh.CreateOrientationAttr(UsdGeom.Tokens.rightHanded)
    mesh.CreateDoubleSidedAttr(True)
    prim = mesh.GetPrim()
    _author_owners(prim, group, entries, points=starts, faces=group.faces)
    if group.alone and entries[0].root is not None:
        author_primvars(prim, **skin_primvars(entries))
    usual, counts = (_CONSTANT, 1) if group.alone else ("uniform", np.diff(group.faces))
    if any(looks := [entry.look for entry in entries]):
        author_shared(prim, LOOK_PRIMVAR, looks, usual, counts)
    if any(barbs := [entry.barb_count for entry in entries]):
        author_shared(prim, BARB_COUNT_PRIMVAR, barbs, usual, counts)
    st = arrays.vec2f(np.concatenate([each.st for each in surfaces]))
    author_primvars(prim, Pref=rest, rest=rest, st=st, side=arrays.ints(part))
    author_primvars(prim, **paint_primvars(entries, MESH_PRIM))
    if (
        any(entry.held is not None for entry in entries)
        and (MESH_PRIM, HOOKED_PRIMVAR) not in group.keys
    ):
        author_primvars(prim, hooked=arrays.floats(group.held))
    shades = join_shades(entries, "points", np.diff(starts).tolist())
    _author_look(prim, "vane", materials, shades, "" if shades is None else UsdGeom.Tokens.vertex)
    _define_subsets(mesh, part, materials)


def _define_subsets(mesh: Any, part: Indices, materials: Any) -> None:
    """Define vanes and rachis as a family that covers every face once, without empty subsets."""
    family = UsdShade.Tokens.materialBind
    for name, number in SUBSETS.items():
        faces = np.flatnonzero(part == number)
        if not len(faces):
            continue
        kind, indices = UsdGeom.Tokens.face, arrays.ints(faces)
        subset = UsdGeom.Subset.CreateGeomSubset(mesh, name, kind, indices, family)
        look = materials["rachis" if number == RACHIS_PART else "vane"]
        UsdShade.MaterialBindingAPI.Apply(subset.GetPrim()).Bind(look)
    UsdGeom.Subset.SetFamilyType(mesh, family, UsdGeom.Tokens.partition)


def define_rachises(
    stage: Any,
    path: Any,
    group: PosedGroup,
    entries: Sequence[FeatherEntry],
    rest: Any,
    ups: Any,
    materials: Any,
) -> None:
    """Author the constant part of rachises, a curve each. rest, as of define_mesh.

    ups: (M, 3) dorsal directions of the roots at rest, stage axes.
    """
    starts, each = group.points[RACHIS_PRIM], np.arange(len(entries) + 1)
    prim = _define_curves(stage, path, np.diff(starts), rest, group.widths)
    _author_owners(prim, group, entries, points=starts, curves=each)
    author_primvars(prim, group.interpolation, up=arrays.vec3f(ups))
    if not group.alone and all(entry.root is not None for entry in entries):
        author_primvars(prim, group.interpolation, **skin_primvars(entries))
    if entries[0].chart is not None:
        charts = arrays.vec4f(np.stack([e.chart for e in entries if e.chart is not None]))
        author_primvars(prim, group.interpolation, chart=charts)
    shades = join_shades(entries, "rachis", [1] * len(entries))
    _author_look(prim, "rachis", materials, shades, "" if shades is None else group.interpolation)


def define_barbs(
    stage: Any,
    path: Any,
    group: PosedGroup,
    entries: Sequence[FeatherEntry],
    rest: Any,
    materials: Any,
) -> None:
    """Author the constant part of barbs. rest: as of define_mesh."""
    barbs = [entry.barbs for entry in entries if entry.barbs is not None]
    counts = np.concatenate([each.counts for each in barbs])
    prim = _define_curves(stage, path, counts, rest, group.barb_widths)
    # through their points, from the first to the last
    curve = UsdGeom.BasisCurves(prim)
    curve.GetTypeAttr().Set(UsdGeom.Tokens.cubic)
    curve.CreateBasisAttr(UsdGeom.Tokens.catmullRom)
    curve.GetWrapAttr().Set(UsdGeom.Tokens.pinned)
    drawn = [0 if entry.barbs is None else len(entry.barbs.counts) for entry in entries]
    curves = np.concatenate([[0], np.cumsum(drawn)])
    _author_owners(prim, group, entries, points=group.points[BARB_PRIM], curves=curves)
    ids = [own.of_curves(barb_ids(entry.id, own)) for entry in entries if (own := entry.barbs)]
    author_primvars(
        prim,
        side=arrays.ints(np.concatenate([each.of_curves(each.side) for each in barbs])),
        st=arrays.vec2f(np.concatenate([each.drawn(each.st.reshape(-1, 2)) for each in barbs])),
        barbId=arrays.ints(np.concatenate(ids)),
        barbIndex=arrays.ints(np.concatenate([each.of_curves(each.index) for each in barbs])),
        rootUv=arrays.vec2f(np.concatenate([each.of_curves(each.st[:, 0]) for each in barbs])),
        **paint_primvars(entries, BARB_PRIM),
    )
    if any(each.barbules is not None for each in barbs):
        sorts = [np.append(np.zeros_like(each.side), each.barbules.sort) for each in barbs]
        author_primvars(prim, barbule=arrays.ints(np.concatenate(sorts)))
    for name in ("hooked", "ramus"):
        joined = [each.drawn(getattr(each, name).ravel()) for each in barbs]
        values = {name: arrays.floats(np.concatenate(joined))}
        author_primvars(prim, UsdGeom.Tokens.vertex, **values)
    points = np.diff(group.points[BARB_PRIM]).tolist()
    shades = join_shades(entries, "barbs", points)
    _author_look(prim, "barb", materials, shades, "" if shades is None else UsdGeom.Tokens.vertex)


def barb_ids(feather: str, barbs: BarbCurves) -> Indices:
    """Return (B,) numbers below 2^31 that stay with a barb of a feather's id, for random draws."""
    from featherfx.groom.regions.scatter import hashed  # only where barbs are drawn

    numbers = hashed(stable_number(feather), 0, 2 * barbs.index + barbs.side)
    return (numbers >> np.uint64(33)).astype(np.int64)


def _define_curves(stage: Any, path: Any, counts: Any, rest: Any, widths: Any) -> Any:
    curve = define_polylines(stage, path, counts)
    curve.CreateWidthsAttr(arrays.floats(widths))
    curve.SetWidthsInterpolation(UsdGeom.Tokens.vertex)
    prim = curve.GetPrim()
    author_primvars(prim, Pref=rest, rest=rest)
    return prim


def define_polylines(stage: Any, path: Any, counts: Any) -> Any:
    """Define linear curves of so many points each."""
    curve = UsdGeom.BasisCurves.Define(stage, path)
    curve.CreateTypeAttr(UsdGeom.Tokens.linear)
    curve.CreateWrapAttr(UsdGeom.Tokens.nonperiodic)
    curve.CreateCurveVertexCountsAttr(arrays.ints(counts))
    return curve


REPRESENTATION_SET, _DEFAULT_REPRESENTATION = "representation", "vane"

_DRAWN, _HIDDEN = UsdGeom.Tokens.default_, None
_VARIANTS = {
    "vane": {FEATHERS_SCOPE: _DRAWN, BARBS_SCOPE: _HIDDEN, RACHISES_SCOPE: UsdGeom.Tokens.guide},
    "barbs": {
        FEATHERS_SCOPE: UsdGeom.Tokens.proxy,
        BARBS_SCOPE: UsdGeom.Tokens.render,
        RACHISES_SCOPE: UsdGeom.Tokens.render,
    },
    "rachis": {FEATHERS_SCOPE: _HIDDEN, BARBS_SCOPE: _HIDDEN, RACHISES_SCOPE: _DRAWN},
}


def define_representations(stage: Any, info: StageInfo, with_barbs: bool) -> None:
    """Define the variant set; without the variant "barbs" where a cache has none."""
    variants = (
        stage.GetPrimAtPath(info.root_path).GetVariantSets().AddVariantSet(REPRESENTATION_SET)
    )
    for name, purposes in _VARIANTS.items():
        if name == "barbs" and not with_barbs:
            continue
        variants.AddVariant(name)
        variants.SetVariantSelection(name)
        with variants.GetVariantEditContext():
            for scope, purpose in purposes.items():
                prim = stage.GetPrimAtPath(info.root_path.AppendChild(scope))
                if prim:
                    image = UsdGeom.Imageable(prim)
                    if purpose is None:
                        image.CreateVisibilityAttr(UsdGeom.Tokens.invisible)
                    else:
                        image.CreatePurposeAttr(purpose)
    variants.SetVariantSelection(_DEFAULT_REPRESENTATION)


def define_prims(
    layer: Any, info: StageInfo, entries: Sequence[FeatherEntry], prims: AnimatedPrims, texture: str
) -> None:
    """Author the prims and their constant values in a layer.

    texture: as of MaterialInputs. Rest points, topology and texture coordinates stay in memory with
    the layer, so this comes when the samples are on disk.
    """
    stage, parts = Usd.Stage.Open(layer), {part for own in prims.prims for part in own}
    define_root(stage, info)
    for name in (*(SCOPES[part][0] for part in SCOPES if part in parts), MATERIALS_SCOPE):
        UsdGeom.Scope.Define(stage, info.root_path.AppendChild(name))
    if MESH_PRIM in parts:  # else all that there is is drawn
        define_representations(stage, info, BARB_PRIM in parts)
    look = choose_inputs(entries, texture)
    scope = info.root_path.AppendChild(MATERIALS_SCOPE)
    materials = define_materials(stage, scope, look, BARB_PRIM in parts)
    with Sdf.ChangeBlock():
        # prims stand in the order of the feathers, whichever of them is defined first
        for path in (path for own in prims.prims for path in own.values()):
            Sdf.CreatePrimInLayer(layer, path)
    for group, at in zip(prims.groups, prims.prims, strict=True):
        own, rest = [entries[k] for k in group.members], _rest_points(group)
        if MESH_PRIM in at:
            define_mesh(stage, at[MESH_PRIM], group, own, rest[MESH_PRIM], materials)
        ups = info.space.directions(np.stack([e.rest_points.directors[0, 1] for e in own]))
        define_rachises(stage, at[RACHIS_PRIM], group, own, rest[RACHIS_PRIM], ups, materials)
        if group.is_condensed:
            usd.forms.define_condensed(stage, info, at[RACHIS_PRIM], group, own, rest)
        if BARB_PRIM in at:
            define_barbs(stage, at[BARB_PRIM], group, own, rest[BARB_PRIM], materials)


def _rest_points(group: PosedGroup) -> dict[str, Any]:
    pose = group.rest()
    found = {part: pose.values[part, "points"].value for part in group.parts}
    barbs = BARB_NODE_PRIMVARS if group.is_condensed else ()
    return found | {name: pose.values[RACHIS_PRIM, name].value for name in barbs}
