"""Channels of a shot: what a director asks of some feathers over time.

A channel's value is smooth between its keys (monotone cubic, Fritsch and Carlson 1980, so it stays
between two neighbouring keys), starts and ends without a kick and is constant outside of them. On
feather f it acts as

    neutral + w_f (value - neutral)

neutral: the value that changes nothing. w_f: 1 within the channel; with a soft border it falls
smoothly to 0 at roots that lie nearest to feathers outside, and a map multiplies it.

Channels that act otherwise than asked: on guided and rigid feathers, of which nothing is solved,
and on coats without a skin.
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from featherfx.algebra.interpolation import faded
from featherfx.algebra.types import Array, Indices
from featherfx.errors import InputWarning
from featherfx.groom.skin.field import search_tree
from featherfx.shot.clock import StageClock
from featherfx.shot.options.options import FeatherOptions
from featherfx.shot.patterns import fits
from featherfx.shot.types import CHANNELS, Channel, Shot

if TYPE_CHECKING:
    from scipy.interpolate import CubicHermiteSpline


@dataclass(frozen=True)
class Curve:
    """A value over time. times: (K,) s since the first frame, and values: (K,), of its keys. clock:
    of the shot's cuts, within which a value is that of their ends."""

    times: Array
    values: Array
    clock: StageClock

    @staticmethod
    def of_keys(shot: Shot, keys: Sequence[Sequence[float]]) -> Curve:
        """keys: a frame of a shot and a value each."""
        frames, values = np.array(keys, dtype=np.float64).T
        rate = shot.frames_per_second
        clock = StageClock(0.0, 1.0 / rate, rate, shot.frame_cuts)
        return Curve((frames - shot.first_frame) / rate, values, clock)

    @cached_property
    def _curve(self) -> CubicHermiteSpline:
        # with all of scipy.optimize behind it 12 MiB, which most shots have no use for
        from scipy.interpolate import CubicHermiteSpline, PchipInterpolator

        slopes = PchipInterpolator(self.times, self.values).derivative()(self.times)
        slopes[[0, -1]] = 0.0
        return CubicHermiteSpline(self.times, self.values, slopes)

    def value(self, time: float) -> float:
        """At a time in s."""
        if len(self.times) == 1:
            return float(self.values[0])
        return float(self._curve(min(max(self.clock.held(time), self.times[0]), self.times[-1])))


@dataclass(frozen=True)
class Course:
    """A channel on the feathers of a shot. curve: its value. weights: (F,) w."""

    channel: Channel
    curve: Curve
    weights: Array

    def value(self, time: float) -> float:
        """At a time in s."""
        return self.curve.value(time)

    def of_each(self, time: float) -> Array:
        """(F,) what every feather gets at a time in s."""
        neutral = CHANNELS[self.channel.name].neutral
        return neutral + self.weights * (self.value(time) - neutral)


def courses(shot: Shot, names: Sequence[str]) -> list[Course]:
    """The channels of a shot that have one of some names, in its order."""
    chosen = [each for each in shot.channels if each.name in names]
    return [_course(shot, each) for each in chosen]


def _course(shot: Shot, channel: Channel) -> Course:
    return Course(channel, Curve.of_keys(shot, channel.keys), _weights(shot, channel))


def _weights(shot: Shot, channel: Channel) -> Array:
    inside = np.array([fits(channel, each) for each in shot.groom.feathers], dtype=np.bool_)
    weights = inside.astype(np.float64)
    if channel.factors is not None:
        weights *= [channel.factors[each.id] for each in shot.groom.feathers]
    if channel.soft == 0.0 or inside.all():
        return weights
    roots = np.array([each.position for each in shot.groom.feathers])
    distance, _ = search_tree(roots[~inside]).query(roots[inside])
    weights[inside] *= faded(distance / channel.soft)
    return weights


def acting(shot: Shot) -> list[list[Any]]:
    """List the channels that act on every feather of a shot: name, times, values and weight. A fan
    and a fold depend on all of their feathers."""
    found = courses(shot, tuple(CHANNELS))
    together = [
        [
            (each.position, each.rotation)
            for each, weight in zip(shot.groom.feathers, course.weights, strict=True)
            if weight > 0.0
        ]
        if course.channel.name in ("fan", "fold")
        else []
        for course in found
    ]
    return [
        [
            (each.channel.name, each.curve.times, each.curve.values, float(each.weights[f]), others)
            for each, others in zip(found, together, strict=True)
            if each.weights[f] > 0.0
        ]
        for f in range(len(shot.groom.feathers))
    ]


def product(found: Sequence[Course], name: str, time: float, members: Indices) -> Array:
    """(M,) all channels of a name, whose neutral value is 1, multiplied with each other at a time
    in s; members: (M,) feathers."""
    own = [each.of_each(time)[members] for each in found if each.channel.name == name]
    return np.prod([np.ones(len(members)), *own], axis=0)


# channels that act within the simulation, or on what comes of it
FELT = ("stiffness", "damping", "wind", "gravity", "follow")
# those that raise or turn the leaves of a coat together
_TOGETHER = ("ruffle", "sleek", "turn", "puff")


def warn_of_unfelt(shot: Shot, options: Sequence[FeatherOptions]) -> None:
    """Warn of channels that none of their feathers feels.

    options: of each feather.
    """
    solved = np.array([each.is_simulated for each in options], dtype=np.bool_)
    guided = np.array([each.level == "guided" for each in options], dtype=np.bool_)
    for course in courses(shot, FELT):
        name, own = course.channel.name, course.weights > 0.0
        felt = solved | guided if name == "follow" else solved
        acts = bool((course.curve.values != CHANNELS[name].neutral).any())
        if acts and own.any() and not (own & felt).any():
            number = next(k for k, each in enumerate(shot.channels) if each is course.channel)
            which = "simulated or guided" if name == "follow" else "simulated"
            message = f"none of its {int(own.sum())} feathers is {which}, so none feels {name}"
            message += ". Give them another level in [[detail]]"
            warnings.warn(f"{shot.source}: channel[{number}]: {message}", InputWarning, 2)
    if shot.skin is None and shot.groom.coat is not None:
        coat = np.array([each.leaf is not None for each in shot.groom.feathers], dtype=np.bool_)
        apart = [(course.weights != 0.0) & coat for course in courses(shot, _TOGETHER)]
        if apart and (count := int(np.any(apart, axis=0).sum())):
            warnings.warn(
                f"{shot.source}: channel: {count} feathers of the coat turn one by one and may pass"
                " through each other, as the shot has no [skin]. Add one with the groom's skin",
                InputWarning,
                2,
            )
