"""Networks of straight fibres: triangular lattices, whole and diluted, and random (Mikado) ones.

After Houghton 2020, sections 5.1 and 5.3. Fibres are hinged to each other where they cross.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy import sparse
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree
from scipy.special import ndtri

from featherfx.algebra.types import Array, Flags, Indices
from featherfx.lab.networks.network import FibreNetwork, following, joined

Periodic = Literal["no", "x", "both"]
_ROW = np.sqrt(0.75)


@dataclass(frozen=True)
class FibreSection:
    """stretch: N, EA, mu in the literature. bend: N m^2, EI, kappa there."""

    stretch: float = 1.0
    bend: float = 2.5e-5


@dataclass(frozen=True)
class NetworkLayout:
    """A network and where it lies.

    places: (N, 2) m, of its nodes. size: (2,) m, width and height. held: (H,) nodes on the edges
    that are not periodic.
    """

    network: FibreNetwork
    places: Array
    size: Array
    held: Indices

    @property
    def area(self) -> float:
        return float(np.prod(self.size))

    def carrying(self) -> NetworkLayout:
        """Without dangling ends and without nodes that no fibre reaches."""
        network, used = self.network.carrying(self.held)
        return NetworkLayout(
            network, self.places[used], self.size, np.searchsorted(used, self.held)
        )


def triangular(
    columns: int,
    rows: int,
    section: FibreSection,
    periodic: Periodic,
    kept: float = 1.0,
    seed: int = 0,
) -> NetworkLayout:
    """Regular triangular lattice with sides of 1 m, nodes row by row; fibres along 0, 60, 120 deg.

    rows: a whole number of pairs of them if both directions are periodic. The lowest and the
    highest row are held otherwise. kept: probability with which a segment stays.
    """
    i, j = np.divmod(np.arange(columns * rows), columns)
    ends, inside = [], []
    # the node that follows on a row, and above to the right and to the left; odd rows are half a
    # segment to the right
    for up, right in ((0, 1), (1, 0), (1, -1)):
        row, column = i + up, j + right + up * (i % 2)
        there = np.ones(len(i), dtype=bool)
        if periodic == "no":
            there &= (column >= 0) & (column < columns)
        if periodic != "both":
            there &= row < rows
        ends.append(row % rows * columns + column % columns)
        inside.append(there)
    count = len(i)
    after = np.concatenate(ends)
    first = np.arange(3 * count)
    angles = np.repeat(np.radians([0.0, 60.0, 120.0]), count)
    network = FibreNetwork(
        nodes=count,
        ends=np.stack([first % count, after], axis=1),
        span=np.stack([np.cos(angles), np.sin(angles)], axis=1),
        stretch=np.full(3 * count, section.stretch),
        pairs=np.stack([first, first // count * count + after], axis=1),
        reach=np.full(3 * count, 2.0),
        bend=np.full(3 * count, section.bend),
    )
    stays = np.concatenate(inside) & (np.random.default_rng(seed).random(3 * count) < kept)
    height = rows if periodic == "both" else rows - 1
    edges = (0, rows - 1) if periodic != "both" else ()
    return NetworkLayout(
        network.keeping(stays),
        np.stack([j + 0.5 * (i % 2), _ROW * i], axis=1),
        np.array([columns, _ROW * height]),
        np.flatnonzero(np.isin(i, edges)),
    )


@dataclass(frozen=True)
class Mikado:
    """Fibres of equal length with random middles and directions.

    fibres: how many. width: m, of the square. length: m. merge: m; crossings of one fibre that are
    closer to each other are one node. periodic: in both directions; if not, fibres end at the edge
    of the square and are held there. scatter: rad, standard deviation of a fibre's direction from
    the x axis; None: all directions alike.
    """

    fibres: int
    width: float
    length: float = 1.0
    merge: float = 0.0
    periodic: bool = True
    seed: int = 0
    scatter: float | None = None


def mikado(plan: Mikado, section: FibreSection) -> NetworkLayout:
    """The network of a plan, with its dangling ends."""
    random = np.random.default_rng(plan.seed)
    # drawn one after the other, so that a network with more fibres holds one with fewer
    drawn = random.random((plan.fibres, 3))
    middle = plan.width * drawn[:, :2]
    evenly = plan.scatter is None
    angle = np.pi * drawn[:, 2] if evenly else plan.scatter * ndtri(drawn[:, 2])
    along = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    stops = _crossings(plan, middle, along)
    held = np.zeros(len(stops.places), dtype=bool)
    if not plan.periodic:
        stops, held = _with_edges(plan, middle, along, stops)
    return _joined(plan, stops, held, section)


@dataclass(frozen=True)
class _Stops:
    """Places of nodes on fibres. places: (M, 2) m, of the nodes. fibre, node: (K,). at: (K,) m,
    from the fibre's middle."""

    places: Array
    fibre: Indices
    node: Indices
    at: Array


def _crossings(plan: Mikado, middle: Array, along: Array) -> _Stops:
    tree = cKDTree(middle, boxsize=plan.width if plan.periodic else None)
    one, other = tree.query_pairs(plan.length, output_type="ndarray").T
    apart = _nearest(plan, middle[other] - middle[one])
    turn = _cross(along[one], along[other])
    with np.errstate(divide="ignore", invalid="ignore"):
        at_one = _cross(apart, along[other]) / turn
        at_other = _cross(apart, along[one]) / turn
    half = 0.5 * plan.length
    places = middle[one] + at_one[:, None] * along[one]
    meet = (np.abs(at_one) <= half) & (np.abs(at_other) <= half)
    if not plan.periodic:
        meet &= ((places >= 0.0) & (places <= plan.width)).all(axis=1)
    number = np.tile(np.arange(np.count_nonzero(meet)), 2)
    fibre = np.concatenate([one[meet], other[meet]])
    return _Stops(places[meet], fibre, number, np.concatenate([at_one[meet], at_other[meet]]))


def _with_edges(plan: Mikado, middle: Array, along: Array, stops: _Stops) -> tuple[_Stops, Flags]:
    """With a node where a fibre leaves the square; which nodes are held."""
    with np.errstate(divide="ignore"):
        walls = np.stack([-middle / along, (plan.width - middle) / along])
    places, fibre, at = [stops.places], [stops.fibre], [stops.at]
    for far in (walls.max(axis=0).min(axis=1), walls.min(axis=0).max(axis=1)):
        leaves = np.flatnonzero(np.abs(far) < 0.5 * plan.length)
        fibre.append(leaves)
        at.append(far[leaves])
        places.append(middle[leaves] + far[leaves, None] * along[leaves])
    every = np.concatenate(places)
    added = np.arange(len(stops.places), len(every))
    held = np.arange(len(every)) >= len(stops.places)
    node = np.concatenate([stops.node, added])
    return _Stops(every, np.concatenate(fibre), node, np.concatenate(at)), held


def _joined(plan: Mikado, stops: _Stops, held: Flags, section: FibreSection) -> NetworkLayout:
    """Nodes along fibres, near ones merged into the held or the first of them."""
    order = np.lexsort((stops.at, stops.fibre))
    fibre, node, at = stops.fibre[order], stops.node[order], stops.at[order]
    near = (fibre[1:] == fibre[:-1]) & (np.diff(at) < plan.merge)
    count = len(stops.places)
    graph = sparse.coo_array((near[near], (node[:-1][near], node[1:][near])), shape=(count, count))
    _, group = connected_components(graph, directed=False)
    ranked = np.lexsort((np.arange(count), ~held, group))
    chosen = ranked[np.unique(group[ranked], return_index=True)[1]]
    places, fixed, node = stops.places[chosen], held[chosen], group[node]
    once = np.sort(np.unique(fibre * len(chosen) + node, return_index=True)[1])
    fibre, node = fibre[once], node[once]
    follows = following(fibre)
    span = _nearest(plan, places[node[follows + 1]] - places[node[follows]])
    network = joined(len(places), node, follows, span, (section.stretch, section.bend))
    return NetworkLayout(network, places, np.full(2, plan.width), np.flatnonzero(fixed))


def _nearest(plan: Mikado, apart: Array) -> Array:
    """Vectors to the nearest periodic copy."""
    if not plan.periodic:
        return apart
    return apart - plan.width * np.round(apart / plan.width)


def _cross(first: Array, second: Array) -> Array:
    return first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0]
