"""Feathers whose drawn pose is their balance, in a groom with `drawn_pose = "equilibrium"`."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from featherfx.algebra.vectors import quats_to_frames
from featherfx.errors import some_of, warn_input
from featherfx.groom.types import Placement
from featherfx.shot.types import Shot
from featherfx.solver.inverse_statics import find_unloaded
from featherfx.solver.solver import Solver
from featherfx.solver.state import State


def hang_as_drawn(
    shot: Shot, placements: Sequence[Placement], solver: Solver, state: State
) -> State:
    """Give a solver the unloaded shapes of its feathers; return the state in the drawn pose.

    state: at rest in the drawn pose, where the shot begins. Gravity is the groom's, and turns with
    the roots. An InputWarning names feathers without such a shape.
    """
    gravity = shot.groom.drawn_gravity
    assert gravity is not None
    roots = np.stack([each.rotation for each in placements])
    begun = quats_to_frames(state.rotation[:, 0])
    local = np.einsum("fij,fkj,k->fi", begun, roots, gravity)
    found = find_unloaded(solver, state, local)
    solver.model = found.model
    lost = [placements[f].id for f in np.flatnonzero(found.missing).tolist()]
    if lost:
        message = (
            f"{shot.groom.source}: drawn_pose: no unloaded shape comes to rest in the drawn pose of"
            f" {some_of(lost)}: they hang from it. Make them stiffer, or draw"
            " them lower"
        )
        warn_input(message)
    return found.state
