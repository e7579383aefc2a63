"""Spacing of barbs and width of shafts by length, against feathers of museum skins.

feather_measures.csv: flying species of Saitta et al. 2025, Evolution, data (CC0)
doi:10.5061/dryad.qrfj6q5s7. spacing: mean of both vanes in the middle of the part that shows, whose
length and whose shaft at the base are there too.
"""

import csv
from pathlib import Path

import numpy as np
import pytest

from featherfx.groom.keys.problems import Place, Problems
from featherfx.groom.presets.kinds import Change, adjusted, kind_of
from featherfx.groom.presets.presets import load_preset

CONTOUR = "dorsal_contour", "ventral_contour"
LENGTHS = 0.008, 0.025, 0.06  # m, from a face to a swan


def measured(*feathers):
    """Return length (m), shaft (m) and spacing (m) of feathers."""
    with (Path(__file__).parent / "feather_measures.csv").open() as file:
        rows = [each for each in csv.DictReader(file) if each["feather"] in feathers]
    names = "length_mm", "rachis_mm", "spacing_mm"
    return np.array([[1e-3 * float(row[name]) for name in names] for row in rows]).T


def exponent(length, value):
    """Return the power of length that a value goes with, and its standard error."""
    found, covariance = np.polyfit(np.log(length), np.log(value), 1, cov=True)
    return found[0], np.sqrt(covariance[0, 0])


def of_length(name, length):
    kind = kind_of(name, load_preset(f"feather/{name}")[1], Place("", "", Problems()))
    return adjusted(kind, Change(scale=length / kind.length))


def power(name, value):
    ends = [value(of_length(name, length)) for length in (0.02, 0.2)]
    return np.log10(ends[1] / ends[0])


@pytest.mark.parametrize(
    ("preset", "feathers"),
    [
        ("contour", CONTOUR),
        ("primary", ("primary",)),
        ("rectrix", ("rectrix",)),
        ("tertial", ("tertial",)),
    ],
)
def test_barbs_and_shafts_grow_with_the_length_as_measured(preset, feathers):
    length, shaft, spacing = measured(*feathers)
    barbs, barbs_error = exponent(length, spacing)
    assert power(preset, lambda kind: kind.barb_spacing) == pytest.approx(barbs, abs=barbs_error)
    shafts, shafts_error = exponent(length, shaft)
    found = power(preset, lambda kind: kind.rachis.diameter_base)
    assert found == pytest.approx(shafts, abs=2.5 * shafts_error)


@pytest.mark.parametrize("length", LENGTHS)
@pytest.mark.parametrize("preset", ["contour", "covert"])
def test_barbs_of_contour_feathers_stand_as_far_apart_as_measured(preset, length):
    spacing = np.exp(np.log(measured(*CONTOUR)[2]).mean())
    kind = of_length(preset, length)
    assert kind.barb_spacing == pytest.approx(spacing, rel=0.2)
    assert kind.barb_count == pytest.approx(length * (1.0 - kind.calamus) / spacing, rel=0.25)
