"""Two feathers that a groom has through each other by a centimetre come apart, or are named."""

from __future__ import annotations

import warnings
from dataclasses import replace

import numpy as np
import pytest
from shingled import crossings

from featherfx.errors import InputWarning
from featherfx.shot.loop.simulate import simulate
from featherfx.shot.read.read import read_shot

FEATHER = """[[feather]]
id = "{}"
kind = "swan_primary"
position = {}
direction = {}
up = {}
scale = 0.5714
overrides = {{ scaling = "fixed_vane" }}
"""
SHOT = """name = "crossed"
groom = "groom.toml"
frames = [1, 2]
motion = "hold"
wind = "calm"
quality = { base = "draft", rows = 11 }
[contact]
"""
ALONG, UP = [1, 0, 0], [0, 0, 1]
# what the second feather of a pair differs in from one along x: the vanes of two that lie side by
# side are rolled into each other, one lies across the other, one dives through the other's vane
APART = {
    "side by side": ([0, -0.015, -0.013], ALONG, UP, "roll = -27", "roll = 27"),
    "at right angles": ([0.1, -0.1, 0.012], [0, 1, -0.15], UP, "", ""),
    "tip through vane": ([0, 0.004, 0.03], [1, 0, -0.2], UP, "", ""),
}
# one that stands upright in the other: nothing tells which is over which
UPRIGHT = ([0.1, 0.01, 0.1], [0.2, 0, -1], [1, 0, 0.2], "", "")


def shot_of(pair, folder):
    position, direction, up, more, others = pair
    first = FEATHER.format("one", [0, 0, 0], ALONG, UP) + others
    second = FEATHER.format("two", position, direction, up) + more
    (folder / "groom.toml").write_text(f'name = "crossed"\n{first}\n{second}\n')
    (folder / "shot.toml").write_text(SHOT)
    return read_shot(folder / "shot.toml")


@pytest.mark.parametrize(
    "way",
    [
        "side by side",
        "at right angles",
        pytest.param(
            "tip through vane",
            marks=pytest.mark.xfail(strict=True, reason="contact takes a tip in a vane for clear"),
        ),
    ],
)
def test_two_that_begin_a_centimetre_in_each_other_come_apart_or_are_named(way, tmp_path):
    shot = shot_of(APART[way], tmp_path)
    free = next(iter(simulate(replace(shot, contact=None), 1)))
    assert crossings(shot, free) > 0
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        frames = list(simulate(shot, 1))
    named = any("'one'" in str(each.message) and "'two'" in str(each.message) for each in told)
    assert named or [crossings(shot, frame) for frame in frames] == [0, 0]


def test_two_of_which_nothing_tells_which_is_over_which_are_named(tmp_path):
    shot = shot_of(UPRIGHT, tmp_path)
    with pytest.warns(InputWarning, match="contact: feathers 'one' and 'two' pass .* at rest"):
        frames = list(simulate(shot, 1))
    assert crossings(shot, frames[-1]) > 0
    assert all(np.isfinite(points).all() for frame in frames for points in frame.rows)
