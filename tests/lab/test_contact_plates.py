"""Plates that touch: one alone has the closed forms of a cantilever."""

from __future__ import annotations

import pytest

from featherfx.errors import InputError
from featherfx.lab.contact.experiments import ContactTest, run_contact
from featherfx.lab.contact.plates import BENDING, Plate, droop_of, frequency_of


@pytest.mark.parametrize("quality", ["preview", "final"])
def test_one_plate_droops_and_swings_as_a_cantilever(quality):
    found = run_contact(ContactTest(case="stack", n=1, quality=quality))
    assert found.droop == pytest.approx(found.droop_exact, rel=2e-3)
    assert found.frequency == pytest.approx(found.frequency_exact, rel=0.02)
    assert found.depth == 0.0


def test_a_stack_is_a_beam_of_the_sum_of_its_plates():
    plates = [Plate(4.0 * BENDING, 0.1, 0.0), Plate(BENDING, 0.1, 5e-4)]
    one = [Plate(5.0 * BENDING, 0.2, 0.0)]
    assert droop_of(plates, 1.0) == pytest.approx(-2.59e-3, rel=1e-3)
    assert droop_of(plates, 1.0) == pytest.approx(droop_of(one, 1.0), rel=1e-3)
    assert frequency_of(plates) == pytest.approx(frequency_of(one), rel=1e-3)


def test_a_stack_without_plates_is_refused():
    with pytest.raises(InputError, match=r"n: 0 is not allowed\. Give 1 to 50"):
        run_contact(ContactTest(case="stack", n=0))
