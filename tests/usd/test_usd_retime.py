"""A cache in another time holds the motion that it was made of."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import feathers
import numpy as np
import pytest
from commands import invoke

import featherfx
from featherfx.baking import pipeline
from featherfx.errors import InputError
from featherfx.feather.types import both
from featherfx.shot.frames import FeatherPose, Frame
from featherfx.usd.read.cache import Cache
from featherfx.usd.write.cache_writer import CacheWriter
from featherfx.usd.write.options import WriteOptions

RATE, PERIOD = 24.0, 12


def angle(frame, derivative, drift):
    """Of the feather about y: a swing of PERIOD frames and one that dies out, and rates by s."""
    w, k = 2.0 * np.pi * RATE / PERIOD, 8.0
    time = (frame - 1) / RATE
    swing = 0.3 * w**derivative * np.sin(w * time + 0.5 * np.pi * derivative)
    return swing + drift * (-k) ** derivative * np.exp(-k * time)


def posed(frame, drift=0.0):
    """The feather, its velocity and acceleration at a frame, exactly."""
    a, rate, bend = (angle(frame, d, drift) for d in range(3))
    place = feathers.placed((0, 0, 0), a)
    ahead = feathers.placed((0, 0, 0), a + 0.5 * np.pi)
    plane = np.array((1, 0, 1))
    velocity = both(lambda part: part * plane * rate, ahead)
    acceleration = both(
        lambda part, other: part * plane * bend - other * plane * rate**2, ahead, place
    )
    return FeatherPose(place, velocity, acceleration)


@pytest.fixture(scope="module")
def swings(tmp_path_factory: pytest.TempPathFactory) -> dict[float, Path]:
    """Thirty-two frames of a swing; with a part that dies out, and without."""
    folder, paths = tmp_path_factory.mktemp("swings"), {}
    entry = replace(feathers.entries()[0], rest_points=feathers.rest_points())
    for drift in (0.0, 0.05):
        paths[drift] = folder / f"swing{drift:g}.usdc"
        options = WriteOptions(accelerations=True, layout="clips", chunk=10)
        with CacheWriter(paths[drift], [entry], (1, 32), RATE, options) as writer:
            for number in range(1, 33):
                writer.write(Frame(number, (number - 1) / RATE, (posed(number, drift),)))
    return paths


def wanted(frame, drift=0.0):
    """(V, 3) points and velocities of the mesh at any frame of the cache, exactly."""
    surface, pose = feathers.surface(), posed(frame, drift)
    return surface.points(pose.points), surface.points(pose.velocities)


@pytest.mark.parametrize(
    ("options", "first", "speed", "last"),
    [({"speed": 0.25}, 1.0, 0.25, 125), ({"keys": [(1, 32), (63, 1)]}, 32.0, -0.5, 63)],
)
def test_slow_and_backwards_lie_on_the_motion(tmp_path, swings, options, first, speed, last):
    out = featherfx.retime(swings[0.0], tmp_path / "out.usda", **options)
    assert pipeline.check(out) == []
    cache, step = Cache(out), 2.0 * np.pi / PERIOD
    assert cache.frames == (1.0, last)
    # errors of a cubic with exact slopes, by the greatest fourth derivative, here by a frame
    fourth = 0.15 * 0.3 * step**4
    for frame in (1, 2, 3, 38, 55, last):
        points, velocities = wanted(first + speed * (frame - 1))
        pose = cache.pose(0, float(frame))
        assert np.abs(pose.points - points).max() < fourth / 384.0
        assert np.abs(pose.velocities - speed * velocities).max() < fourth / 100.0 * RATE


def test_keys_ease_in(tmp_path, swings):
    """Velocities are the differences of the points, where time speeds up."""
    keys = [(10, 1), (50, 6), (90, 26)]
    cache = Cache(featherfx.retime(swings[0.05], tmp_path / "out.usdc", keys=keys))
    assert cache.frames == (10.0, 90.0)
    frames = np.arange(10, 91)
    points = np.array([cache.pose(0, float(each)).points for each in frames])
    speeds = np.array([cache.pose(0, float(each)).velocities for each in frames])
    differences = (points[2:] - points[:-2]) * RATE / 2.0
    assert np.abs(speeds[1:-1] - differences).max() < 0.05 * np.abs(speeds).max()


def test_a_loop_ends_as_it_begins(tmp_path, swings):
    out = featherfx.retime(swings[0.05], tmp_path / "loop.usda", loop=2 * PERIOD)
    assert pipeline.check(out) == []
    cache = Cache(out)
    assert cache.frames == (1.0, 1.0 + 2 * PERIOD)
    one, other = cache.pose(0, 1.0), cache.pose(0, 1.0 + 2 * PERIOD)
    np.testing.assert_allclose(one.points, other.points, atol=1e-7)
    np.testing.assert_allclose(one.velocities, other.velocities, atol=1e-5)
    # the beginning is untouched; before its end the part that dies out comes back, smoothly
    points, velocities = wanted(32.0 - 2 * PERIOD, 0.05)
    np.testing.assert_allclose(one.points, points, atol=1e-7)
    np.testing.assert_allclose(one.velocities, velocities, atol=1e-5)
    for frame in range(2, 2 * PERIOD + 1):
        before, now, after = (cache.pose(0, frame + k) for k in (-1.0, 0.0, 1.0))
        middle = (after.points - before.points) * RATE / 2.0
        assert np.abs(now.velocities - middle).max() < 0.06 * 0.1 * 0.3 * 2 * np.pi * RATE / PERIOD


def test_a_loop_of_another_period_is_refused(tmp_path):
    """Its roots stand elsewhere then: a cache whose feathers are carried along."""
    path = tmp_path / "carried.usdc"
    with CacheWriter(path, feathers.entries()[:1], (1, 9), RATE) as writer:
        for number in range(1, 10):
            pose = posed(number)
            moved = pose.points.shifted(np.array((0.01 * number, 0.0, 0.0)))
            writer.write(Frame(number, (number - 1) / RATE, (pose._replace(points=moved),)))
    with pytest.raises(InputError, match="40 % of its feather's length away at frame 5"):
        featherfx.retime(path, tmp_path / "out.usdc", loop=4)
    assert not (tmp_path / "out.usdc").exists()


@pytest.mark.parametrize(
    ("options", "code", "told"),
    [
        ([], 2, "one of --speed, --keys and --loop"),
        (["--speed", "1", "--loop", "3"], 2, "one of"),
        (["--keys", "1:1,a"], 2, "no list of keys"),
        (["--keys", "1:1"], 1, "at least two"),
        (["--keys", "1:1,5:4,3:6"], 1, "new frame 3 after 5"),
        (["--keys", "1:1,9:99"], 1, "frame 99, the cache has 1 to 32"),
        (["--keys", "1:1,1e9:4"], 1, "at most 1000000"),
        (["--speed", "0"], 2, "x>0"),
        (["--speed", "nan"], 1, "above 0"),
        (["--speed", "1e-9"], 1, "allowed 3.1e-05 to 31"),
        (["--loop", "31"], 1, "at least 33. This one has 32"),
    ],
)
def test_wrong_times_are_refused(tmp_path, swings, options, code, told):
    out = tmp_path / "out.usdc"
    result = invoke("retime", swings[0.0], "-o", out, *options)
    assert (result.exit_code, out.exists()) == (code, False)
    assert told in result.output
