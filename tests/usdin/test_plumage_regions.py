"""Feathers that grow in regions of a USD skin."""

import warnings

import numpy as np
import pytest
import trimesh
from pxr import Sdf, UsdGeom, Vt
from regions_skin import RADIUS, grown, problems, region, roots, skin_folder, write_skin

from featherfx.errors import InputWarning
from featherfx.groom.regions import regions
from featherfx.groom.regions.scatter import expected_count
from featherfx.phases import Account

__all__ = ["skin_folder"]


def test_roots_stand_on_the_skin_tilted_and_combed(folder):
    groom = grown(folder, region(keys="count = 200\ntilt = 12\nlength = 0.03"))
    assert len(groom.feathers) == 200
    positions = roots(groom)
    normals = positions / np.linalg.norm(positions, axis=1)[:, None]
    shafts = np.array([f.rotation[:, 0] for f in groom.feathers])
    lifted = np.degrees(np.arcsin(np.einsum("nc,nc->n", shafts, normals)))
    assert np.abs(lifted - 12).max() < 1.0
    # combed along -x wherever the skin does not face it
    aside = np.abs(normals[:, 0]) < 0.9
    assert (shafts[aside, 0] < 0).all()
    assert {round(f.kind.length, 9) for f in groom.feathers} == {0.03}
    assert all(f.mirrored == (f.position[1] > 0) for f in groom.feathers)


def test_units_of_the_skin(tmp_path):
    write_skin(tmp_path, meters_per_unit=0.01)
    assert np.linalg.norm(roots(grown(tmp_path, region())), axis=1).max() < 1.01 * RADIUS


def test_editing_one_region_leaves_the_other_alone(folder):
    front = "count = 100\nwhere = [{ x = [0, 1], soft = 0.02 }]"
    back = "count = 100\nwhere = [{ x = [-1, 0], soft = 0.02 }]"
    first = grown(folder, region("front", front), region("back", back))
    other = grown(
        folder,
        region("front", front.replace("100", "333") + "\nlength = 0.02\nseed = 9"),
        region("back", back),
    )

    def of_back(groom):
        return {f.id: tuple(f.position) for f in groom.feathers if f.region == "back"}

    assert of_back(first) == of_back(other)


def test_regions_that_pass_into_each_other_have_places_of_their_own(folder):
    front = "count = 300\nwhere = [{ x = [0, 1], soft = 0.1 }]"
    back = "count = 300\nwhere = [{ x = [-1, 0], soft = 0.1 }]"
    groom = grown(folder, region("front", front), region("back", back))
    places = [
        roots(groom)[[f.region == name for f in groom.feathers]] for name in ("front", "back")
    ]
    apart = np.linalg.norm(places[0][:, None] - places[1], axis=2).min(axis=1)
    assert (apart < 1e-3).mean() < 0.05


def test_a_higher_density_keeps_roots_and_ids(folder):
    sparse = grown(folder, region(keys="density = 1000"))
    dense = grown(folder, region(keys="density = 3000"))
    # the sphere's area times the density
    assert len(sparse.feathers) == pytest.approx(4 * np.pi * RADIUS**2 * 1000, rel=0.1)
    kept = {f.id: tuple(f.position) for f in dense.feathers}
    assert all(kept[f.id] == tuple(f.position) for f in sparse.feathers)


def test_feathers_of_a_density_are_counted_once(folder, tmp_path, monkeypatch):
    monkeypatch.setenv("FEATHERFX_CACHE", str(tmp_path / "kept"))
    counts = []

    def counted(*given):
        counts.append(expected_count(*given))
        return counts[-1]

    monkeypatch.setattr(regions, "expected_count", counted)
    half = "\nwhere = [{ y = [0, 1] }]"
    wanted = "density = 1000", "density = 1000", "density = 500", "density = 1000" + half
    found = [len(grown(folder, region(keys=keys)).feathers) for keys in wanted]
    assert len(counts) == 3
    assert found == pytest.approx([counts[0], *counts], rel=0.15)


@pytest.mark.parametrize(
    ("rule", "inside"),
    [
        ("subset = 'back'", lambda p: p[:, 0] < 0.01),
        ("primvar = 'top'", lambda p: p[:, 2] > -0.01),
        ("box = [[-1, -1, 0.05], [1, 1, 1]]", lambda p: p[:, 2] >= 0.05),
        ("sphere = [0, 0, 0.1, 0.05]", lambda p: np.linalg.norm(p - [0, 0, 0.1], axis=1) <= 0.05),
        ("y = [0.0, 1.0]", lambda p: p[:, 1] >= 0),
        ("y = [0.0, 1.0], invert = true", lambda p: p[:, 1] <= 0),
        ("facing = [0, 0, 1], angle = 60, soft_angle = 0", lambda p: p[:, 2] > 0.48 * RADIUS),
    ],
)
def test_where(folder, rule, inside):
    positions = roots(grown(folder, region(keys=f"count = 60\nwhere = [{{ {rule} }}]")))
    assert len(positions) == 60
    assert inside(positions).all()


def facing_spheres(distance):
    """Two spheres that face each other along x, as one mesh."""
    parts = [trimesh.creation.icosphere(3, radius=RADIUS) for _ in range(2)]
    parts[1].apply_translation([2 * RADIUS + distance, 0, 0])
    return trimesh.util.concatenate(parts)


def test_no_feathers_where_there_is_no_room(tmp_path):
    write_skin(tmp_path, facing_spheres(0.01))
    # a ball that touches both spheres has its middle in the plane between them: its radius at the
    # angle a from the axis is (RADIUS + 0.005) / cos(a) - RADIUS
    positions = roots(grown(tmp_path, region(keys="count = 300\nwhere = [{ free_radius = 0.02 }]")))
    apart = np.abs(positions[:, 0] - (RADIUS + 0.005))
    assert len(positions) == 300
    widest = RADIUS + 0.005 - RADIUS * (RADIUS + 0.005) / (RADIUS + 0.02)
    assert widest - 0.004 < apart.min() < widest + 0.01


def test_feathers_fit_the_room(tmp_path):
    write_skin(tmp_path, facing_spheres(0.02))
    groom = grown(
        tmp_path, region(keys="count = 400\nlength = 0.05\nmax_length_per_free_radius = 1.5")
    )
    lengths = np.array([f.kind.length for f in groom.feathers])
    cosine = roots(groom)[:, 0] / np.linalg.norm(roots(groom), axis=1)
    near = (np.linalg.norm(roots(groom), axis=1) < 1.01 * RADIUS) & (cosine > 0.8)
    room = (RADIUS + 0.01) / cosine[near] - RADIUS  # as above, its middle half way between
    assert near.sum() > 10
    # the mesh's points stand for the skin, and are 15 mm apart
    assert lengths[near] == pytest.approx(np.clip(1.5 * room, 0.02, 0.05), rel=0.15)
    assert lengths.max() == pytest.approx(0.05)
    shorter = grown(
        tmp_path, region(keys="count = 50\nlength = 0.05\nmax_length_per_free_radius = 0.01")
    )
    assert min(f.kind.length for f in shorter.feathers) == pytest.approx(0.02)


def test_feathers_are_as_much_denser_as_they_are_shorter(tmp_path):
    write_skin(tmp_path, facing_spheres(0.02))
    keys = "density = 9000\nlength = 0.05\nmax_length_per_free_radius = {}"
    counts = []
    for fit in (100, 1.5):
        places = roots(grown(tmp_path, region(keys=keys.format(fit))))
        own = places[np.linalg.norm(places, axis=1) < 1.01 * RADIUS] / RADIUS
        counts.append([(own[:, 0] > 0.92).sum(), (own[:, 0] < 0.0).sum()])
    (near, far), (more, as_many) = counts
    # of equal areas between cosines
    cosine = np.linspace(0.92, 1.0, 100)
    room = (RADIUS + 0.01) / cosine - RADIUS
    assert more / near == pytest.approx(np.mean(0.05 / np.clip(1.5 * room, 0.02, 0.05)), rel=0.1)
    assert as_many / far == pytest.approx(1.0, abs=0.03)


def test_roots_inside_a_body_that_crosses_itself_are_left_out(tmp_path):
    write_skin(tmp_path, facing_spheres(-0.08))  # the second reaches 8 cm into the first
    with pytest.warns(InputWarning) as caught:
        groom = grown(tmp_path, region(keys="count = 300"))
    told = "\n".join(str(each.message) for each in caught)
    assert "passes through itself" in told
    assert "roots lie inside the body" in told
    assert 200 < len(groom.feathers) < 300
    positions, other = roots(groom), np.array([2 * RADIUS - 0.08, 0, 0])
    for centre in (np.zeros(3), other):
        assert np.linalg.norm(positions - centre, axis=1).min() > 0.98 * RADIUS
    # the caps inside have a height of 4 cm of 20, and so a fifth of the area
    assert len(groom.feathers) == pytest.approx(300 * 0.8, abs=15)


def test_density_from_a_picture(folder):
    from PIL import Image

    stage = write_skin(folder)
    points = np.array(UsdGeom.Mesh(stage.GetPrimAtPath("/skin")).GetPointsAttr().Get())
    st = np.stack([points[:, 0] / 0.2 + 0.5, points[:, 2] / 0.2 + 0.5], axis=1)
    api = UsdGeom.PrimvarsAPI(stage.GetPrimAtPath("/skin"))
    kind = Sdf.ValueTypeNames.TexCoord2fArray
    api.CreatePrimvar("st", kind, "vertex").Set(Vt.Vec2fArray.FromNumpy(st.astype(np.float32)))
    stage.GetRootLayer().Save()
    picture = np.zeros((64, 64), np.uint8)
    picture[:32] = 255  # the upper half: t above 0.5, z above 0
    Image.fromarray(picture).save(folder / "map.png")
    positions = roots(grown(folder, region(keys="count = 80\nwhere = [{ image = 'map.png' }]")))
    assert positions[:, 2].min() > -0.005


@pytest.mark.parametrize(
    ("flow", "wanted"),
    [
        ("away = [0, 0, 0.2]", lambda p: p - [0, 0, 0.2]),
        ("towards = [0, 0, 0.2]", lambda p: [0, 0, 0.2] - p),
        (
            "away = [0.2, 0, 0], towards = [-9, 0, 0]",
            lambda p: np.tile([-1.0, 0.0, 0.0], (len(p), 1)),
        ),
        ("primvar = 'flow'", lambda p: np.tile([0.0, 1.0, 0.0], (len(p), 1))),
        ("curves = ['/guides']", lambda p: np.tile([-1.0, 0.0, 0.0], (len(p), 1))),
        ("direction = [-1, 0, 0], turn = 90", lambda p: np.cross(p, [-1.0, 0.0, 0.0])),
    ],
)
def test_flow(folder, flow, wanted):
    keys = "count = 60\ntilt = 0\nwhere = [{ z = [0.03, 0.08] }]"
    groom = grown(folder, region(keys=keys, flow=flow))
    positions = roots(groom)
    normals = positions / np.linalg.norm(positions, axis=1)[:, None]
    along = np.asarray(wanted(positions), dtype=float)
    along = along - np.einsum("nc,nc->n", along, normals)[:, None] * normals
    along /= np.linalg.norm(along, axis=1)[:, None]
    shafts = np.array([f.rotation[:, 0] for f in groom.feathers])
    assert np.einsum("nc,nc->n", shafts, along).min() > 0.995


def test_regions_blend_where_they_overlap(folder):
    where = "where = [{{ x = [{0}], soft = 0.1 }}]"
    front = f"count = 300\nlength = 0.02\n{where.format('0, 1')}"
    back = f"count = 300\nlength = 0.04\n{where.format('-1, 0')}"
    groom = grown(folder, region("front", front), region("back", back))
    x = roots(groom)[:, 0]
    length = np.array([f.kind.length for f in groom.feathers])
    assert np.allclose(length[x > 0.055], 0.02)
    assert np.allclose(length[x < -0.055], 0.04)
    # both regions agree on the length at a place: smoothstep of x over the border's width
    share = np.clip(x / 0.1 + 0.5, 0, 1)
    expected = 0.04 - 0.02 * share**2 * (3 - 2 * share)
    assert np.allclose(length, expected, atol=1e-9)
    alone = grown(folder, region("front", front + "\nblend = false"), region("back", back))
    assert {round(f.kind.length, 9) for f in alone.feathers if f.region == "front"} == {0.02}


def test_variants_repeat_and_lengths_do_not(folder):
    spread = "variation = { length = 0.1, width = 0.1, curl = 5 }\n"
    groom = grown(folder, region(keys=f"count = 200\n{spread}variants = 5"))
    assert len({id(f.prototype) for f in groom.feathers}) == 5
    assert len({f.kind.length for f in groom.feathers}) > 150
    free = grown(folder, region(keys=f"count = 200\n{spread}variants = 0"))
    assert len({id(f.prototype) for f in free.feathers}) == 200
    lengths = np.array([f.kind.length for f in free.feathers])
    assert lengths.std() / lengths.mean() == pytest.approx(0.1, rel=0.2)


def test_shafts_follow_the_skin(folder):
    groom = grown(folder, region(keys="count = 100\nlength = 0.04\nfollow = 1\nvariants = 0"))
    # an arc of 0.04 m on a sphere of 0.1 m turns by 0.4 rad; the straight way to the tip by less
    expected = np.degrees(np.arctan(0.4))
    cambers = np.array([f.kind.rachis.camber for f in groom.feathers])
    assert np.median(cambers) == pytest.approx(expected, abs=3.0)


BAD = [
    ("count = 10\ndensity = 5", "direction = [1, 0, 0]", "expects either density or count"),
    ("count = 10", "turn = 5", "holds none, expects one of direction"),
    ("count = 10\nlength = 0.5", "direction = [1, 0, 0]", "longer than the whole skin /skin"),
    ("density = 1e8", "direction = [1, 0, 0]", "that max_feathers of [skin] allows. Lower it"),
    ("count = 10\nwhere = [{ primvar = 'toop' }]", "direction = [1, 0, 0]", "did you mean 'top'"),
    ("count = 10\nwhere = [{ subset = 'front' }]", "direction = [1, 0, 0]", "known: back"),
    ("count = 10\nwhere = [{ image = 'a.png' }]", "direction = [1, 0, 0]", "no primvars:st"),
    (
        "count = 10\nwhere = [{ image = 'a.png' }]",
        "direction = [1, 0, 0]",
        "a.png: there is no such file",
    ),
    ("count = 10\nwhere = [{ x = [1, 0] }]", "direction = [1, 0, 0]", "Give the lower bound first"),
    ("count = 10\nwhere = [{ soft = 1 }]", "direction = [1, 0, 0]", "expects one of primvar"),
    ("count = 10", "curves = ['/nothing']", "no prim /nothing"),
    ("count = 10\nprim = '/body'", "direction = [1, 0, 0]", "no prim /body"),
]


@pytest.mark.parametrize(("keys", "flow", "message"), BAD)
def test_bad_regions(folder, keys, flow, message):
    assert message in problems(folder, region(keys=keys, flow=flow))


def test_all_problems_come_at_once(folder):
    regions = [region(f"r{k}", keys, flow) for k, (keys, flow, _) in enumerate(BAD[:3])]
    found = problems(folder, *regions)
    assert all(message in found for _, _, message in BAD[:3])


def test_a_region_needs_a_skin_and_a_name_of_its_own(folder):
    assert "grows on a skin" in problems(folder, region(), skin="name = 'a'\n")
    assert "is taken by region[0]" in problems(folder, region(), region())


def test_skins_inside_out_are_turned_and_open_ones_warned_of(tmp_path):
    write_skin(tmp_path, trimesh.creation.icosphere(2, radius=RADIUS))
    expected = roots(grown(tmp_path, region()))
    inverted = trimesh.creation.icosphere(2, radius=RADIUS)
    inverted.invert()
    write_skin(tmp_path, inverted)
    with pytest.warns(InputWarning, match="and 315 more: wound against the surface"):
        turned = grown(tmp_path, region())
    away = np.array([feather.rotation[:, 2] for feather in turned.feathers])
    assert (np.einsum("fc,fc->f", away, roots(turned)) > 0.0).all()
    assert len(turned.feathers) == len(expected)
    opened = trimesh.creation.icosphere(2, radius=RADIUS)
    opened.update_faces(np.arange(len(opened.faces)) > 5)
    write_skin(tmp_path, opened)
    with pytest.warns(InputWarning, match="is not closed"):
        grown(tmp_path, region())


def test_a_place_that_hardly_exists_warns(folder):
    keys = "count = 20\nwhere = [{ sphere = [0, 0, 5, 0.1] }]"
    told = r"reaches x -0\.1 to 0\.1, y -0\.1 to 0\.1, z -0\.1 to 0\.1 .*: 0 of 20 feathers"
    with pytest.warns(InputWarning, match=told), warnings.catch_warnings():
        grown(folder, region("none", keys), region())


def test_how_far_regions_have_grown_is_told(folder):
    told = []
    with Account(told.append):
        grown(folder, region(), region("more", "count = 50"), region("last", "count = 30"))
    found = [(each.done, each.total) for each in told if each.name == "growing"]
    assert found == [(0, 280), (200, 280), (250, 280), (280, 280), (280, 280)]
    assert [each.left is None for each in told if each.name == "growing"][2:] == [False] * 3


@pytest.mark.parametrize("names", [("one",), ("one", "other")])
def test_regions_without_any_skin_are_told_once(folder, names):
    nowhere = "density = 1e4\nwhere = [{ x = [5, 6] }]"
    with pytest.warns(InputWarning, match="no place on the skin and no feathers") as told:
        groom = grown(folder, region(), *(region(name, nowhere) for name in names))
    assert {feather.region for feather in groom.feathers} == {"body"}
    found = [str(each.message) for each in told if "no place" in str(each.message)]
    assert len(found) == 1
    assert all(f"'{name}'" in found[0] for name in names)
