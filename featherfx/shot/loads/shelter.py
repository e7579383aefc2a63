"""Shelter: feathers within a plumage feel the air slower than it blows.

    u' = v + e (u - v)

u: velocity of the air, v: velocity of the feather's root over the interval, e: the share of the
air's motion against the root that reaches the feather (1: all of it). A vane alone in the wind is
pressed on from one side; one that lies on others and on the skin has nearly the same pressure on
both, and the air between them moves with the body. e stands for both. It is no measured property;
a bird's back needs less of it than the tips of its crest.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from featherfx.mechanics.model import Loads
from featherfx.shot.patterns import fits
from featherfx.shot.types import Shot

Array = NDArray[np.float64]

# m/s, to which roots' velocities are rounded, so that even motion gives equal winds
_DIGITS = 9


def exposures(shot: Shot) -> Array:
    """(F,) e of every feather of a shot: by the last shelter that fits it, else 1."""
    found = np.ones(len(shot.groom.feathers))
    for shelter in shot.shelters:
        for f, placement in enumerate(shot.groom.feathers):
            if fits(shelter, placement):
                found[f] = 1.0 - shelter.share
    return found


def sheltered(loads: Loads, exposure: float, way: Array, duration: float) -> Loads:
    """Loads of a batch whose feathers all have one exposure.

    way: (F, 3) m, that the roots go within the loads' duration (s; 0: nothing moves).
    """
    velocity = np.zeros_like(way)
    if duration > 0.0:
        velocity = np.round(way / duration, _DIGITS)
    return loads._replace(
        wind_mean=exposure * loads.wind_mean + (1.0 - exposure) * velocity,
        wind_amplitude=exposure * loads.wind_amplitude,
    )
