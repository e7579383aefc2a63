"""Smallest radius of a rachis in the vane's plane at which barbs do not fold over each other.

A barb b of length L at the angle a to the shaft turns with it; the strip of vane between it and the
next one has the area (L sin a / 2 - k L^2 / 3) ds where the shaft turns by k ds to the barb's side,
if the barb is straight. It is none left at k = 3 sin a / (2 L).
"""

from __future__ import annotations

import numpy as np

from featherfx.algebra.types import Array
from featherfx.groom.course import chord_angle
from featherfx.groom.types import FeatherKind, VaneShape

# of the turning that leaves no area: below it no vane folds of waves, screws and corners of shafts
# of six presets (down, whose barbs are long, folds at 0.95, the others at 1.8 to 2.7)
_SAFE = 0.9
_PLACES = 129
_LONGEST, _STEPS = 1.5, 301


def tightest(kind: FeatherKind) -> Array:
    """(129,) rad per length of the shaft, at even shares of it; infinite where there is no vane."""
    along = (np.linspace(0.0, 1.0, _PLACES) - kind.calamus) / (1.0 - kind.calamus)
    bend = np.zeros(_PLACES)
    for vane in (kind.leading, kind.trailing):
        if vane.outline:
            bend = np.maximum(bend, np.where(along >= 0.0, _bend(vane, kind.calamus, along), 0.0))
    return np.asarray(_SAFE * 1.5 / np.where(bend > 0.0, bend, 1e-9))


def _bend(vane: VaneShape, calamus: float, along: Array) -> Array:
    """(K,) length of the barbs at shares of the vane over the sine of their angle."""
    angle = np.radians(
        np.interp(
            along,
            [guide.position for guide in vane.guides],
            [chord_angle(guide) for guide in vane.guides],
        )
    )
    places, widths = np.array(vane.outline).T
    reach = np.linspace(0.0, _LONGEST, _STEPS)
    ends = along[:, None] + reach * np.cos(angle)[:, None] / (1.0 - calamus)
    edge = np.interp(ends, np.maximum.accumulate(places), widths, right=0.0)
    length = reach[np.argmax(reach * np.sin(angle)[:, None] >= edge, axis=1)]
    return np.asarray(length / np.sin(angle))
