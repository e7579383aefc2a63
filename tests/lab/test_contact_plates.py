"""Plates that touch: one alone has the closed forms of a cantilever."""

from __future__ import annotations

import numpy as np
import pytest

from featherfx.api import simulate
from featherfx.errors import InputError
from featherfx.lab.contact.experiments import ContactTest, make_plates, run_contact
from featherfx.lab.contact.plates import BENDING, Plate, droop_of, frequency_of, make_shot


@pytest.mark.parametrize("quality", ["preview", "final"])
def test_one_plate_droops_and_swings_as_a_cantilever(quality):
    found = run_contact(ContactTest(case="stack", n=1, quality=quality))
    assert found.droop == pytest.approx(found.droop_exact, rel=2e-3)
    assert found.frequency == pytest.approx(found.frequency_exact, rel=0.02)
    assert found.depth == 0.0


@pytest.mark.parametrize("quality", ["preview", "final"])
def test_plates_of_different_stiffness_bear_their_load_together(quality):
    found = run_contact(ContactTest(case="plates", quality=quality))
    assert found.droop == pytest.approx(found.droop_exact, rel=0.01)
    assert found.frequency == pytest.approx(found.frequency_exact, rel=0.05)


@pytest.mark.parametrize("n", [3, pytest.param(8, marks=pytest.mark.nightly)])
def test_a_stack_bears_the_load_of_its_top_plate(n):
    """The plates beneath weigh next to nothing: what does not reach them leaves them straight."""
    test = ContactTest(case="stack", n=n)
    plates = make_plates(test)
    shot = make_shot(plates, test.thickness, test.quality, 1, 1.0)
    (frame,) = simulate(shot)
    heights = [
        points[-1, 0, 2] - plate.height for points, plate in zip(frame.points, plates, strict=True)
    ]
    assert np.mean(heights) == pytest.approx(droop_of(plates, 1.0), rel=0.02)


def test_a_stack_is_a_beam_of_the_sum_of_its_plates():
    plates = [Plate(4.0 * BENDING, 0.1, 0.0), Plate(BENDING, 0.1, 5e-4)]
    one = [Plate(5.0 * BENDING, 0.2, 0.0)]
    assert droop_of(plates, 1.0) == pytest.approx(-2.59e-3, rel=1e-3)
    assert droop_of(plates, 1.0) == pytest.approx(droop_of(one, 1.0), rel=1e-3)
    assert frequency_of(plates) == pytest.approx(frequency_of(one), rel=1e-3)


def test_a_stack_without_plates_is_refused():
    with pytest.raises(InputError, match=r"n: 0 is not allowed\. Give 1 to 50"):
        run_contact(ContactTest(case="stack", n=0))
