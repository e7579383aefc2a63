"""The elastic clamp of barbs: a rotational spring in series with the cantilever."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from nodal_cases import VANE, at_rest

from featherfx.lab.nodal.model import nodal_model
from featherfx.lab.nodal.solver import NodalSolver
from featherfx.lab.strip import strip_feather, strip_kind
from featherfx.mechanics.batch import make_model
from featherfx.mechanics.model import no_loads
from featherfx.solver.solver import Settings, Solver
from featherfx.solver.state import rest_state

ROWS, LENGTH, REACH = 3, 0.1, 0.03
BENDING = VANE.barb_bending_normal


def barbs(columns: int, normal: float = 0.0, in_plane: float = 0.0, coefficients: int = 3):
    """(model, feather, kind) of barbs on a shaft that hardly gives, without hold between them."""
    vane = replace(
        VANE,
        modulus_across_barbs=1e-9,
        shear_modulus=1e-9,
        bending_across=0.0,
        barb_taper=0.0,
        barb_bending_in_plane=BENDING,
        barb_clamp_normal=normal,
        barb_clamp_in_plane=in_plane,
    )
    kind = strip_kind(LENGTH, vane)
    feather = strip_feather(LENGTH, 2.0 * REACH, ROWS, columns)
    model = make_model([feather], [kind], coefficients)
    return model._replace(rachis_stiffness=np.full((1, ROWS - 1, 6), 1e4)), feather, kind


def pulled(model, columns: int, direction: int, force: float):
    """Dead load at the end of the middle row's leading barb."""
    loads = np.zeros((1, ROWS, 1 + 2 * columns, 3))
    loads[0, 1, columns, direction] = force
    return no_loads(1)._replace(force=loads)


def deflection(columns: int, direction: int, force: float, **clamp: float) -> float:
    model, _, _ = barbs(columns, **clamp)
    start = rest_state(model, np.zeros((1, 3)), np.eye(3)[None])
    with Solver(model, Settings(newton=1e-12)) as solver:
        state, status, _ = solver.equilibrium(start, pulled(model, columns, direction, force))
    assert status[0] == 0
    end = (state.points.nodes - start.points.nodes)[0, 1, columns, direction]
    root = (state.points.nodes - start.points.nodes)[0, 1, 0, direction]
    return float(end - root)


def beam(force: float, compliance: float) -> float:
    """F L^3 / 3 B + F L^2 / k, B and 1/k those of the row's bundle of barbs."""
    share = LENGTH / (ROWS - 1)
    return force * REACH**3 / (3.0 * BENDING * share) + force * REACH**2 * compliance / share


@pytest.mark.verification
@pytest.mark.parametrize(("direction", "key"), [(2, "normal"), (0, "in_plane")])
@pytest.mark.parametrize("flexible", [0.1, 1.0, 10.0])
def test_a_cantilever_on_a_rotational_spring(direction: int, key: str, flexible: float) -> None:
    """compliance in units of L / B; however few segments, because they have the barb's own mean
    directions."""
    compliance, force = flexible * REACH / BENDING, 1e-6
    expected = beam(force, compliance)
    for columns in (2, 4, 8):
        found = deflection(columns, direction, force, **{key: compliance})
        assert found == pytest.approx(expected, rel=2e-3)


def test_a_stiff_clamp_is_the_rigid_one() -> None:
    force = 1e-4
    rigid = deflection(6, 2, force)
    gaps = [
        deflection(6, 2, force, normal=stiff * REACH / BENDING) / rigid - 1.0
        for stiff in (1e-2, 1e-3, 1e-4)
    ]
    assert gaps[0] == pytest.approx(3e-2, rel=0.1)
    assert gaps[0] / gaps[1] == pytest.approx(10.0, rel=0.05)
    assert gaps[1] / gaps[2] == pytest.approx(10.0, rel=0.05)


def test_rigid_clamps_need_no_coefficient_and_no_other_direction_gives() -> None:
    assert barbs(4)[0].coefficients == 3
    assert barbs(4, normal=1.0)[0].coefficients == 4
    force, compliance = 1e-6, REACH / BENDING
    assert deflection(6, 0, force, normal=compliance) == pytest.approx(
        deflection(6, 0, force), rel=1e-5
    )


def test_rigid_barbs_on_elastic_clamps_turn_as_wholes() -> None:
    force, compliance = 1e-6, REACH / BENDING
    turn = deflection(4, 2, force, normal=compliance, coefficients=0)
    assert turn == pytest.approx(force * REACH**2 * compliance / (LENGTH / 2), rel=1e-5)


@pytest.mark.slow
@pytest.mark.verification
def test_both_kinematics_agree() -> None:
    columns, force = 8, 1e-6
    compliance = 2.0 * REACH / BENDING
    model, feather, kind = barbs(columns, normal=compliance)
    nodal = nodal_model(model, [feather], [kind])
    solver = NodalSolver(model, nodal, Settings(newton=1e-12))
    start = at_rest(model, nodal)
    state, status, _ = solver.equilibrium(start, pulled(model, columns, 2, force))
    assert status[0] == 0
    end = (state.points.nodes - start.points.nodes)[0, 1, [0, columns], 2]
    smooth = deflection(columns, 2, force, normal=compliance)
    assert end[1] - end[0] == pytest.approx(smooth, rel=5e-3)
