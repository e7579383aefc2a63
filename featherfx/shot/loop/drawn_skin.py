"""Roots on the skin that a renderer draws, in what is written.

Roots are simulated on a skin that moves smoothly between its own frames. A renderer draws it as its
stage has it, points along straight lines from sample to sample. Between own frames feathers are
therefore shifted, each as a whole, by what is between their roots on the one and on the other.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from featherfx.algebra.types import Array
from featherfx.feather.types import RowPoints
from featherfx.shot.frames import FeatherPose
from featherfx.shot.loop.run import ShotRun, Stage
from featherfx.shot.motion.motion import uncut_motion
from featherfx.shot.roots import RootFrames, arrived
from featherfx.shot.skin import BoundSkin

_STEP = 1e-3  # frames, over which the rate of shifts is found


class DrawnSkinStage(Stage):
    """Feathers whose roots stand on the skin as it is drawn."""

    def __init__(self, run: ShotRun) -> None:
        super().__init__(run)
        skin, self._shown = run.shot.skin, None
        self._largest: tuple[float, int, float] = 0.0, 0, float(run.shot.first_frame)
        if not isinstance(skin, BoundSkin):
            return
        if any(part.surface.knots is not None for part in skin.parts):
            drawn = skin.led(lambda each: each.smoothed(None), skin.clock)
            self._shown, self._clock = uncut_motion(replace(run.shot, skin=drawn)), skin.clock

    def show(self, time: float, poses: list[FeatherPose]) -> list[FeatherPose]:
        """Shift feathers to the skin as it is drawn; with several samples a frame, their rates so
        that they go on along its straight lines."""
        run, place = self.run, time * self.run.shot.frames_per_second
        own = 0.0 if self._shown is None else self._clock.own(place)
        is_own = abs(own - round(own)) < 1e-6
        if self._shown is None or (is_own and run.subframes == 1):
            return poses
        shifts, rates = self._shifts(time, run.motion.frames(time)), np.zeros((len(poses), 3))
        if run.subframes > 1:
            step = _STEP / run.shot.frames_per_second
            later = self._shifts(time + step, run.motion.frames(time + step))
            rates = (later - self._shifts(time, arrived(run.motion, time))) / step
        sizes = np.linalg.norm(shifts, axis=1)
        if len(sizes) and sizes.max() > self._largest[0]:
            number = run.shot.first_frame + place
            self._largest = float(sizes.max()), int(sizes.argmax()), round(number, 6)
        return [
            _shifted(pose, shift, rate)
            for pose, shift, rate in zip(poses, shifts, rates, strict=True)
        ]

    def _shifts(self, time: float, roots: RootFrames) -> Array:
        """(P, 3) m, from the roots of the wanted feathers to those on the skin that is drawn."""
        assert self._shown is not None
        return (self._shown.frames(time).positions - roots.positions)[self.run.wanted]

    def report(self) -> dict[str, Any]:
        """Largest shift of a feather, m, with its id and frame."""
        distance, k, frame = self._largest
        if distance == 0.0:
            return {}
        feather = self.run.shot.groom.feathers[self.run.wanted[k]].id
        return {"drawn_skin": {"distance": distance, "feather": feather, "frame": frame}}


def _shifted(pose: FeatherPose, shift: Array, rate: Array) -> FeatherPose:
    velocities = RowPoints(pose.velocities.nodes + rate, pose.velocities.directors)
    return replace(pose, points=pose.points.shifted(shift), velocities=velocities)
