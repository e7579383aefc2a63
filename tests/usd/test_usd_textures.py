"""Colours as pictures that materials take, read by another process as other programs read them."""

from __future__ import annotations

import json
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from feathers import entries
from places import COARSE
from pxr import Usd, UsdGeom, UsdShade

import featherfx
from featherfx.errors import InputError
from featherfx.usd.check.check import check_usd
from featherfx.usd.write.cache_writer import CacheWriter
from featherfx.usd.write.materials import Atlas
from featherfx.usd.write.options import WriteOptions

pytest.importorskip("PIL")
GROOM = """name = "painted"
[[feather]]
id = "barred"
kind = "owl_primary"
position = [0, 0, 0]
[[feather]]
id = "shining"
kind = "covert"
position = [0, 0.2, 0]
[feather.overrides.colour]
base = [0.2, 0.25, 0.3]
brightness_variation = 0.2
film = 5e-7
patterns = [{ kind = "gradient", colour = [0.9, 0.3, 0.2], film = 0 }]
[[feather]]
id = "shining_too"
kind = "covert"
position = [0, 0.4, 0]
[feather.overrides.colour]
base = [0.2, 0.25, 0.3]
brightness_variation = 0.2
film = 5e-7
patterns = [{ kind = "gradient", colour = [0.9, 0.3, 0.2], film = 0 }]
"""
SHOT = 'name = "s"\ngroom = "groom.toml"\nframes = [1, 2]\n' + COARSE
# of each prim: pictures' colours at its points beside the shaft, and displayColor
READER = """
import json, sys
import numpy as np
from PIL import Image
from pxr import Usd, UsdGeom, UsdShade
stage, found = Usd.Stage.Open(sys.argv[1]), {}
material = UsdShade.Material(stage.GetDefaultPrim().GetChild("materials").GetChild("vane"))
(texture,), _ = material.ComputeSurfaceSource()[0].GetInput("diffuseColor").GetConnectedSources()
asset = UsdShade.Shader(texture.source.GetPrim()).GetInput("file").Get()
image = np.asarray(Image.open(asset.resolvedPath)).astype(float) / 255.0
image = np.where(image <= 0.04045, image / 12.92, ((image + 0.055) / 1.055) ** 2.4)
for prim in stage.Traverse():
    primvars = UsdGeom.PrimvarsAPI(prim)
    if not primvars.HasPrimvar("atlas"):
        continue
    u, v = np.array(primvars.GetPrimvar("atlas").Get()).T
    side = len(image)
    at = np.clip(side - 1 - (v * side).astype(int), 0, side - 1), (u * side).astype(int)
    off = np.abs(np.array(primvars.GetPrimvar("st").Get())[:, 0] - 0.5) > 0.06
    shown = np.array(primvars.GetPrimvar("displayColor").Get())
    found[str(prim.GetPath())] = [image[at][off].tolist(), shown[off].tolist()]
print(json.dumps(found))
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    made = tmp_path_factory.mktemp("textures")
    (made / "groom.toml").write_text(GROOM)
    (made / "shot.toml").write_text(SHOT)
    for group in ("feather", "all"):
        featherfx.bake(
            made / "shot.toml", made / f"{group}.usdc", group=group, barbs=12, textures=256,
            render_rows=40, render_columns=8,
        )  # fmt: skip
    return made


@pytest.mark.parametrize("group", ["feather", "all"])
def test_pictures_have_the_colours_of_points(folder, group):
    run = [sys.executable, "-c", READER, str(folder / f"{group}.usdc")]
    found = json.loads(subprocess.run(run, capture_output=True, check=True, text=True).stdout)
    assert len(found) == (6 if group == "feather" else 2)  # meshes and barbs
    for path, (painted, shown) in found.items():
        apart = np.abs(np.array(painted) - np.array(shown)).max(axis=1)
        # borders of bars lie between two pixels
        assert np.median(apart) < 0.01, path
        assert np.mean(apart < 0.05) > 0.9, path
        assert np.ptp(np.array(painted), axis=0).max() > 0.2  # there is something to see


def test_each_vane_has_a_place_of_its_own(folder):
    """The middle of no face lies in another one, of all vanes of a cache; the vanes of a feather
    have half its chart each."""
    stage = Usd.Stage.Open(str(folder / "all.usdc"))
    primvars = UsdGeom.PrimvarsAPI(stage.GetPrimAtPath("/all/feathers/all"))
    corners = np.array(UsdGeom.Mesh(primvars.GetPrim()).GetFaceVertexIndicesAttr().Get())
    side = np.array(primvars.GetPrimvar("side").Get())
    vane = side < 2
    faces, side = corners.reshape(-1, 3)[vane], side[vane]
    st, atlas = (np.array(primvars.GetPrimvar(name).Get()) for name in ("st", "atlas"))
    assert st[faces[side == 0], 0].min() == st[faces[side == 1], 0].max() == 0.5
    a, b, c = np.moveaxis(atlas[faces].astype(float), 1, 0)

    def left_of(start, end, points):
        way = end - start
        return way[:, None, 0] * (points[None, :, 1] - start[:, None, 1]) - way[:, None, 1] * (
            points[None, :, 0] - start[:, None, 0]
        )

    middle = (a + b + c) / 3.0
    turns = np.stack([left_of(*ends, middle) for ends in ((a, b), (b, c), (c, a))])
    within = (turns > 0.0).all(axis=0) | (turns < 0.0).all(axis=0)
    assert len(faces) > 1500
    assert (within == np.eye(len(faces), dtype=bool)).all()


def test_each_feather_has_a_chart_of_its_own(folder):
    stage = Usd.Stage.Open(str(folder / "all.usdc"))
    primvars = UsdGeom.PrimvarsAPI(stage.GetPrimAtPath("/all/rachises/all_rachis"))
    charts = np.array(primvars.GetPrimvar("chart").Get())
    assert primvars.GetPrimvar("chart").GetInterpolation() == "uniform"
    assert len(np.unique(charts[:, :2], axis=0)) == 3
    mesh = UsdGeom.PrimvarsAPI(stage.GetPrimAtPath("/all/feathers/all"))
    st, atlas = (np.array(mesh.GetPrimvar(name).Get()) for name in ("st", "atlas"))
    ranges = np.array(mesh.GetPrim().GetAttribute("featherRange:points").Get())
    for (first, number), chart in zip(ranges, charts, strict=True):
        own = slice(first, first + number)
        assert atlas[own] == pytest.approx(st[own] * chart[2:] + chart[:2], abs=1e-6)


@pytest.mark.parametrize(("feathers", "pixels"), [(1, 32), (3, 256), (200, 100), (3000, 512)])
def test_charts_lie_apart_within_their_tiles(feathers, pixels):
    atlas = Atlas(feathers, pixels)
    charts, side = atlas.charts, atlas.side
    low, high = charts[:, :2], charts[:, :2] + charts[:, 2:]
    assert np.array_equal(np.floor(low), np.floor(high))
    tiles = np.floor(low).astype(int) @ [1, 10]
    assert np.array_equal(np.unique(tiles), np.arange(len(atlas.files(Path("a.usdc")))))
    # corners in pixels of all tiles: no pixel is in two charts
    corners = np.round((low - np.floor(low)) * side).astype(int) - 2
    place = tiles * side * side + corners[:, 1] // pixels * side + corners[:, 0] // (pixels // 2)
    assert len(np.unique(place)) == feathers
    assert ("<UDIM>" in atlas.asset(Path("a.usdc"))) == (tiles.max() > 0)


def test_the_film_is_data_for_the_shader(folder):
    stage = Usd.Stage.Open(str(folder / "feather.usdc"))
    for name, thickness in (("barred", {0.0}), ("shining", {0.0, 500.0})):
        mesh = UsdGeom.PrimvarsAPI(stage.GetPrimAtPath(f"/feather/feathers/{name}"))
        assert set(mesh.GetPrimvar("filmThickness").Get()) == thickness
    material = UsdShade.Material.Get(stage, "/feather/materials/vane")
    surface, _, _ = material.ComputeSurfaceSource("mtlx")
    assert surface.GetIdAttr().Get() == "ND_standard_surface_surfaceshader"
    sources = {}
    for name in ("base_color", "thin_film_thickness"):
        (source,), _ = surface.GetInput(name).GetConnectedSources()
        sources[name] = UsdShade.Shader(source.source.GetPrim())
    assert sources["base_color"].GetIdAttr().Get() == "ND_image_color3"
    assert sources["thin_film_thickness"].GetInput("geomprop").Get() == "filmThickness"
    assert check_usd(folder / "feather.usdc") == []


def test_what_was_painted_over_is_not_replaced(folder):
    from PIL import Image

    output, picture = folder / "again.usdc", folder / "again.colour.1001.png"
    featherfx.bake(folder / "shot.toml", output)
    # pictures are added without simulating again
    report = featherfx.bake(folder / "shot.toml", output, textures=64, resume=True).report
    assert report["newton_iterations"]["mean"] == 0.0
    with Image.open(picture) as image:
        plain = np.asarray(image)
        image.rotate(180).save(picture)
    (folder / "groom.toml").write_text(GROOM.replace("0.25, 0.3]", "0.5, 0.3]"))
    with pytest.raises(InputError, match="not as featherfx wrote it"):
        featherfx.bake(folder / "shot.toml", output, textures=64, resume=True)
    featherfx.bake(folder / "shot.toml", output, textures=64, overwrite=True)
    assert not np.array_equal(np.asarray(Image.open(picture)), plain)
    picture.unlink()
    (problem,) = check_usd(output)
    assert "again.colour.1001.png" in problem.key
    (folder / "groom.toml").write_text(GROOM)


def test_a_feather_without_a_kind_is_plain(tmp_path):
    from PIL import Image

    given = [replace(each, static=True) for each in entries()]
    with CacheWriter(tmp_path / "a.usdc", given, None, options=WriteOptions(textures=32)):
        pass
    assert len(np.unique(np.asarray(Image.open(tmp_path / "a.colour.1001.png")))) == 3


def test_groom_writes_no_pictures_of_instances(folder):
    with pytest.raises(InputError, match="not written of instances"):
        featherfx.baking.pipeline.export_groom(
            folder / "groom.toml", folder / "g.usdc", textures=64, instances=True
        )
