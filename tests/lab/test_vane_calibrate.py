"""Calibration: round trips, refusals, CSV with faults, presets."""

import csv
import json

import numpy as np
import pytest
from commands import invoke

from featherfx.errors import InputError
from featherfx.groom.presets.presets import load_preset
from featherfx.lab.vane.calibrate import (
    CALIBRATED,
    CURVE_COLUMNS,
    MeasuredCurve,
    calibrate,
    read_curves,
)
from featherfx.lab.vane.sample import Moduli, Sample
from featherfx.lab.vane.traction import Traction, pull_test

TRUE = Moduli(3.6e8, 4.8e4, 2.78e4)
ELEMENTS = 500


def write_curves(path, curves):
    """A file that read_curves reads."""
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(CURVE_COLUMNS)
        for curve in curves:
            part = curve.sample
            size = (part.angle, part.width, part.height, part.thickness)
            for strain, stress in zip(curve.strain, curve.stress, strict=True):
                writer.writerow([repr(float(each)) for each in (strain, stress, *size)])


@pytest.fixture(scope="module")
def curves():
    found = []
    for angle, largest in ((0.0, 0.3), (90.0, 0.01), (40.0, 0.08)):
        sample = Sample(angle, 13e-3, 18e-3)
        pulled = pull_test(Traction(sample, TRUE, largest, 8, ELEMENTS))
        found.append(MeasuredCurve(sample, pulled.strain, pulled.stress))
    return tuple(found)


@pytest.fixture(scope="module")
def fitted(curves):
    return calibrate(curves, ELEMENTS)


def test_round_trip(fitted):
    for name in CALIBRATED:
        assert getattr(fitted.moduli, name) == pytest.approx(getattr(TRUE, name), rel=1e-3)
    assert fitted.residual < 1e-3
    assert min(fitted.identified) > 0.1
    assert 1.0 <= fitted.conditioning < 10.0


def test_noise_is_borne_and_known(curves):
    """2 % noise: within 5 %, and the intervals hold the truth and are of the noise's size."""
    generator = np.random.default_rng(5)
    noisy = [
        MeasuredCurve(c.sample, c.strain, c.stress * (1.0 + 0.02 * generator.standard_normal(8)))
        for c in curves
    ]
    found = calibrate(noisy, ELEMENTS)
    for name in CALIBRATED:
        value, true = getattr(found.moduli, name), getattr(TRUE, name)
        low, high = getattr(found.low, name), getattr(found.high, name)
        assert value == pytest.approx(true, rel=0.05)
        assert low < true < high
        assert 0.005 < (high - low) / value < 0.1


@pytest.mark.parametrize(
    ("chosen", "missing"),
    [((0, 1), {"shear"}), ((1, 2), {"across"}), ((0, 2), {"along"}), ((0,), {"along", "shear"})],
)
def test_sets_that_cannot_tell_are_refused(curves, chosen, missing):
    with pytest.raises(InputError) as error:
        calibrate([curves[k] for k in chosen])
    assert {problem.key for problem in error.value.problems} == missing
    assert "Missing is a" in str(error.value)


def test_diagonal_and_falling_curves_are_refused(curves):
    diagonal = MeasuredCurve(Sample(45.0, 0.01, 0.01), np.array([0.01]), np.array([1e4]))
    falling = MeasuredCurve(curves[0].sample, curves[0].strain, -curves[0].stress)
    with pytest.raises(InputError) as error:
        calibrate([*curves, diagonal, falling])
    assert len(error.value.problems) == 2


def test_csv_round_trip(curves, tmp_path):
    write_curves(tmp_path / "tests.csv", curves)
    read = read_curves(tmp_path / "tests.csv")
    for a, b in zip(read, curves, strict=True):
        assert a.sample == b.sample
        assert np.array_equal(a.strain, b.strain)
        assert np.array_equal(a.stress, b.stress)


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("0.1,,0,0.01,0.01,1e-4", "line 2, stress: is empty"),
        ("0.1,nan,0,0.01,0.01,1e-4", "line 2, stress: nan is not finite"),
        ("0.1,x,0,0.01,0.01,1e-4", "'x' is not a number"),
        ("0.1,5,0,0.01,0.01,120", "Is this in micrometres"),
        ("0.1,5,0,13,0.01,1e-4", "Is this in millimetres"),
        ("0.1,5,120,0.01,0.01,1e-4", "-90 to 90 degrees"),
        ("5,5,0,0.01,0.01,1e-4", "Is this in percent"),
        ("-0.5,5,0,0.01,0.01,1e-4", "above -0.5"),
        ("0.1,5,0,0.01,0.01", "line 2, thickness: is empty"),
        ("", "holds no points"),
    ],
)
def test_faults_of_a_csv(tmp_path, line, message):
    file = tmp_path / "tests.csv"
    file.write_text(",".join(CURVE_COLUMNS) + "\n" + line + "\n")
    with pytest.raises(InputError, match=message):
        read_curves(file)


def test_all_faults_of_a_csv_are_told(tmp_path):
    file = tmp_path / "tests.csv"
    lines = [
        ",".join(CURVE_COLUMNS),
        "0.1,1,95,0.01,0.02,1e-4",
        "-0.6,1,0,0.01,0.02,nan",
        "0.1,1,0,0,1,1",
    ]
    file.write_text("\n".join(lines))
    with pytest.raises(InputError) as raised:
        read_curves(file)
    assert [each.key for each in raised.value.problems] == [
        "line 3, strain",
        "line 3, thickness",
        "line 2, angle",
        "line 4, width",
        "line 4, thickness",
    ]


def test_too_few_elements(curves):
    with pytest.raises(InputError, match="elements"):
        calibrate(curves, 0)


def test_missing_columns_are_named(tmp_path):
    file = tmp_path / "tests.csv"
    file.write_text("strain,stress,angle\n0.1,5,0\n")
    with pytest.raises(InputError, match="width, height, thickness"):
        read_curves(file)


def test_command_saves_a_preset(curves, tmp_path):
    write_curves(tmp_path / "tests.csv", curves)
    arguments = ["lab", "calibrate", str(tmp_path / "tests.csv"), "--elements", str(ELEMENTS)]
    arguments += ["--save", str(tmp_path), "--name", "my_vane", "--json"]
    done = invoke(*arguments)
    assert done.exit_code == 0, done.stderr
    values = json.loads(done.stdout)
    assert values["shear"]["value"] == pytest.approx(TRUE.shear, rel=1e-3)
    family, tree = load_preset("my_vane", (tmp_path,))
    assert family == "material/vane"
    assert tree["modulus_across_barbs"].value == pytest.approx(TRUE.across, rel=1e-3)
    again = invoke(*arguments)
    assert again.exit_code == 1
    assert "exists already" in again.stderr


def test_commands_refuse_bad_input(tmp_path):
    cases = (
        ("traction", "--angle", "45", "--width", "0.01", "--height", "0", "--thickness", "120"),
        ("traction", "--angle", "91", "--width", "0.01", "--height", "0.02"),
        ("mesoscale", "--barb-fraction", "1.5"),
        ("calibrate", str(tmp_path / "none.csv")),
        ("angles", "--angle", "60"),
        ("locking", "--ratio", "0"),
    )
    for case in cases:
        done = invoke("lab", *case)
        assert done.exit_code == 1, case
        assert done.stderr.startswith("featherfx: ")


def test_traction_command_gives_its_keys():
    arguments = ["traction", "--angle", "30", "--width", "0.013", "--height", "0.018"]
    done = invoke("lab", *arguments, "--elements", "400", "--json")
    assert done.exit_code == 0, done.stderr
    values = json.loads(done.stdout)
    keys = ("strain", "stress", "slope", "elements", "unknowns", "iterations", "seconds")
    assert set(keys) <= set(values)
    assert len(values["stress"]) == 10
