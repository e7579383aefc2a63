"""States of feathers as the images of others': moved as a whole, or mirrored.

Mirrored feathers have mirrored models (featherfx/feather/types.py): d2 points to the trailing side,
so a row frame R becomes T R diag(1, -1, 1), and what turns, bends or shears out of the mirror
changes its sign: coefficients within the vane, shear along and bending across the shaft, folds and
twists of the vane.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from featherfx.algebra.rotation import frames_to_quats
from featherfx.algebra.types import Array, Flags, Indices
from featherfx.feather.types import RowPoints
from featherfx.solver.state import State

MIRROR = np.array([1.0, -1.0, 1.0])
# of the strains of a shaft's element (rachis_kernels): v, then p
_RACHIS = np.array([1.0, -1.0, 1.0, -1.0, 1.0, -1.0])


class StateImage(NamedTuple):
    """Map of feathers to P others: points to turn x + shift.

    turn: (P, 3, 3) orthogonal; where its determinant is -1 the other feather is the mirror image.
    shift: (P, 3) m.
    """

    turn: Array
    shift: Array

    def of(self, state: State, given: Indices, own: Indices) -> dict[str, Array]:
        """Arrays of State for feathers own (P,), as images of feathers given (P,)."""
        flipped = np.linalg.det(self.turn) < 0.0
        found = {name: array[given] for name, array in state.arrays().items()}
        points = RowPoints(found["points.nodes"], found["points.directors"])
        found |= _named("points", self._turned(points, flipped).shifted(self.shift))
        for name in ("velocity", "acceleration", "smoothed"):
            rate = RowPoints(found[f"{name}.nodes"], found[f"{name}.directors"])
            found |= _named(name, self._turned(rate, flipped))
        sign = np.where(flipped, -1.0, 1.0)
        found["centre"] = self._along(found["centre"]) + self.shift[:, None]
        found["spin"] = self._along(found["spin"]) * sign[:, None, None]
        found["rotation"] = self._frames(found["rotation"], flipped, state.rotation[own, 0])
        for name, signs in _signs(state).items():
            found[name][flipped] *= signs
        # no negative zeros, as where feathers are stepped
        return {name: values + 0.0 for name, values in found.items()}

    def _along(self, values: Array) -> Array:
        """Vectors (P, ..., 3), turned."""
        flat = values.reshape(len(values), -1, 3)
        return np.asarray((flat @ np.swapaxes(self.turn, 1, 2)).reshape(values.shape))

    def _turned(self, points: RowPoints, flipped: Flags) -> RowPoints:
        directors = self._along(points.directors)
        directors[flipped, :, 0] *= -1.0
        return RowPoints(self._along(points.nodes), directors)

    def _frames(self, quats: Array, flipped: Flags, near: Array) -> Array:
        """Row frames (P, n, 4), turned; of both signs those nearer at the root to near (P, 4)."""
        proper = np.where(flipped[:, None, None], self.turn * MIRROR, self.turn)
        quats = np.where(flipped[:, None, None], quats * np.array([1.0, -1.0, 1.0, -1.0]), quats)
        if (proper != np.eye(3)).any():
            quats = _product(frames_to_quats(proper)[:, None], quats)
        close = np.einsum("pk,pk->p", quats[:, 0], near)
        return np.asarray(quats * np.where(close < 0.0, -1.0, 1.0)[:, None, None])


def _product(first: Array, second: Array) -> Array:
    """Quaternions (..., 4) of second rotations followed by first ones."""
    (a, u), (b, v) = ((each[..., :1], each[..., 1:]) for each in (first, second))
    real = a * b - np.sum(u * v, axis=-1, keepdims=True)
    return np.concatenate([real, a * v + b * u + np.cross(u, v)], axis=-1)


def _named(name: str, points: RowPoints) -> dict[str, Array]:
    return {f"{name}.nodes": points.nodes, f"{name}.directors": points.directors}


def _signs(state: State) -> dict[str, Array]:
    """By name, the signs of a mirror image's numbers over the original's."""
    in_plane = np.ones(state.coefficient.shape[-1])
    in_plane[len(in_plane) // 2 :] = -1.0
    barbs = dict.fromkeys(("coefficient", "coefficient_rate", "strains.barb"), in_plane)
    minus = np.array(-1.0)
    return barbs | {"strains.rachis": _RACHIS, "strains.hinge": minus, "strains.twist": minus}
