"""Look of barbs and plumage: clumps, frizz, water, and shading as one surface.

Light that enters plumage is scattered by many vanes before it leaves, so that neighbours are lit
alike. Each feather has a normal of the plumage about it at a few places along its rachis, the mean
over vanes near there that look the same way, towards which its own normals are drawn. Barbs have
the look of their feather as in feather/barb_looks.py, with the slopes that shading needs.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from featherfx.algebra.types import Array, Indices
from featherfx.algebra.vectors import unit
from featherfx.feather.barb_looks import WET_SHAPE, clump_fraction, draws_of, middle_barbs
from featherfx.groom.looks import BarbLook

_NEAR = 0.05  # place on a barb


class BarbStrips(NamedTuple):
    """Strips of n feathers, (n, B, 2 S + 1, 3) each: points of the one edge, of the other, the tip.

    along, tangents: derivatives of points along the shaft and along the barb.
    """

    points: Array
    along: Array
    tangents: Array


def dressed(
    strips: BarbStrips, look: BarbLook, draws: Sequence[int], inner: Array, roots: Array
) -> BarbStrips:
    """Strips with a look. draws: (n,) numbers by which each feather draws. inner: (S,) places of
    the edges' points on a barb, the tip at 1. roots: (B,) places of barbs on the shaft."""
    random = [draws_of(look, draw, len(roots)) for draw in draws]
    lengths = np.stack([each.lengths for each in random])
    waves = 2.0 * np.pi * np.stack([each.waves for each in random])
    phases = np.stack([each.phases for each in random], axis=1)
    strips = BarbStrips(*(_shortened(each, inner, lengths) for each in strips))
    strips = strips._replace(tangents=strips.tangents * lengths[..., None])
    place = np.concatenate([inner, inner, [1.0]])
    points, tangents = _clumped(strips, look, place, roots)
    angle = waves * place + phases
    far = look.frizz * place * np.sin(angle)
    rate = look.frizz * (np.sin(angle) + place * waves * np.cos(angle))
    for way, own, change in zip(_ways(strips), far, rate, strict=True):
        points, tangents = points + own[..., None] * way, tangents + change[..., None] * way
    return BarbStrips(points, strips.along, tangents)


def soaked(strips: BarbStrips, wet: Array, inner: Array, roots: Array) -> BarbStrips:
    """Strips whose ends water draws together. wet: (n, 2) how far, and in how many clumps. inner,
    roots: as of dressed."""
    some = wet[wet[:, 0] > 0.0]
    if not len(some):
        return strips
    place, drawn = np.concatenate([inner, inner, [1.0]]), BarbStrips(*(s.copy() for s in strips))
    for amount, clumps in np.unique(some, axis=0):
        own = (wet == (amount, clumps)).all(axis=1)
        look = BarbLook(clump=amount, clump_count=int(clumps), clump_shape=WET_SHAPE)
        mine = BarbStrips(*(each[own] for each in strips))
        drawn.points[own], drawn.tangents[own] = _clumped(mine, look, place, roots)
    return drawn


def _shortened(values: Array, inner: Array, lengths: Array) -> Array:
    """Values of strips of which only the first part is left. lengths: (n, B, 1) parts."""
    knots, stations = np.append(inner, 1.0), len(inner)
    place = lengths * knots
    low = np.clip(np.searchsorted(knots, place, side="right") - 1, 0, stations - 1)
    part = ((place - knots[low]) / np.diff(knots)[low])[..., None]
    edges = []
    for edge in (values[:, :, :stations], values[:, :, stations:-1]):
        whole = np.concatenate([edge, values[:, :, -1:]], axis=2)
        below, above = (np.take_along_axis(whole, (low + k)[..., None], axis=2) for k in (0, 1))
        edges.append(below + part * (above - below))
    tips = 0.5 * (edges[0] + edges[1])[:, :, -1:]
    return np.concatenate([edges[0][:, :, :-1], edges[1][:, :, :-1], tips], axis=2)


def _clumped(strips: BarbStrips, look: BarbLook, place: Array, roots: Array) -> tuple[Array, Array]:
    """Points and tangents of strips drawn towards the line of the middle barb of their clump."""
    middle = middle_barbs(np.zeros(len(roots), dtype=np.int64), roots, look.clump_count)
    fraction = clump_fraction(look, place)[:, None]
    # barbs that leave the shaft towards each other have no finite slope there
    slope = np.maximum(place, _NEAR) ** (look.clump_shape - 1.0)
    rate = (look.clump * look.clump_shape * slope)[:, None]
    lines = [_line(each)[:, middle] - each for each in (strips.points, strips.tangents)]
    points = strips.points + fraction * lines[0]
    return points, strips.tangents + fraction * lines[1] + rate * lines[0]


def _line(values: Array) -> Array:
    """Mean of both edges."""
    stations = values.shape[2] // 2
    middle = 0.5 * (values[:, :, :stations] + values[:, :, stations:-1])
    return np.concatenate([middle, middle, values[:, :, -1:]], axis=2)


def _ways(strips: BarbStrips) -> tuple[Array, Array]:
    """Unit vectors across the barbs in the vane, and out of it."""
    barb = unit(strips.tangents)
    across = strips.along - (strips.along * barb).sum(axis=-1, keepdims=True) * barb
    return unit(across), unit(np.cross(strips.along, strips.tangents))


_PLACES = 4  # along a feather, at the middles of as many equal parts of it
_NEAR = 32  # places of vanes that are looked at
_MOST = 0.75  # how far normals are drawn towards the coat's, at most
_SMALL = 120.0  # pixels, length of a feather up to which they are


def coat_fractions(pixels: Array) -> Array:
    """(N,) how far the normals of feathers are drawn towards the coat's. pixels: (N,) lengths."""
    return np.asarray(_MOST * np.minimum(_SMALL / np.maximum(pixels, 1e-9), 1.0))


def coat_normals(points: Array, triangles: Indices, owner: Indices, heights: Array) -> Array:
    """(N, _PLACES, 3) units, dorsal, of the coat about each feather; zero where it has no vane.

    points: (V, 3) m. triangles: (T, 3) of vanes. owner: (T,) feather, ascending, N of the last and
    1. heights: (T,) of the triangles' middles, 0 to 1 along the feather.
    """
    first, second, third = (points[triangles[:, k]] for k in range(3))
    crossed = np.cross(second - first, third - first)
    count = _PLACES * (int(owner[-1]) + 1)
    cell = _PLACES * owner + np.minimum((heights * _PLACES).astype(np.int64), _PLACES - 1)
    area = np.linalg.norm(crossed, axis=1)
    middles = _summed((first + second + third) / 3.0 * area[:, None], cell, count)
    own = unit(_summed(crossed, cell, count))
    total = np.bincount(cell, area, count)
    there = np.flatnonzero(total > 0.0)
    places = middles[there] / total[there, None]
    distance, near = cKDTree(places).query(places, k=min(_NEAR, len(places)))
    distance, near = distance.reshape(len(places), -1), near.reshape(len(places), -1)
    reach = np.maximum(distance[:, [-1]], 1e-12)
    alike = np.einsum("nc,nkc->nk", own[there], own[there][near])
    weight = (1.0 - 0.9 * (distance / reach) ** 2) * np.maximum(alike, 0.0)
    result = np.zeros((count, 3))
    result[there] = unit(np.einsum("nk,nkc->nc", weight, own[there][near]))
    return result.reshape(-1, _PLACES, 3)


def _summed(values: Array, cell: Indices, count: int) -> Array:
    """(count, 3) sums of values (T, 3) by cell."""
    return np.stack([np.bincount(cell, values[:, k], count) for k in range(3)], axis=1)


def drawn_towards(normals: Array, coat: Array, heights: Array, fractions: Array) -> Array:
    """Normals (n, B, S, 3) of barbs at heights (B,) of n feathers, drawn towards those of the coat.

    coat: (n, _PLACES, 3). fractions: (n,).
    """
    at = np.clip(heights * _PLACES - 0.5, 0.0, _PLACES - 1.0)
    low = np.minimum(at.astype(int), _PLACES - 2)
    part = (at - low)[:, None]
    there = ((1.0 - part) * coat[:, low] + part * coat[:, low + 1])[:, :, None]
    own = unit(normals)
    own = np.where((own * there).sum(axis=-1, keepdims=True) < 0.0, -own, own)
    return mixed(own, there, fractions)


def mixed(first: Array, second: Array, fractions: Array) -> Array:
    """(n, ...) units between first and second (n, B, S, 3). fractions: (n,) of the second."""
    part = fractions[:, None, None, None]
    return np.asarray(unit((1.0 - part) * first + part * second))
