"""Fraction of barbules of a vane that hold at rest, place by place.

What a strip between two rows has of the stiffness of a whole one is not the share in its middle.
The barbs that it stands for hang one on the next, so compliances add up: over a strip from a to b

    share = (b - a) / integral ds / h(s),    h the share along the shaft,

and where some of them are loose, the next row hangs on nothing, however wide the strip is. Along a
barb stiffnesses add up, and the middle of a triangle tells.
"""

from __future__ import annotations

import numpy as np

from featherfx.feather.profiles import at_places, middles, vane_shares
from featherfx.feather.types import Array, Feather
from featherfx.groom.materials import Curve
from featherfx.groom.types import FeatherKind

# shares are not less along the shaft, so that loose barbs are compliant, not apart; what is left of
# a strip then counts as nothing below this
_MIN_FRACTION, _NOTHING = 1e-6, 1e-4


def hooked_fraction(kind: FeatherKind, feather: Feather) -> Array:
    """(2, n-1, m, 2) share of hooked barbules, 0 to 1, in the middle of each triangle.

    feather: of that kind, at any size.
    """
    along_shaft, along_barb = middles(kind, feather)
    sides = [
        np.outer(
            at_places(each.hooked.rachis, along_shaft), at_places(each.hooked.barb, along_barb)
        )
        for each in (kind.leading, kind.trailing)
    ]
    return np.repeat(np.stack(sides)[..., None], 2, axis=3)


def hooked_stiffness(kind: FeatherKind, feather: Feather) -> Array:
    """(2, n-1, m, 2) what is hooked has of each triangle's stiffness, 0 to 1."""
    ends, (_, along_barb) = vane_shares(kind, feather.station), middles(kind, feather)
    sides = [
        np.outer(in_series(each.hooked.rachis, ends), at_places(each.hooked.barb, along_barb))
        for each in (kind.leading, kind.trailing)
    ]
    return np.repeat(np.stack(sides)[..., None], 2, axis=3)


def in_series(curve: Curve, ends: Array) -> Array:
    """(n-1,) shares of the strips between places (n,), of what hangs one on the next."""
    if not curve:
        return np.ones(len(ends) - 1)
    corners = np.array([place for place, _ in curve])
    inside = (corners > ends[0]) & (corners < ends[-1])
    places = np.unique(np.concatenate([ends, corners[inside]]))
    share = np.maximum(at_places(curve, places), _MIN_FRACTION)
    low, high = np.minimum(share[1:], share[:-1]), np.maximum(share[1:], share[:-1])
    rise = high / low - 1.0
    # of 1 / h where h is linear
    mean = np.divide(np.log1p(rise), rise, out=np.ones_like(rise), where=rise > 0.0) / low
    strip = np.searchsorted(ends, places[:-1], side="right") - 1
    compliance = np.bincount(strip, np.diff(places) * mean, minlength=len(ends) - 1)
    found = np.diff(ends) / compliance
    return np.where(found < _NOTHING, 0.0, found)
