"""Stages of moving skins: cuts at which roots jump, and roots on the skin that a renderer draws.

Roots are simulated on a skin that moves smoothly between its own frames. A renderer draws it as its
stage has it, points along straight lines from sample to sample. Between own frames feathers are
therefore shifted, each as a whole, by what is between the points of the one and of the other below
their roots. Faces may collapse there, as those of a skin that is cut to a half turn do.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from featherfx.algebra.types import Array
from featherfx.errors import warn_input
from featherfx.feather.types import RowPoints
from featherfx.shot.frames import FeatherPose, StageClock
from featherfx.shot.loop.run import ShotRun, Stage
from featherfx.shot.motion.cuts import CutFinder, CutRoots
from featherfx.shot.skin import BoundSkin


class CutStage(Stage):
    """Roots of a shot, as they are where it is cut."""

    def __init__(self, run: ShotRun) -> None:
        super().__init__(run)
        self._cuts = run.shot.frame_cuts
        clock = StageClock(0.0, 1.0, run.shot.frames_per_second, self._cuts)
        run.motion = CutRoots(run.motion, clock)
        self._numbers: list[float] = []

    def begin(self, index: int) -> None:
        """Warn of a cut that was found right after the sample before."""
        frame, between = divmod(index - 1, self.run.subframes)
        if (
            index <= -self.run.shot.handles * self.run.subframes
            or between
            or not self._cuts.is_cut(frame)
        ):
            return
        number = self.run.number(index - 1 + self.run.subframes)
        self._numbers.append(number)
        if not isinstance(self._cuts, CutFinder) or (cut := self._cuts.found[frame]) is None:
            return
        more = f" and {cut.more} more" if cut.more else ""
        warn_input(
            f"{self.run.shot.source}: {cut.name}{more}: cut to another place at frame {number:g}, "
            f"{cut.way:.3g} m away. Feathers are carried along, without that speed. Give "
            f"cuts = [{number:g}] if that is right, cuts = [] if it is a motion"
        )

    def report(self) -> dict[str, Any]:
        """Frames at which the shot is cut."""
        return {"cuts": list(self._numbers)}


_STEP = 1e-3  # frames, over which the rate of the smooth skin is found


class DrawnSkinStage(Stage):
    """Feathers whose roots stand on the skin as it is drawn."""

    def __init__(self, run: ShotRun) -> None:
        super().__init__(run)
        skin = run.shot.skin
        self._largest: tuple[float, int, float] = 0.0, 0, float(run.shot.first_frame)
        self._skins: tuple[BoundSkin, BoundSkin] | None = None
        if isinstance(skin, BoundSkin) and any(each.surface.knots for each in skin.parts):
            self._skins = skin, skin.led(lambda each: each.smoothed(None), skin.clock)

    def show(self, time: float, poses: list[FeatherPose]) -> list[FeatherPose]:
        """Shift feathers to the skin as it is drawn; with several samples a frame, their rates so
        that they go on along its straight lines."""
        run, place = self.run, time * self.run.shot.frames_per_second
        if self._skins is None:
            return poses
        smooth, drawn = self._skins
        own = smooth.clock.own(place)
        if abs(own - round(own)) < 1e-6 and run.subframes == 1:
            return poses
        shifts = (drawn.carriers(time) - smooth.carriers(time))[run.wanted]
        rates = np.zeros_like(shifts)
        if run.subframes > 1 and run.rates:
            step = _STEP / run.shot.frames_per_second
            # stages interpolate in single precision: as long a step as has one straight line
            half = 0.5 * run.time(1)
            here, middle, end = (drawn.carriers(time + k * half) for k in range(3))
            onwards = (4.0 * middle - 3.0 * here - end) / (2.0 * half)
            # feathers arrive with the speed that the smooth skin has until then
            arrived = (smooth.carriers(time) - smooth.carriers(time - step)) / step
            rates = (onwards - arrived)[run.wanted]
        sizes = np.linalg.norm(shifts, axis=1)
        if len(sizes) and sizes.max() > self._largest[0]:
            number = run.shot.first_frame + place
            self._largest = float(sizes.max()), int(sizes.argmax()), round(number, 6)
        return [
            _shifted(pose, shift, rate)
            for pose, shift, rate in zip(poses, shifts, rates, strict=True)
        ]

    def report(self) -> dict[str, Any]:
        """Largest shift of a feather, m, with its id and frame."""
        distance, k, frame = self._largest
        if distance == 0.0:
            return {}
        feather = self.run.shot.groom.feathers[self.run.wanted[k]].id
        return {"drawn_skin": {"distance": distance, "feather": feather, "frame": frame}}


def _shifted(pose: FeatherPose, shift: Array, rate: Array) -> FeatherPose:
    velocities = RowPoints(pose.velocities.nodes + rate, pose.velocities.directors)
    return pose._replace(points=pose.points.shifted(shift), velocities=velocities)
