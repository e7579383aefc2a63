"""Time left of frames that are finished while the next are simulated."""

from types import SimpleNamespace

import pytest

from featherfx.baking import pace
from featherfx.baking.pace import Pace

SIMULATE, PART, CORES = 0.4, 0.15, 1.6


@pytest.mark.parametrize("ahead", [0, 6])
def test_what_is_laid_later_is_part_of_the_time_left(ahead, monkeypatch):
    """Samples are taken up at once, and laid for good `ahead` samples later."""
    frames, clock, beside = 20, SimpleNamespace(worked=7.0), SimpleNamespace(processor_seconds=0.0)
    monkeypatch.setattr(pace.time, "process_time", lambda: clock.worked)
    monkeypatch.setattr(pace.time, "perf_counter", lambda: clock.worked / CORES)
    every = frames * (SIMULATE + 2 * PART)
    known, parts, spent = Pace(frames, 2 * frames), 0, 0.0
    for number in range(1, frames + 1):
        clock.worked += SIMULATE
        for _ in range(1 + (number > ahead)):
            clock.worked += PART
            beside.processor_seconds += PART
            parts += 1
        spent = clock.worked - 7.0
        left = known.left(number, parts, beside)
        if number > 2:
            assert left == pytest.approx((every - spent) / CORES)
        else:
            assert left is None
    assert left == pytest.approx(ahead * PART / CORES)


def test_samples_that_only_others_need_are_waited_for(monkeypatch):
    clock, beside = SimpleNamespace(worked=0.0), SimpleNamespace(processor_seconds=0.0)
    monkeypatch.setattr(pace.time, "process_time", lambda: clock.worked)
    monkeypatch.setattr(pace.time, "perf_counter", lambda: clock.worked)
    known = Pace(8 + 12, 0)
    for number in range(1, 9):
        clock.worked += SIMULATE
        left = known.left(number, 0, beside)
    assert left == pytest.approx(12 * SIMULATE)
