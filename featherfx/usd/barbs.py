"""Barbs to render, of all feathers of a cache at once."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from featherfx.feather.render import BarbCurves
from featherfx.usd import surface_kernels
from featherfx.usd.space import StageSpace
from featherfx.usd.types import FeatherEntry

Array = NDArray[np.float64]
Floats = NDArray[np.float32]


@dataclass(frozen=True)
class BarbFrame:
    """One pose of the barbs of all N feathers, stage units and axes, as it is written (float32).

    points, velocities: (Q, 3). extent: (N, 2, 3), padded by half the width; zero where a feather
    has no barbs. accelerations: (Q, 3), None where not asked for.
    """

    points: Floats
    velocities: Floats
    extent: Floats
    accelerations: Floats | None = None

    @property
    def bytes(self) -> int:
        values = (getattr(self, each.name) for each in fields(self))
        return sum(value.nbytes for value in values if value is not None)


class BarbSet:
    """The constant arrays of the barbs of a cache, and their evaluation.

    slices: where each feather stands in the flat arrays. starts: (N + 1,) the same. widths: per
    feather (B K,) stage units. drawn: (N,) whether a feather has barbs. rest: the rest pose.
    """

    def __init__(self, entries: Sequence[FeatherEntry], space: StageSpace) -> None:
        self._entries, self._space = tuple(entries), space
        barbs = [entry.barbs for entry in entries]
        points = [_flat(each.points) if each else np.zeros((0, 3)) for each in barbs]
        self._rest = points
        self.starts = np.concatenate([[0], np.cumsum([len(each) for each in points])])
        self.slices = [slice(int(a), int(b)) for a, b in pairwise(self.starts)]
        self.widths = [
            space.lengths(each.widths.ravel()) if each else np.zeros(0) for each in barbs
        ]
        self.drawn = np.diff(self.starts) > 0
        # Feathers without barbs take no room, so those with barbs follow each other directly.
        self._runs = self.starts[np.append(self.drawn, True)]
        half = [0.5 * each.max() for each in self.widths if len(each)]
        self._half_width = np.array(half, np.float32)
        self.rest = self._frame(points, [np.zeros_like(each) for each in points], None)

    def evaluate(
        self,
        points: Sequence[Array],
        velocities: Sequence[Array],
        accelerations: Sequence[Array] = (),
    ) -> BarbFrame:
        """A pose from per-feather material points and rates; static feathers: at rest."""
        if not self.drawn.any():
            return self.rest
        pose = self._mapped(points)
        for index, entry in enumerate(self._entries):
            if entry.static:
                pose[index] = self._rest[index]
        second = self._mapped(accelerations) if len(accelerations) else None
        return self._frame(pose, self._mapped(velocities), second)

    def _mapped(self, values: Sequence[Array]) -> list[Array]:
        """Per feather (Q, 3), of points or rates; zero for static feathers."""
        return [
            _moved(entry.barbs, each) if entry.barbs and not entry.static else np.zeros_like(rest)
            for entry, each, rest in zip(self._entries, values, self._rest, strict=True)
        ]

    def _frame(
        self, points: Sequence[Array], velocities: Sequence[Array], second: Sequence[Array] | None
    ) -> BarbFrame:
        def written(values: Sequence[Array]) -> Floats:
            return self._space.positions(np.concatenate(values)).astype(np.float32)

        placed = written(points)
        extent = np.zeros((len(self._entries), 2, 3), np.float32)
        corners = np.empty((len(self._half_width), 2, 3), np.float32)
        if len(corners):
            surface_kernels.extents(placed, self._runs, self._half_width, corners)
            extent[self.drawn] = corners
        rates = None if second is None else written(second)
        return BarbFrame(placed, written(velocities), extent, rates)


def _flat(points: Array) -> Array:
    return np.reshape(points, (-1, 3))


def _moved(barbs: BarbCurves, values: Array) -> Array:
    return _flat(barbs.points_map(values))
