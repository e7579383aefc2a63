"""Definition of the prims of a cache with their constant values.

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
from typing import Any

import numpy as np
from pxr import Sdf, Usd, UsdGeom

from featherfx import usd
from featherfx.usd import arrays
from featherfx.usd.types import (
    BARB_NODE_PRIMVARS,
    BARB_PRIM,
    MESH_PRIM,
    RACHIS_PRIM,
    FeatherEntry,
)
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
from featherfx.usd.write.prims import (
    chart_primvar,
    define_barbs,
    define_mesh,
    define_rachises,
    label_primvars,
    paint_primvars,
    replace_primvars,
    skin_primvars,
)

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
    layer: Any,
    info: StageInfo,
    entries: Sequence[FeatherEntry],
    prims: AnimatedPrims,
    texture: str,
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
    first: dict[Any, int] = {}  # group of each sort that the others are copies of
    members = [[entries[k] for k in group.members] for group in prims.groups]
    sorts = [_copy_key(*each) for each in zip(prims.groups, members, strict=True)]
    for index, (group, own, at) in enumerate(zip(prims.groups, members, prims.prims, strict=True)):
        is_first = first.setdefault(sorts[index], index) == index
        rest = _rest_points(group) if is_first or BARB_PRIM in at else {}
        if is_first:
            if MESH_PRIM in at:
                define_mesh(stage, at[MESH_PRIM], group, own, rest[MESH_PRIM], materials)
            ups = _dorsal_axes(info, own)
            define_rachises(stage, at[RACHIS_PRIM], group, own, rest[RACHIS_PRIM], ups, materials)
            if group.is_condensed:
                usd.forms.define_condensed(stage, info, at[RACHIS_PRIM], group, own, rest)
        if BARB_PRIM in at:
            define_barbs(stage, at[BARB_PRIM], group, own, rest[BARB_PRIM], materials)
    del stage  # layers alone take copies much faster
    with Sdf.ChangeBlock():
        for index, group in enumerate(prims.groups):
            if (like := first[sorts[index]]) != index:
                _copy_feather(
                    layer, info, prims.prims[like], prims.prims[index], members[index][0], group
                )


def _copy_key(group: PosedGroup, entries: Sequence[FeatherEntry]) -> Any:
    """Return a key that is equal for feathers that differ only in what _copy_feather replaces."""
    surface = entries[0].feather.surface
    if not group.alone:
        return group.name
    shared = surface.triangles, surface.part, surface.st
    is_held = entries[0].held is None or entries[0].hooked
    looks = entries[0].colours is None, entries[0].look, entries[0].barb_count
    alike = entries[0].root is None, is_held, *looks
    return *map(id, shared), entries[0].feather.rows, *alike


def _copy_feather(
    layer: Any, info: StageInfo, source: Any, target: Any, entry: FeatherEntry, group: PosedGroup
) -> None:
    """Copy mesh and rachis from a feather of the same surface, and replace own values."""
    rest, own = _rest_points(group), label_primvars(entry.id, entry.kind, entry.region)
    for part in (part for part in (MESH_PRIM, RACHIS_PRIM) if part in target):
        Sdf.CopySpec(layer, source[part], layer, target[part])
        replace_primvars(layer, target[part], **own, Pref=rest[part], rest=rest[part])
    if entry.root is not None and MESH_PRIM in target:
        replace_primvars(layer, target[MESH_PRIM], **skin_primvars([entry]))
    if entry.held is not None and not entry.hooked and MESH_PRIM in target:
        replace_primvars(layer, target[MESH_PRIM], hooked=arrays.floats(entry.held))
    for part, name in ((MESH_PRIM, "points"), (RACHIS_PRIM, "rachis")):
        if entry.colours is not None and part in target:
            shades = np.atleast_2d(getattr(entry.colours, name))
            replace_primvars(layer, target[part], displayColor=arrays.vec3f(shades))
    if MESH_PRIM in target:
        replace_primvars(layer, target[MESH_PRIM], **paint_primvars([entry], MESH_PRIM))
    if entry.chart is not None:
        replace_primvars(layer, target[RACHIS_PRIM], chart=chart_primvar([entry]))
    replace_primvars(layer, target[RACHIS_PRIM], up=arrays.vec3f(_dorsal_axes(info, [entry])))
    if group.is_condensed:
        usd.forms.replace_condensed(layer, info, target[RACHIS_PRIM], group, entry, rest)
    widths = target[RACHIS_PRIM].AppendProperty(UsdGeom.Tokens.widths)
    layer.GetAttributeAtPath(widths).default = arrays.floats(group.widths)


def _rest_points(group: PosedGroup) -> dict[str, Any]:
    pose = group.rest()
    found = {part: pose.values[part, "points"].value for part in group.parts}
    barbs = BARB_NODE_PRIMVARS if group.is_condensed else ()
    return found | {name: pose.values[RACHIS_PRIM, name].value for name in barbs}


def _dorsal_axes(info: StageInfo, entries: Sequence[FeatherEntry]) -> Any:
    return info.space.directions(np.stack([e.rest_points.directors[0, 1] for e in entries]))
