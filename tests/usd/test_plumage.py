"""Measures of a plumage against feathers that stand on a plane at angles that are known."""

import json

import feathers
import numpy as np
import pytest
from commands import invoke
from usd_meshes import SQUARE, define_mesh, new_stage

from featherfx.baking.pipeline import measure_plumage
from featherfx.usd.types import FeatherEntry
from featherfx.usd.write.cache_writer import CacheWriter
from featherfx.usd.write.options import WriteOptions

SPACING, SIDE = 0.05, 5
LOW, STEEP = np.radians(4.0), np.radians(20.0)


def write(folder, places, **options):
    """Feathers at places (id, region, offset, angle), and a plane beneath; their paths."""
    path, skin = folder / "plumage.usda", folder / "skin.usda"
    one = feathers.feather()
    entries = [
        FeatherEntry(id, "k", region, one, feathers.placed(offset, -angle), static=True)
        for id, region, offset, angle in places
    ]
    with CacheWriter(path, entries, None, 24.0, WriteOptions(**options)):
        pass
    stage = new_stage(skin, 0.01)
    define_mesh(stage, "/skin", 50.0 * SQUARE, scheme=None)
    stage.Save()
    return path, skin


def rows(angles):
    """A square of feathers of two tracts, and wing feathers that do not count."""
    for k, (i, j) in enumerate(np.ndindex(SIDE, SIDE)):
        # none stands in another: across they are 4 cm wide
        at = (SPACING * i, SPACING * j, 0.0)
        tract = "steep" if j > 2 else "low"
        yield f"{tract}_{k}", tract, at, angles[j > 2]
    yield "left_wing_primary", "left wing", (0.0, -0.3, 0.0), 1.0


@pytest.mark.parametrize("options", [{"group": "all"}, {"up_axis": "Y", "meters_per_unit": 0.01}])
def test_angles_and_heights_are_those_of_the_feathers(tmp_path, options):
    path, skin = write(tmp_path, rows((LOW, STEEP)), **options)
    found = measure_plumage(path, skin, "/skin")
    assert set(found) == {"all", "low", "steep"}
    assert found["all"]["feathers"] == SIDE**2
    for tract, angle in (("low", LOW), ("steep", STEEP)):
        own = found[tract]
        for key in ("angle_mid_p50", "angle_mid_p90", "angle_tip_p50"):
            assert own[key] == pytest.approx(np.degrees(angle), rel=1e-3), key
        assert own["tip_height_p90"] == pytest.approx(np.sin(angle), rel=1e-3)
    assert found["low"]["neighbour_height_p50"] == pytest.approx(0.0, abs=1e-6)


@pytest.mark.parametrize("side", [1.0, -1.0])
@pytest.mark.parametrize("options", [{"group": "all"}, {"up_axis": "Y", "meters_per_unit": 0.01}])
def test_what_lies_on_a_tail_is_measured_from_its_vanes(tmp_path, options, side):
    """Above it as below; what is farther from it than from the skin is measured from the skin."""
    high, gap = 0.08, 0.002
    places = [
        ("tail_01", "tail", (0.0, 0.0, high), 0.0),
        ("rump_1", "rump", (0.0, 0.0, high + side * gap), side * LOW),
        ("back_1", "back", (0.0, 0.3, 0.0), STEEP),
    ]
    found = measure_plumage(*write(tmp_path, places, **options), "/skin")
    assert found["rump"]["angle_mid_p50"] == pytest.approx(np.degrees(LOW), rel=0.02)
    height = gap / feathers.LENGTH + np.sin(LOW)
    assert found["rump"]["tip_height_p90"] == pytest.approx(height, rel=0.02)
    assert found["back"]["tip_height_p90"] == pytest.approx(np.sin(STEEP), rel=1e-3)


def test_overlap_is_length_over_spacing(tmp_path):
    path, skin = write(tmp_path, rows((LOW, LOW)))
    # the rim, whose skin reaches as far as a feather, is a third of the number of all
    spread = (SPACING * (SIDE - 1) + 2.0 * feathers.LENGTH) / SIDE
    assert measure_plumage(path, skin, "/skin")["all"]["overlap"] == pytest.approx(
        feathers.LENGTH / spread, rel=0.05
    )


def test_pairs_intersect_where_one_stands_in_another(tmp_path):
    places = [
        ("one", "breast", (0.0, 0.0, 0.0), 0.15),
        ("flat", "belly", (0.02, 0.004, 0.006), 0.0),
        ("other", "back", (0.5, 0.0, 0.0), 0.15),
        ("steeper", "rump", (0.52, 0.004, 0.006), 0.3),
    ]
    path, skin = write(tmp_path, places)
    told = invoke("check", "--plumage", path, "--skin", skin, "/skin", "--json")
    pairs = {tract: each["intersecting_pairs"] for tract, each in json.loads(told.stdout).items()}
    assert pairs == {"all": 1, "breast": 1, "belly": 1, "back": 0, "rump": 0}


def test_what_is_missing_is_told(tmp_path):
    path, skin = write(tmp_path, [("wing_1", "wing", (0.0, 0.0, 0.0), 0.1)])
    assert (
        "no contour feathers" in invoke("check", "--plumage", path, "--skin", skin, "/skin").stderr
    )
    gone = invoke("check", "--plumage", path, "--skin", skin, "/body")
    assert "no prim /body" in gone.stderr
    assert invoke("check", "--plumage", path).exit_code == 2
