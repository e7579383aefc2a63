"""Rest shapes of ribbons."""

import numpy as np
import pytest

from featherfx.errors import InputError
from featherfx.lab.ribbons.energy import Ribbon
from featherfx.lab.ribbons.experiments import cantilever_ratios, clamp_frame, hang, hang_rod, rod_of
from featherfx.lab.ribbons.oracles import heavy_elastica
from featherfx.lab.ribbons.ribbon import settle_ribbon

CURL = {"width": 0.01, "rigidity": 2e-4, "surface_density": 0.1, "rest_curvature": 60.0}


def test_without_loads_the_rest_shape_stays():
    ribbon = Ribbon(0.1, **CURL)
    rest = settle_ribbon(ribbon, np.eye(3), np.zeros(3))
    assert rest.unknowns == pytest.approx(ribbon.rest)
    assert rest.curve.points[-1] == pytest.approx(
        [0.0, (np.cos(6.0) - 1.0) / 60.0, np.sin(6.0) / 60.0], abs=2e-5
    )


@pytest.mark.verification
@pytest.mark.parametrize("load", [1e-2, 1.0, 1e2])
def test_heavy_cantilever_against_shooting(load):
    x, drop = heavy_elastica(load)
    assert cantilever_ratios([load])[0] == pytest.approx(drop / x, rel=5e-4)


@pytest.mark.verification
def test_heavy_elastica_has_its_limits():
    """Linear theory: drop / L = load / 8. A strip that hangs bends in a layer at the clamp only,
    where p'^2 / 2 = load (1 - cos p), so p' = -2 load^(1/2) sin(p / 2), and x, the integral of
    sin p / |p'| from 0 to pi / 2, is 2 sin(pi / 4) / load^(1/2)."""
    x, drop = heavy_elastica(1e-3)
    assert drop / x == pytest.approx(1e-3 / 8.0, rel=1e-5)
    x, drop = heavy_elastica(1e4)
    assert x == pytest.approx(2.0 * np.sin(np.pi / 4.0) / np.sqrt(1e4), rel=1e-2)


@pytest.mark.verification
def test_curl_is_planar_when_short_and_leaves_its_plane_when_long():
    """Published: between 27 and 31 cm, at 29 cm."""
    short, long = (hang(Ribbon(length, **CURL)) for length in (0.27, 0.32))
    assert short.out_of_plane == pytest.approx(0.0, abs=1e-9)
    assert long.out_of_plane > 0.02
    assert min(short.rest.stability, long.rest.stability) > 0.0
    held = hang(Ribbon(0.32, **CURL), planar=True)
    assert held.rest.stability < 0.0
    assert held.out_of_plane == pytest.approx(0.0, abs=1e-9)
    assert long.rest.energy < held.rest.energy


@pytest.mark.verification
def test_rod_and_ribbon_coincide_while_planar():
    ribbon = Ribbon(0.2, **CURL)
    rod = hang_rod(rod_of(ribbon, 1e-4), ribbon.surface_density * ribbon.width)
    assert rod[-1] == pytest.approx(hang(ribbon).rest.curve.points[-1], abs=2e-3 * 0.2)


def test_tapered_strip_hangs_less():
    wide, narrow = (Ribbon(0.2, 0.01, 2e-4, 0.1, tip_width=tip) for tip in (0.01, 0.004))
    drops = [-hang(each).rest.curve.points[-1][1] for each in (wide, narrow)]
    assert 0.0 < drops[1] < drops[0]


def test_tip_force_acts():
    """Small force: F L^3 / 3 D w."""
    ribbon = Ribbon(0.2, 0.01, 2e-4, 0.0)
    force = np.array([0.0, 1e-6, 0.0])
    rest = settle_ribbon(ribbon, clamp_frame("level"), np.zeros(3), tip_force=force)
    assert rest.curve.points[-1, 1] == pytest.approx(1e-6 * 0.2**3 / 3 / 2e-6, rel=2e-3)


def test_wrong_clamp_and_rod():
    with pytest.raises(InputError, match="sideways"):
        hang(Ribbon(0.1, **CURL), "sideways")
    with pytest.raises(InputError, match="tapers"):
        rod_of(Ribbon(0.1, 0.01, 2e-4, 0.1, tip_width=0.001), 1e-4)
