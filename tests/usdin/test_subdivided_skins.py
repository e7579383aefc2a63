"""Skins and colliders that renderers subdivide: roots, motion and primvars on the limit surface."""

import warnings

import numpy as np
import pytest
from pxr import Sdf, UsdGeom, Vt
from regions_skin import SKIN, grown, region, roots
from usd_meshes import define_mesh
from usdin_scenes import new_stage

from featherfx.algebra.subdivision import refine
from featherfx.algebra.subdivision_cage import Rules, make_cage
from featherfx.api import read_groom, read_shot
from featherfx.baking.export import export_groom
from featherfx.errors import InputError, InputWarning
from featherfx.groom.keys.problems import Place, Problems
from featherfx.groom.skin.points import signed_volume
from featherfx.groom.skin.skin import closest
from featherfx.render.options import PictureOptions
from featherfx.render.subject import open_subject
from featherfx.usd.check.measures import MeasuredMeshes
from featherfx.usd.read.cache import Cache
from featherfx.usd.read.contents import inspect_stage
from featherfx.usd.read.stage import open_scene
from featherfx.usd.read.surface import MeshOptions, open_mesh

CUBE = np.array(
    [(0, 3, 2, 1), (4, 5, 6, 7), (0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (3, 0, 4, 7)]
)
BOX = 0.1 * np.array([(x, y, z) for z in (-1, 1) for x, y in ((-1, -1), (1, -1), (1, 1), (-1, 1))])
OCTAHEDRON = np.array(
    [(0, 2, 4), (2, 1, 4), (1, 3, 4), (3, 0, 4), (2, 0, 5), (1, 2, 5), (3, 1, 5), (0, 3, 5)]
)
TIPS = 0.1 * np.array([(1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0), (0, 0, 1), (0, 0, -1)])

# every so many points are compared with a surface of many triangles
SOME = 13


def write(folder, points, faces, scheme=None, **attributes):
    """A stage skin.usda with a mesh, and that."""
    stage = new_stage(folder / "skin.usda", 1.0)
    mesh = define_mesh(stage, "/skin", points, faces, scheme)
    for name, value in attributes.items():
        mesh.GetPrim().GetAttribute(name).Set(value)
    stage.GetRootLayer().Save()
    return stage, mesh


def opened(folder, **options):
    place = Place("shot.toml", "skin", Problems())
    scene = open_scene(folder / "skin.usda", place)
    return open_mesh(scene, "/skin", MeshOptions(**options), place)


def distances(places, surface):
    """(N,) m, from triangles (T, 3, 3)."""
    triangle, weights = closest(places, surface)
    return np.linalg.norm(np.einsum("nk,nkc->nc", weights, surface[triangle]) - places, axis=1)


def limit(points, faces, levels, **rules):
    """Triangles (T, 3, 3) of the surface that is drawn, by its own refinement."""
    counts = np.array([len(face) for face in faces])
    found = refine(make_cage(counts, np.concatenate(faces), len(points), Rules(**rules)), levels)
    at = (found.matrix @ points)[found.indices].reshape(len(found.counts), -1, 3)
    return np.concatenate([at[:, [0, k, k + 1]] for k in range(1, at.shape[1] - 1)])


# where USD says nothing a mesh is subdivided by Catmull and Clark
@pytest.mark.parametrize("scheme", [None, "catmullClark", "loop"])
def test_roots_grow_on_the_surface_that_is_drawn(tmp_path, scheme):
    faces, points = (OCTAHEDRON, TIPS) if scheme == "loop" else (CUBE, BOX)
    write(tmp_path, points, faces, scheme)
    found = roots(grown(tmp_path, region(keys="count = 60\nlength = 0.02")))
    surface = limit(points, faces, 5, scheme=scheme or "catmullClark")
    assert distances(found, surface).max() < 1e-4
    assert distances(found, points[faces][:, :3]).min() > 1e-3
    skin = SKIN.replace("prim =", "subdivision = false\nprim =")
    with pytest.warns(InputWarning, match=r"the cage, which is taken, are up to \d+ mm off"):
        flat = roots(grown(tmp_path, region(keys="count = 60\nlength = 0.02"), skin=skin))
    cage = points[np.concatenate([faces[:, [0, k, k + 1]] for k in range(1, faces.shape[1] - 1)])]
    assert distances(flat, cage).max() < 1e-7


def test_a_collider_is_the_surface_that_is_drawn_unless_its_cage_is_chosen(tmp_path):
    write(tmp_path, BOX, CUBE)
    (tmp_path / "groom.toml").write_text(
        'name = "g"\n[[feather]]\nid = "f"\nkind = "covert"\nposition = [1, 0, 0]\n'
    )
    table = '[contact]\n[[collider]]\nusd = "skin.usda"\nprims = ["/skin"]\n'
    shot = f'name = "s"\ngroom = "groom.toml"\nframes = [1, 2]\n{table}'
    (tmp_path / "shot.toml").write_text(shot)
    (drawn,) = read_shot(tmp_path / "shot.toml").colliders
    assert distances(drawn.surface.rest[::SOME], limit(BOX, CUBE, 5)).max() < 1e-4
    (tmp_path / "shot.toml").write_text(f"{shot}subdivision = false\n")
    with pytest.warns(InputWarning, match="the cage, which is taken"):
        (flat,) = read_shot(tmp_path / "shot.toml").colliders
    np.testing.assert_allclose(flat.surface.rest, BOX, atol=1e-7)


def test_creases_corners_and_holes_are_those_of_the_mesh(tmp_path):
    sharp = {
        "cornerIndices": [*range(8)],
        "cornerSharpnesses": [10.0] * 8,
        "creaseIndices": [0, 1, 2, 3, 0, 4, 5, 6, 7, 4],
        "creaseLengths": [5, 5],
        "creaseSharpnesses": [10.0, 10.0],
    }
    write(tmp_path, BOX, CUBE, **sharp)
    mesh = opened(tmp_path)
    corners = BOX[:, None]
    assert np.linalg.norm(mesh.rest[None] - corners, axis=2).min(axis=1).max() < 1e-7
    # the rims of bottom and top stay, the upright edges do not
    below = mesh.rest[:, 2] < -0.1 + 1e-6
    assert np.abs(mesh.rest[below][:, :2]).max() == pytest.approx(0.1)
    waist = np.abs(mesh.rest[:, 2]) < 0.01
    assert np.linalg.norm(mesh.rest[waist][:, :2], axis=1).max() < 0.13
    (tmp_path / "holed").mkdir()
    write(tmp_path / "holed", BOX, CUBE, holeIndices=[1])
    holed = opened(tmp_path / "holed")
    assert set(holed.face.tolist()) == {0, 2, 3, 4, 5}
    assert not holed.closed.any()
    assert opened(tmp_path).closed.all()


def test_the_surface_moves_as_its_cage_is_refined_in_each_frame(tmp_path):
    stage, mesh = write(tmp_path, BOX, CUBE)
    later = BOX * (1.0, 1.4, 0.7) + 0.02 * np.sin(40.0 * BOX[:, [1, 2, 0]])
    for code, points in ((1.0, BOX), (2.0, later)):
        mesh.GetPointsAttr().Set(Vt.Vec3fArray.FromNumpy(points.astype(np.float32)), code)
    stage.GetRootLayer().Save()
    skin = opened(tmp_path)
    assert distances(skin.points(2.0)[::SOME], limit(later, CUBE, 5)).max() < 1e-4
    chosen = skin.triangles[::977]
    np.testing.assert_allclose(skin.corners(2.0, chosen), skin.points(2.0)[chosen], atol=1e-12)
    halfway = distances(skin.points(1.5)[::SOME], limit(0.5 * (BOX + later), CUBE, 5))
    assert halfway.max() < 1e-4
    # what is written of roots names the cage's points
    triangle = np.arange(0, len(skin.triangles), 499)
    middle = np.full((len(triangle), 3), 1.0 / 3.0)
    faces, points, weights = skin.locate(triangle, middle)
    assert points.max() < 8
    assert (faces == skin.face[triangle]).mean() > 0.9
    assert weights.sum(axis=1) == pytest.approx(1.0)


def test_primvars_are_refined_as_points_are(tmp_path):
    stage, mesh = write(tmp_path, BOX, CUBE)
    api = UsdGeom.PrimvarsAPI(mesh)
    types = Sdf.ValueTypeNames
    api.CreatePrimvar("place", types.Vector3fArray, "vertex").Set(
        Vt.Vec3fArray.FromNumpy(BOX.astype(np.float32))
    )
    api.CreatePrimvar("lines", types.Vector3fArray, "varying").Set(
        Vt.Vec3fArray.FromNumpy(BOX.astype(np.float32))
    )
    api.CreatePrimvar("number", types.FloatArray, "uniform").Set([0, 1, 2, 3, 4, 5])
    uv = api.CreatePrimvar("map1", types.TexCoord2fArray, "faceVarying")
    uv.Set([(0, 0), (1, 0), (1, 1), (0, 1)])
    uv.SetIndices([0, 1, 2, 3] * 6)
    stage.GetRootLayer().Save()
    skin = opened(tmp_path, uv="map1")
    corners = skin.rest[skin.triangles]
    values = BOX.astype(np.float32).astype(float)
    np.testing.assert_allclose(skin.spread(values, "vertex", None), corners, atol=1e-12)
    # in lines the cage itself is spread
    assert np.abs(skin.spread(values, "varying", None)).max(axis=2).min() == pytest.approx(0.1)
    numbers = skin.spread(np.arange(6.0), "uniform", None)
    assert (numbers == skin.face[:, None]).all()
    # each face is a chart of its own, whose corners are sharp and whose sides stay straight
    assert skin.st.min() == pytest.approx(0.0, abs=1e-12)
    assert skin.st.max() == pytest.approx(1.0)
    areas = 0.5 * np.abs(np.linalg.det(skin.st[:, 1:] - skin.st[:, :1]))
    assert areas.sum() == pytest.approx(6.0)
    assert skin.spread(np.arange(5.0), "vertex", None) is None


@pytest.mark.parametrize(
    ("scheme", "attributes", "told"),
    [
        ("loop", {}, "loop needs triangles, but face 0 has 4 sides"),
        (None, {"cornerIndices": [9], "cornerSharpnesses": [1.0]}, "9 is out of range"),
        (None, {"cornerIndices": [1], "cornerSharpnesses": []}, "has 0, expects 1"),
        (None, {"creaseIndices": [0, 1], "creaseLengths": [3]}, "add up to 3"),
        (
            None,
            {"creaseIndices": [0, 1], "creaseLengths": [2], "creaseSharpnesses": [1.0, 2.0]},
            "expects 1 for lines or 1 for edges",
        ),
    ],
)
def test_what_does_not_fit_is_one_sentence(tmp_path, scheme, attributes, told):
    write(tmp_path, BOX, CUBE, scheme, **attributes)
    with pytest.raises(InputError, match=told):
        opened(tmp_path)


def test_inspect_tells_how_far_a_cage_is_off(tmp_path):
    write(tmp_path, BOX, CUBE)
    (found,) = inspect_stage(tmp_path / "skin.usda").prims
    assert found.subdivision == "catmullClark"
    assert found.cage_distance == pytest.approx(0.05 * 3**0.5, rel=1e-6)
    assert found.triangles == 12


def test_a_mesh_that_is_dense_is_taken_as_it_is(tmp_path):
    size = 450
    number = np.arange((size + 1) ** 2).reshape(size + 1, size + 1)
    faces = np.stack(
        [number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:]], axis=-1
    ).reshape(-1, 4)
    x, y = np.meshgrid(*[np.linspace(0.0, 1.0, size + 1)] * 2, indexing="ij")
    write(tmp_path, np.stack([x, y, 0.05 * np.sin(6.0 * x)], axis=-1).reshape(-1, 3), faces)
    skin = opened(tmp_path)
    assert skin.limit is None
    assert len(skin.triangles) == 2 * size**2


@pytest.mark.parametrize("key", ["", "subdivision = false\n"])
def test_pictures_and_checks_take_the_surface_that_roots_stand_on(tmp_path, key):
    """Of a body that is mirrored and wound inwards, too."""
    stage, mesh = write(tmp_path, BOX, CUBE[:, ::-1])
    mesh.AddScaleOp().Set((-1.0, 1.0, 1.0))
    mesh.CreateDisplayColorPrimvar("uniform").Set([(0.1 * k, 0.0, 0.0) for k in range(6)])
    stage.GetRootLayer().Save()
    groom, cache = tmp_path / "groom.toml", tmp_path / "out.usdc"
    text = region(keys="count = 60\nlength = 0.02")
    groom.write_text(f"{SKIN.replace('prim =', key + 'prim =')}{text}")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", InputWarning)
        export_groom(groom, cache, quality="draft")
    (drawn,) = open_subject(cache, PictureOptions()).scenery
    corners = drawn.points(None)[drawn.surface.triangles]
    surface = BOX[CUBE][:, [0, 1, 2]] if key else limit(BOX, CUBE, 5, scheme="catmullClark")
    if not key:
        assert distances(drawn.points(None)[::SOME], surface).max() < 1e-4
    assert signed_volume(corners) > (0.0079 if key else 0.001)
    assert (
        distances(np.array([f.position for f in read_groom(groom).feathers]), corners).max() < 1e-6
    )
    assert np.ptp(drawn.colours(np.zeros(3))[:, 0]) > 0.1
    patches = MeasuredMeshes(Cache(cache), cache)
    np.testing.assert_allclose(patches.points(None)[-1], drawn.points(None))
