"""Networks of fibres in space: random ones in a box, and sheets that are linked to each other.

After Houghton 2020, sections 6.1, 6.3 and 6.4. Straight fibres in space do not cross: two that
pass each other nearer than a given distance have a node each at their nearest points, and the two
nodes move as one ("coupled").
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import sparse
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from featherfx.algebra.types import Array, Flags, Indices
from featherfx.algebra.vectors import dots
from featherfx.lab.networks.layouts import FibreSection, NetworkLayout
from featherfx.lab.networks.network import (
    FibreNetwork,
    equilibrium,
    following,
    held_system,
    joined,
    strain_rows,
)


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
