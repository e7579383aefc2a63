"""Shapes of feathers: built once for all sizes and sides, cached, and written as text.

Points of a feather carried to another grid, its barbs as long as at rest.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, fields, is_dataclass, replace
from functools import lru_cache, partial
from operator import attrgetter
from types import UnionType
from typing import Any, NamedTuple, get_args, get_origin, get_type_hints
from weakref import WeakValueDictionary, ref

import numpy as np

from featherfx.algebra.interpolation import Rows
from featherfx.algebra.types import Array, Indices
from featherfx.algebra.views import COUNT as LANES
from featherfx.algebra.views import views_of
from featherfx.errors import all_of
from featherfx.feather.types import (
    Feather,
    FeatherSurface,
    MovingPoints,
    PointMap,
    RowMap,
    RowPoints,
    both,
    make_read_only,
    scale_feather,
    share,
)
from featherfx.files.disk_cache import Arrays, kept
from featherfx.groom.types import Colour, FeatherKind, Placement
from featherfx.jit.compiled import KernelModule


def distinct_shapes(placements: Sequence[Placement]) -> tuple[list[int], list[int]]:
    """The first placement of every shape, and for each placement the number of its shape."""
    numbers: dict[tuple[int, bool], int] = {}
    first: list[int] = []
    chosen = []
    for k, placement in enumerate(placements):
        key = (id(placement.prototype or placement.kind), placement.mirrored)
        if key not in numbers:
            numbers[key] = len(first)
            first.append(k)
        chosen.append(numbers[key])
    return first, chosen


_SURFACE = tuple(each.name for each in fields(FeatherSurface))


_STRUCTURES = "rest", "surface"


_OWN = tuple(each.name for each in fields(Feather) if each.name not in _STRUCTURES)


# arrays that many shapes have in common
_TOPOLOGY = "cell", *(f"surface.{name}" for name in ("row", "node", "triangles", "part", "lips"))
# where the arrays of a feather are
_PATHS = (
    *_OWN,
    *(f"rest.{name}" for name in RowPoints._fields),
    *(f"surface.{name}" for name in _SURFACE),
)


# grids of a shot's feathers that are remembered: meshes, simulated, coarse
_GRIDS = 4


class _BuiltShape(NamedTuple):
    """A kind, held weakly, its feather on a grid, and those of its other sizes that are in use:
    simulation and writer share them."""

    kind: ref[FeatherKind]
    feather: Feather
    sized: WeakValueDictionary[float, Feather]


def build_plane_feathers(placements: Sequence[Placement], rows: int, columns: int) -> list[Feather]:
    """Rest geometry of placed feathers as their kinds have it, each in its own frame.

    Feathers of one shape and size share theirs. rows, columns: as in build_feather. Raises
    InputError with the problems of all shapes that cannot be built.
    """
    first, chosen = distinct_shapes(placements)
    shapes = [(p.prototype or p.kind, p.mirrored) for p in (placements[k] for k in first)]
    built = _built(shapes, rows, columns)
    found = []
    for shape, placement in zip(chosen, placements, strict=True):
        _, unit, sized = built[shape]
        size = 1.0 if placement.prototype is None else placement.size
        feather = sized.get(size)
        if feather is None:
            feather = sized[size] = scale_feather(unit, size)
        found.append(feather)
    return found


def build_shapes(
    shapes: Sequence[tuple[FeatherKind, bool]], rows: int, columns: int
) -> list[Feather]:
    """The feather of each kind, as build_feather gives it. shapes: kind, and whether mirrored."""
    return [each.feather for each in _built(shapes, rows, columns)]


@lru_cache(maxsize=_GRIDS)
def built_shapes(rows: int, columns: int) -> dict[tuple[int, bool], _BuiltShape]:
    """Shapes built on a grid, of kinds that are in use, by identity of the kind, and whether
    mirrored."""
    return {}


def _built(
    shapes: Sequence[tuple[FeatherKind, bool]], rows: int, columns: int
) -> list[_BuiltShape]:
    known = built_shapes(rows, columns)
    found = [known.get((id(kind), mirrored)) for kind, mirrored in shapes]
    missing = [shape for shape, each in zip(shapes, found, strict=True) if each is None]

    def compute() -> Arrays:
        from featherfx.feather.build import build_feather  # only for shapes that are not cached

        tasks = (partial(build_feather, kind, rows, columns, side) for kind, side in missing)
        return _packed(all_of(*tasks))

    def note(shape: tuple[FeatherKind, bool], feather: Feather) -> _BuiltShape:
        key = id(shape[0]), shape[1]
        kind = ref(shape[0], lambda _: known.pop(key, None))
        known[key] = new = _BuiltShape(kind, feather, WeakValueDictionary())
        return new

    if not missing:
        return [each for each in found if each]
    arrays = kept("shapes", [missing, rows, columns], compute)
    made = map(note, missing, _unpacked(arrays, len(missing)))
    return [each or next(made) for each in found]


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
    for name in _TOPOLOGY:
        parts[name] = [*map(share, parts[name])]
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


Grid = tuple[int, int]


def build_unit_maps(
    shapes: Sequence[tuple[FeatherKind, bool]], coarse: Grid, fine: Grid
) -> list[RowMap]:
    """The density map of each shape, a kind and whether it is mirrored, from a grid (rows and
    columns) to another one."""
    if not shapes:
        return []

    def compute() -> Arrays:
        from featherfx.feather.build import build_feather
        from featherfx.feather.density import density_map

        return _packed_maps(
            [
                density_map(
                    build_feather(kind, *coarse, mirrored), build_feather(kind, *fine, mirrored)
                )
                for kind, mirrored in shapes
            ]
        )

    return _unpacked_maps(kept("maps", [tuple(shapes), coarse, fine], compute), len(shapes))


def _packed_maps(maps: Sequence[RowMap]) -> Arrays:
    """The arrays of one name of all maps end to end, and their sizes."""
    found: dict[str, Any] = {"pieces": np.stack([each.pieces for each in maps])}
    for name in ("nodes", "directors"):
        own = [getattr(each, name) for each in maps]
        found[f"{name}.widths"] = np.array([each.width for each in own])
        found[f"{name}.shapes"] = np.array([each.shape for each in own])
        for part in Rows._fields:
            arrays = [getattr(each.matrix, part) for each in own]
            found[f"{name}.{part}"] = np.concatenate(arrays)
            found[f"{name}.{part}.ends"] = np.cumsum([len(each) for each in arrays])
    return found


def _unpacked_maps(arrays: Mapping[str, Any], count: int) -> list[RowMap]:
    """Invert _packed_maps."""
    parts = {}
    for name in ("nodes", "directors"):
        cut = [
            np.split(arrays[f"{name}.{part}"], arrays[f"{name}.{part}.ends"][:-1])
            for part in Rows._fields
        ]
        parts[name] = [
            PointMap(
                Rows(*each),
                tuple(arrays[f"{name}.shapes"][k].tolist()),
                int(arrays[f"{name}.widths"][k]),
            )
            for k, each in enumerate(zip(*cut, strict=True))
        ]
    return [
        RowMap(parts["nodes"][k], parts["directors"][k], arrays["pieces"][k]) for k in range(count)
    ]


_MIRRORED = "mirrored"


@lru_cache(maxsize=4096)
def encode_shape(kind: FeatherKind, mirrored: bool) -> str:
    """All that a feather is built from but its colours, to the last bit."""
    told = asdict(replace(kind, colour=Colour())) | {_MIRRORED: mirrored}
    del told["colour"]
    return json.dumps(told, separators=(",", ":"), allow_nan=False)


def decode_shape(text: str) -> tuple[FeatherKind, bool]:
    """The kind that a text is of, and whether it is mirrored. Raises ValueError for other texts."""
    try:
        told = json.loads(text)
        mirrored = told.pop(_MIRRORED)
        if isinstance(mirrored, bool):
            return _read(FeatherKind, told), mirrored
    except (AttributeError, KeyError, TypeError, RecursionError) as error:
        raise ValueError(f"is no shape of a feather: {error}") from error
    raise ValueError("is no shape of a feather")


def _read(kind: Any, value: Any) -> Any:
    """A value of a declared type. Raises ValueError or TypeError for one of another."""
    if isinstance(kind, type) and is_dataclass(kind) and isinstance(value, Mapping):
        hints = get_type_hints(kind)
        known = {each.name for each in fields(kind)}
        if not value.keys() <= known:
            raise ValueError(f"holds {min(value.keys() - known)}")
        return kind(**{name: _read(hints[name], each) for name, each in value.items()})
    if get_origin(kind) is UnionType:
        several = isinstance(value, list)
        kind = next(each for each in get_args(kind) if (get_origin(each) is tuple) == several)
    if get_origin(kind) is tuple and isinstance(value, list):
        items = get_args(kind)
        each = items[:1] * len(value) if items[-1:] == (Ellipsis,) else items
        return tuple(_read(*pair) for pair in zip(each, value, strict=True))
    if kind is float and isinstance(value, int | float) and not isinstance(value, bool):
        return float(value)
    if isinstance(kind, type) and type(value) is kind:
        return value
    raise ValueError(f"holds {value!r:.40}")


carry_kernels = KernelModule("featherfx.feather.carry_kernels")


# of a line of what is carried: points, first and second rates, a vector of the processor for each
LINE_WIDTH = 3 * LANES


class RowMapArrays(NamedTuple):
    """A RowMap as kernels take it."""

    nodes: Rows
    directors: Rows
    pieces: Array
    detail: Array


def scaled_map(unit: RowMap, size: float, rows: int) -> RowMap:
    """The density map between the same two feathers `size` times as large.

    rows: of the values that are mapped. Positions grow and directors do not, so only what goes
    from one to the other is scaled. Much faster than a map of its own.
    """
    if size == 1.0:
        return unit
    directors = _scaled(unit.directors, 1 / size, 1, rows)
    return RowMap(scaled_points(unit.nodes, size, rows), directors, size * unit.pieces)


def scaled_points(unit: PointMap, size: float, rows: int) -> PointMap:
    """The same of a map to points alone."""
    return _scaled(unit, 1.0, size, rows)


def _scaled(unit: PointMap, of_nodes: float, of_directors: float, rows: int) -> PointMap:
    """A map of `rows` rows with what goes from nodes, and from directors, times a factor each."""
    if of_nodes == of_directors:
        return unit
    factors = np.full(unit.width, float(of_directors))
    factors[: unit.width - 2 * rows] = of_nodes
    return replace(unit, matrix=unit.matrix.scaled(factors))


def carry_points(to_fine: RowMap, points: RowPoints) -> RowPoints:
    """Points on another grid, its barbs as long as at rest."""
    still = both(np.zeros_like, points)
    return carry_motion(to_fine, points, still, still)[0]


def carry_motion(
    to_fine: RowMap, points: RowPoints, velocities: RowPoints, accelerations: RowPoints
) -> MovingPoints:
    """The same with their first and second rates."""
    parts = points, velocities, accelerations
    given = MovingPoints(*(both(np.ascontiguousarray, each) for each in parts))
    found = _empty(to_fine)
    carry_kernels.carry_feather(
        _way(to_fine), given, np.zeros((to_fine.nodes.width, LINE_WIDTH)), found
    )
    return found


def with_detail(to_fine: RowMap, coarse: Feather, fine: Feather) -> RowMap:
    """The map between plane forms for feathers that lie on leaves, so that the rest shape of the
    one leads to that of the other."""
    base = RowPoints(to_fine.nodes(coarse.rest), to_fine.directors(coarse.rest))
    lateral, dorsal = base.directors[:, 0], base.directors[:, 1]
    frames = np.stack([np.cross(lateral, dorsal), lateral, dorsal], axis=2)
    missing = (fine.points - base.rows()).transpose(0, 2, 1)
    detail = np.linalg.solve(frames, missing).transpose(0, 2, 1)
    return to_fine._replace(detail=np.ascontiguousarray(detail, dtype=np.float64))


def _way(to_fine: RowMap) -> RowMapArrays:
    return RowMapArrays(
        to_fine.nodes.matrix, to_fine.directors.matrix, to_fine.pieces, to_fine.detail
    )


def _empty(to_fine: RowMap, *before: int) -> MovingPoints:
    """Room for what is carried, with axes in front."""
    shapes = [(*before, *each.shape) for each in (to_fine.nodes, to_fine.directors)]
    return MovingPoints(*(RowPoints(*map(np.empty, shapes)) for _ in MovingPoints._fields))


class PointCarrier:
    """Carries feathers of one grid to another, each by a map of its own (F of them)."""

    def __init__(self, maps: Sequence[RowMap]) -> None:
        self._first = maps[0]
        self._ways = views_of([_way(each) for each in maps])

    def __call__(
        self, some: Indices, points: RowPoints, velocities: RowPoints, accelerations: RowPoints
    ) -> MovingPoints:
        """As carry_motion, of some (K,) of the feathers that are given (F, ...)."""
        found = _empty(self._first, len(some))
        lines = np.zeros((self._first.nodes.width, LINE_WIDTH))
        given = MovingPoints(points, velocities, accelerations)
        carry_kernels.carry_feathers(self._ways.views, some, given, lines, found)
        return found
