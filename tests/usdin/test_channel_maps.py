"""Channels that a map on the skin weakens."""

import numpy as np
import pytest
from pxr import Gf, UsdGeom, Vt
from usdin_scenes import TYPES, add_mesh, new_stage, sheet, write_shot

import featherfx
from featherfx.errors import InputError
from featherfx.shot.direction.channels import courses

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


@pytest.mark.parametrize(("name", "said"), [("pant", "pant"), ("no.png", "no.png")])
def test_a_map_that_is_not_there_is_one_message(tmp_path, name, said):
    painted(tmp_path)
    with pytest.raises(InputError, match=said) as caught:
        featherfx.read_shot(write_shot(tmp_path, SKIN + CHANNEL.format(name)))
    assert len(caught.value.problems) == 1


def test_a_map_without_a_skin_is_one_message(tmp_path):
    painted(tmp_path)
    shot = write_shot(tmp_path, SKIN)
    text = shot.read_text().replace("[skin]", "[wind]").partition("[wind]")[0]
    shot.write_text(text + CHANNEL.format("paint"))
    with pytest.raises(InputError, match=r"channel\[0\]\.map: .* no \[skin\]"):
        featherfx.read_shot(shot)
