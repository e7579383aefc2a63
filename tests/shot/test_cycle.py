"""A shot that repeats is played again once it is periodic, and stepped again when it is not."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from places import SAMPLES

from featherfx.errors import InputWarning
from featherfx.shot.loop.simulate import Checkpoint, Simulation, simulate
from featherfx.shot.read.read import read_shot
from featherfx.shot.types import Grip, Motion, Shot

SAMPLE = SAMPLES / "feather_pull" / "shot.toml"
PERIOD, LAST = 6, 54


def cycling(speed: float = 0.0) -> Shot:
    """One coarse feather whose root swings once in six frames, and flies on at speed (m/s)."""
    shot = read_shot(SAMPLE)
    rate = shot.frames_per_second
    times = np.arange(4 * LAST + 1) / (4 * rate)
    swing = 0.004 * np.sin(2.0 * np.pi * rate / PERIOD * times)
    swing *= np.clip(times * rate / PERIOD, 0.0, 1.0)
    keys = [
        {"time": t, "joint": "", "position": (speed * t, 0.0, z), "rotation": None}
        for t, z in zip(times.tolist(), swing.tolist(), strict=True)
    ]
    return replace(
        shot,
        first_frame=0,
        last_frame=LAST,
        motion=Motion("keys", {"keyframes": keys}),
        quality=replace(shot.quality.pushing, rows=9, columns=3, coefficients=1),
        wind=replace(shot.wind, speed=0.0, gust=0.0, air_density=1.2),
        grips=(),
        cycle=PERIOD,
    )


def run(shot: Shot, start: Checkpoint | None = None) -> tuple[Simulation, np.ndarray]:
    simulation = simulate(shot, start=start)
    return simulation, np.stack([frame.rows[0] for frame in simulation])


@cache
def replayed(speed: float) -> tuple[Simulation, np.ndarray]:
    return run(cycling(speed))


def repeated(simulation: Simulation) -> int:
    return int(simulation.report["skipped"]["repeated feather frames"])


@pytest.mark.parametrize("speed", [0.0, 0.5])
def test_a_periodic_feather_is_replayed_within_the_tolerance(speed: float) -> None:
    shot = cycling(speed)
    played, points = replayed(speed)
    stepped, full = run(replace(shot, cycle=0))
    assert repeated(stepped) == 0
    assert repeated(played) > LAST // 3
    assert np.ptp(np.delete(full, (1, 2), axis=2)[-PERIOD:, -1, :, 2], axis=0).max() > 4e-3
    apart = np.abs(np.delete(points - full, (1, 2), axis=2)).max()
    assert 0.0 < apart <= shot.quality.tolerance


def test_replayed_cycles_are_equal_but_for_where_the_root_is() -> None:
    _, points = replayed(0.5)
    way = points[-1] - points[-1 - PERIOD]
    moved = 0.5 * PERIOD / cycling().frames_per_second
    np.testing.assert_allclose(np.delete(way, (1, 2), axis=1)[..., 0], moved, atol=1e-12)
    np.testing.assert_allclose(way[..., 1:], 0.0, atol=1e-12)


def test_a_pull_ends_it_in_the_same_frame() -> None:
    shot = cycling()
    rate, begin = shot.frames_per_second, LAST - 4
    grip = Grip(
        feather=shot.groom.feathers[0].id,
        row=1.0,
        column=0.0,
        side="leading",
        displacement=np.array([0.0, 0.03, 0.0]),
        start=begin / rate,
        end=LAST / rate,
        stiffness=20.0,
    )
    free = replace(grip, stiffness=1e-6, displacement=np.zeros(3))
    _, quiet = run(replace(shot, grips=(free,)))
    played, points = run(replace(shot, grips=(grip,)))
    _, full = run(replace(shot, grips=(grip,), cycle=0))
    moved = np.abs(full[begin + 1] - quiet[begin + 1]).max()
    assert moved > 5.0 * shot.quality.tolerance
    apart = np.abs(np.delete(points - full, (1, 2), axis=2)).max()
    assert apart < 2.0 * shot.quality.tolerance
    assert repeated(played) < LAST - PERIOD


def test_going_on_from_a_checkpoint_changes_no_bit(tmp_path: Path) -> None:
    shot = cycling()
    simulation = simulate(shot)
    points = []
    for frame in simulation:
        points.append(frame.rows[0])
        if frame.number == LAST // 2 + 1:
            simulation.checkpoint().save(tmp_path / "state.npz")
    going_on, rest = run(shot, Checkpoint.load(tmp_path / "state.npz"))
    np.testing.assert_array_equal(np.stack(points)[LAST // 2 + 2 :], rest)
    assert repeated(going_on) > 0


def test_a_cycle_of_the_wrong_length_is_told() -> None:
    with pytest.warns(InputWarning, match="repeat after 7 frames"):
        simulation, points = run(replace(cycling(), cycle=7))
    assert repeated(simulation) == 0
    np.testing.assert_array_equal(points, run(replace(cycling(), cycle=0))[1])


def test_feathers_that_do_not_become_periodic_are_told() -> None:
    """Of a tolerance that four cycles do not come within."""
    shot = replace(cycling(), last_frame=4 * PERIOD)
    strict = replace(shot, quality=replace(shot.quality, tolerance=1e-9, max_substeps=8))
    with pytest.warns(InputWarning, match="none has become periodic. Over the last 6 they changed"):
        assert repeated(run(strict)[0]) == 0


def test_gusts_are_never_replayed() -> None:
    shot = cycling()
    windy = replace(shot, wind=replace(shot.wind, speed=2.0, gust=0.3), last_frame=4 * PERIOD)
    with pytest.warns(InputWarning, match="cycle"):
        assert repeated(run(windy)[0]) == 0


def touching(speed: float) -> Shot:
    """Five feathers of a wing that touch each other, on the same way; wind from below presses them
    on each other."""
    alone, bird = cycling(speed), read_shot(SAMPLE.parents[1] / "flapping_bird" / "shot.toml")
    some = tuple(f for f in bird.groom.feathers if f.id.startswith("right_primary"))
    return replace(
        alone,
        groom=replace(bird.groom, feathers=some),
        contact=replace(bird.contact, steps=4),
        quality=replace(alone.quality, tolerance=1e-3),
    )


@pytest.mark.slow
def test_feathers_that_touch_are_replayed_together() -> None:
    shot = touching(0.5)
    played, points = run(shot)
    stepped, full = run(replace(shot, cycle=0))
    assert repeated(stepped) == 0
    assert repeated(played) > 5 * PERIOD
    assert repeated(played) % 5 == 0
    apart = np.abs(np.delete(points - full, (1, 2), axis=2)).max()
    assert 0.0 < apart <= shot.quality.tolerance


def test_a_replayed_island_goes_on_from_a_checkpoint(tmp_path: Path) -> None:
    shot, path = touching(0.0), tmp_path / "state.npz"
    simulation, points = simulate(shot), []
    for frame in simulation:
        points.append(frame.rows[0])
        if frame.number == LAST - 6:
            assert repeated(simulation) > 0
            simulation.checkpoint().save(path)
    resumed = [frame.rows[0] for frame in simulate(shot, start=Checkpoint.load(path))]
    np.testing.assert_array_equal(resumed, points[-len(resumed) :])
