"""Whole wings from their joints: layers, fans that close, and what is wrong with landmarks."""

from __future__ import annotations

import re
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from featherfx.algebra.vectors import from_rotation_vector, rotation_vectors
from featherfx.baking.export import export_groom
from featherfx.errors import InputError
from featherfx.groom.read.read import read_groom
from featherfx.groom.types import Groom
from featherfx.shot.motion.flap import folding
from featherfx.shot.motion.joints import joint_roots, skeleton_of, still_poses
from featherfx.shot.read.reference import list_presets
from featherfx.usd.check.measures import count_crossings

WING = """
[[wing]]
id = "right_wing"
type = "pigeon"
shoulder = [0.03, -0.03, 0.03]
"""
SHOULDER = np.array([0.03, -0.03, 0.03])
PLACES = [-0.01, -0.05, 0.03], [0.03, -0.09, 0.03], [0.0, -0.14, 0.03]
LANDMARKS = """
elbow = [-0.01, -0.05, 0.03]
wrist = [0.03, -0.09, 0.03]
tip = [0.0, -0.14, 0.03]
"""


def groom_of(folder: Path, text: str) -> Groom:
    path = folder / "groom.toml"
    path.write_text('name = "wings"\n' + text, encoding="utf-8")
    return read_groom(path)


def flight(groom: Groom, side: str = "right") -> list:
    rows = {"tertials": 0, "secondaries": 1, "primaries": 2}
    order = {"tertials": -1, "secondaries": -1, "primaries": 1}
    own = [f for f in groom.feathers if f.region in rows and f.id.startswith(side)]
    return sorted(own, key=lambda f: (rows[f.region], order[f.region] * int(f.id[-2:])))


def lines(feathers: list, groom: Groom) -> tuple[np.ndarray, np.ndarray]:
    """Roots (N, 2) and directions (N, 2) within the wing: along and against the forearm."""
    elbow, wrist = (
        next(j.position for j in groom.joints if j.name == f"right_wing_{name}")
        for name in ("elbow", "wrist")
    )
    x = (wrist - elbow) / np.linalg.norm(wrist - elbow)
    z = np.cross(x, feathers[12].rotation[:, 0])
    y = np.cross(z / np.linalg.norm(z), x)
    plan = np.column_stack([x, y])
    roots = np.array([f.position for f in feathers]) @ plan
    return roots, np.array([f.rotation[:, 0] for f in feathers]) @ plan


@pytest.mark.parametrize("species", [p.name for p in list_presets() if p.family == "wing"])
def test_flight_feathers_of_spread_wings_stand_closer_than_they_are_wide(
    tmp_path: Path, species: str
) -> None:
    """Else sky shows between them. Vanes are a fifth of their length wide, or wider."""
    text = WING.replace('"pigeon"', f'"{species}"') + "fold = 0\n"
    own = flight(groom_of(tmp_path, text))
    arm = [f for f in own if f.region != "primaries"]
    for one, other in pairwise(arm):
        apart = np.linalg.norm(one.position - other.position)
        assert apart < 0.2 * min(one.kind.length, other.kind.length), (one.id, other.id)


def test_one_short_table_is_a_whole_wing(tmp_path: Path) -> None:
    groom = groom_of(tmp_path, WING + "fold = 0\n")
    counts = {region: 0 for region in ("primaries", "secondaries", "tertials", "alula")}
    for feather in groom.feathers:
        if feather.region in counts:
            counts[feather.region] += 1
    assert counts == {"primaries": 10, "secondaries": 10, "tertials": 4, "alula": 3}
    assert [joint.role for joint in groom.joints] == ["shoulder", "elbow", "wrist"]
    longest = max(groom.feathers, key=lambda f: f.kind.length)
    assert (longest.id, longest.kind.length) == ("right_wing_primary_09", pytest.approx(0.17))


def test_a_row_of_no_feathers_is_left_out(tmp_path: Path) -> None:
    kind = 'type = { base = "pigeon", tertials = { count = 0 } }'
    groom = groom_of(tmp_path, WING.replace('type = "pigeon"', kind) + "fold = 0.5\n")
    regions = {feather.region for feather in groom.feathers}
    assert "tertials" not in regions
    assert {"primaries", "secondaries"} <= regions


@pytest.mark.parametrize("fold", [0.0, 0.3, 0.7, 1.0])
def test_no_shaft_crosses_its_neighbour_in_the_plan_of_the_wing(
    tmp_path: Path, fold: float
) -> None:
    groom = groom_of(tmp_path, WING + f"fold = {fold}\n")
    own = flight(groom)
    roots, ways = lines(own, groom)
    tips = roots + np.array([f.kind.length for f in own])[:, None] * ways
    for ends in (roots, tips):  # each stands, all along, on the outer side of the one before
        across = ends[1:] - roots[:-1]
        side = ways[:-1, 0] * across[:, 1] - ways[:-1, 1] * across[:, 0]
        assert (side < 0).all() or (side > 0).all()


def test_fan_of_a_folded_wing_is_closed(tmp_path: Path) -> None:
    spans = []
    for fold in (0, 1):
        groom = groom_of(tmp_path, WING + f"fold = {fold}\n")
        ways = [f.rotation[:, 0] for f in flight(groom)]
        spans.append(np.degrees(np.arccos(np.clip(ways[0] @ ways[-1], -1, 1))))
    assert spans[0] > 60
    assert spans[1] < 25


def test_angles_of_feathers_are_linear_in_the_angle_of_the_wrist(tmp_path: Path) -> None:
    angles = []
    for fold in (0, 0.25, 0.5, 1):
        groom = groom_of(tmp_path, WING + f"fold = {fold}\n")
        _, ways = lines(flight(groom), groom)
        angles.append(np.degrees(np.arctan2(ways[:, 1], ways[:, 0])))
    turned = np.unwrap(np.array(angles), period=360, axis=0)
    expected = turned[0] + np.array([0, 0.25, 0.5, 1])[:, None] * (turned[-1] - turned[0])
    np.testing.assert_allclose(turned, expected, atol=0.05)
    # each follicle turns more than the next inner one
    assert (np.diff(np.abs(turned[-1] - turned[0])) > 0).all()


@pytest.mark.parametrize("start", [0.0, 0.4])
def test_motion_folds_a_wing_to_where_the_groom_has_it(tmp_path: Path, start: float) -> None:
    text = WING + 'mirror = "y"\nfold = {}\n'
    here, there = (groom_of(tmp_path, text.format(fold)) for fold in (start, 1.0))
    keys = [{"time": 0.0, "fold": start}, {"time": 2.0, "fold": 1.0}]
    poses = folding(here, {"joints": "*", "folds": keys}, "shot.toml")
    frames = joint_roots(here, skeleton_of(here), poses).frames(2.0)
    for k, feather in enumerate(there.feathers):
        np.testing.assert_allclose(frames.positions[k], feather.position, atol=1e-9)
        np.testing.assert_allclose(frames.rotations[k], feather.rotation, atol=1e-9)


def test_the_left_wing_is_the_mirror_image(tmp_path: Path) -> None:
    both = groom_of(tmp_path, WING + 'fold = 0.5\nmirror = "y"\n')
    text = WING.replace("right", "left").replace("-0.03,", "0.03,")
    left = groom_of(tmp_path, text + 'fold = 0.5\nside = "left"\n')
    mirrored = {f.id: f for f in both.feathers}
    for feather in left.feathers:
        image = mirrored[feather.id]
        np.testing.assert_allclose(image.position, feather.position, atol=1e-12)
        np.testing.assert_allclose(image.rotation, feather.rotation, atol=1e-12)
    hinges = {j.name: j.hinge for j in both.joints}
    for joint in left.joints:
        np.testing.assert_allclose(hinges[joint.name], joint.hinge, atol=1e-12)


def test_landmarks_pose_the_wing_and_say_how_far_it_is_folded(tmp_path: Path) -> None:
    folded = groom_of(tmp_path, WING + "fold = 0.6\n")
    points = [*(j.position for j in folded.joints)]
    hand = folded.joints[2]
    first, last = flight(folded)[14], flight(folded)[-1]
    way = (last.turning.anchor - first.turning.anchor) / (0.98 - 0.03)
    points.append(hand.position + way)
    named = zip(("shoulder", "elbow", "wrist", "tip"), points, strict=True)
    placed = "".join(f"{name} = {np.asarray(point).tolist()}\n" for name, point in named)
    text = WING.replace("shoulder = [0.03, -0.03, 0.03]\n", placed)
    again = groom_of(tmp_path, text)
    for one, other in zip(folded.feathers, again.feathers, strict=True):
        np.testing.assert_allclose(one.position, other.position, atol=1e-9)
        np.testing.assert_allclose(one.rotation, other.rotation, atol=1e-9)
    assert [j.fold for j in again.joints] == pytest.approx([0.6] * 3)


@pytest.mark.parametrize(
    ("more", "message"),
    [
        ("", "elbow: missing: expects elbow, wrist and tip, or fold"),
        ("elbow = [0, -0.1, 0]\nfold = 0.5\n", "wrist: missing"),
        ("fold = 1.2\n", "fold: 1.2 is out of range. Give 0 to 1"),
        (LANDMARKS.replace("-0.14", "-0.09").replace("0.0, ", "0.03, "), "tip: is where"),
        ("elbow = [0, -0.1, 0]\nwrist = [0, -0.2, 0]\ntip = [0, -0.3, 0]", "are on one line"),
        (LANDMARKS + "forward = [-1, 0, 0]\n", "would point forwards: are landmarks"),
        ("fold = 0\nup = [2, 0, 0]\n", "up: is parallel to forward"),
        ('fold = 0\njoint = "rump"\n', "no joint 'rump'"),
    ],
)
def test_faults_of_landmarks_are_told(tmp_path: Path, more: str, message: str) -> None:
    text = WING
    if "one line" in message:
        text = text.replace("[0.03, -0.03, 0.03]", "[0, 0, 0]")
    with pytest.raises(InputError) as caught:
        groom_of(tmp_path, text + more)
    assert message in "\n".join(str(each) for each in caught.value.problems)
    assert len(caught.value.problems) == 1


def test_more_feathers_than_a_bone_holds_are_refused(tmp_path: Path) -> None:
    kind = 'type = { base = "pigeon", primaries.count = 90 }'
    with pytest.raises(
        InputError, match=r"90 feathers with quills of .* on a bone of 58 mm. Give up to 4[0-9]"
    ):
        groom_of(tmp_path, WING.replace('type = "pigeon"', kind) + "fold = 0\n")


def test_folding_without_a_hinge_is_refused(tmp_path: Path) -> None:
    groom = replace(groom_of(tmp_path, WING + "fold = 0\n"), joints=())
    with pytest.raises(InputError, match="is no joint that folds"):
        folding(groom, {"joints": "*", "folds": [{"time": 0.0, "fold": 0.0}]}, "shot.toml")


TAIL = """
[[tail]]
id = "tail"
position = [-0.1, 0, 0.1]
kind = "rectrix"
lengths = [0.118, 0.112]
root_width = 0.02
fan = {}
"""
CREST = """
[[crest]]
id = "crest"
path = [[0.15, 0, 0.3], [0.13, 0, 0.31], [0.11, 0, 0.305]]
lengths = [0.03, 0.05, 0.035]
count = 9
raise = {}
"""


COVERTS = """
coverts = [
    { name = "upper_1", length = 0.5, ahead = 0.02, height = 0.02 },
    { name = "upper_2", length = 0.36, ahead = 0.1, height = 0.025 },
    { name = "under_1", side = "below", length = 0.6, ahead = 0, height = 0.02 },
    { name = "under_2", side = "below", length = 0.42, ahead = 0, height = 0.03 },
]
"""


@pytest.mark.parametrize("text", [TAIL, TAIL + "arch = 20\n" + COVERTS, CREST])
def test_fans_open_in_a_shot_as_in_the_groom(tmp_path: Path, text: str) -> None:
    closed, opened = (groom_of(tmp_path, re.sub("{}", str(value), text)) for value in (0.0, 1.0))
    keys = [{"time": 0.0, "fold": 1.0}, {"time": 1.0, "fold": 0.0}]
    poses = folding(closed, {"joints": "*", "folds": keys}, "shot.toml")
    frames = joint_roots(closed, skeleton_of(closed), poses).frames(1.0)
    for k, feather in enumerate(opened.feathers):
        np.testing.assert_allclose(frames.rotations[k], feather.rotation, atol=1e-9)
        np.testing.assert_allclose(frames.positions[k], feather.position, atol=1e-9)


def test_tail_is_the_fan_that_it_says_on_both_sides(tmp_path: Path) -> None:
    text = TAIL.format(1) + "angles = [12, 100]\n"
    tail = {f.id: f for f in groom_of(tmp_path, text).feathers}
    assert len(tail) == 12
    outer = [tail[f"tail_{side}_06"].rotation[:, 0] for side in ("right", "left")]
    # feathers stand in the middle of their sixths of half the fan
    assert np.degrees(np.arccos(outer[0] @ outer[1])) == pytest.approx(100 * 11 / 12)
    assert outer[0][1] < 0 < outer[1][1]


@pytest.mark.parametrize("fan", [0, 1])
def test_tail_coverts_lie_in_rows_over_and_under_the_tail(tmp_path: Path, fan: int) -> None:
    found = groom_of(tmp_path, TAIL.format(fan) + COVERTS).feathers
    tail = {f.id: f for f in found}
    assert len(tail) == 12 * 5
    for sort, sign in (("upper", 1.0), ("under", -1.0)):
        heights = []
        for row in ("", f"{sort}_1_", f"{sort}_2_"):
            own = [tail[f"tail_{side}_{row}{k:02d}"] for side in ("right", "left") for k in (1, 6)]
            assert all((f.rotation[2, 2] > 0.7) == (sign > 0 or not row) for f in own)
            ways = np.linspace(0.0, 0.9, 5)[:, None]
            points = np.stack([f.position + f.kind.length * ways * f.rotation[:, 0] for f in own])
            heights.append(sign * (points[:, :, 2] - 0.1))
        # the lowest of a row over the highest of the one before, wherever they meet
        assert heights[1].min() > heights[0].max()
        assert heights[2][:, 0].min() > heights[1][:, 0].max()


def test_a_tail_has_pairs(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="11 is odd, a tail has pairs of feathers"):
        groom_of(tmp_path, TAIL.format(0) + "count = 11\n")


@pytest.mark.slow
@pytest.mark.parametrize(
    "text",
    [
        *(WING + f"fold = {fold}\n" for fold in (0, 0.25, 0.5, 1)),
        *(TAIL.format(fan) + more for fan in (0, 1) for more in ("", COVERTS)),
    ],
)
def test_no_vane_passes_through_another(tmp_path: Path, text: str) -> None:
    groom_of(tmp_path, text)
    export_groom(tmp_path / "groom.toml", tmp_path / "wing.usdc", quality="draft", instances=False)
    (found,) = count_crossings(tmp_path / "wing.usdc")
    assert found["crossings"] == 0, found["worst"]


def test_feathers_of_the_upper_arm_take_a_share_of_what_the_forearm_leaves_the_plane(tmp_path):
    groom = groom_of(tmp_path, WING + "fold = 0\n")
    skeleton = skeleton_of(groom)
    elbow = skeleton.names.index("right_wing_elbow")
    hinge = groom.joints[elbow - 1].hinge
    hinge = hinge / np.linalg.norm(hinge)
    aside = np.cross(hinge, (0.0, 1.0, 0.0))
    rows = {name: [] for name in ("tertials", "secondaries")}
    for number, feather in enumerate(groom.feathers):
        if feather.region in rows:
            rows[feather.region].append(number)

    def turned(axis):
        poses = still_poses(len(skeleton.names))
        poses.rotations[elbow] = from_rotation_vector(np.radians(20.0) * axis)
        roots = joint_roots(groom, skeleton, lambda time: poses).frames(0.0)
        rest = np.array([each.rotation for each in groom.feathers])
        return np.degrees(rotation_vectors(roots.rotations @ rest.swapaxes(1, 2)))

    within = turned(hinge)
    for row in rows.values():
        assert within[row] == pytest.approx(np.tile(20.0 * hinge, (len(row), 1)), abs=1e-9)
    tilted = turned(aside / np.linalg.norm(aside))
    assert np.linalg.norm(tilted[rows["secondaries"]], axis=1) == pytest.approx(20.0)
    inwards = sorted(rows["tertials"], key=lambda number: groom.feathers[number].id)
    shares = np.linalg.norm(tilted[inwards], axis=1) / 20.0
    assert (np.diff(shares) < 0.0).all()
    # from half beside the elbow to half of that in the middle of the upper arm
    assert shares[[0, -1]] == pytest.approx([0.48, 0.225], abs=1e-6)


def test_feathers_fit_the_bones_between_landmarks(tmp_path):
    """Landmarks twice as far apart carry feathers of twice the length, unless a scale is given."""
    usual, far = (
        WING
        + "".join(
            f"{name} = {(SHOULDER + size * (np.array(place) - SHOULDER)).tolist()}\n"
            for name, place in zip(("elbow", "wrist", "tip"), PLACES, strict=True)
        )
        for size in (1.0, 2.0)
    )
    lengths = [
        np.mean([f.kind.length for f in flight(groom_of(tmp_path, text))])
        for text in (usual, far, far + "scale = 1\n", usual + "scale = 1\n")
    ]
    assert lengths[1] == pytest.approx(2.0 * lengths[0])
    assert lengths[2] == pytest.approx(lengths[3])
