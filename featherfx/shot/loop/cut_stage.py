"""Cuts of a shot in the frame loop: roots jump, and what was found is told."""

from __future__ import annotations

from typing import Any

from featherfx.errors import warn_input
from featherfx.shot.clock import StageClock
from featherfx.shot.loop.run import ShotRun, Stage
from featherfx.shot.motion.cuts import CutFinder, CutRoots


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
