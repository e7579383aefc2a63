"""Where the barbs of a vane are hooked at rest: the share of barbules that hold, place by place."""

from __future__ import annotations

import numpy as np

from featherfx.feather.profiles import at_places, middles
from featherfx.feather.types import Array, Feather
from featherfx.groom.types import FeatherKind


def hooked_fraction(kind: FeatherKind, feather: Feather) -> Array:
    """(2, n-1, m, 2) share of hooked barbules, 0 to 1, in the middle of each triangle.

    feather: of that kind, at any size.
    """
    along_shaft, along_barb = middles(kind, feather)
    sides = [
        np.outer(at_places(each.hooked.shaft, along_shaft), at_places(each.hooked.barb, along_barb))
        for each in (kind.leading, kind.trailing)
    ]
    return np.repeat(np.stack(sides)[..., None], 2, axis=3)
