"""The time integrator on linear oscillators, whose exact motion is known."""

from __future__ import annotations

import numpy as np
import pytest
from trial_batches import rod

from featherfx.mechanics.model import no_loads
from featherfx.solver.damping import frequencies
from featherfx.solver.solver import Settings, Solver, hold_roots
from featherfx.solver.state import rest_state
from featherfx.solver.step.integrator_kernels import (
    EULER,
    PointMotion,
    begin_step,
    end_step,
    integrator_of,
    step_error,
)

RADII = [0.0, 0.5, 0.8, 1.0]


class Oscillator:
    """x'' = -w^2 x from x = 1 at rest, as one node."""

    def __init__(self, frequency, radius):
        self.square, self.radius = frequency**2, radius
        shape = (1, 1, 3)
        self.motion = PointMotion(*(np.zeros(shape) for _ in PointMotion._fields))
        self.target, self.past = np.zeros(shape), np.zeros(shape)
        self.motion.points[0, 0, 0] = 1.0
        for acceleration in (self.motion.acceleration, self.motion.smoothed):
            acceleration[:] = -self.square * self.motion.points

    def step(self, h):
        begin_step(self.radius, h, self.motion, self.target, self.past)
        inertia = integrator_of(self.radius, h).inertia
        new = inertia * self.target / (inertia + self.square)
        return self.end(h, new)

    def end(self, h, new):
        error = step_error(self.radius, h, self.motion, new, self.target)
        end_step(self.radius, h, self.motion, new, self.target, self.past)
        self.motion.points[:] = new
        return error

    @property
    def x(self):
        return self.motion.points

    @property
    def v(self):
        return self.motion.velocity

    @property
    def energy(self):
        return 0.5 * (self.v[0, 0, 0] ** 2 + self.square * self.x[0, 0, 0] ** 2)


def error_after(duration, steps, radius, frequency=3.0):
    """Error of position and velocity (in units of the amplitude) after equal steps."""
    trial = Oscillator(frequency, radius)
    for _ in range(steps):
        trial.step(duration / steps)
    phase = frequency * duration
    position = trial.x[0, 0, 0] - np.cos(phase)
    velocity = trial.v[0, 0, 0] / frequency + np.sin(phase)
    return np.hypot(position, velocity)


@pytest.mark.parametrize("radius", RADII)
def test_second_order_in_position_and_velocity(radius):
    errors = np.array([error_after(2.0, steps, radius) for steps in (100, 200, 400)])
    assert np.log2(errors[:-1] / errors[1:]) == pytest.approx([2.0, 2.0], abs=0.05)


def test_implicit_euler_is_of_first_order():
    errors = np.array([error_after(2.0, steps, EULER) for steps in (800, 1600, 3200)])
    assert np.log2(errors[:-1] / errors[1:]) == pytest.approx([1.0, 1.0], abs=0.05)


def test_radius_one_conserves_energy_and_smaller_ones_damp():
    left = []
    for radius in (1.0, 0.8, 0.5, 0.0):
        trial = Oscillator(3.0, radius)
        start = trial.energy
        for _ in range(300):
            trial.step(0.1)
        left.append(trial.energy / start)
    # what is conserved is a modified energy: the plain one swings by the order of h^2
    assert left[0] == pytest.approx(1.0, abs=0.02)
    assert left == sorted(left, reverse=True)
    assert left[-1] < 0.5


@pytest.mark.parametrize("radius", [0.0, 0.5, 0.8])
def test_what_a_step_does_not_resolve_decays_with_the_spectral_radius(radius):
    trial = Oscillator(1e5, radius)
    for _ in range(10):
        trial.step(0.1)
    before = trial.energy
    for _ in range(10):
        trial.step(0.1)
    assert trial.energy <= (1.3 * radius + 1e-3) ** 20 * before + 1e-12


def test_the_estimate_of_a_step_is_its_local_error():
    """One step from the exact state; the estimate is of the third order, like the error."""
    ratios = []
    for h in (0.04, 0.02, 0.01):
        trial = Oscillator(1.0, 0.0)
        for _ in range(20):
            trial.step(h)
        phase = trial.x[0, 0, 0], trial.v[0, 0, 0]
        exact = phase[0] * np.cos(h) + phase[1] * np.sin(h)
        estimate = trial.step(h)
        ratios.append(estimate / abs(trial.x[0, 0, 0] - exact))
    assert all(0.2 < ratio < 5.0 for ratio in ratios)


def test_constant_acceleration_is_exact():
    """A free fall that begins with its acceleration known: second order means no error at all."""
    trial = Oscillator(0.0, 0.0)
    gravity = np.zeros((1, 1, 3))
    gravity[0, 0, 2] = -9.81
    trial.motion.acceleration[:] = trial.motion.smoothed[:] = gravity
    for _ in range(10):
        begin_step(0.0, 0.1, trial.motion, trial.target, trial.past)
        trial.end(0.1, trial.target + gravity / integrator_of(0.0, 0.1).inertia)
    assert trial.x[0, 0, 2] == pytest.approx(-0.5 * 9.81, rel=1e-12)
    assert trial.v[0, 0, 2] == pytest.approx(-9.81, rel=1e-12)


def swinging_rod(steps, settings):
    """Tip of a rod under gravity that grows over 0.2 s, after 0.4 s of equal steps.

    Gravity that sets in at once would make modes ring that coarse steps do not resolve.
    """
    model = rod(9, bending=2.0, torsion=2.0, stretching=1e5)
    state = rest_state(model, np.zeros((1, 3)), np.eye(3)[None])
    duration = 0.4
    with Solver(model, settings) as solver:
        for k in range(steps):
            share = min(2.0 * (k + 1) / steps, 1.0)
            loads = no_loads(1, (0.0, 0.0, -9.0 * share**3 * (10 - 15 * share + 6 * share**2)))
            state, report = solver.step(state, loads, hold_roots(state), duration / steps)
            assert report.status[0] == 0
            assert report.steps[0] == 1
    return state.points.nodes[0, -1, 0].copy()


@pytest.mark.parametrize("radius", [pytest.param(0.0, marks=pytest.mark.slow), 0.8])
def test_a_rod_under_growing_gravity_converges_with_the_second_order(radius):
    settings = Settings(tolerance=1e9, newton=1e-10, max_substeps=1, spectral_radius=radius)
    tips = np.array([swinging_rod(steps, settings) for steps in (160, 320, 640, 1280)])
    moves = np.linalg.norm(np.diff(tips, axis=0), axis=1)
    assert tips[-1][2] < -0.3
    assert np.log2(moves[:-1] / moves[1:]).min() > 1.8


def test_natural_frequencies_of_a_rod_are_those_of_a_cantilever():
    exact = np.array([1.87510407, 4.69409113, 7.85475744]) ** 2 / (2.0 * np.pi)
    found = frequencies(rod(81), 0, 6)
    # bending in both planes: every frequency twice
    assert found[::2] == pytest.approx(exact, rel=5e-3)
    assert found[1::2] == pytest.approx(exact, rel=5e-3)
