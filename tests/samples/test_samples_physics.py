"""The three samples as physics: what the feathers do, from the frames of a simulation."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from typing import NamedTuple

import numpy as np
import pytest
from places import SAMPLES

from featherfx.algebra.types import Array
from featherfx.feather.types import Feather, barb_slice
from featherfx.shot.frames import place
from featherfx.shot.loads import grip_fraction
from featherfx.shot.loop.simulate import simulate
from featherfx.shot.motion.motion import root_motion
from featherfx.shot.read.read import read_shot
from featherfx.shot.types import Shot


class Film(NamedTuple):
    """A shot's feathers and, per feather, points and velocities of its nodes
    (frames, n, 1 + 2 m, 3), directors (frames, n, 2, 3), and the shaft as it is simulated
    (frames, rows, 3)."""

    shot: Shot
    feathers: tuple[Feather, ...]
    points: tuple[Array, ...]
    velocities: tuple[Array, ...]
    directors: tuple[Array, ...]
    shafts: tuple[Array, ...]

    @property
    def times(self) -> Array:
        return np.arange(len(self.points[0])) / self.shot.frames_per_second

    def index(self, name: str) -> int:
        return [placement.id for placement in self.shot.groom.feathers].index(name)


@cache
def film(sample: str) -> Film:
    shot = read_shot(SAMPLES / sample / "shot.toml")
    simulation = simulate(shot)
    frames, shafts = [], []
    for frame in simulation:
        frames.append(frame)
        simulated = simulation.simulated()
        shafts.append([simulated[k][1].nodes[:, 0].copy() for k in sorted(simulated)])
    assert [frame.number for frame in frames] == list(range(shot.first_frame, shot.last_frame + 1))
    count = range(len(shot.groom.feathers))
    return Film(
        shot,
        simulation.feathers,
        tuple(np.stack([frame.poses[k].points.nodes for frame in frames]) for k in count),
        tuple(np.stack([frame.poses[k].velocities.nodes for frame in frames]) for k in count),
        tuple(np.stack([frame.poses[k].points.directors for frame in frames]) for k in count),
        tuple(np.stack([each[k] for each in shafts]) for k in count),
    )


def barb_stretch(feather: Feather, points: Array) -> float:
    """Largest relative change of length of a barb segment over all frames."""
    worst, m = 0.0, feather.columns
    for side in range(2):
        nodes = np.concatenate([points[:, :, :1], points[:, :, barb_slice(side, m)]], axis=2)
        present = feather.barb_length[side] > 0.0
        length = np.linalg.norm(np.diff(nodes[:, present], axis=2), axis=3)
        rest = feather.barb_length[side, present, None] / m
        worst = max(worst, float(np.abs(length / rest - 1.0).max(initial=0.0)))
    return worst


def shaft_stretch(shaft: Array) -> float:
    """Largest relative change of the shaft's length against the first frame."""
    length = np.linalg.norm(np.diff(shaft, axis=1), axis=2).sum(axis=1)
    return float(np.abs(length / length[0] - 1.0).max())


SHOTS = ["swan_wing", "feather_pull", "breeze"]


@pytest.mark.parametrize("sample", SHOTS)
def test_everything_is_finite_and_no_barb_changes_its_length(sample):
    got = film(sample)
    for feather, points, velocities in zip(got.feathers, got.points, got.velocities, strict=True):
        assert np.isfinite(points).all()
        assert np.isfinite(velocities).all()
        assert barb_stretch(feather, points) < 1e-6
        assert shaft_stretch(points[:, :, 0]) < 0.01


@pytest.mark.parametrize("sample", SHOTS)
def test_roots_are_exactly_where_the_motion_puts_them(sample):
    got = film(sample)
    motion = root_motion(got.shot)
    for frame, time in enumerate(got.times):
        positions, rotations = motion.frames(time)
        for k, points in enumerate(got.points):
            assert points[frame, 0, 0] == pytest.approx(positions[k], abs=1e-9)
            assert got.directors[k][frame, 0] == pytest.approx(rotations[k].T[1:], abs=1e-9)


@pytest.mark.parametrize("sample", SHOTS)
def test_velocities_are_the_rates_of_the_points(sample):
    """Summed by the trapezoid rule, velocities give the way that the points have gone."""
    got = film(sample)
    step = 1.0 / got.shot.frames_per_second
    for points, velocities in zip(got.points, got.velocities, strict=True):
        summed = 0.5 * step * (velocities[1:] + velocities[:-1]).sum(axis=0)
        way = points[-1] - points[0]
        travelled = np.abs(np.diff(points, axis=0)).sum(axis=0).max()
        assert np.abs(summed - way).max() < 0.1 * travelled


def rigid_tips(got: Film, name: str) -> Array:
    """(frames, 3) rachis tip of a feather that would move with its root as a rigid body."""
    k, motion = got.index(name), root_motion(got.shot)
    tips = []
    for time in got.times:
        positions, rotations = motion.frames(time)
        tips.append(place(got.feathers[k].rest, positions[k], rotations[k]).nodes[-1, 0])
    return np.array(tips)


def arc(tips: Array) -> float:
    """Angle (deg) that a tip sweeps about the shoulder, seen along the body."""
    shoulder = np.array([-0.08, 0.05])
    y, z = -(tips[:, 1] - shoulder[0]), tips[:, 2] - shoulder[1]
    return float(np.ptp(np.degrees(np.arctan2(z, y))))


def test_the_outermost_primary_sweeps_the_arc_of_the_beat():
    """The shoulder swings by 35 deg to either side; elbow and wrist add a little."""
    got = film("swan_wing")
    name = max(p.id for p in got.shot.groom.feathers if p.id.startswith("right_primary"))
    tips, rigid = got.points[got.index(name)][:, -1, 0], rigid_tips(got, name)
    stroke = got.shot.motion.values["stroke_amplitude"]
    assert arc(tips) == pytest.approx(stroke, abs=8.0)
    assert arc(tips) == pytest.approx(arc(rigid), abs=4.0)
    # a primary yields to the beat, by little against its length of about 0.38 m
    bend = np.linalg.norm(tips - rigid, axis=1)
    assert 0.001 < bend.max() < 0.05
    # the last frame is a frame short of the beat's end: the tip is about where it began
    way = np.linalg.norm(tips - tips[0], axis=1)
    assert way[-1] < 0.1 * way.max()
    assert way[-1] == pytest.approx(np.linalg.norm(rigid[-1] - rigid[0]), abs=0.01)


def test_the_pulled_tip_follows_its_grip_and_bends_the_shaft():
    got = film("feather_pull")
    (grip,) = got.shot.grips
    tip = got.points[0][:, -1, 0]
    fraction = np.array([grip_fraction(grip, time) for time in got.times])
    target = tip[0] + fraction[:, None] * np.asarray(grip.displacement)
    assert np.linalg.norm(tip - target, axis=1).max() < 1e-3
    pull = np.linalg.norm(grip.displacement)
    assert np.linalg.norm(tip[-1] - tip[0]) > 0.95 * pull
    # the shaft bends on an arc: the middle follows by less than a straight lever would
    way = np.linalg.norm(got.points[0][-1, :, 0] - got.points[0][0, :, 0], axis=1)
    middle = way[len(way) // 2]
    assert 0.02 * pull < middle < 0.5 * pull
    assert (np.diff(way) > -1e-4).all()
    # nearly within the plane of the vane: the cambered shaft twists a little
    assert np.abs(got.points[0][:, :, 0, 2] - got.points[0][0, :, 0, 2]).max() < 0.1 * pull
    # of the rows that are simulated: chords of a mesh of fewer rows cut off the bend at the tip
    assert shaft_stretch(got.shafts[0]) < 5e-4


def test_a_plume_in_the_breeze_leans_downwind_and_answers_the_gusts():
    got = film("breeze")
    wind = np.asarray(got.shot.wind.direction)
    still = replace(got.shot, wind=replace(got.shot.wind, speed=0.0))
    (calm,) = list(simulate(still, frames=(still.first_frame, still.first_frame)))
    tips, rest = got.points[0][:, -1, 0], calm.rows[0][-1, 0]
    length = got.feathers[0].station[-1]
    lean = (tips - rest) @ wind
    assert 0.02 * length < lean.mean() < length
    late = tips[len(tips) // 2 :]
    response = np.sqrt(np.sum(np.var(late, axis=0)))
    assert 0.002 * length < response < 0.3 * length
    assert np.linalg.norm(tips, axis=1).max() < 1.01 * length
    speed = np.linalg.norm(got.velocities[0][:, -1, 0], axis=1)
    assert speed.max() < 3.0 * got.shot.wind.speed
