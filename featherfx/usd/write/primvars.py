"""Primvars: always arrays, since some readers drop scalars."""

from __future__ import annotations

from typing import Any

from pxr import Sdf, UsdGeom

from featherfx.shot.motion.skin import SkinRoot
from featherfx.usd import arrays
from featherfx.usd.types import FeatherEntry

BARB_DIRECTION = "primvars:barbDirection"
SIDE_NAMES = ("leading", "trailing", "rachis")


def author_labels(prim: Any, entry: FeatherEntry) -> None:
    """featherId, featherKind and region, one string each for the whole prim."""
    values = {"featherId": entry.id, "featherKind": entry.kind, "region": entry.region}
    for name, value in values.items():
        _author(prim, name, Sdf.ValueTypeNames.StringArray, "constant", arrays.strings(value))


def author_root(prim: Any, root: SkinRoot | None) -> None:
    """skinPrim, skinFace, skinPoints and skinBarycentric: where the feather sits on its skin.

    The skin point is the sum of the three skin points by their barycentric coordinates: one
    element of three numbers each.
    """
    if root is None:
        return
    types = Sdf.ValueTypeNames
    _author(prim, "skinPrim", types.StringArray, "constant", arrays.strings(root.path))
    _author(prim, "skinFace", types.IntArray, "constant", arrays.ints([root.face]))
    _author(prim, "skinPoints", types.IntArray, "constant", arrays.ints(root.points), 3)
    weights = arrays.floats(root.barycentric)
    _author(prim, "skinBarycentric", types.FloatArray, "constant", weights, 3)


def author_rest(prim: Any, points: Any) -> None:
    """Pref (RenderMan, Arnold) and rest (Houdini): the rest points, a USD array, per point."""
    for name in ("Pref", "rest"):
        _author(prim, name, Sdf.ValueTypeNames.Point3fArray, "vertex", points)


def author_up(prim: Any, up: Any) -> None:
    """up: the dorsal side at the root, at rest, as grooms have it. up: (3,), object space."""
    value = arrays.vec3f([up])
    _author(prim, "up", Sdf.ValueTypeNames.Vector3fArray, "constant", value)


def author_st(prim: Any, st: Any) -> None:
    """st, a USD array, per point."""
    _author(prim, "st", Sdf.ValueTypeNames.TexCoord2fArray, "vertex", st)


def author_side(prim: Any, side: Any) -> None:
    """0 leading, 1 trailing, 2 rachis, a USD array, per face or curve."""
    _author(prim, "side", Sdf.ValueTypeNames.IntArray, "uniform", side)


def author_colour(prim: Any, colour: tuple[float, float, float]) -> None:
    """Display colour for viewers that ignore materials."""
    value = arrays.vec3f([colour])
    _author(prim, "displayColor", Sdf.ValueTypeNames.Color3fArray, "constant", value)


def _author(
    prim: Any, name: str, kind: Any, interpolation: str, value: Any, element: int = 1
) -> None:
    primvar = UsdGeom.PrimvarsAPI(prim).CreatePrimvar(name, kind, interpolation)
    primvar.Set(value)
    if element > 1:
        primvar.SetElementSize(element)
