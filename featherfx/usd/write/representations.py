"""What of a cache is drawn, as a variant set of the root prim.

    variant   feathers (meshes)   barbs (curves)   rachises (curves)
    vane      drawn               hidden           guide
    barbs     proxy               render           render
    rachis    hidden              hidden           drawn

Prims and their samples are the same in every variant; only purpose and visibility of the scopes
above them change. Both are inherited, so that nothing is said of single feathers.
"""

from __future__ import annotations

from typing import Any

from pxr import UsdGeom

from featherfx.usd.write.stage import BARBS, FEATHERS, RACHISES, StageInfo

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
