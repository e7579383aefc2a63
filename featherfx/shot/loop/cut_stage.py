"""Roots that jump to another place within a frame, in the frame loop."""

from __future__ import annotations

from featherfx.shot.loop.run import ShotRun, Stage
from featherfx.shot.motion.cuts import cut_roots


class CutStage(Stage):
    """Roots of a shot, as they are where they are cut."""

    def __init__(self, run: ShotRun) -> None:
        super().__init__(run)
        self._motion = run.motion = cut_roots(run.shot, run.motion)

    def begin(self, index: int) -> None:
        """Warn of what is somewhere else right after the sample before."""
        frame, between = divmod(index - 1, self.run.subframes)
        if index > 0 and not between:
            names = [each.id for each in self.run.shot.groom.feathers]
            number = self.run.number(index - 1 + self.run.subframes)
            self._motion.warn(frame, names, number)
