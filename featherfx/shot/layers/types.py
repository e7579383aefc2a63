"""Data of layered plumage, as the kernels take them.

Nodes of a vane are counted as on a strip: rows from the base, columns from the trailing barb's end
(0) over the shaft (m) to the leading barb's end (2 m).
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Indices = NDArray[np.int64]
Bytes = NDArray[np.int8]

# One condition that a feather keeps clear of what is beneath it. pair: its number; upper, lower:
# feathers. node, after: rows and columns of nodes of the feather that the point is of, part: how
# far it lies from one to the other; above: whether that feather is the upper one. corner: rows and
# columns of the other's triangle around the point, weight: theirs, times how far each goes along
# the triangle's normal for its lift. own: that of the point. base: m, what is lacking where neither
# is lifted, and clear: m, what of it is to be between surfaces. share: of it that counts. beside:
# m, how far the point lies beside the other's edge.
LAP = np.dtype(
    [
        *((name, "i4") for name in ("pair", "upper", "lower")),
        ("above", "i1"),
        ("node", "i2", (2,)),
        ("after", "i2", (2,)),
        ("corner", "i2", (3, 2)),
        ("weight", "f8", (3,)),
        *((name, "f8") for name in ("part", "own", "base", "clear", "share", "beside")),
    ]
)
Laps = NDArray[Any]


class Vanes(NamedTuple):
    """F feathers of n rows and m columns a side, as they are drawn.

    present: (F, n, 2 m + 1) nodes that a triangle has. exists: (F, 2, n - 1, m, 2) triangles.
    half: (F,) m, half thickness. row: (F, n - 1) and barb: (F, 2, n) m, distances of nodes along
    shaft and barbs. first: (F,) first row of the vane. deepest: (F,) m, depth that is undone.
    clear: (F,) m, kept from others, at the least. reach: (F,) m, beside a vane, up to where it
    counts. limb: (F,) which one moves it, 0 for none.
    """

    present: Bytes
    exists: Bytes
    half: Array
    row: Array
    barb: Array
    first: Indices
    deepest: Array
    clear: Array
    reach: Array
    limb: Indices


class Stack(NamedTuple):
    """Stacking order. order: (F,) feathers, those beneath first. pairs: (K, 2) upper and lower, in
    the order of the upper; first: (F + 1,) those of order[k] are first[k] to first[k + 1] - 1."""

    order: Indices
    pairs: Indices
    first: Indices


class SkinBelow(NamedTuple):
    """Nodes over a skin. triangle: (F, n, 2 m + 1) the nearest at rest, -1 for a node that is not
    over it. clear: m, height to keep. triangles: (T, 3); beside: (T, 3) those across the edges
    opposite each corner, -1 for none."""

    triangle: Indices
    clear: Array
    triangles: Indices
    beside: Indices


class Lifts(NamedTuple):
    """Lifts of nodes. lift: (F, n, 2 m + 1) m, now; before: at the sample before. same: (F,)
    whether a feather would be where it was then, lifted alike; moved: whether it is shown
    elsewhere; settled: whether its lift is what it was then, strays: whether it is far from that.
    meets: (K,) whether a pair is near enough to be looked at, depths: how deep it is, in
    thicknesses, below 0 how far apart, touching: whether it touches."""

    lift: Array
    before: Array
    same: Bytes
    moved: Bytes
    settled: Bytes
    strays: Bytes
    meets: Bytes
    depths: Array
    touching: Bytes


class LayingRules(NamedTuple):
    """Rules by which a sample is laid. kept: share of a lift that it keeps at least, of the sample
    before. turns: searches of a feather at most. follow: gap up to which nodes are followed, in
    thicknesses. off: change of a lift, over half a thickness, from which on a feather is searched
    again; seen: the same, for what is written. slope: what a lift may rise along shaft or barb."""

    kept: float
    turns: int
    follow: float
    off: float
    seen: float
    slope: float


class Scratch(NamedTuple):
    """Scratch memory of one thread. laps: (L,). wanted, asked, least, most: (n, 2 m + 1) m. seen:
    (n, 2 m + 1, 5)."""

    laps: Laps
    wanted: Array
    asked: Array
    least: Array
    most: Array
    seen: Indices


class PosedVanes(NamedTuple):
    """F feathers at one time. points: (F, n, 1 + 2 m, 3) m, nodes, lifted by lift,
    (F, n, 2 m + 1) m, along way, (F, n, 3), unit vectors of rows. boxes: (F, n, 6) around
    rows and bounds: (F, 6) around vanes. frames: (F, 4, 3) origin and axes of each feather, along
    its shaft, across and up; own: (F, 6) box around the vane in that, and heights:
    (F, 12, 8, 2) m, least and greatest height of the vane in it, over fields along and across."""

    points: Array
    way: Array
    lift: Array
    boxes: Array
    bounds: Array
    frames: Array
    own: Array
    heights: Array
