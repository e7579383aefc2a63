"""Feathers that settle from a pose turned up about their roots.

Coverts above and below a thin wing may curl through it at rest, and through each other. From there
no step leads out: points beyond the wing stay beyond, on its other side. So such feathers are
turned up until they are clear, and their roots are led down again while contact holds what they
meet.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from featherfx.algebra.vectors import quats_to_frames, rotation_vectors, vectors_to_frames
from featherfx.groom.types import Placement
from featherfx.mechanics.model import Model
from featherfx.solver.contact.surfaces import Grids
from featherfx.solver.state import RootPath, State, hold_roots, rest_state

Array = NDArray[np.float64]


def held_roots(states: Sequence[State]) -> list[RootPath]:
    """Paths of roots that stay where they are."""
    return [hold_roots(state) for state in states]


def raised_points(points: Array, placement: Placement, angle: float) -> Array:
    """A placed feather's points (..., 3) m, turned up about its root by an angle in rad."""
    if angle == 0.0:
        return points
    turn = vectors_to_frames(-angle * placement.rotation[:, 1])
    return np.asarray((points - placement.position) @ turn.T + placement.position)


def turned_up(
    states: Sequence[State], models: Sequence[Model], grids: Grids, angles: Array
) -> list[State]:
    """Batches whose feathers begin in their rest shape, turned up about their roots by angles (B,)
    in rad; those with 0 are as they were."""
    found = []
    for state, model, (low, high) in zip(states, models, pairwise(grids.first), strict=True):
        own, new = angles[low:high], state.copy()
        frames = quats_to_frames(state.rotation[:, 0])
        turns = vectors_to_frames(-own[:, None] * frames[:, :, 1])
        turned = rest_state(model, state.centre[:, 0], turns @ frames)
        turned = turned._replace(time=state.time)
        for f in np.flatnonzero(own).tolist():
            new.take(turned, f)
        found.append(new)
    return found


class Lowering:
    """Leads roots to where those of some states are."""

    def __init__(self, states: Sequence[State]) -> None:
        self._ends = [quats_to_frames(state.rotation[:, 0]) for state in states]

    def paths(self, part: float) -> Callable[[Sequence[State]], list[RootPath]]:
        """Paths that turn roots by a part of what is left."""

        def paths_of(states: Sequence[State]) -> list[RootPath]:
            paths = held_roots(states)
            for path, end in zip(paths, self._ends, strict=True):
                turn = end @ np.swapaxes(quats_to_frames(path.base), -1, -2)
                path.samples[:, 1, 3:] = part * rotation_vectors(turn)
            return paths

        return paths_of
