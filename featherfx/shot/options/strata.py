"""Strata of a shot's feathers: of one kind, size and load, each with a sample that is measured."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from featherfx.algebra.types import Flags, Indices
from featherfx.mechanics.batch import may_slip
from featherfx.shot.options.load_estimate import Deflection
from featherfx.shot.types import Shot

# strata a shot may have at least, and one for so many feathers
_MIN_STRATA, _FEATHERS_PER_STRATUM = 8, 20
# powers of two within which sizes and deflections are alike, from fine to coarse
_WIDTHS = (1.0, 2.0, 4.0, 100.0)
# of a feather's length, deflection below which all are alike
_MIN_DEFLECTION = 2e-3


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
