"""Cuts: found by acceleration that no smooth motion explains, or named."""

from __future__ import annotations

import warnings
from dataclasses import dataclass, replace

import numpy as np
import pytest
from places import ROOT, SAMPLES
from pxr import Gf, Usd, UsdGeom, Vt
from usd_meshes import define_mesh, level_grid, new_stage

import featherfx
from featherfx.errors import InputWarning
from featherfx.groom.keys.preset import UNSCALED_CLOCK
from featherfx.shot.contact.bodies import Bodies, FeathersOver
from featherfx.shot.frames import FrameCuts, StageClock
from featherfx.shot.loop.simulate import simulate
from featherfx.shot.motion.cuts import CutFinder, CutTrack, NamedCuts, with_cuts
from featherfx.shot.motion.motion import root_motion
from featherfx.shot.read.read import read_shot
from featherfx.shot.sources import TimedSurface
from featherfx.shot.types import Motion

SAMPLE = SAMPLES / "flapping_bird" / "shot.toml"
FRAME = 1.0 / 30.0
CUT = 5  # between this frame and the next
LENGTH = 0.1


def cuts_of(places, first=0, last=20):
    """Frames after which a thing, 0.1 m long, is cut that goes from place (3,) to place a frame."""
    track = CutTrack(
        lambda time: np.array([places(time)], float),
        np.array([LENGTH]),
        StageClock(),
        first,
        last,
        "".format,
    )
    finder = CutFinder([track], frozenset())
    return [k for k in range(first, last) if finder.is_cut(k)]


def leap(t, way=5.0):
    return np.array([0.0, way if t > CUT else 0.0, 0.0])


@pytest.mark.parametrize(
    "motion",
    [
        lambda t: (0.0, 0.0, 0.0),
        lambda t: (0.4 * t, 0.0, 0.1 * t),
        lambda t: (0.01 * t * t, 0.0, 0.0),
        lambda t: (6.0 * np.cos(0.1 * t), 6.0 * np.sin(0.1 * t), 0.0),
        lambda t: (0.4 * t, 0.0, 0.02 * np.sin(2.0 * t)),
    ],
)
@pytest.mark.parametrize("way", [0.5, -5.0])
def test_a_leap_is_a_cut_at_rest_and_in_flight(motion, way):
    assert cuts_of(motion) == []
    assert cuts_of(lambda t: motion(t) + leap(t, way)) == [CUT]
    # also in the first and the last frames that there are
    for first, last in ((CUT, 12), (CUT - 1, 12), (0, CUT + 1), (2, CUT + 2)):
        assert cuts_of(lambda t: motion(t) + leap(t, 20.0 * way), first, last) == [CUT]


@pytest.mark.parametrize(
    "motion",
    [
        # a beat by a metre in four frames, in which it stands twice at either of two heights
        lambda t: (0.0, 0.0, np.cos((0.5 * t + 0.25) * np.pi)),
        lambda t: (0.0, 0.0, np.cos(t * np.pi / 3.0) if t > 4 else 1.0),
        # starts, stops and bounces at once
        lambda t: (max(0.0, t - 6.0), 0.0, 0.0),
        lambda t: (min(t, 6.0), 0.0, 0.0),
        lambda t: (0.0, 0.0, abs(0.7 * t - 5.0)),
        # drawn on twos
        lambda t: (0.8 * np.floor(0.5 * t), 0.0, 0.0),
        # within a feather's length
        lambda t: leap(t, 0.9 * LENGTH),
    ],
)
def test_what_starts_stops_beats_and_bounces_is_no_cut(motion):
    assert cuts_of(motion) == []


def test_segments_and_places_about_a_cut():
    cuts = NamedCuts(frozenset({5, 9}))
    assert cuts.ends(4.5, 5) == (-np.inf, 5.0)
    assert cuts.ends(5.0, 5) == (-np.inf, 5.0)
    assert cuts.ends(cuts.after(5.0), 5) == cuts.ends(7.0, 5) == (6.0, 9.0)
    assert [cuts.held(place) for place in (4.5, 5.0, 5.2, 6.0)] == [4.5, 5.0, 6.0, 6.0]
    assert FrameCuts().after(5.0) == 5.0
    # a stage of 30 time codes a second: what is before 8.75 and after 7.5 is of neither side
    clock = StageClock(1.25, 1.25, 24.0, NamedCuts(frozenset({5})))
    assert clock.grid == (1.0, 1.0)
    assert clock.ends(clock.code(5 / 24)) == (-np.inf, 6.0)
    assert clock.ends(clock.code(clock.after(5 / 24))) == (8.0, np.inf)


GROOM = """name = "g"
[[feather]]
id = "a"
kind = "covert"
position = [0.0, 0.0, 0.0]
direction = [-1, 0, 0.1]
up = [0, 0, 1]
[[feather]]
id = "b"
kind = "covert"
position = [0.02, 0.03, 0.0]
direction = [-1, 0.3, 0.2]
up = [0, 0, 1]
"""
SHOT = """name = "s"
groom = "groom.toml"
frames = [1, {last}]
quality = {{ rows = 9, columns = 3, coefficients = 1, tolerance = 1e-3 }}
gravity = [0, 0, 0]
{more}
[skin]
usd = "skin.usda"
prim = "/b/skin"
{keys}
"""
WINGS = """name = "b"
[[wing]]
id = "right_wing"
type = "pigeon"
shoulder = [0.03, -0.03, 0.03]
fold = 1
mirror = "y"
"""
LAST = 7  # frame before the cut
HALF_TURNS = {"x": (1, -1, -1), "y": (-1, 1, -1), "z": (-1, -1, 1)}


def write_skin(path, place, moved, rate=24.0, codes=range(-4, 20), by="points"):
    """A sheet that flies. place: (3,) m by frame. moved: (turn (3,), way (3,)) after the cut."""
    stage = new_stage(None, rate=rate)
    op = UsdGeom.Xform.Define(stage, "/b").AddTransformOp()
    rest, faces = level_grid(-0.2, 0.2, 5)
    mesh = define_mesh(stage, "/b/skin", rest, faces)
    for code in codes:
        turn, way = moved if code * 24.0 / rate > LAST + 1e-6 else ((1, 1, 1), (0, 0, 0))
        places = (rest + place(code * 24.0 / rate)) * turn + way
        if by == "points":
            mesh.GetPointsAttr().Set(Vt.Vec3fArray.FromNumpy(places.astype(np.float32)), code)
        else:
            matrix = np.diag([*turn, 1.0]).astype(float)
            matrix[3, :3] = place(code * 24.0 / rate) * turn + way
            op.Set(Gf.Matrix4d(*matrix.ravel().tolist()), code)
    stage.Export(str(path))


def baked(folder, more="", keys="", subframes=1, last=11):
    (folder / "groom.toml").write_text(GROOM)
    (folder / "shot.toml").write_text(SHOT.format(more=more, keys=keys, last=last))
    report = featherfx.bake(
        folder / "shot.toml", folder / "out.usdc", overwrite=True, subframes=subframes
    ).report
    stage = Usd.Stage.Open(str(folder / "out.usdc"))
    stage.Reload()
    meshes = [each for each in stage.Traverse() if each.IsA(UsdGeom.Mesh)]
    codes = sorted(
        {code for each in meshes for code in each.GetAttribute("points").GetTimeSamples()}
    )
    points = {
        code: np.concatenate([each.GetAttribute("points").Get(code) for each in meshes]).astype(
            float
        )
        for code in codes
    }
    return report, points


def straight(t):
    return np.array([0.3 * t, 0.0, 0.1 * t])


def curved(t):
    # at 4.3 m/s: where coverts without neighbours flutter, any two runs part
    return np.array([3.0 * np.cos(0.06 * t), 3.0 * np.sin(0.06 * t), 0.05 * t])


AWAY = (3.0, -2.0, 1.0)


@pytest.mark.parametrize(
    ("place", "turn", "away", "by", "keys"),
    [
        (straight, (1, 1, 1), AWAY, "points", ""),
        (straight, (1, 1, 1), AWAY, "transform", "rest = 0"),
        (straight, (1, 1, 1), AWAY, "points", 'interpolation = "linear"'),
        (curved, HALF_TURNS["z"], AWAY, "points", ""),
        (straight, HALF_TURNS["x"], (0, 0, 0), "points", ""),
        (straight, HALF_TURNS["y"], (0, 0, 0), "transform", "rest = 0"),
    ],
)
def test_feathers_go_through_a_cut_as_if_there_were_none(tmp_path, place, turn, away, by, keys):
    write_skin(tmp_path / "skin.usda", place, ((1, 1, 1), (0, 0, 0)), by=by)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        report, whole = baked(tmp_path, keys=keys)
    assert report["cuts"] == []
    write_skin(tmp_path / "skin.usda", place, (turn, away), by=by)
    with pytest.warns(InputWarning, match="1 more: cut to another place at frame 8") as told:
        report, cut = baked(tmp_path, keys=keys)
    assert len(told) == 1
    assert report["cuts"] == [LAST + 1]
    for code, points in whole.items():
        expected = points * turn + away if code > LAST else points
        assert np.abs(cut[code] - expected).max() < 1e-4


@pytest.mark.parametrize(("rate", "shot"), [(48.0, 24), (30.0, 24), (24.0, 48)])
def test_cuts_of_a_stage_of_another_rate_are_those_of_its_own_frames(tmp_path, rate, shot):
    more, keys = f"frames_per_second = {shot}\ncuts = []", 'time = "seconds"'
    codes, last = range(-8, 60), 20
    write_skin(tmp_path / "skin.usda", straight, ((1, 1, 1), (0, 0, 0)), rate, codes)
    _, whole = baked(tmp_path, more, keys, last=last)
    write_skin(tmp_path / "skin.usda", straight, ((1, 1, 1), AWAY), rate, codes)
    with pytest.warns(InputWarning, match="cut to another place"):
        report, cut = baked(tmp_path, more.replace("cuts = []", ""), keys, last=last)
    (number,) = report["cuts"]
    assert number == np.floor(np.ceil((LAST * rate / 24) + 1e-6) / rate * shot - 1e-6) + 1
    for code, points in whole.items():
        own, before = code * rate / shot, np.floor(LAST * rate / 24)
        if not before < own < before + 1:  # where the stage itself is drawn between both
            gap = np.abs(cut[code] - points - np.array(AWAY) * (code >= number)).max()
            assert gap < 1e-4


@pytest.mark.parametrize("turn", [(1, 1, 1), HALF_TURNS["z"]])
@pytest.mark.parametrize("keys", ["", 'interpolation = "linear"'])
@pytest.mark.filterwarnings("ignore:.*cut to another place")
def test_velocities_at_a_cut_are_those_of_the_drawn_skin(tmp_path, keys, turn):
    """A renderer draws the skin along straight lines, also from one side of a cut to the other.

    Halfway of a half turn no face of it has any area.
    """
    write_skin(tmp_path / "skin.usda", straight, (turn, AWAY))
    (tmp_path / "groom.toml").write_text(GROOM)
    (tmp_path / "shot.toml").write_text(SHOT.format(more="", keys=keys, last=10))
    frames = list(simulate(featherfx.read_shot(tmp_path / "shot.toml"), subframes=2))
    roots = [each.poses[0].points.nodes[0].mean(axis=0) for each in frames]
    for now, here, there in zip(frames, roots, roots[1:], strict=False):
        speed = now.poses[0].velocities.nodes[0].mean(axis=0)
        np.testing.assert_allclose(speed, (there - here) * 48.0, atol=0.02)
    np.testing.assert_allclose(roots[13], 0.5 * (roots[12] + roots[14]), atol=1e-4)


def test_cuts_are_named_and_denied(tmp_path):
    """A way that is shorter than a feather is a motion, unless the shot names it."""
    short = (0.04, 0.0, 0.03)
    write_skin(tmp_path / "skin.usda", straight, ((1, 1, 1), (0, 0, 0)))
    _, whole = baked(tmp_path, subframes=2)  # as steps end there, too
    write_skin(tmp_path / "skin.usda", straight, ((1, 1, 1), short))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        report, led = baked(tmp_path)
        assert report["cuts"] == []
        report, cut = baked(tmp_path, "cuts = [8]", subframes=2)
    assert report["cuts"] == [8]
    for code, points in whole.items():
        away = np.array(short) * (code > LAST)
        assert code % 1 or np.abs(cut[code] - points - away).max() < 1e-4
    assert np.abs(led[9.0] - whole[9.0] - short).max() > 3e-4
    write_skin(tmp_path / "skin.usda", straight, ((1, 1, 1), (0.5, 0, 0)))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert baked(tmp_path, "cuts = []")[0]["cuts"] == []


def test_channels_winds_and_cameras_are_cut_with_the_skin(tmp_path):
    write_skin(tmp_path / "skin.usda", straight, ((1, 1, 1), AWAY))
    (tmp_path / "groom.toml").write_text(GROOM)
    more = '[[channel]]\nname = "ruffle"\nkeys = [[7, 0], [8, 40]]\n[[channel]]\nname = "turn"\n'
    more = SHOT.format(more=more + "keys = [[1, 0], [11, 50]]", keys="", last=11)
    (tmp_path / "shot.toml").write_text(more)
    shot = with_cuts(featherfx.read_shot(tmp_path / "shot.toml"))
    assert [k for k in range(10) if shot.frame_cuts.is_cut(k)] == [LAST - 1]
    clock = shot.skin.clock
    assert clock.held(6.5 / 24) == 8.0
    assert clock.held(6.0 / 24) == 7.0
    motion, rate = root_motion(shot), 24.0
    before, right_after, then = (
        motion.frames(place / rate).rotations for place in (6.0, 6.0 + 1e-7, 7.0)
    )
    np.testing.assert_allclose(right_after, then, atol=1e-6)
    assert np.abs(then - before).max() > 0.3


@dataclass(frozen=True)
class Board:
    """A board that is a metre away, until it stands within the wing."""

    path = "/board"
    rest = np.array([[-1.0, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]])
    triangles = np.array([[0, 1, 2], [0, 2, 3]])
    closed = np.zeros(2, bool)
    sampled = (0.0, 40.0)
    knots = None

    def points(self, code: float) -> np.ndarray:
        return self.rest - np.array([0.0, 0.0, 1.0]) * (code < CUT + 0.5)

    def smoothed(self, knots):
        return self


def test_a_collider_that_is_elsewhere_is_no_wall_that_moves():
    shot = read_shot(SAMPLE)
    kept = tuple(f for f in shot.groom.feathers if f.id in ("right_primary_02", "right_primary_03"))
    shot = replace(
        shot,
        groom=replace(shot.groom, feathers=kept),
        colliders=(TimedSurface(Board(), StageClock(0.0, 1.0, 30.0)),),
        contact=replace(shot.contact, skin=False),
        motion=Motion("hold", {}),
    )
    shot = with_cuts(shot)
    assert [k for k in range(20) if shot.frame_cuts.is_cut(k)] == [CUT]
    assert shot.frame_cuts.found[CUT].name == "collider /board"
    nodes = np.zeros((2, 1, 1, 3))
    feathers = FeathersOver(np.arange(2), nodes, np.full(2, 0.3), np.zeros((2, 3)))
    bodies = Bodies(shot, feathers)
    bodies.begun = True
    still = type("Moving", (), {"nodes": nodes})
    states = [type("State", (), {"velocity": still, "points": still})]
    for k in range(10):
        (wall,) = bodies.walls(states, k * FRAME, (k + 1) * FRAME, 1e-3)
        assert wall.beginning == (k == CUT)
        assert np.all(wall.end[:, 2] == (0.0 if k >= CUT else -1.0))


def keyed(way: float, turn: float = 9.0, after: float = 0.0, cuts=None):
    """A bird whose body keyframes move within a frame, from rest to rest. turn: deg, for each
    metre; after: s, from the next frame to the keyframe there."""
    shot = read_shot(SAMPLE)
    places = {0.0: 0.0, 5 * FRAME: 0.0, 6 * FRAME + after: way, 9 * FRAME: way}
    keys = [
        {"joint": "body", "time": time, "position": [x, 0.0, 0.0], "rotation": [0.0, 0.0, turn * x]}
        for time, x in places.items()
    ]
    return with_cuts(replace(shot, motion=Motion("keys", {"keyframes": keys}), cuts=cuts))


@pytest.mark.parametrize(
    ("way", "turn", "after", "cuts"),
    [
        (4.6, 9.0, 0.0, None),
        (4.6, 9.0, 7e-5, None),
        (1e-4, 9e5, 7e-5, None),
        (0.02, 9.0, 7e-5, (7,)),
    ],
)
def test_keyframes_cut_from_place_to_place_without_swinging(way, turn, after, cuts):
    """By 4.6 m, with a key just after its frame, by a quarter turn alone, or as the shot says."""
    shot = keyed(way, turn, after, cuts)
    assert [k for k in range(12) if shot.frame_cuts.is_cut(k)] == [5]
    motion, start = root_motion(shot), root_motion(keyed(0.0)).frames(0.0)
    for frame in (1.0, 3.5, 5.0):
        for found, at_rest in zip(motion.frames(frame * FRAME), start, strict=True):
            np.testing.assert_allclose(found, at_rest, atol=1e-12)
    there = motion.frames(9 * FRAME)
    for frame in (5.0 + 1e-7, 5.5, 6.0, 7.5, 12.0):
        for found, then in zip(motion.frames(frame * FRAME), there, strict=True):
            np.testing.assert_allclose(found, then, atol=1e-12)


def test_beats_that_are_fast_for_the_frames_are_no_cuts_and_leaps_of_a_body_are(tmp_path):
    """Of an act: wings swing from top to bottom within a frame or two."""
    (tmp_path / "groom.toml").write_text(WINGS)
    leap = """[[motions]]
kind = "keys"
keyframes = [
  {{ time = 0, position = [0, 0, 0] }},
  {{ time = {}, position = [0, 0, 0] }},
  {{ time = {}, position = [3, 0, 0] }},
]"""
    (tmp_path / "presets" / "motion").mkdir(parents=True)
    for name, keys in (("off", ""), ("leap", leap.format(9 / 24, 10 / 24))):
        own = (ROOT / "presets" / "motion" / "take_off.toml").read_text()
        (tmp_path / "presets" / "motion" / f"{name}.toml").write_text(f"{own}{keys}\n")
        (tmp_path / "shot.toml").write_text(
            f'name = "s"\ngroom = "groom.toml"\nframes = [1, 40]\nmotion = "{name}"\n'
        )
        shot = read_shot(tmp_path / "shot.toml", [tmp_path / "presets"])
        shot = with_cuts(replace(shot, motion=replace(shot.motion, clock=UNSCALED_CLOCK)))
        cuts = [k for k in range(40) if shot.frame_cuts.is_cut(k)]
        assert cuts == ([9] if keys else [])


def test_keyframes_that_are_near_each_other_are_one_curve():
    """A hop of a centimetre in a frame is a motion."""
    assert not any(keyed(0.01).frame_cuts.is_cut(k) for k in range(12))
