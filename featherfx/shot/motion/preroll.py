"""The way into a shot: its motion, brought up from rest before the first frame.

A body that moves at the first frame did so before. Over the frames of the preroll it goes along the
way that leads there, which its samples or their continuation tell, from rest half a preroll back
to its full speed: slowly at first, with the speed, acceleration and rate of acceleration of the
shot at its end. Feathers settle where that begins, and arrive in motion.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from featherfx.shot.motion.roots import RootFrames, Roots

# of the error tolerance: what moves less before the first frame is at rest
_STILL = 1e-3


def run_up(time: float, duration: float) -> float:
    """The time (s) of a motion at a time of the shot, which starts from rest `duration` before 0.

    From 0 on they are the same; the rate between them rises as 10 x^3 - 15 x^4 + 6 x^5.
    """
    if time >= 0.0 or duration == 0.0:
        return time
    x = max(1.0 + time / duration, 0.0)
    return duration * (x**4 * (2.5 + x * (x - 3.0)) - 0.5)


@dataclass(frozen=True)
class RunUp:
    """Roots whose motion is brought up from rest within `duration` (s) before the first frame."""

    motion: Roots
    duration: float

    def frames(self, time: float) -> RootFrames:
        """Where the roots are at a time, s since the first frame."""
        return self.motion.frames(run_up(time, self.duration))


def moves_before(motion: Roots, duration: float, tolerance: float) -> bool:
    """Whether any root moves within `duration` (s) before the first frame by more than a small
    part of a tolerance (m)."""
    first, middle, last = (motion.frames(-fraction * duration) for fraction in (1.0, 0.5, 0.0))
    return any(
        bool(np.abs(now - end).max(initial=0.0) > _STILL * tolerance)
        for each in (first, middle)
        for now, end in zip(each, last, strict=True)
    )
