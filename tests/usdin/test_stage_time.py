"""A frame is the time code of its number: what is written stands on its skin in one stage."""

from __future__ import annotations

import numpy as np
import pytest
from pxr import Sdf, Usd, UsdGeom
from usdin_scenes import add_matrix, add_mesh, lifted, new_stage, rigid, sheet, vec, write_shot

import featherfx
from featherfx.errors import InputError

SKIN = 'usd = "skin.usda"\nprim = "/skin"\n'
NTSC = 24000.0 / 1001.0
ROOTS_ABOVE = 2e-3  # m, at most, of the groom over its skin


def write_skin(folder, rate, codes=range(-5, 40)):
    """A sheet that rises ever faster, and turns; rate None: the stage gives none."""
    stage = new_stage(folder / "skin.usda", 1.0, "Z", rate or 24.0)
    if rate is None:
        stage.ClearMetadata("timeCodesPerSecond")
    points, counts, quads = sheet()
    mesh = add_mesh(stage, "/skin", points, counts, quads)
    for code in codes:
        angle = 0.02 * code
        turn = np.array([[np.cos(angle), np.sin(angle), 0], [-np.sin(angle), np.cos(angle), 0]])
        moved = np.column_stack([points[:, :2] @ turn[:, :2], points[:, 2]])
        mesh.GetPointsAttr().Set(vec(lifted(moved, 1e-3 * code**2)), code)
    stage.Save()


def root_gaps(cache, skin, codes, offset=0.0, skin_path="/skin"):
    """(K, F) m, from the roots of a cache to where they are bound on the skin, in one stage."""
    whole = Sdf.Layer.CreateAnonymous(".usda")
    whole.timeCodesPerSecond = Sdf.Layer.FindOrOpen(str(cache)).timeCodesPerSecond
    whole.subLayerPaths = [str(cache), str(skin)]
    whole.subLayerOffsets[1] = Sdf.LayerOffset(offset)
    stage = Usd.Stage.Open(whole)
    body, gaps = UsdGeom.Mesh(stage.GetPrimAtPath(skin_path)), []
    for code in codes:
        points = np.array(body.GetPointsAttr().Get(code), dtype=float)
        matrix = np.array(UsdGeom.Xformable(body).ComputeLocalToWorldTransform(code))
        points = points @ matrix[:3, :3] + matrix[3, :3]
        gaps.append([])
        for prim in stage.Traverse():
            api = UsdGeom.PrimvarsAPI(prim)
            if not prim.IsA(UsdGeom.Mesh) or not api.HasPrimvar("featherId"):
                continue
            weights = np.array(api.GetPrimvar("skinBarycentric").Get())
            corners = np.array(api.GetPrimvar("skinPoints").Get())
            local = np.array(prim.GetAttribute("points").Get(code), dtype=float)
            own = np.array(UsdGeom.Xformable(prim).ComputeLocalToWorldTransform(code))
            local = local @ own[:3, :3] + own[3, :3]
            place = weights @ points[corners]
            gaps[-1].append(np.linalg.norm(local - place, axis=1).min())
    return np.array(gaps)


@pytest.mark.parametrize(
    ("rate", "shot", "key", "first", "step", "written"),
    [
        (25.0, None, None, 1.0, 1.0, 25.0),
        (25.0, 24.0, "codes", 1.0, 1.0, 25.0),
        (25.0, 24.0, "seconds", 25.0 / 24.0, 25.0 / 24.0, 24.0),
        (48.0, 24.0, "seconds", 2.0, 2.0, 24.0),
        (NTSC, 23.976, None, 1.0, 1.0, NTSC),
        (NTSC, 24.0, "codes", 1.0, 1.0, NTSC),
        (None, 30.0, None, 1.0, 1.0, 24.0),
        (24.0, 24.0, "seconds", 1.0, 1.0, 24.0),
    ],
)
def test_feathers_stand_on_the_skin_where_both_are_composed(
    tmp_path, rate, shot, key, first, step, written
):
    write_skin(tmp_path, rate)
    more = "" if shot is None else f"frames_per_second = {shot}\n"
    own = "" if key is None else f'time = "{key}"\n'
    path = write_shot(tmp_path, SKIN + own, (1, 4), more=more)
    report = featherfx.bake(path, tmp_path / "out.usda").report
    assert report["time"]["first_time_code"] == pytest.approx(first, abs=1e-12)
    assert report["time"]["time_codes_per_frame"] == pytest.approx(step, abs=1e-12)
    layer = Sdf.Layer.FindOrOpen(str(tmp_path / "out.usda"))
    assert layer.timeCodesPerSecond == pytest.approx(written, abs=1e-12)
    assert layer.framesPerSecond == (shot or rate)
    gaps = root_gaps(tmp_path / "out.usda", tmp_path / "skin.usda", (1, 2, 3, 4))
    assert gaps.max() < ROOTS_ABOVE
    assert np.ptp(gaps, axis=0).max() < 2e-6


def test_rates_are_those_of_usd_at_the_written_time_codes(tmp_path):
    """Written velocities carry points from one time code to the next."""
    write_skin(tmp_path, 25.0)
    skin = SKIN + 'time = "codes"\n'
    path = write_shot(tmp_path, skin, (1, 4), more="frames_per_second = 20\n")
    featherfx.bake(path, tmp_path / "out.usda", accelerations=True)
    stage = Usd.Stage.Open(str(tmp_path / "out.usda"))
    for prim in (each for each in stage.Traverse() if each.IsA(UsdGeom.Mesh)):
        read = {
            name: [np.array(prim.GetAttribute(name).Get(code), float) for code in (2, 3, 4)]
            for name in ("points", "velocities", "accelerations")
        }
        step = 1.0 / stage.GetTimeCodesPerSecond()
        mean = (read["points"][2] - read["points"][0]) / (2.0 * step)
        np.testing.assert_allclose(read["velocities"][1][:, 2], mean[:, 2], rtol=0.03)
        bend = (read["points"][2] - 2.0 * read["points"][1] + read["points"][0]) / step**2
        assert np.median(read["accelerations"][1][:, 2] / bend[:, 2]) == pytest.approx(1.0, abs=0.1)


@pytest.mark.parametrize("frames", [(-3, 1), (0, 3), (1001, 1003)])
def test_start_shifts_and_frames_may_be_negative(tmp_path, frames):
    write_skin(tmp_path, 24.0)
    start = "start = 3\n" if frames[0] > 100 else ""
    report = featherfx.bake(
        write_shot(tmp_path, SKIN + start, frames), tmp_path / "out.usda"
    ).report
    code = 3.0 if start else float(frames[0])
    assert report["time"] == {"first_time_code": code, "time_codes_per_frame": 1.0}
    offset, codes = frames[0] - code, range(frames[0], frames[1] + 1)
    gaps = root_gaps(tmp_path / "out.usda", tmp_path / "skin.usda", codes, offset)
    assert gaps.max() < ROOTS_ABOVE


@pytest.mark.parametrize(("rate", "shot"), [(25, 24), (24, 23.976), (30, 24), (60, 59.94)])
def test_rates_that_differ_are_an_error_with_both(tmp_path, rate, shot):
    write_skin(tmp_path, rate)
    path = write_shot(tmp_path, SKIN, (1, 4), more=f"frames_per_second = {shot}\n")
    told = f"skin: /skin has {rate} time codes a second, the shot {shot} frames_per_second"
    with pytest.raises(InputError, match=told):
        featherfx.read_shot(path)


def test_rates_that_are_no_frames_are_an_error(tmp_path):
    """Ticks of a program that counts 4800 a second, every 200th of which is a frame."""
    write_skin(tmp_path, 4800.0, range(0, 4000, 200))
    with pytest.raises(InputError, match="4800 time codes a second, which are no frames"):
        featherfx.read_shot(write_shot(tmp_path, SKIN, (1, 4)))
    seconds, rate = SKIN + 'time = "seconds"\n', "frames_per_second = 24\n"
    shot = featherfx.read_shot(write_shot(tmp_path, seconds, (1, 4), more=rate))
    assert (shot.skin.clock.start, shot.skin.clock.step) == (200.0, 200.0)


def test_colliders_winds_and_cameras_read_time_alike(tmp_path):
    """The skin gives the rate, which those of another rate are asked about."""
    write_skin(tmp_path, 24.0)
    stage = new_stage(tmp_path / "other.usda", 1.0, "Z", 25.0)
    points, counts, quads = sheet()
    mesh = add_mesh(stage, "/wall", points, counts, quads)
    wind = stage.DefinePrim("/air").CreateAttribute("w", Sdf.ValueTypeNames.Vector3f)
    camera = UsdGeom.Camera.Define(stage, "/camera").CreateFocalLengthAttr()
    for code in range(40):
        mesh.GetPointsAttr().Set(vec(lifted(points, -1.0 - code)), code)
        wind.Set((code, 0, 0), code)
        camera.Set(30.0 + code, code)
    stage.Save()
    tables = {
        "[collider]": 'usd = "other.usda"\nprims = ["/wall"]\n',
        "wind_usd": 'usd = "other.usda"\nprim = "/air"\nattribute = "w"\n',
        "level_of_detail": 'usd = "other.usda"\nprim = "/camera"\n',
    }
    for table, keys in tables.items():
        plain = f"[{table}]\n{keys}"
        with pytest.raises(
            InputError, match="has 25 time codes a second, the shot 24 frames_per_second"
        ):
            featherfx.read_shot(write_shot(tmp_path, SKIN, (1, 4), more=plain))
    for key, step in (("codes", 1.0), ("seconds", 25.0 / 24.0)):
        more = "".join(f'[{table}]\n{keys}time = "{key}"\n' for table, keys in tables.items())
        shot = featherfx.read_shot(write_shot(tmp_path, SKIN, (2, 4), more=more))
        clocks = shot.colliders[0].clock, shot.wind_source.clock, shot.level_of_detail.camera.clock
        assert [(each.start, each.step) for each in clocks] == [(2.0 * step, step)] * 3
        assert shot.wind_source.velocity(np.zeros((1, 3)), 1 / 24)[0, 0] == pytest.approx(3 * step)


@pytest.mark.parametrize("by", ["points", "transform", "every second code"])
def test_roots_stay_on_the_skin_that_is_drawn_between_frames(tmp_path, by):
    """A sheet turns by 29 degrees a frame, which a renderer draws along chords."""
    stage = new_stage(tmp_path / "skin.usda")
    points, counts, quads = sheet()
    mesh = add_mesh(stage, "/skin", points, counts, quads)
    for code in range(0, 20, 2 if by == "every second code" else 1):
        matrix = rigid(29.0 * code, (1, 0, 0), (0.1 * code, 0, 0))
        if by == "transform":
            add_matrix(mesh, matrix, code)
        else:
            mesh.GetPointsAttr().Set(vec(points @ matrix[:3, :3] + matrix[3, :3]), code)
    stage.Save()
    skin = SKIN + "rest = 0\n"
    path = write_shot(tmp_path, skin, (2, 6), groom="g.toml", more="preroll = 0\n")
    (tmp_path / "g.toml").write_text(
        'name = "g"\n[[feather]]\nid = "f"\nkind = "covert"\nposition = [0.0, 0.15, 0.0]\n'
    )
    report = featherfx.bake(path, tmp_path / "out.usda", subframes=4).report
    codes = np.arange(2.0, 6.0, 0.125)
    gaps = root_gaps(tmp_path / "out.usda", tmp_path / "skin.usda", codes)
    # a transform is no chord for USD itself, only for points between the samples that are written
    assert gaps[::2].max() < 1e-6
    assert gaps.max() < 1e-3
    assert report["drawn_skin"]["feather"] == "f"
    assert report["drawn_skin"]["distance"] > (1e-5 if by == "transform" else 4e-3)
    stage = Usd.Stage.Open(str(tmp_path / "out.usda"))
    feather = next(each for each in stage.Traverse() if each.IsA(UsdGeom.Mesh))
    for code in (3.25, 4.0, 4.5):
        here, there = (np.array(feather.GetAttribute("points").Get(c)) for c in (code, code + 0.25))
        root = np.linalg.norm(here - np.array(feather.GetAttribute("points").Get(code))[0], axis=1)
        velocity = np.array(feather.GetAttribute("velocities").Get(code))[root.argmin()]
        way = (there - here)[root.argmin()] * 24.0 / 0.25
        assert np.linalg.norm(velocity - way) < 0.1 * np.linalg.norm(way)


def test_handles_are_samples_beyond_both_ends(tmp_path):
    """The stage's range stays the shot's; shares join, a bake resumes, and the check agrees."""
    write_skin(tmp_path, 24.0)
    path = write_shot(tmp_path, SKIN, (2, 4), more="handles = 1\n")
    cache, skin = tmp_path / "out.usda", tmp_path / "skin.usda"
    report = featherfx.bake(path, cache, subframes=2, frames=(2, 3)).report
    assert report["samples"] == 7
    assert report["time"]["first_time_code"] == 1.0
    stage = Usd.Stage.Open(str(cache))
    assert (stage.GetStartTimeCode(), stage.GetEndTimeCode()) == (2.0, 3.0)
    mesh = next(each for each in stage.Traverse() if each.IsA(UsdGeom.Mesh))
    assert mesh.GetAttribute("points").GetTimeSamples() == [1.0 + k / 2 for k in range(7)]
    gaps = root_gaps(cache, skin, np.arange(1.0, 4.0, 0.25))
    assert gaps.max() < ROOTS_ABOVE
    assert np.ptp(gaps, axis=0).max() < 1e-5
    assert featherfx.check(cache) == []
    again = featherfx.bake(path, cache, subframes=2, frames=(2, 3), resume=True).report
    assert again["samples_taken_over"] == 7
    for share in (1, 2):
        featherfx.bake(path, tmp_path / "whole.usda", feathers=(share, 2))
    featherfx.join(tmp_path / "whole.usda", 2)
    assert featherfx.check(tmp_path / "whole.usda") == []


@pytest.mark.parametrize("codes", [range(2, 9), range(5)])
def test_handles_need_samples_of_the_skin(tmp_path, codes):
    write_skin(tmp_path, 24.0, codes)
    told = f"has samples from {codes[0]} to {codes[-1]}"
    with pytest.raises(InputError, match=told):
        featherfx.read_shot(write_shot(tmp_path, SKIN, (2, 4), more="handles = 1\n"))
    hold = SKIN + 'extrapolation = "hold"\n'
    path = write_shot(tmp_path, hold, (2, 4), more="handles = 1\n")
    featherfx.bake(path, tmp_path / "out.usda")
    gaps = root_gaps(tmp_path / "out.usda", tmp_path / "skin.usda", range(1, 6))
    assert np.ptp(gaps, axis=0).max() < 2e-6


def test_a_run_up_ends_where_handles_begin(tmp_path):
    """Feathers are at speed at the first sample that is written."""
    write_skin(tmp_path, 24.0)
    runs = []
    for frames, more in (((2, 4), ""), ((4, 4), "handles = 2\n")):
        path = write_shot(tmp_path, SKIN, frames, more=more)
        featherfx.bake(path, tmp_path / "out.usda", overwrite=True)
        stage = Usd.Stage.Open(str(tmp_path / "out.usda"))
        mesh = next(each for each in stage.Traverse() if each.IsA(UsdGeom.Mesh))
        runs.append([np.array(mesh.GetAttribute("points").Get(code)) for code in (2, 3, 4)])
    np.testing.assert_allclose(runs[1], runs[0], atol=1e-6)
