"""Roots that follow a skeleton without a skin."""

import creature
import numpy as np
import pytest
from places import COARSE
from pxr import Gf, UsdSkel, Vt
from scipy.spatial.transform import Rotation
from usdin_scenes import new_stage

import featherfx
from featherfx.baking.entries import scenery_of
from featherfx.errors import InputError

ROOT = "{ position = [0, 0, 0], direction = [-1, 0, 0.1], up = [0, 0, 1] }"


def write_shot(folder, usd, joints, keys="", count=40, frames=(1001, 1024)):
    row = (
        f"name = 'row'\n[[row]]\nid = 'row'\nkind = 'covert'\ncount = {count}\n"
        f"first = {ROOT}\nlast = {ROOT}\nturn_with_path = true\n"
        f"curve = {{ usd = '{usd}', prim = '/creature/skeleton', joints = {joints} }}\n"
    )
    (folder / "groom.toml").write_text(row)
    path = folder / "shot.toml"
    path.write_text(
        f"name = 's'\ngroom = 'groom.toml'\nframes = [{frames[0]}, {frames[1]}]\n"
        f"{COARSE}[skin]\nusd = '{usd}'\nprim = '/creature/skeleton'\n{keys}\n"
    )
    return path


@pytest.fixture(name="skin", scope="module")
def chain_skin(tmp_path_factory):
    folder = tmp_path_factory.mktemp("chain")
    creature.skinned(folder / "creature.usda")
    joints = [f"j{k:02d}" for k in range(creature.JOINTS)]
    return featherfx.read_shot(write_shot(folder, "creature.usda", joints)).skin


def test_a_row_on_joints_turns_as_its_bones_do(skin):
    """Each bone turns as the joint above it; from bone to bone the row passes smoothly."""
    bone = 2.0 * creature.HALF / (creature.JOINTS - 1)
    for frame in (0, 5, 11.5, 23):
        time = frame / creature.RATE
        found = skin.frames(time)
        y = np.linspace(-creature.HALF, creature.HALF, 40)
        turns = found.rotations @ skin.rotations.transpose(0, 2, 1)
        # the joint that turns a bone stands at its beginning
        bend = creature.bend(y - 0.5 * bone, time)
        wanted = Rotation.from_euler("x", bend[:, None]).as_matrix()
        apart = Rotation.from_matrix(turns @ wanted.transpose(0, 2, 1)).magnitude()
        inner = slice(3, -4)
        assert apart[inner].max() < 0.04 * creature.BEND
        share = np.abs(np.diff(bend))[inner]
        steps = Rotation.from_matrix(turns[1:] @ turns[:-1].transpose(0, 2, 1)).magnitude()[inner]
        assert (steps[share > 1e-3] / share[share > 1e-3]).max() < 1.5


def test_a_row_on_joints_stays_on_its_bones(skin):
    """On the line through the joints, whose length the poses keep."""
    length = 2.0 * creature.HALF
    for time in (0.0, 0.3, 0.77):
        places = skin.frames(time).positions
        gaps = np.linalg.norm(np.diff(places, axis=0), axis=1)
        assert gaps == pytest.approx(length / 39, rel=0.01)


def test_roots_on_joints_move_smoothly(skin):
    step = 1e-3
    for frame in (4, 9):
        time = frame / creature.RATE
        at = [skin.frames(time + k * step).positions for k in (-2, -1, 0, 1, 2)]
        before, after = (3 * at[2] - 4 * at[1] + at[0]), (4 * at[3] - 3 * at[2] - at[4])
        assert np.abs(after - before).max() / (2 * step) < 0.1


def write_arm(folder, pose=None, joints=("arm", "arm/hand", "arm/hand/tip", "arm/leg")):
    """An arm of three joints, bent at a right angle, and a leg, in metres."""
    stage = new_stage(folder / "arm.usda")
    UsdSkel.Root.Define(stage, "/creature")
    skeleton = UsdSkel.Skeleton.Define(stage, "/creature/skeleton")
    skeleton.CreateJointsAttr(list(joints))
    places = np.array([(0, 0, 0), (0.2, 0, 0), (0.2, 0.3, 0), (0, 0, -0.4)])[: len(joints)]
    parents = [-1, 0, 1, 0]
    binds = [Gf.Matrix4d().SetTranslate(Gf.Vec3d(*place.tolist())) for place in places]
    steps = [p - (places[parents[k]] if k else 0) for k, p in enumerate(places)]
    skeleton.CreateBindTransformsAttr(binds)
    skeleton.CreateRestTransformsAttr(
        [Gf.Matrix4d().SetTranslate(Gf.Vec3d(*each.tolist())) for each in steps]
    )
    if pose is not None:
        animation = UsdSkel.Animation.Define(stage, "/creature/motion")
        animation.CreateJointsAttr(list(joints))
        animation.CreateScalesAttr(Vt.Vec3hArray([Gf.Vec3h(1)] * len(joints)))
        animation.CreateTranslationsAttr(Vt.Vec3fArray([Gf.Vec3f(*s.tolist()) for s in steps]))
        rotations = animation.CreateRotationsAttr()
        for code in (1, 2):
            quats = [Gf.Quatf(1, 0, 0, 0)] * len(joints)
            for joint, (axis, degrees) in pose.items():
                turned = Gf.Rotation(Gf.Vec3d(*axis), degrees * (code - 1)).GetQuat()
                quats[joint] = Gf.Quatf(turned)
            rotations.Set(Vt.QuatfArray(quats), code)
        UsdSkel.BindingAPI.Apply(skeleton.GetPrim()).CreateAnimationSourceRel().SetTargets(
            [animation.GetPath()]
        )
    stage.Save()
    return stage


def test_roots_follow_a_skeleton_that_turns_as_a_whole_exactly(tmp_path):
    write_arm(tmp_path, {0: ((1, 2, 3), 40.0)})
    path = write_shot(tmp_path, "arm.usda", ["arm", "hand", "tip"], count=9, frames=(1, 2))
    shot = featherfx.read_shot(path)
    assert scenery_of(shot, tmp_path / "cache.usdc", {}) == {}  # nothing of it is drawn
    start, end = shot.skin.frames(0.0), shot.skin.frames(1 / 24)
    axis = np.array([1, 2, 3]) / np.sqrt(14)
    turn = Rotation.from_rotvec(np.radians(40.0) * axis).as_matrix()
    np.testing.assert_allclose(end.positions, start.positions @ turn.T, atol=1e-6)
    np.testing.assert_allclose(end.rotations, turn @ start.rotations, atol=1e-6)


def test_a_bent_elbow_turns_the_hand_and_leaves_the_arm_and_the_leg(tmp_path):
    write_arm(tmp_path, {1: ((0, 0, 1), 30.0)})
    path = write_shot(tmp_path, "arm.usda", ["arm", "hand", "tip"], "", 11, (1, 2))
    leg = "[[feather]]\nid = 'leg'\nkind = 'covert'\nposition = [0.01, 0, -0.2]\n"
    groom = tmp_path / "groom.toml"
    groom.write_text(groom.read_text() + leg)
    skin = featherfx.read_shot(path).skin
    turns = skin.frames(1 / 24).rotations @ skin.rotations.transpose(0, 2, 1)
    angles = dict(
        zip(skin.ids, np.degrees(Rotation.from_matrix(turns).as_rotvec()[:, 2]), strict=True)
    )
    assert angles["leg"] == pytest.approx(0.0, abs=1e-3)
    row = [angles[f"row_{k + 1:02d}"] for k in range(11)]
    # from nothing to the whole turn, without a way back
    assert row[0] == pytest.approx(0.0, abs=0.5)
    assert row[-1] == pytest.approx(30.0, abs=0.5)
    assert (np.diff(row) > -1e-6).all()
    assert np.diff(row).max() < 15.0


def test_a_groom_is_written_in_the_space_of_a_skeleton(tmp_path):
    creature.skinned(tmp_path / "skin.usda")
    groom = tmp_path / "groom.toml"
    head = (
        "name = 'x'\n[skin]\nusd = 'skin.usda'\nprim = '/creature/skeleton'\n"
        "[space]\nof = 'skin'\nleft = '-z'\n"
    )
    feather = "[[feather]]\nid = 'left'\nkind = 'covert'\nmirror = 'z'\n"
    groom.write_text(head + feather + "position = { joint = 'j03', offset = [0, 2, 0] }\n")
    at = creature.HALF * (2 * 3 / (creature.JOINTS - 1) - 1)
    one, other = (each.position for each in featherfx.read_groom(groom).feathers)
    assert one == pytest.approx([0, at, 0.02], abs=1e-6)
    assert other == pytest.approx([0, -at, 0.02], abs=1e-6)
    region = "[[region]]\nid = 'r'\nkind = 'covert'\ncount = 3\nflow = { direction = [1, 0, 0] }\n"
    groom.write_text(head + region)
    with pytest.raises(InputError, match="is no Mesh, on which alone regions grow"):
        featherfx.read_groom(groom)


def test_skeletons_that_cannot_be_followed_are_told(tmp_path):
    stage = write_arm(tmp_path)
    path = write_shot(tmp_path, "arm.usda", ["arm", "hand"], frames=(1, 2))
    collider = (
        "[contact]\nsteps = 8\n[[collider]]\nusd = 'arm.usda'\nprims = ['/creature/skeleton']\n"
    )
    text = path.read_text()
    path.write_text(text + collider)
    with pytest.raises(InputError, match="is no Mesh, nothing can touch it"):
        featherfx.read_shot(path)
    path.write_text(text)
    UsdSkel.Skeleton(stage.GetPrimAtPath("/creature/skeleton")).GetBindTransformsAttr().Clear()
    stage.Save()
    (tmp_path / "groom.toml").write_text(
        "name = 'x'\n[[feather]]\nid = 'a'\nkind = 'covert'\nposition = [0, 0, 0]\n"
    )
    with pytest.raises(InputError, match="has no joints with bind transforms"):
        featherfx.read_shot(path)
