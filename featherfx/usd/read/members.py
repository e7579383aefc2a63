"""Feathers of a prim that several share: which points, faces or curves are whose.

Such a prim has featherId, featherKind and region for each face or curve, and tables with the first
and the number of each feather's points, faces or curves, in the order of featherId's values.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from pxr import UsdGeom

from featherfx.algebra.types import Indices
from featherfx.usd.read.values import (
    DEFAULT,
    INTEGERS,
    Kind,
    array_of,
    fault,
    sized_array,
    texts_of,
)
from featherfx.usd.types import LOOK, RANGES

_PAIRS = Kind("iu", (2,), "an array of pairs of integers")


@dataclass(frozen=True)
class Member:
    """One feather of a prim. name: to tell it by, the prim's where it is the only one. points,
    faces: (first, number) of its own, None for all; faces of a mesh, else curves. look: of its
    barbs, as text."""

    id: str
    kind: str
    region: str
    points: tuple[int, int] | None = None
    faces: tuple[int, int] | None = None
    look: str = ""


def members_of(prim: Any) -> list[Member]:
    """The feathers of a prim that several share; none for any other prim.

    Raises InputError where the tables do not fit each other.
    """
    element = "faces" if prim.IsA(UsdGeom.Mesh) else "curves"
    points, faces = _ranges(prim, "points"), _ranges(prim, element)
    if points is None or faces is None:
        return []
    ids = texts_of(_primvar(prim, "featherId").GetAttr())
    if not len(ids) == len(points) == len(faces):
        told = f"names {len(ids)} feathers, and {RANGES} {len(points)} and {len(faces)}"
        raise fault(_primvar(prim, "featherId").GetAttr(), told)
    kinds, regions, looks = (_texts(prim, name, faces) for name in ("featherKind", "region", LOOK))
    ranges = (map(tuple, table.tolist()) for table in (points, faces))
    return [Member(*each) for each in zip(ids, kinds, regions, *ranges, looks, strict=True)]


def _ranges(prim: Any, name: str) -> Indices | None:
    """(M, 2) first and number; None where there is no such table."""
    attribute = prim.GetAttribute(f"{RANGES}:{name}")
    found = array_of(attribute, DEFAULT, _PAIRS)
    if found is None:
        return None
    found = found.astype(np.int64)
    if (found < 0).any() or (found[1:, 0] != found[:-1].sum(axis=1)).any() or found[:1, 0].any():
        raise fault(attribute, "is no table of first and number, each range after the one before")
    return found


def _texts(prim: Any, name: str, faces: Indices) -> Sequence[str]:
    """A label of each feather: that of its first face or curve, empty where it has none."""
    primvar = _primvar(prim, name)
    texts = texts_of(primvar.GetAttr())
    indices = np.arange(len(texts))
    if primvar and primvar.IsIndexed():
        indices = sized_array(primvar.GetIndicesAttr(), DEFAULT, INTEGERS).astype(np.int64)
    if not ((indices >= 0) & (indices < len(texts))).all():
        raise fault(primvar.GetAttr(), "its indices do not fit its values")
    inside = (faces[:, 1] > 0) & (faces[:, 0] < len(indices))
    return [texts[indices[k]] if own else "" for k, own in zip(faces[:, 0], inside, strict=True)]


def _primvar(prim: Any, name: str) -> Any:
    return UsdGeom.PrimvarsAPI(prim).GetPrimvar(name)
