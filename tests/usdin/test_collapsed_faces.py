"""Faces without area under roots: the skin around turns them; and skins far from the origin."""

from __future__ import annotations

import warnings

import numpy as np
import pytest
from pxr import Usd, UsdGeom
from usdin_scenes import add_mesh, new_stage, rigid, sheet, vec, write_shot

import featherfx
from featherfx.baking.task import _find_origin
from featherfx.errors import InputError, InputWarning

SKIN = 'usd = "skin.usda"\nprim = "/skin"\n'
PLACE = np.array([0.01, 0.013, 0.0])


def write_groom(folder):
    (folder / "g.toml").write_text(
        'name = "g"\n[[feather]]\nid = "f"\nkind = "covert"\noverrides = { length = 0.02 }\n'
        f"position = {PLACE.tolist()}\ndirection = [-1, 0, 0.2]\nup = [0, 0, 1]\n"
    )


def write_skin(folder, squeezed, matrices, codes=range(-3, 14)):
    """A sheet that turns and moves; squeezed: code to (P, 3) places of its points."""
    stage = new_stage(folder / "skin.usda")
    points, counts, quads = sheet()
    mesh = add_mesh(stage, "/skin", points, counts, quads)
    for code in codes:
        local = squeezed.get(code, lambda each: each)(points.copy())
        matrix = matrices(code)
        mesh.GetPointsAttr().Set(vec(local @ matrix[:3, :3] + matrix[3, :3]), code)
    stage.Save()


def to_point(points):
    points[np.abs(points).max(axis=1) < 0.08] = 0.0
    return points


def to_line(points):
    points[np.abs(points).max(axis=1) < 0.08, 1] = 0.0
    return points


def to_edge(points):
    near = np.linalg.norm(points - PLACE, axis=1).argsort()[:2]
    points[near[0]] = points[near[1]]
    return points


def turning(code):
    return rigid(4.0 * code, (0, 0, 1), (0.01 * code, 0.0, 0.0))


@pytest.mark.parametrize("squeeze", [to_point, to_line, to_edge])
@pytest.mark.parametrize("matrices", [lambda code: np.eye(4), turning])
def test_roots_turn_with_the_skin_around_a_collapsed_face(tmp_path, squeeze, matrices):
    write_groom(tmp_path)
    write_skin(tmp_path, {5: squeeze}, matrices)
    path = write_shot(tmp_path, SKIN + "rest = 0\n", (1, 8), groom="g.toml")
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        shot = featherfx.read_shot(path)
        turns = [shot.skin.frames(k / 24.0).rotations[0] for k in range(8)]
    rest = shot.groom.feathers[0].rotation
    for k, found in enumerate(turns):
        expected = matrices(k + 1)[:3, :3].T @ matrices(0)[:3, :3] @ rest
        assert np.degrees(np.arccos(np.clip((np.trace(found.T @ expected) - 1) / 2, -1, 1))) < 25.0
    if squeeze is not to_edge:
        assert (
            len([each for each in told if "has no area at time code 5. 'f'" in str(each.message)])
            == 1
        )
        strict = write_shot(
            tmp_path, SKIN + 'rest = 0\non_collapse = "error"\n', (1, 8), "e.toml", "g.toml"
        )
        with pytest.raises(InputError, match=r"has no area at time code 5\. 'f' sits on it"):
            featherfx.read_shot(strict).skin.frames(4.0 / 24.0)


def test_a_skin_without_any_area_is_an_error(tmp_path):
    write_groom(tmp_path)
    write_skin(tmp_path, {5: lambda points: 0.0 * points}, turning)
    shot = featherfx.read_shot(write_shot(tmp_path, SKIN, (1, 8), groom="g.toml"))
    with pytest.raises(InputError, match="has no area at time code 5"):
        shot.skin.frames(4.0 / 24.0)


def test_feathers_on_a_skin_far_away_keep_their_lengths(tmp_path):
    write_groom(tmp_path)
    write_skin(tmp_path, {}, lambda code: rigid(0.0, (0, 0, 1), (1e4, -2e4, 0.0)))
    featherfx.bake(write_shot(tmp_path, SKIN, (1, 2), groom="g.toml"), tmp_path / "out.usdc")
    stage = Usd.Stage.Open(str(tmp_path / "out.usdc"))
    mesh = next(each for each in stage.Traverse() if each.IsA(UsdGeom.Mesh))
    points = np.array(mesh.GetAttribute("points").Get(2), float)
    assert np.linalg.norm(points, axis=1).max() < 1.0
    matrix = UsdGeom.Xformable(mesh).ComputeLocalToWorldTransform(2)
    assert np.abs(np.array(matrix)[3, :3] - (1e4, -2e4, 0.0)).max() < 1.0


def test_feathers_that_single_precision_misses_are_told(tmp_path):
    write_groom(tmp_path)
    far = (tmp_path / "g.toml").read_text().split("[[feather]]")[1].replace('"f"', '"far"')
    with (tmp_path / "g.toml").open("a") as file:
        file.write("[[feather]]" + far.replace(str(PLACE.tolist()), "[4000, 0, 0]"))
    shot = featherfx.read_shot(write_shot(tmp_path, None, (1, 2), groom="g.toml"))
    with pytest.warns(InputWarning, match="up to 2e[+]03 m from the origin of the cache"):
        assert _find_origin(shot, (1, 2)) == (2000.0, 0.0, 0.0)
