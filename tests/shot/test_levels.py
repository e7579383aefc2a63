"""Levels of detail, and rows that the solver chooses."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from places import SAMPLES

from featherfx.errors import InputError
from featherfx.feather.build import build_feather
from featherfx.groom.presets.kinds import Change, adjusted
from featherfx.mechanics.batch import make_model
from featherfx.mechanics.model import no_loads
from featherfx.mechanics.resolution import ROW_NUMBERS, rachis_deflection, rows_for
from featherfx.shot.loop.simulate import Simulation, simulate
from featherfx.shot.options import length_factor
from featherfx.shot.patterns import Detail
from featherfx.shot.read.read import check_file, read_shot
from featherfx.shot.roots import end_rates
from featherfx.shot.types import Motion, Shot
from featherfx.solver.solver import Settings, Solver
from featherfx.solver.state import rest_state


def shaken(frames: int = 6) -> Shot:
    """A swan primary whose root swings, 13 rows."""
    shot = read_shot(SAMPLES / "feather_pull" / "shot.toml")
    swing = {
        "amplitude": 0.03,
        "frequency": 3.0,
        "direction": (0.0, 0.0, 1.0),
        "ramp_periods": 0.25,
    }
    return replace(
        shot,
        first_frame=0,
        last_frame=frames,
        grips=(),
        gravity=np.array([0.0, 0.0, -9.81]),
        motion=Motion("shake", swing),
        quality=replace(shot.quality.pushing, rows=21, columns=4, coefficients=1, simulated_rows=0),
    )


def led(velocity: tuple[float, float, float], frames: int = 10, turn: float = 0.0) -> Shot:
    """A root that moves evenly from the first frame on."""
    shot = shaken(frames)
    end = frames / shot.frames_per_second
    keys = [
        {"time": 0.0, "joint": "", "position": (0.0, 0.0, 0.0), "rotation": (0.0, 0.0, 0.0)},
        {
            "time": end,
            "joint": "",
            "position": tuple(end * v for v in velocity),
            "rotation": (0.0, 0.0, turn),
        },
    ]
    return replace(shot, motion=Motion("keys", {"keyframes": keys}))


def run(shot: Shot) -> tuple[Simulation, np.ndarray]:
    simulation = simulate(shot)
    return simulation, np.stack([frame.rows[0] for frame in simulation])


def apart(first: np.ndarray, second: np.ndarray) -> float:
    """Largest distance of any point, directors left out, m."""
    return float(np.linalg.norm(np.delete(first - second, (1, 2), axis=2), axis=-1).max())


def test_full_detail_and_no_detail_are_the_same_bytes() -> None:
    plain, named = shaken(), replace(shaken(), details=(Detail(level="full"),))
    assert run(plain)[1].tobytes() == run(named)[1].tobytes()
    many = replace(plain, quality=replace(plain.quality, simulated_rows=21))
    assert run(plain)[1].tobytes() == run(many)[1].tobytes()


@pytest.mark.parametrize(("level", "allowed"), [("coarse", 0.01), ("rachis", 0.02), ("rigid", 0.1)])
def test_less_detail_keeps_the_mesh_and_stays_near(level: str, allowed: float) -> None:
    shot = shaken()
    _, full = run(shot)
    simulation, less = run(replace(shot, details=(Detail(feathers="feat*", level=level),)))
    assert less.shape == full.shape
    assert simulation.feathers[0].rows == 21
    assert simulation.options[0].level == level
    length = shot.groom.feathers[0].kind.length
    assert 0.0 < apart(less, full) < allowed * length


def test_lengths_choose_levels_and_patterns_win() -> None:
    shot = shaken(1)
    length = shot.groom.feathers[0].kind.length
    for below, level in (
        ({}, "full"),
        ({"coarse_below": 1.1 * length}, "coarse"),
        ({"coarse_below": 2.0, "rachis_below": 1.1 * length}, "rachis"),
        ({"coarse_below": 2.0, "rachis_below": 0.9 * length}, "coarse"),
        ({"rachis_below": 2.0, "rigid_below": 1.1 * length}, "rigid"),
    ):
        chosen = replace(shot, quality=replace(shot.quality, **below))
        assert run(chosen)[0].options[0].level == level
    pinned = replace(
        chosen, details=(Detail(level="rachis"), Detail(feathers="feather", level="full"))
    )
    assert run(pinned)[0].options[0].level == "full"


def test_lengths_of_a_quality_grow_with_the_body() -> None:
    """The creature of 2.8 m: with lengths for a bird of 0.45 m nothing of it was short."""
    shot = shaken(1)
    groom, own = shot.groom, shot.groom.feathers[0].kind.length
    quality = replace(shot.quality, coarse_below=2.0 * own, guided_below=0.9 * own)
    box = np.array([[[0.0, 0.0, 0.0], [0.3, 0.0, 0.2], [0.3, 0.1, 0.0]]])
    size = float(np.sqrt(0.3**2 + 0.1**2 + 0.2**2))
    for scale, level in ((0.4, "full"), (1.0, "coarse"), (1.2, "guided")):
        larger = replace(groom, skin=scale * box)
        chosen = replace(shot, groom=larger, quality=replace(quality, body_size=size))
        assert length_factor(chosen) == pytest.approx(scale)
        if level != "guided":
            assert simulate(chosen).options[0].level == level
    # as they are, whatever the body; and of a feather that is all there is, its length
    fixed = replace(shot, groom=replace(groom, skin=40.0 * box), quality=quality)
    assert length_factor(fixed) == 1.0
    alone = replace(shot, quality=replace(quality, body_size=0.5 * own))
    assert length_factor(alone) == pytest.approx(2.0)


def test_a_rigid_feather_is_its_rest_shape_with_the_rates_of_its_root() -> None:
    shot = replace(led((1.0, 0.0, 0.5), turn=90.0), details=(Detail(level="rigid"),))
    simulation = simulate(shot)
    frames = list(simulation)
    fine = list(simulate(shot, subframes=32))
    distances = np.linalg.norm(frames[-1].rows[0][1:, 0] - frames[-1].rows[0][0, 0], axis=1)
    rest = simulation.feathers[0].rest.nodes
    assert distances == pytest.approx(np.linalg.norm(rest[1:, 0] - rest[0, 0], axis=1), rel=1e-12)
    assert simulation.report["skipped"]["rigid feather frames"] == len(frames)
    step = 1.0 / shot.frames_per_second / 32
    before, now, after = (fine[128 + k].rows[0] for k in (-1, 0, 1))
    assert now == pytest.approx(frames[4].rows[0], abs=1e-12)
    for frame in (frames[4], fine[128]):
        assert frame.row_velocities[0] == pytest.approx((after - before) / (2.0 * step), abs=1e-2)
        bend = (after - 2.0 * now + before) / step**2
        assert frame.row_accelerations[0] == pytest.approx(bend, abs=0.5)


def test_rates_at_the_end_are_exact_for_polynomials() -> None:
    times = np.linspace(0.3, 0.7, 5)
    first, second = end_rates(times)
    for power in range(5):
        values = times**power
        assert first @ values == pytest.approx(power * 0.7 ** max(power - 1, 0), abs=1e-9)
        exact = power * (power - 1) * 0.7 ** max(power - 2, 0)
        assert second @ values == pytest.approx(exact, abs=1e-8)


def test_wrong_details_are_told(tmp_path: Path) -> None:
    (tmp_path / "groom.toml").write_text((SAMPLES / "feather_pull" / "groom.toml").read_text())
    text = (SAMPLES / "feather_pull" / "shot.toml").read_text()
    detail = '[[detail]]\nfeathers = "covert_*"\nlevel = "rigid"\n[[detail]]\nlevel = "none"\n'
    detail += '[[detail]]\nregion = "nowhere"\nkind = "swan_*"\nlevel = "guided"\n'
    (tmp_path / "shot.toml").write_text(text + detail)
    keys = sorted(problem.key for problem in check_file(tmp_path / "shot.toml"))
    assert keys == ["detail[0].feathers", "detail[1].level", "detail[2].region"]


def test_a_rigid_feather_cannot_be_pulled() -> None:
    shot = read_shot(SAMPLES / "feather_pull" / "shot.toml")
    with pytest.raises(InputError, match="'feather' is rigid, but a grip"):
        list(simulate(replace(shot, details=(Detail(level="rigid"),))))


@pytest.mark.parametrize("stiffer", [1.0, 100.0])
def test_rows_follow_stiffness_and_tolerance(stiffer: float) -> None:
    """Fewer for stiff shafts and loose tolerances; the error stays below five tolerances."""
    shot = shaken()
    placement = shot.groom.feathers[0]
    material = replace(
        placement.kind.rachis_material,
        youngs_modulus=stiffer * placement.kind.rachis_material.youngs_modulus,
    )
    kind = replace(placement.kind, rachis_material=material)
    groom = replace(shot.groom, feathers=(replace(placement, kind=kind),))
    shot = replace(
        shot, groom=groom, quality=replace(shot.quality.pushing, rows=41, tolerance=1e-4)
    )
    auto = replace(shot, quality=replace(shot.quality, simulated_rows=-1))
    simulation, chosen = run(auto)
    _, full = run(shot)
    rows = simulation.options[0].rows
    assert rows == (8 if stiffer == 1.0 else 6)
    assert chosen.shape == full.shape
    assert apart(chosen, full) < 5e-4
    loose = replace(auto, quality=replace(auto.quality, tolerance=1e-2))
    assert run(loose)[0].options[0].rows <= rows


def test_rows_are_of_the_list_and_at_most_those_asked_for() -> None:
    assert rows_for(0.0, 1e-4, 41) == ROW_NUMBERS[0]
    assert rows_for(1.0, 1e-9, 41) == 41
    assert rows_for(1.0, 1e-9, 30) == 30
    assert rows_for(1.0, 1e-9, 4000) == 4000
    picked = [rows_for(1e-2, tolerance, 400) for tolerance in (1e-2, 1e-3, 1e-4, 1e-5)]
    assert picked == sorted(picked)
    assert all(count in ROW_NUMBERS for count in picked)


@pytest.mark.parametrize("scale", [1.0, 0.3])
def test_the_estimated_deflection_is_that_of_a_settled_feather(scale: float) -> None:
    """A cantilever's formula against statics; small loads, so within the vane's share of it."""
    kind = adjusted(shaken().groom.feathers[0].kind, Change(scale=scale))
    feather = build_feather(kind, 21, 4)
    model = make_model([feather], [kind], 1)
    start = rest_state(model, np.zeros((1, 3)), np.eye(3)[None])
    with Solver(model, Settings(newton=1e-9)) as solver:
        loads = no_loads(1, (0.0, 0.0, -9.81))
        state, status, _ = solver.equilibrium(start, loads)
    assert status[0] == 0
    sag = np.linalg.norm(state.points.nodes[0, -1, 0] - start.points.nodes[0, -1, 0])
    assert rachis_deflection(feather, kind, 9.81, 0.0) == pytest.approx(sag, rel=0.3)
