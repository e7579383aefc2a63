"""Bands of wings run straight through feathers where the wing is folded."""

from __future__ import annotations

import numpy as np
import pytest
from places import ROOT

import featherfx
from featherfx.errors import InputError, InputWarning
from featherfx.groom.materials import Pattern
from featherfx.groom.presets.presets import load_preset

WING = """name = "wing"
[[wing]]
id = "right_wing"
shoulder = [0.03, -0.03, 0.03]
fold = FOLD
mirror = "y"
[wing.type]
base = "pigeon"
camber = 0.0
bow = 0.0
[[wing.type.bands]]
rows = ["tertials", "secondaries"]
inner = [0.5, 0.8]
outer = [0.6, 0.75]
colour = [0, 0, 0]
"""


def marks(folder, fold="1", text=WING):
    """Feathers with marks, by id, and the mark of each."""
    path = folder / "groom.toml"
    path.write_text(text.replace("FOLD", fold))
    found = {each.id: each for each in featherfx.read_groom(path).feathers}
    return {k: (f, f.kind.colour.patterns[-1]) for k, f in found.items() if f.kind.colour.patterns}


def places(feather, shares):
    """Points of a straight rachis at shares of its vane."""
    along = feather.kind.calamus + (1.0 - feather.kind.calamus) * np.array(shares)
    away = feather.kind.length * along
    return feather.position + away[:, None] * feather.rotation[:, 0]


def test_a_band_of_a_folded_wing_is_straight(tmp_path):
    found = {k: each for k, each in marks(tmp_path).items() if k.startswith("right")}
    joints = {
        each.name: each.position for each in featherfx.read_groom(tmp_path / "groom.toml").joints
    }
    shoulder, elbow, wrist = (joints[f"right_wing_{k}"] for k in ("shoulder", "elbow", "wrist"))
    normal = np.cross(elbow - shoulder, wrist - elbow)
    flat = np.linalg.svd(normal[None])[2][1:].T  # (3, 2) axes of the wing's plane
    assert len(found) > 11
    assert all("tertial" in k or "secondary" in k for k in found)
    whole = [each for each in found.values() if each[1].start > 0.0 and each[1].end < 1.0]
    edges = np.array([places(f, (mark.start, mark.end)) for f, mark in whole]) @ flat
    ends = [found[f"right_wing_{k}"] for k in ("tertial_04", "secondary_01")]
    for side, inner, outer in ((0, 0.5, 0.6), (1, 0.8, 0.75)):
        first, last = places(ends[0][0], (inner,))[0] @ flat, places(ends[1][0], (outer,))[0] @ flat
        way = (last - first) / np.linalg.norm(last - first)
        off = np.abs((edges[:, side] - first) @ [-way[1], way[0]])
        assert off.max() < 1e-3 * 0.12  # what shares are rounded to
        assert np.ptp(edges[:, side] @ way) > 0.03
    # each mark leans as the band does
    line = (sum(places(ends[1][0], (0.6, 0.75))) - sum(places(ends[0][0], (0.5, 0.8)))) @ flat
    for feather, mark in whole:
        way = feather.rotation[:, 0] @ flat
        x, y = way @ line, abs(way @ [-line[1], line[0]])
        assert mark.slant == pytest.approx(np.degrees(np.arctan2(x, y)), abs=0.5)


def test_a_band_stays_with_its_feathers_when_the_wing_opens(tmp_path):
    shut, spread = marks(tmp_path), marks(tmp_path, "0")
    assert {k: mark for k, (_, mark) in shut.items()} == {
        k: mark for k, (_, mark) in spread.items()
    }
    for k, (feather, _) in shut.items():  # both wings share their kinds
        if k.startswith("right"):
            assert shut[k.replace("right", "left")][0].kind is feather.kind


def test_a_band_lies_over_the_marks_of_colours(tmp_path):
    text = WING.replace("\n", "\noverrides = { '*' = { colour.base = [1, 0, 0] } }\n", 1)
    found = marks(tmp_path, text=text)
    assert all(f.kind.colour.base == (1.0, 0.0, 0.0) for f, _ in found.values())
    assert all(isinstance(mark, Pattern) and mark.kind == "bars" for _, mark in found.values())


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('"secondaries"', '"secondary"', r"bands\[0\].rows\[1\]: 'secondary' is none of tertials"),
        ("inner = [0.5, 0.8]", "inner = [0.5]", r"bands\[0\].inner: has 1 item"),
        ("colour = [0, 0, 0]", "colour = [0, 0, 2]", r"bands\[0\].colour\[2\]: 2 is out of range"),
    ],
)
def test_faults_of_bands_are_told_once(tmp_path, old, new, message):
    with pytest.raises(InputError, match=message) as error:
        marks(tmp_path, text=WING.replace(old, new))
    assert len(error.value.problems) == 1


def test_feathers_that_a_band_runs_along_are_told_once(tmp_path):
    """From the root of the innermost tertial to the tip of the same feather: along it."""
    text = WING.replace('["tertials", "secondaries"]', '["tertials"]')
    text = text.replace("[wing.type]", "[wing.type]\ntertials = { count = 1 }")
    text = text.replace("inner = [0.5, 0.8]", "inner = [0.2, 0.3]")
    text = text.replace("outer = [0.6, 0.75]", "outer = [0.8, 0.9]")
    told = r"bands\[0\]: leans by more than 75 degrees on 1 feather .*, as on 'tertial_01', by 90"
    with pytest.warns(InputWarning, match=told) as caught:
        assert not marks(tmp_path, text=text)
    # both wings are one table
    assert len([each for each in caught if "bands" in str(each.message)]) == 1


OWN = sorted(path.stem for path in ROOT.glob("presets/wing/*.toml"))


@pytest.mark.parametrize("name", OWN)
def test_no_other_bird_has_the_bars_of_a_pigeon(name):
    _, wing = load_preset(f"wing/{name}")
    assert bool(wing["bands"].value) == (name == "pigeon")
