"""Flocks: paths, birds that are near, replays, and the stage that shows them."""

from __future__ import annotations

import json
import shutil
import warnings

import numpy as np
import pytest
from commands import invoke
from places import COARSE, SAMPLES
from pxr import Gf, Usd, UsdGeom

import featherfx
from featherfx.api import scene_readers
from featherfx.errors import InputError, InputWarning
from featherfx.shot.flock import GRAVITY, Spline, bird_poses
from featherfx.shot.read.flock import read_flock

GROOM = """
name = "bird"
[[feather]]
id = "left"
kind = "contour"
position = [0.3, 0.1, 0.2]
direction = [0, 1, 0]
up = [0, 0, 1]
[[feather]]
id = "tail"
kind = "contour"
position = [0.1, 0, 0.2]
direction = [-1, 0, 0]
up = [0, 0, 1]
"""
# turns up to 20 degrees once in eight frames
BIRD = (
    """
name = "bird"
groom = "groom.toml"
frames = [1, 9]
frames_per_second = 24
cycle = 8
motion = { kind = "swing", axis = [1, 0, 0], angle = 20, frequency = 3, start = -1 }
"""
    + COARSE
)
RIGID = BIRD + '[[detail]]\nlevel = "rigid"\n'
FLOCK = """
name = "flock"
frames = [1, 7]
[camera]
usd = "camera.usda"
prim = "/camera"
near_above = 220
far_below = 20
[[flock]]
shot = "bird.toml"
birds = 6
seed = 4
spread = [3, 2, 1]
path = [[0, 0, 0, 5], [2, 4, 0.5, 5.5], [4, 7, 2.5, 6]]
"""
EYE = Gf.Vec3d(2.0, -6.0, 5.0)


def write_camera(path, eye=EYE):
    stage = Usd.Stage.CreateNew(str(path))
    stage.SetMetadata("metersPerUnit", 1.0)
    UsdGeom.SetStageUpAxis(stage, "Z")
    camera = UsdGeom.Camera.Define(stage, "/camera")
    view = Gf.Matrix4d().SetLookAt(eye, Gf.Vec3d(2.5, 0.5, 5.2), Gf.Vec3d(0, 0, 1))
    camera.AddTransformOp().Set(view.GetInverse())
    stage.GetRootLayer().Save()


@pytest.fixture
def folder(tmp_path):
    for name, text in {"groom": GROOM, "bird": RIGID, "flock": FLOCK}.items():
        (tmp_path / f"{name}.toml").write_text(text)
    write_camera(tmp_path / "camera.usda")
    return tmp_path


def bake(folder, **options):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", InputWarning)
        return featherfx.bake_flock(folder / "flock.toml", folder / "out.usda", **options)


def shown_points(stage, bird, frame):
    """Points of all meshes of a bird by feather, world, as a reader of the stage sees them."""
    found = {}
    prims = Usd.PrimRange(stage.GetPrimAtPath(f"/out/{bird}"), Usd.TraverseInstanceProxies())
    for prim in prims:
        if not prim.IsA(UsdGeom.Mesh):
            continue
        matrix = np.array(UsdGeom.Xformable(prim).ComputeLocalToWorldTransform(frame))
        points = np.array(UsdGeom.Mesh(prim).GetPointsAttr().Get(frame), dtype=float)
        found[prim.GetName()] = points @ matrix[:3, :3] + matrix[3, :3]
    return found


def test_rigid_birds_are_where_their_paths_have_them(folder):
    """Near birds and replays show one motion: a replay of what is rigid is exact.

    A point x of the bird goes to R (T x - m) + p with the swing T, the path's turn R and place p,
    and m the middle of the bird's roots.
    """
    report = bake(folder)
    assert min(report["birds"].values()) >= 1
    stage = Usd.Stage.Open(str(folder / "out.usda"))
    flock = read_flock(folder / "flock.toml", (), scene_readers())
    rest = featherfx.read_shot(folder / "bird.toml").groom.feathers
    roots = np.array([each.position for each in rest])
    for bird in flock.birds:
        prim = stage.GetPrimAtPath(f"/out/{bird.name}")
        assert prim.GetCustomDataByKey("featherfx:way") == bird.way
        assert prim.IsInstance() is (bird.way != "near")
        for frame in (1, 4, 7):
            time = (frame - 1) / 24.0
            angle = np.radians(20.0) * np.sin(2 * np.pi * 3.0 * (time + bird.phase / 24.0))
            swing = np.array(
                [[1, 0, 0], [0, np.cos(angle), -np.sin(angle)], [0, np.sin(angle), np.cos(angle)]]
            )
            (turn,), (place,) = bird_poses(
                bird.path, np.array([1.0, 0, 0]), roots.mean(axis=0), np.array([time])
            )
            expected = roots @ swing.T @ turn.T + place
            shown = shown_points(stage, bird.name, frame)
            every = np.concatenate(list(shown.values()))
            nearest = np.linalg.norm(every[:, None] - expected, axis=2).min(axis=0)
            # roots are within the width of a calamus of points of the mesh
            assert nearest.max() < 2e-3


def test_groups_have_birds_and_paths_of_their_own(folder):
    glide = RIGID.replace('name = "bird"', 'name = "glide"').replace("angle = 20", "angle = 0")
    (folder / "glide.toml").write_text(glide)
    second = '[[flock]]\nshot = "glide.toml"\nbirds = 2\nseed = 1\nspread = [1, 1, 1]\n'
    path = "path = [[0, 0, 3, 9], [4, -7, 3, 9]]\n"
    first = FLOCK.replace("birds = 6", "birds = 2")
    first = first[: first.index("[camera]")] + first[first.index("[[flock]]") :]
    (folder / "flock.toml").write_text(first + second + path)
    bake(folder)
    stage = Usd.Stage.Open(str(folder / "out.usda"))
    shown = {prim.GetName() for prim in stage.GetPrimAtPath("/out").GetChildren()}
    assert shown == {"bird_1_0001", "bird_1_0002", "bird_2_0001", "bird_2_0002"}
    before, after = (shown_points(stage, "bird_2_0001", frame) for frame in (1, 7))
    # wings held still, 1.75 m/s against x
    for name, points in before.items():
        np.testing.assert_allclose(
            after[name] - points, [[-1.75 * 0.25, 0, 0]] * len(points), atol=1e-4
        )


def test_replays_repeat_the_loop_of_a_simulated_bird(folder):
    (folder / "bird.toml").write_text(BIRD)
    (folder / "flock.toml").write_text(FLOCK.replace("near_above = 220", "near_above = 1e5"))
    report = bake(folder)
    gap = report["loop_gaps"]["bird_1_middle_1.usdc"]
    assert 0.0 <= gap < 10.0
    stage = Usd.Stage.Open(str(folder / "out.usda"))
    cache = featherfx.open_cache(folder / "out.birds" / "bird_1_middle_1.usdc")
    first, last = cache.frames
    assert last - first == 8
    flock = read_flock(folder / "flock.toml", (), scene_readers())
    middle = next(each for each in flock.birds if each.way == "middle")
    for frame in (1, 3, 6):
        there = first + (middle.phase + frame - 1) % 8
        prim = stage.GetPrimAtPath(f"/out/{middle.name}")
        matrix = np.array(UsdGeom.Xformable(prim).ComputeLocalToWorldTransform(frame))
        own = cache["tail"].points(there) @ matrix[:3, :3] + matrix[3, :3]
        np.testing.assert_allclose(shown_points(stage, middle.name, frame)["tail"], own, atol=2e-6)


def test_a_near_bird_bends_in_the_wind_of_its_flight_as_its_replay_does(folder):
    (folder / "bird.toml").write_text(BIRD)
    report = bake(folder)
    assert report["replay_error"]["percent_p50"] < 5.0
    assert report["replay_error"]["distance"] < 0.01


def test_the_same_flock_has_the_same_bytes_and_takes_what_is_done(folder):
    bake(folder)
    first = (folder / "out.usda").read_bytes()
    times = {each: each.stat().st_mtime_ns for each in (folder / "out.birds").glob("*.usdc")}
    with pytest.raises(InputError, match="exists"):
        bake(folder)
    report = bake(folder, resume=True)
    assert (folder / "out.usda").read_bytes() == first
    assert times == {each: each.stat().st_mtime_ns for each in times}
    assert all(each["samples_taken_over"] for each in report["caches"].values())


def test_a_bird_banks_by_the_balance_of_a_level_turn():
    """On a circle of radius r at speed v: tan(bank) = v^2 / (g r), the inner wing down."""
    speed, radius = 10.0, 20.0
    times = np.linspace(0.0, 4.0, 81)
    angle = speed / radius * times
    circle = radius * np.stack([np.sin(angle), -np.cos(angle), 0.0 * angle], axis=1)
    turn = Spline.through(times, circle).turns(np.array([2.0]))[0]
    bank = np.arctan2(turn[2, 1], turn[2, 2])
    assert np.tan(bank) == pytest.approx(-(speed**2) / (GRAVITY * radius), rel=1e-3)
    np.testing.assert_allclose(turn.T @ turn, np.eye(3), atol=1e-12)
    np.testing.assert_allclose(turn[:, 0], [np.cos(1.0), np.sin(1.0), 0.0], atol=1e-4)


def test_paths_go_straight_on_outside_of_their_keys():
    path = Spline.through(np.array([0.0, 1.0, 2.0]), np.array([[0, 0, 0], [1, 1, 0], [3, 1, 1.0]]))
    ends, beyond = path.positions(np.array([0.0, 2.0])), path.positions(np.array([-1.0, 3.0]))
    rates = path.velocities(np.array([-1.0, 3.0]))
    np.testing.assert_allclose(beyond, ends + [[-1.0], [1.0]] * rates)


def test_points_of_an_instancer_carry_birds(folder):
    stage = Usd.Stage.CreateNew(str(folder / "points.usda"))
    stage.SetMetadata("metersPerUnit", 0.01)
    UsdGeom.SetStageUpAxis(stage, "Y")
    points = UsdGeom.PointInstancer.Define(stage, "/birds")
    points.CreateIdsAttr([7, 9])
    quarter = Gf.Quath(0.5**0.5, 0.0, 0.5**0.5, 0.0)  # about the stage's y, so the world's z
    for frame in range(1, 8):
        points.CreatePositionsAttr().Set([(100.0 * frame, 0, 0), (0, 200.0, -100.0 * frame)], frame)
        points.CreateOrientationsAttr().Set([Gf.Quath(1.0), quarter], frame)
    stage.GetRootLayer().Save()
    keys = 'usd = "points.usda"\nprim = "/birds"'
    text = FLOCK[: FLOCK.index("[camera]")] + f'[[flock]]\nshot = "bird.toml"\n{keys}\n'
    (folder / "flock.toml").write_text(text)
    flock = read_flock(folder / "flock.toml", (), scene_readers())
    assert [each.name for each in flock.birds] == ["bird_1_0007", "bird_1_0009"]
    at = np.array([0.125])
    np.testing.assert_allclose(flock.birds[0].path.positions(at), [[4.0, 0, 0]], atol=1e-5)
    np.testing.assert_allclose(flock.birds[1].path.positions(at), [[0, 4.0, 2.0]], atol=1e-5)
    turn = flock.birds[1].path.turns(at)[0]
    np.testing.assert_allclose(turn, [[0, -1, 0], [1, 0, 0], [0, 0, 1]], atol=2e-3)


MISTAKES = {
    "no length": ("[2, 4, 0.5, 5.5], [4, 7, 2.5, 6]", "[2, 0, 0, 5]", "path: has no length"),
    "order": ("[2, 4", "[0, 4", r"path\[1\]: 0 s is not later than 0 s"),
    "no path": ("path = [[", "# [[", "needs either a path, or usd and prim"),
    "no bird": ("birds = 6", "birds = 0", "birds: 0 is out of range. Give 1 to 100000"),
    "limits": ("far_below = 20", "far_below = 300", "300 is above near_above = 220"),
    "rate": ("frames = [1, 7]", "frames = [1, 7]\nframes_per_second = 30", "24 frames per second"),
    "camera": ('prim = "/camera"', 'prim = "/cam"', "no prim /cam"),
    "shot": ('"bird.toml"', '"birb.toml"', "birb.toml: there is no such file"),
    "forward": ("birds = 6", "birds = 6\nforward = [0, 0, 1]", "forward: is not level"),
    "frames": ("frames = [1, 7]", "frames = [7, 1]", "the last frame comes before the first"),
}


@pytest.mark.parametrize("mistake", MISTAKES)
def test_mistakes_are_one_message(folder, mistake):
    before, after, told = MISTAKES[mistake]
    assert before in FLOCK
    (folder / "flock.toml").write_text(FLOCK.replace(before, after))
    result = invoke("bake", folder / "flock.toml", "-o", folder / "out.usda")
    assert result.exit_code == 1
    assert result.stderr.count("featherfx: ") == 1
    with pytest.raises(InputError, match=told):
        bake(folder)
    assert not (folder / "out.birds").exists()


def test_birds_in_one_place_and_a_camera_in_a_bird_are_told(folder):
    (folder / "flock.toml").write_text(FLOCK.replace("spread = [3, 2, 1]", ""))
    with pytest.warns(InputWarning, match="6 birds are in others, bird_1_0001 and"):
        read_flock(folder / "flock.toml", (), scene_readers())
    (folder / "flock.toml").write_text(FLOCK.replace("birds = 6", "birds = 1"))
    (folder / "camera.usda").unlink()
    write_camera(folder / "inside.usda", Gf.Vec3d(0.0, 0.02, 5.0))
    text = FLOCK.replace("birds = 6", "birds = 1").replace("camera.usda", "inside.usda")
    (folder / "flock.toml").write_text(text)
    with pytest.warns(InputWarning, match="is inside of bird_1_0001 in frame 1"):
        read_flock(folder / "flock.toml", (), scene_readers())


def test_a_full_disk_is_told_before(folder, monkeypatch):
    monkeypatch.setattr("shutil.disk_usage", lambda path: type("", (), {"free": 1000})())
    with pytest.raises(InputError, match=r"caches need some 0\.0 GB.*near_above"):
        bake(folder)
    assert not (folder / "out.birds").exists()


def test_a_loop_that_does_not_close_is_told(folder):
    (folder / "bird.toml").write_text(RIGID.replace("cycle = 8", "cycle = 3"))
    with pytest.warns(InputWarning, match="jump by .* where its loop of 3 frames ends"):
        featherfx.bake_flock(folder / "flock.toml", folder / "out.usda")


def test_other_commands_say_what_a_flock_is(folder):
    flock = folder / "flock.toml"
    assert invoke("check", flock).exit_code == 0
    assert "is a flock" in invoke("stats", flock).stderr
    assert "has no [[flock]]" in invoke("bake", folder / "bird.toml", "--birds", "3").stderr
    with pytest.raises(InputError, match="is a flock"):
        featherfx.read_shot(flock)


def test_the_sample_is_sound():
    shot = SAMPLES / "flock/shot.toml"
    assert invoke("check", shot).exit_code == 0
    flock = read_flock(shot, (), scene_readers(), birds=20)
    ways = [each.way for each in flock.birds]
    assert {"near", "middle", "far"} == set(ways)
    assert ways.count("near") <= 3


def test_some_frames_are_those_of_the_whole(folder):
    bake(folder)
    whole = Usd.Stage.Open(str(folder / "out.usda"))
    names = [each.GetName() for each in whole.GetPrimAtPath("/out").GetChildren()]
    before = {name: shown_points(whole, name, 5) for name in names}
    del whole
    bake(folder, frames=(4, 6), overwrite=True)
    part = Usd.Stage.Open(str(folder / "out.usda"))
    part.Reload()
    for name in names:
        for feather, points in shown_points(part, name, 5).items():
            np.testing.assert_allclose(points, before[name][feather], atol=1e-6)


def test_the_command_takes_birds_and_frames(folder):
    result = invoke(
        *("bake", folder / "flock.toml", "--birds", 2, "--frames", "2-5"),
        *("-o", folder / "out.usda", "--report", folder / "report.json"),
    )
    assert result.exit_code == 0, result.stderr
    report = json.loads((folder / "report.json").read_text())
    assert sum(report["birds"].values()) == 2
    stage = Usd.Stage.Open(str(folder / "out.usda"))
    assert (stage.GetStartTimeCode(), stage.GetEndTimeCode()) == (2, 5)


def test_shares_and_a_plan_make_the_same_stage(folder):
    bake(folder)
    whole = (folder / "out.usda").read_bytes()
    for file in (folder / "out.usda", *(folder / "out.birds").glob("*")):
        file.unlink() if file.is_file() else shutil.rmtree(file)
    command = ("bake", folder / "flock.toml", "-o", folder / "out.usda")
    for share in ("1/2", "2/2"):
        told = invoke(*command, "--feathers", share)
        assert told.exit_code == 0, told.stderr
        assert "the stage is not written" in told.stderr
        assert not (folder / "out.usda").exists()
    assert invoke(*command, "--resume").exit_code == 0
    assert (folder / "out.usda").read_bytes() == whole
    assert invoke(*command, "--plan", 2).exit_code == 0
    items = json.loads((folder / "out.plan.json").read_text())["items"]
    assert [each["after"] for each in items] == [[], [], ["bake_1", "bake_2"]]
    assert {"--resume", "bake"} <= set(items[-1]["command"])
    assert "--feathers" not in items[-1]["command"]
