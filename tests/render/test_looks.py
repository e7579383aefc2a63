"""How feathers look, what stands beside them, and where the camera is."""

from __future__ import annotations

import numpy as np
import pytest
from PIL import Image
from pxr import Gf, Sdf, Usd, UsdGeom
from scipy.spatial import ConvexHull
from usd_meshes import SQUARE, define_mesh

from featherfx import export_groom
from featherfx.errors import InputError, InputWarning
from featherfx.files.folders import shipped_folder
from featherfx.phases import Account
from featherfx.render.camera import axes_of, framing, turntable
from featherfx.render.geometry import load_points, topology_of
from featherfx.render.light_kernels import VANE
from featherfx.render.options import PictureOptions
from featherfx.render.picture import render
from featherfx.render.subject import open_subject
from featherfx.render.tracer import backdrop
from featherfx.usd.read.cache import Cache
from featherfx.usd.read.scenes import find_camera

pytest.importorskip("embreex", reason="no wheel for this platform")

SIZE = (96, 64)


def picture(file, path, **options):
    options = {"size": SIZE, "samples": 4} | options
    (written,) = render(file, path, overwrite=True, **options)
    return np.asarray(Image.open(written).convert("RGB")).astype(int)


def covered(pixels):
    """Where a picture differs from what is behind all."""
    rows, columns = pixels.shape[:2]
    behind = 255 * backdrop(columns, 0, rows, rows)
    return np.abs(pixels - behind).sum(axis=2) > 12


def whole_reach(subject):
    return np.concatenate([hull for _, hull in subject.whole_reach])


def looked_at(cache, size=(400, 300), **options):
    """A subject with its colours chosen for a camera that sees all of it, and its geometry."""
    subject = open_subject(cache, PictureOptions(**options))
    right, up = axes_of("top", *subject.shape())
    eye = framing(right, up, whole_reach(subject), size)
    subject.colour(eye, [1.0], "shaded")
    return subject, eye, subject.geometry(1.0)


def test_every_barb_is_a_strip_within_the_vane(cache):
    subject, _, geometry = looked_at(cache)
    assert len(subject.plumage.plain) == 0
    barbs = sum(len(each.members) * 2 * each.barbs for each in subject.plumage.groups)
    tips = geometry.barbs[:, 1] == 1.0
    assert np.count_nonzero(tips) == barbs > 8 * 12
    mesh = load_points(subject.cache, subject.scene, 1.0)
    low, high = mesh.min(axis=0), mesh.max(axis=0)
    assert (geometry.points > low - 1e-4).all()
    assert (geometry.points < high + 1e-4).all()


def test_barbs_of_every_shipped_kind_are_drawn(tmp_path):
    """Also where vanes begin and end in a point, in a row without barbs."""
    kinds = sorted(path.stem for path in (shipped_folder() / "feather").glob("*.toml"))
    assert len(kinds) > 4
    feathers = "".join(
        f'[[feather]]\nid = "{kind}"\nkind = "{kind}"\nposition = [0, {k}, 0]\n'
        "direction = [-1, 0, 0]\nup = [0, 0, 1]\n"
        for k, kind in enumerate(kinds)
    )
    (tmp_path / "groom.toml").write_text(f'name = "kinds"\n{feathers}')
    export_groom(tmp_path / "groom.toml", tmp_path / "kinds.usdc", quality="draft")
    for feather in Cache(tmp_path / "kinds.usdc").feathers:
        topology = topology_of(feather)
        assert topology is not None, feather.id
        for vane in topology.vanes:
            assert vane.rows.shape == (len(vane.heights), len(vane.places))
            assert vane.places[0] == 0.0
            assert vane.places[-1] == 1.0
            assert vane.edges is None


def test_barbs_of_a_vane_that_may_part_go_along_with_their_strips(tmp_path):
    """Where a strip's upper edge leaves the next row, none of its barbs stays across the gap."""
    (tmp_path / "groom.toml").write_text(
        'name = "one"\n[[feather]]\nid = "feather"\nkind = "swan_primary"\nposition = [0, 0, 0]\n'
        'direction = [-1, 0, 0]\nup = [0, 0, 1]\noverrides = { vane_material.hooks = "open" }\n'
    )
    export_groom(tmp_path / "groom.toml", tmp_path / "one.usdc", quality="draft")
    subject, _, whole = looked_at(tmp_path / "one.usdc")
    (group,) = subject.plumage.groups
    vane = group.topology.vanes[0]
    assert vane.edges is not None
    points = load_points(subject.cache, subject.scene, 1.0).astype(float)
    lips = np.setdiff1d(vane.edges[5], vane.rows[6])
    assert len(lips) > 0
    np.testing.assert_array_equal(points[vane.edges[5]], points[vane.rows[6]])
    points[lips] += [0.0, 0.0, 0.01]
    moved = subject.plumage.geometry(points).points - whole.points[: len(whole.points)]
    lifted = np.abs(moved).max(axis=1) > 1e-6
    # strips of one row in nine, on one side of two
    assert 0.0 < lifted.mean() < 0.2
    assert moved[lifted][:, 2].max() == pytest.approx(0.01, rel=0.15)


def test_strips_cover_the_area_of_the_vane(cache):
    """Barbs of the tests' feather are straight, so that strips tile the vane but for their tips."""
    subject, _, geometry = looked_at(cache)
    corners = geometry.points[geometry.triangles[geometry.material == VANE]].astype(float)

    def area(points):
        normal = np.cross(points[:, 1] - points[:, 0], points[:, 2] - points[:, 0])
        return 0.5 * np.linalg.norm(normal, axis=1).sum()

    scene = subject.scene
    mesh = load_points(subject.cache, scene, 1.0)[scene.triangles[~scene.rachis]]
    assert area(corners) == pytest.approx(area(mesh), rel=0.04)


def test_more_pixels_show_more_barbs_up_to_those_there_are(cache):
    counts = []
    for width in (60, 240, 960, 40000):
        subject, *_ = looked_at(cache, (width, width))
        counts.append(max(each.barbs for each in subject.plumage.groups))
    assert counts[0] < counts[1] < counts[2]
    assert counts[3] < 0.1 / 5e-4 * 1.35


@pytest.fixture
def two_squares(tmp_path):
    """A large square, and a small one 0.3 m above it; z up, metres."""
    stage = Usd.Stage.CreateNew(str(tmp_path / "two.usda"))
    UsdGeom.SetStageUpAxis(stage, "Z")
    UsdGeom.SetStageMetersPerUnit(stage, 1)
    define_square(stage, "low", 1.0, 0.0)
    define_square(stage, "high", 0.25, 0.3)
    stage.Save()
    return tmp_path / "two.usda"


def define_square(stage, name, half, height):
    return define_mesh(stage, f"/{name}", half * SQUARE + (0.0, 0.0, height), scheme=None)


def test_shadows_are_soft(two_squares, tmp_path):
    shown = picture(two_squares, tmp_path / "a.png", view="top", samples=16)
    lit = shown[covered(shown)].sum(axis=1)
    full = np.median(lit)
    assert 60 < lit.min() < 0.75 * full
    assert ((lit > lit.min() + 60) & (lit < full - 60)).any()


def test_a_floor_takes_shadow_and_has_no_colour(two_squares, tmp_path):
    stage = Usd.Stage.Open(str(two_squares))
    define_square(stage, "low", 0.1, 0.0)
    define_square(stage, "high", 0.6, 0.8)
    stage.Save()
    free, stands = (
        picture(two_squares, tmp_path / "a.png", floor=floor, samples=16, view="top")
        for floor in (False, True)
    )
    darker = (free - stands).max(axis=2)
    assert darker[~covered(free)].max() > 40
    assert (darker >= -1).all()
    assert (darker <= 1).mean() > 0.5


def test_a_body_is_seen_upright():
    directions = np.random.default_rng(3).normal(size=(60, 3))
    ball = ConvexHull(directions / np.linalg.norm(directions, axis=1, keepdims=True))
    points = ball.points * (2.0, 1.0, 1.0)
    right, up = axes_of("auto", points, ball.simplices)
    assert right[2] == 0
    assert up[2] > 0.9
    # to the right where its longest axis is positive
    assert right[0] > 0.8


def test_raised_wings_are_seen_from_above_and_not_along_their_vanes():
    turn = np.radians(35)
    inner, outer = (0.1, 0.0), (0.1 + np.cos(turn), np.sin(turn))
    corners = [(x, side * y, z) for side in (1, -1) for y, z in (inner, outer) for x in (0, -0.2)]
    triangles = np.array([[0, 1, 3], [0, 3, 2], [4, 7, 5], [4, 6, 7]])  # all look upwards
    right, up = axes_of("auto", np.array(corners), triangles)
    assert np.cross(right, up)[2] > 0.8


def test_a_lens_blurs_what_is_out_of_focus(two_squares, tmp_path):
    stage = Usd.Stage.Open(str(two_squares))
    # dark before what is behind it
    define_square(stage, "high", 0.25, 3.0).CreateDisplayColorAttr([(0.02, 0.02, 0.02)])
    stage.Save()
    sharp, blurred = (
        picture(two_squares, tmp_path / "a.png", f_stop=stop, samples=64, view="top")
        for stop in (0.0, 0.1)
    )
    # from the left border to the background
    row = SIZE[1] // 2
    edges = [np.abs(np.diff(each.sum(axis=2)[row])).max() for each in (sharp, blurred)]
    assert edges[1] < 0.6 * edges[0]


def test_the_camera_is_the_same_for_all_frames_and_calls(cache):
    whole = open_subject(cache, PictureOptions())
    right, up = axes_of("auto", *whole.shape())
    eye = framing(right, up, whole_reach(whole), SIZE)
    for time in (1.0, 2.5, 5.0):
        x, y = eye.places(load_points(whole.cache, whole.scene, time)).T
        assert x.min() > 0 < y.min()
        assert x.max() < SIZE[0]
        assert y.max() < SIZE[1]


def test_the_camera_goes_along_with_what_flies_away(tmp_path):
    """A beating square that flies far is as large in every frame as one that stays."""
    shown = {}
    for speed in (0.0, 2.0):
        stage = Usd.Stage.CreateNew(str(tmp_path / f"{speed}.usda"))
        UsdGeom.SetStageUpAxis(stage, "Z")
        UsdGeom.SetStageMetersPerUnit(stage, 1)
        stage.SetStartTimeCode(1)
        stage.SetEndTimeCode(9)
        points = define_square(stage, "body", 0.25, 0.0).GetPointsAttr()
        square = np.array(points.Get())
        for code in range(1, 10):
            beat = 0.1 * np.sin(2.0 * code) * np.array([[0, 0, 1], [0, 0, 0], [0, 0, 1], [0, 0, 0]])
            way = speed * np.array([code, 0.5 * code, 0.1 * code**2])
            points.Set([tuple(map(float, each)) for each in square + beat + way], code)
        stage.Save()
        for frame in (1, 4, 9):
            file = tmp_path / "a.png"
            own = covered(picture(tmp_path / f"{speed}.usda", file, frames=[frame], view="top"))
            shown[speed, frame] = own.mean()
    still = [shown[0.0, frame] for frame in (1, 4, 9)]
    moving = [shown[2.0, frame] for frame in (1, 4, 9)]
    assert min(still) > 0.2
    np.testing.assert_allclose(moving, still, rtol=0.3)


def test_a_single_frame_is_the_tile_of_a_sheet(cache, tmp_path):
    single = picture(cache, tmp_path / "a.png", frames=[3])
    sheet = picture(cache, tmp_path / "b.png", frames=[1, 3], sheet=True)
    tile = sheet[:, SIZE[0] + 2 :]
    # below its label
    np.testing.assert_array_equal(tile[30:], single[30:])


def test_a_feather_close_up_fills_the_picture(cache, tmp_path):
    ids = [each.id for each in Cache(cache).feathers]
    near = picture(cache, tmp_path / "a.png", feathers=[ids[0]])
    inside = covered(near)
    filled = [np.ptp(np.flatnonzero(inside.any(axis=k))) / SIZE[k] for k in (0, 1)]
    assert max(filled) > 0.8
    around = picture(cache, tmp_path / "b.png", feathers=[ids[0]], surroundings=True)
    assert covered(around).sum() >= inside.sum()
    by_region = picture(cache, tmp_path / "c.png", regions=["tail"])
    assert covered(by_region).any()


def test_feathers_and_regions_that_are_not_there(cache, tmp_path):
    ids = [each.id for each in Cache(cache).feathers]
    with pytest.raises(InputError) as caught:
        render(cache, tmp_path / "a.png", feathers=[ids[0] + "x"], regions=["tial"])
    told = str(caught.value)
    assert f"feather: no feather fits '{ids[0]}x', did you mean '{ids[0]}'?" in told
    assert "region: no region fits 'tial', did you mean 'tail'?" in told


def test_caches_side_by_side(cache, tmp_path):
    three = picture(cache, tmp_path / "c.png", frames=[3], against=[cache, cache])
    assert three.shape == (SIZE[1], 3 * SIZE[0] + 4, 3)
    both = picture(cache, tmp_path / "a.png", frames=[3], against=cache)
    assert both.shape == (SIZE[1], 2 * SIZE[0] + 2, 3)
    left, right = both[30:, : SIZE[0]], both[30:, SIZE[0] + 2 :]
    np.testing.assert_array_equal(left, right)
    with pytest.raises(InputError, match=r"no\.usdc: there is no such file"):
        render(cache, tmp_path / "b.png", against=tmp_path / "no.usdc")
    with pytest.raises(InputError, match="a scale for each file"):
        render(cache, tmp_path / "b.png", against=cache, colour="strain")


@pytest.fixture
def cameras(tmp_path):
    """A file, y up and in centimetres, with a camera 2 m above the origin that looks down."""
    stage = Usd.Stage.CreateNew(str(tmp_path / "cameras.usda"))
    UsdGeom.SetStageUpAxis(stage, "Y")
    UsdGeom.SetStageMetersPerUnit(stage, 0.01)
    camera = UsdGeom.Camera.Define(stage, "/cameras/above")
    camera.AddTranslateOp().Set(Gf.Vec3d(0, 200, 0))
    camera.AddRotateXOp().Set(-90.0)
    camera.CreateFocalLengthAttr(50.0)
    camera.CreateHorizontalApertureAttr(36.0)
    camera.CreateVerticalApertureAttr(24.0)
    stage.Save()
    return tmp_path / "cameras.usda"


def test_a_usd_camera_by_its_path(cache, cameras, tmp_path):
    seen = find_camera(cache, f"{cameras}:/cameras/above", Cache(cache))(1.0)
    np.testing.assert_allclose(seen.eye, (0, 0, 2), atol=1e-9)
    np.testing.assert_allclose(seen.back, (0, 0, 1), atol=1e-9)
    shown = picture(cache, tmp_path / "a.png", camera=f"{cameras}:/cameras/above")
    points = load_points(Cache(cache), open_subject(cache, PictureOptions()).scene, 1.0)
    # 36 mm at 50 mm and 2 m: 1.44 m over the width
    columns = (points[:, 0] / (2 - points[:, 2]) / 0.72 + 0.5) * SIZE[0]
    inside = np.flatnonzero(covered(shown).any(axis=0))
    assert inside.min() == pytest.approx(np.clip(columns.min(), 0, SIZE[0]), abs=2)
    assert inside.max() == pytest.approx(np.clip(columns.max(), 0, SIZE[0]), abs=2)


def test_a_wrong_camera_path_lists_the_cameras(cache, cameras, tmp_path):
    with pytest.raises(InputError, match="The stage has one camera: /cameras/above"):
        render(cache, tmp_path / "a.png", camera=f"{cameras}:/cameras/below")
    with pytest.raises(InputError, match="The stage has no camera"):
        render(cache, tmp_path / "a.png", camera="/nothing")


def test_turntable_cameras_see_everything_from_one_distance():
    points = np.random.default_rng(3).normal(size=(40, 3)) * (3, 1, 0.5)
    right, up = np.array([1.0, 0, 0]), np.array([0, 0, 1.0])
    eyes = turntable(right, up, points, SIZE, np.arange(6) * np.pi / 3)
    middle = 0.5 * (points.min(axis=0) + points.max(axis=0))
    away = [np.linalg.norm((eye.view.eye - middle)[:2]) for eye in eyes]
    np.testing.assert_allclose(away, away[0])
    for eye in eyes:
        assert (eye.places(points) > 0).all()
        assert (eye.places(points) < SIZE).all()


@pytest.fixture
def skinned(cache, tmp_path):
    """A copy of the cache that names a skin, which has eyes, and a collider, below the feathers."""
    stage = Usd.Stage.CreateNew(str(tmp_path / "body.usda"))
    UsdGeom.SetStageUpAxis(stage, "Z")
    UsdGeom.SetStageMetersPerUnit(stage, 1)
    stage.SetTimeCodesPerSecond(24)
    define_square(stage, "bird/body", 0.2, -0.05)
    define_square(stage, "bird/eyes", 0.01, -0.04)
    define_square(stage, "perch", 0.1, -0.055)
    floor = define_square(stage, "floor", 5.0, -0.06)
    floor.CreateDisplayColorAttr([(0.6, 0.05, 0.05)])
    stage.Save()
    layer = Sdf.Layer.FindOrOpen(str(cache))
    copy = Sdf.Layer.CreateNew(str(tmp_path / "skinned.usdc"))
    copy.TransferContent(layer)
    told = dict(copy.customLayerData.get("featherfx", {}))
    told["scenery"] = {
        str(k): {"role": role, "file": "body.usda", "prim": prim}
        | dict.fromkeys(("start", "first", "time_codes_per_frame"), 1.0)
        for k, (role, prim) in enumerate((("skin", "/bird/body"), ("collider", "/floor")))
    }
    copy.customLayerData = {"featherfx": told}
    copy.Save()
    return tmp_path / "skinned.usdc"


def test_skin_and_colliders_of_the_shot_are_drawn(skinned, tmp_path):
    shown = picture(skinned, tmp_path / "a.png", view="top")
    bare = picture(skinned, tmp_path / "b.png", view="top", bare=True)
    # the floor reaches to every corner, but the camera keeps to feathers and skin
    red, _, blue = shown[0, 0]
    assert red > blue + 60
    assert bare[0, 0, 0] < bare[0, 0, 2]
    assert covered(bare).mean() < 0.9
    subject = open_subject(skinned, PictureOptions())
    drawn = [(each.surface.path, each.is_framed) for each in subject.scenery]
    assert drawn == [("/bird/body", True), ("/bird/eyes", True), ("/floor", False)]
    assert np.abs(whole_reach(subject)[:, :2]).max() < 0.5


def test_scenery_that_is_gone_is_told(skinned, tmp_path):
    (tmp_path / "body.usda").unlink()
    with pytest.warns(InputWarning, match=r"its skin .*body\.usda is not there and not drawn"):
        picture(skinned, tmp_path / "a.png")


def test_progress_counts_to_the_end(cache, tmp_path):
    told = []
    with Account(told.append):
        picture(cache, tmp_path / "a.png", frames=[1, 2], sheet=True)
    assert list(dict.fromkeys(each.name for each in told)) == ["reading", "drawing", "finishing"]
    drawing = [each for each in told if each.name == "drawing"]
    assert {each.total for each in drawing} == {8}
    assert sorted({each.done for each in drawing}) == list(range(9))


def test_films(cache, tmp_path):
    for rate, lasting in ((None, 40), (12, 80), (50, 20)):
        options = {"frames": [1, 2, 3], "size": (32, 24), "samples": 1, "rate": rate}
        render(cache, tmp_path / "a.gif", overwrite=True, **options)
        film = Image.open(tmp_path / "a.gif")
        assert (film.n_frames, film.size, film.info["duration"]) == (3, (32, 24), lasting)
    with pytest.raises(InputError, match=r"rate: 0\.5 is not allowed. Give 1 to 50 pictures"):
        render(cache, tmp_path / "b.gif", rate=0.5)
    with pytest.raises(InputError, match="a sheet is one image"):
        render(cache, tmp_path / "b.gif", sheet=True)


def test_an_mp4_has_every_frame(cache, tmp_path):
    ffmpeg = pytest.importorskip("imageio_ffmpeg")
    render(cache, tmp_path / "a.mp4", size=(65, 48), samples=1)
    frames = ffmpeg.read_frames(str(tmp_path / "a.mp4"))
    assert next(frames)["size"] == (64, 48)
    assert len(list(frames)) == 5


def groom_of(tmp_path, *lines):
    """A groom of feathers, each with lines of its own."""
    groom = tmp_path / "groom.toml"
    each = '[[feather]]\nid = "feather_{}"\nkind = "swan_primary"\nposition = [0, {}, 0]\n{}\n'
    feathers = (each.format(k, k, line) for k, line in enumerate(lines))
    groom.write_text('name = "few"\n' + "".join(feathers))
    return groom


def drawn_group(tmp_path, line, name="one"):
    """A feather as a picture that it fills has it: its group, and its strips (B, 2 S + 1, 3) of
    both vanes."""
    export_groom(groom_of(tmp_path, line), tmp_path / f"{name}.usdc", quality="draft")
    subject = open_subject(tmp_path / f"{name}.usdc", PictureOptions())
    right, up = axes_of("top", *subject.shape())
    eye = framing(right, up, whole_reach(subject), (400, 300))
    subject.colour(eye, [None], "shaded")
    geometry, (group,) = subject.geometry(None), subject.plumage.groups
    each = 2 * group.stations + 1
    points = geometry.points[: 2 * group.barbs * each]
    return group, points.reshape(2, group.barbs, each, 3)


def drawn_with(tmp_path, look, name="one"):
    return drawn_group(tmp_path, f"overrides = {{ {look} }}", name)[1]


def test_pictures_show_how_barbs_look(tmp_path):
    smooth = drawn_with(tmp_path, "barbs.clump_count = 6", "smooth")
    clumped = drawn_with(tmp_path, "barbs = { clump = 1.0, clump_count = 6 }", "clumped")
    np.testing.assert_allclose(clumped[:, :, 0], smooth[:, :, 0], atol=1e-7)
    for vane in clumped[:, :, -1]:
        assert len(np.unique(np.round(vane, 6), axis=0)) == 6
    known = {tuple(each) for each in np.round(smooth[:, :, -1].reshape(-1, 3), 6).tolist()}
    ends = np.round(clumped[:, :, -1].reshape(-1, 3), 6)
    assert {tuple(each) for each in ends.tolist()} <= known
    uneven = drawn_with(tmp_path, "barbs.jitter = 0.5", "uneven")
    long, short = (
        np.linalg.norm(each[:, :, -1] - each[:, :, 0], axis=2) for each in (smooth, uneven)
    )
    grown = long > 1e-3
    assert (short[grown] <= 1.001 * long[grown]).all()
    assert 0.6 < (short[grown] / long[grown]).mean() < 0.9
    frizzy = drawn_with(tmp_path, "barbs.frizz = 1e-3", "frizzy")
    away = np.linalg.norm(frizzy - smooth, axis=3)
    assert away[:, :, 0].max() < 1e-7
    assert 2e-4 < away[:, :, -1].mean() < away.max() < 1.5e-3


def test_edges_are_as_soft_as_barbs_are_loose(tmp_path):
    """Less is seen of a vane whose barbs part, which reaches as far."""
    reaches, shown = [], []
    for loose in (0.0, 0.5):
        groom, cache = groom_of(tmp_path, f"overrides.barbs.loose = {loose}"), tmp_path / "a.usdc"
        export_groom(groom, cache, quality="draft", overwrite=True)
        pixels = picture(cache, tmp_path / "a.png", size=(300, 200), view="top", samples=16)
        reaches.append(np.argwhere(covered(pixels)))
        shown.append(np.abs(pixels - 255 * backdrop(300, 0, 200, 200)).sum())
    assert shown[1] < 0.9 * shown[0]
    extents = [[each.min(axis=0), each.max(axis=0)] for each in reaches]
    np.testing.assert_allclose(*extents, atol=3)


@pytest.mark.parametrize("size", [0.04, 8.0])
def test_a_feather_is_drawn_alike_at_any_size(tmp_path, size):
    keys = "overrides = { barb_spacing_exponent = 1 }\nscale = "
    (once, points), (scaled, others) = (
        drawn_group(tmp_path, f"{keys}{each}", f"size_{k}") for k, each in enumerate((1.0, size))
    )
    assert scaled.real == once.real == pytest.approx(0.85 * 0.35 / 5e-4, rel=0.01)
    np.testing.assert_allclose(others / size, points, atol=1e-6)


@pytest.mark.parametrize("instances", [True, False])
def test_caches_tell_how_many_barbs_there_are(tmp_path, instances):
    groom = groom_of(tmp_path, "", "scale = 0.05", "overrides = { barb_spacing = 4.25e-3 }")
    export_groom(groom, tmp_path / "a.usdc", quality="draft", instances=instances)
    counts = {f.id: f.barb_count for f in Cache(tmp_path / "a.usdc").feathers}
    assert counts == {"feather_0": 595, "feather_1": round(595 * 0.05**0.6), "feather_2": 70}


def test_a_look_that_is_none_is_refused(tmp_path):
    drawn_with(tmp_path, "barbs.frizz = 1e-3")
    stage = Usd.Stage.Open(str(tmp_path / "one.usdc"))
    mesh = next(prim for prim in stage.Traverse() if prim.IsA(UsdGeom.Mesh))
    mesh.GetAttribute("primvars:barbLook").Set(['{"clump_count": 0}'])
    stage.Save()
    with pytest.raises(InputError, match=r"barbLook.*clump_count: 0.*1 to 1000"):
        Cache(tmp_path / "one.usdc")
