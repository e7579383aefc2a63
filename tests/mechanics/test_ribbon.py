"""Ribbons: the energy of a section that curls, against the least of what it is derived from."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.polynomial import Legendre, legendre

from featherfx.errors import InputError
from featherfx.feather.build import build_feather
from featherfx.lab.nodal.model import nodal_model
from featherfx.lab.ribbons.energy import Ribbon
from featherfx.lab.ribbons.experiments import feather_of, hang, hang_feather
from featherfx.mechanics.batch import make_model
from featherfx.mechanics.ribbon_kernels import curl_energy, curling
from featherfx.solver.damping import frequencies

WIDTH, THICKNESS, LENGTH = 0.015, 8.5e-5, 0.0125


def _rest(bend, poisson, thickness=THICKNESS):
    flatness = 3.0 / 16.0 * (1.0 - poisson**2) * WIDTH**4 / (thickness * LENGTH) ** 2
    return np.array([1.0, 0.0, 0.0, 0.0, bend, 0.0, poisson, flatness])


def _least(twist, bend, rest, poisson, thickness=THICKNESS, terms=40):
    """Energy over D w / l of a section whose height is a sum of Legendre polynomials, the best."""
    k, k0, t = bend / LENGTH, rest / LENGTH, twist / LENGTH
    v, weight = legendre.leggauss(2 * terms)
    half = 0.5 * WIDTH
    even = [Legendre.basis(2 * n) for n in range(1, terms)]
    height = np.array([p(v) for p in even]).T
    curl = np.array([p.deriv(2)(v) for p in even]).T / half**2
    membrane = 12.0 * (1.0 - poisson**2) / thickness**2
    free = half**2 * (v**2 - 1.0 / 3.0) * 0.5 * t * t
    root = np.sqrt(0.5 * weight)[:, None]
    # two sums of squares: of stretch, and of curl about -nu (k - k0)
    lines = np.concatenate([np.sqrt(membrane) * -k * root * height, root * curl])
    right = np.concatenate(
        [-np.sqrt(membrane) * root[:, 0] * free, -poisson * (k - k0) * root[:, 0]]
    )
    found = np.linalg.lstsq(lines, right, rcond=None)[0]
    squares = float(np.sum((lines @ found - right) ** 2))
    rod = (1.0 - poisson**2) * (k - k0) ** 2 + 2.0 * (1.0 - poisson) * t * t
    return 0.5 * LENGTH**2 * (rod + squares)


@pytest.mark.verification
@pytest.mark.parametrize("seed", range(6))
def test_the_section_takes_the_shape_of_least_energy(seed):
    random = np.random.default_rng(seed)
    twist, bend, rest = random.uniform(-0.6, 0.6, 3)
    poisson, thickness = random.uniform(0.0, 0.5), THICKNESS * 10.0 ** random.uniform(-0.5, 1.0)
    strain = np.array([0.0, 0.0, 0.0, twist, bend - rest, 0.0])
    beam = 1.0 - poisson**2
    curl = curl_energy(strain, _rest(rest, poisson, thickness), beam)[0]
    rod = 0.5 * (beam * (bend - rest) ** 2 + 2.0 * (1.0 - poisson) * twist**2)
    assert rod + curl == pytest.approx(_least(twist, bend, rest, poisson, thickness), rel=1e-6)


@pytest.mark.verification
def test_thin_strips_are_developable():
    """Sadowsky's energy with a rest curvature, as lab/ribbons/energy.py has it."""
    twist, bend, rest, nu = 0.2, 0.35, 0.3, 0.4
    strain = np.array([0.0, 0.0, 0.0, twist, bend - rest, 0.0])
    ruling = twist / bend
    developable = 0.5 * (
        bend**2 * (1.0 + ruling**2) ** 2 - 2.0 * rest * bend * (1.0 + nu * ruling**2) + rest**2
    )
    rod = 0.5 * ((1.0 - nu**2) * (bend - rest) ** 2 + 2.0 * (1.0 - nu) * twist**2)
    gaps = []
    for thickness in (1e-6, 1e-8):
        curl = curl_energy(strain, _rest(rest, nu, thickness), 1.0 - nu**2)[0]
        gaps.append(abs(rod + curl - developable))
    # boundary layers at the edges are as wide as the square root of the thickness
    assert gaps[1] == pytest.approx(0.1 * gaps[0], rel=1e-2)
    assert gaps[1] < 1e-3 * developable


@pytest.mark.parametrize("bend", [-0.4, 0.0, 1e-3, 0.7])
@pytest.mark.parametrize("thickness", [THICKNESS, 1e-6])
def test_derivatives(bend, thickness):
    rest, at = _rest(0.2, 0.35, thickness), np.array([0.15, bend])

    def energy(place):
        strain = np.array([0.0, 0.0, 0.0, place[0], place[1] - rest[4], 0.0])
        return curl_energy(strain, rest, 2.0)

    steps = 1e-6 * np.eye(2)
    value, by_a, by_b, aa, ab, bb = energy(at)
    size = abs(aa) + abs(bb)
    sides = [[energy(at + sign * step) for sign in (1, -1)] for step in steps]
    slopes = [(up[0] - down[0]) / 2e-6 for up, down in sides]
    assert slopes == pytest.approx([by_a, by_b], rel=1e-5, abs=1e-6 * size)
    second = [[(up[k] - down[k]) / 2e-6 for k in (1, 2)] for up, down in sides]
    assert np.array(second) == pytest.approx(
        np.array([[aa, ab], [ab, bb]]), rel=1e-4, abs=1e-4 * size
    )
    assert value >= 0.0


def test_series_and_its_limit_meet():
    before, after = (np.array(curling(30.0**4 * share)) for share in (1.0, 1.0 + 1e-12))
    assert after == pytest.approx(before, rel=1e-10)
    assert curling(0.0)[0] == pytest.approx(1.0 / 180.0)


STRIP = Ribbon(0.1, 0.005, 2e-4, 0.05)


@pytest.mark.verification
def test_a_flat_ribbon_swings_as_a_beam():
    """A strip that hardly bends does not curl: w = 1.875104^2 sqrt(D w (1 - nu^2) / m) / L^2."""
    kind = feather_of(STRIP, 1e-4)
    model = make_model([build_feather(kind, 41, 1)], [kind], 0)
    beam = (1.0 - STRIP.poisson**2) * STRIP.rigidity / STRIP.surface_density
    expected = 1.875104**2 / (2.0 * np.pi) * np.sqrt(beam) / STRIP.length**2
    assert frequencies(model, 0, 1)[0] == pytest.approx(expected, rel=5e-3)


@pytest.mark.verification
def test_a_curled_ribbon_hangs_as_sadowskys():
    """The strip of Charrondiere et al. 2019, section 5.2, thin: beyond its plane."""
    strip = Ribbon(0.5, 0.015, 2e-4, 0.015, 30.0, finite_width=False)
    points = hang(strip).rest.curve.points
    found = hang_feather(feather_of(strip, 1e-7), 161)
    assert abs(found[-1, 2]) > 0.02
    found[:, 2] *= np.sign(found[-1, 2] * points[-1, 2])
    assert found[-1] == pytest.approx(points[-1], abs=2e-3 * strip.length)


def test_ribbons_and_shafts_in_one_batch():
    """What is beside a ribbon stays what it is alone."""
    ribbon = feather_of(STRIP, 1e-4)
    shaft = replace(
        ribbon,
        vane_material=replace(ribbon.vane_material, ribbon=False),
        rachis=replace(ribbon.rachis, diameter_base=1e-3, diameter_tip=1e-3),
        rachis_material=replace(ribbon.rachis_material, youngs_modulus=3e9, shear_modulus=1e9),
    )
    kinds = [ribbon, shaft]
    both = make_model([build_feather(kind, 9, 1) for kind in kinds], kinds, 0)
    for f, kind in enumerate(kinds):
        alone = make_model([build_feather(kind, 9, 1)], [kind], 0)
        assert frequencies(both, f, 2) == pytest.approx(frequencies(alone, 0, 2), rel=1e-9)
    with pytest.raises(InputError, match="ribbon"):
        nodal_model(both, [build_feather(kind, 9, 1) for kind in kinds], kinds)
