"""Clocks of the stages of a shot: what a frame is where rates differ.

A stage may have other time codes per second than the shot has frames. Then the key `time` says
which of two readings holds:

    "codes"     frame N is time code N
    "seconds"   frame N is time code N T / F, as USD scales the time of layers of other rates

T: time codes per second of the stage. F: frames per second of the shot. Both are one where T and F
differ by less than the rounding of rates such as 24000/1001.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from featherfx.groom.keys.problems import Place
from featherfx.shot.clock import MAX_RATE, MIN_RATE, StageClock

if TYPE_CHECKING:
    from featherfx.shot.sources import OfScene

DEFAULT_RATE = 24.0  # 1/s, where neither shot nor stage gives one
# of a rate: a quarter of what is between 24 and 24000/1001, above the rounding of 23.98
_RATE_TOLERANCE = 2.5e-4


def _differ(source: OfScene, rate: float) -> bool:
    own = source.time_codes_per_second
    return abs(own - rate) > _RATE_TOLERANCE * rate and source.sampled is not None


def check_rate(source: OfScene, rate: float, at: Place) -> None:
    """Problems where the rates of shot and stage differ."""
    if _differ(source, rate) and source.has_rate:
        at.fail(
            f"{source.path} has {source.time_codes_per_second:g} time codes a second, the shot "
            f'{rate:g} frames_per_second. Give it as many, or time = "codes", frame N is time '
            'code N, or time = "seconds", as USD composes layers of other rates'
        )


@dataclass
class ClockReader:
    """Clocks of the stages of a shot, made in the order in which it reads them.

    first_frame: of the shot. frames_per_second: as given; None: those of the first stage.
    written_rate: time codes per second of what is written, so that it stands on its skin where both
    are composed in one stage.
    """

    first_frame: int
    frames_per_second: float | None
    written_rate: float | None = None

    def clock(self, source: OfScene, entry: dict[str, Any], at: Place) -> StageClock:
        """Make the clock of a stage by keys `time` and `start` of an entry; problems where the
        rates of shot and stage differ and nothing says what a frame is."""
        own = source.time_codes_per_second
        rate = self._rate(own, at)
        differ = _differ(source, rate)
        if entry["time"] is None:
            check_rate(source, rate, at)
        step = own / rate if differ and entry["time"] == "seconds" else 1.0
        if self.written_rate is None:
            self.written_rate = own / step if source.sampled is not None else rate
        start = self.first_frame * step if entry["start"] is None else entry["start"]
        return StageClock(float(start), step, rate)

    def _rate(self, own: float, at: Place) -> float:
        """Return frames per second, given or of a stage with its own time codes per second."""
        if self.frames_per_second is None:
            if not MIN_RATE <= own <= MAX_RATE:
                at.refuse(
                    f"has {own:g} time codes a second, which are no frames. Give frames_per_second "
                    'to the shot and time = "codes" or "seconds" here'
                )
            self.frames_per_second = own
        return self.frames_per_second
