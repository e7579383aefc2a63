"""Feathers that were far from each other at rest and come to meet."""

from __future__ import annotations

import tracemalloc
from dataclasses import replace

import numpy as np
from test_contact_shots import THICKNESS, baked, bird

from featherfx.shot.contact.pairs import joined, meeting
from featherfx.shot.loop.simulate import Checkpoint, simulate
from featherfx.shot.types import Motion
from featherfx.solver.contact.meeting_kernels import cover_ways

PAIR = "right_primary_03", "left_primary_03"


def falling():
    """A feather of the left wing is swept over one of the right, and pressed down through it."""
    shot = bird()
    feathers = tuple(f for f in shot.groom.feathers if f.id in PAIR)
    right, left = (next(f for f in feathers if f.id == name) for name in PAIR)
    over = right.position - left.position + np.array([0.0, -0.08, 0.03])
    down = over - np.array([0.0, 0.0, 0.04])
    # s, m, m/s: it swings past and comes back, and is at no time held still
    places = (
        (0.0, np.zeros(3), [0.0, 0.0, 0.0]),
        (0.3, over, [0.0, -1.2, 0.06]),
        (0.4, over, [0.0, 0.4, -0.095]),
        (0.6, down, [0.0, 0.0, 0.0]),
    )
    keys = [
        {"time": time, "joint": "left_wrist", "position": list(at), "tangents": rates}
        for time, at, rates in places
    ]
    groom = replace(shot.groom, feathers=feathers)
    contact = replace(shot.contact, steps=0)
    quality = replace(shot.quality, tolerance=1e-3, coefficients=1)
    motion = Motion("keys", {"keyframes": keys})
    return replace(
        shot, groom=groom, motion=motion, contact=contact, last_frame=18, preroll=0, quality=quality
    )


def height_over(frame):
    """m, of the left feather's shaft over that of the right one, where they cross seen from above;
    of two that do not, where they are nearest."""
    right, left = (
        np.stack(
            [np.interp(np.linspace(0, len(p) - 1, 400), range(len(p)), x) for x in p[:, 0].T], 1
        )
        for p in frame.rows
    )
    away = np.linalg.norm(right[:, None, :2] - left[None, :, :2], axis=2)
    i, k = np.unravel_index(np.argmin(away), away.shape)
    return left[k, 2] - right[i, 2]


def test_feathers_that_meet_later_do_not_pass_and_a_checkpoint_knows_who_has_met(tmp_path):
    shot, frames = falling(), []
    simulation = simulate(shot, 1, (1, 18))
    for frame in simulation:
        frames.append(frame)
        if frame.number == 16:
            checkpoint = simulation.checkpoint()
            assert len(checkpoint.stages["contact"]["0.met"]) == 2
            checkpoint.save(tmp_path / "state.npz")
    contact = simulation.report["contact"]
    assert contact["most_contacts"] > 0
    _, without = baked(replace(shot, contact=None), 18)
    assert height_over(without[11]) > 0.02
    assert height_over(without[-1]) < -30.0 * THICKNESS
    assert contact["worst_depth"] < 0.5 * THICKNESS
    # between the nodes of the two shafts, where nothing is tested
    assert height_over(frames[-1]) > -2.0 * THICKNESS
    start = Checkpoint.load(tmp_path / "state.npz")
    for a, b in zip(frames[-2:], simulate(shot, 1, (17, 18), start=start), strict=True):
        assert all(np.array_equal(x, y) for x, y in zip(a.rows, b.rows, strict=True))


def test_steps_are_as_short_as_a_shot_allows():
    """For a tolerance that none keeps; what is hard to solve is halved once more."""
    shot = replace(falling(), last_frame=3)
    shot = replace(shot, quality=replace(shot.quality, tolerance=1e-8))
    for most in (2, 6):
        simulation, _ = baked(replace(shot, contact=replace(shot.contact, max_steps=most)), 3)
        shortest = 1.0 / (shot.frames_per_second * most)
        assert 0.5 * shortest * (1.0 - 1e-9) <= simulation.report["contact"]["shortest_step"]
        assert simulation.report["contact"]["shortest_step"] <= shortest * (1.0 + 1e-9)
        assert simulation.report["substeps_over_tolerance"] > 0


def test_boxes_that_meet_are_found():
    rng = np.random.default_rng(8)
    low = rng.random((300, 3))
    high = low + 0.2 * rng.random((300, 3))
    both = (low[:, None] <= high[None]).all(axis=2)
    expected = np.argwhere(np.triu(both & both.T, 1))
    assert len(expected) > 300
    assert np.array_equal(meeting(low, high), expected)
    assert meeting(low[:1], high[:1]).shape == (0, 2)


def test_parts_of_boxes_that_meet():
    rng = np.random.default_rng(9)
    for count, size in ((300, 0.05), (300, 0.2), (40, 0.6)):
        low = rng.random((count, 3))
        high = low + size * rng.random((count, 3))
        low[::7], high[::7] = low[0], high[0]
        before = rng.integers(0, 10 * count, count)
        pairs = [*meeting(low, high).tolist()]
        pairs += [(k, before.tolist().index(part)) for k, part in enumerate(before)]
        # the parts by their definition: whatever is linked has the same number, to the end
        expected = np.arange(count)
        for _ in range(count):
            last = expected.copy()
            for a, b in pairs:
                expected[[a, b]] = min(expected[a], expected[b])
            if np.array_equal(last, expected):
                break
        numbers = np.unique(expected, return_inverse=True)[1]
        assert numbers.max() > 0
        assert np.array_equal(joined(before, low, high), numbers)


def test_thousands_of_boxes_at_one_place_are_no_millions_of_pairs():
    place = np.repeat(np.arange(3.0), 20_000)[:, None] * np.ones(3)
    joined(np.arange(2), place[:2], place[:2] + 0.5)
    tracemalloc.start()
    parts = joined(np.arange(len(place)), place, place + 0.5)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert np.array_equal(parts, np.repeat(np.arange(3), 20_000))
    assert peak < 20e6


def test_boxes_cover_the_ways_of_feathers_and_of_their_roots():
    rng = np.random.default_rng(10)
    nodes, velocity = rng.normal(size=(2, 5, 4, 7, 3))
    samples = np.cumsum(rng.normal(size=(5, 6, 6)), axis=1)
    low, high = np.empty((2, 5, 3))
    cover_ways(nodes, velocity, samples, 0.3, 0.01, low, high)
    for f in range(5):
        points = nodes[f].reshape(-1, 3)
        size = np.linalg.norm(np.ptp(points, axis=0))
        led = np.abs(samples[f] - samples[f, 0]).max(axis=0)
        by_root = led[:3] + led[3:].sum() * size
        by_itself = 0.3 * np.abs(velocity[f]).max(axis=(0, 1))
        way = np.maximum(by_root, by_itself) + 0.01
        assert np.allclose(low[f], points.min(axis=0) - way, atol=1e-12)
        assert np.allclose(high[f], points.max(axis=0) + way, atol=1e-12)
