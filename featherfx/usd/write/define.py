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
from featherfx.usd.types import BARB_NODE_PRIMVARS, BARB_PRIM, MESH_PRIM, RACHIS_PRIM, FeatherEntry
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
from featherfx.usd.write.prims import define_barbs, define_mesh, define_rachises

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
