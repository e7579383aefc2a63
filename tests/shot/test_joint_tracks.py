"""Tracks of joints: angles of a flap come back, rates are those of the motion, quaternions turn."""

import json

import numpy as np
import pytest
from commands import invoke
from places import SAMPLES

from featherfx.algebra.vectors import quats_to_frames
from featherfx.api import read_shot
from featherfx.shot.motion.joint_tracks import find_tracks, frame_rows

SHOT = SAMPLES / "swan_wing/shot.toml"


def flapping(**values):
    return read_shot(SHOT).replace(motion={"base": "flap", **values}, frames=[1, 49])


def test_the_angles_of_a_flap_come_back_on_both_sides():
    """raised = offset + amplitude cos(phase), swept = sweep cos, twisted = twist sin."""
    keys = {"stroke_amplitude": 80, "elevation": {"mean": 5}, "sweep": {"harmonics": [[9, 0]]}}
    tracks = find_tracks(flapping(**keys, twist={"harmonics": [[0, 20]]}))
    # ramps of a quarter of a beat end at rest; after them the phase is the time
    late = tracks.times > 0.3
    phase = 2.0 * np.pi * tracks.times[late]
    for side in ("left", "right"):
        wing = tracks.wings[side]
        np.testing.assert_allclose(
            np.degrees(wing.elevation[late]), 5.0 + 40.0 * np.cos(phase), atol=1e-9
        )
        np.testing.assert_allclose(np.degrees(wing.sweep[late]), 9.0 * np.cos(phase), atol=1e-9)
        np.testing.assert_allclose(np.degrees(wing.twist[late]), 20.0 * np.sin(phase), atol=1e-9)
        assert wing.span_ratio.max() == 1.0
        assert wing.span_ratio.min() < 0.95
        assert wing.downstroke == pytest.approx(0.5, abs=0.02)


def test_rates_are_those_of_a_swing_about_a_pivot():
    """A pivot at r from the axis that turns by A sin(w t): speed A w r, turn A w."""
    amplitude, frequency = np.radians(10.0), 2.0
    keys = {"kind": "swing", "joints": "right_elbow", "axis": [0, 0, 1], "angle": 10.0}
    shot = read_shot(SHOT).replace(
        motion={**keys, "frequency": frequency, "ramp_periods": 1.0}, frames=[1, 49]
    )
    rates = find_tracks(shot).largest_rates()
    omega = 2.0 * np.pi * frequency
    groom = {joint.name: joint.position for joint in shot.groom.joints}
    reach = np.linalg.norm(groom["right_wrist"][:2] - groom["right_elbow"][:2])
    assert rates["right_elbow"]["speed"] == pytest.approx(0.0, abs=1e-9)
    assert rates["right_elbow"]["turn"] == pytest.approx(amplitude * omega, rel=2e-3)
    assert rates["right_wrist"]["speed"] == pytest.approx(amplitude * omega * reach, rel=2e-3)
    assert rates["left_wrist"] == {"speed": 0.0, "turn": 0.0, "acceleration": 0.0}


def test_rows_and_commands_hold_the_same(tmp_path):
    told = json.loads(invoke("lab", "motion", SHOT, "--json").stdout)
    shot = read_shot(SHOT)
    tracks = find_tracks(shot)
    assert told["frames"] == json.loads(json.dumps(list(frame_rows(shot, tracks))))
    assert told["frames"][0]["wings"]["left"]["downstroke"] == tracks.wings["left"].downstroke
    assert [row["frame"] for row in told["frames"]] == list(range(1, 25))
    last = told["frames"][-1]["joints"]["right_wrist"]
    np.testing.assert_allclose(
        quats_to_frames(np.array(last["rotation"])), tracks.rotations[-1, 6], atol=1e-12
    )
    assert told["rates"] == tracks.largest_rates()
    explained = json.loads(invoke("check", "--explain", SHOT, "--json").stdout)
    assert explained["motion"] == tracks.largest_rates()
    assert "falls for" in invoke("lab", "motion", SHOT).stdout
