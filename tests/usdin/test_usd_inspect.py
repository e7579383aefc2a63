"""`featherfx inspect`: what a stage holds for grooms and shots to name, and what it tells."""

import json
import os
import warnings

import creature
import numpy as np
import pytest
from commands import invoke
from places import SAMPLES
from pxr import Gf, Usd, UsdGeom
from usdin_scenes import add_curves, add_mesh, add_skinned, arc, new_stage, sheet, write_shot

from featherfx import read_groom, read_shot
from featherfx.baking.pipeline import export_groom, inspect_stage
from featherfx.errors import InputError


def inspected(*arguments):
    """Exit code, stdout and stderr of the command."""
    done = invoke("inspect", *arguments)
    return done.exit_code, done.stdout, done.stderr


def only(prims):
    (prim,) = prims
    return prim


def test_the_body_of_the_pigeon():
    code, out, _ = inspected(SAMPLES / "pigeon/body.usdc", "--json")
    found = json.loads(out)
    assert code == 0
    assert (found["meters_per_unit"], found["up_axis"]) == (1.0, "Z")
    assert (found["start"], found["end"], found["time_codes_per_second"]) == (1, 96, 24)
    mesh, eyes, claws, skeleton = found["prims"]
    assert (eyes["path"], eyes["skeleton"]) == ("/pigeon/eyes", "/pigeon/skeleton")
    assert (claws["path"], claws["skeleton"]) == ("/pigeon/claws", "/pigeon/skeleton")
    stage = Usd.Stage.Open(str(SAMPLES / "pigeon/body.usdc"))
    body = UsdGeom.Mesh(stage.GetPrimAtPath(mesh["path"]))
    points, faces = len(body.GetPointsAttr().Get(1)), len(body.GetFaceVertexCountsAttr().Get())
    assert (mesh["path"], mesh["points"], mesh["parts"]) == ("/pigeon/body", points, faces)
    assert (mesh["sampled"], mesh["skeleton"]) == ([1, 96], "/pigeon/skeleton")
    assert skeleton["joints"][2] == "body/neck/head"
    primvar = next(each for each in mesh["primvars"] if each["name"] == "torso")
    kind = (primvar["type"], primvar["interpolation"], primvar["count"])
    assert kind == ("float[]", "vertex", points)


def test_a_creature_in_centimetres_is_told_in_metres(tmp_path):
    creature.skinned(tmp_path / "creature.usda")
    code, out, _ = inspected(tmp_path / "creature.usda")
    assert code == 0
    assert "0.01 m per unit, Y up" in out
    assert "738 points, 0.4 x 0.197 x 2 m, moves from 1001 to 1024" in out
    assert "    at rest, in its own units: x -20 to 20, y -9.848 to 9.848, z -100 to 100" in out
    assert "24 joints, moves from 1001 to 1024, 24 samples" in out
    assert "joints: j00, j01, j02" in out


@pytest.mark.parametrize(
    ("bird", "why"),
    [
        ("", "USD skins nothing below /all/bird, which is no Xform or Scope"),
        ("Xform", ""),
        (None, "USD skins only what is below a SkelRoot"),
    ],
)
def test_a_mesh_that_usd_does_not_skin_is_told(tmp_path, bird, why):
    """bird: type of the prim between skin and SkelRoot; None: there is no SkelRoot."""
    stage = new_stage(tmp_path / "skin.usda")
    add_skinned(stage, "/all/bird")
    stage.GetPrimAtPath("/all/bird").SetTypeName(bird or "")
    stage.DefinePrim("/all", "Xform" if bird is None else "SkelRoot")
    stage.Save()
    code, out, told = inspected(tmp_path / "skin.usda")
    assert code == 0
    assert ("moved by /all/bird/skeleton" in out) == (not why)
    path = write_shot(tmp_path, 'usd = "skin.usda"\nprim = "/all/bird/skin"\ntolerance = 10')
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        skin = read_shot(path).skin
    still = np.allclose(skin.frames(1.0).positions, skin.frames(0.0).positions)
    assert still == bool(why)
    expected = f"/all/bird/skin: bound to /all/bird/skeleton but moves by nothing: {why}"
    assert (expected in told) == still
    assert any(expected in str(each.message) for each in caught) == still


def test_a_cache_of_feathers_that_featherfx_wrote(tmp_path):
    (tmp_path / "groom.toml").write_text(
        'name = "one"\n[[feather]]\nid = "a"\nkind = "covert"\nposition = [0, 0, 0]\n'
        "direction = [1, 0, 0]\nup = [0, 0, 1]\n"
    )
    export_groom(tmp_path / "groom.toml", tmp_path / "rest.usda")
    report = inspect_stage(tmp_path / "rest.usda")
    assert report.problems == ()
    told = [each for prim in report.prims for each in prim.primvars]
    assert "featherId" in {each.name for each in told}


def test_instances_payloads_curves_and_cameras(tmp_path):
    bird = new_stage(tmp_path / "bird.usda")
    bird.SetDefaultPrim(add_skinned(bird).GetPrim().GetParent())
    bird.Save()
    stage = new_stage(tmp_path / "shot.usda", 0.1, "Y", 25.0)
    for name in ("a", "b"):
        prim = stage.DefinePrim(f"/flock/{name}")  # a SkelRoot, as the payload says
        prim.GetPayloads().AddPayload("./bird.usda")
        prim.SetInstanceable(True)
    add_curves(stage, "/guides", [arc(), arc()])
    lens = UsdGeom.Camera.Define(stage, "/cam").CreateFocalLengthAttr()
    lens.Set(20.0, 3)
    lens.Set(35.0, 9)
    points, counts, quads = sheet()
    mesh = add_mesh(stage, "/ground", points, counts, quads)
    UsdGeom.Subset.CreateGeomSubset(mesh, "moss", "face", [0, 1])
    UsdGeom.XformCommonAPI(mesh).SetScale(Gf.Vec3f(2, 1, 1))
    UsdGeom.PointInstancer.Define(stage, "/pebbles").CreateProtoIndicesAttr([0, 0, 0])
    stage.Save()
    report = inspect_stage(tmp_path / "shot.usda")
    meshes = {each.path: each for each in report.of_kind("mesh")}
    assert set(meshes) == {"/flock/a/skin", "/flock/b/skin", "/ground"}
    assert meshes["/flock/b/skin"].in_instance
    assert meshes["/flock/b/skin"].skeleton == "/flock/b/skeleton"
    assert meshes["/ground"].subsets == ("moss",)
    assert meshes["/ground"].size == pytest.approx((0.08, 0.04, 0.0))
    guides = only(report.of_kind("curves"))
    assert (guides.parts, guides.points) == (2, 42)
    assert only(report.of_kind("camera")).sampled == (3, 9)
    assert only(report.of_kind("instancer")).parts == 3


def test_what_cannot_be_read_is_told_beside_the_rest(tmp_path):
    stage = new_stage(tmp_path / "odd.usda")
    points, counts, quads = sheet()
    add_mesh(stage, "/sound", points, counts, quads)
    add_mesh(stage, "/odd", points, counts, quads)
    stage.Save()
    text = (tmp_path / "odd.usda").read_text()
    head, tail = text.rsplit("point3f[] points", 1)
    (tmp_path / "odd.usda").write_text(f"{head}string points = 'x'\n#{tail}")
    code, out, err = inspected(tmp_path / "odd.usda")
    assert code == 1
    assert "/sound: Mesh, 64 faces, 81 points" in out
    assert "/odd:" not in out
    assert "/odd.points" in err
    assert "/: 1 prim; left 1 Mesh that cannot be read (/odd)" in err
    assert len(err.splitlines()) == 2


def test_what_is_no_stage_is_one_message(tmp_path):
    (tmp_path / "text.usda").write_text("nothing")
    for path in (tmp_path / "text.usda", tmp_path, tmp_path / "none.usd"):
        with pytest.raises(InputError) as caught:
            inspect_stage(path)
        assert len(caught.value.problems) == 1
        assert str(caught.value).startswith(str(path))


def refused(shot):
    with pytest.raises(InputError) as caught:
        read_shot(shot)
    return str(caught.value)


def test_a_wrong_path_of_a_skin_lists_the_meshes(tmp_path):
    points, counts, quads = sheet()
    stage = new_stage(tmp_path / "skin.usda")
    add_mesh(stage, "/rig/geo/body", points, counts, quads)
    stage.DefinePrim("/rig/bones", "Xform")
    stage.Save()
    skin = 'usd = "skin.usda"\nprim = "{}"'
    for path in ("/bird/body", "/rig/bones", "/rig/bad path"):
        told = refused(write_shot(tmp_path, skin.format(path)))
        assert "The stage has one mesh: /rig/geo/body" in told
        assert len(told.splitlines()) == 1
    for number in range(40):
        add_mesh(stage, f"/rig/props/prop_{number:02d}", points, counts, quads)
    stage.Save()
    told = refused(write_shot(tmp_path, skin.format("/rig/geo/bodi")))
    assert "The stage has 41 of kind mesh, the nearest /rig/geo/body" in told
    assert "prop_30" not in told


def test_wrong_paths_of_colliders_and_cameras_list_what_is_there(tmp_path):
    stage = new_stage(tmp_path / "set.usda")
    add_mesh(stage, "/set/ground", *sheet())
    UsdGeom.Camera.Define(stage, "/set/lens")
    stage.Save()
    collider = '[[collider]]\nusd = "set.usda"\nprims = ["{}"]\n'
    for name in ("/ground", "rock_*"):
        told = refused(write_shot(tmp_path, None, more=collider.format(name)))
        assert "The stage has one mesh: /set/ground" in told
    groom = tmp_path / "drawn.toml"
    groom.write_text('name = "drawn"\n[[usd]]\nfile = "set.usda"\nkind = "covert"\n')
    with pytest.raises(InputError, match=r"The stage has no curves\. The stage has no instancer"):
        read_groom(groom)


@pytest.mark.parametrize("path", ["/dev/zero", "pipe.usda"])
def test_what_is_no_regular_file_is_not_opened(tmp_path, path):
    os.mkfifo(tmp_path / "pipe.usda")
    code, _, told = inspected(tmp_path / path)
    assert (code, told) == (
        1,
        f"featherfx: {tmp_path / path}: is not a regular file. Name a USD file.\n",
    )
