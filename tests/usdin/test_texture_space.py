"""Pictures and places in texture space: uv sets, tiles, ways to go on outside, stacked charts."""

import numpy as np
import pytest
import trimesh
from PIL import Image
from pxr import Sdf, Usd, UsdGeom
from regions_skin import SKIN, grown, problems, region, roots
from usdin_scenes import add_mesh, new_stage

from featherfx.api import read_shot
from featherfx.errors import InputError, InputWarning
from featherfx.groom.regions.rules import find_tiles, sample_tiles
from featherfx.groom.skin.skin import bind

KEYS = "count = 60\nlength = 0.02\nwhere = [{{ image = '{}' }}]"


def sheet(folder, uv, name="st"):
    """A flat square of 0.2 m whose texture coordinates are a function of x and y within 0 to 1."""
    stage = new_stage(folder / "skin.usda", 1.0)
    x, y = (each.ravel() for each in np.meshgrid(*[np.linspace(0.0, 1.0, 9)] * 2))
    first = (np.arange(8)[:, None] * 9 + np.arange(8)).ravel()
    faces = np.stack([first, first + 1, first + 10, first + 9], axis=1)
    points = np.column_stack([0.2 * x - 0.1, 0.2 * y - 0.1, np.zeros(81)])
    mesh = add_mesh(stage, "/skin", points, np.full(64, 4), faces)
    values = np.column_stack(np.broadcast_arrays(*uv(x, y), x)[:2]).tolist()
    primvar = UsdGeom.PrimvarsAPI(mesh).CreatePrimvar(
        name, Sdf.ValueTypeNames.TexCoord2fArray, "vertex"
    )
    primvar.Set([tuple(each) for each in values])
    stage.GetRootLayer().Save()


def picture(folder, name, value=255, size=8):
    pixels = np.full((size, size), value, np.uint8) if np.isscalar(value) else value
    Image.fromarray(pixels).save(folder / name)


def test_tiles_are_read_and_outside_of_them_is_nothing(tmp_path):
    sheet(tmp_path, lambda x, y: (3.0 * x, y))
    picture(tmp_path, "m.1001.png", 0)
    picture(tmp_path, "m.1002.png")
    with pytest.warns(
        InputWarning,
        match=r"3\d % of /skin lies outside.*\. Its texture coordinates are in tiles 1003",
    ):
        found = roots(grown(tmp_path, region(keys=KEYS.format("m.<UDIM>.png"))))
    assert len(found) == 60
    assert (np.abs(found[:, 0]) < 0.1 / 3.0 + 1e-6).all()
    assert np.ptp(found[:, 0]) > 0.05
    # one tile alone is a picture, which ends where it does
    with pytest.warns(InputWarning, match=r"6\d % of /skin lies outside"):
        found = roots(grown(tmp_path, region(keys=KEYS.format("m.1002.png"))))
    assert found[:, 0].max() < -0.1 / 3.0 + 1e-6
    told = problems(tmp_path, region(keys=KEYS.format("n.<UDIM>.png")))
    assert "there is no tile, such as n.1001.png" in told


@pytest.mark.filterwarnings("ignore::featherfx.errors.InputWarning")
@pytest.mark.parametrize(
    ("wrap", "white"),
    [
        ("black", [(-0.05, 0.0)]),
        ("clamp", [(-0.05, 0.1)]),
        ("repeat", [(-0.05, 0.0), (0.05, 0.1)]),
        ("mirror", [(-0.05, 0.05)]),
    ],
)
def test_a_picture_goes_on_outside_as_the_skin_says(tmp_path, wrap, white):
    # black on the left, white on the right; the sheet is two pictures wide
    sheet(tmp_path, lambda x, y: (2.0 * x, y))
    picture(tmp_path, "m.png", np.repeat([[0] * 32 + [255] * 32], 64, axis=0).astype(np.uint8))
    skin = SKIN + f"wrap = '{wrap}'\n"
    x = roots(grown(tmp_path, region(keys=KEYS.format("m.png")), skin=skin))[:, 0]
    inside = [(x > low - 2e-3) & (x < high + 2e-3) for low, high in white]
    assert np.any(inside, axis=0).all()
    assert all(each.any() for each in inside)


def test_any_primvar_holds_texture_coordinates(tmp_path):
    sheet(tmp_path, lambda x, y: (y, x), name="map1")
    picture(tmp_path, "m.png", np.repeat([[0] * 32 + [255] * 32], 64, axis=0).astype(np.uint8))
    skin = SKIN + "uv = 'map1'\n"
    found = roots(grown(tmp_path, region(keys=KEYS.format("m.png")), skin=skin))
    assert found[:, 1].min() > -2e-3
    assert np.ptp(found[:, 0]) > 0.15
    assert "has no primvars:st" in problems(tmp_path, region(keys=KEYS.format("m.png")))


def test_a_picture_of_one_pixel_is_its_value_everywhere(tmp_path):
    for wrap in ("black", "clamp", "repeat", "mirror"):
        tiles = {-1: np.array([[0.25]])}
        st = np.random.default_rng(0).uniform(0.0, 1.0, (50, 2))
        np.testing.assert_allclose(sample_tiles(tiles, st, wrap), 0.25)
    sheet(tmp_path, lambda x, y: (x, y))
    picture(tmp_path, "dot.png", size=1)
    assert len(roots(grown(tmp_path, region(keys=KEYS.format("dot.png"))))) == 60


def test_tiles_are_numbered_as_udim_does():
    tiles = {number: np.full((2, 2), number / 2000.0) for number in (1001, 1010, 1011, 1025)}
    st = np.array([[0.5, 0.5], [9.5, 0.5], [0.5, 1.5], [4.5, 2.5], [1.5, 0.5], [10.5, 0], [-1, 0]])
    number, inner = find_tiles(tiles, st, "black")
    assert number.tolist() == [0, 1, 2, 3, -1, -1, -1]
    np.testing.assert_allclose(inner[:4], 0.5)
    values = sample_tiles(tiles, st, "black")
    np.testing.assert_allclose(values, [0.5005, 0.505, 0.5055, 0.5125, 0, 0, 0])


@pytest.mark.parametrize("charts", [2, 3])
def test_of_places_with_one_uv_the_nearest_is_taken(charts):
    # sheets beside each other that share one chart, the second and fourth mirrored
    corners = np.array([[(0, 0), (1, 0), (0, 1)], [(1, 0), (1, 1), (0, 1)]], dtype=float)
    points, triangles, st = [], [], []
    for chart in range(charts):
        for triangle in corners:
            x = triangle[:, 0] if chart % 2 == 0 else 1.0 - triangle[:, 0]
            triangles.append(np.arange(3) + len(points))
            points += np.column_stack([x + 2.0 * chart, triangle[:, 1], np.zeros(3)]).tolist()
            st.append(np.column_stack([triangle, np.zeros(3)]))
    random = np.random.default_rng(4)
    uv = np.column_stack([random.uniform(0.05, 0.95, (40, 2)), np.zeros(40)])
    own = np.arange(40) % charts
    x = np.where(own % 2 == 0, uv[:, 0], 1.0 - uv[:, 0]) + 2.0 * own
    meant = np.column_stack([x, uv[:, 1], np.zeros(40)])
    given = meant + random.normal(scale=0.05, size=(40, 3))
    found = bind(given, np.array(points), np.array(triangles), (uv, np.array(st)))
    np.testing.assert_allclose(given - found.offset, meant, atol=1e-9)


SHOT = """name = "s"
groom = "plain.toml"
frames = [1, 2]
[contact]
[[collider]]
usd = "skin.usda"
prims = ["/skin"]
"""


def read_collider(folder, keys):
    feather = '[[feather]]\nid = "f"\nkind = "covert"\nposition = [0, 0, 1]\n'
    (folder / "plain.toml").write_text(f'name = "g"\n{feather}')
    (folder / "shot.toml").write_text(SHOT + keys)
    (collider,) = read_shot(folder / "shot.toml").colliders
    surface = collider.surface
    return surface.rest[surface.triangles].mean(axis=1), surface


@pytest.mark.parametrize(
    ("keys", "axis", "low"),
    [
        ('map = "half.png"', 0, 0.0),
        ('map = "half.png"\nuv = "turned"', 1, 0.0),
        ('map = "half.png"\nuv = "twice"\nwrap = "clamp"', 0, -0.05),
        ('map = "weight"', 1, 0.05),
    ],
)
def test_a_map_says_which_part_of_a_collider_is_touched(tmp_path, keys, axis, low):
    sheet(tmp_path, lambda x, y: (x, y))
    stage = Usd.Stage.Open(str(tmp_path / "skin.usda"))
    api = UsdGeom.PrimvarsAPI(stage.GetPrimAtPath("/skin"))
    st = np.array(api.GetPrimvar("st").Get())
    for name, values in (("turned", st[:, ::-1]), ("twice", 2.0 * st)):
        kind = Sdf.ValueTypeNames.TexCoord2fArray
        api.CreatePrimvar(name, kind, "vertex").Set([tuple(each) for each in values.tolist()])
    weights = np.clip(2.0 * st[:, 1] - 1.0, 0.0, 1.0).tolist()
    api.CreatePrimvar("weight", Sdf.ValueTypeNames.FloatArray, "vertex").Set(weights)
    stage.Save()
    picture(tmp_path, "half.png", np.where(np.arange(8) < 4, 0, 255).astype(np.uint8)[None])
    whole, _ = read_collider(tmp_path, "")
    middles, surface = read_collider(tmp_path, keys)
    is_left = whole[:, axis] > low
    assert np.array_equal(middles, whole[is_left])
    assert len(surface.closed) == len(surface.border) == len(surface.face) == is_left.sum()


def test_a_volume_of_which_a_part_is_touched_is_a_sheet(tmp_path):
    stage = new_stage(tmp_path / "skin.usda", 1.0)
    box = trimesh.creation.box((0.2, 0.2, 0.2))
    for mesh in (add_mesh(stage, "/skin", box.vertices, [3] * 12, box.faces),):
        weights = (box.vertices[:, 2] > 0.0).astype(float).tolist()
        primvar = UsdGeom.PrimvarsAPI(mesh).CreatePrimvar(
            "weight", Sdf.ValueTypeNames.FloatArray, "vertex"
        )
        primvar.Set(weights)
    stage.GetRootLayer().Save()
    assert read_collider(tmp_path, "")[1].closed.all()
    middles, surface = read_collider(tmp_path, 'map = "weight"')
    assert 2 <= len(middles) < 12
    assert not surface.closed.any()


def test_a_map_that_leaves_nothing_to_touch_is_refused(tmp_path):
    sheet(tmp_path, lambda x, y: (x, y))
    picture(tmp_path, "black.png", 0)
    with pytest.raises(InputError, match=r"map: leaves no face of /skin"):
        read_collider(tmp_path, 'map = "black.png"')
