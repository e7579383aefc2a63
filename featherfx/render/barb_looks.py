"""Barbs of pictures with the look of their feather: in clumps, frizzy, of uneven lengths, wet.

As barbs that are written as curves have it (feather/barb_looks.py), for the strips of a picture, of
which there may be more or fewer, with the slopes that shading needs.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from featherfx.algebra.types import Array
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
