"""Root frames at any time: what every source of motion answers, and rates made of it.

The frame loop asks a `Roots` and nothing else. Sources: a skin (skin.py), or joints (joints.py)
whose poses come from a wing beat (beat.py), from keyframes (keys.py), or are held or shaken.

The way into a shot: its motion, brought up from rest before the first frame.

A body that moves at the first frame did so before. Over the frames of the preroll it swings from
the pose of the first frame back along the way that leads there, which its samples or their
continuation tell, and forth again to its full speed. So feathers settle in a pose that the shot
has, nothing turns or folds farther back than it goes in a fifth of the preroll, and speed and
acceleration at the end are those of the shot. The way that all roots have in common is no pose,
and to go back on it would be wind from behind: it is gone forwards only, from half a preroll's
length back.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple, Protocol, runtime_checkable

import numpy as np

from featherfx.algebra.types import Array, Indices
from featherfx.shot.frames import FrameCuts

# of a root within an interval
SAMPLES = 5


class Timed(Protocol):
    """A shot as rates see it."""

    @property
    def frames_per_second(self) -> float:
        """Return its frames in a second."""

    @property
    def frame_cuts(self) -> FrameCuts:
        """Return its cuts."""


class RootFrames(NamedTuple):
    """positions: (F, 3) m, rotations: (F, 3, 3) whose columns are the feathers' x, y and z axes, in
    the world; or rates of both."""

    positions: Array
    rotations: Array


class Roots(Protocol):
    """Whatever moves the roots of F feathers."""

    def frames(self, time: float) -> RootFrames:
        """Return where the roots are at a time, s since the first frame."""


@runtime_checkable
class RootsWithCuts(Roots, Protocol):
    """Roots that are somewhere else in no time where the animation is cut (cuts.py)."""

    def after(self, time: float) -> RootFrames:
        """Return where the roots are from a time on; frames tells where they were until then."""


@runtime_checkable
class SeparableRoots(Roots, Protocol):
    """Roots of which some can be moved without the others."""

    def some(self, chosen: Indices) -> Roots:
        """Return those of feathers (K,), by numbers in ascending order."""


@dataclass(frozen=True)
class PickedRoots:
    """Those of the roots of all feathers that have some numbers (K,)."""

    motion: Roots
    chosen: Indices

    def frames(self, time: float) -> RootFrames:
        """Return where they are at a time, s since the first frame."""
        return RootFrames(*(each[self.chosen] for each in self.motion.frames(time)))


def some_roots(motion: Roots, chosen: Indices) -> Roots:
    """Roots of feathers (K,), by numbers in ascending order; without the others where that is
    possible."""
    if isinstance(motion, SeparableRoots):
        return motion.some(chosen)
    return PickedRoots(motion, chosen)


def arrived(motion: Roots, time: float) -> RootFrames:
    """Roots from a time (s) on: after a cut, where there is one."""
    return motion.after(time) if isinstance(motion, RootsWithCuts) else motion.frames(time)


def root_rates(motion: Roots, start: float, end: float) -> tuple[RootFrames, ...]:
    """Root frames at end (s), then their first and second rates.

    Rates are those of the polynomial through evenly spaced frames from `start` on; without a time
    in between, none.
    """
    now = motion.frames(end)
    if not end > start:
        none = RootFrames(*(np.zeros_like(each) for each in now))
        return now, none, none
    times = np.linspace(start, end, SAMPLES)
    samples = [motion.frames(float(time)) for time in times[1:-1]]
    samples = [arrived(motion, start), *samples, now]
    positions, rotations = (
        np.stack([values - values_now for values in column])
        for column, values_now in zip(zip(*samples, strict=True), now, strict=True)
    )
    first, second = (
        RootFrames(np.tensordot(weights, positions, 1), np.tensordot(weights, rotations, 1))
        for weights in end_rates(times)
    )
    return now, first, second


def end_rates(times: Array) -> tuple[Array, Array]:
    """(K,) weights of values at K times that give the first and second rate at the last one."""
    powers = np.vander(times - times[-1], increasing=True)
    inverse = np.linalg.inv(powers)
    return inverse[1], 2.0 * inverse[2]


def sampled_rates(places: Array, frames: Array, shot: Timed) -> tuple[Array, Array]:
    """(K, F, 3) velocities and accelerations of places (K, F, 3) at K frames from 0 s on, between
    the cuts of a shot."""
    cut = map(shot.frame_cuts.between, frames[:-1], frames[1:])
    ends = [0, *(np.flatnonzero(list(cut)) + 1), len(frames)]
    rates = np.zeros((2, *places.shape))
    for low, high in pairwise(ends):
        if high > low + 1:
            times = frames[low:high] / shot.frames_per_second
            rates[0, low:high] = np.gradient(places[low:high], times, axis=0)
            rates[1, low:high] = np.gradient(rates[0, low:high], times, axis=0)
    return rates[0], rates[1]


# of the error tolerance: what moves less before the first frame is at rest
STILL = 1e-3
# of the preroll, how far back the swing goes: -(min of u^3 (-4 + 7 u - 3 u^2)), at u = 2/3
_BACK = 16.0 / 81.0
# of a preroll, the step by which the speed at its end is found
_STEP = 1e-3


class RunUp(NamedTuple):
    """The time in which what moves is brought up from rest.

    duration: s. velocity: (3,) m/s, that all of it has in common at the end. end: s since the first
    frame, 0 or before it.
    """

    duration: float = 0.0
    velocity: tuple[float, float, float] = (0.0, 0.0, 0.0)
    end: float = 0.0

    @property
    def back(self) -> float:
        """Return the time (s) that the swing goes back to."""
        return self.end - _BACK * self.duration

    def own(self, time: float) -> float:
        """Return the time (s) whose pose a body has at a time of the shot.

        From the end on they are the same. Before, it starts and ends there, with rates 0 and 1 and
        no second ones.
        """
        if time >= self.end or self.duration == 0.0:
            return time
        u = self._fraction(time)
        return self.end + self.duration * u**3 * (u * (7.0 - 3.0 * u) - 4.0)

    def shift(self, time: float) -> Array:
        """(3,) m, by which that pose is farther back at a time (s), so that the body flies forwards
        only, at a speed that rises as 10 u^3 - 15 u^4 + 6 u^5."""
        if time >= self.end or self.duration == 0.0:
            return np.zeros(3)
        u = self._fraction(time)
        flown = self.end + self.duration * (u**4 * (2.5 + u * (u - 3.0)) - 0.5)
        return (flown - self.own(time)) * np.array(self.velocity)

    def _fraction(self, time: float) -> float:
        return max(1.0 + (time - self.end) / self.duration, 0.0)


# of what begins at rest
NO_RUN_UP = RunUp()


class RunUpRoots(NamedTuple):
    """Roots whose motion is brought up from rest before the first frame."""

    motion: Roots
    run_up: RunUp

    def frames(self, time: float) -> RootFrames:
        """Return where the roots are at a time, s since the first frame."""
        positions, rotations = self.motion.frames(self.run_up.own(time))
        return RootFrames(positions + self.run_up.shift(time), rotations)

    def some(self, chosen: Indices) -> Roots:
        """Return those of feathers (K,), by numbers in ascending order."""
        return self._replace(motion=some_roots(self.motion, chosen))


def run_up_of(motion: Roots, duration: float, tolerance: float, end: float = 0.0) -> RunUp | None:
    """Find how a motion is brought up within a duration (s) before a time (s, end); None where no
    root moves there by more than a small part of a tolerance (m)."""
    back, middle, last = (
        motion.frames(end - fraction * duration) for fraction in (_BACK, 0.5 * _BACK, 0.0)
    )
    if not any(
        bool(np.abs(now - end).max(initial=0.0) > STILL * tolerance)
        for each in (back, middle)
        for now, end in zip(each, last, strict=True)
    ):
        return None
    step = _STEP * duration
    velocities = (last.positions - motion.frames(end - step).positions) / step
    low, high = velocities.min(axis=0), velocities.max(axis=0)
    x, y, z = np.clip(0.0, low, high).tolist()
    return RunUp(duration, (x, y, z), end)
