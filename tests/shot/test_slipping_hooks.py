"""Vanes whose hooks slip, in shots: slip stays, and nothing loses it silently."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from places import SAMPLES

from featherfx.shot.loop.simulate import Checkpoint, Simulation, simulate
from featherfx.shot.read.read import read_shot
from featherfx.shot.types import LevelOfDetail, Shot

SAMPLE = SAMPLES / "feather_pull"
LAST = 6


def pulled(hooks: str, weaker: float = 1.0) -> Shot:
    """A coarse feather pulled aside by its tip; weaker: divides yield and strength of the hooks."""
    shot = read_shot(SAMPLE / "shot.toml")
    one = shot.groom.feathers[0]
    vane = one.kind.vane_material
    vane = replace(
        vane,
        hooks=hooks,
        hook_yield_across=vane.hook_yield_across / weaker,
        hook_yield_shear=vane.hook_yield_shear / weaker,
        hook_strength=vane.hook_strength / weaker,
    )
    one = replace(one, kind=replace(one.kind, vane_material=vane))
    return replace(
        shot,
        groom=replace(shot.groom, feathers=(one,)),
        first_frame=0,
        last_frame=LAST,
        quality=replace(shot.quality.pushing, rows=11, columns=3, coefficients=1, simulated_rows=0),
    )


def run(shot: Shot, **values: object) -> tuple[Simulation, np.ndarray]:
    simulation = simulate(shot, **values)
    return simulation, np.stack([frame.rows[0] for frame in simulation])


def slip_of(simulation: Simulation) -> np.ndarray:
    """Of the state that a checkpoint keeps, after the last step."""
    return simulation.checkpoint().states[0].gaps.slip[0]


def test_hooks_that_hold_give_the_motion_of_closed_ones() -> None:
    _, closed = run(pulled("closed"))
    simulation, points = run(pulled("slip", 1e-3))
    assert np.abs(slip_of(simulation)).max() == 0.0
    np.testing.assert_allclose(points, closed, atol=1e-9)


def test_slip_is_kept_by_checkpoints_to_the_bit(tmp_path: Path) -> None:
    shot = pulled("slip", 1e3)
    simulation, points = simulate(shot), []
    for frame in simulation:
        points.append(frame.rows[0])
        if frame.number == LAST // 2:
            early = np.abs(slip_of(simulation)).max()
            simulation.checkpoint().save(tmp_path / "state.npz")
    assert 0.0 < early < np.abs(slip_of(simulation)).max()
    assert np.abs(np.stack(points) - run(pulled("closed"))[1]).max() > 1e-6
    going_on, rest = run(shot, start=Checkpoint.load(tmp_path / "state.npz"))
    np.testing.assert_array_equal(np.stack(points)[LAST // 2 + 1 :], rest)
    np.testing.assert_array_equal(slip_of(going_on), slip_of(simulation))


def test_models_from_the_store_are_those_that_were_computed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("featherfx.files.disk_cache.cache_folder", lambda: tmp_path)
    _, computed = run(pulled("slip", 1e3))
    assert list(tmp_path.glob("content/models.*"))
    np.testing.assert_array_equal(computed, run(pulled("slip", 1e3))[1])


def test_no_camera_changes_the_level_of_a_vane_that_slips() -> None:
    values = dict.fromkeys(("coarse_below", "rachis_below", "guided_below", "rigid_below"), 0.0)
    values |= {"pixels_per_metre": 1.0, "rachis_below": 10.0, "image_height": 1e3}
    rules = LevelOfDetail(camera=None, outside="rigid", margin=0.1, motion=0.0, **values)
    seen = {
        hooks: simulate(replace(pulled(hooks), grips=(), level_of_detail=rules)).options[0]
        for hooks in ("closed", "slip")
    }
    assert [each.level for each in seen.values()] == ["rachis", "full"]
