"""Loads on single feathers: dead forces at a point, along the rachis or along a barb, and grips.

A force is spread over the nodes around its place with linear hats along the rachis (by
arc length) and along the barbs, a line's with the integrals of those hats. So the total does not
depend on the grid, and the place converges with it.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from featherfx.algebra.interpolation import smooth_step
from featherfx.algebra.types import Array, Indices
from featherfx.errors import InputError, Problem
from featherfx.feather.density import linear_weights
from featherfx.feather.types import LEADING, TRAILING, Feather, barb_slice
from featherfx.shot.types import Force, Grip


def force_weights(force: Force, feather: Feather) -> Array:
    """(n, 1 + 2 m) how much of a force acts on every node; of a line's, m.

    Raises InputError where a barb is meant and none grows.
    """
    stations = feather.station / feather.station[-1]
    weights = np.zeros(feather.rest.nodes.shape[:2])
    if force.line == "rachis":
        weights[:, 0] = feather.station[-1] * hat_integrals(stations, *force.span)
        return weights
    rows = linear_weights(stations, np.array([force.row]))[0]
    if force.line == "point" and force.column == 0.0:
        weights[:, 0] = rows
        return weights
    side = LEADING if force.side == "leading" else TRAILING
    reach = feather.barb_length[side]
    rows = np.where(reach > 0.0, rows, 0.0)  # beside the first barb of a grid and the last one
    if not rows.any():
        where = f"no {force.side} barb grows at row = {force.row:g} of feather '{force.feather}'"
        grown = stations[reach > 0.0]
        raise InputError(
            Problem(
                "shot",
                "force",
                (f"{where}. Give {grown[0]:.3g} to {grown[-1]:.3g}" if len(grown) else where),
            )
        )
    rows /= rows.sum()
    columns = np.linspace(0.0, 1.0, feather.columns + 1)
    if force.line == "barb":
        rows, along = rows * reach, hat_integrals(columns, *force.span)
    else:
        along = linear_weights(columns, np.array([force.column]))[0]
    weights[:, 0] = rows * along[0]
    weights[:, barb_slice(side, feather.columns)] = rows[:, None] * along[1:]
    return weights


def hat_integrals(knots: Array, start: float, end: float) -> Array:
    """(n,) integrals of the linear hats of ascending knots from start to end."""
    inside = knots[(knots > start) & (knots < end)]
    places = np.concatenate([[start], inside, [end]])
    values = linear_weights(knots, places)
    # linear between all of these places, so the trapezoidal rule is exact
    return np.asarray(0.5 * np.diff(places) @ (values[:-1] + values[1:]))


def force_at(force: Force, time: float) -> Array:
    """(3,) N, or N/m of a line, at a time (s since the first frame): linear between its keys."""
    if not force.keys:
        return force.force
    times, factors = zip(*force.keys, strict=True)
    return force.force * float(np.interp(time, times, factors))


def dead_forces(
    forces: Sequence[tuple[int, Force, Array]],
    feathers: Sequence[Feather],
    start: float,
    end: float,
) -> tuple[Array, Array]:
    """force and force_change of Loads, from (place in the batch, force, its weights)."""
    if not forces:
        return np.zeros((len(feathers), 0, 0, 3)), np.zeros((0, 0, 0, 3))
    force = np.zeros((len(feathers), *feathers[0].rest.nodes.shape))
    change = np.zeros_like(force)
    for place, each, weights in forces:
        before, after = force_at(each, start), force_at(each, end)
        force[place] += weights[..., None] * before
        change[place] += weights[..., None] * (after - before)
    return force, change


def gripped(
    grips: Sequence[tuple[int, Grip]],
    feathers: Sequence[Feather],
    start_points: Sequence[Array],
    start: float,
    end: float,
) -> tuple[Indices, Array, Array, Array]:
    """grip_node, (grip_start, grip_end), grip_stiffness and max_grip_force of Loads (see
    frame_loads)."""
    count = len(feathers)
    most = max(np.bincount([place for place, _ in grips], minlength=count)) if grips else 0
    node = np.full((count, most, 2), -1, dtype=np.int64)
    targets, stiffness = np.zeros((2, count, most, 3)), np.zeros((count, most))
    force = np.full((count, most), np.inf)
    used = [0] * count
    for place, grip in grips:
        g = used[place]
        used[place] += 1
        node[place, g] = grip_node(grip, feathers[place])
        rest = start_points[place][tuple(node[place, g])]
        for k, time in enumerate((start, end)):
            targets[k, place, g] = rest + grip_fraction(grip, time) * grip.displacement
        stiffness[place, g] = grip.stiffness
        if grip.max_force is not None:
            force[place, g] = grip.max_force
    return node, targets, stiffness, force


def grip_fraction(grip: Grip, time: float) -> float:
    """Return how much of a grip's displacement is done at a time (s); no velocity at start and
    end."""
    if grip.end <= grip.start:
        return 1.0 if time >= grip.end else 0.0
    return smooth_step((time - grip.start) / (grip.end - grip.start))


def grip_node(grip: Grip, feather: Feather) -> tuple[int, int]:
    """Row and node that a grip holds."""
    row = round(grip.row * (feather.rows - 1))
    column = round(grip.column * feather.columns)
    if column == 0:
        return row, 0
    return row, (0 if grip.side == "leading" else feather.columns) + column
