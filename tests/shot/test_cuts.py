"""Roots and colliders that are somewhere else in no time."""

from __future__ import annotations

import warnings
from dataclasses import dataclass, replace

import numpy as np
import pytest
from places import SAMPLES

from featherfx.algebra.interpolation import Knots
from featherfx.errors import InputWarning
from featherfx.shot.clock import StageClock
from featherfx.shot.contact.bodies import Bodies, FeathersOver
from featherfx.shot.loop.simulate import simulate
from featherfx.shot.motion.cuts import CutRoots
from featherfx.shot.motion.motion import root_motion
from featherfx.shot.read.read import read_shot
from featherfx.shot.roots import RootFrames, Roots, arrived, root_rates
from featherfx.shot.sources import TimedSurface
from featherfx.shot.types import Motion

SAMPLE = SAMPLES / "flapping_bird" / "shot.toml"
FRAME = 1.0 / 30.0
SPEED = np.array([3.0, 0.5, 0.0])
AWAY = np.array([-4.0, 2.0, 1.0])
CUT = 5  # between this frame and the next


@dataclass(frozen=True)
class Flight:
    """Roots that fly straight on at one speed, through samples at whole frames, and from one frame
    to the next are somewhere else."""

    at_rest: RootFrames
    away: np.ndarray
    parts = ()

    def frames(self, time: float) -> RootFrames:
        stencil = Knots(0.0, FRAME, 0, 40).stencil(time)
        samples = [SPEED * t + self.away * (t > (CUT + 0.5) * FRAME) for t in stencil.times]
        return RootFrames(
            self.at_rest.positions + stencil.place(np.array(samples)), self.at_rest[1]
        )


def roots(away, lengths=0.2):
    at_rest = RootFrames(np.zeros((2, 3)), np.tile(np.eye(3), (2, 1, 1)))
    return CutRoots(Flight(at_rest, away), np.full(2, lengths), FRAME, 40)


def test_a_cut_has_no_speed_and_leaves_no_trace_in_the_curves_beside_it():
    cut, straight = roots(AWAY), roots(np.zeros(3)).motion
    assert [k for k in range(40) if cut.finder.cut(k).any()] == [CUT]
    for time in np.arange(0.0, 12.0, 0.25) * FRAME:
        passed = AWAY * (time > (CUT + 1e-3) * FRAME)
        expected = straight.frames(time).positions + passed
        np.testing.assert_allclose(cut.frames(time).positions, expected, atol=1e-12)
    at = CUT * FRAME
    there = straight.frames(at).positions + AWAY
    np.testing.assert_allclose(arrived(cut, at).positions, there, atol=1e-12)
    _, first, second = root_rates(cut, at, at + FRAME)
    np.testing.assert_allclose(first.positions, [SPEED, SPEED], atol=1e-9)
    np.testing.assert_allclose(second.positions, 0.0, atol=1e-6)


@pytest.mark.parametrize(("away", "lengths"), [(0.5 * SPEED * FRAME, 0.01), (AWAY, 6.0)])
def test_what_is_slow_or_within_a_feathers_length_is_no_cut(away, lengths):
    cut = roots(away, lengths)
    assert not any(cut.finder.cut(k).any() for k in range(40))
    time = (CUT + 0.5) * FRAME
    assert np.array_equal(cut.frames(time).positions, cut.motion.frames(time).positions)


class Beat:
    """Roots that beat up and down by a metre in four frames, in which they stand twice at either of
    two heights."""

    def frames(self, time: float) -> RootFrames:
        height = np.cos((0.5 * time / FRAME + 0.25) * np.pi)
        return RootFrames(np.tile([0.0, 0.0, height], (2, 1)), np.tile(np.eye(3), (2, 1, 1)))


def test_a_fast_beat_is_no_cut():
    beat = CutRoots(Beat(), np.full(2, 0.2), FRAME, 40)
    moved = [beat.moved(k)[0] for k in range(4)]
    assert max(moved) > 1.4
    assert min(moved) < 1e-9
    assert not any(beat.finder.cut(k).any() for k in range(40))


def flight(away):
    """Two feathers that touch each other, on roots that fly."""
    shot = read_shot(SAMPLE)
    kept = tuple(f for f in shot.groom.feathers if f.id in ("right_primary_02", "right_primary_03"))
    at_rest = RootFrames(
        *(np.stack([getattr(f, n) for f in kept]) for n in ("position", "rotation"))
    )
    return replace(
        shot,
        groom=replace(shot.groom, feathers=kept),
        skin=Flight(at_rest, away),
        quality=replace(shot.quality.pushing, rows=7, columns=2, coefficients=1),
        wind=replace(shot.wind, air_density=0.0),
        contact=replace(shot.contact, skin=False),
        preroll=0,
    )


def test_feathers_go_through_a_cut_as_if_there_were_none():
    with pytest.warns(InputWarning, match=r"root of feather 'right_primary_0\d' and 1 more: cut"):
        cut = list(simulate(flight(AWAY), 1, (1, 9)))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        whole = list(simulate(flight(np.zeros(3)), 1, (1, 9)))
    for number, (own, other) in enumerate(zip(cut, whole, strict=True)):
        passed = AWAY * (number > CUT)
        for f in range(2):
            moved = own.points[f] - other.points[f]
            assert np.abs(moved[:, [0]] - passed).max() < 1e-6
            assert np.abs(own.velocities[f] - other.velocities[f]).max() < 1e-3


@dataclass(frozen=True)
class Board:
    """A board that is a metre away, until it stands within the wing."""

    path = "/board"
    rest = np.array([[-1.0, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]])
    triangles = np.array([[0, 1, 2], [0, 2, 3]])
    time_codes_per_second = 1.0

    def points(self, code: float) -> np.ndarray:
        return self.rest - np.array([0.0, 0.0, 1.0]) * (code < (CUT + 0.5) * FRAME)


def test_a_collider_that_is_elsewhere_is_no_wall_that_moves():
    shot = flight(np.zeros(3))
    feathers = FeathersOver(np.arange(2), np.zeros((2, 1, 1, 3)), np.full(2, 0.3), np.zeros((2, 3)))
    bodies = Bodies(replace(shot, colliders=(TimedSurface(Board(), StageClock()),)), feathers)
    bodies.begun = True
    states = next(iter(simulate_states(shot)))
    for k in range(10):
        (wall,) = bodies.walls(states, k * FRAME, (k + 1) * FRAME, 1e-3)
        assert np.array_equal(wall.start, wall.end)
        assert wall.beginning == (k == CUT)
        level = 0.0 if k >= CUT else -1.0
        assert np.all(wall.end[:, 2] == level)
    with pytest.warns(InputWarning, match="collider /board: cut to another place at frame 7, 1 m"):
        bodies.warn(CUT, 7.0)


def simulate_states(shot):
    simulation = simulate(shot, 1, (1, 1))
    yield [group.state for group in simulation._run.groups]


def keyed(way: float, turn: float = 9.0, after: float = 0.0) -> Roots:
    """Roots of a bird whose body keyframes move within a frame, from rest to rest. turn: deg, for
    each metre; after: s, from the next frame to the keyframe there."""
    shot = read_shot(SAMPLE)
    places = {0.0: 0.0, 5 * FRAME: 0.0, 6 * FRAME + after: way, 9 * FRAME: way}
    keys = [
        {"joint": "body", "time": time, "position": [x, 0.0, 0.0], "rotation": [0.0, 0.0, turn * x]}
        for time, x in places.items()
    ]
    return root_motion(replace(shot, motion=Motion("keys", {"keyframes": keys})))


@pytest.mark.parametrize(
    ("way", "turn", "after"), [(4.6, 9.0, 0.0), (4.6, 9.0, 7e-5), (1e-4, 9e5, 7e-5)]
)
def test_keyframes_cut_from_place_to_place_without_swinging(way, turn, after):
    """By 4.6 m, with a key just after its frame, or by a quarter turn alone."""
    cut, start = keyed(way, turn, after), keyed(0.0).frames(0.0)
    shot = read_shot(SAMPLE)
    finder = CutRoots(cut, np.array([f.kind.length for f in shot.groom.feathers]), FRAME, 12).finder
    assert [k for k in range(12) if finder.cut(k).any()] == [5]
    assert finder.cut(5).all()
    for frame in (1.0, 3.5, 5.0):
        for found, at_rest in zip(cut.frames(frame * FRAME), start, strict=True):
            np.testing.assert_allclose(found, at_rest, atol=1e-12)
    there = cut.frames(9 * FRAME)
    for frame in (6.0, 7.5, 12.0):
        for found, then in zip(cut.frames(frame * FRAME), there, strict=True):
            np.testing.assert_allclose(found, then, atol=1e-12)


def test_keyframes_that_are_near_each_other_are_one_curve():
    """A hop of a centimetre in a frame is a motion within that frame, not a cut."""
    hop, start = keyed(0.01), keyed(0.0).frames(0.0).positions
    assert np.abs(hop.frames(5.0 * FRAME).positions - start).max() < 1e-12
    ways = [np.abs(hop.frames((5 + u) * FRAME).positions - start).max() for u in (0.25, 0.5, 0.75)]
    assert 1e-4 < ways[0] < ways[1] < ways[2]
