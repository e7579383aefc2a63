"""Channels of a shot: what a director asks of some feathers over time.

A channel's value is smooth between its keys (monotone cubic, Fritsch and Carlson 1980, so it stays
between two neighbouring keys), starts and ends without a kick and is constant outside of them. On
feather f it acts as

    neutral + w_f (value - neutral)

neutral: the value that changes nothing. w_f: 1 within the channel; with a soft border it falls
smoothly to 0 at roots that lie nearest to feathers outside, and a map multiplies it.

Channels that act otherwise than asked: on guided and rigid feathers, of which nothing is solved,
and on coats without a skin.

Feathers that are directed to be stiffer, calmer or heavier, or to feel more or less of the wind.

With the values of a feather's channels, 1 where there are none:

    moduli of shaft, barbs and vane     stiffness times
    dashpots and branches               damping times, so that the share of the energy that a swing
                                        loses is damping times what it was
    weight                              gravity times: dead forces (gravity - 1) m g
    velocity of the wind                wind times, gusts included

Moduli change from sample to sample; what a bent feather holds then changes with them.

Follow-through: how much of what is simulated is shown.

The share of the channels `follow` scales the small turns that a feather deviates from its rest
shape by: 0 is the rest shape on its moving root, 1 what was simulated.

Feathers that are shown with other turns than those of their poses.

A feather is taken apart as those that guide others are (detail/guided.py): turns from row to row,
of the rachis' chords and of the barbs' segments, against its rest shape. A rule changes these small
turns, and the chain is put together again on its moving root. So nothing is stretched.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from featherfx.algebra.interpolation import faded
from featherfx.algebra.types import Array, Indices
from featherfx.errors import warn_input
from featherfx.feather.types import RowPoints, both, stacked
from featherfx.groom.skin.field import search_tree
from featherfx.mechanics.model import Loads, Model
from featherfx.shot.detail.guided import INSTANT, Shapes, Turns, in_world, rates_of, seen_from_roots
from featherfx.shot.frames import FeatherPose, StageClock
from featherfx.shot.loop.groups import FeatherGroup, GroupLoad
from featherfx.shot.loop.run import ShotLoad, ShotRun, Stage
from featherfx.shot.options import FeatherOptions
from featherfx.shot.patterns import CHANNELS, Channel, fits, last_fitting
from featherfx.shot.types import Shot

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
            warn_input(f"{shot.source}: channel[{number}]: {message}")
    if shot.skin is None and shot.groom.coat is not None:
        coat = np.array([each.leaf is not None for each in shot.groom.feathers], dtype=np.bool_)
        apart = [(course.weights != 0.0) & coat for course in courses(shot, _TOGETHER)]
        if apart and (count := int(np.any(apart, axis=0).sum())):
            warn_input(
                f"{shot.source}: channel: {count} feathers of the coat turn one by one and may pass"
                " through each other, as the shot has no [skin]. Add one with the groom's skin"
            )


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


# turns that are shown at a time (s), from those of the poses
TurnRule = Callable[[Turns, float], Turns]


class ShownTurns:
    """Feathers whose turns a rule changes. members: (M,) their numbers. shapes: at rest."""

    def __init__(self, run: ShotRun, members: Indices) -> None:
        self._run, self.members = run, members
        placements = run.shot.groom.feathers
        mirrored = [placements[f].mirrored for f in members]
        self.shapes = Shapes([run.drawn[f] for f in members], mirrored)

    def change(self, index: int, poses: dict[int, FeatherPose], rule: TurnRule) -> None:
        """Change the poses of the members at a sample."""
        start, end = self._run.time(index - 1), self._run.time(index)
        taken = [poses[f] for f in self.members.tolist()]
        world = [
            stacked([getattr(pose, name) for pose in taken])
            for name in ("points", "velocities", "accelerations")
        ]
        roots = rates_of(self._run.motion, self.members, start, end)
        local = self._changed(seen_from_roots(world, roots), start, end, rule)
        points, velocities, accelerations = in_world(local, roots)
        for place, f in enumerate(self.members.tolist()):
            poses[f] = poses[f]._replace(
                points=points.at(place),
                velocities=velocities.at(place),
                accelerations=accelerations.at(place),
            )

    def _changed(
        self, local: Sequence[RowPoints], start: float, end: float, rule: TurnRule
    ) -> list[RowPoints]:
        """Points and their first and second rates in root frames."""
        h = INSTANT * (end - start)

        def at(step: float) -> RowPoints:
            moved = both(lambda x, v, a: x + step * v + 0.5 * step * step * a, *local)
            return self.shapes.posed(rule(self.shapes.turns(moved), end + step))

        before, now, after = at(-h), at(0.0), at(h)
        return [
            now,
            both(lambda a, b: (a - b) / (2.0 * h), after, before),
            both(lambda a, x, b: (a - 2.0 * x + b) / (h * h), after, now, before),
        ]


def scaled_turns(turns: Turns, fractions: Array) -> Turns:
    """Turns of F feathers times fractions (F,)."""
    along = turns.along * fractions[:, None, None]
    return Turns(along, turns.barbs * fractions[:, None, None, None, None])


class FollowThrough(Stage):
    """The feathers of a shot of which another part of the simulated motion is shown."""

    def __init__(self, run: ShotRun) -> None:
        super().__init__(run)
        shot, shown = run.shot, run.wanted
        warn_of_unfelt(shot, run.options.feathers)
        self._found = courses(shot, ("follow",))
        acted_on = np.zeros(len(run.drawn), dtype=np.bool_)
        for each in self._found:
            acted_on |= each.weights > 0.0
        # what flies by itself has no root that it could follow
        acted_on &= np.array(last_fitting(shot.detachments, shot.groom.feathers)) < 0
        members = shown[acted_on[shown]]
        self._shown = ShownTurns(run, members) if len(members) else None

    def follow(self, index: int, poses: dict[int, FeatherPose]) -> None:
        """Change the poses of those that are shown by their part at a sample."""
        if (shown := self._shown) is None:
            return
        shown.change(
            index,
            poses,
            lambda turns, time: scaled_turns(
                turns, product(self._found, "follow", time, shown.members)
            ),
        )
