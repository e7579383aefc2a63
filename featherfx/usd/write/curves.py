"""Curves of a feather: the shaft's centre line, and barbs to render.

The centre line is for grooming tools and constraints, and the whole feather where only rachises
are drawn. Purposes are those of the scopes above (featherfx/usd/write/representations.py).
"""

from __future__ import annotations

from typing import Any

import numpy as np
from pxr import UsdGeom

from featherfx.usd import arrays
from featherfx.usd.types import FeatherEntry
from featherfx.usd.write import material, primvars


def define_rachis(
    stage: Any, path: Any, entry: FeatherEntry, rest: Any, widths: Any, up: Any, materials: Any
) -> None:
    """Author the curve's constant part.

    rest: USD array of n points. widths: (n,) diameters. up: (3,) dorsal direction of the root.
    """
    prim = _define(stage, path, [len(rest)], rest, widths)
    primvars.author_labels(prim, entry)
    primvars.author_up(prim, up)
    _author_look(prim, "rachis", materials)


def define_barbs(
    stage: Any, path: Any, entry: FeatherEntry, rest: Any, widths: Any, materials: Any
) -> None:
    """Author the constant part of a feather's barbs. rest: USD array, (B K,), widths: as many."""
    assert entry.barbs is not None
    count, points = entry.barbs.widths.shape
    prim = _define(stage, path, np.full(count, points), rest, widths)
    primvars.author_labels(prim, entry)
    primvars.author_side(prim, arrays.ints(entry.barbs.side))
    primvars.author_st(prim, arrays.vec2f(entry.barbs.st.reshape(-1, 2)))
    _author_look(prim, "vane", materials)


def _define(stage: Any, path: Any, counts: Any, rest: Any, widths: Any) -> Any:
    curve = UsdGeom.BasisCurves.Define(stage, path)
    curve.CreateTypeAttr(UsdGeom.Tokens.linear)
    curve.CreateWrapAttr(UsdGeom.Tokens.nonperiodic)
    curve.CreateCurveVertexCountsAttr(arrays.ints(counts))
    curve.CreateWidthsAttr(arrays.floats(widths))
    curve.SetWidthsInterpolation(UsdGeom.Tokens.vertex)
    primvars.author_rest(curve.GetPrim(), rest)
    return curve.GetPrim()


def _author_look(prim: Any, name: str, materials: Any) -> None:
    primvars.author_colour(prim, material.COLOURS[name])
    material.bind(prim, materials[name])
