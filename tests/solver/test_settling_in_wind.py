"""Feathers in wind find their balance, or that there is none, however they are turned."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from trial_batches import preset_batch

from featherfx.mechanics.model import no_loads
from featherfx.solver.solver import Settings, Solver
from featherfx.solver.state import rest_state
from featherfx.solver.types import CONVERGED, NO_REST, SEVERAL_RESTS

AIR = np.array([1.2, 1.2, 0.02, 1.1])
COUNT = 168
# m/s
CALM, STRONG = 1.0, 30.0


@pytest.mark.parametrize("name", ["swan_primary", "covert", "ornamental_plume"])
@pytest.mark.nightly
def test_none_of_random_directions_fails(name):
    """Three kinds, 504 directions in all; gravity and wind have one each."""
    _, model = preset_batch(name, rows=7, columns=3, coefficients=1, count=COUNT)
    random = np.random.default_rng(16)
    turns = Rotation.random(COUNT, random_state=random).as_matrix()
    heading = random.normal(size=(COUNT, 3))
    heading /= np.linalg.norm(heading, axis=1)[:, None]
    speed = random.uniform(CALM, STRONG, (COUNT, 1))
    loads = no_loads(COUNT, (0.0, 0.0, -9.81))._replace(air=AIR, wind_mean=speed * heading)
    start = rest_state(model, np.zeros((COUNT, 3)), turns)
    with Solver(model, Settings(tolerance=1e-4, spectral_radius=0.5)) as solver:
        state, status, _ = solver.equilibrium(start, loads)
    failed = np.flatnonzero(~np.isin(status, (CONVERGED, NO_REST, SEVERAL_RESTS)))
    assert not len(failed), f"{name}: {failed}, {turns[failed]}, {loads.wind_mean[failed]}"
    assert np.isfinite(state.points.nodes).all()
    assert (status == CONVERGED).any()


@pytest.mark.parametrize(("name", "speed"), [("peacock_train", 4), ("semiplume", 5)])
def test_the_wind_leads_to_the_same_branch_on_every_grid(name, speed):
    """Bent by more than half of their lengths, up the wind's growth from calm air."""
    found = []
    for rows, columns in ((11, 3), (15, 4), (21, 5)):
        _, model = preset_batch(name, rows=rows, columns=columns, coefficients=2)
        wind = speed * np.array([[0.2, 0.1, 1.0]])
        loads = no_loads(1, (0.0, 0.0, -9.81))._replace(air=AIR, wind_mean=wind)
        start = rest_state(model, np.zeros((1, 3)), np.eye(3)[None])
        with Solver(model, Settings(tolerance=1e-5)) as solver:
            state, status, _ = solver.equilibrium(start, loads)
        assert status[0] == CONVERGED
        ways = np.linalg.norm(state.points.nodes - start.points.nodes, axis=-1)
        assert ways.max() > 0.5 * model.length.sum()
        found.append(state.points.nodes[0, -1, 0] / model.length.sum())
    assert np.linalg.norm(found[0] - found[2]) < 0.01
    assert np.linalg.norm(found[1] - found[2]) < 0.01
