"""Coefficients that the solver chooses: few where they suffice, more where they are needed."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from places import SAMPLES

from featherfx.shot.loop.simulate import simulate
from featherfx.shot.motion.motion import root_motion
from featherfx.shot.options import resolve_options
from featherfx.shot.read.read import read_shot


def chosen(shot) -> list[int]:
    options = resolve_options(shot, simulate(shot).feathers, root_motion(shot))
    return [each.coefficients for each in options.full]


def with_coefficients(shot, count):
    return replace(shot, quality=replace(shot.quality.pushing, coefficients=count))


def test_a_number_in_the_quality_is_taken_as_it_is():
    shot = with_coefficients(read_shot(SAMPLES / "swan_wing" / "shot.toml"), 3)
    assert chosen(shot) == [3] * len(shot.groom.feathers)


def test_wind_and_softness_ask_for_more():
    shot = with_coefficients(read_shot(SAMPLES / "breeze" / "shot.toml"), -1)
    shot = replace(shot, quality=replace(shot.quality.pushing, tolerance=2e-5))
    calm = replace(shot, wind=replace(shot.wind, speed=0.0))
    assert chosen(shot)[0] > chosen(calm)[0] >= 1


def test_a_grip_asks_for_two():
    shot = with_coefficients(read_shot(SAMPLES / "feather_pull" / "shot.toml"), -1)
    assert chosen(shot) == [2]
    assert chosen(replace(shot, grips=())) == [1]


@pytest.mark.verification
def test_the_choice_is_as_good_as_two_more_coefficients():
    """A plume in the wind: the last frames differ by little more than the tolerance."""
    shot = read_shot(SAMPLES / "breeze" / "shot.toml")
    quality = replace(shot.quality.pushing, rows=11, columns=6, tolerance=1e-3)
    shot = replace(shot, quality=quality, last_frame=shot.first_frame + 8)
    shot = with_coefficients(shot, -1)
    count = chosen(shot)[0]
    ends = [
        list(simulate(with_coefficients(shot, number)))[-1].rows[0] for number in (count, count + 2)
    ]
    length = shot.groom.feathers[0].kind.length
    assert np.linalg.norm(ends[0] - ends[1], axis=-1)[:, [0, *range(3, 15)]].max() < 5e-3 * length
