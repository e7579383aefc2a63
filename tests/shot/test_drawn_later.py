"""Frames that are drawn once the simulation has gone on."""

from pathlib import Path

import numpy as np
import pytest

from featherfx import read_shot
from featherfx.shot.loop.simulate import simulate

SAMPLES = Path(__file__).parents[2] / "samples"


@pytest.mark.parametrize("sample", ["breeze", "flapping_bird"])
def test_a_frame_drawn_after_later_samples_is_that_of_its_time(sample):
    shot = read_shot(SAMPLES / sample / "shot.toml").with_quality("draft")
    last = shot.first_frame + 2
    at_once = [frame.rows for frame in simulate(shot, frames=(shot.first_frame, last))]
    samples = simulate(shot, frames=(shot.first_frame, last)).samples()
    later = [draw().rows for draw, _ in list(samples)]
    moved = max(np.abs(a - b).max() for a, b in zip(at_once[0], at_once[-1], strict=True))
    assert moved > 1e-6
    for before, after in zip(at_once, later, strict=True):
        for own, other in zip(before, after, strict=True):
            np.testing.assert_array_equal(own, other)
