"""Time codes of stages over a shot: a frame is the time code of its number."""

from __future__ import annotations

from dataclasses import dataclass

MIN_RATE, MAX_RATE = 1.0, 1000.0  # 1/s, frames of a shot


@dataclass(frozen=True)
class StageClock:
    """Time codes of a stage over a shot. start: time code at the first frame. step: time codes of a
    frame. frames_per_second: 1/s, of the shot."""

    start: float = 0.0
    step: float = 1.0
    frames_per_second: float = 1.0

    def code(self, time: float) -> float:
        """Return the time code at a time in s since the first frame."""
        return self.start + time * self.frames_per_second * self.step
