"""Wing beats: shares, ratios and planes that are asked for are measured, modes blend, sources."""

import json
import re
import warnings
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from commands import invoke
from test_bird_motions import BIRD, SHOT, read

from featherfx.algebra.vectors import about_x, rotation_vectors, unit
from featherfx.errors import InputError, InputWarning
from featherfx.shot.motion.beat import wing_axes
from featherfx.shot.motion.joint_tracks import find_tracks
from featherfx.shot.motion.joints import joint_roots, opened_poses, skeleton_of
from featherfx.shot.motion.motion import joint_poses, root_motion
from featherfx.shot.read.read import read_shot

# a beat under way, with both wings open
BEAT = """kind = "act"
[[motion.motions]]
kind = "fold"
folds = [{{ time = 0, fold = 0 }}]
[[motion.motions]]
base = "pigeon_beat"
start = -1
{}
"""


def tracks_of(folder, motion, frames=7, rate=24):
    shot = read(folder, motion)
    return shot, find_tracks(replace(shot, last_frame=frames, frames_per_second=float(rate)))


@pytest.mark.parametrize(("share", "ratio"), [(0.35, 0.8), (0.5, 0.62), (0.66, 0.7)])
def test_downstroke_and_span_ratio_are_what_is_asked_for(tmp_path, share, ratio):
    keys = f"wingbeat_frequency = 4\ndownstroke = {share}\nspan_ratio = {ratio}\ntip_reversal = 20"
    _, tracks = tracks_of(tmp_path, BEAT.format(keys), 25, 48)
    for wing in tracks.wings.values():
        assert wing.downstroke == pytest.approx(share, abs=0.02)
        # a beat takes 12 frames of 8 samples
        middle = [round(8 * 12 * each) for each in (share / 2.0, share + (1.0 - share) / 2.0)]
        down, up = (wing.span_ratio[96 + each] for each in middle)
        assert up / down == pytest.approx(ratio, abs=0.015)
        assert np.ptp(np.degrees(wing.elevation)) > 65.0


@pytest.mark.parametrize("lean", [-20.0, 35.0, 80.0])
def test_the_arm_beats_in_the_plane_of_the_stroke(tmp_path, lean):
    keys = f"stroke_plane = {lean}\nsweep = 0\ntwist = 0"
    _, tracks = tracks_of(tmp_path, BEAT.format(keys))
    wing = tracks.wings["left"]
    arm = np.stack(
        [
            -np.sin(wing.sweep),
            np.cos(wing.sweep) * np.cos(wing.elevation),
            np.cos(wing.sweep) * np.sin(wing.elevation),
        ]
    )
    normal = np.array((np.cos(np.radians(lean)), 0.0, np.sin(np.radians(lean))))
    np.testing.assert_allclose(normal @ arm, 0.0, atol=1e-9)
    stroke = np.degrees(np.arctan2(arm[2] * normal[0] - arm[0] * normal[2], arm[1]))
    assert np.ptp(stroke) == pytest.approx(70.0, abs=0.5)


def test_in_a_turn_to_the_left_the_left_wing_is_swept_back_and_lowered(tmp_path):
    _, straight = tracks_of(tmp_path, BEAT.format(""))
    _, turning = tracks_of(tmp_path, BEAT.format("turn = 6"))
    for name, sign in (("left", 1.0), ("right", -1.0)):
        for angle in ("sweep", "twist"):
            change = getattr(turning.wings[name], angle) - getattr(straight.wings[name], angle)
            np.testing.assert_allclose(np.degrees(change), sign * 6.0, atol=1e-6)


def test_the_hand_turns_over_in_the_upstroke_alone(tmp_path):
    """About its own length: fold and reach stay."""
    _, plain = tracks_of(tmp_path, BEAT.format("tip_reversal = 0\nspan_ratio = 0.8"))
    _, turned = tracks_of(tmp_path, BEAT.format("tip_reversal = 50\nspan_ratio = 0.8"))
    hand = plain.names.index("left_wing_wrist")
    relative = plain.rotations[:, hand].swapaxes(1, 2) @ turned.rotations[:, hand]
    cosine = np.clip((np.trace(relative, axis1=1, axis2=2) - 1.0) / 2.0, -1.0, 1.0)
    angle = np.degrees(np.arccos(cosine))
    falls = np.gradient(plain.wings["left"].elevation) < 0.0
    assert angle[falls].max() < 1.0
    assert angle.max() == pytest.approx(50.0, abs=0.5)
    np.testing.assert_array_equal(plain.wings["left"].wrist > 0.0, turned.wings["left"].wrist > 0.0)


def test_modes_follow_each_other_without_a_jump(tmp_path):
    """Frequency, stroke and all others change in the middle of beats."""
    keys = """wingbeat_frequency = [[0, 9], [0.5, 4]]
stroke_amplitude = [[0, 130], [0.5, 60]]
downstroke = [[0, 0.62], [0.5, 0.45]]
stroke_plane = [[0, 0], [0.5, 40]]
span_ratio = [[0, 0.62], [0.5, 0.9]]
tip_reversal = [[0, 50], [0.5, 0]]"""
    shot = read(tmp_path, BEAT.format(keys))
    poses = joint_poses(shot.motion, shot, skeleton_of(shot.groom))
    found = [poses(time) for time in np.arange(0.0, 0.6, 4e-4)]
    for values in (np.stack([p.rotations for p in found]), np.stack([p.bends for p in found])):
        # of a motion without a jump, steps over half the time are half as long
        whole, half = (np.abs(np.diff(each, axis=0)).max() for each in (values[::2], values))
        assert whole / half == pytest.approx(2.0, rel=0.02)


@pytest.mark.parametrize(("share", "tempo", "size"), [(0.4, 1, 1), (0.55, 1, 1), (0.55, 2.2, 0.4)])
def test_a_body_heaves_under_lift_that_bears_its_weight(tmp_path, share, tempo, size):
    """Its acceleration is that of a half sine in the downstroke, less gravity; both means are 0.

    So it is of a bird of another size, whose time goes faster.
    """
    rate = 5.0 * tempo
    keys = f"heave = 1\nwingbeat_frequency = 5\ndownstroke = {share}"
    clock = f"tempo = {tempo}\nsize = {size}\n"
    shot = read(tmp_path, BEAT.replace("[[", clock + "[[", 1).format(keys))
    poses = joint_poses(shot.motion, shot, skeleton_of(shot.groom))
    count = 400
    step = 1.0 / (rate * count)
    places = np.stack([poses(k * step).displacements[0] for k in range(-1, count + 1)])
    assert np.abs(places[:, :2]).max() == 0.0
    found = np.diff(places[:, 2], 2) / step**2
    time = np.arange(count) / count
    lift = np.where(time < share, 0.5 * np.pi / share * np.sin(np.pi * time / share), 0.0)
    # where lift begins and ends, second differences err by a sixth of a step of its rate
    err = 1.01 * 9.81 * 0.5 * (np.pi / share) ** 2 / count / 6.0
    np.testing.assert_allclose(found, 9.81 * (lift - 1.0), atol=err)
    assert lift.mean() == pytest.approx(1.0, abs=1e-3)
    assert places[1:-1, 2].mean() == pytest.approx(0.0, abs=1e-6)


@pytest.mark.parametrize("after", [False, True])
@pytest.mark.parametrize(("roll", "pitch", "share"), [(0, -40, 1), (35, 0, None), (75, 0, 0.5)])
def test_the_heave_of_a_banked_body_leans_and_bears_the_weight(tmp_path, roll, pitch, share, after):
    """Across its span, as high as that of a level one: the lift is 1 / cos of the roll."""
    path = f"""[[motion.motions]]
kind = "keys"
keyframes = [{{ time = 0, rotation = [{roll}, {pitch}, 0], position = [0.2, 0, 0] }}]
"""
    beat = BEAT.format("heave = 1")
    text = beat + path if after else beat.replace("[[motion", path + "[[motion", 1)
    places = []
    for motion in (text, text.replace("heave = 1", "heave = 0"), beat):
        shot = read(tmp_path, motion)
        poses = joint_poses(shot.motion, shot, skeleton_of(shot.groom))
        places.append(np.stack([poses(k / 60.0).displacements[0] for k in range(10)]))
    angle = np.radians(roll)
    lift = np.array((0.0, -np.sin(angle), np.cos(angle))) / (share or np.cos(angle))
    assert np.ptp(places[2][:, 2]) > 0.01
    np.testing.assert_allclose(places[0] - places[1], places[2][:, 2:] * lift, atol=1e-12)


@pytest.mark.parametrize("name", ["cruise", "hover", "glide", "walk"])
def test_motions_that_go_on_close(tmp_path, name):
    """After a period all joints stand, and move, as they did."""
    period = {"cruise": 1 / 6, "hover": 1 / 7, "glide": 1 / 0.15, "walk": 1 / 2.5}[name]
    step = 1e-3 * min(period, 1.0)
    shot = read(tmp_path, f'base = "{name}"\nfit = "none"')
    skeleton = skeleton_of(shot.groom)
    poses = joint_poses(shot.motion, shot, skeleton)

    def places(time):
        turns, shifts = skeleton.carriers(poses(time))
        return np.concatenate(
            [turns.reshape(-1), (turns @ skeleton.pivots[:, :, None]).ravel() + shifts.ravel()]
        )

    start = 40.0
    first, last = places(start), places(start + period)
    np.testing.assert_allclose(last, first, atol=1e-9)
    rates = [(places(t + step) - places(t - step)) / (2 * step) for t in (start, start + period)]
    np.testing.assert_allclose(rates[1], rates[0], atol=1e-6 * np.abs(rates[0]).max())
    halfway = places(start + 0.37 * period)
    assert np.abs(halfway - first).max() > 1e-3


def strokes(tracks, axes):
    """Time (s) and angle (deg) from the horizontal, from top to bottom, of each downstroke."""
    wing, body = tracks.wings["left"], tracks.rotations[:, 0] @ axes.T
    cosine = np.cos(wing.sweep)
    arm = [-np.sin(wing.sweep), cosine * np.cos(wing.elevation), cosine * np.sin(wing.elevation)]
    arm = np.einsum("tij,jt->ti", body, np.array(arm))
    turns = 1 + np.flatnonzero(np.diff(np.sign(np.diff(wing.elevation))))
    for top, bottom in pairwise(turns):
        if wing.elevation[top] > wing.elevation[bottom]:
            x, _, z = arm[bottom] - arm[top]
            yield tracks.times[top], np.degrees(np.arctan2(z, x))


@pytest.mark.parametrize("tail", [-0.02, -0.12], ids=["21 degrees", "49 degrees"])
@pytest.mark.parametrize(
    ("name", "during", "published"),
    [
        ("take_off", (0.2, 0.95), ((-60.0, 5.0), (-47.0, 1.0))),
        ("landing", (0.42, 0.9), ((-1.0, 2.0), (17.0, 7.0))),
    ],
)
def test_strokes_lie_in_the_planes_of_a_pigeon(
    tmp_path, monkeypatch, name, during, published, tail
):
    """Berg and Biewener 2010, summary: mean and standard deviation, first and last.

    So they do on a bird that stands steeper, whose trunk is levelled in flight.
    """
    steep = BIRD.replace("[-0.1, 0, -0.02]", f"[-0.1, 0, {tail}]")
    monkeypatch.setattr("test_bird_motions.BIRD", steep)
    shot, tracks = tracks_of(tmp_path, f'base = "{name}"\nfit = "none"', 27, 24)
    planes = strokes(tracks, wing_axes(shot.groom))
    found = [angle for time, angle in planes if during[0] < time < during[1]]
    assert len(found) >= 3
    for angle, (mean, deviation) in zip((found[0], found[-1]), published, strict=True):
        assert angle == pytest.approx(mean, abs=deviation), found


def test_the_list_of_presets_says_where_figures_of_motions_come_from():
    listed = json.loads(invoke("presets", "list", "--json").stdout)["presets"]
    motions = {each["name"]: each for each in listed if each["family"] == "motion"}
    assert "Berg and Biewener 2010" in motions["take_off"]["cites"][0]
    assert motions["hover"] == motions["hover"] | {"cites": [], "by_eye": True}
    flight = ("flap", "pigeon_beat", "cruise", "take_off", "landing", "hover", "glide", "bank")
    assert all(motions[name]["cites"] or motions[name]["by_eye"] for name in flight)


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        ("downstroke = 1.5", r"motion.*downstroke: 1.5 is out of range. Give 0.1 to 0.9"),
        ("elbow = [[0.5, 3], [0.2, 1]]", r"elbow\[1\]\[0\]: 0.2 is not after 0.5"),
        ("elbow = [[0, 3], [1, 1]]", r"elbow\[1\]\[0\]: 1 is no phase of a beat"),
        ("turn = [[0, 3], [1, 999]]", r"turn\[1\]\[1\]: 999 is out of range"),
        ("period = 1", r"period: was removed. Write wingbeat_frequency"),
    ],
)
def test_beats_that_cannot_be(tmp_path, keys, message):
    with pytest.raises(InputError, match=message):
        tracks_of(tmp_path, BEAT.format(keys), 1)


def test_wings_that_cannot_fold_so_far_come_as_near_as_they_do(tmp_path):
    pattern = r"span_ratio: 0.1 is less than these wings reach, .*; 0.\d+ is taken"
    with pytest.warns(InputWarning, match=pattern) as told:
        _, asked = tracks_of(tmp_path, BEAT.format("span_ratio = 0.1"))
    least = re.search(r"; (\S+) is taken", str(told[0].message))[1]
    _, taken = tracks_of(tmp_path, BEAT.format(f"span_ratio = {least}"))
    for one, other in zip(asked.wings.values(), taken.wings.values(), strict=True):
        np.testing.assert_allclose(one.span_ratio, other.span_ratio, atol=0.01)


# of all motions, the one in which wings that fly fold farthest
@pytest.mark.parametrize("name", ["hover"])
@pytest.mark.parametrize(
    "species", ["gull", "owl", "parrot", "peacock", "pigeon", "sparrow", "swan"]
)
def test_motions_fold_no_wing_farther_than_it_goes(tmp_path, species, name):
    """Wings bow as on bodies that they lie on."""
    wing = BIRD.replace('type = "sparrow"', f'type = {{ base = "{species}", bow = 25 }}')
    (tmp_path / "groom.toml").write_text(wing)
    (tmp_path / "shot.toml").write_text(SHOT + f'base = "{name}"')
    shot = read_shot(tmp_path / "shot.toml")
    with warnings.catch_warnings():
        warnings.filterwarnings("error", message=".*less than these wings reach")
        joint_poses(shot.motion, shot, skeleton_of(shot.groom))


@pytest.mark.parametrize(
    ("motion", "told"),
    [
        (BEAT.format("wingbeat_frequency = 14"), "wingbeat_frequency: 14 flaps"),
        ('kind = "swing"\naxis = [1, 0, 0]\nangle = 3\nfrequency = 14', "frequency: 14 swings"),
        ('base = "shake"\nfrequency = 7\ntempo = 2', "frequency: 14 shakes"),
    ],
)
def test_motions_too_fast_for_the_frames_are_told(tmp_path, motion, told):
    with pytest.warns(InputWarning, match=f"{told} a second.*Give more than 28 frames"):
        read(tmp_path, motion)


def roots_at(groom, turns=(), folds=(), bends=()):
    """Root frames of an open wing whose joints turn (name, rotation), and fold and bend (name,
    whole folds) on top."""
    skeleton = skeleton_of(groom)
    poses = opened_poses(groom)
    for name, turn in turns:
        poses.rotations[skeleton.names.index(name)] = turn
    for name, fold in folds:
        poses.folds[skeleton.names.index(name)] += fold
    for name, bend in bends:
        poses.bends[skeleton.names.index(name)] = bend
    return joint_roots(groom, skeleton, lambda _: poses).frames(0.0)


def arm_of(groom):
    """Joints of the right wing by role."""
    return {each.role: each.name for each in groom.joints if each.name.startswith("right")}


@pytest.mark.parametrize("raised", [-60.0, 60.0])
def test_feathers_of_the_upper_arm_close_the_way_from_body_to_wing_as_it_beats(tmp_path, raised):
    """Their roots go along by a share that grows; vanes lie along the way from root to root."""
    groom = read(tmp_path, 'kind = "hold"').groom
    arm, names = arm_of(groom), [each.id for each in groom.feathers]
    still, beaten = roots_at(groom), roots_at(groom, [(arm["shoulder"], about_x(raised))])
    own = [names.index(f"right_wing_tertial_{number:02d}") for number in (4, 3, 2, 1)]
    shoulder = next(each.position for each in groom.joints if each.name == arm["shoulder"])
    before, after = ((each.positions[own] - shoulder)[:, 1:] for each in (still, beaten))
    turned = np.degrees(np.arctan2(*after.T) - np.arctan2(*before.T)) / -raised
    assert 0.0 < turned[0] < 0.3
    assert turned[-1] > 0.8
    assert (np.diff(turned) > 0.2).all()
    frames = beaten.rotations[own]
    for step, (near, far) in zip(
        np.diff(beaten.positions[own], axis=0), pairwise(frames), strict=True
    ):
        shaft, normal = unit(near[:, 0] + far[:, 0]), unit(near[:, 2] + far[:, 2])
        across = unit(step - (step @ shaft) * shaft)
        assert np.degrees(np.arcsin(abs(across @ normal))) < 30.0
    outer = [k for k, each in enumerate(groom.feathers) if each.joint == arm["wrist"]]
    turns = beaten.rotations[outer] @ still.rotations[outer].swapaxes(1, 2)
    np.testing.assert_allclose(np.linalg.norm(rotation_vectors(turns), axis=1), np.pi / 3.0)


@pytest.mark.parametrize("by", ["folds", "bends"])
@pytest.mark.parametrize("folded", [("elbow", "wrist"), ("shoulder", "elbow", "wrist")])
def test_wings_bow_round_a_body_only_where_they_fold_and_upper_arms_lie_on_it(tmp_path, folded, by):
    """A beat, which bends them as far for a moment, would throw their feathers."""
    found = []
    for bow in (0, 25):
        wing = BIRD.replace('type = "sparrow"', f'type = {{ base = "parrot", bow = {bow} }}')
        (tmp_path / "groom.toml").write_text(wing)
        (tmp_path / "shot.toml").write_text(SHOT + 'kind = "hold"')
        groom = read_shot(tmp_path / "shot.toml").groom
        arm = arm_of(groom)
        found.append(roots_at(groom, **{by: [(arm[role], 1.0) for role in folded]}).positions)
    away = np.abs(found[1] - found[0]).max()
    assert (away > 1e-3) == ("shoulder" in folded and by == "folds")


def test_open_wings_bow_at_no_phase_of_a_beat_that_turns_their_hands_over(tmp_path):
    """What they would bow for a moment would throw their feathers."""
    found = []
    for bow in (0, 25):
        wing = BIRD.replace('type = "sparrow"', f'type = {{ base = "pigeon", bow = {bow} }}')
        (tmp_path / "groom.toml").write_text(wing)
        (tmp_path / "shot.toml").write_text(SHOT + 'base = "hover"\nfit = "none"')
        motion = root_motion(read_shot(tmp_path / "shot.toml"))
        found.append([motion.frames(k / 7 / 24).positions for k in range(24)])
    np.testing.assert_allclose(found[0], found[1], atol=1e-7)


def test_a_wing_stands_off_its_shoulder_by_as_much_of_the_offset_as_it_is_folded(tmp_path):
    """Along the body, which the arm does not turn."""
    (tmp_path / "groom.toml").write_text(BIRD.replace("fold = 1", "fold = 0"))
    (tmp_path / "shot.toml").write_text(SHOT + 'kind = "hold"')
    groom = read_shot(tmp_path / "shot.toml").groom
    way = np.array((-0.01, 0.0, 0.02))
    own = tuple(
        replace(each, offset=way if each.role == "shoulder" and each.side else None)
        for each in groom.joints
    )
    wing = [k for k, each in enumerate(groom.feathers) if "wing" in each.id]
    for fold in (0.0, 0.4, 1.0):
        folds = [(each.name, fold) for each in groom.joints if "wing" in each.name]
        near, far = (roots_at(each, folds=folds) for each in (groom, replace(groom, joints=own)))
        away = (far.positions - near.positions)[wing]
        np.testing.assert_allclose(away, np.tile(fold * way, (len(wing), 1)), atol=1e-9)
        np.testing.assert_allclose(far.rotations, near.rotations, atol=1e-12)
