"""Pictures in texture space: one, or the tiles of a UDIM set, with the ways they go on outside.

Tile 1001 + i + 10 j holds texture coordinates from (i, j) to (i + 1, j + 1), i below 10. A picture
without <UDIM> in its name is tile 1001 alone, which wraps as USD's textures do.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

import numpy as np

from featherfx.algebra.types import Array, Indices
from featherfx.groom.keys.problems import Place

_UDIM = "<UDIM>"
_FIRST, _COLUMNS, _ROWS = 1001, 10, 900  # number of the first tile; tiles in a row, and rows
_ROUNDING = 1e-6  # of texture coordinates at the edge of a picture

Tiles = dict[int, Array]  # (H, W) grey or (H, W, 3) values, top row first, by number; -1: no set


def read_tiles(path: Path, read: Callable[[Path], Array], place: Place) -> Tiles:
    """Return the tiles of a picture by number: all of a UDIM set that are there, or one as -1.

    Raises InputError for a set without tiles.
    """
    if _UDIM not in path.name:
        return {-1: read(path)}
    before, after = map(re.escape, path.name.split(_UDIM, 1))
    form = re.compile(f"{before}([1-9][0-9]{{3}}){after}")
    there = sorted(path.parent.iterdir()) if path.parent.is_dir() else []
    found = {int(match[1]): each for each in there if (match := form.fullmatch(each.name))}
    if not found:
        place.refuse(f"{path}: there is no tile, such as {path.name.replace(_UDIM, '1001')}")
    return {number: read(each) for number, each in found.items()}


def name_tiles(st: Array) -> set[int]:
    """Return the numbers of the tiles that texture coordinates (N, 2) are in; 0 for none."""
    column, row = np.floor(st).astype(np.int64).T
    sound = (column >= 0) & (column < _COLUMNS) & (row >= 0) & (row < _ROWS)
    return set(np.where(sound, _FIRST + column + _COLUMNS * row, 0).tolist())


def find_tiles(tiles: Tiles, st: Array, wrap: str) -> tuple[Indices, Array]:
    """Return (N,) where among sorted tiles texture coordinates (N, 2) lie, -1 for none, and (N, 2)
    their places within the tile, 0 to 1.

    wrap: black, clamp, repeat or mirror, of a single picture; a set of tiles is black outside.
    """
    if -1 in tiles:
        if wrap == "repeat":
            return np.zeros(len(st), np.int64), st - np.floor(st)
        if wrap == "mirror":
            return np.zeros(len(st), np.int64), 1.0 - np.abs(1.0 - st % 2.0)
        inside = (wrap == "clamp") | (np.abs(st - 0.5) <= 0.5 + _ROUNDING).all(axis=1)
        return np.where(inside, 0, -1), np.clip(st, 0.0, 1.0)
    known = np.array(sorted(tiles))
    corner = np.floor(st)
    column, row = corner.T
    sound = (column >= 0) & (column < _COLUMNS) & (row >= 0) & (row < _ROWS)
    number = np.where(sound, _FIRST + column + _COLUMNS * row, 0).astype(np.int64)
    place = np.minimum(np.searchsorted(known, number), len(known) - 1)
    return np.where(known[place] == number, place, -1), st - corner


def sample_tiles(tiles: Tiles, st: Array, wrap: str) -> Array:
    """Return values of tiles, grey or in colours, at texture coordinates (N, 2); 0 outside."""
    number, inner = find_tiles(tiles, st, wrap)
    first = tiles[min(tiles)]
    found = np.zeros((len(st), *first.shape[2:]))
    for place, key in enumerate(sorted(tiles)):
        own = number == place
        found[own] = _interpolate(tiles[key], inner[own], wrap if key == -1 else "clamp")
    return found


def _interpolate(picture: Array, st: Array, wrap: str) -> Array:
    """(N, ...) values of a picture between the middles of its pixels; its lower left corner is
    (0, 0)."""
    size = np.array(picture.shape[1::-1])
    place = np.column_stack([st[:, 0], 1.0 - st[:, 1]]) * size - 0.5
    low = np.floor(place).astype(np.int64)
    ends = low, low + 1
    if wrap == "repeat":
        (left, top), (right, bottom) = (each.T % size[:, None] for each in ends)
    else:
        (left, top), (right, bottom) = (np.clip(each, 0, size - 1).T for each in ends)
    u, v = ((place - low)[:, k].reshape(-1, *[1] * (picture.ndim - 2)) for k in (0, 1))
    upper = (1.0 - u) * picture[top, left] + u * picture[top, right]
    lower = (1.0 - u) * picture[bottom, left] + u * picture[bottom, right]
    return np.asarray((1.0 - v) * upper + v * lower)
