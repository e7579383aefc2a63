"""A cache whose feathers are brought to drawn poses at some frames."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from commands import invoke
from places import SAMPLES
from pxr import Usd, UsdGeom, Vt

import featherfx
from featherfx.errors import InputError, InputWarning
from featherfx.usd.read.cache import Cache
from featherfx.usd.types import RANGES_PREFIX

OWN = ["right_secondary_03", "left_secondary_03"]
AT = 7.0


def points_of(path, name, code):
    """(V, 3) points of a feather, m."""
    cache = Cache(path)
    index = next(k for k, each in enumerate(cache.feathers) if each.id == name)
    return cache.points(index, code) @ cache.to_world


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Caches of a beating wing that is rigid, and of one of limp feathers that fall upwards."""
    made = tmp_path_factory.mktemp("sculpt")
    shot = featherfx.read_shot(SAMPLES / "swan_wing/shot.toml").replace(
        frames=[1, 12], quality="draft", detail=[{"level": "rigid"}]
    )
    featherfx.bake(shot, made / "wing.usdc", barbs=8, accelerations=True)
    featherfx.bake(
        shot, made / "joined.usdc", barbs=8, accelerations=True, group="all", up_axis="Y",
        meters_per_unit=0.01, layout="clips",
    )  # fmt: skip
    limp = shot.replace(
        quality={"base": "draft", "rows": 11, "columns": 4, "simulated_rows": 11},
        frames=[1, 7],
        detail=[{"level": "rigid"}, *({"level": "full", "feathers": name} for name in OWN)],
        channel=[
            {"name": "stiffness", "keys": [[1, 0.2]]},
            {"name": "gravity", "keys": [[1, -10]]},
        ],
    )
    featherfx.bake(limp, made / "limp.usdc")
    return made


@pytest.fixture(scope="module")
def poses(folder: Path) -> Path:
    """The limp shape of two feathers at one frame, as meshes."""
    meshes = {name: {AT: points_of(folder / "limp.usdc", name, AT)} for name in OWN}
    return poses_file(folder / "poses.usda", meshes, UsdGeom.Mesh)


def poses_file(path, held, schema):
    stage = Usd.Stage.CreateNew(str(path))
    UsdGeom.SetStageMetersPerUnit(stage, 1.0)
    UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.z)
    for name, by_code in held.items():
        prim = schema.Define(stage, f"/poses/{name}")
        for code, points in by_code.items():
            prim.CreatePointsAttr().Set(Vt.Vec3fArray.FromNumpy(np.float32(points)), code)
        if schema is UsdGeom.BasisCurves:
            prim.CreateCurveVertexCountsAttr([len(points)])
            prim.CreateTypeAttr("linear")
        else:
            prim.CreateFaceVertexCountsAttr([3])
            prim.CreateFaceVertexIndicesAttr([0, 1, 2])
    stage.Save()
    return path


def chain_lengths(path, name, code):
    """m, lengths of a feather's rachis and drawn barbs, piece by piece."""
    stage = Usd.Stage.Open(str(path))
    unit, found = UsdGeom.GetStageMetersPerUnit(stage), []
    for prim in stage.Traverse():
        if not prim.IsA(UsdGeom.BasisCurves):
            continue
        curves, start = UsdGeom.BasisCurves(prim), 0
        ids = prim.GetAttribute("primvars:featherId").Get()
        ranges = prim.GetAttribute(f"{RANGES_PREFIX}:points").Get() or [(0, None)]
        points = unit * np.array(curves.GetPointsAttr().Get(code), dtype=float)
        counts = np.array(curves.GetCurveVertexCountsAttr().Get())
        first, number = ranges[list(ids).index(name)] if name in ids else (None, None)
        if first is None:
            continue
        last = len(points) if number is None else first + number
        for count in counts:
            if first <= start < last:
                found.append(np.linalg.norm(np.diff(points[start : start + count], axis=0), axis=1))
            start += count
    return np.concatenate(found)


@pytest.mark.filterwarnings("ignore:.*intersect at frame 7")
@pytest.mark.parametrize("source", ["wing.usdc", "joined.usdc"])
def test_a_pose_is_reached_and_everything_else_stays(folder, poses, tmp_path, source):
    before = folder / source
    after = featherfx.sculpt(before, tmp_path / "out.usdc", poses=poses, fade=3)
    assert featherfx.check(after) == []
    for name in OWN:
        aim = points_of(folder / "limp.usdc", name, AT)
        length = chain_lengths(before, name, AT)[:10].sum()
        there, was = points_of(after, name, AT), points_of(before, name, AT)
        assert np.linalg.norm(was - aim, axis=1).max() > 0.1 * length
        assert np.linalg.norm(there - aim, axis=1).max() < 0.01 * length
        for code in map(float, range(1, 13)):
            lengths = [chain_lengths(each, name, code) for each in (before, after)]
            np.testing.assert_allclose(*lengths, rtol=2e-5, atol=2e-7)
            same = np.array_equal(*(points_of(each, name, code) for each in (before, after)))
            assert same == (abs(code - AT) >= 3.0)
    other = "right_primary_01"
    for code in (1.0, AT, 12.0):
        assert np.array_equal(*(points_of(each, other, code) for each in (before, after)))


def test_rates_are_those_of_the_new_motion(folder, poses, tmp_path):
    """Of mesh, rachis and barbs: they lead from frame to frame."""
    after = featherfx.sculpt(folder / "wing.usdc", tmp_path / "out.usdc", poses=poses, fade=5)
    stage = Usd.Stage.Open(str(after))
    rate = stage.GetTimeCodesPerSecond()
    for scope, end in (("feathers", ""), ("rachises", "_rachis"), ("barbs", "_barbs")):
        prim = stage.GetPrimAtPath(f"/wing/{scope}/{OWN[0]}{end}")
        points, velocities, bends = (
            np.array(
                [prim.GetAttribute(name).Get(float(code)) for code in range(1, 13)], dtype=float
            )
            for name in ("points", "velocities", "accelerations")
        )
        # of polynomials of fourth degree, exactly; where cubics meet, second rates jump
        steps = 0.5 * (velocities[1:] + velocities[:-1]) / rate
        steps -= (bends[1:] - bends[:-1]) / (12.0 * rate**2)
        own = [2, 3, 4, 7, 8, 9]
        off = np.abs(np.diff(points, axis=0) - steps)[own].max()
        assert off < 0.005 * np.abs(np.diff(points, axis=0)).max()


@pytest.mark.parametrize("stretch", [1.0, 1.3])
def test_a_curve_gives_the_rachis(folder, tmp_path, stretch):
    """A rachis as long as the curve lies on it; a longer curve gives its form, and is told."""
    name, before = OWN[0], folder / "wing.usdc"
    limp = Usd.Stage.Open(str(folder / "limp.usdc"))
    path = f"/limp/rachises/{name}_rachis"
    line = np.array(UsdGeom.BasisCurves(limp.GetPrimAtPath(path)).GetPointsAttr().Get(AT))
    line = line[0] + stretch * (line - line[0])
    drawn = poses_file(tmp_path / "poses.usda", {name: {AT: line}}, UsdGeom.BasisCurves)
    out = tmp_path / "out.usdc"
    if stretch == 1.0:
        featherfx.sculpt(before, out, poses=drawn)
    else:
        with pytest.warns(
            InputWarning, match="'right_secondary_03' is 30.* off its pose at frame 7"
        ):
            featherfx.sculpt(before, out, poses=drawn)
    stage = Usd.Stage.Open(str(out))
    curves = UsdGeom.BasisCurves(stage.GetPrimAtPath(path.replace("limp", "wing")))
    there = np.array(curves.GetPointsAttr().Get(AT))
    wanted = line[0] + (line - line[0]) / stretch
    length = np.linalg.norm(np.diff(wanted, axis=0), axis=1).sum()
    assert np.linalg.norm(there - wanted, axis=1).max() < 0.01 * length


def test_a_feather_is_carried_between_its_poses(folder, tmp_path):
    """By two poses that are the cache's own it is not changed, nor beside them."""
    name, before = OWN[0], folder / "wing.usdc"
    held = {code: points_of(before, name, code) for code in (4.0, 8.0)}
    own = poses_file(tmp_path / "poses.usda", {name: held}, UsdGeom.Mesh)
    after = featherfx.sculpt(before, tmp_path / "out.usdc", poses=own, fade=0)
    for code in map(float, range(1, 13)):
        one, other = (points_of(each, name, code) for each in (before, after))
        np.testing.assert_allclose(one, other, atol=2e-6)


@pytest.mark.parametrize(
    ("held", "told"),
    [
        ({"nobody": {AT: np.eye(3)}}, "holds 'nobody', "),
        ({OWN[0]: {99.0: np.eye(3)}}, "holds a pose at frame 99, the cache has 1 to 12"),
        (
            {OWN[0]: {AT: np.eye(3)}},
            "'right_secondary_03' at frame 7 has 3 points, its mesh in the",
        ),
        ({}, "holds no time samples of points"),
    ],
)
def test_poses_that_do_not_fit_are_one_message(folder, tmp_path, held, told):
    wrong = poses_file(tmp_path / "poses.usda", held, UsdGeom.Mesh)
    arguments = ["sculpt", folder / "wing.usdc", "--with", wrong, "-o", tmp_path / "out.usdc"]
    result = invoke(*map(str, arguments))
    assert result.exit_code == 1
    (line,) = [
        each for each in result.stderr.splitlines() if not each.startswith("featherfx: read")
    ]
    assert told in line
    assert "poses.usda" in line
    assert not (tmp_path / "out.usdc").exists()


def test_feathers_that_come_to_pass_through_others_are_named(folder, tmp_path):
    name, before = OWN[0], folder / "wing.usdc"
    points = points_of(before, name, AT)
    other = points_of(before, "right_secondary_01", AT)
    way = other.mean(axis=0) - points.mean(axis=0)
    turn = np.linspace(0.0, 1.0, 20)[:, None]
    line = points[0] + turn * (points.mean(axis=0) - points[0]) * 2.0 + turn**2 * way
    drawn = poses_file(tmp_path / "poses.usda", {name: {AT: line}}, UsdGeom.BasisCurves)
    with pytest.warns(
        InputWarning, match=r"'.*' intersect at frame 7 and did not before.* Pose both"
    ):
        featherfx.sculpt(before, tmp_path / "out.usdc", poses=drawn)


def test_a_curve_that_is_no_rachis_is_refused(folder, tmp_path):
    line = {OWN[0]: {AT: np.array([[9.0, 0, 0], [9.0, 0, 0.1]])}}
    drawn = poses_file(tmp_path / "poses.usda", line, UsdGeom.BasisCurves)
    with pytest.raises(InputError, match="the curve of 'right_secondary_03' at frame 7 "):
        featherfx.sculpt(folder / "wing.usdc", tmp_path / "out.usdc", poses=drawn)
