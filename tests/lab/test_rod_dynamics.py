"""Rods in motion: order in time, damping, conservation."""

import numpy as np
import pytest

from featherfx.feather.types import both
from featherfx.lab.ribbons.rod import (
    ReleaseTest,
    Rod,
    bend,
    clamped,
    release,
    rod_loads,
    rod_model,
    total_energy,
)
from featherfx.mechanics.model import no_loads
from featherfx.solver.damping import first_frequency
from featherfx.solver.solver import Settings, Solver, hold_roots, raise_if_failed

pytestmark = pytest.mark.verification

UNLIMITED = 1e30
ROD = Rod(1.0, 1.0, line_mass=1.0, line_weight=10.0)


def run(solver, state, loads, step, count):
    """States at multiples of a fixed step (s), the first included."""
    path = hold_roots(state)
    states = [state]
    for _ in range(count):
        state, report = solver.step(state, loads, path, step)
        raise_if_failed(report.status, state.time, ["rod"])
        assert (report.steps[0], report.fallbacks[0]) == (1, 0)
        states.append(state)
    return states


def fixed(model, radius):
    newton = 1e-9 * model.length.sum()
    return Solver(model, Settings(UNLIMITED, newton=newton, spectral_radius=radius))


def plucked(rod, direction, height):
    """Model and state of a rod at rest, bent nearly as its first mode by forces just gone.

    Forces follow mass times deflection, inverse iteration, scaled to the tip's height (m).
    """
    model = rod_model(rod)
    solver = Solver(model, Settings(newton=1e-9 * rod.length))
    loads = rod_loads(rod)
    shape = np.linspace(0.0, 1.0, rod.segments + 1) ** 2
    # of a uniform rod under end force: a start for the size
    scale = 3.0 * height * rod.ei / rod.length**3 / np.sum(model.mass[0, :, 0] * shape)
    for _ in range(5):
        force = scale * model.mass[0, :, 0] * shape
        loads.force[0, :, 0] = force[:, None] * np.asarray(direction)
        state, status, _ = solver.equilibrium(clamped(model), loads)
        assert status[0] == 0
        found = state.centre[0] @ np.asarray(direction)
        shape = found / found[-1]
        scale *= height / found[-1]
    return model, state


def test_rows_and_tolerance_of_a_released_rod_converge():
    """Tip of the first swing at 40 segments against 160 and a tolerance 100 times smaller."""
    long = Rod(1.0, 1.0, line_mass=1.0, line_weight=10.0, segments=160)
    fine = release(ReleaseTest(long, 1.2, 1e-6, samples=24))
    coarse = release(ReleaseTest(ROD, 1.2, 1e-4, samples=24))
    assert np.linalg.norm(coarse.tip - fine.tip, axis=1).max() < 0.01


@pytest.mark.parametrize(
    "radius",
    [pytest.param(0.0, marks=pytest.mark.slow), 0.8, pytest.param(1.0, marks=pytest.mark.slow)],
)
def test_second_order_in_time(radius):
    """A root that starts smoothly from rest, at fixed steps against steps 8 times smaller."""
    rod = Rod(1.0, 1.0, line_mass=1.0, segments=10)
    model = rod_model(rod)
    solver, start, loads = fixed(model, radius), clamped(model), no_loads(1)

    def root(time):
        return np.array([0.0, 0.01, 0.02]) * (1.0 - np.cos(2.0 * np.pi * time)) ** 2

    def end(count):
        state = start
        for k in range(count):
            path = hold_roots(start)
            samples = np.zeros((1, 5, 6))
            samples[0, :, :3] = [root((k + share) / count) for share in np.linspace(0, 1, 5)]
            state, report = solver.step(state, loads, path._replace(samples=samples), 1.0 / count)
            assert (report.status[0], report.steps[0], report.fallbacks[0]) == (0, 1, 0)
        return state.centre[0]

    reference = end(2560)
    errors = np.array([np.abs(end(n) - reference).max() for n in (80, 160, 320)])
    orders = np.log2(errors[:-1] / errors[1:])
    assert (orders > 1.8).all(), f"errors {errors}, orders {orders}"


def energies(radius, steps_per_period, periods):
    rod = Rod(0.3, ei=2e-3, line_mass=0.01, segments=10)
    model, start = plucked(rod, (0.0, 0.6, 0.8), 0.05)
    period = 2.0 * np.pi / first_frequency(model, 0)
    count = steps_per_period * periods
    solver = fixed(model, radius)
    # the first step of a state is implicit Euler's; a tiny one costs no energy
    start = run(solver, start, no_loads(1), 1e-4 * period, 1)[-1]
    start.proposal[:] = 0.0
    states = run(solver, start, no_loads(1), period / steps_per_period, count)
    return np.array([total_energy(model, no_loads(1), state) for state in states])


def test_energy_drifts_little_in_100_periods_with_little_numerical_damping():
    """Spectral radius 0.9: what is damped are the stretching modes, not the swing. The undamped
    radius 1 is no setting for nearly inextensible rods: docs/lab.md."""
    energy = energies(0.9, 40, 100)
    assert np.abs(energy / energy[0] - 1.0).max() < 0.01


def test_energy_never_grows_with_the_damped_setting():
    """Within a period the sum of velocities and strains at the same step ripples at second order;
    from period to period, and against the start, nothing is gained."""
    energy = energies(0.0, 40, 30)
    assert energy.max() < 1.001 * energy[0]
    highest = energy[1:].reshape(30, 40).max(axis=1)
    assert (np.diff(highest) < 0.0).all()
    assert energy[-1] < 0.99 * energy[0]


def momenta(model, state):
    inertia, rates = (model.mass[0], model.rotary_inertia[0]), state.velocity.at(0)
    linear = inertia[0][:, 0] @ rates.nodes[:, 0]
    angular = sum(
        np.einsum("np,npk->k", mass, np.cross(places, rate))
        for mass, places, rate in zip(inertia, state.points.at(0), rates, strict=True)
    )
    return linear, angular


def test_free_flight_conserves_linear_and_angular_momentum():
    """A bent rod let go while it flies and spins: it tumbles, straightens and rings."""
    rod = Rod(0.3, ei=2e-3, line_mass=0.01, segments=12)
    model, start = plucked(rod, (0.0, 0.6, 0.8), 0.15)
    model = model._replace(held=np.zeros(1, dtype=np.bool_))
    spin, flight = np.array([2.0, 5.0, -3.0]), np.array([1.0, -2.0, 0.5])
    state = start.copy()
    turning = both(lambda part: np.cross(spin, part), state.points)
    state.velocity.assign(turning.shifted(flight[None]))
    state.spin[:] = spin
    before = momenta(model, state)
    states = run(fixed(model, 0.9), state, no_loads(1), 5e-4, 800)
    bent = [np.linalg.norm(each.centre[0, -1] - each.centre[0, 0]) for each in states]
    assert np.ptp(bent) > 0.01 * rod.length
    for each in states[::40]:
        linear, angular = momenta(model, each)
        assert linear == pytest.approx(before[0], rel=1e-6)
        assert np.linalg.norm(angular - before[1]) < 2e-3 * np.linalg.norm(before[1])


def test_bent_rod_rings_at_its_first_frequency():
    """Period of a small swing against the modes' own linear answer."""
    rod = Rod(0.3, ei=2e-3, line_mass=0.01, segments=20)
    model, start = plucked(rod, (0.0, 0.0, 1.0), 1e-3)
    period = 2.0 * np.pi / first_frequency(model, 0)
    states = run(fixed(model, 0.8), start, no_loads(1), period / 200.0, 1200)
    height = np.array([state.centre[0, -1, 2] for state in states])
    falls = np.flatnonzero((height[:-1] > 0.0) & (height[1:] <= 0.0))
    crossing = falls + height[falls] / (height[falls] - height[falls + 1])
    assert np.diff(crossing).mean() / 200.0 == pytest.approx(1.0, rel=5e-3)
    assert bend(rod).tip == pytest.approx([0.3, 0.0, 0.0])
