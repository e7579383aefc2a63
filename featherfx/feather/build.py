"""From a feather kind or a placed feather to rest geometry, and maps between grids.

Shapes are built once for all sizes and sides, cached, and written as text.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, fields, is_dataclass, replace
from functools import lru_cache, partial
from itertools import pairwise
from operator import attrgetter
from types import UnionType
from typing import Any, get_args, get_origin, get_type_hints
from weakref import WeakValueDictionary

import numpy as np

from featherfx.algebra.interpolation import Rows
from featherfx.errors import Problem, all_of, require
from featherfx.feather.barbs import describe_outline_fault
from featherfx.feather.density import density_map
from featherfx.feather.profiles import build_rachis
from featherfx.feather.types import (
    LEADING,
    TRAILING,
    Array,
    Feather,
    FeatherSurface,
    PointMap,
    RowMap,
    RowPoints,
    barb_slice,
)
from featherfx.feather.vane import barb_span, build_surface, build_vane
from featherfx.files.disk_cache import Arrays, kept
from featherfx.groom.types import Colour, FeatherKind, Placement, VaneShape

_SIDES = ((LEADING, "leading"), (TRAILING, "trailing"))


@lru_cache(maxsize=1024)
def build_feather(
    kind: FeatherKind, rows: int, columns: int, mirrored: bool = False, tube_sides: int = 6
) -> Feather:
    """Rest geometry of a feather, remembered for equal arguments; its arrays are read-only.

    rows: rachis rows, at least 3. columns: barb columns a side, at least 1. mirrored: the mirror
    image in y, for the other wing: leading vane and d2 on opposite sides, sweep still towards
    trailing, camber still towards ventral. tube_sides: corners of the rachis section, at least 3.

    A vane begins where its outline does and is closed at right angles to the rachis where an end
    of the outline lies away from it; rows outside and barbs below a thousandth of the feather's
    length have no barb. InputError, with all problems found, for outlines and guides that cannot
    be built: barbs that cross, leave the outline or fold the vane.
    """
    require(*_problems(kind, rows, columns, tube_sides))
    if mirrored:
        feather = mirror_feather(build_feather(kind, rows, columns, False, tube_sides))
    else:
        feather = _build(kind, rows, columns, tube_sides)
    make_read_only(feather)
    return feather


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


def _build(kind: FeatherKind, rows: int, columns: int, tube_sides: int) -> Feather:
    rachis = build_rachis(kind, rows)
    nodes = np.empty((rows, 1 + 2 * columns, 3))
    nodes[:, 0] = rachis.position
    unsplit = nodes.copy()
    place = rachis.station - rachis.station[rachis.first_vane_row]
    place /= (1.0 - kind.calamus) * kind.length
    cell = np.zeros((2, rows - 1, columns, 2), dtype=np.bool_)
    barb_length, spans = np.zeros((2, rows)), np.zeros((2, rows))
    split = np.zeros_like(cell)
    problems: list[Problem] = []
    for side, name in _SIDES:
        vane = whole = build_vane(kind, side, rachis, columns)
        if (shape := getattr(kind, name)).is_split:
            from featherfx.feather.splits import open_cells, strips_of
            from featherfx.groom.splits import splits_of

            splits = splits_of(shape.splits, side)
            vane = build_vane(kind, side, rachis, columns, splits)
            strips = strips_of(splits, place, vane.barb_length > 0.0)
            split[side] = open_cells(strips, vane.cell)
        nodes[:, barb_slice(side, columns)] = vane.nodes[:, 1:]
        unsplit[:, barb_slice(side, columns)] = whole.nodes[:, 1:]
        cell[side], barb_length[side] = vane.cell, vane.barb_length
        spans[side] = barb_span(rachis.station, vane.barb_length, rachis.first_vane_row)
        problems += [_problem(kind, f"{name}.guides", message) for message in vane.problems]
    require(*problems)
    surface = build_surface(
        nodes, rachis, barb_length, cell, tube_sides, kind.may_part, kind.rachis.above_vane
    )
    feather = Feather(
        rest=RowPoints(nodes, np.stack([rachis.frame[..., 1], rachis.frame[..., 2]], axis=1)),
        station=rachis.station,
        width=rachis.width,
        height=rachis.height,
        barb_length=barb_length,
        barb_span=spans,
        cell=cell,
        surface=surface,
    )
    return replace(feather, split=split, unsplit=unsplit) if split.any() else feather


def _problems(kind: FeatherKind, rows: int, columns: int, tube_sides: int) -> list[Problem]:
    """List what can be seen to be wrong from the arguments alone."""
    least = {"rows": (rows, 3), "columns": (columns, 1), "tube_sides": (tube_sides, 3)}
    problems = [
        Problem("", name, f"{value} is not allowed. Give at least {low}")
        for name, (value, low) in least.items()
        if value < low
    ]
    if not 0.0 <= kind.calamus < 1.0:
        problems.append(
            _problem(kind, "calamus", f"{kind.calamus:g} is not allowed. Give 0 to below 1")
        )
    sizes = {
        "length": kind.length,
        "rachis.diameter_base": kind.rachis.diameter_base,
        "rachis.diameter_tip": kind.rachis.diameter_tip,
        "rachis_material.flattening": kind.rachis_material.flattening,
    }
    problems += [
        _problem(kind, key, f"{value:g} is not allowed. Give a value above 0")
        for key, value in sizes.items()
        if not 0.0 < value < np.inf
    ]
    for _, name in _SIDES:
        vane: VaneShape = getattr(kind, name)
        if vane.outline:
            problems += _vane_problems(kind, name, vane)
    return problems


def _vane_problems(kind: FeatherKind, name: str, vane: VaneShape) -> list[Problem]:
    problems = []
    fault = describe_outline_fault(vane.outline)
    if fault:
        problems.append(_problem(kind, f"{name}.outline", fault))
    places = [guide.position for guide in vane.guides]
    if not places:
        problems.append(_problem(kind, f"{name}.guides", "a vane needs at least one barb guide"))
    if any(not later > earlier for earlier, later in pairwise(places)):
        problems.append(_problem(kind, f"{name}.guides", "positions must ascend"))
    for number, guide in enumerate(vane.guides):
        key = f"{name}.guides.{number}"
        if not 0.0 < guide.angle < 180.0:
            message = f"{guide.angle:g} is not allowed. Give 0 to 180 deg"
            problems.append(_problem(kind, f"{key}.angle", message))
        for turning in ("curl", "camber"):
            value = getattr(guide, turning)
            if not abs(value) <= 180.0:
                message = f"{value:g} is not allowed. Give -180 to 180 deg"
                problems.append(_problem(kind, f"{key}.{turning}", message))
    return problems


def _problem(kind: FeatherKind, key: str, message: str) -> Problem:
    return Problem(f"feather kind {kind.name}", key, message)


def make_read_only(record: Any) -> None:
    """Let nobody write to the arrays of a record."""
    for entry in fields(record):
        value = getattr(record, entry.name)
        if is_dataclass(value):
            make_read_only(value)
            continue
        for array in value if isinstance(value, RowPoints) else (value,):
            array.flags.writeable = False


_REFLECTION = np.array([1.0, -1.0, 1.0])


def mirror_feather(feather: Feather) -> Feather:
    """The mirror image in the plane y = 0: leading vane at -y, dorsal still +z.

    A reflection would make the frames left-handed, so d2 is turned round: it still starts as +y,
    which is then the trailing side.
    """
    turned_round = _REFLECTION * [[-1.0], [1.0]]
    rest = RowPoints(
        _positive_zeros(feather.rest.nodes * _REFLECTION),
        _positive_zeros(feather.rest.directors * turned_round),
    )
    unsplit = _positive_zeros(feather.unsplit * _REFLECTION)
    surface = _mirror_surface(feather.surface)
    return replace(feather, rest=rest, surface=surface, unsplit=unsplit)


def _mirror_surface(surface: FeatherSurface) -> FeatherSurface:
    return replace(
        surface,
        offset=_positive_zeros(surface.offset * [-1.0, 1.0]),
        triangles=np.ascontiguousarray(surface.triangles[:, [0, 2, 1]]),
        barb_direction=_positive_zeros(surface.barb_direction * _REFLECTION),
    )


def _positive_zeros(values: Array) -> Array:
    """Zeros without a sign, so that files do not show -0."""
    return values + 0.0


def scale_feather(feather: Feather, size: float) -> Feather:
    """The feather `size` times as large. Directors and the mesh's topology stay the same."""
    if size == 1.0:
        return feather
    lengths = ("station", "width", "height", "barb_length", "barb_span", "unsplit")
    own = {name: size * getattr(feather, name) for name in lengths}
    nodes, offset = size * feather.rest.nodes, size * feather.surface.offset
    for array in (*own.values(), nodes, offset):
        array.flags.writeable = False  # the others are those of the feather
    surface = replace(feather.surface, offset=offset)
    return replace(feather, rest=feather.rest._replace(nodes=nodes), surface=surface, **own)


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


def build_plane_feathers(placements: Sequence[Placement], rows: int, columns: int) -> list[Feather]:
    """Rest geometry of placed feathers as their kinds have it, each in its own frame.

    Feathers of one shape and size share theirs. rows, columns: as in build_feather. Raises
    InputError with the problems of all shapes that cannot be built.
    """
    first, chosen = distinct_shapes(placements)
    shapes = tuple((p.prototype or p.kind, p.mirrored) for p in (placements[k] for k in first))
    built, sized = build_shapes(shapes, rows, columns), _sized(shapes, rows, columns)
    found = []
    for shape, placement in zip(chosen, placements, strict=True):
        size = 1.0 if placement.prototype is None else placement.size
        feather = sized.get((shape, size))
        if feather is None:
            feather = sized[shape, size] = scale_feather(built[shape], size)
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
def build_shapes(
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


Grid = tuple[int, int]


def build_unit_maps(
    shapes: Sequence[tuple[FeatherKind, bool]], coarse: Grid, fine: Grid
) -> list[RowMap]:
    """The density map of each shape, a kind and whether it is mirrored, from a grid (rows and
    columns) to another one."""
    if not shapes:
        return []

    def compute() -> Arrays:
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
