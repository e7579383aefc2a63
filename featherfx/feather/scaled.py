"""One rest shape for all feathers that differ in size only."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from featherfx.feather.build import build_feather
from featherfx.feather.types import Feather
from featherfx.groom.types import Placement


def feather_of(placement: Placement, rows: int, columns: int) -> Feather:
    """Rest geometry of a placed feather, in its own frame; shapes are built once for all sizes.

    rows, columns: as in build_feather. Raises InputError for shapes that cannot be built.
    """
    if placement.prototype is None:
        return build_feather(placement.kind, rows, columns, placement.mirrored)
    built = build_feather(placement.prototype, rows, columns, placement.mirrored)
    return scaled(built, placement.size)


def repeated_shapes(placements: Sequence[Placement]) -> tuple[list[int], list[int]]:
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


def scaled(feather: Feather, size: float) -> Feather:
    """The feather `size` times as large. Directors and the mesh's topology stay the same."""
    if size == 1.0:
        return feather
    points = size * feather.points
    points[:, 1:3] = feather.points[:, 1:3]
    # a point of the shaft's tube is the rachis point plus directors times lengths
    weights = feather.surface.weights.copy()
    weights[:, 1:] *= size
    result = replace(
        feather,
        points=points,
        station=size * feather.station,
        width=size * feather.width,
        height=size * feather.height,
        barb_length=size * feather.barb_length,
        barb_span=size * feather.barb_span,
        surface=replace(feather.surface, weights=weights),
    )
    for array in (points, result.station, result.width, result.height, weights):
        array.flags.writeable = False
    result.barb_length.flags.writeable = result.barb_span.flags.writeable = False
    return result
