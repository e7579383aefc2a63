"""Laws of soft tissue: closed forms, energies, fits, bad files."""

import json

import numpy as np
import pytest
from commands import invoke

from featherfx.errors import InputError
from featherfx.lab.networks.unit_cell import (
    LAWS,
    arnoux,
    fit_tissue,
    fung,
    incompressible,
    read_tissue,
    sacks,
)

pytestmark = pytest.mark.verification
STRAIN = np.linspace(0.005, 0.24, 50)


def test_arnoux_undamaged_is_the_slope_of_its_energy():
    """S = (dW/dl) / l for W = a exp(b (I1 - 3)) - a b / 2 (I2 - 3) of an incompressible pull."""
    a, b = 0.3, 17.0

    def energy(stretch):
        first, second = stretch**2 + 2 / stretch, 2 * stretch + stretch**-2
        return a * np.exp(b * (first - 3)) - 0.5 * a * b * (second - 3)

    stretch, step = np.sqrt(1 + 2 * STRAIN), 1e-5
    slope = (energy(stretch + step) - energy(stretch - step)) / (2 * step)
    undamaged = arnoux(np.array([a, b, 1e12, 1.0]), STRAIN, STRAIN)
    assert undamaged == pytest.approx(slope / stretch, rel=1e-6)


def test_arnoux_damage_follows_its_rate():
    """dD/dl = a b n / Q (D + D0)^(1 - 1/n) (e - 1/l), by small steps."""
    a, b, q, n = 0.2835, 16.9081, 1.5337, 0.7889
    stretch = np.linspace(1.0, np.sqrt(1.4), 4001)
    damage, step = np.zeros(len(stretch)), stretch[1] - stretch[0]
    for k in range(len(stretch) - 1):
        middle = stretch[k] + 0.5 * step
        growth = np.exp(b * (middle**2 + 2 / middle - 3)) - 1 / middle
        damage[k + 1] = (
            damage[k] + step * a * b * n / q * (damage[k] + 0.01) ** (1 - 1 / n) * growth
        )
    strain = 0.5 * (stretch**2 - 1)
    whole = arnoux(np.array([a, b, q, n]), strain, strain)
    undamaged = arnoux(np.array([a, b, 1e12, n]), strain, strain)
    seen = (undamaged > 0.1) & (damage < 0.9)
    assert whole[seen] / undamaged[seen] == pytest.approx(1 - damage[seen], rel=2e-3)


def test_sacks_of_stiff_fibres_in_all_directions():
    """b to 0: S = a b int (E1 cos^2 + E2 sin^2) R cos^2, here by Gauss points."""
    a, b = 3.0, 1e-7
    place, weight = np.polynomial.legendre.leggauss(40)
    angle, weight = 0.5 * np.pi * place, 0.5 * np.pi * weight
    share = np.exp(-(angle**2) / (2 * (np.pi / 2) ** 2)) / (np.pi / 2 * np.sqrt(2 * np.pi))
    square = np.cos(angle) ** 2
    along, across = np.array([0.1, 0.2]), np.array([-0.03, 0.05])
    expected = [
        a * b * float(weight @ ((e * square + f * (1 - square)) * share * square))
        for e, f in zip(along, across, strict=True)
    ]
    assert sacks(np.array([a, b]), along, across) == pytest.approx(expected, rel=1e-4)


def test_fung_is_the_slope_of_its_energy():
    parameters = np.array([2.0, 0.3, 0.7, 3.0, 1.0, 0.5])
    a1, a4, c, b1, b2, b4 = parameters
    across, step = np.array([-0.05]), 1e-6

    def energy(e):
        exponent = b1 * e**2 + b2 * across**2 + 2 * b4 * e * across
        return 0.5 * (a1 * e**2 + 2 * a4 * e * across) + 0.5 * c * np.exp(exponent)

    slope = (energy(0.2 + step) - energy(0.2 - step)) / (2 * step)
    assert fung(parameters, np.array([0.2]), across) == pytest.approx(slope, rel=1e-6)


def test_intervals_hold_the_parameters_nineteen_times_of_twenty():
    true = {"a": 0.9e6, "b": 13.0}
    across = incompressible(STRAIN)
    exact = sacks(np.array(list(true.values())), STRAIN, across)
    random, held = np.random.default_rng(0), 0
    for _ in range(20):
        noisy = exact + 0.01 * exact.max() * random.standard_normal(len(exact))
        found = fit_tissue("sacks", STRAIN, noisy, across, "x")
        intervals = [found.intervals[name] for name in true]
        assert all(high / low < 1.5 for low, high in intervals)
        assert 0.0 < found.error < 0.05
        held += sum(
            low < value < high for (low, high), value in zip(intervals, true.values(), strict=True)
        )
    assert held >= 35


def test_what_a_curve_does_not_tell_has_no_interval():
    across = np.zeros_like(STRAIN)
    stress = fung(np.array([2e6, 1.0, 3e5, 5.0, 1.0, 1.0]), STRAIN, across)
    found = fit_tissue("fung", STRAIN, stress, across, "x")
    assert found.error < 1e-2
    assert found.intervals["b2"] is None
    assert found.intervals["a4"] is None


def test_too_few_points_are_refused():
    with pytest.raises(InputError, match="more than the 2"):
        fit_tissue("sacks", STRAIN[:2], STRAIN[:2], STRAIN[:2], "x")


@pytest.mark.parametrize(
    ("text", "key"),
    [
        ("strain\n0.1\n", "stress"),
        ("strain,stress\n0.1,x\n", "line 2: stress"),
        ("strain,stress\n-0.6,1\n", "line 2: strain"),
        ("strain,stress,strain_across\n0.1,1,\n", "line 2: strain_across"),
    ],
)
def test_bad_files_are_named(tmp_path, text, key):
    path = tmp_path / "skin.csv"
    path.write_text(text)
    with pytest.raises(InputError, match=key):
        read_tissue(path)


@pytest.mark.parametrize("law", LAWS)
def test_command_fits_a_file(tmp_path, law):
    path = tmp_path / "skin.csv"
    stress = sacks(np.array([1e6, 12.0]), STRAIN, incompressible(STRAIN))
    lines = [f"{a:.9g},{b:.9g}" for a, b in zip(STRAIN, stress, strict=True)]
    path.write_text("\n".join(["strain,stress", *lines]) + "\n")
    result = invoke("lab", "calibrate", path, "--law", law, "--json")
    assert result.exit_code == 0, result.stderr
    found = json.loads(result.stdout)
    assert set(found["parameters"]) == set(LAWS[law].names) == set(found["intervals"])
    assert found["error"] < 0.05
