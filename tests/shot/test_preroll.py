"""The way into a shot: from rest in the pose of the first frame to its motion."""

from dataclasses import dataclass

import numpy as np
import pytest

from featherfx.algebra.vectors import from_rotation_vector
from featherfx.shot.frames import StageClock
from featherfx.shot.roots import RootFrames, RunUpRoots, run_up_of
from featherfx.shot.sources import TimedSurface

PREROLL = 0.4  # s, 12 of 30 frames a second
TOLERANCE = 1e-4
SPEED = 12.0


class Beat:
    """Roots along two wings that beat by 32 degrees, 2.5 times a second, on a body that flies."""

    spans = np.array([-0.6, -0.3, 0.0, 0.3, 0.6])

    def __init__(self, phase=0.0, speed=SPEED):
        self.phase, self.speed = phase, speed

    def angle(self, time):
        return np.radians(32.0) * np.sin(2 * np.pi * 2.5 * time + self.phase)

    def frames(self, time):
        turns = [
            from_rotation_vector(np.array([np.sign(span) * self.angle(time), 0.0, 0.0]))
            for span in self.spans
        ]
        arms = np.array(
            [turn @ [0.0, span, 0.0] for turn, span in zip(turns, self.spans, strict=True)]
        )
        return RootFrames(arms + np.array([self.speed * time, 0.0, 0.0]), np.array(turns))


def led(motion):
    return RunUpRoots(motion, run_up_of(motion, PREROLL, TOLERANCE))


@pytest.mark.parametrize("phase", [0.0, 0.6, 2.6, -1.2])
def test_it_begins_in_the_pose_of_the_first_frame_and_turns_no_farther_than_a_fifth(phase):
    motion = Beat(phase)
    roots, first = led(motion), motion.frames(0.0)
    begin = roots.frames(-PREROLL)
    np.testing.assert_allclose(begin.rotations, first.rotations, atol=1e-12)
    np.testing.assert_allclose(np.ptp(begin.positions - first.positions, axis=0), 0.0, atol=1e-12)
    # and at rest there
    after = roots.frames(-PREROLL + 1e-4)
    assert np.abs(after.positions - begin.positions).max() < 1e-8
    times = np.linspace(-PREROLL, 0.0, 200)
    turned = [roots.frames(time).rotations[-1] for time in times]
    angles = np.array([np.arctan2(turn[2, 1], turn[1, 1]) for turn in turned])
    own = np.array([motion.angle(-way * 0.2 * PREROLL) for way in np.linspace(0, 1, 50)])
    assert angles.min() > own.min() - 1e-3
    assert angles.max() < own.max() + 1e-3


@pytest.mark.parametrize("phase", [0.0, 2.6])
def test_it_arrives_with_the_motions_velocity_and_acceleration(phase):
    motion, h = Beat(phase), 1e-4
    roots = led(motion)

    def rates(source):
        two, one, now = (source.frames(-k * h) for k in (2, 1, 0))
        for each in zip(two, one, now, strict=True):
            yield (3 * each[2] - 4 * each[1] + each[0]) / (2 * h)
            yield (each[2] - 2 * each[1] + each[0]) / h**2

    for found, wanted in zip(rates(roots), rates(motion), strict=True):
        assert np.abs(found - wanted).max() < 0.01 * np.abs(wanted).max() + 1e-3


def test_a_body_that_flies_is_never_blown_from_behind():
    """Its speed rises from 0 to that of the first frame, and has no more."""
    times = np.linspace(-PREROLL, 0.0, 100)
    places = np.array([led(Beat()).frames(time).positions[2] for time in times])
    speeds = np.diff(places[:, 0]) / np.diff(times)
    assert speeds.min() > -1e-6
    assert speeds.max() < SPEED + 1e-6
    np.testing.assert_allclose(places[0], [-0.5 * SPEED * PREROLL, 0, 0], atol=1e-6)


def test_wings_of_a_body_that_stands_stay_on_it():
    """What all roots have in common is nothing there."""
    roots = led(Beat(0.3, speed=0.0))
    for time in np.linspace(-PREROLL, 0.0, 20):
        np.testing.assert_allclose(roots.frames(time).positions[2], 0.0, atol=1e-12)


def test_what_stands_at_the_first_frame_needs_no_run_up():
    assert run_up_of(Beat(0.5 * np.pi, speed=0.0), 1e-4, TOLERANCE) is None


@dataclass(frozen=True)
class Plate:
    """A plate that flies. speed: m/s."""

    speed: float
    time_codes_per_second = 1.0

    def points(self, code):
        return np.eye(3) + np.array([self.speed * code, 0.0, 0.0])


@pytest.mark.parametrize(("speed", "farther"), [(SPEED, 0.5 * SPEED * PREROLL), (0.0, 0.0)])
def test_bodies_that_move_are_led_as_the_roots_are_and_the_ground_stays(speed, farther):
    run_up = run_up_of(Beat(), PREROLL, TOLERANCE)
    surface = TimedSurface(Plate(speed), StageClock()).brought_up(run_up, TOLERANCE)
    for time, back in ((-PREROLL, farther), (0.0, 0.0)):
        way = surface.points(time) - Plate(speed).points(0.0)
        np.testing.assert_allclose(way[:, 0], -back, atol=1e-6)
    np.testing.assert_allclose(surface.points(0.2), Plate(speed).points(0.2))
