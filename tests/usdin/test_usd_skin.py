"""Roots on animated USD skins: transforms, subframes, skeletons, instances, and what is refused."""

import numpy as np
import pytest
from pxr import Gf, Sdf, Usd, UsdGeom, UsdSkel
from scipy.spatial.transform import Rotation
from usdin_scenes import (
    TYPES,
    add_curves,
    add_matrix,
    add_mesh,
    add_skinned,
    arc,
    lifted,
    new_stage,
    rigid,
    sheet,
    vec,
    write_shot,
)

import featherfx
from featherfx.errors import InputError, InputWarning

SKIN = 'usd = "skin.usda"\nprim = "/bird/skin"'


def moving_sheet(tmp_path, meters_per_unit=1.0, up_axis="Z", codes_per_second=24.0):
    """A sheet whose points bend with time and whose parent turns and moves."""
    stage = new_stage(tmp_path / "skin.usda", meters_per_unit, up_axis, codes_per_second)
    points, counts, quads = sheet()
    if up_axis == "Y":
        points = points[:, [0, 2, 1]] * [1, 1, -1]
    points = points / meters_per_unit
    mesh = add_mesh(stage, "/bird/skin", points, counts, quads)
    parent = UsdGeom.Xform.Define(stage, "/bird")
    return stage, mesh, parent, points


def frames(shot, time):
    return featherfx.read_shot(shot).skin.frames(time)


def test_roots_follow_transforms_of_all_levels(tmp_path):
    stage, mesh, parent, _ = moving_sheet(tmp_path)
    for frame in (1, 13, 25):
        add_matrix(parent, rigid(90 * (frame - 1) / 24, (0, 0, 1), (0, 0, frame)), frame)
    add_matrix(mesh, rigid(0, (0, 0, 1), (0.5, 0, 0)), 1)
    stage.Save()
    shot = featherfx.read_shot(write_shot(tmp_path, SKIN + "\nrest = 1\ntolerance = 10"))
    rest, at_rest = shot.skin.frames(0.0)
    np.testing.assert_allclose(rest, [f.position for f in shot.groom.feathers], atol=1e-6)
    np.testing.assert_allclose(at_rest, [f.rotation for f in shot.groom.feathers], atol=1e-6)
    moved, turned = shot.skin.frames(1.0)
    turn = Rotation.from_euler("z", 90, degrees=True).as_matrix()
    np.testing.assert_allclose(moved, (rest - [0, 0, 1]) @ turn.T + [0, 0, 25], atol=1e-5)
    np.testing.assert_allclose(turned, turn @ at_rest, atol=1e-6)


@pytest.mark.parametrize("up_axis", ["Y", "Z"])
@pytest.mark.parametrize("codes_per_second", [24.0, 48.0])
def test_units_axes_time_codes_and_subframes(tmp_path, up_axis, codes_per_second):
    """Points rise by 1 m between the samples of the first and the last frame."""
    stage, mesh, _, points = moving_sheet(tmp_path, 0.01, up_axis, codes_per_second)
    rise = np.array([0, 100, 0]) if up_axis == "Y" else np.array([0, 0, 100])
    ratio = codes_per_second / 24
    mesh.GetPointsAttr().Set(vec(points), 1 * ratio)
    mesh.GetPointsAttr().Set(vec(points + rise), 25 * ratio)
    stage.Save()
    seconds, rate = SKIN + '\ntime = "seconds"', "frames_per_second = 24\n"
    shot = featherfx.read_shot(write_shot(tmp_path, seconds, more=rate))
    start = shot.skin.frames(0.0)[0]
    np.testing.assert_allclose(start, [f.position for f in shot.groom.feathers], atol=1e-6)
    for time in (0.25, 0.371, 1.0):
        expected = lifted(start, time)
        np.testing.assert_allclose(shot.skin.frames(time)[0], expected, atol=1e-6)


def test_samples_may_start_elsewhere(tmp_path):
    stage, mesh, _, points = moving_sheet(tmp_path)
    mesh.GetPointsAttr().Set(vec(points), 1001)
    mesh.GetPointsAttr().Set(vec(lifted(points, 1)), 1025)
    stage.Save()
    path = write_shot(tmp_path, SKIN)
    with pytest.raises(InputError, match="has samples from 1001 to 1025, the shot needs 1 to 25"):
        featherfx.read_shot(path)
    shot = featherfx.read_shot(write_shot(tmp_path, SKIN + "\nstart = 1001"))
    gained = shot.skin.frames(1.0)[0] - shot.skin.frames(0.0)[0]
    np.testing.assert_allclose(gained, np.broadcast_to([0, 0, 1.0], (5, 3)), atol=1e-6)
    held = featherfx.read_shot(write_shot(tmp_path, SKIN + '\nextrapolation = "hold"'))
    np.testing.assert_allclose(held.skin.frames(1.0)[0], held.skin.frames(0.0)[0])


@pytest.mark.parametrize("instanced", [False, True])
def test_skeletons_are_evaluated_as_usd_bakes_them(tmp_path, instanced):
    stage = new_stage(tmp_path / "character.usda", 0.5)
    add_skinned(stage)
    add_matrix(stage.GetPrimAtPath("/bird/skeleton"), rigid(20, (0, 1, 0), (0.1, 0.2, 0.3)))
    stage.SetDefaultPrim(stage.GetPrimAtPath("/bird"))
    stage.Save()
    world = new_stage(tmp_path / "skin.usda", 0.5)
    bird = world.DefinePrim("/set/bird", "SkelRoot")
    bird.GetPayloads().AddPayload("./character.usda")
    bird.SetInstanceable(instanced)
    add_matrix(UsdGeom.Xform.Define(world, "/set"), rigid(30, (1, 0, 0), (1, 0, 0)))
    world.Save()
    skin = 'usd = "skin.usda"\nprim = "/set/bird/skin"\ntolerance = 10'
    shot = featherfx.read_shot(write_shot(tmp_path, skin))
    surface = shot.skin.parts[0].surface

    baked = Usd.Stage.Open(str(tmp_path / "skin.usda"))
    baked.SetEditTarget(baked.GetSessionLayer())  # the file's own layers are shared
    baked.GetPrimAtPath("/set/bird").SetInstanceable(False)
    UsdSkel.BakeSkinning(UsdSkel.Root(baked.GetPrimAtPath("/set/bird")), Gf.Interval(1, 25))
    mesh = UsdGeom.Mesh(baked.GetPrimAtPath("/set/bird/skin"))
    for code in (1, 25):
        matrix = np.array(mesh.ComputeLocalToWorldTransform(code))
        points = np.asarray(mesh.GetPointsAttr().Get(code)) @ matrix[:3, :3] + matrix[3, :3]
        np.testing.assert_allclose(surface.points(code), 0.5 * points, atol=1e-6)
    # rest is the bind pose, which no frame of the animation shows
    flat = Usd.Stage.Open(str(tmp_path / "skin.usda"))
    skeleton = UsdGeom.Xformable(flat.GetPrimAtPath("/set/bird/skeleton"))
    matrix = np.array(skeleton.ComputeLocalToWorldTransform(1))
    expected = 0.5 * (sheet()[0] @ matrix[:3, :3] + matrix[3, :3])
    np.testing.assert_allclose(surface.rest, expected, atol=1e-6)
    assert np.abs(surface.points(1) - surface.rest).max() > 0.01
    # between the samples the wing passes through its bind pose, bulging by half
    moved = (surface.points(13) - surface.rest) @ np.linalg.inv(0.5 * matrix[:3, :3])
    expected = np.zeros((81, 3))
    expected[[0, 1, 2, 40, 44], 2] = 0.05
    np.testing.assert_allclose(moved, expected, atol=1e-6)


def test_mirrored_scaled_and_left_handed_skins(tmp_path):
    """The right half of a bird as a mirrored instance of the left one behaves as the left one."""
    stage, mesh, _, points = moving_sheet(tmp_path)
    mesh.CreateOrientationAttr("leftHanded")
    for frame in (1, 25):
        bent = points + np.outer(np.sin(3 * points[:, 0]) * (frame - 1) / 24, [0, 0, 0.2])
        mesh.GetPointsAttr().Set(vec(bent), frame)
    plain = stage.ExportToString()
    stage.Save()
    shot = featherfx.read_shot(write_shot(tmp_path, SKIN + "\nsmoothing_radius = 0.05"))
    position, rotation = shot.skin.frames(1.0)

    mirrored = Sdf.Layer.CreateNew(str(tmp_path / "mirrored.usda"))
    mirrored.ImportFromString(plain)
    flipped = Usd.Stage.Open(mirrored)
    add_matrix(flipped.GetPrimAtPath("/bird"), np.diag([2.0, -2.0, 2.0, 1.0]))
    flipped.Save()
    (tmp_path / "other").mkdir()
    write_shot(
        tmp_path / "other",
        SKIN.replace("skin.usda", "../mirrored.usda") + "\nsmoothing_radius = 0.1",
    )
    text = (tmp_path / "other/groom.toml").read_text()
    for old, new in (
        ("-0.15, 0.013, 0", "-0.3, -0.026, 0"),
        ("0.15, 0.017, 0.002", "0.3, -0.034, 0.004"),
        ("1, 0.3, 0.2", "1, -0.3, 0.2"),
    ):
        text = text.replace(old, new)
    (tmp_path / "other/groom.toml").write_text(text + 'side = "left"\n')
    there = featherfx.read_shot(tmp_path / "other/shot.toml")
    position_there, rotation_there = there.skin.frames(1.0)
    np.testing.assert_allclose(position_there, 2 * position * [1, -1, 1], atol=1e-5)
    mirror = np.diag([1.0, -1.0, 1.0])
    np.testing.assert_allclose(rotation_there, mirror @ rotation @ mirror, atol=1e-5)


def test_polygons_holes_and_faces_without_area(tmp_path):
    stage = new_stage(tmp_path / "skin.usda")
    ring = [[np.cos(a), np.sin(a), 0] for a in np.linspace(0, 2 * np.pi, 6, endpoint=False)]
    points = [*ring, [3, 0, 0], [4, 0, 0], [4, 1, 0], [5, 0, 0], [6, 0, 0], [7, 0, 0]]
    indices = [0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11]
    mesh = add_mesh(stage, "/bird/skin", points, [6, 3, 3], indices)
    mesh.CreateHoleIndicesAttr([1])
    stage.Save()
    text = 'name = "g"\n[[feather]]\nid = "f"\nkind = "covert"\nposition = [3.5, 0.2, 0]\n'
    (tmp_path / "g.toml").write_text(text)
    path = write_shot(tmp_path, SKIN + "\ntolerance = 10", groom="g.toml")
    shot = featherfx.read_shot(path)
    # not on the hole at 3.5, nor on the face without area at 5 to 7
    assert shot.skin.roots[0].face == 0
    assert shot.skin.parts[0].binding.distance[0] == pytest.approx(np.hypot(2.5, 0.2))


def test_skin_places_in_texture_space(tmp_path):
    stage, mesh, _, points = moving_sheet(tmp_path)
    st = UsdGeom.PrimvarsAPI(mesh).CreatePrimvar("st", TYPES.TexCoord2fArray, "vertex")
    st.Set([(float(p[0] / 0.4 + 0.5), float(p[1] / 0.4 + 0.5)) for p in points])
    stage.Save()
    scene = new_stage(tmp_path / "groom.usda")
    uv = (TYPES.TexCoord2fArray, [(0.75, 0.25)])
    add_curves(scene, "/c", [lifted(arc(), 0.001)], ids=["f"], skinUV=uv)
    scene.Save()
    path = write_shot(tmp_path, SKIN + "\ntolerance = 1", groom="groom.usda")
    shot = featherfx.read_shot(path)
    root = shot.skin.roots[0]
    np.testing.assert_allclose(root.barycentric @ points[root.points], [0.1, -0.1, 0], atol=1e-6)
    np.testing.assert_allclose(shot.skin.frames(0.0)[0], [[0, 0, 0.001]], atol=1e-7)


def test_feathers_of_several_skins(tmp_path):
    stage, _, _, points = moving_sheet(tmp_path)
    _, counts, quads = sheet()
    other = add_mesh(stage, "/bird/tail", lifted(points, 1), counts, quads)
    other.GetPointsAttr().Set(vec(lifted(points, 1)), 1)
    other.GetPointsAttr().Set(vec(lifted(points, 2)), 25)
    stage.Save()
    scene = new_stage(tmp_path / "groom.usda")
    both = (TYPES.StringArray, ["", "/bird/tail"])
    add_curves(scene, "/c", [arc(), lifted(arc(), 1)], ids=["a", "b"], skinPrim=both)
    scene.Save()
    shot = featherfx.read_shot(write_shot(tmp_path, SKIN, groom="groom.usda"))
    assert [root.path for root in shot.skin.roots] == ["/bird/skin", "/bird/tail"]
    np.testing.assert_allclose(shot.skin.frames(1.0)[0], [[0, 0, 0], [0, 0, 2]], atol=1e-6)


def test_far_roots_warn_with_ids_and_distances(tmp_path):
    stage, _, parent, _ = moving_sheet(tmp_path)
    add_matrix(parent, rigid(0, (0, 0, 1), (0, 0, -0.02)))
    stage.Save()
    with pytest.warns(
        InputWarning, match=r"farther than 0.01 m from /bird/skin: 'covert_05' 0.022"
    ):
        featherfx.read_shot(write_shot(tmp_path, SKIN))


def set_topology(mesh):
    mesh.GetFaceVertexCountsAttr().Set([3], 2)
    mesh.GetFaceVertexIndicesAttr().Set([0, 1, 2], 2)


def collapse(mesh):
    mesh.GetPointsAttr().Set(vec(sheet()[0]), 1)
    mesh.GetPointsAttr().Set(vec(sheet()[0] * [0, 1, 1]), 25)


def lose_transform(mesh):
    op = UsdGeom.Xformable(mesh).AddTranslateOp()
    for code, x in ((1, 0.0), (13, np.nan), (25, 0.0)):
        op.Set((x, 0.0, 0.0), code)


FAULTS = {
    "topology": (set_topology, "faceVertexCounts", "changes at time code 2"),
    "counts": (lambda m: m.GetFaceVertexCountsAttr().Set([4]), "faceVertexIndices", "add up to 4"),
    "sides": (lambda m: m.GetFaceVertexCountsAttr().Set([2, 4]), "face 0 has 2 sides"),
    "range": (lambda m: m.GetFaceVertexIndicesAttr().Set([99] * 256), "99 is out of range"),
    "holes": (lambda m: m.CreateHoleIndicesAttr([64]), "holeIndices", "name face 64 of 64"),
    "points": (
        lambda m: m.GetPointsAttr().Set(vec(np.zeros((3, 3))), 5),
        "3 points at time code 5",
    ),
    "nan": (
        lambda m: m.GetPointsAttr().Set(vec(sheet()[0] * np.nan), 5),
        "not finite at time code 5",
    ),
    "transform": (lose_transform, "transforms are not finite at time code 13"),
    "none": (lambda m: m.GetPointsAttr().Block(), "points", "has no value"),
    "area": (lambda m: m.GetPointsAttr().Set(vec(sheet()[0] * 0)), "no face has any area"),
    "inactive": (lambda m: m.GetPrim().SetActive(False), "is inactive"),
    "short": (
        lambda m: [m.GetPointsAttr().Set(vec(sheet()[0] + k), k) for k in range(1, 11)],
        "has samples from 1 to 10, the shot needs 1 to 25",
    ),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_skins_that_are_refused(tmp_path, fault):
    stage, mesh, _, _ = moving_sheet(tmp_path)
    FAULTS[fault][0](mesh)
    stage.Save()
    with pytest.raises(InputError) as caught:
        featherfx.read_shot(write_shot(tmp_path, SKIN))
    problem = caught.value.problems[0]
    assert problem.source.endswith("shot.toml")
    assert problem.key == ("skin" if fault == "short" else "skin.prim")
    for words in ("/bird/skin", *FAULTS[fault][1:]):
        assert words in problem.message


def test_rest_lies_within_the_samples(tmp_path):
    """A rest pose that is not the first frame is fine; one that is no frame is asked back."""
    stage, mesh, _, points = moving_sheet(tmp_path)
    for code in (1, 25):
        mesh.GetPointsAttr().Set(vec(lifted(points, 0.01 * (code - 1))), code)
    stage.Save()
    for rest, gap in ((13, 0.12), (25, 0.24)):
        with pytest.warns(InputWarning, match=f"'covert_01' {gap}"):
            featherfx.read_shot(write_shot(tmp_path, f"{SKIN}\nrest = {rest}"))
    with pytest.raises(InputError, match="rest: 26 is outside of the samples of /bird/skin"):
        featherfx.read_shot(write_shot(tmp_path, f"{SKIN}\nrest = 26"))
    held = write_shot(tmp_path, f'{SKIN}\nrest = 26\nextrapolation = "hold"\ntolerance = 1')
    assert featherfx.read_shot(held).skin is not None


def test_a_face_that_collapses_under_a_root(tmp_path):
    stage, mesh, _, _ = moving_sheet(tmp_path)
    collapse(mesh)
    stage.Save()
    skin = featherfx.read_shot(write_shot(tmp_path, SKIN)).skin
    skin.frames(0.5)
    with pytest.raises(InputError, match=r"/bird/skin.*no area at time code 25. 'covert_01'"):
        skin.frames(1.0)


def test_shots_with_wrong_skins_say_all(tmp_path):
    stage, *_ = moving_sheet(tmp_path)
    stage.Save()
    more = 'motion = "flap"\n'
    with pytest.raises(InputError) as caught:
        featherfx.read_shot(write_shot(tmp_path, 'usd = "none.usda"\nprim = "/bird"', more=more))
    text = str(caught.value)
    assert "motion: stands beside [skin]" in text
    assert "none.usda: there is no such file" in text
    with pytest.raises(InputError, match=r"/bird is a Xform, no Mesh\. Below it is /bird/skin"):
        featherfx.read_shot(write_shot(tmp_path, 'usd = "skin.usda"\nprim = "/bird"'))
    with pytest.raises(
        InputError, match=r"skin\.prim: no prim /bird/skn .* Below /bird there is skin"
    ):
        featherfx.read_shot(write_shot(tmp_path, 'usd = "skin.usda"\nprim = "/bird/skn"'))
    with pytest.raises(InputError, match=r"skin.prim: missing"):
        featherfx.read_shot(write_shot(tmp_path, 'usd = "skin.usda"'))


def test_a_shot_overrides_its_groom(tmp_path):
    stage, *_ = moving_sheet(tmp_path)
    stage.Save()
    more = 'overrides = { "covert_0[12]" = { length = 0.3 } }\n'
    shot = featherfx.read_shot(write_shot(tmp_path, SKIN, more=more))
    assert [f.kind.length for f in shot.groom.feathers] == [0.3, 0.3, 0.11, 0.11, 0.11]
    plain = featherfx.read_shot(write_shot(tmp_path, SKIN))
    assert plain.groom.feathers[0].kind.length == 0.11
    with pytest.raises(InputError, match=r"shot.toml: overrides.\"emu\": matches no feather id"):
        featherfx.read_shot(write_shot(tmp_path, None, more="overrides = { emu = { roll = 1 } }\n"))


def test_a_shot_may_say_what_to_read_of_a_usd_groom(tmp_path):
    scene = new_stage(tmp_path / "bird.usda")
    add_curves(scene, "/bird/wing", [arc()], kind=None)
    add_curves(scene, "/bird/tail", [arc()])
    scene.Save()
    path = write_shot(tmp_path, None, groom="x")
    path.write_text(
        path.read_text().replace(
            '"x"', '{ usd = "bird.usda", prims = ["/bird/wing"], kind = "covert" }'
        )
    )
    shot = featherfx.read_shot(path)
    assert shot.groom.name == "bird"
    assert [f.id for f in shot.groom.feathers] == ["wing"]
    path.write_text(path.read_text().replace("prims", "prim"))
    with pytest.raises(InputError, match=r"groom.prim: unknown key, did you mean 'prims'"):
        featherfx.read_shot(path)
