"""What channels ask of follicles goes as far as feathers that lie on others let it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from shingled import THICKNESS, in_line

import featherfx
from featherfx.errors import InputWarning
from featherfx.shot.loop.simulate import simulate
from featherfx.shot.motion.motion import root_motion
from featherfx.shot.partition.dependence import dependences
from featherfx.shot.types import Channel, Contact, Detail, Layers, Motion

WING = """
name = "bird"
[[wing]]
id = "right_wing"
type = { base = "pigeon", bow = 25, primaries.count = 4, secondaries.count = 4 }
shoulder = [0.03, -0.03, 0.03]
fold = 1
"""
SHOT = """
name = "s"
groom = "groom.toml"
frames = [1, 9]
quality = { base = "draft", rows = 5, columns = 2 }
[contact]
forces = false
[[detail]]
level = "rigid"
[[channel]]
name = "%s"
keys = [[1, 0], [9, %g]]
"""


def row(back: float, *channels: Channel):
    """Two rigid feathers in a line, the first over the second, whose root is so far behind the
    first's, in lengths."""
    length = in_line(1, np.zeros(3), 1).groom.feathers[0].kind.length
    shot = in_line(2, np.array([-back * length, 0.0, 0.0]), 4, rows=11)
    return replace(
        shot,
        motion=Motion("hold", {}),
        details=(Detail(level="rigid"),),
        layers=Layers(Contact(THICKNESS)),
        channels=channels,
    )


def raised(value: float) -> Channel:
    return Channel(name="ruffle", keys=((0.0, 0.0), (4.0, value)))


def test_what_lies_under_a_root_is_raised_less_than_what_stands_there():
    assert root_motion(row(-0.25, raised(40.0))).share == pytest.approx([1.0, 1.0])
    shot = row(0.25, raised(40.0))
    over, under = root_motion(shot).share
    assert over == 1.0
    assert 0.1 < under < 0.9
    with pytest.warns(InputWarning, match=r"channel\[0\]: of 40 degrees of ruffle 1 of 2 feathers"):
        simulation = simulate(shot)
    assert dependences(shot)[1] != dependences(row(-0.25, raised(40.0)))[1]
    assert root_motion(replace(shot, layers=None)).share == pytest.approx([1.0, 1.0])
    for _ in simulation:
        pass
    assert simulation.report["contact"]["written_depth"]["worst"] < 2.0


def test_all_is_left_where_nothing_is_asked_or_lies_on_others():
    assert root_motion(row(0.25, raised(0.0))).share == pytest.approx([1.0, 1.0])
    assert root_motion(row(3.0, raised(40.0))).share == pytest.approx([1.0, 1.0])


def test_a_share_is_that_of_the_worst_key_and_falls_with_it():
    twice = Channel(name="ruffle", keys=((0.0, 20.0), (2.0, 50.0), (4.0, 10.0)))
    worst = Channel(name="ruffle", keys=((0.0, 50.0),))
    shares = [root_motion(row(0.25, each)).share[1] for each in (raised(30.0), twice, worst)]
    assert shares[0] > shares[1] == pytest.approx(shares[2])


def test_feathers_that_turn_into_each_other_turn_less():
    shot = row(0.0, Channel(name="turn", keys=((0.0, 60.0),)))
    feathers = list(shot.groom.feathers)
    width = 0.1 * feathers[0].kind.length
    apart = [np.array([0.0, side * width, -1e-3]) for side in (1.0, -1.0)]
    shares = []
    for place in apart:
        moved = replace(feathers[1], position=feathers[0].position + place)
        groom = replace(shot.groom, feathers=(feathers[0], moved))
        shares.append(root_motion(replace(shot, groom=groom)).share.min())
    # turned about its shaft, each opens from the one at one side, and goes into that at the other
    assert max(shares) > min(shares)
    assert min(shares) < 0.9


@pytest.mark.parametrize(("name", "value"), [("ruffle", 60.0), ("sleek", 60.0)])
def test_a_folded_wing_goes_as_far_as_its_layers_hold_as_a_whole(tmp_path, name, value):
    (tmp_path / "groom.toml").write_text(WING)
    (tmp_path / "shot.toml").write_text(SHOT % (name, value))
    share = root_motion(featherfx.read_shot(tmp_path / "shot.toml")).share
    assert 0.0 < share[0] < 1.0
    assert share == pytest.approx(share[0])
    (tmp_path / "shot.toml").write_text(SHOT % (name, 2.0))
    assert root_motion(featherfx.read_shot(tmp_path / "shot.toml")).share == pytest.approx(1.0)
