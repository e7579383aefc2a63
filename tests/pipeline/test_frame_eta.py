"""Time left of frames that are finished while the next are simulated."""

from types import SimpleNamespace

import pytest

from featherfx.baking import frame_loop
from featherfx.baking.frame_loop import FrameEta

SIMULATE, PART, CORES = 0.4, 0.15, 1.6


@pytest.fixture
def clock(monkeypatch):
    """A thread beside, whose seconds pass as it works, and the process, with CORES at a time."""
    known = SimpleNamespace(worked=7.0, seconds=0.0, processor_seconds=0.0)
    monkeypatch.setattr(frame_loop.time, "process_time", lambda: known.worked)
    monkeypatch.setattr(frame_loop.time, "perf_counter", lambda: known.worked / CORES)
    return known


@pytest.mark.parametrize("ahead", [0, 6])
def test_what_is_laid_later_is_part_of_the_time_left(ahead, clock):
    """Samples are taken up at once, and laid for good `ahead` samples later."""
    frames = 20
    known, todo = FrameEta(frames, 2 * frames), frames * (SIMULATE + 2 * PART)
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
    known = FrameEta(8 + 12, 0)
    for _ in range(8):
        clock.worked += SIMULATE
        known.simulated += 1
        left = known.left(clock)
    assert left == pytest.approx(12 * SIMULATE / CORES)


# s of processor time of the samples of two bakes as they were recorded: a wing beat with contact,
# and a vane that is torn, up to where it sleeps
FLAPPING = [
    0.25, 0.27, 0.33, 0.45, 0.51, 0.85, 1.06, 0.67, 0.51, 0.49, 0.48, 0.41, 0.49, 0.36, 0.35, 0.42,
    0.39, 0.36, 0.36, 0.37, 0.36, 0.34, 0.33, 0.38, 0.31, 0.3, 0.31, 0.32, 0.29, 0.35, 0.33, 0.36,
    0.32, 0.35, 0.35, 0.35,
]  # fmt: skip
TEARING = [
    0.02, 0.01, 0.0, 0.41, 0.57, 0.25, 0.23, 0.27, 0.31, 0.15, 0.21, 0.18, 0.34, 0.18, 0.14, 0.12,
    0.1, 0.11, 0.43, 0.4, 0.35, 0.22, 0.21, 0.49, 0.25, 0.2, 0.17, 0.12, 0.12, 0.12, 0.12, 0.15,
    0.35, 0.22, 0.17, 0.11, 0.15, 0.2, 0.2, 0.12, 0.11, 0.12, 0.13, 0.15, 0.13, 0.14, 0.1, 0.13,
    0.14, 0.1, 0.1, 0.11, 0.09, 0.09, 0.09, 0.11, 0.1, 0.15, 0.14, 0.1, 0.1, 0.13, 0.1, 0.1, 0.1,
    0.11, 0.1, 0.09, 0.12, 0.13, 0.11, 0.1, 0.12, 0.11, 0.14, 0.12, 0.13, 0.14, 0.12, 0.12, 0.1,
    0.1,
]  # fmt: skip


@pytest.mark.parametrize("costs", [FLAPPING, TEARING])
@pytest.mark.parametrize("waiting", [0.0, 1.0])
def test_time_left_is_right_to_a_factor_of_two_after_the_first_tenth(costs, waiting, clock):
    """Of what is recorded, laid 6 samples later, beside a thread that waits for the interpreter for
    a part of the time. The first sample, in which all settles, is not of it."""
    part, ahead, frames = 0.01, 6, len(costs) + 1
    known, ratios, todo = FrameEta(frames, 2 * frames), [], []
    for number, cost in enumerate([0.0, *costs], 1):
        parts = 1 + (number > ahead)
        clock.worked += cost + parts * part
        clock.processor_seconds += parts * part
        clock.seconds += parts * part + waiting * cost / CORES
        known.simulated += 1
        known.finished += parts
        todo.append((known.left(clock), clock.worked))
    for left, then in todo[frames // 10 :]:
        exact = (clock.worked - then + ahead * part) / CORES
        ratios.append((left + 0.1) / (exact + 0.1))
    assert 0.5 < min(ratios) < max(ratios) < 2.0


def test_what_is_left_is_never_less_than_nothing(clock):
    """Where all is done, what is laid last is told once more."""
    known = FrameEta(3, 6)
    for _ in range(5):
        clock.worked += SIMULATE
        clock.processor_seconds += PART
        known.simulated += 1
        known.finished += 2
        left = known.left(clock)
    assert left == 0.0
