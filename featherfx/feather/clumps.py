"""Wet barbs: water draws the ends of neighbouring ones together, each clump to its middle barb.

    x = x_0 + a u^2 (c - x_0)

x_0 a point of a dry barb, u its place along the barb, 0 at the root, c the point at the same place
of the clump's middle barb, a how far they come together. A look: no capillary force is computed.
"""

from __future__ import annotations

import numpy as np

from featherfx.feather.types import Array, BarbCurves, Indices

# of the part of a vane that a clump takes, how unevenly the parts are cut
_UNEVEN = 0.7
_SEED = 7


def clumped(barbs: BarbCurves, points: Array, amount: float, clumps: int) -> Array:
    """(B K, 3) points of barbs, or their rates, at an amount a. clumps: of each vane."""
    if amount == 0.0:
        return points
    each = points.reshape(*barbs.widths.shape, 3)
    along = np.linspace(0.0, 1.0, each.shape[1])[:, None]
    middle = each[middle_barbs(barbs.side, barbs.st[:, 0, 1], clumps)]
    return np.asarray(each + amount * along**2 * (middle - each)).reshape(points.shape)


def middle_barbs(side: Indices, place: Array, clumps: int) -> Indices:
    """(B,) barb in the middle of each barb's clump. place: (B,) along the shaft, 0 to 1."""
    rng = np.random.default_rng(_SEED)
    cuts = (np.arange(clumps) + _UNEVEN * rng.uniform(-0.5, 0.5, clumps))[1:] / clumps
    span = np.ptp(place) or 1.0
    number = np.searchsorted(cuts, (place - place.min()) / span) + clumps * side
    _, first, clump, count = np.unique(
        number, return_index=True, return_inverse=True, return_counts=True
    )
    return np.asarray((first + count // 2)[clump])
