"""Bare skin under feathers, against a raster of the same feathers, and against discs left open."""

import json
import subprocess
import sys

import numpy as np
import pytest
import trimesh
from commands import invoke
from regions_skin import SKIN, region, write_skin
from scipy.ndimage import distance_transform_edt

from featherfx.api import build, read_groom
from featherfx.baking.pipeline import measure_coverage

pytest.importorskip("embreex", reason="no wheel for this platform")
pytestmark = pytest.mark.filterwarnings("ignore:.*is not closed")

SIDE, CELLS = 0.1, 200  # m and cells of a raster
KEYS = "length = 0.02\ntilt = 25\n"
DISC = 0.02  # m, radius


def plane(folder, keys):
    """A groom of one region on a level square."""
    ends = np.linspace(-0.5 * SIDE, 0.5 * SIDE, 21)
    points = np.array([(x, y, 0.0) for x in ends for y in ends])
    corner = np.array([21 * i + j for i in range(20) for j in range(20)])
    quads = [corner, corner + 21, corner + 22], [corner, corner + 22, corner + 1]
    write_skin(folder, trimesh.Trimesh(points, np.concatenate(quads, axis=1).T, process=False))
    path = folder / "groom.toml"
    path.write_text(SKIN + region(keys=KEYS + keys))
    return path


def raster(path):
    """Whether cells of the square have a feather above them."""
    groom = read_groom(path)
    covered = np.zeros((CELLS, CELLS), dtype=bool)
    middles = SIDE * ((np.arange(CELLS) + 0.5) / CELLS - 0.5)
    for placed, feather in zip(groom.feathers, build(groom, "draft"), strict=True):
        points = feather.surface.points(feather.rest) @ placed.rotation.T + placed.position
        for corners in points[feather.surface.triangles]:
            if corners[:, 2].mean() < 0.0:
                continue
            low, high = (
                np.searchsorted(middles, f(corners[:, :2], axis=0)) for f in (np.min, np.max)
            )
            x, y = np.meshgrid(
                *(middles[a:b] for a, b in zip(low, high, strict=True)), indexing="ij"
            )
            sides = [
                (b[0] - a[0]) * (y - a[1]) - (b[1] - a[1]) * (x - a[0])
                for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True)
            ]
            inside = np.logical_or(np.min(sides, axis=0) >= 0, np.max(sides, axis=0) <= 0)
            covered[low[0] : high[0], low[1] : high[1]] |= inside
    return covered


@pytest.mark.parametrize("count", [12, 40])
def test_bare_skin_and_its_largest_hole_are_those_of_a_raster(tmp_path, count):
    path = plane(tmp_path, f"count = {count}")
    covered = raster(path)
    found = measure_coverage(path, quality="draft")
    own = found["tracts"]["body"]
    assert own["area"] == pytest.approx(SIDE**2, rel=1e-6)
    assert own["count"] == count
    assert own["bare"] == pytest.approx(1.0 - covered.mean(), abs=0.01)
    hole = 2.0 * distance_transform_edt(~covered).max() * SIDE / CELLS
    assert own["largest_hole"] == pytest.approx(hole, rel=0.02, abs=4.0 * found["spacing"])
    assert own["overlap"] == pytest.approx(0.02 * np.sqrt(count) / SIDE, rel=1e-6)
    assert found["tracts"]["all"] == own


def test_skin_of_no_region_is_neither_bare_nor_of_a_tract(tmp_path):
    disc = f"{{ sphere = {{ centre = [0, 0, 0], radius = {DISC} }}, invert = true }}"
    path = plane(tmp_path, f"count = 400\nwhere = [{disc}]")
    found = measure_coverage(path, quality="draft")
    assert found["featherless_area"] == pytest.approx(np.pi * DISC**2, rel=0.1)
    assert found["tracts"]["body"]["area"] + found["featherless_area"] == pytest.approx(SIDE**2)
    assert found["tracts"]["body"]["bare"] < 0.1


@pytest.mark.parametrize(
    ("missing", "drawn", "told"),
    [
        ("PIL", False, ""),
        ("PIL", True, "Pillow, which writes pictures, is not installed"),
        ("embreex", False, "Embree, which casts rays, is not installed"),
    ],
)
def test_a_package_is_asked_for_only_by_what_needs_it(tmp_path, missing, drawn, told):
    path, picture = plane(tmp_path, "count = 4"), tmp_path / "bare.png"
    code = f"""
import importlib.util, sys
sys.modules[{missing!r}] = None
find = importlib.util.find_spec
importlib.util.find_spec = lambda name, *own: None if name == {missing!r} else find(name, *own)
from featherfx.baking.pipeline import measure_coverage
from featherfx.errors import InputError
try:
    measure_coverage({str(path)!r}, {str(picture) if drawn else None!r}, quality="draft")
except InputError as error:
    print(error)
"""
    printed = subprocess.check_output([sys.executable, "-W", "ignore", "-c", code], text=True)
    assert (told in printed) if told else not printed


def test_feathers_far_apart_are_exposed_and_close_ones_hide_each_other(tmp_path):
    exposed = []
    for count in (4, 60, 400):
        (tmp_path / f"{count}").mkdir()
        path = plane(tmp_path / f"{count}", f"count = {count}")
        exposed.append(measure_coverage(path, quality="draft")["tracts"]["body"]["exposed"])
    assert exposed[0] == 1.0
    assert exposed[0] > exposed[1] > exposed[2] > 0.0


def test_the_command_prints_and_draws_and_writes_nothing_else(tmp_path):
    path = plane(tmp_path, "count = 12")
    before = sorted(tmp_path.iterdir())
    found = json.loads(invoke("groom", path, "--coverage", "--json").stdout)
    assert set(found["tracts"]["body"]) == {
        *("area", "bare", "count", "largest_hole", "overlap", "exposed")
    }
    assert sorted(tmp_path.iterdir()) == before
    picture = tmp_path / "bare.png"
    assert "body: 12 feathers" in invoke("groom", path, "--coverage", "-o", picture).stdout
    assert sorted(tmp_path.iterdir()) == sorted([*before, picture])


@pytest.mark.parametrize(
    ("options", "told"),
    [
        (["-o", "feathers.usda", "--coverage"], "Name a .png file"),
        (["--json"], "--json goes with --coverage"),
        ([], "Missing option '-o'"),
        (["--coverage", "--barbs", "9"], "--barbs does not go with --coverage"),
    ],
)
def test_options_that_exclude_each_other_are_told(tmp_path, options, told):
    result = invoke("groom", plane(tmp_path, "count = 4"), *options)
    assert result.exit_code
    assert told in result.stderr


def test_a_groom_without_a_skin_has_no_coverage(tmp_path):
    path = tmp_path / "groom.toml"
    path.write_text("name = 'one'\n[[feather]]\nid = 'a'\nkind = 'contour'\nposition = [0, 0, 0]\n")
    assert "[[region]] or [bird]" in invoke("groom", path, "--coverage").stderr
