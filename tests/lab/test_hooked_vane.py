"""Samples of a hooked vane: slip that stays, and splits along the barbs."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from commands import invoke

from featherfx.errors import InputError
from featherfx.lab.feather import feather_kind
from featherfx.lab.vane.hooked import CycleTest, TearTest, cycle, tear

# the solver is compiled anew for gaps that slip and open, and with the sample's topology
pytestmark = pytest.mark.slow

VANE = feather_kind("swan_primary").vane_material


@pytest.fixture(scope="module")
def cycled():
    return cycle(CycleTest(rows=6, columns=2, parts=8))


def test_slip_stays_after_a_cycle(cycled):
    """Jouve 2024, figure 3.9: load-unload cycles of increasing amplitude; after one the force is
    negative where it was null."""
    below, first, second = cycled["stress_at_zero"]
    assert below == pytest.approx(0.0, abs=1.0)
    assert second < first < -100.0


def test_loss_of_a_cycle_grows_with_its_amplitude(cycled):
    below, first, second = cycled["loss"]
    assert below == pytest.approx(0.0, abs=1e-3)
    assert second > first > 10.0


def test_below_the_yield_stress_the_sample_is_elastic(cycled):
    """S = E_ww e (1 + d/H), e = ((1 + d/H)^2 - 1) / 2, while E_ww e is below the yield stress."""
    pull, stress = cycled["strain"][4], cycled["stress"][4]
    strain = 0.5 * ((1.0 + pull) ** 2 - 1.0)
    assert VANE.modulus_across_barbs * strain < VANE.hook_yield_across
    assert stress == pytest.approx(VANE.modulus_across_barbs * strain * (1.0 + pull), rel=1e-3)


@pytest.mark.parametrize("rows", [6, 21])
def test_strength_and_energy_of_a_split_are_those_of_the_law(rows):
    """Largest stress S_c (1 + d/H) and energy b S_c R / 2 per length, for any number of rows."""
    found = tear(TearTest("across", rows=rows, columns=4, scatter=0.0)).as_json()
    assert found["energy_per_length"] == pytest.approx(
        0.5 * VANE.thickness * VANE.hook_strength * VANE.hook_release, rel=1e-3
    )
    at_peak = found["strain"][int(np.argmax(found["stress"]))]
    assert found["strength"] == pytest.approx(VANE.hook_strength * (1.0 + at_peak), rel=0.02)
    # other gaps of the same strength may part as well, or begin to, while the sample snaps
    assert found["split_length"] >= 13e-3 * (1.0 - 1e-9)


@pytest.mark.parametrize("direction", ["across", "tilted", "along"])
def test_splits_run_along_the_barbs_whatever_the_pull(direction):
    found = tear(TearTest(direction, rows=11, columns=6, step=0.02)).as_json()
    assert found["split_angle"] < 1.0
    assert found["split_length"] >= 13e-3
    assert found["stress"][-1] < 0.2 * found["strength"]


def test_until_it_opens_work_is_stored_spent_or_damped():
    """Damped: E tau (de/dt)^2 over the volume, at 1 height a second; under 2 % of the work."""
    found = tear(TearTest("across", rows=6, columns=2, step=0.02, furthest=0.3)).as_json()
    assert found["released_energy"] == 0.0
    assert found["strength"] is None
    assert 0.0 < found["damping_work"] < 0.02 * found["work"]
    assert abs(found["unaccounted"]) < 1e-3 * found["work"]


@pytest.mark.parametrize("direction", ["across", "along", "tilted"])
def test_what_is_spent_stored_and_damped_is_the_work_of_the_clamp(direction):
    """Damping is counted step by step, and takes most of what the sample sets free as it snaps."""
    found = tear(TearTest(direction, rows=11, columns=4)).as_json()
    assert found["damping_work"] > 0.3 * found["work"]
    assert found["stored"] + found["dissipated"] == pytest.approx(found["work"], rel=0.01)


def test_strength_and_energy_along_the_barbs_do_not_depend_on_the_rows():
    found = [tear(TearTest("along", rows=rows)).as_json() for rows in (11, 21, 81)]
    for key in ("strength", "energy_per_length"):
        values = [each[key] for each in found]
        assert max(values) < 1.01 * min(values)


@pytest.mark.parametrize("direction", ["along", "tilted"])
def test_strength_does_not_depend_on_the_columns(direction):
    found = [tear(TearTest(direction, rows=11, columns=m)).as_json() for m in (4, 8, 16)]
    values = [each["strength"] for each in found]
    assert max(values) < 1.05 * min(values)


def test_the_law_does_not_know_the_rate():
    slow, fast = (
        tear(TearTest("across", rows=6, columns=2, step=0.05, rate=rate)).as_json()["strength"]
        for rate in (0.01, 1.0)
    )
    assert fast == pytest.approx(slow, rel=0.02)


def test_the_commands_print_what_programs_read():
    arguments = ["lab", "cycle", "--strains", "0.1", "--rows", "6", "--columns", "2", "--json"]
    found = json.loads(invoke(*arguments).output)
    assert set(found) == {"strain", "stress", "stress_at_zero", "loss"}


def test_a_strip_without_gaps_cannot_be_torn_or_slip():
    for run, test in ((tear, TearTest("across")), (cycle, CycleTest())):
        with pytest.raises(InputError, match=r"preset: 'peacock_barb' is a ribbon"):
            run(replace(test, preset="peacock_barb"))


@pytest.mark.parametrize("strains", ["", "0.1,x", "-0.1", "0.1,2"])
def test_wrong_strains_are_told(strains):
    with pytest.raises(InputError, match="strains"):
        cycle(CycleTest(strains=strains))
