"""Paths of the roots of a batch during a frame."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from featherfx.solver.state import State

Array = NDArray[np.float64]


class RootPath(NamedTuple):
    """Paths of the roots during a frame.

    samples: (F, K, 6) position (m) and rotation vector (rad) relative to the first sample, at K
    evenly spaced fractions of the frame. base: (F, 4) quaternion of the first sample.
    """

    samples: Array
    base: Array

    def part(self, some: slice) -> RootPath:
        """The paths of some feathers, the same memory."""
        return RootPath(self.samples[some], self.base[some])


def hold_roots(state: State) -> RootPath:
    """A path that keeps all roots where they are."""
    samples = np.zeros((len(state.rotation), 2, 6))
    samples[:, :, :3] = state.centre[:, None, 0]
    return RootPath(samples, state.rotation[:, 0].copy())
