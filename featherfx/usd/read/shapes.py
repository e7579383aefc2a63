"""What condensed feathers are built of, from the texts that a file has of them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from pxr import UsdGeom

from featherfx.errors import InputError
from featherfx.feather.density import density_map
from featherfx.feather.shapes import built_shapes
from featherfx.feather.types import Feather, RowMap
from featherfx.groom.types import FeatherKind
from featherfx.usd.read.values import DEFAULT, INTEGERS, fault, sized_array, texts_of


@dataclass(frozen=True)
class Grown:
    """What feathers of one shape and grid have in common, unit size and metres.

    own: on the written grid. fine: as it is drawn. to_fine: the map to that, None where it is own.
    """

    own: Feather
    fine: Feather
    to_fine: RowMap | None


@lru_cache(maxsize=4096)
def grown_on(
    shape: tuple[FeatherKind, bool], own: tuple[int, int], wanted: tuple[int, int]
) -> Grown:
    """Feathers of a kind and side. own, wanted: rows and columns."""
    (fine,) = built_shapes((shape,), *wanted)
    if own == wanted:
        return Grown(fine, fine, None)
    (written,) = built_shapes((shape,), *own)
    return Grown(written, fine, density_map(written, fine))


def each_of_texts(prim: Any, name: str, read: Callable[[str], Any], count: int) -> list[Any]:
    """What each of so many feathers of a prim has by a primvar of texts. Raises InputError where
    there are not as many, or `read` refuses one."""
    primvar = UsdGeom.PrimvarsAPI(prim).GetPrimvar(name)
    attribute = prim.GetAttribute(f"primvars:{name}")
    texts = texts_of(primvar.GetAttr()) if primvar else []
    places = np.arange(len(texts))
    if primvar and primvar.IsIndexed():
        places = sized_array(primvar.GetIndicesAttr(), DEFAULT, INTEGERS).astype(np.int64)
    if len(places) != count or not ((places >= 0) & (places < len(texts))).all():
        raise fault(attribute, f"has not one value for each of {count} feathers")
    try:
        known = [read(text) for text in texts]
    except (ValueError, InputError) as error:
        raise fault(attribute, str(error)) from error
    return [known[k] for k in places]
