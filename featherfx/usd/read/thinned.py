"""Meshes with fewer points, for what a browser can take: shafts' tubes first, then rows and barbs.

Only points are left out; those that are kept stand where the cache has them.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from featherfx.algebra.types import Floats, Indices
from featherfx.feather.types import RACHIS
from featherfx.usd.read.cached_feather import CachedFeather

# rows of a thinned vane, tried one after another
_ROWS = (11, 7, 5, 3)
# triangles of a level, at most a share of those of the one before
_FEWER = 0.75


class Thinned(NamedTuple):
    """points: (P,) kept points of all feathers, ascending by feather. triangles: (T, 3) into these.
    starts: (N + 1,) first kept point of each feather, and P. told: what was left out, empty where
    nothing was."""

    points: Indices
    triangles: Indices
    starts: Indices
    told: str


def thinned(feathers: Sequence[CachedFeather], starts: Indices, most: int) -> Thinned:
    """As much of feathers as has at most so many points, or the least that there is.

    starts: (N + 1,) first point of each feather, and all.
    """
    kept = _joined([_whole(each) for each in feathers], starts, "")
    if len(kept.points) > most:
        parts = [_without_shaft(each) for each in feathers]
        kept = _joined(parts, starts, "without the tubes of shafts")
    for rows in _ROWS:
        if len(kept.points) <= most:
            break
        told = f"vanes with at most {rows} rows and one barb segment a side, without shafts"
        kept = _joined([_rows(each, rows) for each in feathers], starts, told)
    return kept


def levels(
    feathers: Sequence[CachedFeather], starts: Indices, kept: Thinned
) -> list[tuple[Indices, Indices]]:
    """Ever fewer of kept points (P,) and triangles (T, 3) of these, for pages that draw slowly:
    without shafts, with fewer rows, and at last the outline alone. starts: as of thinned."""
    cuts = [slice(*kept.starts[k : k + 2]) for k in range(len(feathers))]
    among = [kept.points[cut] - start for cut, start in zip(cuts, starts, strict=False)]
    found, last = [], len(kept.triangles)
    for rows, middle in (*((rows, True) for rows in _ROWS), (_ROWS[-1], False)):
        parts = [_rows(f, rows, own, middle) for f, own in zip(feathers, among, strict=True)]
        made = _joined(parts, starts, "")
        if len(made.triangles) <= _FEWER * last:
            found.append((np.searchsorted(kept.points, made.points), made.triangles))
            last = len(made.triangles)
    return found


def _joined(parts: Sequence[tuple[Indices, Indices]], starts: Indices, told: str) -> Thinned:
    own = np.cumsum([0, *(len(points) for points, _ in parts)])
    points = [each + start for (each, _), start in zip(parts, starts, strict=False)]
    triangles = [each + start for (_, each), start in zip(parts, own, strict=False)]
    return Thinned(np.concatenate(points), np.concatenate(triangles), own, told)


def _used(triangles: Indices) -> tuple[Indices, Indices]:
    """Points that triangles use, and the triangles by these."""
    points, places = np.unique(triangles, return_inverse=True)
    return points, places.reshape(-1, 3)


def _whole(feather: CachedFeather) -> tuple[Indices, Indices]:
    return _used(feather.triangles)


def _without_shaft(feather: CachedFeather) -> tuple[Indices, Indices]:
    vane = feather.triangles[feather.side != RACHIS]
    return _used(vane if len(vane) else feather.triangles)


def _rows(
    feather: CachedFeather, most: int, among: Indices | None = None, middle: bool = True
) -> tuple[Indices, Indices]:
    """The ends of the barbs at some of the rows, and the shaft where the middle is wanted, as
    strips. among: points that there are; None: all."""
    points, triangles = _without_shaft(feather)
    if feather.st is None or not (feather.side != RACHIS).any():
        return points, triangles
    if among is not None:
        points = np.intersect1d(points, among)
    across, along = feather.st[points, 0], np.round(feather.st[points, 1], 5)
    stations = np.unique(along)
    chosen = stations[np.unique(np.linspace(0, len(stations) - 1, most).round().astype(int))]
    corners = []
    for station in chosen:
        row = np.flatnonzero(along == station)
        ends = row[across[row].argmin()], row[across[row].argmax()]
        inner = (row[np.abs(across[row] - 0.5).argmin()],) if middle else ()
        corners.append((ends[0], *inner, ends[1]))
    low, high = np.array(corners[:-1]), np.array(corners[1:])
    columns = range(low.shape[1] - 1)
    strips = [(low[:, k], low[:, k + 1], high[:, k + 1]) for k in columns] + [
        (low[:, k], high[:, k + 1], high[:, k]) for k in columns
    ]
    made = points[np.concatenate([np.stack(each, axis=1) for each in strips])]
    real = (made[:, 0] != made[:, 1]) & (made[:, 1] != made[:, 2]) & (made[:, 2] != made[:, 0])
    made = made[real]
    # wound as the feather's own
    whole = _areas(feather.st, feather.triangles[feather.side != RACHIS]).sum()
    turned = _areas(feather.st, made) * whole < 0.0
    made[turned] = made[turned][:, [0, 2, 1]]
    return _used(made)


def _areas(st: Floats, triangles: Indices) -> Floats:
    """(T,) twice the signed areas in texture space."""
    first, second = (st[triangles[:, k]] - st[triangles[:, 0]] for k in (1, 2))
    return np.asarray(first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0])
