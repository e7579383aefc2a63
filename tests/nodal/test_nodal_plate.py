"""The nodal kinematics as an isotropic plate without Poisson effect."""

import numpy as np
import pytest
from nodal_cases import at_rest, end_row_loads, isotropic, strip_models

from featherfx.lab.nodal.solver import NodalSolver
from featherfx.mechanics.model import no_loads
from featherfx.solver.solver import Settings

LENGTH, WIDTH, THICKNESS, YOUNG = 10.0, 1.0, 0.1, 1.2e6
BENDING = YOUNG * THICKNESS**3 / 12.0


def plate(elements, columns, length=LENGTH, width=WIDTH):
    """A cantilever clamped in the middle between its first two rows, which is second order."""
    spacing = length / (elements - 0.5)
    vane = isotropic(YOUNG, THICKNESS)
    pinned = np.zeros((elements + 1, 1 + 2 * columns), dtype=bool)
    pinned[:2] = True
    start = 0.5 * spacing
    model, nodal = strip_models(
        length + start, width, elements + 1, columns, vane, pinned, bending="plate"
    )
    return model, nodal, start


def bent(elements, columns, force):
    """(U, W) of the middle of the end under a dead end shear, and the final nodes."""
    model, nodal, start = plate(elements, columns)
    loads = end_row_loads(no_loads(1), model, (0.0, 0.0, 1.0), force)
    solver = NodalSolver(model, nodal, Settings(newton=1e-8))
    state, status, _ = solver.equilibrium(at_rest(model, nodal), loads)
    assert status[0] == 0
    tip = state.points.nodes[0, -1, 0]
    return np.array([LENGTH + start - tip[0], tip[2]]), state.points.nodes[0]


@pytest.mark.slow
@pytest.mark.verification
def test_cantilever_under_end_shear():
    """Sze, Liu and Lo 2004, first benchmark: U = 3.286, W = 6.698 at 4 N; the inextensible
    elastica at F L^2 / EI = 4 (Mattiasson 1981) has U = 3.2894, W = 6.6996."""
    (coarse, _), (fine, points) = bent(20, 1, 4.0), bent(40, 1, 4.0)
    assert fine == pytest.approx([3.286, 6.698], rel=2e-3)
    limit = fine + (fine - coarse) / 3.0
    assert limit == pytest.approx([3.2894, 6.6996], rel=2e-4)
    error = np.abs([coarse - [3.2894, 6.6996], fine - [3.2894, 6.6996]]).max(axis=1)
    assert error[0] / error[1] > 3.0
    assert points[-1, 1, 2] == pytest.approx(points[-1, 2, 2], abs=1e-6)


@pytest.mark.verification
@pytest.mark.slow
def test_result_does_not_depend_on_the_direction_of_the_diagonals():
    narrow, _ = bent(20, 1, 4.0)
    wide, _ = bent(20, 3, 4.0)
    assert narrow == pytest.approx(wide, rel=1e-5)


@pytest.mark.verification
@pytest.mark.parametrize("curvatures", [(1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)])
def test_energy_of_constant_curvature(curvatures):
    """1/2 A D (k_along^2 + k_across^2 + 2 k_twist^2) for small k, edges of free hinges left out."""
    model, nodal, _ = plate(12, 4, length=1.0, width=1.0)
    along, across, twist = curvatures
    state = at_rest(model, nodal)
    x, y = nodal.rest_nodes[0, ..., 0], nodal.rest_nodes[0, ..., 1]
    size = 1e-6
    lift = size * (0.5 * along * y**2 + 0.5 * across * x**2 + twist * x * y)
    state.points.nodes[0, ..., 2] += lift
    solver = NodalSolver(model, nodal, Settings())
    energy = solver.system(state, no_loads(1), 0).energy
    spacing = 1.0 / 11.5
    area = 12 * spacing
    weight = along**2 + across**2 + 2.0 * twist**2
    expected = 0.5 * area * BENDING * size**2 * weight
    # where a hinge is missing at a free edge the triangle relaxes: energy is lost there only
    edge = 0.5 * (2.0 * spacing + 2.0 * area / 8.0) * BENDING * size**2 * weight
    assert expected - edge <= energy <= expected * (1.0 + 1e-6)
