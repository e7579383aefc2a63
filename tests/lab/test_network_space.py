"""Networks in space: coupled fibres, linked sheets, equations of any number of directions."""

import numpy as np
import pytest

from featherfx.lab.networks.layouts import (
    FibreSection,
    Mikado,
    SpaceMikado,
    linked_sheets,
    mikado,
    shear,
    space_mikado,
)
from featherfx.lab.networks.network import held_system, solve
from featherfx.lab.studies.space import small

pytestmark = pytest.mark.verification
SECTION = FibreSection(1.0, 1e-4)


def test_printed_numbers_of_small_networks():
    """Houghton 2020, equations 6.24, 6.31 and 6.34, tables 6.5 to 6.8, steps to the last digit."""
    found = small(None)
    assert len(found.rows) > 20
    assert found.verdict == "agrees"


def test_coupled_fibres_are_all_pairs_that_come_near():
    """Beside points of every pair, spread along both fibres, and their periodic copies."""
    plan = SpaceMikado(24, 0.1, seed=2)
    random = np.random.default_rng(plan.seed)
    middle, along = random.random((24, 3)), random.normal(size=(24, 3))
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    places = np.linspace(-0.25, 0.25, 101)
    count = 0
    for i in range(24):
        for j in range(i):
            apart = middle[i] - middle[j]
            apart[[0, 2]] -= np.round(apart[[0, 2]])
            one, other = places[:, None] * along[i], places[:, None] * along[j]
            way = np.linalg.norm(apart + one[:, None] - other[None], axis=-1)
            at = np.unravel_index(way.argmin(), way.shape)
            inside = all(0 < k < 100 for k in at)
            height = middle[[i, j], 1] + places[list(at)] * along[[i, j], 1]
            count += way.min() < plan.reach and inside and (height > 0).all() and (height < 1).all()
    layout = space_mikado(plan, SECTION)
    leaves = len(layout.held)
    assert len(layout.places) - leaves == pytest.approx(count, abs=1)
    height = layout.places[layout.held, 1]
    assert np.minimum(height, 1.0 - height) == pytest.approx(0.0, abs=1e-12)


def test_a_sheet_in_space_carries_what_it_carries_in_its_plane():
    """Houghton 2020, tables 6.1 and 6.2; sheared out of its plane it costs nothing (eq. 6.28)."""
    sheet = mikado(Mikado(40, 2.0, periodic=False), SECTION).carrying()
    layout = linked_sheets(sheet, 1, 0.2, 0.1)
    gradient = np.zeros((3, 3))
    gradient[0, 1] = 0.1
    moved = sheet.places @ gradient[:2, :2].T
    system = held_system(sheet.network, sheet.held, moved[sheet.held])
    flat = np.linalg.solve(system.matrix.toarray(), system.right)
    whole = moved.ravel()
    whole[system.free] = flat
    energy = 0.5 * whole @ (_stiffness(sheet.network) @ whole)
    assert shear(layout, gradient).energy == pytest.approx(energy, rel=1e-6)
    aside = np.zeros((3, 3))
    aside[2, 1] = 0.1
    assert shear(layout, aside).energy < 1e-6 * energy


def _stiffness(network):
    return held_system(network, np.zeros(0, dtype=np.int64), np.zeros((0, 2))).matrix


def test_linked_sheets_have_one_link_a_node_and_direction():
    sheet = mikado(Mikado(30, 2.0, periodic=False), SECTION)
    layout = linked_sheets(sheet, 3, 0.2, 0.15)
    links = layout.network.ends[layout.links]
    assert len(links) > 10
    for end in range(2):
        assert len(np.unique(links[:, end])) == len(links)
    apart = layout.places[links[:, 1]] - layout.places[links[:, 0]]
    assert apart[:, 2] == pytest.approx(0.2)
    assert np.linalg.norm(apart[:, :2], axis=1).max() <= 0.15


@pytest.mark.parametrize(("method", "choice"), [("pcg", "P_Db"), ("gmres", "P_Ab")])
def test_preconditioners_go_with_three_directions(method, choice):
    layout = linked_sheets(mikado(Mikado(30, 2.0, periodic=False), SECTION).carrying(), 2, 0.2, 0.3)
    moved = 0.1 * layout.places[layout.held][:, [1, 2, 0]]
    system = held_system(layout.network, layout.held, moved)
    exact = np.linalg.solve(system.matrix.toarray(), system.right)
    found = solve(system, method, choice, 1e-12, directions=3)
    assert found.displacements == pytest.approx(exact, abs=1e-8)
