"""Stages of which a layer or a clip is cut short or missing: told by name, never a crash."""

from __future__ import annotations

import pytest
from pxr import Sdf, Usd, UsdGeom
from usdin_scenes import add_curves, add_mesh, arc, lifted, new_stage, sheet, vec, write_shot

import featherfx
import featherfx.baking.pipeline as pipeline
from featherfx.errors import InputError

SKIN = 'usd = "top.usda"\nprim = "/bird/skin"'
COLLIDER = '[[collider]]\nusd = "top.usda"\nprims = ["/bird/skin"]\n'


def cut(file) -> None:
    content = file.read_bytes()
    file.write_bytes(content[: len(content) // 2])


def inner(folder) -> None:
    """inner.usdc: a skin with samples at 1 to 3."""
    stage = new_stage(folder / "inner.usdc")
    stage.SetDefaultPrim(UsdGeom.Xform.Define(stage, "/bird").GetPrim())
    points, counts, quads = sheet()
    mesh = add_mesh(stage, "/bird/skin", None, counts, quads)
    for code in (1, 2, 3):
        mesh.CreatePointsAttr().Set(vec(lifted(points, 0.001 * code)), code)
    stage.Save()


def layered(folder, arc_of: str):
    """top.usda: names inner.usdc as a sublayer, reference or payload."""
    inner(folder)
    stage = new_stage(folder / "top.usda")
    if arc_of == "sublayer":
        stage.GetRootLayer().subLayerPaths.append("./inner.usdc")
    else:
        prim = stage.DefinePrim("/bird", "Xform")
        add = prim.GetPayloads().AddPayload if arc_of == "payload" else None
        (add or prim.GetReferences().AddReference)("./inner.usdc")
    stage.Save()
    return folder / "inner.usdc"


def clipped(folder):
    """top.usda: a skin whose points come from two value clips."""
    stage = new_stage(folder / "top.usda")
    points, counts, quads = sheet()
    add_mesh(stage, "/bird/skin", None, counts, quads)
    for name, codes in (("manifest", ()), ("one", (1, 2)), ("two", (3, 4))):
        layer = new_stage(folder / f"{name}.usdc")
        attribute = layer.OverridePrim("/bird/skin").CreateAttribute(
            "points", Sdf.ValueTypeNames.Point3fArray
        )
        for code in codes:
            attribute.Set(vec(lifted(points, 0.001 * code)), code)
        layer.Save()
    api = Usd.ClipsAPI(stage.GetPrimAtPath("/bird"))
    api.SetClipAssetPaths([Sdf.AssetPath("./one.usdc"), Sdf.AssetPath("./two.usdc")])
    api.SetClipManifestAssetPath(Sdf.AssetPath("./manifest.usdc"))
    api.SetClipPrimPath("/bird")
    api.SetClipActive([(1, 0), (3, 1)])
    api.SetClipTimes([(1, 1), (4, 4)])
    stage.Save()
    return folder / "two.usdc"


def refused(shot) -> str:
    with pytest.raises(InputError) as caught:
        featherfx.bake(shot, shot.parent / "out.usdc")
    assert not (shot.parent / "out.usdc").exists()
    return str(caught.value)


@pytest.mark.parametrize("arc_of", ["sublayer", "reference", "payload"])
def test_a_skin_behind_a_broken_layer(tmp_path, arc_of):
    file = layered(tmp_path, arc_of)
    shot = write_shot(tmp_path, SKIN, (1, 3))
    assert featherfx.read_shot(shot).skin is not None
    cut(file)
    told = refused(shot)
    assert "no prim /bird/skin in" in told
    assert f"{file}: USD cannot open it" in told
    found = pipeline.check(tmp_path / "top.usda")
    assert [(each.key, "cannot open" in each.message) for each in found] == [(str(file), True)]
    file.unlink()
    told = refused(shot)
    assert f"{file}: is missing" in told
    assert [each.message for each in pipeline.check(tmp_path / "top.usda")] == ["is missing"]


def test_a_collider_behind_a_broken_layer(tmp_path):
    file = layered(tmp_path, "payload")
    cut(file)
    assert f"{file}: USD cannot open it" in refused(
        write_shot(tmp_path, None, (1, 3), more=COLLIDER)
    )


def test_a_groom_behind_a_broken_layer(tmp_path):
    stage = new_stage(tmp_path / "curves.usdc")
    add_curves(stage, "/feathers", [arc()])
    stage.Save()
    top = new_stage(tmp_path / "groom.usda")
    top.GetRootLayer().subLayerPaths.append("./curves.usdc")
    top.Save()
    del stage, top
    cut(tmp_path / "curves.usdc")
    told = refused(write_shot(tmp_path, None, (1, 3), groom="groom.usda"))
    assert "no curves and no instances at / or below" in told
    assert f"{tmp_path / 'curves.usdc'}: USD cannot open it" in told


def test_a_broken_layer_that_a_bake_does_not_need(tmp_path):
    """It counts neither for the skin nor, as it cannot be read, for what the bake depends on."""
    file = layered(tmp_path, "payload")
    other = new_stage(tmp_path / "other.usdc")
    other.SetDefaultPrim(other.DefinePrim("/prop"))
    other.Save()
    del other
    cut(tmp_path / "other.usdc")
    stage = Usd.Stage.Open(str(tmp_path / "top.usda"))
    stage.DefinePrim("/prop").GetPayloads().AddPayload("./other.usdc")
    stage.Save()
    skin = featherfx.read_shot(write_shot(tmp_path, SKIN, (1, 3))).skin
    assert set(skin.parts[0].surface.origin[1]) == {file, tmp_path / "top.usda"}


def test_a_layer_that_breaks_while_a_host_has_it_open(tmp_path):
    file = layered(tmp_path, "payload")
    kept = Usd.Stage.Open(str(tmp_path / "top.usda"))
    cut(file)
    assert f"{file}: USD cannot open it" in refused(write_shot(tmp_path, SKIN, (1, 3)))
    assert kept.GetPrimAtPath("/bird/skin")


def test_clips_that_are_cut_short_or_missing(tmp_path):
    file = clipped(tmp_path)
    shot = write_shot(tmp_path, SKIN, (1, 3))
    files = featherfx.read_shot(shot).skin.parts[0].surface.origin[1]
    names = ("top.usda", "one.usdc", "two.usdc", "manifest.usdc")
    assert set(files) == {tmp_path / name for name in names}
    cut(file)
    assert f"{file}: USD cannot open it" in refused(shot)
    assert any(str(file) in f"{each.key} {each.message}" for each in pipeline.check(shot))
    found = pipeline.check(tmp_path / "top.usda")
    assert any(str(file) in f"{each.key} {each.message}" for each in found)
    file.unlink()
    assert "/bird/skin.points" in refused(shot)


def test_a_file_of_a_newer_usd_is_refused_with_a_remedy(tmp_path):
    inner(tmp_path)
    file = tmp_path / "inner.usdc"
    content = bytearray(file.read_bytes())
    content[8:10] = 0, 250  # major and minor version, after the name of the format
    file.write_bytes(content)
    with pytest.raises(InputError, match=r"version mismatch.*Update usd-core"):
        pipeline.inspect_stage(file)
