"""Root motion: what each kind does to the roots, how smooth it is, what is refused."""

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from featherfx.errors import InputError
from featherfx.groom.keys.preset import UNSCALED_CLOCK, Clock
from featherfx.groom.types import Groom, Joint, Placement
from featherfx.shot.loop.simulate import simulate
from featherfx.shot.motion.motion import root_motion
from featherfx.shot.read.read import read_shot
from featherfx.shot.roots import root_rates
from featherfx.shot.types import Motion, Quality, Shot, Wind

MIRROR = np.diag((1.0, -1.0, 1.0))
PERIOD = 0.8
STILL = {
    **dict.fromkeys(("stroke_amplitude", "stroke_plane", "tip_reversal", "turn", "sweep"), 0.0),
    **dict.fromkeys(("twist", "elbow", "wrist", "beats"), 0.0),
    **{
        "wingbeat_frequency": 1.0,
        "downstroke": 0.5,
        "span_ratio": None,
        "heave": 0.0,
        "pitch": 0.0,
    },
    "elevation": {"mean": 0.0, "harmonics": ((1.0, 0.0),)},
}
FLAP = STILL | {
    "wingbeat_frequency": 1.0 / PERIOD,
    "stroke_amplitude": 80.0,
    "elevation": {"mean": 8.0, "harmonics": ((1.0, 0.0),)},
    "sweep": {"mean": 0.0, "harmonics": ((12.0, 0.0),)},
    "elbow": {"mean": 25.0, "harmonics": ((-5.0, -14.0),)},
    "wrist": {"mean": 30.0, "harmonics": ((0.0, -20.0),)},
    "twist": {"mean": 0.0, "harmonics": ((0.0, 15.0),)},
}


def placement(name, position, joint, rotation=None):
    turn = np.eye(3) if rotation is None else rotation
    kind = SimpleNamespace(length=0.2)  # all that motions ask of it
    return Placement(name, kind, "wing", np.array(position, float), turn, joint)


def wing_joints():
    joints = [Joint("body", np.array((0.0, 0.0, 0.1)), "", "body", 0)]
    for side, letter in ((1, "l"), (-1, "r")):
        for role, parent, y in (
            ("wrist", f"elbow_{letter}", 0.7),
            ("shoulder", "body", 0.1),
            ("elbow", f"shoulder_{letter}", 0.4),
        ):
            place = np.array((-0.02 * y, side * y, 0.1))
            joints.append(Joint(f"{role}_{letter}", place, parent, role, side))
    return tuple(joints)


def wing_groom():
    turn = Rotation.from_euler("xyz", (20, -30, 110), degrees=True).as_matrix()
    feathers = [placement("tail", (-0.4, 0.0, 0.0), "")]
    for side, letter in ((1, "l"), (-1, "r")):
        rotation = turn if side > 0 else MIRROR @ turn @ np.diag((1.0, -1.0, 1.0))
        for role, y in (("shoulder", 0.2), ("elbow", 0.5), ("wrist", 0.9)):
            place = (-0.05, side * y, 0.12)
            feathers.append(placement(f"{role}_{letter}", place, f"{role}_{letter}", rotation))
    return Groom("wings", Path("groom.toml"), tuple(feathers), wing_joints())


def motion_of(kind, values, groom=None, clock=UNSCALED_CLOCK):
    shot = Shot(
        name="shot",
        source=Path("shot.toml"),
        groom=groom or wing_groom(),
        first_frame=1,
        last_frame=24,
        frames_per_second=24.0,
        motion=Motion(kind, values, clock),
        wind=Wind(np.array((1.0, 0, 0)), 0.0, 0.0, 1.0, 1.2, 1.0, 0.1, 0),
        quality=Quality("draft", 11, 4, 1, 1e-3, 8),
        gravity=np.array((0.0, 0.0, -9.81)),
    )
    return root_motion(shot)


def is_rotation(matrices):
    product = matrices @ np.swapaxes(matrices, -1, -2)
    return np.allclose(product, np.eye(3), atol=1e-12) and np.all(np.linalg.det(matrices) > 0)


def sampled(motion, times):
    positions, rotations = zip(*(motion.frames(time) for time in times), strict=True)
    return np.stack(positions), np.stack(rotations)


def largest_jump_of_rate(motion, end, samples=4000):
    """Largest change of velocity between neighbouring samples over the largest velocity."""
    positions, rotations = sampled(motion, np.linspace(-0.05, end, samples))
    state = np.concatenate((positions, rotations.reshape(*rotations.shape[:2], 9)), axis=2)
    rate = np.diff(state, axis=0)
    return np.abs(np.diff(rate, axis=0)).max() / np.abs(rate).max()


ONE = """
name = "g"
[[feather]]
id = "f"
kind = "%s"
position = [0, 0, 0]
direction = [1, 0, 0]
up = [0, 0, 1]
"""
SHAKEN = """
name = "s"
groom = "groom.toml"
frames = [1, 10]
wind = "calm"
motion = "shake"
quality = "preview"
"""


def test_hold_leaves_every_root_where_the_groom_has_it():
    groom = wing_groom()
    positions, rotations = motion_of("hold", {}, groom).frames(3.21)
    np.testing.assert_array_equal(positions, [f.position for f in groom.feathers])
    np.testing.assert_array_equal(rotations, [f.rotation for f in groom.feathers])


def test_shake_is_a_sine_along_the_direction_that_starts_at_rest():
    values = {
        "amplitude": 0.05,
        "frequency": 3.0,
        "direction": [0.0, 3.0, 4.0],
        "ramp_periods": 0.25,
    }
    motion, rest = motion_of("shake", values), motion_of("hold", {}).frames(0.0)
    for time in (0.1, 0.2513, 1.7):
        positions, rotations = motion.frames(time)
        shift = 0.05 * np.sin(6.0 * np.pi * time) * np.array((0.0, 0.6, 0.8))
        np.testing.assert_allclose(positions - rest[0], np.tile(shift, (7, 1)), atol=1e-14)
        np.testing.assert_array_equal(rotations, rest[1])
    step = 1e-5
    near = np.abs(motion.frames(step)[0] - rest[0]).max()
    assert near < 1e-6 * 0.05 * 6.0 * np.pi * step
    assert largest_jump_of_rate(motion, 1.0) < 0.02


@pytest.mark.parametrize("kind", ["swan_primary", "ostrich_plume"])
def test_a_shake_begins_without_throwing_tips(tmp_path, kind):
    (tmp_path / "groom.toml").write_text(ONE % kind)
    (tmp_path / "shot.toml").write_text(SHAKEN)
    speeds = [
        np.linalg.norm(frame.poses[0].velocities.nodes[:, 0], axis=1)
        for frame in simulate(read_shot(tmp_path / "shot.toml"), subframes=8)
    ]
    root, tip = np.max(speeds, axis=0)[[0, -1]]
    # the greatest speed of a sine
    assert root == pytest.approx(0.02 * 2.0 * np.pi * 3.0, rel=0.01)
    assert tip < 1.5 * root


def test_flap_is_under_way_periodic_and_smooth():
    motion = motion_of("flap", FLAP)
    before, later = (sampled(motion, t + np.linspace(0.0, 0.8, 17)) for t in (-1.6, 2.4))
    np.testing.assert_allclose(before[0], later[0], atol=1e-12)
    np.testing.assert_allclose(before[1], later[1], atol=1e-12)
    assert is_rotation(before[1])
    assert largest_jump_of_rate(motion, 1.7) < 0.02
    assert motion.frames(0.0)[0][1][2] > 0.12 + 0.05  # the wing is up


@pytest.mark.parametrize("beats", [0.3, 2.5, 7.0])
def test_a_number_of_beats_is_from_rest_to_rest_and_never_faster_than_without_end(beats):
    motion, ever = (motion_of("flap", FLAP | {"beats": each}) for each in (beats, 0.0))
    end = (beats + min(beats, 2.0)) * PERIOD
    before, after = motion.frames(end - 1e-5)[0], motion.frames(end + 7.0)[0]
    np.testing.assert_allclose(motion.frames(end)[0], after, atol=1e-12)
    np.testing.assert_allclose(motion.frames(-1.0)[0], motion.frames(0.0)[0], atol=1e-12)
    assert np.abs(before - after).max() < 1e-9
    assert np.abs(motion.frames(0.5 * end)[0] - after).max() > 0.05
    assert largest_jump_of_rate(motion, end + 0.1) < 0.04
    fastest, of_ever = (
        np.abs(np.diff(sampled(each, np.linspace(0.0, end, 2001))[0], axis=0)).max()
        for each in (motion, ever)
    )
    assert fastest < 1.01 * of_ever


def test_flap_of_the_right_wing_mirrors_that_of_the_left():
    motion = motion_of("flap", FLAP)
    rest = motion_of("hold", {}).frames(0.0)[1]
    for time in (0.0, 0.33, 0.61):
        positions, rotations = motion.frames(time)
        np.testing.assert_allclose(positions[4:], positions[1:4] @ MIRROR, atol=1e-12)
        turn = rotations @ np.swapaxes(rest, 1, 2)
        np.testing.assert_allclose(turn[4:], MIRROR @ turn[1:4] @ MIRROR, atol=1e-12)


def test_flap_signs_raise_twist_and_fold_the_wing():
    def at(time, **values):
        return motion_of("flap", STILL | values).frames(time)

    rest = at(0.0)[0]
    left = slice(1, 4)
    assert np.all(at(1.0, stroke_amplitude=60.0)[0][left, 2] > rest[left, 2])
    assert np.all(at(1.5, stroke_amplitude=60.0)[0][left, 2] < rest[left, 2])
    assert np.all(at(1.0, sweep=10.0)[0][left, 0] < rest[left, 0])
    # A quarter beat on, in mid-downstroke, the leading edge (forward, +x) is down.
    turn = at(1.25, twist={"mean": 0.0, "harmonics": ((0.0, 20.0),)})[1][1] @ at(0.0)[1][1].T
    assert turn[2, 0] == pytest.approx(-np.sin(np.radians(20.0)))
    folded = at(0.0, elbow=30.0)[0] - rest
    assert folded[2, 0] > 0.01
    assert folded[2, 2] < 0.0
    assert np.all(folded[1] == 0.0)
    folded = at(0.0, wrist=30.0)[0] - rest
    assert folded[3, 0] < -0.01
    assert folded[3, 2] < 0.0
    assert np.all(folded[:3] == 0.0)


def test_joints_carry_their_feathers_rigidly_and_feathers_without_joint_stay():
    motion = motion_of("flap", FLAP)
    rest, moved = motion_of("hold", {}).frames(0.0), motion.frames(0.37)
    np.testing.assert_array_equal(moved[0][0], rest[0][0])
    np.testing.assert_array_equal(moved[1][0], rest[1][0])
    # The pivot of the elbow is a point of the shoulder's body and of the elbow's.
    pivot = wing_joints()[3].position

    def carried(feather):
        turn = moved[1][feather] @ rest[1][feather].T
        return moved[0][feather] + turn @ (pivot - rest[0][feather])

    np.testing.assert_allclose(carried(1), carried(2), atol=1e-12)


def test_flap_without_shoulder_is_refused():
    groom = Groom("one", Path("groom.toml"), (placement("a", (0, 0, 0), ""),))
    with pytest.raises(InputError, match="shoulder"):
        motion_of("flap", FLAP, groom)


KEYS = [
    {"time": 0.5, "joint": "", "position": [0.0, 0.0, 0.0], "rotation": [0.0, 0.0, 0.0]},
    {"time": 1.0, "joint": "", "position": [0.2, 0.0, 0.1], "rotation": [30.0, 40.0, -60.0]},
    {"time": 2.0, "joint": "", "position": [0.2, 0.3, 0.0], "rotation": [1.0, 0.0, 0.0, 0.0]},
    {"time": 2.2, "joint": "", "rotation": [0.0, 170.0, 0.0]},
]


def test_keys_are_met_and_held_outside():
    motion = motion_of("keys", {"keyframes": KEYS})
    rest = motion_of("hold", {}).frames(0.0)
    for time in (-1.0, 0.0, 0.5):
        np.testing.assert_allclose(motion.frames(time)[0], rest[0], atol=1e-14)
    turn = Rotation.from_euler("xyz", KEYS[1]["rotation"], degrees=True).as_matrix()
    positions, rotations = motion.frames(1.0)
    np.testing.assert_allclose(positions, rest[0] @ turn.T + KEYS[1]["position"], atol=1e-12)
    np.testing.assert_allclose(rotations, turn @ rest[1], atol=1e-12)
    positions, rotations = motion.frames(2.0)
    np.testing.assert_allclose(positions, rest[0] + KEYS[2]["position"], atol=1e-12)
    np.testing.assert_allclose(motion.frames(2.2)[0], motion.frames(9.0)[0], atol=1e-12)


@pytest.mark.parametrize("turn", [[90.0, 0.0, 0.0], [0.5**0.5, 0.5**0.5, 0.0, 0.0]])
def test_keys_go_on_at_the_rate_of_the_step_beside(turn):
    """What ends flat is held; turns go on about their axis."""
    still = [0.0] * 3 if len(turn) == 3 else [1.0, 0.0, 0.0, 0.0]
    keys = [
        {"time": 0.0, "position": [0.0, 0.0, 0.0], "rotation": still},
        {"time": 0.5, "position": [0.1, -0.2, 0.0], "rotation": turn},
    ]
    rest = motion_of("hold", {}).frames(0.0)
    for flat, time in ((None, 1.25), (None, -0.75), (1, 1.25), (0, -0.75), (1, -0.75)):
        given = [each | {"tangents": "flat"} if k == flat else each for k, each in enumerate(keys)]
        motion = motion_of("keys", {"keyframes": given, "extrapolation": "linear"})
        held = flat == (time > 0.0)
        steps = float(time > 0.0) if held else time / 0.5
        about = Rotation.from_rotvec([steps * 0.5 * np.pi, 0.0, 0.0]).as_matrix()
        positions, rotations = motion.frames(time)
        np.testing.assert_allclose(rotations, about @ rest[1], atol=1e-12)
        there = rest[0] @ about.T + steps * np.array([0.1, -0.2, 0.0])
        np.testing.assert_allclose(positions, there, atol=1e-12)


def test_keys_are_smooth_rotations_at_every_time():
    motion = motion_of("keys", {"keyframes": KEYS})
    assert is_rotation(sampled(motion, np.linspace(0.0, 3.0, 101))[1])
    assert largest_jump_of_rate(motion, 2.4) < 0.05


def test_keys_do_not_depend_on_the_frame_they_are_given_in():
    turn = Rotation.from_rotvec((0.4, -1.1, 0.7))
    given = [Rotation.from_rotvec(v) for v in ((0, 0, 0), (0.5, 1.0, 0), (0.2, -0.4, 2.0))]

    def rotations(keys):
        keyframes = [
            {"time": 0.3 * i, "rotation": list(key.as_quat(scalar_first=True))}
            for i, key in enumerate(keys)
        ]
        return sampled(motion_of("keys", {"keyframes": keyframes}), np.linspace(0, 0.6, 13))[1]

    plain = rotations(given)
    turned = rotations([turn * key for key in given])
    np.testing.assert_allclose(turned, turn.as_matrix() @ plain, atol=1e-12)


def key_track(keyframes, what, times):
    """(T, 3) positions (m) or accumulated turning (deg, small steps) of a groom's one root."""
    motion, rest = motion_of("keys", {"keyframes": keyframes}), motion_of("hold", {}).frames(0.0)
    positions, rotations = sampled(motion, times)
    if what == "position":
        return positions[:, 0] - rest[0][0]
    frames = Rotation.from_matrix(rotations[:, 0])
    steps = (frames[1:] * frames[:-1].inv()).as_rotvec(degrees=True)
    return np.vstack((np.zeros(3), np.cumsum(steps, axis=0)))


def test_a_hold_holds_and_nothing_overshoots():
    times = np.linspace(0.0, 3.0, 601)
    turns = [{"time": t, "rotation": [0, 0, a]} for t, a in ((0, 0), (0.5, 90), (3, 90))]
    angles = key_track(turns, "rotation", times)[:, 2]
    assert np.abs(angles[times >= 0.5] - 90.0).max() < 1e-9
    assert (np.diff(angles[times <= 0.5]) > 0.0).all()
    shifts = [{"time": t, "position": [0, x, 0]} for t, x in ((0, 0), (1, 0.1), (2, 0.1))]
    assert key_track(shifts, "position", times)[:, 1].max() <= 0.1 + 1e-15


@pytest.mark.parametrize("end", [270.0, 720.0, -1080.0])
@pytest.mark.parametrize("axis", [0, 1, 2])
def test_angles_count_turns(end, axis):
    turns = [{"time": float(t), "rotation": list(end * t * np.eye(3)[axis])} for t in (0, 1)]
    angles = key_track(turns, "rotation", np.linspace(0.0, 1.0, 201))
    assert angles[-1, axis] == pytest.approx(end, abs=1e-9)
    # halfway in half the time, by the symmetry of a step from rest to rest
    assert angles[100, axis] == pytest.approx(0.5 * end, abs=1e-9)


def test_smooth_rates_are_those_of_fritsch_and_butland():
    from scipy.interpolate import PchipInterpolator

    times, values = np.array([0.0, 0.4, 1.0, 1.3, 2.0]), np.array([0.0, 80.0, 200.0, 210.0, 90.0])
    inside = PchipInterpolator(times, values).derivative()(times[1:-1])
    turns = [{"time": t, "rotation": [0, a, 0]} for t, a in zip(times, values, strict=True)]
    at = times[1:-1, None] + [-1e-6, 1e-6]
    angles = key_track(turns, "rotation", np.concatenate([[0.0], at.ravel()]))[1:, 1]
    np.testing.assert_allclose(np.diff(angles.reshape(-1, 2))[:, 0] / 2e-6, inside, atol=1e-2)


@pytest.mark.parametrize("what", ["position", "rotation"])
@pytest.mark.parametrize(
    ("tangents", "at_quarter"),
    [
        # of a step of 2 within 1 s that begins with that tangent and ends flat
        ("linear", 2 * (3 / 16 - 2 / 64) + 2 * 0.25 * 0.75**2),
        ("step", 0.0),
        ("flat", 2 * (3 / 16 - 2 / 64)),
        ([-5.0, 0.0, 0.0], 2 * (3 / 16 - 2 / 64) - 5 * 0.25 * 0.75**2),
    ],
)
def test_tangents_of_a_keyframe(what, tangents, at_quarter):
    keys = [
        {"time": 0.0, what: [0, 0, 0], "tangents": tangents},
        {"time": 1.0, what: [2, 0, 0], "tangents": "flat"},
    ]
    found = key_track(keys, what, np.array([0.0, 0.25, 1.0]))
    np.testing.assert_allclose(found[1:, 0], [at_quarter, 2.0], atol=1e-9)


@pytest.mark.parametrize("order", ["xyz", "zxy", "yzx", "zyx"])
def test_the_order_of_angles_is_that_of_fixed_axes(order):
    angles = {"x": 20.0, "y": -35.0, "z": 70.0}
    keys = [{"time": 0.0, "rotation": list(angles.values()), "order": order}]
    rest = motion_of("hold", {}).frames(0.0)[1]
    turn = Rotation.from_euler(order, [angles[axis] for axis in order], degrees=True).as_matrix()
    found = motion_of("keys", {"keyframes": keys}).frames(0.0)[1]
    np.testing.assert_allclose(found, turn @ rest, atol=1e-12)


def test_keys_of_a_joint_move_what_hangs_on_it():
    keyframes = [{"time": 0.0, "joint": "elbow_l", "rotation": [0.0, 0.0, 90.0]}]
    motion, rest = motion_of("keys", {"keyframes": keyframes}), motion_of("hold", {})
    positions, still = motion.frames(4.0)[0], rest.frames(0.0)[0]
    moved = np.abs(positions - still).max(axis=1) > 1e-6
    assert list(moved) == [False, False, True, True, False, False, False]
    pivot = wing_joints()[3].position
    arm = still[3] - pivot
    turned = np.array((-arm[1], arm[0], arm[2]))
    np.testing.assert_allclose(positions[3], pivot + turned, atol=1e-12)


def test_rates_at_the_end_of_a_frame_are_those_of_the_frames_there():
    motion, end, h = motion_of("flap", FLAP, wing_groom()), 0.5, 1e-4
    now, first, second = root_rates(motion, end - 1.0 / 24.0, end)
    before, after = motion.frames(end - h), motion.frames(end + h)
    for x, rate, change, low, high in zip(now, first, second, before, after, strict=True):
        true, bend = (high - low) / (2.0 * h), (high - 2.0 * x + low) / h**2
        np.testing.assert_allclose(rate, true, rtol=0.0, atol=5e-4 * np.abs(true).max())
        np.testing.assert_allclose(change, bend, rtol=0.0, atol=1e-2 * np.abs(bend).max())
    for rates in root_rates(motion, end, end)[1:]:
        assert not np.any(rates.positions)
        assert not np.any(rates.rotations)


def turned(joint, vector):
    turn = Rotation.from_rotvec(vector).as_quat(scalar_first=True).tolist()
    return Motion("keys", {"keyframes": [{"time": 0.0, "joint": joint, "rotation": turn}]})


def test_parts_of_an_act_move_the_groom_as_those_before_have_left_it():
    arm, hand = np.array((0.3, -0.5, 0.8)), np.array((-0.7, 0.2, 0.4))
    acts = {"motions": (turned("", hand), turned("shoulder_l", arm), turned("elbow_l", hand))}
    positions, rotations = motion_of("act", acts).frames(0.0)
    rest = motion_of("hold", {}).frames(0.0)
    first, then = (Rotation.from_rotvec(vector).as_matrix() for vector in (arm, hand))
    shoulder, elbow = wing_joints()[2].position, wing_joints()[3].position

    def about(turn, pivot, point):
        return pivot + turn @ (point - pivot)

    bent = about(first, shoulder, elbow)
    expected = about(then, bent, about(first, shoulder, rest.positions[3]))
    # the whole groom turns last: axes of limbs go with it
    np.testing.assert_allclose(positions[3], then @ expected, atol=1e-12)
    np.testing.assert_allclose(rotations[3], then @ then @ first @ rest.rotations[3], atol=1e-12)


def test_a_clock_starts_quickens_and_fades_a_motion():
    keys = {
        "keyframes": [{"time": 0.0, "rotation": [0, 0, 0]}, {"time": 1.0, "rotation": [0, 0, 80]}]
    }
    amounts = ((0.5, 1.0), (1.0, 0.5))
    whole = motion_of("keys", keys)
    changed = motion_of("keys", keys, clock=Clock(start=2.0, tempo=2.0, amount=amounts))
    for time in (0.0, 2.1, 2.25):
        own = whole.frames(2.0 * (time - 2.0))
        np.testing.assert_allclose(changed.frames(time)[0], own[0], atol=1e-12)
    turn = Rotation.from_euler("z", 40, degrees=True).as_matrix()
    np.testing.assert_allclose(
        changed.frames(4.0)[1], turn @ motion_of("hold", {}).frames(0.0)[1], atol=1e-12
    )
    assert largest_jump_of_rate(changed, 3.0) < 0.02


def test_ways_of_a_motion_go_with_its_size_and_turns_stay():
    keys = {"keyframes": [{"time": 0.0, "rotation": [0, 0, 80], "position": [1, 0, 0.5]}]}
    whole, small = (motion_of("keys", keys, clock=Clock(size=size)) for size in (1.0, 0.25))
    (places, turns), (own, same) = whole.frames(0.0), small.frames(0.0)
    np.testing.assert_allclose(same, turns, atol=1e-12)
    np.testing.assert_allclose(places - own, np.tile([0.75, 0, 0.375], (len(own), 1)), atol=1e-12)


def test_a_swing_turns_joints_there_and_back():
    values = {"joints": "elbow_?", "axis": [0, 0, 1], "angle": 30, "frequency": 2}
    values |= {"phase": 0.0, "ramp_periods": 1.0}
    rest, motion = motion_of("hold", {}).frames(0.0)[1], motion_of("swing", values)
    for time, angle in ((0.625, 30.0), (0.75, 0.0), (0.875, -30.0)):
        turn = Rotation.from_euler("z", angle, degrees=True).as_matrix()
        rotations = motion.frames(time)[1]
        np.testing.assert_allclose(rotations[[2, 5]], turn @ rest[[2, 5]], atol=1e-12)
        np.testing.assert_array_equal(rotations[[0, 1, 4]], rest[[0, 1, 4]])
    with pytest.raises(InputError, match="no joint"):
        motion_of("swing", values | {"joints": "knee"})


def test_an_act_leaves_out_what_the_groom_lacks_but_not_all():
    tail = Motion("fold", {"joints": "tail", "folds": [{"time": 0.0, "fold": 0.0}]})
    arm = turned("shoulder_l", (0.1, 0, 0))
    found = motion_of("act", {"motions": (tail, arm)}).frames(0.0)
    np.testing.assert_array_equal(found[0], motion_of("act", {"motions": (arm,)}).frames(0.0)[0])
    with pytest.raises(InputError, match="no joint that folds"):
        motion_of("act", {"motions": (tail,)})
