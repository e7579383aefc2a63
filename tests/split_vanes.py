"""How stiff a vane is whose hooks have slipped, opened or been closed again."""

from __future__ import annotations

import numpy as np

from featherfx.mechanics.model import Gaps, Model, no_loads
from featherfx.solver.solver import Settings, Solver
from featherfx.solver.state import rest_state


def compliance(model: Model, gaps: Gaps, row: int, node: int, force: float) -> float:
    """m/N, how far a small force (N) along the shaft moves a node at rest; the feather's root is
    held, and it has these gaps."""
    state = rest_state(model, np.zeros((1, 3)), np.eye(3)[None])
    for array, value in zip(state.gaps_of(0), gaps, strict=True):
        array[:] = value
    places = []
    with Solver(model, Settings(newton=1e-9), 1) as solver:
        for own in (0.0, force):
            loads = no_loads(1)._replace(force=np.zeros((1, *model.mass.shape[1:], 3)))
            loads.force[0, row, node, 0] = own
            places.append(solver.equilibrium(state, loads)[0].points.nodes[0, row, node])
    return float(np.linalg.norm(places[1] - places[0])) / force
