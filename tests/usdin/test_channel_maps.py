"""Channels on a skin: maps that weaken them, and how far a coat is pressed down."""

from dataclasses import replace

import numpy as np
import pytest
from pxr import Gf, UsdGeom, Vt
from usdin_scenes import TYPES, add_mesh, new_stage, sheet, write_shot

import featherfx
from featherfx.errors import InputError
from featherfx.feather.crossings import strips_of
from featherfx.shot.direction.channels import courses
from featherfx.shot.motion.motion import root_motion
from featherfx.shot.patterns import Channel

SKIN = 'usd = "skin.usda"\nprim = "/bird/skin"\ntolerance = 10'
CHANNEL = '\n[[channel]]\nname = "ruffle"\nkeys = [[1, 30]]\nmap = "{}"\n'


def painted(folder):
    """A sheet whose primvar `paint` grows from 0 to 1 along x."""
    stage = new_stage(folder / "skin.usda")
    points, counts, indices = sheet()
    mesh = add_mesh(stage, "/bird/skin", points, counts, indices)
    share = (points[:, 0] - points[:, 0].min()) / np.ptp(points[:, 0])
    api = UsdGeom.PrimvarsAPI(mesh)
    values = Vt.FloatArray.FromNumpy(share.astype(np.float32))
    api.CreatePrimvar("paint", TYPES.FloatArray, "vertex").Set(values)
    st = np.column_stack([np.zeros_like(share), share])
    texture = [Gf.Vec2f(*each) for each in st.tolist()]
    api.CreatePrimvar("st", TYPES.TexCoord2fArray, "vertex").Set(texture)
    stage.Save()
    return points


def weights(shot):
    (course,) = courses(shot, ("ruffle",))
    return course.weights


def test_a_primvar_says_how_far_it_acts(tmp_path):
    points = painted(tmp_path)
    shot = featherfx.read_shot(write_shot(tmp_path, SKIN + CHANNEL.format("paint")))
    x = np.array([each.position[0] for each in shot.groom.feathers])
    share = np.clip((x - points[:, 0].min()) / np.ptp(points[:, 0]), 0.0, 1.0)
    assert np.ptp(share) > 0.1
    assert weights(shot) == pytest.approx(share, abs=1e-6)


def test_a_picture_says_it_as_well(tmp_path):
    image = pytest.importorskip("PIL.Image")
    painted(tmp_path)
    rows = np.linspace(255, 0, 256).astype(np.uint8)
    image.fromarray(np.repeat(rows[:, None], 4, axis=1)).save(tmp_path / "paint.png")
    by_picture = featherfx.read_shot(write_shot(tmp_path, SKIN + CHANNEL.format("paint.png")))
    by_primvar = featherfx.read_shot(write_shot(tmp_path, SKIN + CHANNEL.format("paint")))
    assert weights(by_picture) == pytest.approx(weights(by_primvar), abs=5e-3)


@pytest.mark.parametrize("angle", [2.0, 10.0, 100.0])
def test_a_coat_is_pressed_down_together_and_not_into_its_skin(tmp_path, angle):
    """By one share of what is between each and the skin, which is at most a half."""
    painted(tmp_path)
    path = write_shot(tmp_path, SKIN)
    groom = tmp_path / "groom.toml"
    # the last one steeper
    text = groom.read_text().replace("0, 0.2]", "0, 0.8]").replace("0.3, 0.2]", "0.3, 1.6]")
    groom.write_text(text)
    shot = featherfx.read_shot(path)
    before, left = over_the_sheet(shot), []
    for name, value in (("sleek", angle), ("ruffle", -angle)):
        channel = Channel(name=name, keys=((1, value),))
        turned = root_motion(replace(shot, channels=(channel,))).frames(0.0).rotations
        left.append(over_the_sheet(shot, turned) / before)
    assert left[0] == pytest.approx(left[1])
    assert np.ptp(before) > 0.3
    assert np.ptp(left[0]) < 0.07
    # feathers that sweep to a side come down a little less
    assert left[0].mean() == pytest.approx({2.0: 0.88, 10.0: 0.63, 100.0: 0.5}[angle], abs=0.09)


def over_the_sheet(shot, rotations=None):
    """(F,) rad, angles between feathers, root to tip, and z = 0."""
    feathers = shot.groom.feathers
    if rotations is not None:
        feathers = [replace(f, rotation=r) for f, r in zip(feathers, rotations, strict=True)]
    shaft = strips_of(feathers).shaft
    return np.arcsin(shaft[:, 2] / np.linalg.norm(shaft, axis=1))


@pytest.mark.parametrize(("name", "said"), [("pant", "pant"), ("no.png", "no.png")])
def test_a_map_that_is_not_there_is_one_message(tmp_path, name, said):
    painted(tmp_path)
    with pytest.raises(InputError, match=rf"channel\[0\]\.map: .*{said}") as caught:
        featherfx.read_shot(write_shot(tmp_path, SKIN + CHANNEL.format(name)))
    assert len(caught.value.problems) == 1


def test_a_map_without_a_skin_is_one_message(tmp_path):
    painted(tmp_path)
    shot = write_shot(tmp_path, SKIN)
    text = shot.read_text().replace("[skin]", "[wind]").partition("[wind]")[0]
    shot.write_text(text + CHANNEL.format("paint"))
    with pytest.raises(InputError, match=r"channel\[0\]\.map: .* Add \[skin\]"):
        featherfx.read_shot(shot)
