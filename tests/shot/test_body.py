"""Bodies that an act carries, and the layer that shows them."""

from __future__ import annotations

import re
import warnings

import numpy as np
import pytest
from bird_of_cubes import CUBE, GROOM, SHOT, TURN, WALK, WAY, write_body
from farm.farm_cases import SerialEngine, options_of
from usd_meshes import SQUARE, define_mesh, new_stage

import featherfx
from featherfx.algebra.vectors import from_angles
from featherfx.baking import pipeline
from featherfx.errors import InputError
from featherfx.farm.job import Job
from featherfx.shot.motion.motion import root_motion
from featherfx.usd.read.cache import Cache
from featherfx.usd.read.contents import find_scenery


@pytest.fixture
def shot(tmp_path):
    (tmp_path / "groom.toml").write_text(GROOM)
    (tmp_path / "shot.toml").write_text(SHOT)
    return tmp_path / "shot.toml"


@pytest.mark.parametrize(
    ("kind", "up", "unit"), [("still", "Z", 1.0), ("points", "Y", 0.01), ("skeleton", "Y", 0.01)]
)
def test_an_act_carries_skin_and_roots_as_one(shot, tmp_path, kind, up, unit):
    write_body(tmp_path / "body.usda", kind, up, unit)
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        read = featherfx.read_shot(shot)
    said = [each for each in told if "without its own animation" in str(each.message)]
    assert len(said) == (kind != "still")
    first, last = (root_motion(read).frames(time) for time in (0.0, 0.25))
    turn = from_angles(TURN, "xyz")
    breast = next(k for k, each in enumerate(read.groom.feathers) if each.id == "breast")
    there = first.positions[breast] @ turn.T + WAY
    np.testing.assert_allclose(last.positions[breast], there, atol=1e-6)
    np.testing.assert_allclose(last.rotations[breast], turn @ first.rotations[breast], atol=1e-6)
    cache = featherfx.bake(read, tmp_path / "out.usdc")
    assert featherfx.check(cache.path) == []
    layer = tmp_path / "out.body.usda"
    for code, (moved, way) in {1.0: (np.eye(3), np.zeros(3)), 7.0: (turn, WAY)}.items():
        (body,) = find_scenery(Cache(cache.path).scenery, cache.path, ["skin"], "drawn")
        assert body.scene.path == layer
        stood = CUBE + (0.0 if kind == "still" else WALK)
        np.testing.assert_allclose(body.points(code), stood @ moved.T + way, atol=1e-6)


def test_the_explanation_tells_how_fast_an_act_moves_a_body(shot, tmp_path):
    write_body(tmp_path / "body.usda", "still")
    _, rates = pipeline.explain_options(shot)
    speed = np.linalg.norm(WAY) / 0.25  # on the average
    assert speed < rates[""]["speed"] < 3.0 * speed
    shot.write_text(re.sub(r"\[motion\].*", "", SHOT, flags=re.DOTALL))
    assert pipeline.explain_options(shot)[1] == {}


def test_a_layer_replaces_no_file_unasked_and_no_skin(shot, tmp_path):
    write_body(tmp_path / "body.usda", "still")
    layer = tmp_path / "out.body.usda"
    layer.write_text("mine")
    with pytest.raises(InputError, match=r"out\.body\.usda"):
        featherfx.bake(shot, tmp_path / "out.usdc")
    assert layer.read_text() == "mine"
    (tmp_path / "body.usda").rename(layer)
    shot.write_text(SHOT.replace("body.usda", "out.body.usda"))
    with pytest.raises(InputError, match=r"out\.body\.usda"):
        featherfx.bake(shot, tmp_path / "out.usdc", overwrite=True)


def test_a_skin_that_moves_the_body_writes_no_layer(shot, tmp_path):
    write_body(tmp_path / "body.usda", "points")
    shot.write_text(SHOT.replace('body = "act"', ""))
    featherfx.bake(shot, tmp_path / "out.usdc")
    assert not list(tmp_path.glob("*.body*.usda"))


FLOOR = """
[[collider]]
usd = "floor.usda"
prims = ["/floor"]
"""


@pytest.mark.parametrize(
    ("low", "away", "said"),
    [
        (-0.031, 0.0, "by 31 mm at frame 4. Give a path"),
        (0.01, 0.0, ""),
        # beside the floor and back, below it
        (-0.031, 1.0, ""),
    ],
)
def test_a_body_that_goes_through_the_floor_is_told(shot, tmp_path, low, away, said):
    """It stands 5 mm within the floor at first, and goes down and up again."""
    write_body(tmp_path / "body.usda", "still")
    stage = new_stage(tmp_path / "floor.usda")
    define_mesh(stage, "/floor", 0.5 * SQUARE - (0, 0, 0.045), scheme=None)
    stage.Save()
    beside = [
        (0.04, (away, 0, 0)),
        (0.125, (away, 0, low)),
        (0.21, (away, 0, 0)),
        (0.25, (0, 0, 0)),
    ]
    keys = [f"{{ time = {time}, position = {list(place)} }}" for time, place in beside]
    start = "keyframes = [{ time = 0, position = [0, 0, 0] }, "
    text = re.sub(r"keyframes = \[\n.*?\n\]", f"{start}{', '.join(keys)}]", SHOT, flags=re.S)
    shot.write_text(text.replace("[motion]", f"{FLOOR}[motion]"))
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        featherfx.read_shot(shot)
    found = [str(each.message) for each in told if "through" in str(each.message)]
    assert [each.partition("/floor, ")[2][: len(said)] for each in found] == [said] * bool(said)


def test_the_body_of_a_take_off_leaves_the_ground(shot, tmp_path):
    """Wings go with it: as a whole the bird is where its act takes it."""
    write_body(tmp_path / "body.usda", "still")
    head = SHOT.partition("[motion]")[0].replace("[1, 7]", "[1, 30]")
    shot.write_text(head + '[motion]\nbase = "take_off"\nfit = "none"\n')
    read = featherfx.read_shot(shot)
    motion = root_motion(read)
    start, end = (motion.frames(time).positions for time in (0.0, 29.0 / 24.0))
    assert (end[:, 2] - start[:, 2]).min() > 0.3
    spread = [np.linalg.norm(each - each.mean(axis=0), axis=1).max() for each in (start, end)]
    assert spread[1] < 3.0 * spread[0]


def test_shares_of_a_bake_have_one_layer_between_them(shot, tmp_path):
    write_body(tmp_path / "body.usda", "still")
    featherfx.bake(shot, tmp_path / "whole.usdc")
    for k in (2, 1):
        featherfx.bake(shot, tmp_path / "out.usdc", feathers=(k, 2))
    pipeline.join(tmp_path / "out.usdc", 2)
    names = [each.name for each in sorted(tmp_path.glob("*.body*.usda"))]
    assert names == ["out.body.usda", "whole.body.usda"]
    texts = [(tmp_path / each).read_text() for each in names]
    assert texts[0] == texts[1]
    (body,) = find_scenery(
        Cache(tmp_path / "out.usdc").scenery, tmp_path / "out.usdc", ["skin"], "drawn"
    )
    assert body.scene.path == tmp_path / "out.body.usda"
    with pytest.raises(InputError, match=r"out\.body\.usda"):
        featherfx.bake(shot, tmp_path / "out.usda")
    (tmp_path / "out.body.usda").write_text("mine")
    with pytest.raises(InputError, match=r"out\.body\.usda"):
        featherfx.bake(shot, tmp_path / "out.usda", feathers=(1, 2))


@pytest.mark.nightly
def test_a_job_leaves_the_layer_beside_its_cache_alone(shot, tmp_path):
    write_body(tmp_path / "body.usda", "still")
    featherfx.bake(shot, tmp_path / "whole.usdc")
    options = options_of(chunk=3, layout="flat")
    out = tmp_path / "out"
    out.mkdir()
    told = Job([shot], [out / "out.usdc"], options, SerialEngine(), 3, lambda *_: None).run()
    assert told
    assert sorted(each.name for each in out.iterdir()) == ["out.body.usda", "out.usdc"]
    find = find_scenery(Cache(out / "out.usdc").scenery, out / "out.usdc", ["skin"], "drawn")
    assert next(iter(find)).scene.path == out / "out.body.usda"
