"""Feathers of a prim that several share: which points, faces or curves are whose.

Such a prim has featherId, featherKind and region for each face or curve, and tables with the first
and the number of each feather's points, faces or curves, in the order of featherId's values.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, TypeVar

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
from featherfx.usd.types import BARB_COUNT, LOOK, RANGES

Shared = TypeVar("Shared", str, int)
_PAIRS = Kind("iu", (2,), "an array of pairs of integers")


@dataclass(frozen=True)
class Member:
    """One feather of a prim. name: to tell it by, the prim's where it is the only one. points,
    faces: (first, number) of its own, None for all; faces of a mesh, else curves. look: of its
    barbs, as text. barb_count: of these, 0: not known."""

    id: str
    kind: str
    region: str
    points: tuple[int, int] | None = None
    faces: tuple[int, int] | None = None
    look: str = ""
    barb_count: int = 0


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
    counts = _shared(_primvar(prim, BARB_COUNT), _numbers(prim), faces, 0)
    ranges = (map(tuple, table.tolist()) for table in (points, faces))
    return [Member(*each) for each in zip(ids, kinds, regions, *ranges, looks, counts, strict=True)]


def barb_count_of(prim: Any) -> int:
    """Real barbs along each vane of a prim's only feather; 0 where it does not tell."""
    return next(iter(_numbers(prim)), 0)


def _numbers(prim: Any) -> list[int]:
    found = array_of(_primvar(prim, BARB_COUNT).GetAttr(), DEFAULT, INTEGERS)
    return [] if found is None else np.maximum(found, 0).astype(int).tolist()


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
    return _shared(primvar, texts_of(primvar.GetAttr()), faces, "")


def _shared(primvar: Any, values: Sequence[Shared], faces: Indices, none: Shared) -> list[Shared]:
    """What a primvar that may be indexed has for each feather's first face or curve."""
    indices = np.arange(len(values))
    if primvar and primvar.IsIndexed():
        indices = sized_array(primvar.GetIndicesAttr(), DEFAULT, INTEGERS).astype(np.int64)
    if not ((indices >= 0) & (indices < len(values))).all():
        raise fault(primvar.GetAttr(), "its indices do not fit its values")
    inside = (faces[:, 1] > 0) & (faces[:, 0] < len(indices))
    return [values[indices[k]] if own else none for k, own in zip(faces[:, 0], inside, strict=True)]


def _primvar(prim: Any, name: str) -> Any:
    return UsdGeom.PrimvarsAPI(prim).GetPrimvar(name)
