"""Feathers at rest are skipped, and everything that disturbs them wakes them in the same frame."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from places import SAMPLES

from featherfx.shot.loop.simulate import Simulation, simulate
from featherfx.shot.patterns import Force, Grip
from featherfx.shot.read.read import read_shot
from featherfx.shot.types import Motion, Shot

SAMPLE = SAMPLES / "feather_pull" / "shot.toml"
STILL, MOVED = 4, 8


def quiet_shot() -> Shot:
    """One coarse feather that hangs in still air for eight frames."""
    shot = read_shot(SAMPLE)
    return replace(
        shot,
        first_frame=0,
        last_frame=MOVED,
        motion=Motion("hold", {}),
        quality=replace(shot.quality.pushing, rows=9, columns=3, coefficients=1),
        gravity=np.array([0.0, 0.0, -9.81]),
        grips=(),
    )


def run(shot: Shot) -> tuple[Simulation, np.ndarray]:
    simulation = simulate(shot)
    return simulation, np.stack([frame.rows[0] for frame in simulation])


def slept(simulation: Simulation) -> int:
    return int(simulation.report["skipped"]["sleeping feather frames"])


def test_a_feather_at_rest_sleeps_and_stays_where_the_full_result_is() -> None:
    asleep, points = run(quiet_shot())
    awake, full = run(replace(quiet_shot(), sleep=False))
    assert slept(asleep) >= MOVED - 2
    assert slept(awake) == 0
    assert np.abs(points - full).max() < 1e-3 * quiet_shot().quality.tolerance * MOVED


def led(shot: Shot) -> Shot:
    """A keyframed root that stands still until frame 4 and then moves."""
    start, end = STILL / shot.frames_per_second, MOVED / shot.frames_per_second
    still = {"joint": "", "rotation": None}
    keys = [
        {"time": start, "position": (0.0, 0.0, 0.0), **still},
        {"time": end, "position": (0.0, 0.02, 0.0), **still},
    ]
    return replace(shot, motion=Motion("keys", {"keyframes": keys}))


def pulled(shot: Shot) -> Shot:
    rate = shot.frames_per_second
    grip = Grip(
        feather=shot.groom.feathers[0].id,
        row=1.0,
        column=0.0,
        side="leading",
        displacement=np.array([0.0, 0.01, 0.0]),
        start=STILL / rate,
        end=MOVED / rate,
        stiffness=500.0,
    )
    return replace(shot, grips=(grip,))


def forced(shot: Shot, line: str = "point", column: float = 0.0) -> Shot:
    rate = shot.frames_per_second
    force = Force(
        feather=shot.groom.feathers[0].id,
        force=np.array([0.0, 0.0, 0.05 if line == "point" else 0.5]),
        line=line,
        row=0.8,
        column=column,
        side="leading",
        span=(0.0, 1.0),
        keys=((STILL / rate, 0.0), (MOVED / rate, 1.0)),
    )
    return replace(shot, forces=(force,))


def forced_barb_end(shot: Shot) -> Shot:
    return forced(shot, column=1.0)


def forced_line(shot: Shot) -> Shot:
    return forced(shot, line="rachis")


class Breath:
    """Air that begins to move at frame 4, everywhere alike."""

    def velocity(self, points: np.ndarray, time: float) -> np.ndarray:
        speed = 6.0 * max(0.0, 24.0 * time - STILL)
        return np.tile([0.0, 0.0, speed], (len(points), 1))


def blown(shot: Shot) -> Shot:
    wind = replace(shot.wind, speed=0.0, gust=0.0, air_density=1.2)
    return replace(shot, wind=wind, wind_source=Breath())


@pytest.mark.parametrize("disturb", [led, pulled, forced, forced_barb_end, forced_line, blown])
def test_roots_grips_forces_and_wind_wake_it(disturb) -> None:
    shot = disturb(quiet_shot())
    asleep, points = run(shot)
    _, full = run(replace(shot, sleep=False))
    assert slept(asleep) >= STILL - 2
    moved = np.abs(full[MOVED] - full[0]).max()
    assert moved > 5e-3
    # waking from exact rest and going on from almost-rest differ by what rest may move
    assert np.abs(points - full).max() < 1e-3 * moved


def test_gusts_never_let_it_sleep() -> None:
    shot = quiet_shot()
    wind = replace(shot.wind, speed=3.0, gust=0.3, air_density=1.2)
    windy, points = run(replace(shot, wind=wind))
    assert slept(windy) == 0
    assert np.abs(np.diff(points, axis=0)).max() > 0.0
