"""Plane forms: the part of a feather's shape that it keeps whatever it lies on.

Angles within the vane and lengths, of chords between nodes: the rachis turns by its geodesic
curvature, barbs leave it at their angles. Camber and twist are those of the leaf.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from featherfx.algebra.types import Array

_ROUNDING = 1e-9  # of shares of a length


class PlaneForms(NamedTuple):
    """Plane forms of F feathers of n rows and m columns a side.

    steps: (F, n - 1) m, chords of the rachis. ahead, behind: (F, n - 1) rad, of each chord to the
    frames of the rows where it begins and ends, towards d2. angles: (F, 2, n, m) rad, of the
    barbs' pieces to their row, and pieces: (F, 2, n, m) m. sunk: (F, n) share u of the calamus that
    is still ahead, squared: how much of the follicle's depth each row lies under its leaf. bare:
    (F,) m, length of the calamus.
    """

    steps: Array
    ahead: Array
    behind: Array
    angles: Array
    pieces: Array
    sunk: Array
    bare: Array


def make_plane_forms(nodes: Array, directors: Array, bare: Array) -> PlaneForms:
    """Measure plane forms of feathers at rest.

    nodes: (F, n, 1 + 2 m, 3) m. directors: (F, n, 2, 3). bare: (F,) m.
    """
    lateral, dorsal = directors[:, :, 0], directors[:, :, 1]
    forward = np.cross(lateral, dorsal)

    def angle(ways: Array, rows: slice) -> Array:
        extra = (1,) * (ways.ndim - 3)
        axes = [each[:, rows].reshape(len(each), -1, *extra, 3) for each in (lateral, forward)]
        return np.asarray(np.arctan2(*(_dots(ways, each) for each in axes)))

    chords = np.diff(nodes[:, :, 0], axis=1)
    columns = (nodes.shape[2] - 1) // 2
    sides = []
    for side in range(2):
        own = nodes[:, :, 1 + side * columns : 1 + (side + 1) * columns]
        sides.append(np.diff(np.concatenate([nodes[:, :, :1], own], axis=2), axis=2))
    ways, steps = np.stack(sides, axis=1), np.sqrt(_dots(chords, chords))
    station = np.concatenate([np.zeros((len(steps), 1)), np.cumsum(steps, axis=1)], axis=1)
    ahead = np.maximum(1.0 - station / np.where(bare > 0.0, bare, 1.0)[:, None], 0.0)
    # rounding of the row where the vane begins
    sunk = np.where((bare > 0.0)[:, None] & (ahead > _ROUNDING), ahead**2, 0.0)
    return PlaneForms(
        steps=steps,
        ahead=angle(chords, slice(None, -1)),
        behind=angle(chords, slice(1, None)),
        angles=np.stack([angle(way, slice(None)) for way in sides], axis=1),
        pieces=np.sqrt(_dots(ways, ways)),
        sunk=sunk,
        bare=bare,
    )


def _dots(first: Array, second: Array) -> Array:
    """(...) dot products of vectors (..., 3)."""
    return np.asarray(np.einsum("...k,...k->...", first, second))
