"""Acts that drive the joints of a skin's skeleton: skin, layer and feathers move as one."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from bird_of_cubes import BONES, CUBE, GROOM, WALK, bone_places, define_mesh, write_body
from bird_of_cubes import SHOT as STILL_SHOT
from pxr import Usd, UsdGeom, UsdSkel, Vt
from scipy.spatial.transform import Rotation

import featherfx
from featherfx.algebra.vectors import from_angles
from featherfx.errors import InputError
from featherfx.shot.motion.joint_tracks import find_tracks
from featherfx.shot.motion.motion import root_motion
from featherfx.usd.read.cache import Cache
from featherfx.usd.read.contents import find_scenery

ON_ARM = """
[[feather]]
id = "on_arm"
kind = "contour"
position = [{}, {}, {}]
direction = [-1, 0, 0.2]
up = [0, 0, 1]
"""
FLEXED = (20.0, 0.0, 35.0)
DRIVEN = f"""
[[collider]]
usd = "body.usda"
prims = ["/bird/body"]
[motion]
kind = "act"
body = "act"
[motion.joints]
right_wing_shoulder = "arm"
right_wing_elbow = "root/arm/fore"
right_wing_wrist = "hand"
[[motion.motions]]
kind = "keys"
keyframes = [
  {{ time = 0, joint = "right_wing_shoulder", rotation = [0, 0, 0] }},
  {{ time = 0.25, joint = "right_wing_shoulder", rotation = {list(FLEXED)} }},
]
"""
SHOT = STILL_SHOT.replace('\n[motion]\nkind = "act"\nbody = "act"\n', DRIVEN)
UP, UNIT = "Y", 0.01


def write_bird(folder):
    """A groom, and a body that walks by its skeleton; return its points at rest."""
    (folder / "groom.toml").write_text(GROOM)
    bones = bone_places(folder)
    (folder / "groom.toml").write_text(GROOM + ON_ARM.format(*(bones[0] + (0.0, 0.0, 0.012))))
    return write_body(folder / "body.usda", "skeleton", UP, UNIT, bones)


@pytest.fixture
def shot(tmp_path):
    (tmp_path / "shot.toml").write_text(SHOT)
    return tmp_path / "shot.toml"


def skinned(path, code):
    """(V, 3) m of the body of a layer, by USD's own skinning."""
    stage = Usd.Stage.Open(str(path))
    cache, root = UsdSkel.Cache(), UsdSkel.Root(stage.GetPrimAtPath("/bird"))
    cache.Populate(root, Usd.PrimDefaultPredicate)
    mesh = UsdGeom.Mesh(stage.GetPrimAtPath("/bird/body"))
    skeleton = cache.GetSkelQuery(UsdSkel.Skeleton(stage.GetPrimAtPath("/bird/skeleton")))
    points = Vt.Vec3fArray(mesh.GetPointsAttr().Get())
    transforms = skeleton.ComputeSkinningTransforms(code)
    assert cache.GetSkinningQuery(mesh.GetPrim()).ComputeSkinnedPoints(transforms, points, code)
    matrix = np.array(UsdGeom.Xformable(root).ComputeLocalToWorldTransform(code))
    found = np.array(points) @ matrix[:3, :3] + matrix[3, :3]
    return UNIT * found[:, [0, 2, 1]] * (1, -1, 1)


def rigid(before, after):
    """Turn and way that take points (N, 3) to others."""
    middle, other = before.mean(axis=0), after.mean(axis=0)
    left, _, right = np.linalg.svd((before - middle).T @ (after - other))
    turn = (left @ np.diag((1, 1, np.linalg.det(left @ right))) @ right).T
    return turn, other - turn @ middle


@pytest.mark.parametrize("body", ["act", "skin"])
def test_skin_layer_and_feathers_move_as_one(shot, tmp_path, body):
    rest = write_bird(tmp_path)
    given = (tmp_path / "body.usda").read_bytes()
    shot.write_text(SHOT.replace('body = "act"', f'body = "{body}"'))
    read = featherfx.read_shot(shot)
    cache = featherfx.bake(read, tmp_path / "out.usdc", subframes=2)
    assert featherfx.check(cache.path) == []
    assert (tmp_path / "body.usda").read_bytes() == given
    layer, motion = tmp_path / "out.body.usda", root_motion(read)
    bare_shot = replace(read, skin=None, surfaces=None)
    bare, tracks = root_motion(bare_shot), find_tracks(bare_shot)
    for code in (1.0, 4.5, 7.0):
        points = skinned(layer, code).reshape(5, 8, 3)
        (drawn,) = find_scenery(Cache(cache.path).scenery, cache.path, ["skin"], "drawn")
        assert drawn.scene.path == layer
        np.testing.assert_allclose(drawn.points(code).reshape(5, 8, 3), points, atol=1e-6)
        carriers = [rigid(*each) for each in zip(rest.reshape(5, 8, 3), points, strict=True)]
        time = (code - 1.0) / 24.0
        np.testing.assert_allclose(
            read.colliders[0].points(time).reshape(5, 8, 3), points, atol=1e-6
        )
        found, alone = motion.frames(time), bare.frames(time)
        pose = tracks.rotations[round(8 * (code - 1))], tracks.positions[round(8 * (code - 1))]
        turn, way = pose[0][0], pose[1][0]
        # from where the act has the groom to where it has a body that has walked on
        back = np.eye(3) if body == "act" else turn.T
        walked = turn @ WALK if body == "act" else WALK * code - turn.T @ way
        for bone, name in enumerate(("", *BONES)):
            joint = tracks.names.index(name)
            np.testing.assert_allclose(carriers[bone][0], back @ pose[0][joint], atol=1e-5)
            there = back @ pose[1][joint] + walked
            np.testing.assert_allclose(points[bone].mean(axis=0), there, atol=1e-6)
        for k, feather in enumerate(read.groom.feathers):
            if feather.id.startswith("right"):
                place, frame = back @ alone.positions[k] + walked, back @ alone.rotations[k]
            elif feather.id in ("breast", "on_arm"):
                carried, shift = carriers[("breast", "on_arm").index(feather.id)]
                place, frame = carried @ feather.position + shift, carried @ feather.rotation
            else:
                continue
            np.testing.assert_allclose(found.positions[k], place, atol=2e-6)
            np.testing.assert_allclose(found.rotations[k], frame, atol=2e-5)
    assert np.linalg.norm(carriers[1][0] - carriers[0][0]) > 0.3


def test_a_wing_goes_with_its_body_where_the_skin_at_its_shoulder_bends(shot, tmp_path):
    """A neck drives the cube that the wing's first feathers stand on."""
    write_bird(tmp_path)
    wings = SHOT[SHOT.index("right_wing_shoulder =") : SHOT.index("[[motion.motions]]")]
    bent = SHOT.replace(wings, 'neck = "arm"\n').replace('"right_wing_shoulder"', '"neck"')
    shot.write_text(bent)
    read = featherfx.read_shot(shot)
    time, wing = 0.125, [each.turning is not None for each in read.groom.feathers]
    bare = replace(read, skin=None, surfaces=None)
    found, alone = (root_motion(each).frames(time) for each in (read, bare))
    turn = find_tracks(bare).rotations[24, 0]
    walked = alone.positions + turn @ WALK
    np.testing.assert_allclose(found.positions[wing], walked[wing], atol=2e-6)
    np.testing.assert_allclose(found.rotations[wing], alone.rotations[wing], atol=2e-5)
    on_arm = [each.id for each in read.groom.feathers].index("on_arm")
    assert np.abs(found.rotations[on_arm] - alone.rotations[on_arm]).max() > 0.1


@pytest.mark.parametrize(
    ("before", "after", "message"),
    [
        ('= "hand"', '= "hnd"', r"joints.right_wing_wrist: no joint 'hnd' in /bird/skeleton.*hand"),
        (
            "right_wing_wrist =",
            "right_wing_wrst =",
            r"no joint 'right_wing_wrst' in the groom.*right_wing_wrist",
        ),
        (
            '= "hand"',
            '= "arm"',
            r"right_wing_wrist: 'arm' is driven by 'right_wing_shoulder' already",
        ),
        (
            'prim = "/bird/body"',
            'prim = "/bird/still"',
            r"motion.joints: drives the skeleton of a \[skin\]",
        ),
        ('prim = "/bird/body"', 'prim = "/bird/bdy"', "skin.*bdy"),
    ],
)
def test_a_map_of_joints_that_cannot_be(shot, tmp_path, before, after, message):
    write_bird(tmp_path)
    stage = Usd.Stage.Open(str(tmp_path / "body.usda"))
    define_mesh(stage, "/bird/still", CUBE, UP, UNIT)
    stage.Save()
    shot.write_text(SHOT.replace(before, after))
    with pytest.raises(InputError, match=message) as told:
        featherfx.read_shot(shot)
    assert len(told.value.problems) == 1


STEADY = """steady_head = SHARE
[motion.joints]
neck = "arm"
head = "root/arm/fore"
left_leg = "tip"
[[motion.motions]]
kind = "keys"
keyframes = [
  { time = 0, rotation = [0, -40, 0], position = [0.3, 0, 0] },
  { time = 0, joint = "left_leg", rotation = [0, 70, 0] },
]
[[motion.motions]]
base = "pigeon_beat"
start = -1
wingbeat_frequency = 4
heave = HEAVE
pitch = PITCH
"""


@pytest.mark.parametrize("share", [1.0, 0.5])
def test_a_head_stays_level_and_does_not_heave(tmp_path, share, monkeypatch):
    """Against the same act without heave and pitch of the beats; legs stand as keyframes say."""
    write_bird(tmp_path)
    head = SHOT.partition("[motion.joints]")[0]
    text = head + STEADY.replace("SHARE", str(share))
    monkeypatch.setattr("featherfx.shot.motion.act._FARTHEST", 10.0)  # a long neck
    found = {}
    whole, part = (
        text.replace("steady", "size = 0.5\nsteady"),
        text.replace("start", "size = 0.5\nstart"),
    )
    part = part.replace('kind = "keys"', 'kind = "keys"\nsize = 0.5')
    for name, given, heave, pitch in (
        ("own", text, 1, 8),
        ("calm", text, 0, 0),
        ("small", whole, 1, 8),
        ("small parts", part, 1, 8),
    ):
        (tmp_path / "shot.toml").write_text(
            given.replace("HEAVE", str(heave)).replace("PITCH", str(pitch))
        )
        found[name] = find_tracks(featherfx.read_shot(tmp_path / "shot.toml"))
    own, calm = found["own"], found["calm"]
    # an act of half the size has a head on its neck as one of parts of half the size
    for small, parts in zip(found["small"].positions, found["small parts"].positions, strict=True):
        np.testing.assert_allclose(small, parts, atol=1e-12)
    joint = own.names.index("head")
    level = Rotation.from_matrix(own.rotations[:, joint]).magnitude()
    body = Rotation.from_matrix(own.rotations[:, 0]).magnitude()
    assert np.ptp(np.degrees(body)) == pytest.approx(8.0, abs=0.1)
    np.testing.assert_allclose(level, (1.0 - share) * body, atol=1e-6)
    heave = np.ptp(own.positions - calm.positions, axis=0)[:, 2]
    assert heave[0] > 0.01
    assert heave[joint] < (1.0 - share) * 0.05 + 1e-9
    leg = own.rotations[:, own.names.index("left_leg")]
    turned = own.rotations[:, 0].swapaxes(1, 2) @ leg
    np.testing.assert_allclose(
        turned, np.tile(from_angles((0, 70, 0), "xyz"), (49, 1, 1)), atol=1e-9
    )


def test_a_short_neck_takes_its_head_along(tmp_path):
    """A twentieth of the neck's length and, by a hyperbolic tangent, as much again: a share of the
    way that is the same throughout a beat, so that heads are not thrown."""
    write_bird(tmp_path)
    text = SHOT.partition("[motion.joints]")[0] + STEADY.replace("SHARE", "1")
    text = text.replace("[0, -40, 0]", "[0, 0, 0]").replace("PITCH", "0")
    (tmp_path / "calm.toml").write_text(text.replace("HEAVE", "0"))
    (tmp_path / "shot.toml").write_text(text.replace("HEAVE", "1"))
    calm, own = (find_tracks(featherfx.read_shot(tmp_path / f"{k}.toml")) for k in ("calm", "shot"))
    neck, head = (own.names.index(name) for name in ("neck", "head"))
    free = 0.05 * np.linalg.norm(calm.positions[0, head] - calm.positions[0, neck])
    body, found = ((own.positions - calm.positions)[:, k, 2] for k in (0, head))
    most = 0.5 * np.ptp(body)
    way = free * (1.0 + np.tanh(most / free - 1.0))
    assert most > 2.0 * free
    np.testing.assert_allclose(found, (1.0 - way / most) * body, rtol=2e-3, atol=1e-9)


STANDING = """planted_feet = [[0.1, 1], [0.2, SHARE]]
[motion.joints]
left_leg = "arm"
left_tarsus = "root/arm/fore"
left_foot = "hand"
[[motion.motions]]
kind = "keys"
keyframes = [
  { time = 0, rotation = [0, 0, 0], position = [0, 0, 0] },
  { time = 0, joint = "left_leg", rotation = [0, 25, 0] },
  { time = 0.1, rotation = [0, 6, 0], position = [0.003, -0.01, -0.004] },
  { time = 0.25, rotation = [0, -20, 0], position = [0, 0.05, 1] },
]
"""


def test_feet_stand_as_far_as_legs_reach_and_then_leave(tmp_path):
    write_bird(tmp_path)
    text, found = SHOT.partition("[motion.joints]")[0] + STANDING, {}
    for name, given in (
        ("stays", text.replace("SHARE", "1")),
        ("leaves", text.replace("SHARE", "0")),
        ("never", text.replace("[[0.1, 1], [0.2, SHARE]]", "0")),
    ):
        (tmp_path / "shot.toml").write_text(given)
        found[name] = find_tracks(featherfx.read_shot(tmp_path / "shot.toml"))
    stays, leaves, never = found.values()
    hip, heel, foot = (stays.names.index(f"left_{each}") for each in ("leg", "tarsus", "foot"))
    near, late = stays.times <= 0.1, stays.times >= 0.2
    bones = np.linalg.norm(np.diff(never.positions[0, [hip, heel, foot]], axis=0), axis=1)
    for each in (stays, leaves):
        # legs stand as at rest at first, whatever keyframes say, bent to the same side
        assert np.abs(each.rotations[0, [hip, heel, foot]] - np.eye(3)).max() < 1e-9
        places = each.positions[near, foot]
        np.testing.assert_allclose(places, np.tile(places[0], (len(places), 1)), atol=1e-9)
        np.testing.assert_allclose(
            each.rotations[near, foot], np.tile(np.eye(3), (near.sum(), 1, 1)), atol=1e-9
        )
        own = np.linalg.norm(np.diff(each.positions[:, [hip, heel, foot]], axis=1), axis=2)
        np.testing.assert_allclose(own, np.tile(bones, (len(own), 1)), atol=1e-9)
    assert np.linalg.norm(never.positions[near, foot] - places[0], axis=1).max() > 0.003
    np.testing.assert_allclose(leaves.positions[late], never.positions[late], atol=1e-12)
    way = places[0] - stays.positions[late, hip]
    reach = stays.positions[late, foot] - stays.positions[late, hip]
    size = np.linalg.norm(reach, axis=1)
    rest, away = (
        np.linalg.norm(stays.positions[0, foot] - stays.positions[0, hip]),
        np.linalg.norm(way, axis=1),
    )
    spare = bones.sum() - rest
    np.testing.assert_allclose(size, rest + spare * (1.0 - np.exp((rest - away) / spare)))
    assert rest < size[0] < bones.sum()
    cosine = np.einsum("tk,tk->t", way, reach) / away / size
    np.testing.assert_allclose(cosine, np.ones(late.sum()), atol=1e-9)


def test_shares_of_planted_feet_are_in_order(tmp_path):
    write_bird(tmp_path)
    text = SHOT.partition("[motion.joints]")[0] + STANDING.replace("[0.2, SHARE]", "[0.05, 1]")
    (tmp_path / "shot.toml").write_text(text)
    with pytest.raises(InputError, match=r"planted_feet\[1\].*0.05 s is not after 0.1 s") as told:
        featherfx.read_shot(tmp_path / "shot.toml")
    assert len(told.value.problems) == 1
