"""Joints that attributes of a stage lead: splines, samples, units, axes, rates, and wrong ones."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import featherfx
from featherfx.errors import InputError
from featherfx.files.disk_cache import settings_digest, shot_settings
from featherfx.shot.motion.joint_tracks import find_tracks

STAGE = """#usda 1.0
(
    metersPerUnit = 0.01
    upAxis = "%s"
    startTimeCode = 1
    endTimeCode = 25
    timeCodesPerSecond = %d
)
def Xform "rig"
{
    double turn.spline = {
        1: 0; post linear,
        13: 90; post linear,
        25: 720; post held,
    }
    double3 xformOp:translate.timeSamples = { 1: (0, 0, 0), 13: (10, 20, 30) }
    quatf facing.timeSamples = { 1: (1, 0, 0, 0), 25: (0.70710678, 0, 0.70710678, 0) }
    float3 angles = (10, 20, 30)
    double3 holes.timeSamples = { 1: (0, 0, 0), 7: (0, nan, 0) }
    string word = "hi"
}
"""
GROOM = """name = "g"
[[feather]]
id = "a"
kind = "contour"
position = [0, 0, 0]
direction = [1, 0, 0]
up = [0, 0, 1]
"""
SHOT = """name = "s"
groom = "groom.toml"
frames = [1, 25]
[motion]
kind = "act"
[[motion.motions]]
kind = "curve"
usd = "rig.usda"
prim = "/rig"
"""
# of a stage whose y is up: its x, y and z in the groom's axes
Y_UP = np.array([[1, 0, 0], [0, 0, -1], [0, 1, 0]])


def read(folder, keys, up="Y", rate=24):
    (folder / "rig.usda").write_text(STAGE % (up, rate))
    (folder / "groom.toml").write_text(GROOM)
    (folder / "shot.toml").write_text(SHOT + keys)
    return featherfx.read_shot(folder / "shot.toml")


def pose(folder, keys, frame, up="Y", rate=24):
    """Place (3,) m and turn (3, 3) of the groom at a whole frame or half of one."""
    tracks = find_tracks(read(folder, keys, up, rate))
    row = round(8 * (frame - 1))
    return tracks.positions[row, 0], tracks.rotations[row, 0]


@pytest.mark.parametrize(("up", "axes"), [("Y", Y_UP), ("Z", np.eye(3))])
def test_attributes_lead_a_joint_in_the_axes_and_unit_of_their_stage(tmp_path, up, axes):
    place, turn = pose(tmp_path, 'attribute = "xformOp:translate"\nsets = "position"', 5.5, up)
    np.testing.assert_allclose(place, 0.375 * axes @ (0.1, 0.2, 0.3), atol=1e-12)
    np.testing.assert_array_equal(turn, np.eye(3))
    for keys, frame, expected in (
        ('attribute = "turn"\nsets = "rotation_y"', 7, ("y", 45.0)),
        ('attribute = "turn"\nsets = "rotation_y"', 16, ("y", 90.0 + 630.0 / 4.0)),
        ('attribute = "turn"\nsets = "rotation_x"', 25, ("x", 720.0)),
        ('attribute = "facing"\nsets = "rotation"', 13, ("y", 45.0)),
        ('attribute = "angles"\nsets = "rotation"\norder = "zxy"', 3, ("zxy", (30, 10, 20))),
    ):
        own = Rotation.from_euler(*expected, degrees=True).as_matrix()
        place, turn = pose(tmp_path, keys, frame, up)
        np.testing.assert_allclose(turn, axes @ own @ axes.T, atol=1e-6)
        np.testing.assert_array_equal(place, np.zeros(3))


@pytest.mark.parametrize(("time", "expected"), [("codes", 45.0), ("seconds", 142.5)])
def test_frames_of_other_rates_are_codes_or_seconds(tmp_path, time, expected):
    """At 48 codes a second frame 7 is code 7 or 14, and 52.5 degrees a code come after 13."""
    keys = f'attribute = "turn"\nsets = "rotation_z"\ntime = "{time}"'
    _, turn = pose(tmp_path, keys, 7, "Z", 48)
    np.testing.assert_allclose(Rotation.from_matrix(turn).magnitude(), np.radians(expected))
    with pytest.raises(InputError, match="has 48 time codes a second, the shot 24 frames_per_sec"):
        read(tmp_path, 'attribute = "turn"\nsets = "rotation_z"', rate=48)


def test_a_shot_depends_on_its_curve(tmp_path):
    keys = 'attribute = "turn"\nsets = "rotation_z"'
    first = settings_digest(shot_settings(read(tmp_path, keys)))
    assert first == settings_digest(shot_settings(read(tmp_path, keys)))
    shot = read(tmp_path, keys)
    (tmp_path / "rig.usda").write_text((STAGE % ("Y", 24)).replace("13: 90", "13: 80"))
    shot = featherfx.read_shot(tmp_path / "shot.toml")
    assert first != settings_digest(shot_settings(shot))


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        ('attribute = "tur"\nsets = "rotation_x"', r"no attribute 'tur' on /rig.*a number: turn"),
        ('attribute = "word"\nsets = "rotation"', r"/rig.word is not one vector or a quaternion"),
        ('attribute = "turn"\nsets = "rotation"', r"/rig.turn is not one vector or a quaternion"),
        ('attribute = "facing"\nsets = "position"', r"/rig.facing is not one vector, of finite"),
        ('attribute = "holes"\nsets = "position"', r"finite numbers, at time code 7"),
        (
            'attribute = "turn"\nsets = "rotation_x"\njoint = "x"',
            r"joint: no joint 'x' in the groom",
        ),
        ('attribute = "turn"\nsets = "yaw"', r"sets: 'yaw' is not allowed.*rotation_x"),
    ],
)
def test_what_no_curve_can_be(tmp_path, keys, message):
    with pytest.raises(InputError, match=message):
        read(tmp_path, keys)
