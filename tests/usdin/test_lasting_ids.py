"""Ids and roots of regions when the mesh that they grow on is published again."""

import numpy as np
import pytest
import trimesh
from pxr import Gf, UsdGeom
from scipy.spatial.transform import Rotation
from usd_meshes import define_mesh
from usdin_scenes import new_stage

from featherfx import export_groom
from featherfx.api import read_groom
from featherfx.errors import InputError
from featherfx.phases import listen_to_reads

TURN = Rotation.from_euler("xyz", [0.3, 0.5, 1.0]).as_matrix()
WAY = np.array([1.234, -0.567, 0.891])


def sheet():
    """(points, faces): quads that are flat, and bent along one side."""
    number = np.arange(81).reshape(9, 9)
    faces = np.stack([number[:-1, :-1], number[:-1, 1:], number[1:, 1:], number[1:, :-1]], -1)
    x, y = np.meshgrid(np.linspace(-0.1, 0.1, 9), np.linspace(-0.1, 0.1, 9))
    points = np.stack([x, y, np.maximum(x, 0.0) ** 2 * 3.0], -1).reshape(-1, 3)
    return points, faces.reshape(-1, 4)


def ball():
    """(points, faces): a closed body of triangles, with waists."""
    mesh = trimesh.creation.icosphere(2, radius=0.1)
    points = np.array(mesh.vertices)
    return points * (1.0 + 0.2 * np.sin(20.0 * points[:, 1:2])) * (1.0, 0.7, 1.2), mesh.faces


def published(folder, points, faces, *, density=3000, matrix=None, keys=""):
    """Roots of a region by their ids."""
    folder.mkdir()
    stage = new_stage(folder / "skin.usda", 1.0)
    body = UsdGeom.Xform.Define(stage, "/body")
    if matrix is not None:
        body.AddTransformOp().Set(Gf.Matrix4d(matrix.tolist()))
    define_mesh(stage, "/body/skin", points, faces)
    stage.GetRootLayer().Save()
    (folder / "groom.toml").write_text(
        "name = 'g'\n[skin]\nusd = 'skin.usda'\nprim = '/body/skin'\n[[region]]\nid = 'r'\n"
        f"kind = 'covert'\ndensity = {density}\nlength = 0.02\n"
        f"flow = {{ direction = [1, 1, 0.1] }}\n{keys}"
    )
    found = read_groom(folder / "groom.toml").feathers
    return {feather.id: np.array(feather.position) for feather in found}


def split(points, faces):
    """Every face cut at its middle and its sides' middles, without a change of shape."""
    points, middles, found = list(points), {}, []

    def middle(a, b):
        key = min(a, b), max(a, b)
        if key not in middles:
            middles[key] = len(points)
            points.append(0.5 * (points[a] + points[b]))
        return middles[key]

    for face in faces.tolist():
        sides = [middle(a, b) for a, b in zip(face, face[1:] + face[:1], strict=True)]
        if len(face) == 3:
            found.append(tuple(sides))
            found += [(a, sides[k], sides[k - 1]) for k, a in enumerate(face)]
        else:
            points.append(np.mean([points[k] for k in face], axis=0))
            centre = len(points) - 1
            found += [(a, sides[k], centre, sides[k - 1]) for k, a in enumerate(face)]
    return np.array(points), np.array(found)


SHAPES = {"sheet": sheet, "ball": ball}


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("shape", SHAPES)
def test_ids_and_roots_stay_when_a_mesh_is_published_again(tmp_path, shape):
    points, faces = SHAPES[shape]()
    random = np.random.default_rng(0)
    order = random.permutation(len(points))
    matrix = np.eye(4)
    matrix[:3, :3], matrix[3, :3] = TURN, WAY
    rolled = np.array([np.roll(face, random.integers(len(face))) for face in faces])
    again = {
        "faces": (points, faces[random.permutation(len(faces))]),
        "corners": (points, rolled),
        "points": (points[order], np.argsort(order)[faces]),
        "split": split(points, faces),
        "moved": (points + WAY, faces),
        "turned": (points, faces),
    }
    first = published(tmp_path / "first", points, faces)
    area = trimesh.Trimesh(points, trimesh.geometry.triangulate_quads(faces)).area
    assert len(first) == pytest.approx(3000 * area, rel=0.06)
    for name, (at, corners) in again.items():
        found = published(tmp_path / name, at, corners, matrix=matrix if name == "turned" else None)
        assert found.keys() == first.keys(), name
        for key, root in first.items():
            place = {"moved": root + WAY, "turned": root @ TURN + WAY}.get(name, root)
            np.testing.assert_allclose(found[key], place, atol=2e-6, err_msg=name)
    denser = published(tmp_path / "denser", points, faces, density=3300)
    assert len(denser) > 1.05 * len(first)
    assert all((denser[key] == root).all() for key, root in first.items())


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("corner", [0, 40, 44])
def test_a_corner_that_is_moved_moves_the_feathers_at_it_alone(tmp_path, shape, corner):
    points, faces = SHAPES[shape]()
    first = published(tmp_path / "first", points, faces)
    moved = points.copy()
    moved[corner] += (0.004, 0.002, 0.006)
    second = published(tmp_path / "second", moved, faces)
    at = np.unique(faces[(faces == corner).any(axis=1)])
    reach = np.linalg.norm(points[at] - points[corner], axis=1).max()
    changed = [
        np.linalg.norm(root - points[corner])
        for key, root in first.items()
        if key not in second or np.abs(second[key] - root).max() > 1e-6
    ]
    assert 0 < len(changed) < 0.15 * len(first)
    # beside the faces at it, a feather may have made room for another
    assert max(changed) < 2.2 * reach


@pytest.mark.filterwarnings("ignore")
def test_feathers_take_the_ids_of_those_that_stood_at_their_places(tmp_path):
    points, faces = ball()
    first = published(tmp_path / "first", points, faces, density=1000)
    before = tmp_path / "before.usdc"
    export_groom(tmp_path / "first" / "groom.toml", before, quality="draft")
    kept, reads = f"ids_from = '{before}'\n", []
    spacing = (0.5 / 1000) ** 0.5
    for name, keys in {"same": kept, "others": "seed = 9\n" + kept}.items():
        with listen_to_reads(reads.append):
            found = published(tmp_path / name, points, faces, density=1000, keys=keys)
        told, stay = reads[-1], found.keys() & first.keys()
        assert (told.role, told.taken) == ("kept id", len(stay))
        assert {each.path for each in told.left} == first.keys() - found.keys()
        assert f"{len(found.keys() - first.keys())} new" in told.motion
        away = [np.linalg.norm(found[key] - first[key]) for key in stay]
        assert len(stay) > 0.8 * len(first)
        assert max(away) < 2.0 * spacing
    assert 0 < len(stay) < len(first)
    moved = published(tmp_path / "moved", points + WAY, faces, density=1000, keys=kept)
    assert moved.keys() == first.keys()
    denser = published(tmp_path / "denser", points, faces, density=1100, keys=kept)
    assert denser.keys() > first.keys()
    assert all(np.abs(denser[key] - root).max() < 1e-6 for key, root in first.items())


@pytest.mark.filterwarnings("ignore")
def test_ids_come_from_meshes_and_those_of_another_region_are_refused(tmp_path):
    points, faces = sheet()
    first = published(tmp_path / "first", points, faces, density=500)
    groom, before = tmp_path / "first" / "groom.toml", tmp_path / "before.usdc"
    export_groom(groom, before, quality="draft", instances=False)
    kept = f"ids_from = '{before}'\n"
    order = np.random.default_rng(2).permutation(len(faces))
    again = published(tmp_path / "again", points, faces[order], density=500, keys=kept)
    assert again.keys() == first.keys()
    groom.write_text(groom.read_text().replace("id = 'r'", f"id = 'other'\n{kept}"))
    with pytest.raises(InputError, match="holds no feather of region 'other', known: r"):
        read_groom(groom)
