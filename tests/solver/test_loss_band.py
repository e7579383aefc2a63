"""Materials whose loss factor holds in a band of frequencies."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from drawn_cases import crumple
from trial_batches import at_origin, preset_batch, preset_kind, rod

from featherfx.api import read_shot
from featherfx.errors import InputError
from featherfx.feather.build import build_feather
from featherfx.lab.feather import feather_kind
from featherfx.lab.ribbons.rod import (
    ModesTest,
    Rod,
    clamped,
    damped,
    find_rod_modes,
    rod_model,
    total_energy,
)
from featherfx.mechanics.batch import make_model
from featherfx.mechanics.model import no_loads
from featherfx.solver.damping import fit_branches, natural_modes, with_damping
from featherfx.solver.scratch import make_scratch
from featherfx.solver.solver import Settings, Solver
from featherfx.solver.state import hold_roots
from featherfx.solver.step.energy_kernels import viscous_energy
from featherfx.solver.step.pose_kernels import add_increment, keep_pose, load_pose, place_points
from featherfx.solver.step.strain_kernels import damping_over, relax, set_reference
from featherfx.solver.types import Strains


@pytest.mark.parametrize("band", [(1.0, 200.0), (0.5, 50.0), (20.0, 900.0)])
@pytest.mark.parametrize("loss", [0.03, 0.1, 0.3])
def test_the_loss_angle_is_flat_in_the_band(loss, band):
    dashpot, times, weights = fit_branches(loss, band)
    angular = 2j * np.pi * np.geomspace(*band, 200)
    turn = angular[:, None] * times
    modulus = 1.0 + angular * dashpot + (weights * turn / (1.0 + turn)).sum(axis=1)
    assert (weights >= 0.0).all()
    assert modulus.imag / modulus.real == pytest.approx(loss, rel=0.05)


@pytest.mark.parametrize("steps", [1, 7, 40])
def test_a_strain_that_changes_evenly_is_solved_exactly_by_steps_of_any_length(steps):
    """s = c t: s - v = c t_i (1 - exp(-t / t_i))."""
    model, rate, end = damped(rod(3), 0.2), 0.7, 0.05
    history, place = np.zeros((6, 1)), (0, 1)
    ends = end * np.linspace(0.0, 1.0, steps + 1) ** 2
    for begin, time in pairwise(ends):
        h, now, reference = time - begin, np.array([rate * time]), np.zeros(1)
        set_reference(model, 0, 0, (h, 0.0), place, history, reference)
        stress = now + damping_over(model, 0, 0, h, 0.0) * (now - reference)
        relax(model, 0, 0, h, place, now, history, history)
        history[0] = now
    times, weights = model.relaxation_time[0, 0], model.relaxation_weight[0, 0]
    exact = rate * (end + model.retardation[0, 0])
    exact += (weights * rate * times * -np.expm1(-end / times)).sum()
    assert stress[0] == pytest.approx(exact, rel=1e-12)


def bent_as(model, shape, height):
    """State of a clamped rod at rest that is bent as a mode (N,), by height (m) at its end."""
    state, work = clamped(model), make_scratch(model)
    load_pose(model, 0, state, work.now)
    step = height / np.linalg.norm(shape.reshape(model.rows, 6)[-1, :3]) * shape
    add_increment(model.length[0], work.now, step, 1.0, work.trial, work.beam.gradient)
    state.rotation[0], state.centre[0] = work.trial.rotation, work.trial.centre
    load_pose(model, 0, state, work.now)
    place_points(model, 0, work.now)
    keep_pose(0, work.now, state)
    return state


@pytest.mark.parametrize("mode", [0, 1, 2])
@pytest.mark.parametrize(("loss", "taper"), [(0.1, 0.0), (0.05, 0.5)])
def test_a_rod_loses_as_much_in_each_of_its_first_three_modes(loss, taper, mode):
    """pi times the loss factor a period, in motion as by the modes' own answer."""
    shaft = Rod(0.3, ei=2e-3, ei2=5e-3, line_mass=0.01, taper=taper, segments=16)
    modes = find_rod_modes(ModesTest(shaft, 6, loss))
    free = rod_model(shaft)
    _, shapes = natural_modes(free, 0, 6)
    flat = [k for k in range(6) if np.ptp(shapes[:, k].reshape(-1, 6)[:, 2]) > 1e-9]
    k, model = flat[mode], damped(free, loss)
    state = bent_as(model, shapes[:, k], 1e-4)
    h, tips = 1.0 / modes.frequencies[k] / 100.0, []
    settings = Settings(1e30, newton=1e-10, spectral_radius=0.9)
    with Solver(model, settings) as solver:
        for _ in range(400):
            state, report = solver.step(state, no_loads(1), hold_roots(state), h)
            assert (report.status[0], report.steps[0]) == (0, 1)
            tips.append(state.centre[0, -1, 2])
    tips = np.array(tips)
    # from turn to turn, so that what creeps does not count
    turns = 1 + np.flatnonzero(np.diff(np.sign(np.diff(tips))))[1:]
    swings, halves = np.abs(np.diff(tips[turns])), len(turns) - 2
    lost = 2.0 * np.log(swings[0] / swings[-1]) / halves
    assert lost == pytest.approx(np.pi * loss, abs=0.3 * loss)
    assert modes.decrements[k] == pytest.approx(np.pi * loss, abs=0.3 * loss)
    period = 2.0 * h * (turns[-1] - turns[0]) / (len(turns) - 1)
    assert 1.0 / period == pytest.approx(modes.frequencies[k], rel=0.03)


def banded(kind, **changes):
    """A feather kind whose materials have a band."""
    parts = {
        name: replace(getattr(kind, name), loss_band=(1.0, 200.0), **changes)
        for name in ("vane_material", "rachis_material")
    }
    return replace(kind, **parts)


@pytest.mark.parametrize("frame", [2e-4, 2e-3, 0.04])
def test_the_energy_of_a_feather_that_is_left_alone_only_falls(frame):
    """That of the springs of the dashpots included; from a crumpled pose."""
    kind = banded(preset_kind("swan_primary"), loss_factor=0.3)
    model = with_damping(make_model([build_feather(kind, 9, 3)], [kind], 1), [kind])
    state = at_origin(model)
    crumple(model, state, np.random.default_rng(3), 0.3)
    energies = []
    with Solver(model, Settings(tolerance=1e-4)) as solver:
        for k in range(10):
            if k > 0:
                history = Strains(*(each[0] for each in state.strains))
                held = viscous_energy(
                    model, 0, state.strains.at(0, 0), history, state.gaps_of(0), 0.0
                )
                assert held >= 0.0
                energies.append(total_energy(model, no_loads(1), state) + held)
            state, report = solver.step(state, no_loads(1), hold_roots(state), frame)
            assert report.status[0] == 0
    assert np.diff(energies).max() <= 1e-7 * energies[0]
    assert energies[-1] < energies[0]


def test_moduli_hold_at_the_reference_frequency_and_droop_at_rest_is_theirs():
    kind = preset_kind("primary")
    _, plain = preset_batch("primary")
    for reference in (0.0, 20.0):
        own = banded(kind, reference_frequency=reference)
        model = with_damping(plain, [own])
        times, weights = model.relaxation_time[0, 0], model.relaxation_weight[0, 0]
        turn = 2j * np.pi * reference * times
        there = 1.0 + (weights * turn / (1.0 + turn)).sum().real
        assert there * model.rachis_stiffness == pytest.approx(plain.rachis_stiffness)
        assert there * model.cell_stiffness == pytest.approx(plain.cell_stiffness)
        loads = no_loads(1, (0.0, 0.0, -9.81))
        drops = []
        for each in (model, plain._replace(rachis_stiffness=plain.rachis_stiffness / there)):
            state, status, _ = Solver(each, Settings()).equilibrium(at_origin(each), loads)
            assert status[0] == 0
            drops.append(state.centre[0, -1, 2] - at_origin(each).centre[0, -1, 2])
        assert drops[0] == pytest.approx(drops[1], rel=0.02)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"loss_band": [200, 1]}, "loss_band: a band is a lowest and a highest frequency"),
        ({"loss_band": [5]}, "loss_band: has 1 item. Give 2"),
        ({"loss_band": [0.01, 20]}, "up to 300 times as high"),
        ({"loss_factor": 1.5}, "loss_factor: 1.5 is out of range"),
        ({"loss_band": [-1, 200]}, "-1"),
    ],
)
def test_a_band_that_is_none_is_an_error(tmp_path, changes, words):
    text = "".join(f"{key} = {value}\n" for key, value in changes.items())
    (tmp_path / "feather").mkdir()
    (tmp_path / "feather" / "odd.toml").write_text(f'base = "contour"\n[vane_material]\n{text}')
    with pytest.raises(InputError, match=words):
        feather_kind("odd", (tmp_path,))


@pytest.mark.parametrize(("in_shot", "at_fault"), [("loss_band", "shot"), ("loss_factor", "groom")])
def test_a_wrong_band_is_named_where_it_is_written(tmp_path, in_shot, at_fault):
    bands = {"groom": [1, 200], "shot": [1, 200]} | {at_fault: [200, 1]}
    feather = '[[feather]]\nid = "a"\nkind = "contour"\nposition = [0, 0, 0]\nup = [0, 0, 1]'
    feather += "\ndirection = [1, 0, 0]"
    own = f"overrides.vane_material.loss_band = {bands['groom']}"
    (tmp_path / "groom.toml").write_text(f'name = "g"\n{feather}\n{own}\n')
    value = bands["shot"] if in_shot == "loss_band" else 0.2
    text = 'name = "s"\ngroom = "groom.toml"\nframes = [1, 2]\nmotion.kind = "hold"'
    own = f"overrides.a.vane_material.{in_shot} = {value}"
    (tmp_path / "shot.toml").write_text(f"{text}\n{own}\n")
    with pytest.raises(InputError, match=rf"{at_fault}\.toml: \S+loss_band: a band"):
        read_shot(tmp_path / "shot.toml")
