"""A slit annular plate that is lifted at one side of its slit, in the nodal kinematics."""

from __future__ import annotations

import numpy as np
import pytest
from nodal_cases import at_rest, end_row_loads, isotropic

from featherfx.feather.types import LEADING, TRAILING, Feather, RowPoints, barb_slice
from featherfx.feather.vane import vane_surface
from featherfx.lab.nodal.model import nodal_model
from featherfx.lab.nodal.solver import NodalSolver
from featherfx.lab.strip import RACHIS_SIZE, strip_kind
from featherfx.mechanics.batch import make_model
from featherfx.mechanics.model import no_loads
from featherfx.solver.solver import Settings

INNER, OUTER, THICKNESS, YOUNG = 6.0, 10.0, 0.03, 21e6
MIDDLE, HALF = 0.5 * (INNER + OUTER), 0.5 * (OUTER - INNER)
# N, all along the edge
FULL = 0.8 * (OUTER - INNER)


def ring(rows: int, columns: int) -> Feather:
    """Barbs along the radii, the leading ones inwards; the clamp lies between the first two."""
    turn = 2.0 * np.pi / (rows - 0.5) * np.arange(rows + 1)
    radius = np.full(1 + 2 * columns, MIDDLE)
    share = HALF * np.arange(1, columns + 1) / columns
    radius[barb_slice(LEADING, columns)] -= share
    radius[barb_slice(TRAILING, columns)] += share
    flat = np.zeros_like(turn)
    out = np.stack([np.sin(turn), -np.cos(turn), flat], axis=-1)
    nodes = radius[:, None] * out[:, None] + [0.0, MIDDLE, 0.0]
    up = np.broadcast_to([0.0, 0.0, 1.0], out.shape)
    station = MIDDLE * turn
    span = np.full(rows + 1, station[1])
    span[[0, -1]] *= 0.5
    length = np.full((2, rows + 1), HALF)
    cell = np.ones((2, rows, columns, 2), dtype=np.bool_)
    return Feather(
        rest=RowPoints(nodes, np.stack([-out, up], axis=1)),
        station=station,
        width=np.full(rows + 1, RACHIS_SIZE),
        height=np.full(rows + 1, RACHIS_SIZE),
        barb_length=length,
        barb_span=np.stack([span, span]),
        cell=cell,
        surface=vane_surface(nodes, station, length, cell),
    )


def lifted(rows: int, columns: int, shares: tuple[float, ...]) -> np.ndarray:
    """Lifts of the inner and the outer corner under the last of these shares of the load."""
    vane = isotropic(YOUNG, THICKNESS)
    feather, kind = ring(rows, columns), strip_kind(2.0 * np.pi * MIDDLE, vane)
    model = make_model([feather], [kind], 0)
    pinned = np.zeros((rows + 1, 1 + 2 * columns), dtype=np.bool_)
    pinned[:2] = True
    nodal = nodal_model(model, [feather], [kind], bending="plate", has_rachis=False, pinned=pinned)
    state, solver = at_rest(model, nodal), NodalSolver(model, nodal, Settings(newton=1e-6))
    for share in shares:
        loads = end_row_loads(no_loads(1), model, (0.0, 0.0, 1.0), share * FULL)
        state, status, _ = solver.equilibrium(state, loads)
        assert status[0] == 0
    end = state.points.nodes[0, -1, :, 2]
    return end[[columns, 2 * columns]]


@pytest.mark.verification
def test_lifts_converge_to_the_published_ones():
    """Sze, Liu and Lo 2004, section 3.3, at an eighth of the load: 5.007 and 6.872, by 10 x 80
    shells of reduced integration."""
    coarse, middle, fine = (lifted(40 * n, 2 * n, (0.06, 0.125)) for n in (1, 2, 4))
    assert fine == pytest.approx([5.007, 6.872], rel=0.01)
    limit = fine + (fine - middle) / 3.0
    assert limit == pytest.approx([5.007, 6.872], rel=0.005)
    # second order: errors beside the limit fall to a quarter
    assert np.all((middle - coarse) / (fine - middle) > 2.0)


@pytest.mark.slow
@pytest.mark.verification
def test_full_lift():
    """The same at the whole load: 13.891 and 17.528."""
    found = lifted(160, 8, tuple(np.linspace(0.125, 1.0, 8)))
    assert found == pytest.approx([13.891, 17.528], rel=0.01)
