"""Cameras of USD stages: where they stand, what they see, and what is refused."""

from dataclasses import replace

import numpy as np
import pytest
from places import SAMPLES
from pxr import Gf, UsdGeom
from usdin_scenes import new_stage, rigid

from featherfx.api import read_shot
from featherfx.errors import InputError
from featherfx.files.disk_cache import shot_settings
from featherfx.shot.sources import relative_sizes

SAMPLE = SAMPLES / "swan_wing" / "shot.toml"


def with_camera(tmp_path, table='usd = "scene.usda"\nprim = "/cam"'):
    text = SAMPLE.read_text().replace("groom.toml", str(SAMPLE.parent / "groom.toml"))
    path = tmp_path / "shot.toml"
    path.write_text(f"{text}\n[level_of_detail]\n{table}\n")
    return read_shot(path)


def write_camera(tmp_path, **space):
    """A camera in cm, y up, 100 m away that comes as near as 10 m in 10 frames."""
    stage = new_stage(tmp_path / "scene.usda", 0.01, "Y", 24.0)
    camera = UsdGeom.Camera.Define(stage, "/cam")
    camera.CreateHorizontalApertureAttr(20.0)
    camera.CreateVerticalApertureAttr(10.0)
    camera.CreateFocalLengthAttr(20.0)
    camera.CreateFocalLengthAttr().Set(40.0, 11.0)
    camera.CreateFocalLengthAttr().Set(20.0, 1.0)
    op = UsdGeom.Xformable(camera).AddTransformOp()
    for code, distance in ((1.0, 10000.0), (11.0, 1000.0)):
        op.Set(Gf.Matrix4d(*rigid(0.0, (0, 1, 0), (0, 0, distance)).ravel().tolist()), code)
    stage.GetRootLayer().Save()
    return stage


def test_a_camera_is_read_in_metres_with_its_motion(tmp_path):
    write_camera(tmp_path)
    shot = with_camera(tmp_path)
    camera = shot.level_of_detail.camera
    first, last = camera.view(0.0), camera.view(10.0 / 24.0)
    # z of a y-up stage points to -y of the world
    assert first.eye == pytest.approx([0.0, -100.0, 0.0])
    assert last.eye == pytest.approx([0.0, -10.0, 0.0])
    assert first.up == pytest.approx([0.0, 0.0, 1.0])
    assert first.back == pytest.approx([0.0, -1.0, 0.0])
    assert (first.width, first.height) == pytest.approx((1.0, 0.5))
    assert (last.width, last.height) == pytest.approx((0.5, 0.25))
    there = np.zeros((1, 3)), np.array([0.3])
    assert relative_sizes(first, *there, 0.0)[0] == pytest.approx(0.3 / 100.0 / 0.5)
    assert relative_sizes(last, *there, 0.0)[0] == pytest.approx(0.3 / 10.0 / 0.25)


def test_the_camera_is_part_of_what_a_bake_depends_on(tmp_path):
    stage = write_camera(tmp_path)
    before = shot_settings(with_camera(tmp_path))
    UsdGeom.Camera.Get(stage, "/cam").GetFocalLengthAttr().Set(50.0, 11.0)
    stage.GetRootLayer().Save()
    after = shot_settings(with_camera(tmp_path))
    changed = [key for key in before if before[key] != after[key]]
    assert changed == ["level_of_detail.camera"]


def test_an_orthographic_camera_has_metres(tmp_path):
    stage = write_camera(tmp_path)
    UsdGeom.Camera.Get(stage, "/cam").CreateProjectionAttr("orthographic")
    stage.GetRootLayer().Save()
    view = with_camera(tmp_path).level_of_detail.camera.view(0.0)
    # apertures are tenths of the unit, here cm
    assert view.orthographic
    assert (view.width, view.height) == pytest.approx((0.02, 0.01))


@pytest.mark.parametrize(
    ("prim", "message"),
    [
        ("/nothing", "no prim /nothing"),
        ("/box", "is no camera in .*. The stage has one camera: /cam"),
    ],
)
def test_what_is_no_camera_is_told(tmp_path, prim, message):
    stage = write_camera(tmp_path)
    UsdGeom.Cube.Define(stage, "/box")
    stage.GetRootLayer().Save()
    with pytest.raises(InputError, match=message):
        with_camera(tmp_path, f'usd = "scene.usda"\nprim = "{prim}"')


def test_a_camera_without_a_picture_is_told(tmp_path):
    stage = write_camera(tmp_path)
    UsdGeom.Camera.Get(stage, "/cam").GetVerticalApertureAttr().Set(0.0)
    stage.GetRootLayer().Save()
    with pytest.raises(InputError, match="verticalAperture: is 0"):
        with_camera(tmp_path)


def test_feathers_out_of_the_picture_are_rigid(tmp_path):
    from featherfx.shot.loop.simulate import simulate

    write_camera(tmp_path)
    table = 'usd = "scene.usda"\nprim = "/cam"\nguided_below = 0\ncoarse_below = 0'
    shot = with_camera(tmp_path, table)
    shot = replace(shot, last_frame=shot.first_frame + 2)
    aside = replace(
        shot.groom,
        feathers=tuple(
            replace(p, position=p.position + np.array([500.0, 0.0, 0.0]))
            for p in shot.groom.feathers
        ),
    )
    simulation = simulate(replace(shot, groom=aside))
    list(simulation)
    assert {each.level for each in simulation.options} == {"rigid"}
