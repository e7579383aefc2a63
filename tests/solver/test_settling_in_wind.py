"""Feathers in wind find their balance, or that there is none, however they are turned."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from trial_batches import preset_batch

from featherfx.mechanics.model import no_loads
from featherfx.solver.solver import Settings, Solver
from featherfx.solver.state import rest_state
from featherfx.solver.status import CONVERGED, NO_REST

AIR = np.array([1.2, 1.2, 0.02, 1.1])
COUNT = 168
# m/s
CALM, STRONG = 1.0, 30.0


@pytest.mark.parametrize("name", ["swan_primary", "covert", "ornamental_plume"])
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
    failed = np.flatnonzero(~np.isin(status, (CONVERGED, NO_REST)))
    assert not len(failed), f"{name}: {failed}, {turns[failed]}, {loads.wind_mean[failed]}"
    assert np.isfinite(state.points.nodes).all()
    assert (status == CONVERGED).any()
