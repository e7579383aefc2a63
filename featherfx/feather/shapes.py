"""Rest geometry of many placed feathers: every shape built once, and kept for later runs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import fields
from functools import lru_cache, partial
from operator import attrgetter
from typing import Any
from weakref import WeakValueDictionary

import numpy as np

from featherfx.errors import all_of
from featherfx.feather.build import build_feather, make_read_only, repeated_shapes, scaled
from featherfx.feather.types import Feather, FeatherSurface, RowPoints
from featherfx.files.disk_cache import Arrays, kept
from featherfx.groom.types import FeatherKind, Placement

_SURFACE = tuple(each.name for each in fields(FeatherSurface))
_STRUCTURES = "rest", "surface"
_OWN = tuple(each.name for each in fields(Feather) if each.name not in _STRUCTURES)
# where the arrays of a feather are
_PATHS = (
    *_OWN,
    *(f"rest.{name}" for name in RowPoints._fields),
    *(f"surface.{name}" for name in _SURFACE),
)
# grids of a shot's feathers that are remembered: meshes, simulated, coarse
_GRIDS = 4


def feathers_of(placements: Sequence[Placement], rows: int, columns: int) -> list[Feather]:
    """Rest geometry of placed feathers, each in its own frame.

    Feathers of one shape and size share theirs. rows, columns: as in build_feather. Raises
    InputError with the problems of all shapes that cannot be built.
    """
    first, chosen = repeated_shapes(placements)
    shapes = tuple((p.prototype or p.kind, p.mirrored) for p in (placements[k] for k in first))
    built, sized = built_shapes(shapes, rows, columns), _sized(shapes, rows, columns)
    found = []
    for shape, placement in zip(chosen, placements, strict=True):
        size = 1.0 if placement.prototype is None else placement.size
        feather = sized.get((shape, size))
        if feather is None:
            feather = sized[shape, size] = scaled(built[shape], size)
        found.append(feather)
    return found


@lru_cache(maxsize=_GRIDS)
def _sized(
    shapes: tuple[tuple[FeatherKind, bool], ...], rows: int, columns: int
) -> WeakValueDictionary[tuple[int, float], Feather]:
    """The feathers of these shapes that are in use, by number of the shape and size: simulation and
    writer share them."""
    return WeakValueDictionary()


@lru_cache(maxsize=_GRIDS)
def built_shapes(
    shapes: tuple[tuple[FeatherKind, bool], ...], rows: int, columns: int
) -> tuple[Feather, ...]:
    """The feather of each kind, as build_feather gives it. shapes: kind, and whether mirrored."""

    def compute() -> Arrays:
        tasks = (partial(build_feather, kind, rows, columns, side) for kind, side in shapes)
        return _packed(all_of(*tasks))

    return tuple(_unpacked(kept("shapes", [shapes, rows, columns], compute), len(shapes)))


def _packed(feathers: Sequence[Feather]) -> Arrays:
    """All arrays of one name end to end, and their sizes."""
    found: Arrays = {}
    for path in _PATHS:
        parts = [attrgetter(path)(each) for each in feathers]
        found[path] = np.concatenate([np.ravel(part) for part in parts])
        found[f"{path}.shape"] = np.array([part.shape for part in parts])
    return found


def _unpacked(arrays: Mapping[str, Any], count: int) -> list[Feather]:
    """Invert _packed."""
    parts = {
        name: _split(value, arrays[f"{name}.shape"])
        for name, value in arrays.items()
        if not name.endswith(".shape")
    }
    found = []
    for k in range(count):
        surface = FeatherSurface(**{name: parts[f"surface.{name}"][k] for name in _SURFACE})
        rest = RowPoints(*(parts[f"rest.{name}"][k] for name in RowPoints._fields))
        own = {name: parts[name][k] for name in _OWN}
        feather = Feather(**own, rest=rest, surface=surface)
        make_read_only(feather)
        found.append(feather)
    return found


def _split(values: Any, shapes: Any) -> list[Any]:
    ends = np.cumsum(shapes.prod(axis=1, dtype=np.int64))
    cut = np.split(values, ends[:-1])
    return [part.reshape(shape) for part, shape in zip(cut, shapes, strict=True)]
