"""From a feather kind to rest geometry."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache
from itertools import pairwise

import numpy as np

from featherfx.errors import Problem, require
from featherfx.feather.barbs import describe_outline_fault
from featherfx.feather.profiles import build_rachis
from featherfx.feather.types import (
    LEADING,
    TRAILING,
    Array,
    Feather,
    FeatherSurface,
    RowPoints,
    barb_slice,
    make_read_only,
)
from featherfx.feather.vane import barb_span, build_surface, build_vane
from featherfx.groom.types import FeatherKind, VaneShape

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
