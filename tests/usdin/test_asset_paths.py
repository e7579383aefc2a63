"""Files that shots name, found by the asset resolver where they are not beside them."""

from __future__ import annotations

import pytest
from pxr import Ar

import featherfx
from featherfx.errors import InputError
from featherfx.usd.read.values import locate_file, open_stage

GROOM = 'name = "g"\n[[feather]]\nid = "a"\nkind = "covert"\nposition = [0, 0, 0]\n'
SHOT = """
name = "s"
groom = "grooms/one.toml"
frames = [1, 2]
[level_of_detail]
usd = "cameras/main.usda"
prim = "/camera"
"""
CAMERA = '#usda 1.0\n(upAxis = "Z"\nmetersPerUnit = 1)\ndef Camera "camera" {}\n'


@pytest.fixture
def library(tmp_path):
    """A folder on the search path, apart from the shot."""
    folder = tmp_path / "library"
    for name, text in (("grooms/one.toml", GROOM), ("cameras/main.usda", CAMERA)):
        (folder / name).parent.mkdir(parents=True)
        (folder / name).write_text(text)
    Ar.DefaultResolver.SetDefaultSearchPath([str(folder)])
    if str(Ar.GetResolver().Resolve("cameras/main.usda")) != str(folder / "cameras/main.usda"):
        pytest.skip("this USD takes its search path when it starts (PXR_AR_DEFAULT_SEARCH_PATH)")
    yield folder
    Ar.DefaultResolver.SetDefaultSearchPath([])


def test_what_is_beside_the_file_comes_before_the_search_path(library, tmp_path):
    name = "cameras/main.usda"
    shots = tmp_path / "shots"
    assert locate_file(shots, name) == library / name
    own = shots / name
    own.parent.mkdir(parents=True)
    own.write_text(CAMERA)
    assert locate_file(shots, name) == own
    assert locate_file(shots, str(own)) == own
    # what is nowhere is named as seen from the folder
    assert locate_file(shots, "no.usda") == shots / "no.usda"
    assert locate_file(shots, "asset:no.usda") == shots / "asset:no.usda"


def test_a_shot_takes_groom_and_scenes_from_the_search_path(library, tmp_path):
    path = tmp_path / "shot.toml"
    path.write_text(SHOT)
    shot = featherfx.read_shot(path)
    assert [each.id for each in shot.groom.feathers] == ["a"]
    assert library / "cameras/main.usda" in shot.document.files
    assert open_stage("cameras/main.usda").GetPrimAtPath("/camera")
    Ar.DefaultResolver.SetDefaultSearchPath([])
    with pytest.raises(InputError, match=r"grooms/one\.toml: there is no such file"):
        featherfx.read_shot(path)
