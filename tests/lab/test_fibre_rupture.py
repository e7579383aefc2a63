"""Membranes of fibres that break: the law, the specimen, and published numbers."""

from __future__ import annotations

import json
from math import pi

import numpy as np
import pytest
from commands import invoke
from derivatives import derivative_fault, unnoticed_signs

from featherfx.errors import InputError
from featherfx.lab.networks.rupture import (
    Fibre,
    RuptureTest,
    Specimen,
    directions,
    membrane_response,
    pull,
    run_rupture,
)
from featherfx.lab.studies.tissue import energy_slope, free_square

NARROW, WIDE = Fibre(1.36, 1.41), Fibre(1.34, 1.44)


@pytest.mark.parametrize("fibre", [NARROW, WIDE])
def test_plateaus_are_the_slope_of_the_energy(fibre):
    """Of equation 4-15 of Jacquemoud 2007, with her C_c of sections 4.5 and 4.6."""
    assert fibre.plateau == pytest.approx(energy_slope(fibre), rel=1e-6)


def test_a_fibre_is_at_rest_unstretched_and_starts_with_three_a_b():
    stress, slope = NARROW.elastic(np.array([1.0]))
    assert stress[0] == 0.0
    assert slope[0] == pytest.approx(3.0 * NARROW.stiffness * NARROW.exponent)


def test_a_fibre_yields_unloads_by_its_elastic_slope_and_breaks():
    square = np.array([1.30, 1.38, 1.37, 1.38, 1.42, 1.1])
    seen = np.maximum.accumulate(square)
    stress, slope = NARROW.response(square, seen)
    assert stress[1] == pytest.approx(NARROW.plateau)
    assert slope[1] == 0.0
    assert stress[1] - stress[2] == pytest.approx(
        NARROW.elastic(square[1])[0] - NARROW.elastic(square[2])[0]
    )
    assert slope[2] == NARROW.elastic(square[2:3])[1][0]
    assert stress[3] == pytest.approx(NARROW.plateau)
    assert list(stress[4:]) == [0.0, 0.0]


@pytest.mark.parametrize("component", range(3))
def test_tangent_is_the_slope_of_the_stress(component):
    fibres = directions(np.array([0.7]), pi / 4, 200)
    strain, past = np.array([0.08, 0.11, -0.05]), np.ones((1, 200))
    tangent = membrane_response(NARROW, fibres, strain[None], past).tangent[0, component]

    def value(change):
        return membrane_response(NARROW, fibres, (strain + change)[None], past).stress[0, component]

    def fault(gradient):
        return derivative_fault(value, gradient, np.random.default_rng(3), 0.02)

    assert fault(tangent) == ""
    assert unnoticed_signs(fault, tangent) == []


@pytest.mark.parametrize("mean", [pi / 2, 0.0])
def test_one_element_with_free_sides_reaches_the_stress_of_all_its_directions(mean):
    """At E22 = 0.215, a step before a break, against the law summed by adaptive quadrature."""
    found = run_rupture(RuptureTest(mu=mean, fibres=801))
    strains = [each.strain for each in found.path]
    stress = np.interp(0.215, strains, [each.stress for each in found.path])
    assert stress == pytest.approx(free_square(WIDE, mean, pi / 2, 0.215), rel=3e-3)
    # the fibres along the pull break at C_r, whatever the others do
    assert found.peak.strain == pytest.approx(0.5 * (WIDE.release - 1.0), abs=0.004)
    assert found.path[-1].intact[0, 0] < 0.8
    assert found.path[-1].stress < 0.6 * found.peak.stress


def test_a_sample_of_four_elements_is_one_element_up_to_the_peak():
    paths = [
        list(pull(Specimen(WIDE, np.full(shape, pi / 2), pi / 2, fibres=301), 2e-4, 0.2))
        for shape in ((1, 1), (2, 2))
    ]
    strains = [each.strain for each in paths[0]]
    expected = [
        np.interp(each.strain, strains, [one.stress for one in paths[0]]) for each in paths[1]
    ]
    assert [each.stress for each in paths[1]] == pytest.approx(expected, rel=0.02, abs=2e4)
    assert np.ptp(paths[1][-1].strains[..., 1]) < 1e-9


def test_a_tear_starts_beside_the_weak_element_and_the_others_unload():
    """Published: with a weak element 6 of nine, element 5 loses its fibres first, 4 follows, the
    others are pressed (figures 4-14 and 4-15)."""
    test = RuptureTest(elements=9, sigma=pi / 6, weak=1, fibres=201, step=1e-4)
    found = run_rupture(test)
    assert found.weakest == 5
    last = found.path[-1]
    assert last.intact[1].max() < 0.95
    assert last.intact[0].min() > 0.999
    assert last.intact[2].min() > 0.999
    assert last.strains[0, 1, 1] < found.peak.strains[0, 1, 1]
    # figure 4-14: the tear spreads from there
    assert last.intact[1, 1] < last.intact[1, 0]


def test_a_tear_of_24_elements_runs_through_the_row_of_the_weak_ones():
    """As of nine with a weak 5th and 6th (published: figure 4-16), past steps in which fibres break
    and hold in turns."""
    test = RuptureTest(elements=24, sigma=pi / 6, weak=2, fibres=101, step=2e-4)
    found = run_rupture(test)
    last = found.path[-1]
    assert last.stress < 0.05 * found.peak.stress
    assert last.intact[2].max() < 0.5
    assert np.delete(last.intact, 2, axis=0).min() == pytest.approx(1.0)


def test_the_command_prints_what_programs_read():
    result = invoke(
        "lab", "rupture", "--elements", "1", "--sigma", "0.5236", "--mu", "1.5708", "--json"
    )
    found = json.loads(result.output)
    assert found["plateau_stress"] == pytest.approx(15.96e6, rel=5e-4)
    assert found["peak_stress"] == max(found["stress"])
    assert 0.19 < found["strain_at_peak"] < 0.21


@pytest.mark.parametrize(
    ("test", "part"),
    [
        (RuptureTest(elements=4), "elements"),
        (RuptureTest(weak=1), "weak"),
        (RuptureTest(critical=1.5, release=1.4), "release"),
        (RuptureTest(sigma=0.0), "sigma"),
    ],
)
def test_wrong_values_are_told(test, part):
    with pytest.raises(InputError, match=part):
        run_rupture(test)
