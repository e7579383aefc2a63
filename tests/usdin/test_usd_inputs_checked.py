"""`featherfx check` on stages that are no caches: skins, grooms, and what is wrong with them."""

from __future__ import annotations

import warnings

import numpy as np
import pytest
from usdin_scenes import add_curves, add_mesh, arc, lifted, new_stage, sheet, vec

from featherfx.baking.pipeline import check
from featherfx.errors import InputWarning


def skin(folder):
    stage = new_stage(folder / "skin.usda")
    points, counts, indices = sheet()
    mesh = add_mesh(stage, "/skin", points, counts, indices)
    for code in (1, 2):
        mesh.GetPointsAttr().Set(vec(lifted(points, 0.1 * code)), code)
    return stage, mesh


def told(path):
    return [(problem.key, problem.message) for problem in check(path)]


def test_a_skin_is_no_bad_cache(tmp_path):
    """No kind, extent or range of time codes: doubts, but nothing that keeps it from use."""
    stage, _ = skin(tmp_path)
    stage.Save()
    with warnings.catch_warnings(record=True) as doubts:
        warnings.simplefilter("always", InputWarning)
        assert told(tmp_path / "skin.usda") == []
    assert any("/skin.extent: missing" in str(doubt.message) for doubt in doubts)


def test_a_skin_that_cannot_be_followed(tmp_path):
    stage, mesh = skin(tmp_path)
    mesh.GetPointsAttr().Set(vec(np.zeros((3, 3))), 3)
    stage.Save()
    (_, message), *_ = told(tmp_path / "skin.usda")
    assert "/skin.points" in message
    assert "3 points at time code 3" in message


def test_a_groom_is_read_as_feathers(tmp_path):
    stage = new_stage(tmp_path / "bird.usda")
    add_curves(stage, "/bird", [arc(), arc() + np.array([0, 1, 0])], ids=["a", "b"])
    stage.Save()
    with pytest.warns(InputWarning):
        assert told(tmp_path / "bird.usda") == []


def test_two_feathers_of_one_id(tmp_path):
    stage = new_stage(tmp_path / "bird.usda")
    add_curves(stage, "/bird", [arc(), arc() + np.array([0, 1, 0])], ids=["a", "a"])
    stage.Save()
    with pytest.warns(InputWarning):
        problems = told(tmp_path / "bird.usda")
    assert problems == [("/bird[0], /bird[1]", "featherId 'a' is used 2 times. Ids are unique")]


def test_values_that_do_not_fit(tmp_path):
    stage = new_stage(tmp_path / "bird.usda")
    prim = add_curves(stage, "/bird", [arc()])
    prim.CreateWidthsAttr([0.1] * 4)
    prim.SetWidthsInterpolation("vertex")
    stage.Save()
    with pytest.warns(InputWarning):
        problems = told(tmp_path / "bird.usda")
    assert [key for key, _ in problems] == ["/bird.widths"]
