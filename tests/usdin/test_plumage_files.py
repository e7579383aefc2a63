"""Plumage from files to files: instances, previews, statistics."""

import json

import numpy as np
import pytest
from click.testing import CliRunner
from pxr import Usd, UsdGeom
from regions_skin import SKIN, region, write_skin

from featherfx.baking.pipeline import check, export_groom, stats
from featherfx.cli.main import main
from featherfx.render.options import PictureOptions
from featherfx.render.subject import open_subject
from featherfx.usd.read.cache import Cache

KEYS = "count = 60\nlength = 0.03\nvariants = 3\nvariation = { length = 0.1, width = 0.1 }\n"


def written(folder):
    write_skin(folder)
    path = folder / "groom.toml"
    path.write_text(SKIN + region(keys=KEYS + "follow = 1"))
    return path


@pytest.fixture
def groom(tmp_path):
    return written(tmp_path)


@pytest.fixture(scope="module")
def plain(tmp_path_factory):
    """The feathers as meshes."""
    output = tmp_path_factory.mktemp("plain") / "plain.usdc"
    assert export_groom(written(output.parent), output, quality="draft", instances=False) == 60
    return output


@pytest.fixture(scope="module")
def small(tmp_path_factory):
    """The feathers as instances."""
    output = tmp_path_factory.mktemp("small") / "small.usdc"
    assert export_groom(written(output.parent), output, quality="draft") == 60
    return output


@pytest.fixture(autouse=True)
def _quiet(recwarn):
    """The flow on a ball is singular somewhere, which is not what is tested here."""


def by_id(path):
    cache = Cache(path)
    return {each.id: (each, cache.pose(k)) for k, each in enumerate(cache.feathers)}


@pytest.mark.parametrize("stage", [{}, {"meters_per_unit": 0.01, "up_axis": "Y"}])
def test_instances_are_the_plain_feathers(request, groom, stage):
    if stage:
        one, other = groom.with_name("plain.usdc"), groom.with_name("small.usdc")
        export_groom(groom, one, quality="draft", instances=False, **stage)
        export_groom(groom, other, quality="draft", **stage)
    else:
        one, other = map(request.getfixturevalue, ("plain", "small"))
    assert check(other) == []
    first, second = by_id(one), by_id(other)
    assert first.keys() == second.keys()
    unit = stage.get("meters_per_unit", 1.0)
    for name, (feather, pose) in first.items():
        other, same = second[name]
        assert (other.kind, other.region) == (feather.kind, feather.region)
        assert np.array_equal(other.triangles, feather.triangles)
        # a tenth of a micrometre: single precision of points and quaternions
        assert np.abs(same.points - pose.points).max() * unit < 1e-7 + 2e-7
        assert np.abs(same.normals - pose.normals).max() < 1e-3


def test_instances_are_as_loose_as_the_plain_feathers(tmp_path):
    groom = tmp_path / "groom.toml"
    write_skin(tmp_path)
    # plumes' barbs hook to nothing, so a renderer sees through their vanes
    plumes = region(keys="count = 9\nlength = 0.03").replace("body_contour", "ornamental_plume")
    groom.write_text(SKIN + plumes)
    loose = []
    for instances in (True, False):
        output = tmp_path / f"{instances}.usdc"
        export_groom(groom, output, quality="draft", instances=instances)
        loose.append(Cache(output).hooked_of(range(9), None))
    assert np.array_equal(*loose)
    assert 0.0 < np.mean(loose[0]) < 0.9


def test_a_groom_has_the_axes_and_units_of_its_skin(groom):
    """So that it stands on the skin where both are loaded."""
    skin = Usd.Stage.Open(str(groom.with_name("skin.usda")))
    UsdGeom.SetStageUpAxis(skin, UsdGeom.Tokens.y)
    UsdGeom.SetStageMetersPerUnit(skin, 0.01)
    points = UsdGeom.Mesh(skin.GetPrimAtPath("/skin")).GetPointsAttr()
    x, y, z = 100.0 * np.array(points.Get(), dtype=np.float32).T
    points.Set(np.transpose([x, z, -y]))
    skin.Save()
    output = groom.with_name("feathers.usdc")
    export_groom(groom, output, quality="draft")
    stage = Usd.Stage.Open(str(output))
    assert UsdGeom.GetStageUpAxis(stage) == UsdGeom.Tokens.y
    roots = np.array(
        UsdGeom.PointInstancer(stage.GetPrimAtPath("/feathers/plumage")).GetPositionsAttr().Get()
    )
    away = np.linalg.norm(roots[:, None] - np.array(points.Get())[None], axis=-1).min(axis=1)
    assert away.max() < np.abs(points.Get()).max() / 5


def test_instances_are_few_prims_and_keep_their_numbers(groom):
    output = groom.with_name("small.usdc")
    export_groom(groom, output, quality="draft")
    stage = Usd.Stage.Open(str(output))
    instancer = UsdGeom.PointInstancer(stage.GetPrimAtPath("/small/plumage"))
    assert len(instancer.GetPrototypesRel().GetTargets()) < 31
    extent = np.array(instancer.GetExtentAttr().Get())
    points = np.concatenate([pose.points for _, pose in by_id(output).values()])
    # USD turns the prototypes' boxes, so that the extent is up to a feather's width too large
    assert (extent[0] <= points.min(axis=0)).all()
    assert (extent[1] >= points.max(axis=0)).all()
    assert np.allclose(extent, [points.min(axis=0), points.max(axis=0)], atol=8e-3)

    def numbers(stage):
        prim = stage.GetPrimAtPath("/small/plumage")
        ids = UsdGeom.PrimvarsAPI(prim).GetPrimvar("featherId").ComputeFlattened()
        return dict(zip(ids, UsdGeom.PointInstancer(prim).GetIdsAttr().Get(), strict=True))

    before = numbers(stage)
    del instancer
    groom.write_text(groom.read_text().replace("count = 60", "count = 90"))
    del stage  # USD would go on with the layer that is open
    export_groom(groom, output, quality="draft", overwrite=True)
    after = numbers(Usd.Stage.Open(str(output)))
    assert len(after) == 90
    assert all(after[name] == number for name, number in before.items())


@pytest.mark.nightly
def test_feathers_that_do_not_repeat_are_meshes(groom):
    groom.write_text(groom.read_text().replace("variants = 3", "variants = 0"))
    output = groom.with_name("plain.usdc")
    export_groom(groom, output, quality="draft")
    assert not Usd.Stage.Open(str(output)).GetPrimAtPath("/plain/plumage")
    assert len(Cache(output).feathers) == 60


@pytest.mark.parametrize("form", ["small", "plain"])
def test_every_prim_has_a_type(request, form):
    stage = Usd.Stage.Open(str(request.getfixturevalue(form)))
    assert [str(prim.GetPath()) for prim in stage.TraverseAll() if not prim.GetTypeName()] == []


def test_a_payload_of_instances(groom):
    output = groom.with_name("small.usda")
    export_groom(groom, output, quality="draft", layout="payload")
    assert groom.with_name("small.payload.usdc").exists()
    assert len(Cache(output).feathers) == 60


def test_the_command_takes_either_form(groom):
    output = groom.with_name("out.usdc")
    arguments = ["groom", str(groom), "-o", str(output), "--quality", "draft", "--no-instances"]
    assert CliRunner().invoke(main, arguments).exit_code == 0
    assert not Usd.Stage.Open(str(output)).GetPrimAtPath("/out/plumage")
    assert CliRunner().invoke(main, ["check", str(groom), str(output)]).exit_code == 0


def test_broken_instancers_are_found(groom):
    output = groom.with_name("small.usda")
    export_groom(groom, output, quality="draft", layout="flat")
    stage = Usd.Stage.Open(str(output))
    instancer = UsdGeom.PointInstancer(stage.GetPrimAtPath("/small/plumage"))
    indices = list(instancer.GetProtoIndicesAttr().Get())
    instancer.GetProtoIndicesAttr().Set([99, *indices[1:]])
    instancer.GetScalesAttr().Set(instancer.GetScalesAttr().Get()[:-1])
    instancer.GetIdsAttr().Set([1] * len(indices))
    found = "\n".join(map(str, _saved(stage, output)))
    assert "protoIndices: 99 is out of range" in found
    assert "scales: 59 values for 60 instances" in found
    assert "ids: 60 values, 1 different" in found


@pytest.mark.parametrize("form", ["plain", "small"])
def test_a_groom_at_rest_names_its_skin_for_pictures(request, form):
    output = request.getfixturevalue(form)
    skin = output.with_name("skin.usda")
    (entry,) = Cache(output).scenery
    assert (entry["role"], entry["file"], entry["prim"]) == ("skin", "skin.usda", "/skin")
    # a file that is named besides is not drawn twice
    subject = open_subject(output, PictureOptions(scenery=(str(skin),)))
    (drawn,) = subject.scenery
    assert np.linalg.norm(drawn.points(None), axis=1) == pytest.approx(0.1, abs=1e-6)


def _saved(stage, path):
    stage.GetRootLayer().Save()
    return check(path)


def test_stats_of_a_groom(groom, plain):
    found = stats(groom, quality="draft")
    assert found["feathers"] == 60
    assert found["regions"] == {"body": 60}
    assert found["kinds"] == {"body_contour": 60}
    assert 3 <= found["shapes"] <= 30
    assert found["layout"] is None
    groom.write_text(groom.read_text() + "[layout]\n")
    layout = stats(groom, quality="draft")["layout"]
    assert layout["feathers"] == 60
    assert layout["pairs"] > 0
    assert layout["feathers_without_gap"] == 0
    assert found["mesh_points_of_shapes"] < found["mesh_points"]
    cache = Cache(plain)
    points = sum(len(cache.pose(k).points) for k in range(len(cache.feathers)))
    assert found["mesh_points"] == points


@pytest.mark.nightly
def test_stats_of_a_shot(groom):
    shot = groom.with_name("shot.toml")
    skin = "[skin]\nusd = 'skin.usda'\nprim = '/skin'\n"
    shot.write_text(
        "name = 's'\ngroom = 'groom.toml'\nframes = [1, 3]\nframes_per_second = 24\n"
        "quality = 'draft'\nwind = 'breeze'\n" + skin
    )
    arguments = ["stats", str(shot), "--json", "--jobs", "1", "--seconds", "0.5"]
    result = CliRunner().invoke(main, arguments)
    assert result.exit_code == 0
    bake = json.loads(result.stdout[result.stdout.index("{") :])["bake"]
    assert bake["frames"] == 3
    assert bake["seconds_of_a_feather_and_frame"] > 0
    simulating = bake["seconds_of_a_feather_and_frame"] * 60 * 2
    assert bake["seconds"]["simulating"] == pytest.approx(simulating)
    assert bake["wall_seconds"] == pytest.approx(sum(bake["seconds"].values()))
    assert bake["wall_seconds"] > simulating
    assert bake["unknowns"] > 60 * 6 * 6
    plain = CliRunner().invoke(main, ["stats", str(groom)])
    assert "length: " in plain.stdout
    groom.write_text(groom.read_text() + "[layout]\n")
    laid = CliRunner().invoke(main, ["stats", str(groom)])
    assert "neighbours a feather" in laid.stdout


@pytest.mark.nightly
def test_stats_know_guides_and_memory(groom):
    text = (
        "name = 's'\ngroom = 'groom.toml'\nframes = [1, 4]\nquality = 'draft'\n"
        "[skin]\nusd = 'skin.usda'\nprim = '/skin'\n"
    )
    shot = groom.with_name("followed.toml")
    shot.write_text(text)
    full = stats(shot, budget=0.1)["bake"]
    shot.write_text(text + "[[detail]]\nlevel = 'guided'\nevery = 6\n")
    guided = stats(shot, budget=0.1)["bake"]
    assert full["levels"] == {"full": 60}
    assert guided["levels"] == {"full": 10, "guided": 50}
    assert guided["unknowns"] == pytest.approx(full["unknowns"] / 6, abs=1)
    # the caches are of one size, and what is simulated of them needs room
    assert guided["bytes_of_the_cache"] == full["bytes_of_the_cache"]
    assert full["memory_bytes"] > 50e6


def test_stats_of_a_bad_file(tmp_path):
    (tmp_path / "bad.toml").write_text("name = 3\n")
    result = CliRunner().invoke(main, ["stats", str(tmp_path / "bad.toml")])
    assert result.exit_code == 1
    assert "name" in result.output
