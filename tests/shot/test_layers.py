"""Layered plumage: what is shown lies over what is beneath it, as at rest."""

from __future__ import annotations

import warnings
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest
from shingled import THICKNESS, askew, depths, least_gap, shingles

from featherfx.errors import InputWarning
from featherfx.shot.layers import layers as laying
from featherfx.shot.loop.checkpoint import Checkpoint
from featherfx.shot.loop.simulate import simulate
from featherfx.shot.partition.partition import share_count
from featherfx.shot.types import Contact, Layers, Motion, Shot


@pytest.fixture(scope="module")
def bakes() -> tuple[Shot, list, list]:
    """The shot, its frames laid, and as they were without layers."""
    shot = shingles()
    return shot, list(simulate(shot)), list(simulate(replace(shot, layers=None)))


def test_each_lies_over_the_next(bakes):
    shot, laid, plain = bakes
    for frame, other in zip(laid, plain, strict=True):
        for k in range(len(shot.groom.feathers) - 1):
            assert least_gap(other.points[k], other.points[k + 1]) < 0.1 * THICKNESS
            # vanes that slope are nearer along their normal than along z
            assert least_gap(frame.points[k], frame.points[k + 1]) > 0.85 * THICKNESS


def test_roots_stay_and_no_lift_is_more_than_what_was_lacking(bakes):
    shot, laid, plain = bakes
    for frame, other in zip(laid, plain, strict=True):
        lack = depths(other.points) + THICKNESS
        assert lack > 3.0 * THICKNESS
        for k, (points, before) in enumerate(zip(frame.points, other.points, strict=True)):
            np.testing.assert_array_equal(points[0, 0], before[0, 0])
            beneath = len(shot.groom.feathers) - 1 - k
            # that of the rows around, a little more where they slope
            assert np.abs(points - before).max() < 1.3 * beneath * lack + 1e-12


def test_the_change_is_steady_and_is_part_of_the_velocities(bakes):
    """Lifts change no faster than the feathers bend, each a little more than the one beneath."""
    shot, laid, plain = bakes
    step = 1.0 / shot.frames_per_second
    for k in range(1, len(laid)):
        moves = [a - b for a, b in zip(plain[k].points, plain[k - 1].points, strict=True)]
        bent = max(np.abs(move[:, 0] - move[0, 0]).max() for move in moves)
        for f in range(len(shot.groom.feathers)):
            now, before = (laid[i].points[f] - plain[i].points[f] for i in (k, k - 1))
            way = np.abs(now - before).max()
            assert way < 2.0 * bent + 0.1 * THICKNESS
            added = np.abs(laid[k].velocities[f] - plain[k].velocities[f]).max() * step
            assert added == pytest.approx(way, rel=0.2, abs=0.1 * THICKNESS)


def test_what_stands_still_is_still_and_goes_on_from_a_checkpoint(tmp_path):
    shot = shingles()
    feathers = tuple(askew(each, k) for k, each in enumerate(shot.groom.feathers))
    held = Motion(
        "shake",
        {"amplitude": 0.0, "frequency": 3.0, "direction": (0.0, 0.0, 1.0), "ramp_periods": 0.25},
    )
    shot = replace(shot, groom=replace(shot.groom, feathers=feathers), motion=held)
    simulation = simulate(shot)
    laid = list(simulation)
    assert simulation.report["contact"]["pairs_touching"] >= len(laid)
    for frame in laid[1:]:
        for points, first in zip(frame.points, laid[0].points, strict=True):
            assert np.abs(points - first).max() < 1e-6
    begun = simulate(shot, frames=(0, 2))
    for _ in begun:
        pass
    begun.checkpoint().save(tmp_path / "state.npz")
    resumed = list(simulate(shot, start=Checkpoint.load(tmp_path / "state.npz")))
    for frame, other in zip(laid[3:], resumed, strict=True):
        for points, again in zip(frame.points, other.points, strict=True):
            assert points.tobytes() == again.tobytes()


def test_feathers_that_do_not_touch_are_left_as_they_are(bakes):
    shot, _, plain = bakes
    none = replace(shot, layers=Layers(Contact(THICKNESS, regions=("else*",))))
    for frame, other in zip(simulate(none), plain, strict=True):
        for points, before in zip(frame.points, other.points, strict=True):
            np.testing.assert_array_equal(points, before)


def test_the_report_tells_how_deep_what_is_written_is(bakes):
    shot, _, _ = bakes
    simulation = simulate(shot)
    for _ in simulation:
        pass
    told = simulation.report["contact"]
    depth = told["written_depth"]
    assert 0.0 <= depth["median"] <= depth["p99"] <= depth["worst"] < 0.5
    assert told["feathers_lifted"] == told["feathers_at_limit"] == 0
    assert told["worst_lifted"] == []
    # lifts that are asked for again sink more slowly than what is beneath
    assert told["pairs_touching"] >= len(range(shot.first_frame, shot.last_frame + 1)) * 3
    for each in told["pairs_deep"]:
        assert {each["feather"], each["other"]} <= {f"f{k}" for k in range(5)}
        assert each["depth"] <= depth["worst"]
        assert shot.first_frame <= each["frame"] <= shot.last_frame


def test_what_shares_compute_of_what_lies_beneath_is_said(bakes):
    shot, _, _ = bakes
    with pytest.warns(InputWarning, match="of 2 shares the largest 5 of 5 feathers"):
        assert share_count(shot, 2) == 2
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert share_count(shot, 1) == 1
        assert share_count(replace(shot, layers=None), 2) == 2


def test_the_same_bytes_by_threads_shares_and_from_a_checkpoint(bakes, tmp_path):
    shot, laid, _ = bakes
    threads = list(simulate(shot, jobs=3))
    share = list(simulate(shot, wanted=[1, 3]))
    begun = simulate(shot, frames=(0, 2))
    for frame, other in zip(begun, laid, strict=False):
        for points, again in zip(frame.points, other.points, strict=True):
            assert points.tobytes() == again.tobytes()
    begun.checkpoint().save(tmp_path / "state.npz")
    resumed = list(simulate(shot, start=Checkpoint.load(tmp_path / "state.npz")))
    for frame, other, part in zip(laid, threads, share, strict=True):
        for f, points in enumerate(frame.points):
            assert points.tobytes() == other.points[f].tobytes()
        for k, f in enumerate((1, 3)):
            assert part.points[k].tobytes() == frame.points[f].tobytes()
    for frame, other in zip(laid[3:], resumed, strict=True):
        for points, again in zip(frame.points, other.points, strict=True):
            assert points.tobytes() == again.tobytes()


def test_laid_while_the_next_is_simulated_it_is_the_same(bakes, tmp_path):
    shot, laid, _ = bakes
    with ThreadPoolExecutor(1) as pool:
        ahead = simulate(shot, jobs=2).ahead()
        found = [pool.submit(lambda finish=finish: list(finish())) for finish in ahead]
    frames, checkpoints = zip(*(pair for each in found for pair in each.result()), strict=True)
    checkpoints[2].save(tmp_path / "state.npz")
    resumed = list(simulate(shot, start=Checkpoint.load(tmp_path / "state.npz")))
    for frame, other in zip([*laid, *laid[3:]], [*frames, *resumed], strict=True):
        assert frame.number == other.number
        for points, again in zip(frame.points, other.points, strict=True):
            assert points.tobytes() == again.tobytes()


def test_samples_are_laid_one_by_one_up_to_the_last(bakes, monkeypatch):
    shot, frames, _ = bakes
    lay, numbers = laying.LayeredPlumage.lay, []

    def noted(self, frame):
        numbers.append(frame)
        return lay(self, frame)

    monkeypatch.setattr(laying.LayeredPlumage, "lay", noted)
    taken = 0
    for finish in simulate(shot).ahead():
        for frame, _ in finish():
            taken += 1
            assert numbers[taken - 1 :] == [frame.number]
    assert taken == len(frames)


def test_samples_that_wait_hold_only_what_is_asked_for(bakes):
    shot, laid, _ = bakes
    ahead = simulate(shot).ahead(saved=lambda sample: sample == 2, accelerations=False)
    pairs = [pair for finish in ahead for pair in finish()]
    for (frame, checkpoint), other in zip(pairs, laid, strict=True):
        assert (checkpoint is not None) == (frame.number == laid[2].number)
        for pose, again in zip(frame.poses, other.poses, strict=True):
            for part in ("points", "velocities"):
                for values, same in zip(getattr(pose, part), getattr(again, part), strict=True):
                    assert values.tobytes() == same.tobytes()
            assert pose.accelerations.nodes.size == 0 < again.accelerations.nodes.size
