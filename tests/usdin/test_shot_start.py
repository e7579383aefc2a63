"""A shot that begins in mid-flight: no kick at its first frame, nor at any other.

What is written follows the skin as it is drawn, along straight lines between its own frames.
"""

import creature
import numpy as np
import pytest
from scipy.interpolate import CubicSpline

import featherfx
from featherfx.shot.loop.simulate import simulate

FIRST, SUBFRAMES = creature.FIRST, 8
STEP = 1.0 / (creature.RATE * SUBFRAMES)


def flight(folder, make=creature.sampled, subframes=SUBFRAMES, **changes):
    """Points and velocities (K, 2, 3) of root and tip of one feather, and the simulation."""
    shot = featherfx.read_shot(creature.write_shot(folder, make, count=1, **changes))
    run = simulate(shot, subframes=subframes)
    frames = list(run)
    ends = [0, -1]
    points = np.array([frame.rows[0][ends, 0] for frame in frames])
    return points, np.array([frame.row_velocities[0][ends, 0] for frame in frames]), run


@pytest.mark.parametrize(
    "make", [pytest.param(creature.sampled, marks=pytest.mark.slow), creature.skinned]
)
def test_velocities_are_those_of_the_points(tmp_path, make):
    """From the first frame on, against splines through the samples of each frame, at whose ends
    the lines of the skin turn."""
    beat = round(creature.RATE / creature.BEAT)
    fine = 2 * SUBFRAMES  # splines through fewer samples miss the kinks by 0.6 percent
    frames = (FIRST, FIRST + beat)
    points, velocities, run = flight(tmp_path, make, subframes=fine, frames=frames)
    times = STEP * SUBFRAMES / fine * np.arange(fine + 1)
    speeds = np.linalg.norm(velocities, axis=2)
    for k in range(0, len(points) - 1, fine):
        curve = CubicSpline(times, points[k : k + fine + 1])
        off = np.linalg.norm(curve(times[:-1], 1) - velocities[k : k + fine], axis=2)
        assert off.max() < 0.003 * speeds.min()
    # tips go as their roots do, at the first frame and at all others
    assert (speeds[:, 1] < 1.05 * speeds[:, 0]).all()
    assert (speeds[:, 1] > 0.95 * speeds[:, 0]).all()
    assert np.abs(np.diff(speeds, axis=0)).max() < 0.02 * creature.SPEED
    assert run.report["substeps_over_tolerance"] == 0


@pytest.mark.parametrize("preroll", [0, 6])
def test_the_first_frame_has_the_motions_velocity(tmp_path, preroll):
    """Also without any preroll, where the settled feather is carried by its root."""
    _, velocities, _ = flight(tmp_path, more=f"preroll = {preroll}", frames=(FIRST, FIRST + 1))
    np.testing.assert_allclose(velocities[0, :, 0], creature.SPEED, rtol=0.01)
    speeds = np.linalg.norm(velocities, axis=2)
    # the air of the flight bends a feather that was settled at rest
    assert np.abs(speeds[:, 1] - speeds[:, 0]).max() < 0.1 * creature.SPEED


def test_a_skin_that_is_held_starts_and_stops_without_a_kick(tmp_path):
    frames = (FIRST - 4, creature.LAST + 6)
    _, velocities, _ = flight(tmp_path, skin='extrapolation = "hold"', frames=frames)
    speeds = np.linalg.norm(velocities, axis=2)
    assert speeds[0].max() < 1e-9
    assert speeds[: 2 * SUBFRAMES, 0].max() < 1e-6
    # the skin that is drawn starts and stops at once, and its feathers with it, without lagging
    own = np.arange(len(speeds)) // SUBFRAMES + frames[0]
    moves = (own >= FIRST) & (own < creature.LAST)
    assert speeds[moves, 0].min() > 0.95 * creature.SPEED
    assert speeds[~moves, 0].max() < 0.005 * creature.SPEED
    lag = velocities[:, 1] - velocities[:, 0]
    assert np.linalg.norm(lag, axis=1).max() < 0.05 * creature.SPEED
    assert np.linalg.norm(lag[-1]) < 0.01 * creature.SPEED
