"""Models of batches of feathers, and maps from their grids to those of the meshes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from featherfx.algebra.types import Indices
from featherfx.feather.build import build_feather
from featherfx.feather.density import scaled_map, with_detail
from featherfx.feather.shapes import build_unit_maps
from featherfx.feather.types import Feather, RowMap
from featherfx.files.disk_cache import kept
from featherfx.groom.presets.kinds import Change, adjusted
from featherfx.groom.types import FeatherKind, Placement, Splits
from featherfx.mechanics.batch import make_model, may_slip, resized
from featherfx.mechanics.model import Model
from featherfx.shot.options import FeatherOptions
from featherfx.solver.damping import with_damping

# places of a groom whose maps are kept together
_PART = 128


def model_of(
    placements: Sequence[Placement],
    feathers: Sequence[Feather],
    options: FeatherOptions,
    touching: bool,
) -> Model:
    """Constant arrays of a batch: made once for feathers of one shape, or of one shape and size
    where their materials do not follow from the size.

    touching: whether loose barbs do not pass through each other. Of what is not solved, nothing is
    damped.
    """
    units = [_of_unit_size(each, options) for each in placements]
    shapes: list[tuple[Any, ...]] = [
        (id(unit), p.mirrored)
        if unit
        else (id(p.prototype or p.kind), p.kind, p.size, p.mirrored, id(p.leaf))
        for p, unit in zip(placements, units, strict=True)
    ]
    first: dict[tuple[Any, ...], int] = {}
    for k, shape in enumerate(shapes):
        first.setdefault(shape, k)
    number = {shape: n for n, shape in enumerate(first)}
    own = [(placements[k], units[k], feathers[k]) for k in first.values()]
    grid = options.rows, options.columns

    def compute() -> dict[str, Any]:
        some = [
            build_feather(unit, *grid, placement.mirrored) if unit else feather
            for placement, unit, feather in own
        ]
        kinds = [_as_simulated(unit or placement.kind, options) for placement, unit, _ in own]
        model = make_model(some, kinds, options.coefficients, touching)
        if not options.is_simulated:
            return model.arrays()
        return with_damping(model, kinds).arrays()

    inputs = [_constant(placement, unit) for placement, unit, _ in own]
    how = options.level, *grid, options.coefficients, touching
    found = Model.from_arrays(kept("models", [inputs, *how], compute))
    model = found.some([number[shape] for shape in shapes])
    sizes = [1.0 if unit is None else p.size for p, unit in zip(placements, units, strict=True)]
    return resized(model, np.array(sizes)) if any(units) else model


def _constant(placement: Placement, unit: FeatherKind | None) -> list[Any]:
    """List what the constants of a feather, or of one of unit size, depend on."""
    if unit is not None:
        return [unit.uncoloured, placement.mirrored]
    kind, prototype = placement.kind, placement.prototype
    shape = prototype and prototype.uncoloured
    return [kind.uncoloured, shape, placement.size, placement.mirrored, placement.leaf]


def _of_unit_size(placement: Placement, options: FeatherOptions) -> FeatherKind | None:
    """The kind that a feather is `size` times as large as, if all of its constants follow."""
    unit = placement.prototype
    if (
        unit is None
        or placement.leaf is not None
        or unit.scaling != "similar"
        or unit.thickness_exponent != 1.0
        or has_open_hooks(unit, options)
    ):
        return None
    return unit if adjusted(unit, Change(scale=placement.size)) == placement.kind else None


def has_open_hooks(kind: FeatherKind, options: FeatherOptions) -> bool:
    """Return whether hooks of a feather may slip; those of vanes with less detail hold."""
    return options.level == "full" and may_slip(kind)


def _as_simulated(kind: FeatherKind, options: FeatherOptions) -> FeatherKind:
    if has_open_hooks(kind, options) or not may_slip(kind):
        return kind
    return replace(
        kind,
        vane_material=replace(kind.vane_material, hooks="closed"),
        leading=replace(kind.leading, splits=Splits()),
        trailing=replace(kind.trailing, splits=Splits()),
    )


def maps_between(
    members: Indices,
    placements: Sequence[Placement],
    simulated: Sequence[Feather],
    drawn: Sequence[Feather],
) -> list[RowMap | None]:
    """From the simulated grids to those drawn; None where they are the same. members: numbers in
    the groom, ascending."""
    if not placements or simulated[0].cell.shape == drawn[0].cell.shape:
        return [None] * len(placements)
    coarse, fine = simulated[0], drawn[0]
    grids = (coarse.rows, coarse.columns), (fine.rows, fine.columns)
    # one map for all feathers that differ in size only; a wind in which some feathers are simulated
    # otherwise leaves most parts of a groom as they were
    known: dict[tuple[int, bool], RowMap] = {}
    for part in np.split(np.arange(len(members)), np.flatnonzero(np.diff(members // _PART)) + 1):
        own = {}
        for placement in (placements[k] for k in part):
            shape = placement.prototype or placement.kind
            if (id(shape), placement.mirrored) not in known:
                own[id(shape), placement.mirrored] = shape, placement.mirrored
        known |= zip(own, build_unit_maps(tuple(own.values()), *grids), strict=True)
    found: list[RowMap | None] = []
    for placement, own_coarse, own_fine in zip(placements, simulated, drawn, strict=True):
        unit = known[id(placement.prototype or placement.kind), placement.mirrored]
        size = placement.size if placement.prototype is not None else 1.0
        own_map = scaled_map(unit, size, coarse.rows)
        is_laid = placement.leaf is not None
        found.append(with_detail(own_map, own_coarse, own_fine) if is_laid else own_map)
    return found
