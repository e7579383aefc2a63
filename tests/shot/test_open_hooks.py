"""Vanes that split in shots, and are preened shut: state, energies, what is written, bad input."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from places import SAMPLES
from split_vanes import compliance

from featherfx.baking.bake import bake
from featherfx.errors import InputError
from featherfx.feather.build import build_feather
from featherfx.mechanics.batch import make_model
from featherfx.mechanics.model import Gaps, Model, no_loads
from featherfx.shot.loop.simulate import Checkpoint, Simulation, simulate
from featherfx.shot.read.read import read_shot
from featherfx.shot.types import Shot
from featherfx.solver.solver import Settings, Solver, hold_roots
from featherfx.solver.state import rest_state
from featherfx.solver.step.gap_kernels import (
    DAMPED_ENERGY,
    OPENING_WORK,
    RELEASED_ENERGY,
    SLIP_WORK,
)

SAMPLE = SAMPLES / "feather_pull"
PULL = """
[[force]]
feather = "feather"
row = {row}
column = 1.0
force = [{force}, 0, 0]
keys = [[0, 0], [0.2, 1], [0.25, 0]]
"""
STROKES = """
[[preen]]
start = 0.4
end = 0.6
[[preen]]
start = 0.6
end = 0.8
"""
LAST, TORN = 22, 9


def write_shot(folder: Path, hooks: str = "open", more: str = STROKES, heal: float = 0.0) -> Path:
    """Two barbs of a coarse feather are pulled apart until the vane splits, then preened."""
    (folder / "groom.toml").write_text((SAMPLE / "groom.toml").read_text(encoding="utf-8"))
    material = f'hooks = "{hooks}", hook_release = 5e-6, hook_healing_rate = {heal}'
    path = folder / "shot.toml"
    path.write_text(
        f'name = "torn"\ngroom = "groom.toml"\nframes = [1, {LAST}]\nmotion = "hold"\n'
        'wind = "calm"\ngravity = [0, 0, 0]\n'
        'quality = { base = "preview", rows = 11, columns = 3, coefficients = 1 }\n'
        + f'[overrides]\n"*" = {{ vane_material = {{ {material} }} }}\n'
        + PULL.format(row=0.5, force=-1.0)
        + PULL.format(row=0.6, force=1.0)
        + more
    )
    return path


def shot_model(shot: Shot) -> Model:
    """Of its feather, as the shot simulates it."""
    feather = build_feather(shot.groom.feathers[0].kind, 11, 3)
    return make_model([feather], [shot.groom.feathers[0].kind], 1)


def gaps(simulation: Simulation) -> Gaps:
    """Of the state that a checkpoint keeps, after the last step."""
    return simulation.checkpoint().states[0].gaps_of(0)


@pytest.fixture(scope="module")
def shot(tmp_path_factory: pytest.TempPathFactory):
    return read_shot(write_shot(tmp_path_factory.mktemp("torn")))


@pytest.fixture(scope="module")
def run(shot, tmp_path_factory: pytest.TempPathFactory):
    """Points and gaps by frame, the report, and the file of a checkpoint while it is torn."""
    simulation, points, found = simulate(shot), [], []
    path = tmp_path_factory.mktemp("state") / "state.npz"
    for frame in simulation:
        points.append(frame.rows[0])
        found.append(Gaps(*(array.copy() for array in gaps(simulation))))
        if frame.number == TORN:
            simulation.checkpoint().save(path)
    return np.stack(points), found, simulation.report["hooks"], path


def test_the_vane_splits_and_is_preened_shut(run):
    _, found, report, _ = run
    assert (found[0].hooked == 1.0).all()
    assert (found[TORN - 1].hooked == 0.0).sum() >= 2
    assert (found[-1].hooked == 1.0).all()
    assert report["healed"] >= report["opened"] > 1e-3


def test_energies_are_accounted_and_none_is_won(run):
    _, found, report, _ = run
    spent = np.array([each.spent for each in found])
    assert (
        np.diff(spent[:, [SLIP_WORK, OPENING_WORK, RELEASED_ENERGY, DAMPED_ENERGY]], axis=0) >= 0.0
    ).all()
    assert report["damping_work"] > 0.0
    assert report["released_energy"] > 0.0
    assert report["slip_work"] + report["opening_work"] > 0.0
    names = ("slip_work", "opening_work", "released_energy", "preening_work", "damping_work")
    np.testing.assert_allclose(found[-1].spent, [report[name] for name in names])


def test_hooks_that_heal_close_gaps_whose_edges_touch(tmp_path):
    """Nothing strokes it, and the loads are gone after a quarter of a second."""
    healing = read_shot(write_shot(tmp_path, more="", heal=40.0))
    simulation = simulate(healing)
    for _ in simulation:
        pass
    report = simulation.report["hooks"]
    assert 0.0 < report["healed"] <= report["opened"] * (1.0 + 1e-9)


def test_changes_are_told_by_feather_and_frame(run):
    report = run[2]
    for key in ("opened", "healed"):
        assert sum(each[key] for each in report["changes"]) == pytest.approx(report[key])
    torn = {each["frame"] for each in report["changes"] if each["opened"] > 0.0}
    preened = {each["frame"] for each in report["changes"] if each["healed"] > 0.0}
    assert max(torn) < min(preened)
    assert min(preened) >= 1 + 0.4 * 24


def test_a_torn_vane_goes_on_from_a_checkpoint_to_the_bit(shot, run):
    points, found, _, path = run
    going_on = simulate(shot, start=Checkpoint.load(path))
    rest = np.stack([frame.rows[0] for frame in going_on])
    np.testing.assert_array_equal(points[TORN:], rest)
    for ours, theirs in zip(found[-1], gaps(going_on), strict=True):
        np.testing.assert_array_equal(ours, theirs)


@pytest.mark.nightly
def test_a_torn_vane_that_sleeps_stays_torn(tmp_path):
    shot = replace(read_shot(write_shot(tmp_path, more="")), last_frame=60)
    found = []
    for sleep in (True, False):
        simulation = simulate(replace(shot, sleep=sleep))
        for _ in simulation:
            pass
        assert (simulation.report["skipped"]["sleeping feather frames"] > 5) == sleep
        found.append(gaps(simulation))
    assert (found[0].hooked == 0.0).any()
    for ours, theirs in zip(found[0][:3], found[1][:3], strict=True):
        np.testing.assert_array_equal(ours, theirs)


def test_a_preened_vane_is_as_stiff_as_before(shot, run):
    """How far a small force along the shaft moves the end of the barb that was pulled, within 2 %;
    torn, it moves farther."""
    model = shot_model(shot)
    whole, torn, preened = (
        compliance(model, run[1][k], row=5, node=3, force=0.01) for k in (0, TORN - 1, -1)
    )
    assert torn > 1.05 * whole
    assert preened == pytest.approx(whole, rel=0.02)


@pytest.fixture(scope="module")
def baked(shot, tmp_path_factory: pytest.TempPathFactory):
    folder = tmp_path_factory.mktemp("baked")
    path = write_shot(folder)
    bake(path, folder / "torn.usdc", report=folder / "report.json")
    return folder


def test_lips_part_in_the_mesh_and_close_again(baked):
    from pxr import Usd, UsdGeom

    from featherfx.usd.check.check import check_file

    assert check_file(baked / "torn.usdc") == []
    stage = Usd.Stage.Open(str(baked / "torn.usdc"))
    (mesh,) = (UsdGeom.Mesh(p) for p in stage.Traverse() if p.IsA(UsdGeom.Mesh))
    rest = np.array(mesh.GetPrim().GetAttribute("primvars:rest").Get())
    _, place = np.unique(rest, axis=0, return_inverse=True)

    def apart(code):
        """m, between points that are one at rest."""
        points = np.array(mesh.GetPointsAttr().Get(code), dtype=float)
        return max(np.ptp(points[place == k], axis=0).max() for k in range(place.max() + 1))

    hooked = [np.array(mesh.GetPrim().GetAttribute("primvars:hooked").Get(k)) for k in (1, TORN)]
    assert (hooked[0] == 1.0).all()
    assert (hooked[1] == 0.0).any()
    assert apart(1) == 0.0
    assert max(apart(code) for code in range(2, TORN + 1)) > 1e-4
    assert apart(LAST) == 0.0
    report = json.loads((baked / "report.json").read_text())
    assert set(report["hooks"]) >= {"opened", "healed", "slip_work", "released_energy"}


def test_hooks_that_hold_beside_others_that_do_not_never_slip(tmp_path):
    each = [read_shot(write_shot(tmp_path, hooks, "")) for hooks in ("closed", "open")]
    kinds = [shot.groom.feathers[0].kind for shot in each]
    model = make_model([build_feather(kind, 11, 3) for kind in kinds], kinds, 1)
    loads = no_loads(2)._replace(force=np.zeros((2, *model.mass.shape[1:], 3)))
    loads.force[:, 5, 3, 0] = 0.5
    state = rest_state(model, np.zeros((2, 3)), np.tile(np.eye(3), (2, 1, 1)))
    with Solver(model, Settings(), 1) as solver:
        state, report = solver.step(state, loads, hold_roots(state), 0.1)
    assert not report.status.any()
    own, other = state.gaps_of(0), state.gaps_of(1)
    assert other.slip.any()
    assert not own.slip.any()
    assert not own.spent.any()
    assert (own.hooked == 1.0).all()


@pytest.mark.parametrize(
    ("hooks", "more", "message"),
    [
        ("closed", STROKES, "closes nothing"),
        ("open", "[[preen]]\nstart = 1\nend = 1\n", "not later than start"),
        ("open", "[[preen]]\nstart = -1\nend = 1\n", "start"),
        ("open", '[[preen]]\nfeathers = "tail"\nstart = 0\nend = 1\n', "no feather"),
        ("ajar", "", "hooks"),
    ],
)
def test_what_cannot_be_preened_is_told(tmp_path, hooks, more, message):
    with pytest.raises(InputError, match=message):
        read_shot(write_shot(tmp_path, hooks, more))


def test_a_split_is_not_drawn_where_it_is_not(tmp_path):
    with pytest.raises(InputError, match="drawn as it is simulated"):
        bake(write_shot(tmp_path), tmp_path / "torn.usdc", render_rows=30)


@pytest.mark.slow
def test_random_tears_end_sound(tmp_path: Path) -> None:
    """200 feathers pulled at random: no error, no point out of reach, accounts that only grow."""
    rng, split = np.random.default_rng(15), 0
    for _ in range(200):
        pulls = "".join(
            PULL.format(
                row=rng.uniform(0.3, 0.88), force=rng.choice([-1, 1]) * 10 ** rng.uniform(-2, 0)
            )
            for _ in range(3)
        )
        strokes = STROKES if rng.random() < 0.5 else ""
        simulation, before = simulate(read_shot(write_shot(tmp_path, "open", pulls + strokes))), 0.0
        for frame in simulation:
            assert np.abs(frame.poses[0].points.nodes).max() < 0.5
            own = gaps(simulation)
            assert ((own.hooked >= 0.0) & (own.hooked <= 1.0)).all()
            assert all(np.isfinite(array).all() for array in own)
            assert own.spent[:3].min() >= 0.0
            assert own.spent[:3].sum() >= before
            before = own.spent[:3].sum()
        split += simulation.report["hooks"]["opened"] > 0.0
    assert split > 50
