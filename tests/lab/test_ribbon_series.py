"""The centreline of a ribbon by power series."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.interpolate import lagrange

from featherfx.lab.ribbons.curve import (
    MAX_PIECE_TURN,
    centreline,
    energy_of_loads,
    pieces_of,
    series_points,
)
from featherfx.lab.ribbons.energy import Ribbon
from featherfx.lab.ribbons.experiments import GRAVITY_ALONG_Y as WEIGHT
from featherfx.lab.ribbons.experiments import clamp_frame, hang
from featherfx.lab.ribbons.oracles import solved

pytestmark = pytest.mark.verification
RIBBON = Ribbon(0.7, 0.02, 2e-4, 0.3, 5.0, tip_width=0.01, elements=3)
GRAVITY_ALONG_Y, FORCE = np.array([0.3, -9.81, 1.0]), np.array([0.01, 0.02, -0.03])


CUBIC = replace(RIBBON, length=0.1, elements=1, degree=3)


def drawn(seed=0, ribbon=RIBBON):
    random, size = np.random.default_rng(seed), ribbon.nodes
    unknowns = np.concatenate([6.0 * random.normal(size=size), 0.4 * random.normal(size=size)])
    frame = np.linalg.qr(random.normal(size=(3, 3)))[0]
    return unknowns, frame * np.sign(np.linalg.det(frame))


@pytest.mark.parametrize("ribbon", [RIBBON, CUBIC])
def test_points_solve_the_equations_of_the_curve(ribbon):
    unknowns, frame = drawn(0, ribbon)
    own = ribbon.own_nodes()

    def rates(s, state, place, values):
        c, t = (each(s - place) for each in values)
        axes = state[3:].reshape(3, 3)
        spin = np.array([[0, -c * t, 0], [c * t, 0, -c], [0, c, 0]])
        return np.concatenate([axes[:, 2], (axes @ spin).ravel()])

    start = np.concatenate([np.zeros(3), frame.ravel()])
    exact = start
    for element, ends in enumerate(pairwise(ribbon.stations)):
        nodes = own[element]
        local = ribbon.node_stations[nodes] - ends[0]
        values = [lagrange(local, each[nodes]) for each in np.split(unknowns, 2)]
        run = solve_ivp(
            rates, ends, exact, "DOP853", args=(ends[0], values), rtol=1e-12, atol=1e-14
        )
        exact = run.y[:, -1]
    found = series_points(ribbon, unknowns, frame, 1)[0]
    assert found[-1] == pytest.approx(exact[:3], abs=1e-10)


def test_strong_curls_are_cut_so_that_no_term_grows():
    """A circle of 300 rad in one element comes back to where a circle is."""
    ribbon = Ribbon(1.0, 0.01, 1.0, 0.0, elements=1)
    unknowns = np.array([300.0, 300.0, 0.0, 0.0])
    assert len(pieces_of(ribbon, unknowns).length) == pytest.approx(300.0 / MAX_PIECE_TURN, abs=1)
    tip = series_points(ribbon, unknowns, np.eye(3), 1)[0][-1]
    assert tip == pytest.approx(
        [0.0, (np.cos(300.0) - 1) / 300.0, np.sin(300.0) / 300.0], abs=1e-11
    )


@pytest.mark.parametrize("ribbon", [RIBBON, CUBIC])
def test_gradient_and_hessian_are_those_of_the_energy(ribbon):
    unknowns, frame = drawn(1, ribbon)
    _, gradient, hessian = energy_of_loads(ribbon, unknowns, frame, GRAVITY_ALONG_Y, FORCE)
    step = 1e-5
    for k in range(len(unknowns)):
        way = step * np.eye(len(unknowns))[k]
        above, below = (
            energy_of_loads(ribbon, unknowns + each, frame, GRAVITY_ALONG_Y, FORCE)
            for each in (way, -way)
        )
        assert gradient[k] == pytest.approx((above[0] - below[0]) / (2 * step), abs=1e-9)
        assert hessian[k] == pytest.approx((above[1] - below[1]) / (2 * step), abs=1e-8)


def test_links_go_to_the_series_with_the_square_of_their_length():
    unknowns, frame = drawn(2)
    tip = series_points(RIBBON, unknowns, frame, 1)[0][-1]
    errors = [
        np.linalg.norm(centreline(RIBBON, unknowns, frame, links).points[-1] - tip)
        for links in (32, 64)
    ]
    assert errors[0] / errors[1] == pytest.approx(4.0, rel=0.02)


def test_few_elements_of_degree_2_hang_as_the_equations_say():
    """5 of them, beside moments and forces by collocation; as many of degree 1 miss by 3 %."""
    ribbon = Ribbon(0.25, 0.01, 2e-4, 0.1, 60.0, elements=5, series=True)
    rests = [hang(replace(ribbon, degree=degree)).rest for degree in (1, 2)]
    exact = solved(replace(ribbon, degree=2), rests[1], clamp_frame("level"), WEIGHT)[-1]
    errors = [np.linalg.norm(rest.curve.points[-1] - exact) / ribbon.length for rest in rests]
    assert errors[0] > 0.01
    assert errors[1] < 1e-3


def test_hung_strip_is_that_of_many_links():
    ribbon = Ribbon(0.2, 0.01, 2e-4, 0.1, 60.0, elements=10)
    by_links, by_series = hang(ribbon).rest, hang(replace(ribbon, series=True)).rest
    assert by_series.stability > 0.0
    assert by_series.curve.points[-1] == pytest.approx(
        by_links.curve.points[-1], abs=2e-3 * ribbon.length
    )
