"""Root frames at any time: what every source of motion answers, and rates made of it.

The frame loop asks a `Roots` and nothing else. Sources: a skin (skin.py), or joints (joints.py)
whose poses come from a wing beat (beat.py), from keyframes (keys.py), or are held or shaken.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple, Protocol, runtime_checkable

import numpy as np

from featherfx.algebra.types import Array, Indices
from featherfx.shot.clock import FrameCuts

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
