"""Time left of frames that are finished while the next are simulated."""

from types import SimpleNamespace

import pytest

from featherfx.baking import pace
from featherfx.baking.pace import Pace

SIMULATE, PART, CORES = 0.4, 0.15, 1.6


@pytest.fixture
def clock(monkeypatch):
    """A thread beside, whose seconds pass as it works, and the process, with CORES at a time."""
    known = SimpleNamespace(worked=7.0, seconds=0.0, processor_seconds=0.0)
    monkeypatch.setattr(pace.time, "process_time", lambda: known.worked)
    monkeypatch.setattr(pace.time, "perf_counter", lambda: known.worked / CORES)
    return known


@pytest.mark.parametrize("ahead", [0, 6])
def test_what_is_laid_later_is_part_of_the_time_left(ahead, clock):
    """Samples are taken up at once, and laid for good `ahead` samples later."""
    frames = 20
    known, todo = Pace(frames, 2 * frames), frames * (SIMULATE + 2 * PART)
    for number in range(1, frames + 1):
        parts = 1 + (number > ahead)
        clock.seconds += parts * PART
        clock.processor_seconds += parts * PART
        clock.worked += SIMULATE + parts * PART
        todo -= SIMULATE + parts * PART
        known.simulated += 1
        known.finished += parts
        left = known.left(clock)
        if number > 2:
            # while others are simulated, or with one thread when all are
            after = ahead * PART
            exact = (todo - after) / CORES + after
            assert left == pytest.approx(exact, rel=0.1 if number <= ahead else 1e-9)
        else:
            assert left is None
    assert left == pytest.approx(ahead * PART)


def test_samples_that_only_others_need_are_waited_for(clock):
    known = Pace(8 + 12, 0)
    for _ in range(8):
        clock.worked += SIMULATE
        known.simulated += 1
        left = known.left(clock)
    assert left == pytest.approx(12 * SIMULATE / CORES)
