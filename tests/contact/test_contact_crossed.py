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
quality = {{ base = "draft", rows = 11 }}
[contact]
forces = {}
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


def shot_of(pair, forces, folder):
    position, direction, up, more, others = pair
    first = FEATHER.format("one", [0, 0, 0], ALONG, UP) + others
    second = FEATHER.format("two", position, direction, up) + more
    (folder / "groom.toml").write_text(f'name = "crossed"\n{first}\n{second}\n')
    (folder / "shot.toml").write_text(SHOT.format(str(forces).lower()))
    return read_shot(folder / "shot.toml")


@pytest.mark.parametrize("forces", [True, False])
@pytest.mark.parametrize("way", APART)
def test_two_that_begin_a_centimetre_in_each_other_come_apart(way, forces, tmp_path):
    shot = shot_of(APART[way], forces, tmp_path)
    free = next(iter(simulate(replace(shot, contact=None, layers=None), 1)))
    assert crossings(shot, free) > 0
    with warnings.catch_warnings():
        # pairs that nothing pushes apart, but that are laid, and what finds no balance
        warnings.filterwarnings("ignore", message="(contact: feathers|settle: feather) '(one|two)'")
        simulation = simulate(shot, 1)
        laid = list(simulation)
    assert [crossings(shot, frame) for frame in laid] == [0, 0]
    assert simulation.report["contact"]["written_depth"]["worst"] < 0.5


@pytest.mark.parametrize(("forces", "what"), [(True, "contact"), (False, "layers")])
def test_two_of_which_nothing_tells_which_is_over_which_are_named(forces, what, tmp_path):
    shot = shot_of(UPRIGHT, forces, tmp_path)
    with pytest.warns(InputWarning, match=f"{what}: feathers 'one' and 'two' pass .* at rest"):
        frames = list(simulate(shot, 1))
    assert crossings(shot, frames[-1]) > 0
    assert all(np.isfinite(points).all() for frame in frames for points in frame.points)
