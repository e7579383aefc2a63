"""Plates that touch, beside closed forms that share no line with the solver."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from featherfx.errors import InputError
from featherfx.lab.contact import ContactTest, TouchingPlates, energy_gain, run_contact
from featherfx.lab.plates import (
    BENDING,
    FRAMES_PER_SECOND,
    LENGTH,
    Plate,
    PlateSetup,
    droop_of,
    frequency_of,
    prop_force,
    propped_tip,
)
from featherfx.lab.studies.rods import stepped_frequency
from featherfx.solver.damping import fit_branches


def at_rest(**test):
    return run_contact(ContactTest(at_rest=True, **test))


@pytest.mark.parametrize("quality", ["preview", "final"])
def test_one_plate_droops_and_swings_as_a_cantilever(quality):
    found = run_contact(ContactTest(case="stack", n=1, quality=quality))
    assert found.droop == pytest.approx(found.droop_exact, rel=2e-3)
    assert found.frequency == pytest.approx(found.frequency_exact, rel=0.02)
    assert found.reaction_sum == pytest.approx(found.weight, rel=1e-3)
    assert found.energy_gain < 1e-6
    assert found.depth == 0.0


@pytest.mark.parametrize("quality", ["preview", "final"])
def test_plates_of_different_stiffness_bear_their_load_together(quality):
    found = at_rest(case="plates", quality=quality)
    assert found.droop == pytest.approx(found.droop_exact, rel=0.01)
    assert found.reaction_sum == pytest.approx(found.weight, rel=2e-3)


@pytest.mark.parametrize("case", ["stack", "graded"])
@pytest.mark.parametrize("n", [3, pytest.param(8, marks=pytest.mark.nightly)])
def test_a_stack_bears_the_load_of_all_its_plates(case, n):
    """The plates beneath weigh next to nothing: what does not reach them leaves them straight."""
    found = at_rest(case=case, n=n)
    assert found.droop == pytest.approx(found.droop_exact, rel=0.02)
    assert found.reaction_sum == pytest.approx(found.weight, rel=5e-3)


def test_a_plate_rests_on_an_edge():
    found = at_rest(case="wedge", tolerance=2e-5)
    assert found.droop == pytest.approx(found.droop_exact, rel=0.01)
    assert found.reaction_sum == pytest.approx(found.weight, rel=0.01)


def test_droop_comes_nearer_to_the_closed_form_with_the_tolerance():
    errors = []
    for tolerance in (6e-4, 1.5e-4, 2e-5):
        found = at_rest(case="plates", tolerance=tolerance)
        errors.append(abs(found.droop / found.droop_exact - 1.0))
    assert errors[0] > errors[1] > errors[2]
    assert errors[2] < 2e-3


def test_a_plate_sticks_on_a_flat_slope_and_slides_down_a_steep_one():
    found = run_contact(ContactTest(case="slide"))
    assert 0.0 <= found.creep < found.creep_most
    assert found.acceleration > 0.0
    assert found.energy_gain == 0.0


@pytest.mark.parametrize("steps", [0, 4, 16])
@pytest.mark.parametrize(("speed", "x", "most"), [(5.0, -0.1, 0.04), (0.3, -0.02, 0.005)])
def test_friction_slows_a_plate_that_is_thrown_along_another_until_it_sticks(speed, x, most, steps):
    """At 5 m/s it passes the other's whole length in a frame."""
    slowed = 0.3 * 9.81 / FRAMES_PER_SECOND  # in a frame
    frames = 1 if speed > 1.0 else 5
    setup = PlateSetup(5e-4, "preview", gravity=9.81, friction=0.3, steps=steps)
    rigid = Plate(1e3 * BENDING, 0.1)
    plates = TouchingPlates([rigid, replace(rigid, height=5e-4, x=x, is_free=True)], setup)
    plates.throw(1, (speed, 0.0, 0.0))
    samples = list(plates.go(frames))
    speeds = np.array([each.velocity[1, 0] for each in samples])
    slides = speeds[1:] > slowed
    assert slides[0]
    assert -np.diff(speeds)[slides] == pytest.approx(slowed, rel=most)
    if frames > 1:
        assert np.abs(speeds[4:]).max() < plates.slip_speed / 20.0
    assert energy_gain(samples) < 1e-6


@pytest.mark.parametrize("steps", [16, 64])
@pytest.mark.parametrize(
    ("case", "figure", "most"), [("slide", "acceleration", 0.02), ("collide", "momentum", 3e-3)]
)
def test_plates_move_as_their_closed_forms_say(case, figure, most, steps):
    found = run_contact(ContactTest(case=case, steps=steps))
    assert getattr(found, figure) == pytest.approx(getattr(found, f"{figure}_exact"), rel=most)
    assert found.energy_gain < 1e-3


@pytest.mark.parametrize("steps", [4, 16, 64])
def test_contact_adds_nothing_to_what_steps_slow_a_swing_by(steps):
    """Of second order: with 4 steps a frame the integrator alone is 3.1 % slow, with 64 not."""
    found = run_contact(ContactTest(case="plates", steps=steps))
    stepped = stepped_frequency(found.frequency_exact, 1.0 / (steps * FRAMES_PER_SECOND))
    assert found.frequency == pytest.approx(stepped, rel=0.01)
    assert found.energy_gain < 1e-3


@pytest.mark.parametrize("quality", ["preview", "final"])
@pytest.mark.parametrize(
    ("case", "figure", "most"), [("slide", "acceleration", 0.02), ("collide", "momentum", 0.01)]
)
def test_plates_move_as_their_closed_forms_say_in_steps_by_tolerance(case, figure, most, quality):
    found = run_contact(ContactTest(case=case, steps=0, quality=quality))
    assert getattr(found, figure) == pytest.approx(getattr(found, f"{figure}_exact"), rel=most)
    assert found.energy_gain < 1e-3


@pytest.mark.parametrize("quality", ["preview", "final"])
def test_plates_swing_together_as_closely_as_one_does_in_steps_by_tolerance(quality):
    errors = []
    for test in (ContactTest(case="plates"), ContactTest(case="stack", n=1)):
        found = run_contact(replace(test, steps=0, quality=quality))
        errors.append(abs(found.frequency / found.frequency_exact - 1.0))
        assert found.energy_gain < 1e-3
    assert errors[0] < 1.1 * errors[1]


def test_a_gain_of_energy_is_found_after_a_loss():
    plates = TouchingPlates([Plate(BENDING, 0.1, is_free=True)], PlateSetup(5e-4, "preview"))
    (sample,) = plates.go(0)
    energies = [(2.0, 1.0), (1.0, 0.5), (1.5, 2.0)]
    assert energy_gain([sample._replace(energy=e, kinetic=t) for e, t in energies]) == 0.25


def test_what_flies_falls_and_bears_no_root():
    plates = TouchingPlates([Plate(BENDING, 0.1, is_free=True)], PlateSetup(5e-4, "preview"))
    *_, last = plates.go(12)
    assert last.velocity[0, 2] == pytest.approx(-0.5, rel=1e-6)
    assert not last.reactions.any()


def test_a_stack_is_a_beam_of_the_sum_of_its_plates():
    plates = [Plate(4.0 * BENDING, 0.1, 0.0), Plate(BENDING, 0.1, 5e-4)]
    one = [Plate(5.0 * BENDING, 0.2, 0.0)]
    assert droop_of(plates, 1.0) == pytest.approx(-2.59e-3, rel=1e-3)
    assert droop_of(plates, 1.0) == pytest.approx(droop_of(one, 1.0), rel=1e-3)
    assert frequency_of(plates) == pytest.approx(frequency_of(one), rel=1e-3)
    # an edge at the tip holds it, with three eighths of the weight
    assert propped_tip(plates[0], LENGTH, 1.0) == pytest.approx(0.0, abs=1e-12)
    assert prop_force(plates[0], LENGTH, 1.0) == pytest.approx(0.375 * plates[0].mass)


def test_a_stack_without_plates_is_refused():
    with pytest.raises(InputError, match=r"n: 0 is not allowed\. Give 1 to 50"):
        run_contact(ContactTest(case="stack", n=0))


def test_a_beam_with_loss_swings_as_its_dashpots_and_springs_do():
    """One mass on the material's springs, integrated by another program's Runge-Kutta steps."""
    loss, beam = 0.2, [Plate(BENDING, 0.04)]
    dashpot, times, weights = fit_branches(loss, (1.0, 200.0))
    square = (2.0 * np.pi * frequency_of(beam)) ** 2

    def rates(_, y):
        moved, speed, strains = y[0], y[1], y[2:]
        force = moved + dashpot * speed + weights @ strains
        return [speed, -square * force, *(speed - strains / times)]

    begin = [1.0, 0.0, *np.zeros(len(times))]
    found = solve_ivp(rates, (0.0, 1.0), begin, "LSODA", events=lambda _, y: y[1], rtol=1e-9)
    turns = found.t_events[0]
    assert len(turns) > 7
    # half periods, once what creeps has died down
    assert frequency_of(beam, loss) == pytest.approx(0.5 / np.diff(turns)[2:6].mean(), rel=3e-3)
    assert frequency_of(beam, loss) > 1.15 * frequency_of(beam)
