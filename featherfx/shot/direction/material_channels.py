"""Feathers that are directed to be stiffer, calmer or heavier, or to feel more or less of the wind.

With the values of a feather's channels, 1 where there are none:

    moduli of shaft, barbs and vane     stiffness times
    dashpots and branches               damping times, so that the share of the energy that a swing
                                        loses is damping times what it was
    weight                              gravity times: dead forces (gravity - 1) m g
    velocity of the wind                wind times, gusts included

Moduli change from sample to sample; what a bent feather holds then changes with them.
"""

from __future__ import annotations

from collections.abc import Hashable, Sequence

import numpy as np

from featherfx.algebra.types import Array, Indices
from featherfx.mechanics.model import Loads, Model
from featherfx.shot.direction.channels import Course, courses, product
from featherfx.shot.loop.groups import FeatherGroup, GroupLoad
from featherfx.shot.loop.run import ShotLoad, ShotRun

_NAMES = ("stiffness", "damping", "gravity")
# arrays of a model that are moduli
_MODULI = (
    "rachis_stiffness", "barb_stiffness", "cell_stiffness", "hinge_stiffness", "twist_stiffness",
    "cell_guard",
)  # fmt: skip
# gusts are those of a batch: feathers are put together that feel the same of them, to a part of
_WIND_STEP = 1.0 / 8.0


class WindLoads(ShotLoad):
    """Parts of the wind that the feathers of a shot feel, by its channels of wind."""

    def __init__(self, run: ShotRun) -> None:
        super().__init__(run)
        self._found, count = courses(run.shot, ("wind",)), len(run.shot.groom.feathers)
        table = [np.round(each.weights / _WIND_STEP) * _WIND_STEP for each in self._found]
        # (F,) of every feather the weights of all channels, in eighths
        self._weights = [tuple(float(weights[f]) for weights in table) for f in range(count)]

    def key(self, feather: int) -> Hashable:
        """Weights of the channels."""
        return self._weights[feather]

    def on(self, group: FeatherGroup) -> GroupLoad | None:
        """The wind that a batch feels."""
        weights = self._weights[group.members[0]]
        return _FeltWind(self._found, weights) if any(weights) else None


class _FeltWind(GroupLoad):
    """The wind on a batch that feels channels by some weights."""

    def __init__(self, found: Sequence[Course], weights: tuple[float, ...]) -> None:
        self._found, self._weights = found, weights

    def added(self, loads: Loads, group: FeatherGroup, start: float, end: float) -> Loads:
        """Loads with the wind that is felt in the middle of a step."""
        time, fraction = 0.5 * (start + end), 1.0
        for course, weight in zip(self._found, self._weights, strict=True):
            fraction *= 1.0 + weight * (course.value(time) - 1.0)
        if fraction == 1.0:
            return loads
        return loads._replace(
            wind_mean=fraction * loads.wind_mean, wind_amplitude=fraction * loads.wind_amplitude
        )


class MaterialLoads(ShotLoad):
    """The channels of stiffness, damping and gravity of a shot."""

    def __init__(self, run: ShotRun) -> None:
        super().__init__(run)
        self._found = courses(run.shot, _NAMES)
        self._gravity = np.asarray(run.shot.gravity)

    def on(self, group: FeatherGroup) -> GroupLoad | None:
        """The material of a batch; None where no channel acts on it."""
        own = [each for each in self._found if each.weights[group.members].any()]
        return DirectedMaterial(own, group.members, self._gravity) if own else None


class DirectedMaterial(GroupLoad):
    """The material of a batch of feathers while channels act on it.

    found: those that do. members: (M,) numbers of the feathers in the shot. gravity: (3,) m/s^2.
    """

    def __init__(self, found: Sequence[Course], members: Indices, gravity: Array) -> None:
        self._found, self._members, self._gravity = tuple(found), members, gravity
        names = {each.channel.name for each in found}
        self.changes_model = not names.isdisjoint(("stiffness", "damping"))
        self._changes_weight = "gravity" in names
        self._factors = np.ones((2, len(members)))

    def renew(self, group: FeatherGroup, start: float, end: float) -> bool:
        """Take the moduli of the end of a step; whether they are others."""
        before = self._factors
        self._factors = np.stack([self._values(name, end) for name in ("stiffness", "damping")])
        return not np.array_equal(self._factors, before)

    def model(self, model: Model) -> Model:
        """Constant data with the present moduli, from those without channels."""
        stiffness, damping = self._factors
        scaled = {}
        for name in _MODULI:
            values = getattr(model, name)
            scaled[name] = values * stiffness.reshape(-1, *[1] * (values.ndim - 1))
        times = model.retardation * damping[:, None]
        weights = model.relaxation_weight * damping[:, None, None]
        return model._replace(retardation=times, relaxation_weight=weights, **scaled)

    def added(self, loads: Loads, group: FeatherGroup, start: float, end: float) -> Loads:
        """Loads with what gravity adds from start to end (s)."""
        if not self._changes_weight:
            return loads
        mass = group.solver.model.mass
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
