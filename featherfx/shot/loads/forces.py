"""Dead forces on feathers: at a point, along the rachis or along a barb.

A force is shared by the material points around its place with linear hats along the rachis (by
arc length) and along the barbs, a line's with the integrals of those hats. So the total does not
depend on the grid, and the place converges with it.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from featherfx.errors import InputError, Problem
from featherfx.feather.types import LEADING, TRAILING, Feather
from featherfx.shot.types import Force

Array = NDArray[np.float64]


def force_weights(force: Force, feather: Feather) -> Array:
    """(n, P) share of a force that acts on every material point; of a line's, m.

    Raises InputError where a barb is meant and none grows.
    """
    place = feather.station / feather.station[-1]
    weights = np.zeros(feather.points.shape[:2])
    if force.line == "rachis":
        weights[:, 0] = feather.station[-1] * hat_integrals(place, *force.span)
        return weights
    rows = hat_values(place, force.row)
    if force.line == "point" and force.column == 0.0:
        weights[:, 0] = rows
        return weights
    side = LEADING if force.side == "leading" else TRAILING
    reach = feather.barb_length[side]
    if not np.all(reach[rows > 0.0] > 0.0):
        raise InputError(Problem("shot", "force", _no_barb(force, place, reach)))
    columns = np.linspace(0.0, 1.0, feather.columns + 1)
    if force.line == "barb":
        rows, along = rows * reach, hat_integrals(columns, *force.span)
    else:
        along = hat_values(columns, force.column)
    weights[:, 0] = rows * along[0]
    first = 3 + side * feather.columns
    weights[:, first : first + feather.columns] = rows[:, None] * along[1:]
    return weights


def _no_barb(force: Force, place: Array, reach: Array) -> str:
    where = f"no {force.side} barb grows at row = {force.row:g} of feather '{force.feather}'"
    grown = place[reach > 0.0]
    return f"{where}; allowed: {grown[0]:.3g} to {grown[-1]:.3g}" if len(grown) else where


def hat_values(knots: Array, place: float) -> Array:
    """(n,) linear hats of ascending knots at one place between the first and the last."""
    return np.array([np.interp(place, knots, row) for row in np.eye(len(knots))])


def hat_integrals(knots: Array, start: float, end: float) -> Array:
    """(n,) integrals of the linear hats of ascending knots from start to end."""
    inside = knots[(knots > start) & (knots < end)]
    places = np.concatenate([[start], inside, [end]])
    values = np.stack([hat_values(knots, place) for place in places])
    # linear between all of these places, so the trapezoidal rule is exact
    return np.asarray(0.5 * np.diff(places) @ (values[:-1] + values[1:]))


def force_at(force: Force, time: float) -> Array:
    """(3,) N, or N/m of a line, at a time (s since the first frame): linear between its keys."""
    if not force.keys:
        return force.force
    times, factors = zip(*force.keys, strict=True)
    return force.force * float(np.interp(time, times, factors))
