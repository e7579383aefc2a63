"""No output takes the place of a file that it is made from, whatever --overwrite says."""

import pytest
from usdin_scenes import add_curves, add_mesh, arc, new_stage, sheet, write_shot

import featherfx
from featherfx.baking.pipeline import export_groom
from featherfx.errors import InputError


@pytest.fixture
def shot(tmp_path):
    """A groom and a skin in USD; the skin's file has its mesh in a sublayer."""
    stage = new_stage(tmp_path / "bird.usda")
    add_curves(stage, "/bird/wing", [arc()], ids=["a"])
    stage.Save()
    points, counts, quads = sheet()
    body = new_stage(tmp_path / "body.usda")
    add_mesh(body, "/bird/skin", points, counts, quads)
    body.Save()
    top = new_stage(tmp_path / "skin.usda")
    top.GetRootLayer().subLayerPaths.append("./body.usda")
    top.Save()
    skin = 'usd = "skin.usda"\nprim = "/bird/skin"\ntolerance = 1'
    return write_shot(tmp_path, skin, (1, 2), groom="bird.usda")


def contents(folder):
    return {file.name: file.read_bytes() for file in folder.iterdir() if file.is_file()}


@pytest.mark.parametrize("name", ["bird.usda", "skin.usda", "body.usda"])
def test_a_bake_keeps_grooms_skins_and_their_layers(tmp_path, shot, name):
    before = contents(tmp_path)
    for resume in (False, True):
        with pytest.raises(InputError, match=f"{name}: is an input"):
            featherfx.bake(shot, tmp_path / name, overwrite=True, resume=resume)
    assert contents(tmp_path) == before


def test_an_input_under_another_name_is_the_same_file(tmp_path, shot):
    (tmp_path / "alias.usda").hardlink_to(tmp_path / "body.usda")
    with pytest.raises(InputError, match="is an input"):
        featherfx.bake(shot, tmp_path / "alias.usda", overwrite=True)


def test_a_report_keeps_the_shot_and_the_cache(tmp_path, shot):
    before = contents(tmp_path)
    with pytest.raises(InputError, match=r"shot\.toml: is an input"):
        featherfx.bake(shot, tmp_path / "o.usdc", report=shot)
    with pytest.raises(InputError, match=r"o\.usdc: is the cache itself"):
        featherfx.bake(shot, tmp_path / "o.usdc", report=tmp_path / "o.usdc")
    assert contents(tmp_path) == before


def test_rest_feathers_and_exports_keep_their_source(tmp_path, shot):
    with pytest.raises(InputError, match=r"bird\.usda: is an input"):
        export_groom(tmp_path / "bird.usda", tmp_path / "bird.usda", overwrite=True)
    cache = tmp_path / "o.usda"
    featherfx.bake(shot, cache, layout="payload")
    before = contents(tmp_path)
    for name in ("o.usda", "o.payload.usdc"):
        for condensed in (False, True):
            with pytest.raises(InputError, match="is an input"):
                featherfx.export(cache, tmp_path / name, condensed=condensed, overwrite=True)
    assert contents(tmp_path) == before


def test_an_older_cache_that_is_no_input_is_replaced(tmp_path, shot):
    for _ in range(2):
        featherfx.bake(shot, tmp_path / "o.usda", overwrite=True)
    assert featherfx.check(tmp_path / "o.usda") == []
