"""Pictures: what is drawn, where and in which colours, and what goes wrong with a clear word."""

from __future__ import annotations

import os
import subprocess
import sys

import feathers
import numpy as np
import pytest
from PIL import Image
from pxr import Usd, UsdGeom, Vt

from featherfx.errors import InputError
from featherfx.render.geometry import DrawnPose, load_pose, load_scene
from featherfx.render.options import _COLOURS, _VIEWS
from featherfx.render.picture import render
from featherfx.render.subject import (
    Bar,
    Legend,
    linear,
    look_colours,
    strain_across_barbs,
    value_colours,
)
from featherfx.render.tracer import backdrop
from featherfx.usd.read.cache import Cache
from featherfx.usd.write.cache_writer import CacheWriter
from featherfx.usd.write.options import WriteOptions

pytest.importorskip("embreex", reason="no wheel for this platform")

SIZE = (240, 160)


def pixels(path) -> np.ndarray:
    return np.asarray(Image.open(path).convert("RGB")).astype(int)


def drawn(picture: np.ndarray) -> np.ndarray:
    """Where a picture differs from what is behind all."""
    rows, columns = picture.shape[:2]
    behind = 255 * backdrop(columns, 0, rows, rows)
    return np.abs(picture - behind).sum(axis=2) > 12


@pytest.mark.parametrize("colour", _COLOURS)
def test_every_colour_draws_something_and_adds_its_key(tmp_path, cache, colour):
    (path,) = render(cache, tmp_path / "a.png", frames=[3], size=SIZE, colour=colour, samples=4)
    picture = pixels(path)
    assert picture.shape[1] == SIZE[0]
    assert (picture.shape[0] > SIZE[1]) == (colour != "shaded")
    assert 0.05 < drawn(picture[: SIZE[1]]).mean() < 0.9


@pytest.mark.parametrize(("view", "axis"), [*((view, "Y") for view in _VIEWS), ("side", "Z")])
def test_views_frame_all_feathers_and_do_not_depend_on_units(tmp_path, cache, view, axis):
    other = tmp_path / "other.usdc"
    with CacheWriter(
        other, feathers.entries(), (1, 5), options=WriteOptions(meters_per_unit=0.01, up_axis=axis)
    ) as writer:
        for number in range(1, 6):
            writer.write(feathers.frame(number))
    pictures = []
    for name, source in (("a.png", cache), ("b.png", other)):
        options = {"frames": [5], "size": SIZE, "view": view, "framing": "drawn", "samples": 4}
        pictures.append(pixels(render(source, tmp_path / name, **options)[0]))
    assert np.abs(pictures[0] - pictures[1]).mean() < 0.5
    inside = drawn(pictures[0])
    assert inside.any()
    border = [inside[0], inside[-1], inside[:, 0], inside[:, -1]]
    assert not np.concatenate(border).any()
    filled = [np.ptp(np.flatnonzero(inside.any(axis=k))) / SIZE[k] for k in (0, 1)]
    assert max(filled) > 0.8


def test_barb_angle_is_that_of_the_feather_in_any_pose(cache):
    source = Cache(cache)
    scene = load_scene(source)
    poses = [scene.rest, load_pose(source, scene, 5.0)]
    _, key = value_colours(scene, poses, "barb")
    assert isinstance(key, Bar)
    assert "deg" in key.title
    assert (key.low, key.high) == pytest.approx((44, 46), abs=0.01)


def test_region_colours_have_a_legend_of_all_regions(cache):
    scene = load_scene(Cache(cache))
    colours, key = look_colours(scene, "region")
    assert isinstance(key, Legend)
    assert [name for name, _ in key.entries] == ["body", "left wing", "tail"]
    np.testing.assert_allclose(colours[2], linear(np.array(key.entries[0][1])))


@pytest.mark.parametrize("stretch", [0.8, 1.0, 1.3])
def test_strain_across_barbs_of_a_known_stretch(stretch):
    """Barbs at 30 degrees to x, the plane stretched across them and turned in space."""
    angle = np.radians(30)
    along = np.array([np.cos(angle), np.sin(angle), 0])
    across = np.array([-np.sin(angle), np.cos(angle), 0])
    rest = np.random.default_rng(1).normal(size=(9, 3)) * (1, 1, 0)
    pulled = (
        rest
        + (stretch - 1) * np.outer(rest @ across, across)
        + 0.3 * np.outer(rest @ across, along)
    )
    turn = np.linalg.qr(np.random.default_rng(2).normal(size=(3, 3)))[0]
    triangles = np.arange(9).reshape(3, 3)
    found = strain_across_barbs(rest, pulled @ turn, triangles, np.tile(along, (3, 1)))
    np.testing.assert_allclose(found, 0.5 * (stretch**2 + 0.3**2 - 1), atol=1e-12)


def test_rigid_motion_shows_no_strain_and_a_bend_does(cache):
    source = Cache(cache)
    scene = load_scene(source)
    pose = load_pose(source, scene, 5.0)
    stretched = DrawnPose(pose.points * (1.02, 1, 1), pose.normals, pose.barbs, pose.hooked)
    keys = [value_colours(scene, [p], "strain")[1] for p in (pose, stretched)]
    assert keys[0].high < 0.01
    # Barbs at 45 degrees see half of (1.02^2 - 1) / 2 = 2.02 %, less the tilt of the feather.
    assert 0.8 < keys[1].high < 1.1


def test_a_sheet_has_a_tile_per_frame(tmp_path, cache):
    (path,) = render(cache, tmp_path / "sheet.png", size=(120, 80), sheet=True, samples=4)
    picture = pixels(path)
    assert picture.shape == (2 * 80 + 2, 3 * 120 + 4, 3)
    first, last = picture[:80, :120], picture[82:162, 122:242]
    moved = np.abs(first - last)[20:].max(axis=2) > 20
    assert np.count_nonzero(moved) > 20
    assert not moved[~(drawn(first) | drawn(last))[20:]].any()
    assert (picture[82:162, 244:] == 255).all()


def test_several_frames_give_several_files(tmp_path, cache):
    written = render(cache, tmp_path / "a.png", frames=[1, 2.5], size=(64, 48), samples=1)
    assert [path.name for path in written] == ["a.0001.png", "a.0002.500.png"]
    assert sorted(p.name for p in tmp_path.iterdir()) == ["a.0001.png", "a.0002.500.png"]


def test_the_same_picture_every_time(tmp_path, cache):
    one, two = (
        render(cache, tmp_path / f"{jobs}.png", frames=[2], size=(64, 48), jobs=jobs)[0]
        for jobs in (1, 3)
    )
    assert one.read_bytes() == two.read_bytes()


def test_a_rest_groom_without_frames(tmp_path):
    with CacheWriter(tmp_path / "rest.usda", feathers.entries(), None):
        pass
    (path,) = render(tmp_path / "rest.usda", tmp_path / "rest.png", size=(64, 48))
    assert drawn(pixels(path)).any()
    with pytest.raises(InputError, match="no frames"):
        render(tmp_path / "rest.usda", tmp_path / "rest.png", frames=[1], size=(64, 48))


def test_a_feather_of_any_size_is_drawn(tmp_path, cache):
    """A damaged point makes it 1e37 long, and its barbs beyond number."""
    stage = Usd.Stage.CreateNew(str(tmp_path / "far.usda"))
    stage.GetRootLayer().TransferContent(Usd.Stage.Open(str(cache)).Flatten())
    mesh = next(UsdGeom.Mesh(prim) for prim in stage.Traverse() if prim.IsA(UsdGeom.Mesh))
    points = np.array(mesh.GetPointsAttr().Get(2))
    points[-1] = 1e37
    mesh.GetPointsAttr().Set(Vt.Vec3fArray.FromNumpy(points), 2)
    stage.Save()
    (path,) = render(tmp_path / "far.usda", tmp_path / "far.png", frames=[2], size=(64, 48))
    assert pixels(path).shape == (48, 64, 3)


def test_a_plain_mesh_of_another_program(tmp_path):
    (tmp_path / "quad.usda").write_text(
        """#usda 1.0
(defaultPrim = "a")
def Xform "a" (kind = "component") {
    double3 xformOp:translate = (5, 0, 0)
    uniform token[] xformOpOrder = ["xformOp:translate"]
    def Mesh "quad" {
        int[] faceVertexCounts = [4]
        int[] faceVertexIndices = [0, 1, 2, 3]
        point3f[] points.timeSamples = {3: [(0,0,0), (1,0,0), (1,1,0), (0,1,0)]}
    }
}
"""
    )
    for colour in _COLOURS:
        file = tmp_path / f"{colour}.png"
        (path,) = render(tmp_path / "quad.usda", file, size=(64, 48), colour=colour)
        assert drawn(pixels(path)).mean() > 0.2


def test_pictures_replace_nothing_unasked_and_no_pipe(tmp_path, cache):
    path, numbered = tmp_path / "a.png", tmp_path / "a.0002.png"
    numbered.write_bytes(b"mine")
    with pytest.raises(InputError, match=r"a\.0002\.png: exists already"):
        render(cache, path, frames=[1, 2], size=(32, 32))
    assert [each.name for each in tmp_path.iterdir()] == ["a.0002.png"]
    files = render(cache, path, frames=[1, 2], size=(32, 32), overwrite=True)
    assert files == [tmp_path / "a.0001.png", numbered]
    assert numbered.read_bytes() != b"mine"
    os.mkfifo(path)
    with pytest.raises(InputError, match="no regular file"):
        render(cache, path, frames=[1], size=(32, 32), overwrite=True)


def test_all_wrong_options_are_named_at_once(tmp_path, cache):
    with pytest.raises(InputError) as caught:
        render(
            tmp_path / "no.usd", tmp_path / "no" / "a.jpg", size=(0, 9999), colour="red", view="up",
            samples=7, f_stop=-1.0, turntable=-1, framing="loose",
        )  # fmt: skip
    messages = str(caught.value)
    for part in (
        "'red'", "'up'", "'7'", "'loose'", "f_stop: -1", "turntable: -1", "0 x 9999", ".jpg",
        "folder does not exist", "no.usd",
    ):  # fmt: skip
        assert part in messages
    with pytest.raises(InputError, match=r"frame: 9 is out of range\. Give 1 to 5"):
        render(cache, tmp_path / "a.png", frames=[9], size=SIZE)


def test_missing_libraries_are_named(tmp_path, cache, monkeypatch):
    monkeypatch.setattr("featherfx.render.options.importlib.util.find_spec", lambda name: None)
    with pytest.raises(InputError, match=r'pip install "featherfx\[preview\]"'):
        render(cache, tmp_path / "a.png")


def test_a_disk_error_leaves_no_picture(tmp_path, cache, monkeypatch):
    def full(self, path, **options):
        path.write_bytes(b"half")
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Image.Image, "save", full)
    with pytest.raises(InputError, match=r"a\.png: cannot be written: No space left"):
        render(cache, tmp_path / "a.png", frames=[1], size=(64, 48))
    assert list(tmp_path.iterdir()) == []


def test_import_is_light():
    code = (
        "import sys, featherfx.render.options;"
        "sys.exit(any(m in sys.modules for m in ('pxr', 'embreex', 'PIL', 'scipy')))"
    )
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
