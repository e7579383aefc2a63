"""Sides of triangle meshes: windings that agree within each connected component.

Triangles are connected over edges that two of them share. Edges of one triangle alone are joined
by place, since seams of textures split points. A component that no edge ends is closed: it is a
volume, and its outside is counter-clockwise whatever its author's winding. An open component keeps
the winding of the larger part of its area.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from featherfx.algebra.types import Array, Flags, Indices
from featherfx.algebra.vectors import face_products


class OrientedMesh(NamedTuple):
    """Triangles (T, 3) whose windings agree.

    closed: (T,) whether their component is. turned: (T,) triangles whose winding was changed.
    border: (T,) those with an edge that is not shared by two.
    """

    triangles: Indices
    closed: Flags
    turned: Flags
    border: Flags


class _SharedEdges(NamedTuple):
    """Edges (E,) that two triangles share: those, and whether their windings agree.

    is_border: (T,) triangles with an edge of their own, or of more than two.
    """

    first: Indices
    second: Indices
    agree: Flags
    is_border: Flags


def orient(triangles: Indices, points: Array) -> OrientedMesh:
    """Return triangles (T, 3) of points (V, 3) with windings that agree."""
    edges, count = _find_shared_edges(triangles, points), len(triangles)
    if edges.agree.all():
        component = _connect(edges.first, edges.second, count)
        turned = np.zeros(count, dtype=np.bool_)
    else:
        component, turned = _agree(edges, face_products(points[triangles]))
    open_ones = np.bincount(component, edges.is_border) > 0.0
    origin = points[triangles[:1, 0]]
    a, b, c = ((points[corner] - origin).T for corner in triangles.T)
    own = a[0] * (b[1] * c[2] - b[2] * c[1]) + a[1] * (b[2] * c[0] - b[0] * c[2])
    own = own + a[2] * (b[0] * c[1] - b[1] * c[0])
    volumes = np.bincount(component, np.where(turned, -own, own))
    turned ^= (~open_ones & (volumes < 0.0))[component]
    found = triangles
    if turned.any():
        found = np.where(turned[:, None], triangles[:, [0, 2, 1]], triangles)
    return OrientedMesh(found, ~open_ones[component], turned, edges.is_border)


def _find_shared_edges(triangles: Indices, points: Array) -> _SharedEdges:
    start, end = triangles.T.flatten(), triangles.T[[1, 2, 0]].ravel()
    one, other, alone = _pair_up(start, end)
    if len(alone):
        ends = np.concatenate([start[alone], end[alone]])
        place = np.unique(points[ends], axis=0, return_inverse=True)[1].reshape(2, -1)
        first, second, rest = _pair_up(*place)
        start[alone] = place[0]
        one, other = np.append(one, alone[first]), np.append(other, alone[second])
        alone = alone[rest]
    count = len(triangles)
    is_border = np.zeros(count, dtype=np.bool_)
    is_border[alone % count] = True
    return _SharedEdges(one % count, other % count, start[one] != start[other], is_border)


def _pair_up(start: Indices, end: Indices) -> tuple[Indices, Indices, Indices]:
    """Return numbers (P,), (P,) of edges that two triangles share, and of those without a partner.

    start, end: (E,) points of the edges. Where four or six triangles meet at an edge, two or three
    volumes touch.
    """
    low, high = np.minimum(start, end), np.maximum(start, end)
    key = low * (int(high.max(initial=0)) + 1) + high
    order = np.argsort(key, kind="stable")
    starts = np.flatnonzero(np.diff(key[order], prepend=-1))
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


def _agree(edges: _SharedEdges, products: Array) -> tuple[Indices, Flags]:
    """Return (T,) components, and the triangles to turn so that windings agree in each.

    Each triangle stands twice in a graph, as it is and turned round; an edge connects those that
    agree. A component without two sides, such as a Moebius strip, stays as it is.
    """
    count = len(products)
    own, other = edges.first, edges.second + np.where(edges.agree, 0, count)
    opposite = edges.second + np.where(edges.agree, count, 0)
    twofold = _connect(
        np.concatenate([own, own + count]), np.concatenate([other, opposite]), 2 * count
    )
    component = _connect(edges.first, edges.second, count)
    as_it_is, as_turned = twofold[:count], twofold[count:]
    area = np.linalg.norm(products, axis=1)
    weights = np.bincount(as_it_is, area, twofold.max() + 1)
    return component, (as_it_is != as_turned) & (weights[as_it_is] < weights[as_turned])
