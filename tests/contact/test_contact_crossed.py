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


def test_feathers_that_roots_lead_through_each_other_pass_and_are_named(tmp_path):
    """One lies over the other at rest, and under it where the shot begins."""
    first = FEATHER.format("one", [0, 0, 0], ALONG, UP)
    second = FEATHER.format("two", [0.02, 0.01, 0.012], ALONG, UP) + 'joint = "arm"'
    joint = '[[joint]]\nname = "arm"\nposition = [0, 0, 0]\n'
    (tmp_path / "groom.toml").write_text(f'name = "led"\n{joint}{first}\n{second}\n')
    keys = '{{ time = {}, joint = "arm", position = [0, 0, {}] }}'
    under = f"keyframes = [{keys.format(0, -0.025)}, {keys.format(0.01, -0.0251)}]"
    text = SHOT.replace('motion = "hold"\n', "").replace("[1, 2]", "[1, 4]")
    (tmp_path / "shot.toml").write_text(f'{text}[motion]\nkind = "keys"\n{under}')
    shot = read_shot(tmp_path / "shot.toml")
    simulation, told = (
        simulate(shot, 1),
        "'one' and 'two' are .* mm through .* where the shot begins",
    )
    with pytest.warns(InputWarning, match=told):
        found = [(frame.rows, simulation.checkpoint()) for frame in simulation]
    contact = simulation.report["contact"]
    assert contact["crossed"][0]["depth"] > 0.01
    assert contact["crossed_pairs"] == 1
    assert contact["most_contacts"] == contact["worst_depth"] == 0.0
    # what passed still does in a run that goes on from there
    (again,) = simulate(shot, 1, start=found[2][1], frames=(4, 4))
    assert all(np.array_equal(*pair) for pair in zip(again.rows, found[3][0], strict=True))
