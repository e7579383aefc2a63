"""A whole coat in contact: it ends, its rounds converge, and nothing goes deep."""

from __future__ import annotations

from collections import Counter

import pytest

from featherfx.api import read_shot
from featherfx.errors import InputWarning
from featherfx.lab.program import write_patch
from featherfx.shot.contact import pairs
from featherfx.shot.loop.simulate import simulate
from featherfx.shot.options import SPACE

COUNT = 100
# feathers of one more region, whose tips meet those of the first
AGAINST = """
[[region]]
id = "against"
kind = "body_contour"
count = {count}
length = 0.035
where = [{{ sphere = [-0.13, 0, 0.19, 0.06] }}]
flow = {{ direction = [1, 0, 0] }}
"""
SHOT = """name = "coat"
groom = "groom.toml"
frames = [1, 2]
frames_per_second = 24
quality = "draft"
wind = { base = "breeze", direction = [-1, 0.2, 0] }
[skin]
usd = "body.usda"
prim = "/skin"
[contact]
"""


def coat_of(folder, count):
    path = write_patch(folder, count, 2)
    groom = path.with_name("groom.toml")
    groom.write_text(groom.read_text() + AGAINST.format(count=count))
    path.write_text(SHOT)
    return read_shot(path)


@pytest.mark.filterwarnings("ignore::featherfx.errors.InputWarning")
def test_feathers_that_only_chords_of_coarse_grids_put_through_each_other_get_finer(
    tmp_path, monkeypatch
):
    def crossed_and_grids():
        simulation = simulate(shot)
        own = Counter((each.rows, each.columns) for each in simulation.options)
        return simulation.report["contact"]["crossed_pairs"], own

    shot = coat_of(tmp_path, 60)
    drawn = shot.quality.rows, shot.quality.columns
    crossed, grids = crossed_and_grids()
    assert set(grids) == {SPACE[0][:2], drawn}
    assert 0 < grids[drawn] < 60 / 2
    monkeypatch.setattr(pairs, "_REFINEMENTS", 0)
    more, grids = crossed_and_grids()
    assert set(grids) == {SPACE[0][:2]}
    assert crossed < more / 2


def test_a_coat_with_feathers_through_each_other_settles_and_moves_as_it_is_drawn(tmp_path):
    shot = coat_of(tmp_path, COUNT)
    with pytest.warns(InputWarning, match=r"pass through each other at rest.*stay as they are"):
        simulation = simulate(shot)
    assert len(list(simulation)) == 2
    contact = simulation.report["contact"]
    thickness = min(each.kind.vane_material.thickness for each in shot.groom.feathers)
    # those that are drawn through each other are named, and nothing pushes them out
    assert contact["crossed_pairs"] > 5
    assert contact["crossed"][0]["depth"] > 4.0 * thickness
    assert contact["depth_at_rest"] < 1e-5
    # rounds converge, and nothing goes deeper than it is drawn
    assert contact["most_contacts"] > COUNT
    assert contact["steps_with_contacts_off"] == contact["feathers_whose_contacts_yielded"] == 0
    assert contact["depth_after_settling"] < thickness
    assert contact["worst_depth"] < thickness
    assert contact["feather_solves"] < 6 * contact["steps"] * 2 * COUNT
