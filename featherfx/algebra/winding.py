"""Sides of polygon meshes: windings that agree within each connected component.

Faces are connected over edges that two of them share. Edges of one face alone are joined by place,
since seams of textures split points. A component that no edge ends is closed: it is a volume, and
its outside is counter-clockwise whatever its author's winding. An open component keeps the winding
of the larger part of its area.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from featherfx.algebra.types import Array, Flags, Indices
from featherfx.algebra.vectors import dots


class FaceSides(NamedTuple):
    """Sides of faces (F,).

    closed: whether their component is. turned: whether windings agree with this one changed.
    border: whether an edge is not shared by two.
    """

    closed: Flags
    turned: Flags
    border: Flags


class _SharedEdges(NamedTuple):
    """Edges (E,) that two faces share: those, and whether their windings agree.

    is_border: (F,) faces with an edge of their own, or of more than two.
    """

    first: Indices
    second: Indices
    agree: Flags
    is_border: Flags


def orient(counts: Indices, indices: Indices, points: Array, normals: Array) -> FaceSides:
    """Return the sides of faces with counts (F,) of corners, 1 or more, at points (V, 3).

    normals: (F, 3) of the faces, twice their area long.
    """
    starts = np.cumsum(counts) - counts
    following = np.arange(1, len(indices) + 1)
    following[starts - 1] -= np.roll(counts, 1)
    edges = _find_shared_edges(indices, indices[following], counts, points)
    component = _connect(edges.first, edges.second, len(counts))
    is_closed = np.bincount(component, edges.is_border)[component] == 0.0
    turned = np.zeros(len(counts), dtype=np.bool_)
    if not edges.agree.all():
        turned = _agree(edges, normals)
    if is_closed.any():
        corners = points[indices[starts]]
        volumes = dots(normals, corners - corners[:1])
        outward = np.bincount(component, np.where(turned, -volumes, volumes))
        turned = turned ^ (is_closed & (outward < 0.0)[component])
    return FaceSides(is_closed, turned, edges.is_border)


def _find_shared_edges(
    start: Indices, end: Indices, counts: Indices, points: Array
) -> _SharedEdges:
    """Return the shared edges of faces with counts (F,) of edges from start to end (C,)."""
    face = np.repeat(np.arange(len(counts)), counts)
    if (start == end).any():
        start, end, face = (each[start != end] for each in (start, end, face))
    one, other, alone = _pair_up(start, end)
    if len(alone):
        ends = np.concatenate([start[alone], end[alone]])
        place = np.unique(points[ends], axis=0, return_inverse=True)[1].reshape(2, -1)
        first, second, rest = _pair_up(*place)
        start = start.copy()
        start[alone] = place[0]
        one, other = np.append(one, alone[first]), np.append(other, alone[second])
        alone = alone[rest]
    is_border = np.zeros(len(counts), dtype=np.bool_)
    is_border[face[alone]] = True
    first, second = face[one], face[other]
    return _SharedEdges(first, second, (start[one] != start[other]) | (first == second), is_border)


def _pair_up(start: Indices, end: Indices) -> tuple[Indices, Indices, Indices]:
    """Return numbers (P,), (P,) of edges that two faces share, and of those without a partner.

    start, end: (E,) points of the edges. Where four or six faces meet at an edge, two or three
    volumes touch.
    """
    key, high = np.minimum(start, end), np.maximum(start, end)
    key *= int(high.max(initial=0)) + 1
    key += high
    order = np.argsort(key, kind="stable")
    key = key[order]
    starts = np.flatnonzero(np.append(True, key[1:] != key[:-1])[: len(key)])
    uses = np.diff(starts, append=len(order))
    twice = starts[uses == 2]
    alone = np.zeros(0, dtype=np.int64)
    if 2 * len(twice) < len(order):
        alone = np.sort(order[np.repeat(uses % 2 == 1, uses)])
    return order[twice], order[twice + 1], alone


def _connect(first: Indices, second: Indices, count: int) -> Indices:
    """Return (count,) the least number of those that pairs connect with each of count things."""
    label = np.arange(count)
    while len(first):
        low = np.minimum(label[first], label[second])
        np.minimum.at(label, label[first], low)
        np.minimum.at(label, label[second], low)
        while (ahead := label[label]).tobytes() != label.tobytes():
            label = ahead
        apart = label[first] != label[second]
        first, second = first[apart], second[apart]
    return label


def _agree(edges: _SharedEdges, normals: Array) -> Flags:
    """Return (F,) the faces to turn so that windings agree in each component.

    Each face stands twice in a graph, as it is and turned round; an edge connects those that
    agree. A component without two sides, such as a Moebius strip, stays as it is.
    """
    count = len(normals)
    own, other = edges.first, edges.second + np.where(edges.agree, 0, count)
    opposite = edges.second + np.where(edges.agree, count, 0)
    twofold = _connect(
        np.concatenate([own, own + count]), np.concatenate([other, opposite]), 2 * count
    )
    as_it_is, as_turned = twofold[:count], twofold[count:]
    area = np.linalg.norm(normals, axis=1)
    weights = np.bincount(as_it_is, area, twofold.max() + 1)
    return np.asarray((as_it_is != as_turned) & (weights[as_it_is] < weights[as_turned]))
