"""Networks of straight fibres: triangular lattices, whole and diluted, and random (Mikado) ones.

After Houghton 2020, sections 5.1 and 5.3. Fibres are hinged to each other where they cross.

Networks of fibres in space: random ones in a box, and sheets that are linked to each other.

After Houghton 2020, sections 6.1, 6.3 and 6.4. Straight fibres in space do not cross: two that
pass each other nearer than a given distance have a node each at their nearest points, and the two
nodes move as one ("coupled").
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
from featherfx.algebra.vectors import dots
from featherfx.lab.networks.network import (
    FibreNetwork,
    equilibrium,
    following,
    held_system,
    joined,
    strain_rows,
)

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


@dataclass(frozen=True)
class SpaceMikado:
    """Random straight fibres in a cube of 1 m, periodic along x and z, cut at y = 0 and 1.

    fibres: how many. reach: m, distance below which two fibres are coupled. length: m, of a fibre.
    merge: m; nodes of one fibre that are closer to each other are one.
    """

    fibres: int
    reach: float
    length: float = 0.5
    merge: float = 0.0
    seed: int = 0


@dataclass(frozen=True)
class SpaceLayout:
    """A network in space. places: (N, 3) m, of its nodes. held: (H,) nodes on its borders. links:
    (S,) whether a segment joins two sheets."""

    network: FibreNetwork
    places: Array
    held: Indices
    links: Flags


def space_mikado(plan: SpaceMikado, section: FibreSection) -> SpaceLayout:
    """The network of a plan, with its dangling ends."""
    random = np.random.default_rng(plan.seed)
    middle = random.random((plan.fibres, 3))
    along = random.normal(size=(plan.fibres, 3))
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    one, other, at_one, at_other = _nearest_points(plan, middle, along)
    count = len(one)
    fibre, at = np.concatenate([one, other]), np.concatenate([at_one, at_other])
    node = np.tile(np.arange(count), 2)
    # where fibres leave the cube
    walls = np.stack([-middle[:, 1], 1.0 - middle[:, 1]]) / along[:, 1]
    for far in (walls.max(axis=0), walls.min(axis=0)):
        leaves = np.flatnonzero(np.abs(far) < 0.5 * plan.length)
        fibre, at = np.concatenate([fibre, leaves]), np.concatenate([at, far[leaves]])
        node = np.concatenate([node, count + np.arange(len(leaves))])
        count += len(leaves)
    return _strung(plan, middle, along, (fibre, node, at), section)


def _nearest_points(
    plan: SpaceMikado, middle: Array, along: Array
) -> tuple[Indices, Indices, Array, Array]:
    """Pairs of fibres that are coupled, and where on each, m from its middle (equation 6.11)."""
    tree = cKDTree(middle, boxsize=[1.0, 0.0, 1.0])
    one, other = tree.query_pairs(plan.length + plan.reach, output_type="ndarray").T
    apart = middle[one] - middle[other]
    apart[:, [0, 2]] -= np.round(apart[:, [0, 2]])
    b, d = along[one], along[other]
    between = -dots(b, d)
    by_one, by_other = dots(b, apart), -dots(d, apart)
    with np.errstate(divide="ignore", invalid="ignore"):
        at_one = (by_other * between - by_one) / (1.0 - between**2)
        at_other = (by_one * between - by_other) / (1.0 - between**2)
    gap = np.linalg.norm(apart + at_one[:, None] * b - at_other[:, None] * d, axis=1)
    height = middle[one, 1] + at_one * b[:, 1], middle[other, 1] + at_other * d[:, 1]
    half = 0.5 * plan.length
    meet = (gap < plan.reach) & (np.abs(at_one) <= half) & (np.abs(at_other) <= half)
    for each in height:
        meet &= (each > 0.0) & (each < 1.0)
    return one[meet], other[meet], at_one[meet], at_other[meet]


def _strung(
    plan: SpaceMikado,
    middle: Array,
    along: Array,
    stops: tuple[Indices, Indices, Array],
    section: FibreSection,
) -> SpaceLayout:
    """Fibres as rows of segments. stops: fibre, node and place of every node on a fibre."""
    order = np.lexsort((stops[2], stops[0]))
    fibre, node, at = (each[order] for each in stops)
    near = (fibre[1:] == fibre[:-1]) & (np.diff(at) <= plan.merge)
    count = int(node.max()) + 1
    graph = sparse.coo_array((near[near], (node[:-1][near], node[1:][near])), shape=(count, count))
    total, group = connected_components(graph, directed=False)
    node = group[node]
    # a fibre that meets a group of coupled nodes in turn has one node there
    once = np.append(True, (fibre[1:] != fibre[:-1]) | (node[1:] != node[:-1]))
    fibre, node, at = fibre[once], node[once], at[once]
    point = middle[fibre] + at[:, None] * along[fibre]
    sums = [np.bincount(node, point[:, k], total) for k in range(3)]
    places: Array = np.stack(sums, axis=1) / np.bincount(node, minlength=total)[:, None]
    follows = following(fibre)
    span = (at[follows + 1] - at[follows])[:, None] * along[fibre[follows]]
    network = joined(total, node, follows, span, (section.stretch, section.bend))
    border = np.abs(places[:, 1] - 0.5) > 0.5 - 1e-9
    return SpaceLayout(network, places, np.flatnonzero(border), np.zeros(len(follows), np.bool_))


def linked_sheets(sheet: NetworkLayout, count: int, apart: float, aside: float) -> SpaceLayout:
    """Sheets above each other, each the one below turned by a quarter about its middle.

    sheet: in the xy plane, square, held at all sides, its fibres straight: where crossings were
    merged, kinks would resist a turn in space. apart: m, between two. aside: m, how far a
    node may be, in the plane, from the one of the next sheet that it is linked to by a fibre that
    only stretches; every node has one link to the sheet above at most (section 6.3.2).
    """
    plane, middle = sheet.network, 0.5 * sheet.size
    places, spans, turn = [], [], np.eye(2)
    for k in range(count):
        flat = (sheet.places - middle) @ turn.T + middle
        places.append(np.column_stack([flat, np.full(len(flat), k * apart)]))
        spans.append(np.pad(plane.span @ turn.T, ((0, 0), (0, 1))))
        turn = np.array([[0.0, -1.0], [1.0, 0.0]]) @ turn
    inner = np.setdiff1d(np.arange(plane.nodes), sheet.held)
    shift, links = plane.nodes, []
    for k in range(count - 1):
        tree = cKDTree(places[k + 1][inner, :2])
        distance, found = tree.query(places[k][inner, :2], distance_upper_bound=aside)
        # in the order of the nodes below, as the text goes through them
        taken = np.unique(found[np.isfinite(distance)], return_index=True)
        below = np.flatnonzero(np.isfinite(distance))[taken[1]]
        ends = np.column_stack([inner[below] + k * shift, inner[taken[0]] + (k + 1) * shift])
        links.append(ends)
    every, between = np.concatenate(places), np.concatenate([*links, np.zeros((0, 2), np.int64)])
    layers = np.arange(count)
    segments = len(plane.ends)
    network = FibreNetwork(
        nodes=count * shift,
        ends=np.concatenate([*(plane.ends + k * shift for k in layers), between]),
        span=np.concatenate([*spans, every[between[:, 1]] - every[between[:, 0]]]),
        stretch=np.append(np.tile(plane.stretch, count), np.full(len(between), plane.stretch[0])),
        pairs=np.concatenate([plane.pairs + k * segments for k in layers]),
        reach=np.tile(plane.reach, count),
        bend=np.tile(plane.bend, count),
    )
    held = np.concatenate([sheet.held + k * shift for k in layers])
    return SpaceLayout(network, every, held, np.arange(len(network.ends)) >= count * segments)


@dataclass(frozen=True)
class Sheared:
    """Energies (J) of a sheared network. stretch, bend: of its fibres. links: of what joins sheets.
    affine: of all segments if every node moves with the strain. unknowns: of the system."""

    stretch: float
    bend: float
    links: float
    affine: float
    unknowns: int

    @property
    def energy(self) -> float:
        return self.stretch + self.bend


def shear(layout: SpaceLayout, gradient: Array) -> Sheared:
    """Energies under a mean displacement gradient (3, 3). Raises ValueError for mechanisms that the
    strain moves."""
    network, used = layout.network.carrying(layout.held)
    held = np.searchsorted(used, layout.held)
    moved = layout.places[used] @ gradient.T
    system = held_system(network, held, moved[held])
    found = moved.ravel()
    found[system.free] = equilibrium(system.matrix, system.right)
    lines, _, weights = strain_rows(network)
    energies = 0.5 * weights * (lines @ found) ** 2
    _, mean, whole = strain_rows(layout.network)
    size = len(layout.network.ends)
    affine = 0.5 * whole[:size] @ (mean[:size] @ gradient.ravel()) ** 2
    # links never dangle unless their nodes do
    count, joins = len(network.ends), _links_kept(layout, network, used)
    return Sheared(
        stretch=float(energies[:count].sum()),
        bend=float(energies[count:].sum()),
        links=float(energies[:count][joins].sum()),
        affine=float(affine),
        unknowns=len(system.right),
    )


def _links_kept(layout: SpaceLayout, network: FibreNetwork, used: Indices) -> Flags:
    """(S,) which segments of what carries join two sheets: their ends differ in height."""
    if not layout.links.any():
        return np.zeros(len(network.ends), np.bool_)
    height = layout.places[used, 2]
    return np.asarray(np.abs(np.diff(height[network.ends], axis=1)[:, 0]) > 0.0)
