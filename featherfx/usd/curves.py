"""The shaft's centre line as a curve, for grooming tools and constraints.

Its purpose is "guide", so that renderers do not draw it inside the shaft's own surface.
"""

from __future__ import annotations

from typing import Any

from pxr import UsdGeom

from featherfx.usd import arrays, material, primvars
from featherfx.usd.types import FeatherEntry


def define_rachis(
    stage: Any, path: Any, entry: FeatherEntry, rest: Any, widths: Any, materials: Any
) -> None:
    """Author the curve's constant part. rest: (n, 3) and widths: (n,) stage units, diameters."""
    curve = UsdGeom.BasisCurves.Define(stage, path)
    curve.CreateTypeAttr(UsdGeom.Tokens.linear)
    curve.CreateWrapAttr(UsdGeom.Tokens.nonperiodic)
    curve.CreateCurveVertexCountsAttr(arrays.ints([len(rest)]))
    curve.CreateWidthsAttr(arrays.floats(widths))
    curve.SetWidthsInterpolation(UsdGeom.Tokens.vertex)
    curve.CreatePurposeAttr(UsdGeom.Tokens.guide)
    prim = curve.GetPrim()
    primvars.author_labels(prim, entry)
    primvars.author_rest(prim, rest)
    primvars.author_colour(prim, material.COLOURS["rachis"])
    material.bind(prim, materials["rachis"])
