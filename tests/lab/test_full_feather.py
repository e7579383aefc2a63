"""A whole feather that is pulled; the longer comparison of materials is a study of the report."""

import numpy as np
import pytest

from featherfx.errors import InputError
from featherfx.lab.full_feather import FEATHER_LENGTH, FullPull, edge_waves, pull_feather


@pytest.mark.parametrize("wavelength", [0.022, 0.035])
def test_waves_of_an_edge_are_found(wavelength):
    """A sine of amplitude 1 mm on a bent and tilted edge: root mean square 1 / sqrt 2 mm."""
    arc = np.linspace(0.0, 0.18, 41)
    trend = 0.01 - 0.3 * arc + 2.0 * arc**2 - 5.0 * arc**3
    found = edge_waves(arc, trend + 1e-3 * np.sin(2.0 * np.pi * arc / wavelength))
    assert found[0] == pytest.approx(wavelength, rel=0.05)
    assert found[1] == pytest.approx(1e-3 / np.sqrt(2.0), rel=0.1)


def test_pulled_tip_goes_where_it_is_pulled_and_barbs_do_not_stretch():
    pull = FullPull("tip", 0.1, parts=2, rows=13, columns=3)
    found = pull_feather(pull)
    assert found.rachis_deflection == pytest.approx(0.1, abs=0.005)
    assert found.points[-1, 0, 1] == pytest.approx(-0.1 * FEATHER_LENGTH, abs=1e-3)
    assert found.barb_strain < 1e-10
    assert found.points.shape == found.rest.shape == (13, 7, 3)
    # linear spring of the grip: shaft and pull agree
    twice = pull_feather(FullPull("tip", 0.2, parts=4, rows=13, columns=3))
    assert 1.5 < twice.force / found.force < 3.0


def test_wrong_values_are_all_told():
    with pytest.raises(InputError) as caught:
        FullPull("back", 0.0, parts=0, rows=2, columns=99)
    keys = [problem.key for problem in caught.value.problems]
    assert keys == ["scene", "distance", "parts", "rows", "columns"]
    with pytest.raises(InputError, match="steel"):
        FullPull("tip", material="steel")
