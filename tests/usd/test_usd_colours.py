"""Colours of feathers in caches: on points, curves and materials, alone and in groups."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from places import SAMPLES
from pxr import Usd, UsdGeom, UsdShade

import featherfx
from featherfx.algebra.srgb import linear
from featherfx.feather.colours import VANE
from featherfx.shot.dependence import dependences
from featherfx.shot.read.read import read_shot
from featherfx.usd.check.check import check_usd
from featherfx.usd.read.read import Cache

SWAN = SAMPLES / "swan_wing" / "groom.toml"
RED = (0.8, 0.1, 0.1)
GROOM = f"""name = "coloured"
[[feather]]
id = "red"
kind = "covert"
position = [0, 0, 0]
overrides = {{ colour.base = {list(RED)}, colour.shaft = [0, 0, 0] }}
[[feather]]
id = "plain"
kind = "covert"
position = [0, 0.2, 0]
"""


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    folder = tmp_path_factory.mktemp("colours")
    (folder / "groom.toml").write_text(GROOM)
    (folder / "shot.toml").write_text(
        'name = "s"\ngroom = "groom.toml"\nframes = [1, 2]\nquality = "draft"\n'
    )
    for group in ("feather", "all"):
        featherfx.bake(folder / "shot.toml", folder / f"{group}.usdc", group=group, barbs=12)
    return folder


def display(stage, path):
    return UsdGeom.PrimvarsAPI(stage.GetPrimAtPath(path)).GetPrimvar("displayColor")


def test_every_point_has_its_colour(files):
    stage = Usd.Stage.Open(str(files / "feather.usdc"))
    red, plain = (display(stage, f"/feather/feathers/{name}") for name in ("red", "plain"))
    for primvar, colour in ((red, linear(np.array(RED))), (plain, VANE)):
        assert primvar.GetInterpolation() == "vertex"
        shades = np.array(primvar.Get())
        assert np.unique(shades, axis=0).shape[0] == 2  # vanes and shaft
        assert np.isclose(shades, colour, atol=1e-6).all(axis=1).any()
    barbs = np.array(display(stage, "/feather/barbs/red_barbs").Get())
    assert barbs == pytest.approx(np.tile(linear(np.array(RED)), (len(barbs), 1)), abs=1e-6)
    shaft = np.array(display(stage, "/feather/rachises/red_rachis").Get())
    assert shaft == pytest.approx(np.zeros((1, 3)))
    assert check_usd(files / "feather.usdc") == []


def test_materials_take_the_colours(files):
    stage = Usd.Stage.Open(str(files / "feather.usdc"))
    mesh = stage.GetPrimAtPath("/feather/feathers/red")
    material, _ = UsdShade.MaterialBindingAPI(mesh).ComputeBoundMaterial()
    surface, _, _ = material.ComputeSurfaceSource()
    (source,), _ = surface.GetInput("diffuseColor").GetConnectedSources()
    reader = UsdShade.Shader(source.source.GetPrim())
    assert reader.GetIdAttr().Get() == "UsdPrimvarReader_float3"
    assert reader.GetInput("varname").Get() == "displayColor"


def test_feathers_of_a_group_have_the_colours_of_each_alone(files):
    alone, together = (Cache(files / f"{name}.usdc") for name in ("feather", "all"))
    both = [{each.id: each.colour for each in cache.feathers} for cache in (alone, together)]
    for name in ("red", "plain"):
        assert np.array_equal(both[0][name], both[1][name])
    assert check_usd(files / "all.usdc") == []


def test_without_colours_all_is_as_keratin(tmp_path):
    shot = tmp_path / "shot.toml"
    shot.write_text(
        f'name = "s"\ngroom = "{SWAN.as_posix()}"\nframes = [1, 1]\nquality = "draft"\n'
    )
    featherfx.bake(shot, tmp_path / "swan.usdc")
    stage = Usd.Stage.Open(str(tmp_path / "swan.usdc"))
    mesh = display(stage, "/swan/feathers/right_primary_01")
    assert mesh.GetInterpolation() == "constant"


def test_motion_does_not_depend_on_colours(files):
    shot = read_shot(files / "shot.toml")
    red, plain = shot.groom.feathers
    other = replace(red, kind=replace(red.kind, colour=plain.kind.colour))
    swapped = replace(shot, groom=replace(shot.groom, feathers=(other, plain)))
    assert dependences(shot) == dependences(swapped)


def test_another_colour_is_written_without_simulating_again(files):
    changed = files / "again"
    changed.mkdir()
    for name in ("groom.toml", "shot.toml"):
        (changed / name).write_text((files / name).read_text())
    output = changed / "s.usdc"
    featherfx.bake(changed / "shot.toml", output)
    (changed / "groom.toml").write_text(GROOM.replace(str(list(RED)), "[0.1, 0.8, 0.1]"))
    report = featherfx.bake(changed / "shot.toml", output, resume=True)
    assert report["newton_iterations"]["mean"] == 0.0
    red = {each.id: each.colour for each in Cache(output).feathers}["red"]
    assert np.isclose(red, linear(np.array([0.1, 0.8, 0.1])), atol=1e-6).all(axis=1).any()
