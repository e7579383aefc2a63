"""Wings that fold while a skin carries them."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from pxr import Gf, Usd, UsdGeom, UsdSkel, Vt
from usd_meshes import SQUARE, define_mesh

import featherfx
from featherfx.algebra.vectors import from_rotation_vector
from featherfx.errors import InputError
from featherfx.groom.read.read import read_groom
from featherfx.shot.motion.flap import folding
from featherfx.shot.motion.joints import joint_roots, roots_at_rest, skeleton_of
from featherfx.shot.motion.limbs import carried, limbs_of, moving_limbs
from featherfx.shot.motion.motion import root_motion
from featherfx.shot.roots import RootFrames

GROOM = """
name = "bird"
[[wing]]
id = "right_wing"
type = { base = "pigeon", bow = 25 }
shoulder = [0.03, -0.03, 0.03]
fold = 1
mirror = "y"
[[feather]]
id = "breast"
kind = "contour"
position = [0.1, 0, 0]
direction = [-1, 0, 0]
up = [0, 0, 1]
"""
BODY = """
[[joint]]
name = "body"
position = [0, 0, 0]
"""
TAIL = """
[[tail]]
id = "tail"
position = [-0.1, 0, 0]
direction = [-1, 0, 0]
up = [0, 0, 1]
count = 4
lengths = [0.05]
root_width = 0.01
"""
KEYS = [{"time": 0.0, "fold": 1.0}, {"time": 1.0, "fold": 0.2}]


class Skin:
    """Carries all roots rigidly."""

    def __init__(self, rest):
        self.rest = rest

    def frames(self, time):
        turn = from_rotation_vector(time * np.array([0.2, -0.5, 0.8]))
        return RootFrames(
            self.rest.positions @ turn.T + [0.0, 0.0, time], turn @ self.rest.rotations
        )


def test_limbs_fold_on_the_skin_that_carries_them(tmp_path):
    path = tmp_path / "groom.toml"
    path.write_text(GROOM)
    groom = read_groom(path)
    joints = joint_roots(
        groom, skeleton_of(groom), folding(groom, {"joints": "*", "folds": KEYS}, "shot.toml")
    )
    skin = Skin(roots_at_rest(groom))
    roots = carried(groom, skin, joints)
    wings = np.array([feather.turning is not None for feather in groom.feathers])
    for time in (0.0, 0.4, 1.0):
        # a skin that moves rigidly carries the whole bird, as its joints pose it
        expected = Skin(joints.frames(time)).frames(time)
        found, on_skin = roots.frames(time), skin.frames(time)
        for name in ("positions", "rotations"):
            np.testing.assert_allclose(
                getattr(found, name)[wings], getattr(expected, name)[wings], atol=1e-12
            )
            np.testing.assert_array_equal(
                getattr(found, name)[~wings], getattr(on_skin, name)[~wings]
            )
    assert np.abs(roots.frames(1.0).positions - skin.frames(1.0).positions).max() > 0.05


def test_each_feather_is_of_a_limb_or_of_the_skin(tmp_path):
    path = tmp_path / "groom.toml"
    path.write_text(GROOM)
    groom = read_groom(path)
    found = {each.id: int(k) for each, k in zip(groom.feathers, limbs_of(groom), strict=True)}
    sides = {id.split("_")[0]: number for id, number in found.items()}
    assert sides["breast"] == 0
    assert sorted([sides["right"], sides["left"]]) == [1, 2]
    assert all(number == sides[id.split("_")[0]] for id, number in found.items())


@pytest.mark.parametrize("carried_by", ["", 'joint = "body"\n'])
def test_wings_leave_what_they_lie_on_and_tails_do_not(tmp_path, carried_by):
    wing = GROOM.replace("fold = 1\n", f"fold = 1\n{carried_by}")
    (tmp_path / "groom.toml").write_text(wing + BODY + TAIL + carried_by)
    (tmp_path / "shot.toml").write_text(
        'name = "s"\ngroom = "groom.toml"\nframes = [1, 2]\nmotion = "fold"\n'
    )
    shot = featherfx.read_shot(tmp_path / "shot.toml")
    leaves = moving_limbs(replace(shot, skin=Skin(roots_at_rest(shot.groom)))) > 0
    for each, own in zip(shot.groom.feathers, leaves, strict=True):
        assert own == ("wing" in each.id), each.id
    right, left = (
        {
            int(k)
            for each, k in zip(shot.groom.feathers, limbs_of(shot.groom), strict=True)
            if side in each.id
        }
        for side in ("right_wing", "left_wing")
    )
    assert len(right) == len(left) == 1
    assert right != left
    assert not moving_limbs(shot).any()


def test_a_bowed_wing_opens_to_where_the_groom_has_it(tmp_path):
    path = tmp_path / "groom.toml"
    path.write_text(GROOM)
    folded = read_groom(path)
    path.write_text(GROOM.replace("fold = 1", "fold = 0.2"))
    opened = roots_at_rest(read_groom(path))
    poses = folding(folded, {"joints": "*", "folds": KEYS}, "shot.toml")
    found = joint_roots(folded, skeleton_of(folded), poses).frames(1.0)
    np.testing.assert_allclose(found.positions, opened.positions, atol=1e-9)
    np.testing.assert_allclose(found.rotations, opened.rotations, atol=1e-9)


JOINTS = ("arm", "arm/fore", "arm/fore/hand", "arm/fore/hand/tip")
PLACES = np.array(
    [(0.03, -0.03, 0.03), (-0.01, -0.05, 0.03), (0.03, -0.09, 0.03), (0, -0.14, 0.03)]
)
FOLDING = (0.0, 25.0, -55.0)  # deg, of elbow and wrist about z, and the arm does not move


def write_skeleton(path):
    """The bones of a right wing, which fold from time code 1 to 2."""
    stage = Usd.Stage.CreateNew(str(path))
    UsdGeom.SetStageMetersPerUnit(stage, 1.0)
    UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.z)
    UsdSkel.Root.Define(stage, "/bird")
    skeleton = UsdSkel.Skeleton.Define(stage, "/bird/skeleton")
    skeleton.CreateJointsAttr(JOINTS)
    steps = np.diff(PLACES, axis=0, prepend=0.0).tolist()
    for create, places in (
        (skeleton.CreateBindTransformsAttr, PLACES.tolist()),
        (skeleton.CreateRestTransformsAttr, steps),
    ):
        create([Gf.Matrix4d().SetTranslate(Gf.Vec3d(*place)) for place in places])
    animation = UsdSkel.Animation.Define(stage, "/bird/motion")
    animation.CreateJointsAttr(JOINTS)
    animation.CreateScalesAttr(Vt.Vec3hArray([Gf.Vec3h(1)] * 4))
    animation.CreateTranslationsAttr(Vt.Vec3fArray([Gf.Vec3f(*step) for step in steps]))
    for code in (1, 2):
        turns = [Gf.Rotation(Gf.Vec3d(0, 0, 1), a * (code - 1)) for a in (*FOLDING, 0.0)]
        animation.CreateRotationsAttr().Set([Gf.Quatf(each.GetQuat()) for each in turns], code)
    UsdSkel.BindingAPI.Apply(skeleton.GetPrim()).CreateAnimationSourceRel().SetTargets(
        [animation.GetPath()]
    )
    stage.Save()


def add_body(path):
    """A square below the wing, which the arm carries, so that it does not move."""
    stage = Usd.Stage.Open(str(path))
    body = define_mesh(stage, "/bird/body", SQUARE * (0.1, 0.15, 0.0) + (0.0, -0.05, 0.025))
    binding = UsdSkel.BindingAPI.Apply(body.GetPrim())
    binding.CreateSkeletonRel().SetTargets(["/bird/skeleton"])
    binding.CreateJointIndicesPrimvar(True, 1).Set([0])
    binding.CreateJointWeightsPrimvar(True, 1).Set([1.0])
    stage.Save()


@pytest.mark.parametrize("skin", ["/bird/skeleton", "/bird/body"])
def test_a_skeleton_folds_a_wing_to_where_landmarks_have_it(tmp_path, skin):
    write_skeleton(tmp_path / "bones.usda")
    add_body(tmp_path / "bones.usda")
    names = ("shoulder", "elbow", "wrist", "tip")
    of_joints = (
        f'{name} = {{ joint = "{path}" }}' for name, path in zip(names, JOINTS, strict=True)
    )
    wing = 'name = "w"\n[[wing]]\nid = "right_wing"\ntype = { base = "pigeon", bow = 25 }\n'
    own = 'skeleton = "/bird/skeleton"' if skin == "/bird/body" else ""
    skin = f'[skin]\nusd = "bones.usda"\nprim = "{skin}"\n'
    (tmp_path / "groom.toml").write_text("\n".join([wing, own, *of_joints, skin]))
    (tmp_path / "shot.toml").write_text(
        'name = "s"\ngroom = "groom.toml"\nframes = [1, 2]\n' + skin
    )
    shot = featherfx.read_shot(tmp_path / "shot.toml")
    turn, places = np.eye(3), [PLACES[0]]
    for angle, step in zip(np.radians(FOLDING), np.diff(PLACES, axis=0), strict=True):
        turn = turn @ from_rotation_vector(np.array([0.0, 0.0, angle]))
        places.append(places[-1] + turn @ step)
    typed = (f"{name} = {place.tolist()}" for name, place in zip(names, places, strict=True))
    (tmp_path / "groom.toml").write_text("\n".join([wing, *typed]))
    folded = roots_at_rest(read_groom(tmp_path / "groom.toml"))
    found = root_motion(shot).frames(1 / 24)
    assert np.abs(found.positions - roots_at_rest(shot.groom).positions).max() > 0.02
    np.testing.assert_allclose(found.positions, folded.positions, atol=1e-6)
    np.testing.assert_allclose(found.rotations, folded.rotations, atol=1e-5)
    assert moving_limbs(shot).all()
    # a skin without a skeleton carries wings as they lie
    (part,) = shot.skin.parts
    boneless = replace(part, surface=SimpleNamespace(bones=None))
    assert not moving_limbs(replace(shot, skin=replace(shot.skin, parts=(boneless,)))).any()


def test_a_skeleton_with_one_wing_does_not_carry_two(tmp_path):
    """Both wings went with the bones of the right one."""
    write_skeleton(tmp_path / "bones.usda")
    names = ("shoulder", "elbow", "wrist", "tip")
    joints = (f'{name} = {{ joint = "{path}" }}' for name, path in zip(names, JOINTS, strict=True))
    skin = '[skin]\nusd = "bones.usda"\nprim = "/bird/skeleton"\n'
    wing = 'name = "w"\n[[wing]]\nid = "right_wing"\ntype = "pigeon"\nmirror = "y"'
    (tmp_path / "groom.toml").write_text("\n".join([wing, *joints, skin]))
    (tmp_path / "shot.toml").write_text(
        'name = "s"\ngroom = "groom.toml"\nframes = [1, 2]\n' + skin
    )
    with pytest.raises(InputError, match="has the skeleton one wing only"):
        root_motion(featherfx.read_shot(tmp_path / "shot.toml"))
