"""Feathers that are directed to be stiffer, calmer or heavier, or to feel more or less of the wind.

With the values of a feather's channels, 1 where there are none:

    moduli of shaft, barbs and vane     stiffness times
    retardation times                   damping / sqrt(stiffness) times, so that the share of the
                                        energy that a swing loses is damping times what it was
    weight                              gravity times: dead forces (gravity - 1) m g
    velocity of the wind                wind times, gusts included

Moduli change from sample to sample; what a bent feather holds then changes with them.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from featherfx.algebra.types import Array, Indices
from featherfx.mechanics.model import Loads, Model
from featherfx.shot.direction.channels import Course, courses, product
from featherfx.shot.types import Shot

NAMES = ("stiffness", "damping", "gravity")
# arrays of a model that are moduli
_MODULI = (
    "rachis_stiffness", "barb_stiffness", "cell_stiffness", "hinge_stiffness", "twist_stiffness",
    "cell_guard",
)  # fmt: skip
# gusts are those of a batch: feathers are put together that feel the same of them, to a part of
_WIND_STEP = 1.0 / 8.0


class Blown:
    """How much of the wind the feathers of a shot feel, by its channels of wind."""

    def __init__(self, shot: Shot) -> None:
        self._found, count = courses(shot, ("wind",)), len(shot.groom.feathers)
        table = [np.round(each.weights / _WIND_STEP) * _WIND_STEP for each in self._found]
        # (F,) of every feather the weights of all channels, in eighths
        self.weights = [tuple(float(weights[f]) for weights in table) for f in range(count)]

    def through(self, loads: Loads, weights: tuple[float, ...], time: float) -> Loads:
        """Loads of a batch that feels the channels by these weights, at a time in s."""
        fraction = 1.0
        for course, weight in zip(self._found, weights, strict=True):
            fraction *= 1.0 + weight * (course.value(time) - 1.0)
        if fraction == 1.0:
            return loads
        return loads._replace(
            wind_mean=fraction * loads.wind_mean, wind_amplitude=fraction * loads.wind_amplitude
        )


def matter_of(found: Sequence[Course], members: Indices, gravity: Array) -> Matter | None:
    """What channels (those of NAMES) make of the matter of a batch, members: (M,) numbers of its
    feathers in the shot; None where none does."""
    own = [each for each in found if each.weights[members].any()]
    return Matter(own, members, gravity) if own else None


class Matter:
    """The matter of a batch of feathers while channels act on it.

    found: those that do. members: (M,) numbers of the feathers in the shot. gravity: (3,) m/s^2.
    """

    def __init__(self, found: Sequence[Course], members: Indices, gravity: Array) -> None:
        self._found, self._members, self._gravity = tuple(found), members, gravity
        names = {each.channel.name for each in found}
        self.changes_model = not names.isdisjoint(("stiffness", "damping"))
        self.changes_weight = "gravity" in names
        self._factors = np.ones((2, len(members)))

    def renew(self, time: float) -> bool:
        """Take the moduli of a time (s since the first frame); whether they are others."""
        before = self._factors
        self._factors = np.stack([self._values(name, time) for name in ("stiffness", "damping")])
        return not np.array_equal(self._factors, before)

    def model(self, model: Model) -> Model:
        """Constant data with the present moduli, from those without channels."""
        stiffness, damping = self._factors
        scaled = {}
        for name in _MODULI:
            values = getattr(model, name)
            scaled[name] = values * stiffness.reshape(-1, *[1] * (values.ndim - 1))
        times = model.retardation * (damping / np.sqrt(stiffness))[:, None]
        return model._replace(retardation=times, **scaled)

    def weighed(self, loads: Loads, mass: Array, start: float, end: float) -> Loads:
        """Loads with what gravity adds from start to end (s). mass: (M, n, 1 + 2 m) kg."""
        if not self.changes_weight:
            return loads
        before, after = (
            ((self._values("gravity", time) - 1.0)[:, None, None] * mass)[..., None] * self._gravity
            for time in (start, end)
        )
        force, change = before, after - before
        if loads.force.size:
            force, change = force + loads.force, change + loads.force_change
        return loads._replace(force=force, force_change=change)

    def _values(self, name: str, time: float) -> Array:
        return product(self._found, name, time, self._members)
