"""Where the barbs of a vane are hooked at rest: the share of barbules that hold, place by place."""

from __future__ import annotations

import numpy as np

from featherfx.feather.types import Array, Feather
from featherfx.groom.types import FeatherKind


def hooked_fraction(kind: FeatherKind, feather: Feather) -> Array:
    """(2, n-1, m, 2) share of hooked barbules, 0 to 1, in the middle of each triangle.

    feather: of that kind, at any size.
    """
    base = kind.calamus * feather.station[-1]
    middle = 0.5 * (feather.station[1:] + feather.station[:-1])
    along_shaft = (middle - base) / (feather.station[-1] - base)
    along_barb = (np.arange(feather.columns) + 0.5) / feather.columns
    sides = []
    for vane in (kind.leading, kind.trailing):
        shaft, barb = (
            np.interp(place, *np.transpose(curve)) if curve else np.ones(len(place))
            for curve, place in (
                (vane.hooked.shaft, along_shaft),
                (vane.hooked.barb, along_barb),
            )
        )
        sides.append(np.outer(shaft, barb))
    return np.repeat(np.stack(sides)[..., None], 2, axis=3)
