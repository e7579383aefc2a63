"""Grids of a shot that promises an error: measured once for the same content, by strata.

Feathers are alike in strata by kind, size and load. Of each stratum a sample is measured
(calibration.py). What is found depends on the shot alone: no share, thread or frame range changes
it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from featherfx.algebra.types import Array, Flags, Indices
from featherfx.files.disk_cache import digest, keep, kept, kept_before, shot_settings
from featherfx.mechanics.resolution import may_slip
from featherfx.packages import load_name
from featherfx.shot.loads import Deflection, LoadEstimate
from featherfx.shot.options import first_grid
from featherfx.shot.roots import NO_RUN_UP
from featherfx.shot.types import MeasuredGrid, Shot

# strata a shot may have at least, and one for so many feathers
_MIN_STRATA, _FEATHERS_PER_STRATUM = 8, 20
# powers of two within which sizes and deflections are alike, from fine to coarse
_WIDTHS = (1.0, 2.0, 4.0, 100.0)
# of a feather's length, deflection below which all are alike
_MIN_DEFLECTION = 2e-3
# of the shots that this process measured last, and how many
_known: dict[str, list[MeasuredGrid]] = {}
_MAX_KNOWN = 8  # as many as a test or a tuner goes between


class Stratum(NamedTuple):
    """Feathers that are treated alike. members: numbers, ascending. sample: of those measured, the
    ones that loads bend most, then by turns along the groom. is_free: they leave their roots."""

    members: Indices
    sample: Indices
    is_free: bool


def stratify(
    shot: Shot, solved: Indices, deflections: Sequence[Deflection], free: Flags
) -> list[Stratum]:
    """Divide the feathers of a shot that are solved into strata.

    solved: numbers. deflections: m, of each. free: (F,) which leave their roots.
    """
    most = max(_MIN_STRATA, len(solved) // _FEATHERS_PER_STRATUM)
    strata: dict[tuple[Any, ...], list[int]] = {}
    for width in _WIDTHS:
        strata = {}
        for f in solved.tolist():
            key = _key(shot, f, deflections[f], bool(free[f]), width)
            strata.setdefault(key, []).append(f)
        if len(strata) <= most:
            break
    return [
        Stratum(np.array(each), _sample(each, deflections), bool(free[each[0]]))
        for each in strata.values()
    ]


def _key(
    shot: Shot, f: int, deflection: Deflection, is_free: bool, width: float
) -> tuple[Any, ...]:
    kind = shot.groom.feathers[f].kind
    shares = (each / kind.length for each in (deflection.rachis, deflection.barb))
    sizes = kind.length, *(max(each, _MIN_DEFLECTION) for each in shares)
    octaves = (math.floor(math.log2(each) / width) for each in sizes)
    return kind.name, may_slip(kind), deflection.is_pulled, is_free, *octaves


def _sample(members: list[int], deflections: Sequence[Deflection]) -> Indices:
    """Numbers of the feathers of a stratum that are measured."""
    worst = max(members, key=lambda f: deflections[f].rachis + deflections[f].barb)
    extra = members[:: 4 * _FEATHERS_PER_STRATUM][1:]
    return np.unique([worst, *extra])


def measure_grids(
    shot: Shot,
    solved: Indices,
    loads: LoadEstimate,
    deflections: Sequence[Deflection],
    free: Flags,
    until: float = math.inf,
) -> list[MeasuredGrid] | None:
    """Measure the grids of the feathers of a shot that promises an error; of every feather, where
    nothing is solved those to begin with. None where the time ends before.

    solved: numbers. deflections: m, of each. free: (F,) which leave their roots. until: s of CPU
    time of this process.
    """
    if shot.grids is not None:
        return [shot.grids[each.id] for each in shot.groom.feathers]
    shot = replace(shot, run_up=NO_RUN_UP, contact=None, colliders=(), preroll=0)
    # shapes of meshes fit one grid alone
    targets = tuple(each for each in shot.targets if each.points is None)
    shot = replace(shot, details=(), level_of_detail=None, targets=targets)
    # as feathers are solved, not as they are drawn on the skin
    shot = replace(shot, groom=replace(shot.groom, coat=None))
    key = digest([shot_settings(shot), solved])
    found = _known.get(key)
    if found is None:
        error = shot.quality.promised
        assert error is not None
        found = [first_grid(error)] * len(deflections)
        if not len(solved):
            return found
        strata = stratify(shot, solved, deflections, free)
        given = shot, strata, loads, deflections
        if until < math.inf:
            arrays = kept_before("calibrations", [key]) or _measure(*given, until)
            if arrays is None:
                return None
            keep("calibrations", [key], arrays)
        else:
            arrays = kept("calibrations", [key], lambda: _measure(*given) or {})
        rows = zip(*(arrays[name].tolist() for name in MeasuredGrid._fields), strict=True)
        for stratum, row in zip(strata, rows, strict=True):
            for f in stratum.members:
                found[f] = MeasuredGrid(*row)
        _known[key] = found
        while len(_known) > _MAX_KNOWN:
            _known.pop(next(iter(_known)))
    return found


def _measure(*given: Any) -> dict[str, Array] | None:
    """Levels, error and uniqueness of every stratum."""
    found: dict[str, Array] | None = load_name("loop.calibration:measure_strata")(*given)
    return found
