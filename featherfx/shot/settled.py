"""Feathers brought to rest before the first frame."""

from __future__ import annotations

import warnings
from collections.abc import Sequence

import numpy as np

from featherfx.errors import InputWarning
from featherfx.mechanics.model import Loads
from featherfx.solver.step import NO_REST, Solver, State, raise_if_failed


def settled(
    solver: Solver,
    state: State,
    loads: Loads,
    names: Sequence[str],
    feathers: Sequence[int] | None = None,
) -> State:
    """The feathers at rest under their loads; feathers: indices, all by default.

    Raises SimulationError where one cannot be solved. One that flutters in the wind has no rest:
    it is left in a pose on its way, with a warning (InputWarning) that names the first.
    """
    state, status, _ = solver.equilibrium(state, loads, feathers=feathers)
    fluttering = np.flatnonzero(status == NO_REST)
    if len(fluttering):
        more = f" and {len(fluttering) - 1} more" if len(fluttering) > 1 else ""
        warnings.warn(
            f"settle: feather '{names[int(fluttering[0])]}'{more} found no rest in the wind of the"
            " first frame and starts out of balance",
            InputWarning,
            stacklevel=2,
        )
    raise_if_failed(np.where(status == NO_REST, 0, status), state.time, names)
    return state
