"""Cyclic curves: yield and slip of hooks found again, with intervals, or refused."""

from __future__ import annotations

import json

import numpy as np
import pytest
from commands import invoke
from test_vane_calibrate import write_curves

from featherfx.errors import InputError
from featherfx.lab.feather import feather_kind
from featherfx.lab.vane.calibrate import MeasuredCurve
from featherfx.lab.vane.hooked import CycleTest, cycle
from featherfx.lab.vane.hysteresis import Hook, cyclic_stress, fit_cycles
from featherfx.lab.vane.sample import Sample

KIND = feather_kind("swan_primary")
SAMPLE = Sample(0.0, 13e-3, 14e-3)
TRUE = Hook(5e4, 5e3, 0.08, KIND.vane_material.hook_strength)
STRAIN = np.concatenate([np.linspace(0, top, 13)[1:] for top in (0.15,)])
STRAIN = np.concatenate([STRAIN, STRAIN[-2::-1], [0.0], np.linspace(0, 0.3, 17)[1:], [0.2, 0.1]])
CURVE = MeasuredCurve(SAMPLE, STRAIN, cyclic_stress(STRAIN, TRUE))


def test_the_stress_is_that_of_a_sample_of_the_simulation():
    """Within what clamps and the guard do, through a cycle of the lab's own sample."""
    found = cycle(CycleTest(strains="0.2", rows=5, columns=2, parts=6))
    pull = np.array(found["strain"])
    vane = KIND.vane_material
    slip = vane.hook_slip / KIND.barb_spacing
    hook = Hook(vane.modulus_across_barbs, vane.hook_yield_across, slip, vane.hook_strength)
    stress = cyclic_stress(pull + 0.5 * pull**2, hook) * (1.0 + pull)
    np.testing.assert_allclose(found["stress"], stress, atol=0.03 * np.abs(stress).max())
    assert stress[-1] < 0.0


def test_round_trip():
    found = fit_cycles([CURVE], KIND)
    assert found.across.value == pytest.approx(TRUE.across, rel=1e-3)
    assert found.hook_yield_across.value == pytest.approx(TRUE.limit, rel=1e-3)
    assert found.hook_slip.value == pytest.approx(TRUE.slip * KIND.barb_spacing, rel=1e-2)
    assert found.residual < 1e-3


def test_noise_is_borne_and_known():
    rng = np.random.default_rng(6)
    noisy = CURVE.stress * (1.0 + 0.02 * rng.standard_normal(len(STRAIN)))
    found = fit_cycles([MeasuredCurve(SAMPLE, STRAIN, noisy)], KIND)
    for fitted, true in (
        (found.across, TRUE.across),
        (found.hook_yield_across, TRUE.limit),
        (found.hook_slip, TRUE.slip * KIND.barb_spacing),
    ):
        assert fitted.low < true < fitted.high
        assert (fitted.high - fitted.low) / fitted.value < 0.3


def test_what_cannot_be_identified_is_said():
    gentle = MeasuredCurve(
        SAMPLE, 0.3 * STRAIN, cyclic_stress(0.3 * STRAIN, TRUE._replace(limit=1e4))
    )
    with pytest.raises(InputError) as error:
        fit_cycles([gentle], KIND)
    assert {problem.key for problem in error.value.problems} >= {"hook_slip"}
    tilted = MeasuredCurve(Sample(30.0, 13e-3, 14e-3), CURVE.strain, CURVE.stress)
    rising = MeasuredCurve(SAMPLE, STRAIN[:12], CURVE.stress[:12])
    with pytest.raises(InputError) as error:
        fit_cycles([tilted, rising], KIND)
    messages = " ".join(problem.message for problem in error.value.problems)
    assert "the yield in shear cannot be identified" in messages
    assert "is never unloaded" in messages


def test_the_command_takes_points_in_their_order(tmp_path):
    write_curves(tmp_path / "cycles.csv", [CURVE])
    result = invoke("lab", "calibrate", tmp_path / "cycles.csv", "--cycles", "--json")
    assert result.exit_code == 0, result.stderr
    found = json.loads(result.stdout)
    assert found["hook_yield_across"]["value"] == pytest.approx(TRUE.limit, rel=1e-3)
    assert found["hook_yield_shear"] is None
