"""Linear elasticity of a network of straight fibres, in two or three dimensions.

    E = 1/2 sum over segments of EA / l (t . du)^2 + sum over bend triplets of EI / r |p2 - p1|^2

du difference of the displacements of a segment's ends, t its direction, l its length; p is the
segment's turn: (t x du) / l in the plane, (du - t t . du) / l in space. A triplet is two segments
that follow each other on a fibre, r = l1 + l2. Where a fibre is clamped, r is the length of its
first segment alone, so its root element is half as long as the others: a cantilever of n segments
then errs by 1 / (2 n^2) of its deflection. In the plane the clamp may be another fibre. Nodes are
hinges for fibres that cross there. Bend triplets: Houghton 2020, chapter 3. Under a mean strain e
of a periodic cell, du = e s + difference of periodic displacements, s the segment as a vector.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

# an eigenvalue below this share of the largest is a mechanism, which costs no energy
MECHANISM = 1e-12


@dataclass(frozen=True)
class FibreNetwork:
    """nodes: number of nodes. ends: (S, 2) first and last node of the segments. span: (S, d) m,
    segments as vectors (they may leave a periodic cell). stretch: (S,) N, EA. pairs: (T, 2)
    segments of the bend triplets, the first -1 for a clamp to the ground. reach: (T,) m, r. bend:
    (T,) N m^2, EI."""

    nodes: int
    ends: Indices
    span: Array
    stretch: Array
    pairs: Indices
    reach: Array
    bend: Array

    @property
    def dimensions(self) -> int:
        return int(self.span.shape[1])


def strain_rows(network: FibreNetwork) -> tuple[Array, Array, Array]:
    """Rows R (K, N d) and M (K, d d), weights (K,): E = 1/2 sum of weight (R u + M e)^2.

    u: displacements node by node. e: mean displacement gradient, row by row.
    """
    size, count = network.dimensions, len(network.ends)
    length = np.linalg.norm(network.span, axis=1)
    along = network.span / length[:, None]
    difference = np.zeros((count, size, network.nodes, size))
    mean = np.zeros((count, size, size, size))
    for axis in range(size):
        # += in two statements: both ends of a periodic segment may be the same node
        difference[np.arange(count), axis, network.ends[:, 1], axis] += 1.0
        difference[np.arange(count), axis, network.ends[:, 0], axis] -= 1.0
        mean[:, axis, axis] = network.span
    both = np.concatenate(
        [difference.reshape(count, size, -1), mean.reshape(count, size, -1)], axis=2
    )
    stretched = np.einsum("sa,sak->sk", along, both)
    if size == 2:
        across = np.stack([-along[:, 1], along[:, 0]], axis=1)
        turned = np.einsum("sa,sak->sk", across, both)[:, None] / length[:, None, None]
    else:
        turned = (both - along[:, :, None] * stretched[:, None]) / length[:, None, None]
    first, second = network.pairs[:, 0], network.pairs[:, 1]
    bent = turned[second] - np.where((first < 0)[:, None, None], 0.0, turned[first])
    rows = np.concatenate([stretched, bent.reshape(-1, both.shape[2])])
    stiffness = np.repeat(2.0 * network.bend / network.reach, turned.shape[1])
    weights = np.concatenate([network.stretch / length, stiffness])
    split = network.nodes * size
    return rows[:, :split], rows[:, split:], weights


def homogenised(network: FibreNetwork, gradients: Array) -> tuple[Array, Array]:
    """Energies (J) of a cell: (G, G) forms of mean displacement gradients (G, d, d), relaxed and
    affine. E = 1/2 a . form . a for a gradient of amplitudes a; nodes move freely in the relaxed
    form, and with the mean strain in the affine one, which bounds it from above."""
    rows, mean, weights = strain_rows(network)
    applied = mean @ gradients.reshape(len(gradients), -1).T
    affine = applied.T @ (weights[:, None] * applied)
    matrix = rows.T @ (weights[:, None] * rows)
    right = -rows.T @ (weights[:, None] * applied)
    values, vectors = np.linalg.eigh(matrix)
    there = values > MECHANISM * values[-1]
    moved = vectors[:, there] @ ((vectors[:, there].T @ right) / values[there, None])
    strains = rows @ moved + applied
    return strains.T @ (weights[:, None] * strains), affine


def held_displacements(network: FibreNetwork, held: Indices, moved: Array, force: Array) -> Array:
    """(N, d) m, displacements of a network with nodes held (H,) at moved (H, d) m under forces
    (N, d) N on the others. ValueError where a mechanism is left."""
    rows, _, weights = strain_rows(network)
    size = network.dimensions
    matrix = rows.T @ (weights[:, None] * rows)
    fixed = (held[:, None] * size + np.arange(size)).ravel()
    free = np.setdiff1d(np.arange(network.nodes * size), fixed)
    result = np.zeros(network.nodes * size)
    result[fixed] = moved.ravel()
    right = force.ravel()[free] - matrix[np.ix_(free, fixed)] @ moved.ravel()
    values = np.linalg.eigvalsh(matrix[np.ix_(free, free)])
    if values[0] < MECHANISM * values[-1]:
        raise ValueError("the network has a mechanism")
    result[free] = np.linalg.solve(matrix[np.ix_(free, free)], right)
    return result.reshape(-1, size)


def network_energy(network: FibreNetwork, displacements: Array) -> float:
    """Energy (J) of displacements (N, d) m, without mean strain."""
    rows, _, weights = strain_rows(network)
    return 0.5 * float(weights @ (rows @ displacements.ravel()) ** 2)


def chain(count: int, length: float, stretch: float, bend: float, size: int = 2) -> FibreNetwork:
    """A straight fibre along x of count segments, clamped in direction at its first node."""
    first = np.arange(count)
    span = np.zeros((count, size))
    span[:, 0] = length / count
    return FibreNetwork(
        nodes=count + 1,
        ends=np.stack([first, first + 1], axis=1),
        span=span,
        stretch=np.full(count, stretch),
        pairs=np.stack([first - 1, first], axis=1),
        reach=length / count * np.where(first > 0, 2.0, 1.0),
        bend=np.full(count, bend),
    )
