"""Motions of birds: smooth, without a kick, acts of several parts, and what an act cannot be."""

from dataclasses import replace

import numpy as np
import pytest
from test_motion import is_rotation, sampled

from featherfx.errors import InputError
from featherfx.shot.motion.joints import skeleton_of
from featherfx.shot.motion.motion import joint_poses, root_motion
from featherfx.shot.read.read import read_shot
from featherfx.shot.roots import NO_RUN_UP, RunUpRoots, run_up_of
from featherfx.shot.types import Motion

BIRD = """
name = "bird"
[[wing]]
id = "right_wing"
type = "sparrow"
shoulder = [0.03, -0.03, 0.03]
fold = 1
mirror = "y"
[[tail]]
id = "tail"
position = [-0.1, 0, -0.02]
direction = [-1, 0, 0]
up = [0, 0, 1]
count = 4
lengths = [0.05]
root_width = 0.02
angles = [9, 90]
"""
SHOT = 'name = "s"\ngroom = "groom.toml"\nframes = [1, 2]\n[motion]\n'


def read(folder, motion):
    (folder / "groom.toml").write_text(BIRD)
    (folder / "shot.toml").write_text(SHOT + motion)
    return read_shot(folder / "shot.toml")


@pytest.fixture(scope="module")
def acts(tmp_path_factory):
    """Shots of a bird with each act."""
    return {name: read(tmp_path_factory.mktemp(name), f'base = "{name}"') for name in ACTS}


ACTS = ("take_off", "landing", "glide", "hover", "shake_off", "preen", "walk")


@pytest.mark.parametrize("name", ACTS)
def test_motions_of_a_bird_are_smooth_and_move_wings_or_tail(acts, name):
    shot = acts[name]
    motion = root_motion(shot)
    own = np.linspace(0.2, 1.2, 200)
    positions, rotations = sampled(motion, own / shot.motion.clock.tempo)
    assert is_rotation(rotations)
    against = np.swapaxes(rotations[:, :1], 2, 3) @ rotations
    assert np.ptp(against, axis=0).max() > 0.05  # not the body alone
    steps = np.diff(positions, axis=0)
    assert np.abs(np.diff(steps, axis=0)).max() < 0.5 * np.abs(steps).max()


@pytest.mark.parametrize("name", ACTS)
def test_motions_of_a_bird_begin_without_a_kick(acts, name):
    """Tips change their speed at first, the run-up included, no faster than later."""
    own = root_motion(acts[name])
    motion = RunUpRoots(own, run_up_of(own, 0.5, 1e-3) or NO_RUN_UP)
    times = np.arange(-60, 160) / 96.0
    positions, rotations = sampled(motion, times)
    tips = positions + 0.05 * rotations[:, :, :, 0]
    change = np.linalg.norm(np.diff(tips, 2, axis=0), axis=2).max(axis=1)
    start = times[1:-1] < 0.1
    assert change[start].max() <= 1.01 * change[~start].max()


@pytest.mark.parametrize("name", ["hover", "walk", "landing"])
def test_motions_that_go_on_are_under_way_at_the_first_frame(acts, name):
    assert run_up_of(root_motion(acts[name]), 0.5, 1e-3) is not None


def test_beside_a_skin_the_body_of_an_act_is_left_to_the_skin(acts):
    shot = acts["glide"]
    skin = root_motion(replace(shot, motion=Motion("hold", {})))
    level, body, *limbs = shot.motion.values["motions"]
    assert (level.kind, body.kind) == ("level", "swing")
    of_limbs = replace(shot, motion=replace(shot.motion, values={"motions": tuple(limbs)}))
    found = root_motion(replace(shot, skin=skin))
    expected = root_motion(replace(of_limbs, skin=skin))
    for own, other in zip(found.frames(0.7), expected.frames(0.7), strict=True):
        np.testing.assert_allclose(own, other, atol=1e-12)
    assert (
        np.abs(found.frames(0.7).positions - root_motion(shot).frames(0.7).positions).max() > 1e-3
    )


@pytest.mark.parametrize(
    ("motion", "message"),
    [
        (
            'kind = "act"\nmotions = [{ base = "flup" }]',
            r"motion.motions\[0\].base: no motion preset 'flup'",
        ),
        ('kind = "act"', "motion.motions: missing"),
        ('base = "glide"\namount = [[0, 3]]', r"motion.amount\[0\]\[1\]: 3 is out of range"),
        ('base = "glide"\namount = [[1, 0], [1, 1]]', r"motion.amount\[1\]\[0\]: 1 s is not after"),
        (
            'kind = "act"\n[[motion.motions]]\nkind = "keys"\n'
            'keyframes = [{ time = 0, joint = "x", position = [0, 0, 0] }]',
            r"motion.motions\[0\].keyframes\[0\].joint: no joint 'x'",
        ),
    ],
)
def test_what_an_act_cannot_be(tmp_path, motion, message):
    with pytest.raises(InputError, match=message):
        read(tmp_path, motion)


def test_a_joint_that_is_not_there_is_told_once(tmp_path):
    keys = ", ".join(f'{{ time = {k}, joint = "nek", rotation = [0, 1, 0] }}' for k in range(5))
    with pytest.raises(InputError, match="'nek' in the groom, did you mean 'neck'") as told:
        read(tmp_path, f'kind = "keys"\nkeyframes = [{keys}]')
    assert len(told.value.problems) == 1


def test_keyframes_of_a_pattern_lead_all_joints_that_it_means(tmp_path):
    def moved(*keys):
        named = (f'{{ time = {t}, joint = "{j}", rotation = [0, {a}, 0] }}' for j, t, a in keys)
        shot = read(tmp_path, f'kind = "keys"\nkeyframes = [{", ".join(named)}]')
        skeleton = skeleton_of(shot.groom)
        return skeleton, joint_poses(shot.motion, shot, skeleton)(0.25).rotations

    both, sides = ("*_shoulder",), ("right_wing_shoulder", "left_wing_shoulder")
    skeleton, found = moved(*((j, t, 40 * t) for j in both for t in (0, 0.5)))
    _, expected = moved(*((j, t, 40 * t) for j in sides for t in (0, 0.5)))
    np.testing.assert_array_equal(found, expected)
    turned = np.abs(found - np.eye(3)).max(axis=(1, 2)) > 0.01
    assert {skeleton.names[k] for k in np.flatnonzero(turned)} == set(sides)
    with pytest.raises(InputError, match=r"0\.5 s has a rotation of this joint already") as told:
        moved((*both, 0.5, 3), (sides[0], 0.5, 4))
    assert len(told.value.problems) == 1


def test_an_act_that_is_part_of_itself_is_refused(tmp_path):
    (tmp_path / "presets" / "motion").mkdir(parents=True)
    (tmp_path / "presets" / "motion" / "ring.toml").write_text('kind = "act"\nmotions = ["ring"]\n')
    (tmp_path / "groom.toml").write_text(BIRD)
    (tmp_path / "shot.toml").write_text(SHOT + 'base = "ring"')
    with pytest.raises(InputError, match="Is one a part of itself"):
        read_shot(tmp_path / "shot.toml", [tmp_path / "presets"])


@pytest.mark.parametrize(("height", "pitch"), [(0.13, 15.0), (0.05, 0.0)])
def test_trunks_steeper_than_an_angle_are_levelled_about_their_shoulders(tmp_path, height, pitch):
    """The root of the tail is 0.13 m behind the shoulders, of which one that rises by 45 degrees
    pitches to 30; where it rises less, nothing moves."""
    tail = BIRD.replace("[-0.1, 0, -0.02]", f"[-0.1, 0, {0.03 - height}]")
    (tmp_path / "groom.toml").write_text(tail)
    (tmp_path / "shot.toml").write_text(f'{SHOT}kind = "level"\ntrunk_angle = 30\nsize = 3')
    shot = read_shot(tmp_path / "shot.toml")
    skeleton = skeleton_of(shot.groom)
    found = joint_poses(shot.motion, shot, skeleton)(0.3)
    turn, way = found.rotations[0], found.displacements[0]
    own = np.array(((-0.1, 0, 0.03 - height), (0.03, 0, 0.03)))
    root, shoulder = own @ turn.T + way
    np.testing.assert_allclose(shoulder, own[1], atol=1e-12)
    ahead, _, up = shoulder - root
    before = np.degrees(np.arctan2(height, 0.13))
    np.testing.assert_allclose(np.degrees(np.arctan2(up, ahead)), before - pitch, atol=1e-9)


@pytest.mark.parametrize(
    ("ahead", "up", "turned"), [(0.1, 0.1, 25.0), (0.1, 0.02, 0.0), (0.01, 0.01, 6.0)]
)
def test_necks_are_stretched_in_flight_short_ones_less(tmp_path, ahead, up, turned):
    """The head keeps its direction. A trunk of 0.139 m lets a neck of 0.014 turn by 0.102 rad."""
    neck = '[[joint]]\nname = "neck"\nposition = [0.05, 0, 0.04]\n'
    head = (
        f'[[joint]]\nname = "head"\nparent = "neck"\nposition = [{0.05 + ahead}, 0, {0.04 + up}]\n'
    )
    (tmp_path / "groom.toml").write_text(BIRD + neck + head)
    (tmp_path / "shot.toml").write_text(f'{SHOT}kind = "level"\ntrunk_angle = 90\nneck_angle = 20')
    shot = read_shot(tmp_path / "shot.toml")
    skeleton = skeleton_of(shot.groom)
    found = skeleton.carriers(joint_poses(shot.motion, shot, skeleton)(0.0))[0]
    neck_turn, head_turn = (found[skeleton.names.index(name)] for name in ("neck", "head"))
    down = np.degrees(np.arctan2(-neck_turn[2, 0], neck_turn[0, 0]))
    assert down == pytest.approx(turned, abs=0.2)
    np.testing.assert_allclose(head_turn, np.eye(3), atol=1e-12)


def test_a_groom_without_a_tail_has_no_trunk_to_level(tmp_path):
    (tmp_path / "groom.toml").write_text(BIRD[: BIRD.index("[[tail]]")])
    (tmp_path / "shot.toml").write_text(f'{SHOT}kind = "level"\ntrunk_angle = 30')
    shot = read_shot(tmp_path / "shot.toml")
    with pytest.raises(InputError, match="lacks shoulders or the joint 'tail'"):
        root_motion(shot)


WING = """name = "b"
[[wing]]
id = "right_wing"
type = { base = "pigeon", bow = 25 }
shoulder = [0.03, -0.03, 0.03]
fold = %d
mirror = "y"
"""


def tips_of(folder, fold, motion, time):
    """(F, 3) m tips of two wings that are folded or open at rest."""
    (folder / "groom.toml").write_text(WING % fold)
    (folder / "shot.toml").write_text(
        f'name = "s"\ngroom = "groom.toml"\nframes = [1, 90]\nmotion = {motion}\n'
    )
    shot = read_shot(folder / "shot.toml")
    frames = root_motion(shot).frames(time)
    lengths = np.array([each.kind.length for each in shot.groom.feathers])
    return frames.positions + lengths[:, None] * frames.rotations[:, :, 0]


OPEN = '{ kind = "fold", folds = [{ time = 0, fold = 0 }] }'
BENT = (
    '{ kind = "flap", wingbeat_frequency = 1, stroke_amplitude = 0, wrist = 15,'
    " elbow = { mean = 10, harmonics = [[5, 0]] } }"
)


def test_a_beat_folds_an_opened_wing_as_one_that_the_groom_has_open(tmp_path):
    """About the hinges that elbow and wrist have by then, in the wing's plane."""
    opened, open_ = (
        tips_of(tmp_path, fold, f'{{ kind = "act", motions = [{parts}] }}', 0.3)
        for fold, parts in ((1, f"{OPEN}, {BENT}"), (0, BENT))
    )
    assert opened == pytest.approx(open_, abs=1e-9)
    flat = tips_of(tmp_path, 0, '"hold"', 0.0)
    assert np.linalg.norm(opened - flat, axis=1).max() > 0.02
    normal = np.linalg.svd(flat[flat[:, 1] < 0] - flat[flat[:, 1] < 0].mean(axis=0))[2][2]
    out = (opened - flat)[flat[:, 1] < 0] @ normal
    assert np.abs(out).max() < 0.15 * np.linalg.norm(opened - flat, axis=1).max()


def test_a_fold_upon_a_fold_takes_its_place(tmp_path):
    one, two, half = (
        tips_of(tmp_path, 1, f'{{ kind = "act", motions = [{parts}] }}', 0.0)
        for parts in (
            '{ kind = "fold", folds = [{ time = 0, fold = 0.5 }] }',
            f'{OPEN}, {{ kind = "fold", folds = [{{ time = 0, fold = 0.5 }}] }}',
            f'{OPEN}, {{ kind = "fold", folds = [{{ time = 0, fold = 1 }}], amount = [[0, 0.5]] }}',
        )
    )
    assert two == pytest.approx(one, abs=1e-9)
    assert half == pytest.approx(one, abs=1e-9)


def test_an_act_takes_over_the_wings_that_it_folds(tmp_path):
    """A take-off that goes over into a glide ends as the glide alone has its wings."""
    act = '{ kind = "act", motions = [{ base = "take_off" }, %s] }'
    glide = '{ base = "glide", start = 1.8, amount = [[0, 0], [0.5, 1]] }'
    span = [
        np.ptp(tips_of(tmp_path, 1, motion, 2.6)[:, 1])
        for motion in (act % glide, '{ base = "glide", start = 1.8 }')
    ]
    assert span[0] == pytest.approx(span[1], rel=0.02)
    assert span[1] > 0.5
