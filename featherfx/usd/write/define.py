"""The prims of a cache, with all of them that never changes.

What is drawn is a variant set of the root prim:

    variant   feathers (meshes)   barbs (curves)   rachises (curves)
    vane      drawn               hidden           guide
    barbs     proxy               render           render
    rachis    hidden              hidden           drawn

Prims and their samples are the same in every variant; only purpose and visibility of the scopes
above them change. Both are inherited, so that nothing is said of single feathers.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from pxr import Sdf, Usd, UsdGeom

from featherfx.usd import arrays
from featherfx.usd.types import FeatherEntry
from featherfx.usd.write.output import unique_prim_names
from featherfx.usd.write.poses import BARB, MESH, RACHIS, PosedFeather
from featherfx.usd.write.prims import (
    MeshValues,
    define_barbs,
    define_materials,
    define_mesh,
    define_rachis,
    labels,
    replace_primvars,
    seat,
)
from featherfx.usd.write.samples import AnimatedPrims
from featherfx.usd.write.stage import BARBS, FEATHERS, MATERIALS, RACHISES, StageInfo, define_root


def define_scopes(stage: Any, info: StageInfo, with_barbs: bool) -> None:
    """The groups under the root."""
    for name in (FEATHERS, RACHISES, *([BARBS] if with_barbs else []), MATERIALS):
        UsdGeom.Scope.Define(stage, info.root_path.AppendChild(name))


SET, DEFAULT = "representation", "vane"

_DRAWN, _HIDDEN = UsdGeom.Tokens.default_, None
_VARIANTS = {
    "vane": {FEATHERS: _DRAWN, BARBS: _HIDDEN, RACHISES: UsdGeom.Tokens.guide},
    "barbs": {
        FEATHERS: UsdGeom.Tokens.proxy,
        BARBS: UsdGeom.Tokens.render,
        RACHISES: UsdGeom.Tokens.render,
    },
    "rachis": {FEATHERS: _HIDDEN, BARBS: _HIDDEN, RACHISES: _DRAWN},
}


def define_representations(stage: Any, info: StageInfo, with_barbs: bool) -> None:
    """The variant set, with DEFAULT selected; no variant "barbs" where a cache has none."""
    variants = stage.GetPrimAtPath(info.root_path).GetVariantSets().AddVariantSet(SET)
    for name, purposes in _VARIANTS.items():
        if name == "barbs" and not with_barbs:
            continue
        variants.AddVariant(name)
        variants.SetVariantSelection(name)
        with variants.GetVariantEditContext():
            for scope, purpose in purposes.items():
                prim = stage.GetPrimAtPath(info.root_path.AppendChild(scope))
                if prim:
                    _author(UsdGeom.Imageable(prim), purpose)
    variants.SetVariantSelection(DEFAULT)


def _author(scope: Any, purpose: str | None) -> None:
    if purpose is None:
        scope.CreateVisibilityAttr(UsdGeom.Tokens.invisible)
    else:
        scope.CreatePurposeAttr(purpose)


def animated_prims(
    info: StageInfo, entries: Sequence[FeatherEntry], posed: Sequence[PosedFeather]
) -> AnimatedPrims:
    """Where the mesh and the curves of every feather stand."""
    names = unique_prim_names([entry.name or entry.id for entry in entries])

    def paths(scope: str, suffix: str = "") -> list[Any]:
        own = unique_prim_names([name + suffix for name in names])
        return [info.root_path.AppendPath(f"{scope}/{name}") for name in own]

    barbs = zip(paths(BARBS, "_barbs"), posed, strict=True)
    drawn = [path if feather.has_barbs else None for path, feather in barbs]
    return AnimatedPrims(posed, paths(FEATHERS), paths(RACHISES, "_rachis"), drawn)


def define_prims(
    layer: Any, info: StageInfo, entries: Sequence[FeatherEntry], prims: AnimatedPrims
) -> None:
    """Author the prims in a layer, and everything of them that never changes.

    Rest points, topology and texture coordinates stay in memory with the layer, so this comes
    when the samples have gone to disk.
    """
    stage, has_barbs = Usd.Stage.Open(layer), any(each.has_barbs for each in prims.feathers)
    define_root(stage, info)
    define_scopes(stage, info, has_barbs)
    define_representations(stage, info, has_barbs)
    materials = define_materials(stage, info.root_path.AppendChild(MATERIALS))
    paths = [
        {part: own[part, "points"].GetPrimPath() for part in posed.parts}
        for own, posed in zip(prims.paths, prims.feathers, strict=True)
    ]
    with Sdf.ChangeBlock():
        # prims stand in the order of the feathers, whichever of them is defined first
        for path in (path for own in paths for path in own.values()):
            Sdf.CreatePrimInLayer(layer, path)
    first: dict[Any, int] = {}  # feather of each sort that the others are copies of
    for index, (entry, posed, at) in enumerate(zip(entries, prims.feathers, paths, strict=True)):
        is_first = first.setdefault(_sort(entry), index) == index
        rest = _rest(posed) if is_first or posed.has_barbs else {}
        if is_first:
            values = MeshValues(entry.feather.surface)
            define_mesh(stage, at[MESH], entry, values, rest[MESH], materials)
            up = _up(info, entry)
            define_rachis(stage, at[RACHIS], entry, rest[RACHIS], posed.widths, up, materials)
        if posed.has_barbs:
            define_barbs(stage, at[BARB], entry, rest[BARB], posed.barb_widths, materials)
    del stage  # layers alone take copies much faster
    with Sdf.ChangeBlock():
        for index, (entry, posed) in enumerate(zip(entries, prims.feathers, strict=True)):
            if (like := first[_sort(entry)]) != index:
                _copy(layer, info, paths[like], paths[index], entry, posed)


def _sort(entry: FeatherEntry) -> Any:
    """Equal for feathers whose meshes and shafts differ in nothing but what _copy replaces."""
    surface = entry.feather.surface
    shared = surface.triangles, surface.part, surface.st
    return *map(id, shared), entry.feather.rows, entry.root is None


def _copy(
    layer: Any, info: StageInfo, source: Any, target: Any, entry: FeatherEntry, posed: PosedFeather
) -> None:
    """Mesh and shaft of a feather as those of another of its surface, but for what is its own."""
    rest, own = _rest(posed), labels(entry.id, entry.kind, entry.region)
    for part in (MESH, RACHIS):
        Sdf.CopySpec(layer, source[part], layer, target[part])
        replace_primvars(layer, target[part], **own, Pref=rest[part], rest=rest[part])
    if entry.root is not None:
        replace_primvars(layer, target[MESH], **seat(entry.root))
    replace_primvars(layer, target[RACHIS], up=arrays.vec3f([_up(info, entry)]))
    widths = target[RACHIS].AppendProperty(UsdGeom.Tokens.widths)
    layer.GetAttributeAtPath(widths).default = arrays.floats(posed.widths)


def _rest(posed: PosedFeather) -> dict[str, Any]:
    pose = posed.rest()
    return {part: pose.values[part, "points"].value for part in posed.parts}


def _up(info: StageInfo, entry: FeatherEntry) -> Any:
    return info.space.directions(entry.rest_points.directors[0, 1])
