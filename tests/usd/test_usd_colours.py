"""Colours of feathers in caches: on points, curves and materials, alone and in groups."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from places import COARSE, SAMPLES
from pxr import Usd, UsdGeom, UsdShade

import featherfx
from featherfx.errors import InputError
from featherfx.groom.materials import VANE_COLOUR, linear
from featherfx.shot.motion.motion import motion_dependences
from featherfx.shot.read.read import read_shot
from featherfx.usd.check.check import check_usd
from featherfx.usd.convert.condensed import export_condensed
from featherfx.usd.read.cache import Cache

SWAN = SAMPLES / "swan_wing" / "groom.toml"
RED = (0.8, 0.1, 0.1)
GROOM = f"""name = "coloured"
[[feather]]
id = "red"
kind = "covert"
position = [0, 0, 0]
overrides = {{ colour.base = {list(RED)}, colour.rachis = [0, 0, 0] }}
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
        f'name = "s"\ngroom = "groom.toml"\nframes = [1, 2]\n{COARSE}'
    )
    for group in ("feather", "all"):
        featherfx.bake(folder / "shot.toml", folder / f"{group}.usdc", group=group, barbs=12)
    return folder


def display(stage, path):
    return UsdGeom.PrimvarsAPI(stage.GetPrimAtPath(path)).GetPrimvar("displayColor")


def test_every_point_has_its_colour(files):
    stage = Usd.Stage.Open(str(files / "feather.usdc"))
    red, plain = (display(stage, f"/feather/feathers/{name}") for name in ("red", "plain"))
    for primvar, colour in ((red, linear(np.array(RED))), (plain, VANE_COLOUR)):
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
    shot.write_text(f'name = "s"\ngroom = "{SWAN.as_posix()}"\nframes = [1, 1]\n{COARSE}')
    featherfx.bake(shot, tmp_path / "swan.usdc")
    stage = Usd.Stage.Open(str(tmp_path / "swan.usdc"))
    mesh = display(stage, "/swan/feathers/right_primary_01")
    assert mesh.GetInterpolation() == "constant"


def test_motion_does_not_depend_on_colours(files):
    shot = read_shot(files / "shot.toml")
    red, plain = shot.groom.feathers
    other = replace(red, kind=replace(red.kind, colour=plain.kind.colour))
    swapped = replace(shot, groom=replace(shot.groom, feathers=(other, plain)))
    assert motion_dependences(shot) == motion_dependences(swapped)


def test_another_colour_is_written_without_simulating_again(files):
    changed = files / "again"
    changed.mkdir()
    for name in ("groom.toml", "shot.toml"):
        (changed / name).write_text((files / name).read_text())
    output = changed / "s.usdc"
    featherfx.bake(changed / "shot.toml", output)
    (changed / "groom.toml").write_text(GROOM.replace(str(list(RED)), "[0.1, 0.8, 0.1]"))
    report = featherfx.bake(changed / "shot.toml", output, resume=True).report
    assert report["newton_iterations"]["mean"] == 0.0
    red = {each.id: each.colour for each in Cache(output).feathers}["red"]
    assert np.isclose(red, linear(np.array([0.1, 0.8, 0.1])), atol=1e-6).all(axis=1).any()


@pytest.fixture(scope="module")
def condensed(files):
    """The two feathers, one with bars that shine, as meshes and condensed, alone and together."""
    folder = files / "condensed"
    folder.mkdir()
    bars = 'colour.patterns = [{ kind = "bars", colour = [0, 0, 0.4], film = 4e-7 }]'
    groom = GROOM.replace(
        "colour.rachis", f"colour.brightness_variation = 0.2, {bars}, colour.rachis"
    )
    (folder / "groom.toml").write_text(groom)
    (folder / "shot.toml").write_text((files / "shot.toml").read_text())
    for form, group in (("mesh", "feather"), ("condensed", "feather"), ("condensed", "all")):
        output = folder / f"{form}_{group}.usdc"
        featherfx.bake(folder / "shot.toml", output, form=form, group=group)
    return folder


@pytest.mark.parametrize("group", ["feather", "all"])
def test_condensed_feathers_have_the_colours_of_meshes(condensed, group):
    meshes = {each.id: each for each in Cache(condensed / "mesh_feather.usdc").feathers}
    found = Cache(condensed / f"condensed_{group}.usdc").feathers
    assert len(found) == len(meshes) == 2
    for each in found:
        assert each.colour == pytest.approx(meshes[each.id].colour, abs=1e-6)
        assert each.film == pytest.approx(meshes[each.id].film, abs=1e-3)
    assert check_usd(condensed / f"condensed_{group}.usdc") == []
    barbs = featherfx.expand(condensed / f"condensed_{group}.usdc", rows=30, barbs=20)
    for each, own in zip(barbs.feathers, barbs.colours, strict=True):
        assert own.points.shape == (len(each.st), 3)
        assert own.barbs.shape == (9 * len(each.barb_side), 3)
        assert len(np.unique(own.barbs.round(3), axis=0)) > (2 if each.id == "red" else 0)


def test_barbs_of_condensed_feathers_carry_their_colours(condensed):
    """Every node has the colour of the mesh's point at that place."""
    stage = Usd.Stage.Open(str(condensed / "condensed_feather.usdc"))
    mesh = next(e for e in Cache(condensed / "mesh_feather.usdc").feathers if e.id == "red")
    primvars = UsdGeom.PrimvarsAPI(stage.GetPrimAtPath("/condensed_feather/rachises/red_rachis"))
    for end in "lr":
        shades, places, widths = (
            np.array(primvars.GetPrimvar(f"{name}_barb{end}").Get())
            for name in ("displayColor", "uv", "width")
        )
        assert primvars.GetPrimvar(f"displayColor_barb{end}").GetElementSize() == 2
        grown = np.flatnonzero(widths > 0.0)
        assert len(grown) > 4
        for k in grown:
            near = np.linalg.norm(mesh.st - places[k], axis=1)
            if near.min() < 1e-6:
                assert shades[k] == pytest.approx(mesh.colour[near.argmin()], abs=1e-6)


def test_an_export_to_condensed_feathers_takes_the_colours_along(condensed, tmp_path):
    """All nodes of a mesh's barbs have its colours, and the shaft that of its surface."""
    export_condensed(condensed / "mesh_feather.usdc", tmp_path / "plain.usdc")
    cache = Cache(condensed / "mesh_feather.usdc")
    k, mesh = next((k, e) for k, e in enumerate(cache.feathers) if e.id == "red")
    points, stage = cache.points(k), Usd.Stage.Open(str(tmp_path / "plain.usdc"))
    primvars = UsdGeom.PrimvarsAPI(stage.GetPrimAtPath("/plain/red"))
    assert np.array(primvars.GetPrimvar("displayColor").Get()) == pytest.approx(np.zeros((1, 3)))
    for end in "lr":
        nodes = np.array(primvars.GetPrimvar(f"P_barb{end}").Get())
        shades = np.array(primvars.GetPrimvar(f"displayColor_barb{end}").Get())
        assert len(shades) == len(nodes)
        near = np.linalg.norm(points[:, None] - nodes, axis=2)
        found = near.min(axis=0) < 1e-7
        assert found.sum() > 0.5 * len(nodes)
        vane = np.unique(mesh.triangles[mesh.side != 2])
        off = np.abs(shades - mesh.colour[vane][near[vane].argmin(axis=0)]).max(axis=1)
        # nodes of rows without a barb are on the shaft, and have its colour
        assert (off[near[vane].min(axis=0) < 1e-7] < 1e-6).mean() > 0.7
        assert len(np.unique(shades.round(3), axis=0)) > 2


def test_a_colour_that_a_cache_tells_wrong_is_refused(condensed, tmp_path):
    stage = Usd.Stage.Open(str(condensed / "condensed_all.usdc"))
    (prim,) = [each for each in stage.Traverse() if each.IsA(UsdGeom.BasisCurves)]
    primvar = UsdGeom.PrimvarsAPI(prim).GetPrimvar("featherColour")
    primvar.Set(['{"base":[2,0,0]}'] * len(primvar.Get()))
    stage.Export(str(tmp_path / "wrong.usdc"))
    with pytest.raises(InputError, match=r"featherColour.*base\[0\].*out of range"):
        featherfx.expand(tmp_path / "wrong.usdc")
