"""Natural frequencies of clamped rods."""

import numpy as np
import pytest

from featherfx.errors import InputError
from featherfx.lab.ribbons.rod import Rod, natural_frequencies

pytestmark = pytest.mark.verification

# roots of cosh x cos x = -1
WAVE_NUMBERS = np.array([1.8751040687, 4.6940911330, 7.8547574382, 10.9955407349])


def closed_form(rod):
    return WAVE_NUMBERS**2 * np.sqrt(rod.ei / rod.line_mass) / rod.length**2 / (2.0 * np.pi)


def test_unequal_planes_have_their_own_frequencies():
    rod = Rod(0.3, ei=2e-3, ei2=1e-3, gj=1.0, line_mass=0.01)
    found = natural_frequencies(rod, 4)
    first = closed_form(rod)[:2]
    expected = np.sort(np.concatenate([first, first / np.sqrt(2.0)]))
    assert found == pytest.approx(expected, rel=2e-3)


def test_second_order_in_the_number_of_rows():
    def errors(segments):
        rod = Rod(1.0, 1.0, line_mass=1.0, segments=segments)
        return np.abs(natural_frequencies(rod, 8)[0::2] / closed_form(rod) - 1.0)

    ratios = errors(20) / errors(40)
    assert (ratios > 3.6).all(), ratios


def test_count_is_checked_with_the_rod():
    with pytest.raises(InputError) as caught:
        natural_frequencies(Rod(1.0, ei=-1.0, segments=5), 16)
    assert [problem.key for problem in caught.value.problems] == ["ei", "count"]


def test_rods_of_few_segments_have_modes_too():
    exact = 1.8751040687**2 / (2.0 * np.pi)
    rods = [Rod(1.0, 1.0, line_mass=1.0, segments=count) for count in (2, 4, 8)]
    errors = [exact - natural_frequencies(rod, 1)[0] for rod in rods]
    assert errors[0] / errors[1] == pytest.approx(4.0, rel=0.05)
    assert errors[1] / errors[2] == pytest.approx(4.0, rel=0.05)
