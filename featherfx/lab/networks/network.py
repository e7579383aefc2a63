"""Linear elasticity of a network of straight fibres, in two or three dimensions.

    E = 1/2 sum over segments of EA / l (t . du)^2 + sum over bend triplets of EI / r |p2 - p1|^2

du difference of the displacements of a segment's ends, t its direction, l its length; p is the
segment's turn: (t x du) / l in the plane, (du - t t . du) / l in space. A triplet is two segments
that follow each other on a fibre, r = l1 + l2. Where a fibre is clamped, r is the length of its
first segment alone, so its root element is half as long as the others: a cantilever of n segments
then errs by 1 / (2 n^2) of its deflection. In the plane the clamp may be another fibre. Nodes are
hinges for fibres that cross there. Bend triplets: Houghton 2020, chapter 3. Under a mean strain e
of a periodic cell, du = e s + difference of periodic displacements, s the segment as a vector.
Matrices are sparse.

Iterative solution of a network's equations, with the block preconditioners of Houghton 2020.

    H = [Hxx Hxy; Hxy' Hyy],   S = Hyy - Hxy' Hxx^-1 Hxy

    P_J = diag H        P_Db = [Hxx 0; 0 Hyy]    P_S  = [Hxx 0; 0 S]
                        P_Ab = [Hxx Hxy; 0 Hyy]  P_AS = [Hxx Hxy; 0 S]

Unknowns are ordered x, x, ..., y, y, ... (equations 4.22 and 4.23, section 5.4.2). P_Db and P_Ab
go with any number of directions.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any, Literal, get_args

import numpy as np
from scipy import linalg, sparse
from scipy.sparse.linalg import LinearOperator, SuperLU, cg, gmres, minres, splu

from featherfx.algebra.types import Array, Flags, Indices
from featherfx.errors import Problem, require

# springs to the ground that make the matrix of a network with mechanisms regular, as a share of its
# diagonal; their effect is taken out by corrections, until these no longer halve the residual; a
# residual above _MOVES, as a share of the forces, means that these move a mechanism
_SHIFT, _CORRECTIONS, _CLOSE, _MOVES = 1e-12, 30, 1e-13, 1e-7


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

    def keeping(self, kept: Flags) -> FibreNetwork:
        """The network with some of its segments (S,) only; nodes stay."""
        number = np.cumsum(kept) - 1
        whole = kept[self.pairs[:, 1]] & ((self.pairs[:, 0] < 0) | kept[self.pairs[:, 0]])
        pairs = self.pairs[whole]
        return replace(
            self,
            ends=self.ends[kept],
            span=self.span[kept],
            stretch=self.stretch[kept],
            pairs=np.where(pairs < 0, pairs, number[pairs]),
            reach=self.reach[whole],
            bend=self.bend[whole],
        )

    def carrying(self, held: Indices) -> tuple[FibreNetwork, Indices]:
        """The network without dangling ends, which carry nothing, and its nodes (N,) in this one.

        held: (H,) nodes whose fibres may end there.
        """
        kept = np.ones(len(self.ends), dtype=bool)
        while True:
            count = np.bincount(self.ends[kept].ravel(), minlength=self.nodes)
            count[held] += 1
            loose = kept & (count[self.ends] == 1).any(axis=1)
            if not loose.any():
                break
            kept &= ~loose
        used = np.unique(np.concatenate([self.ends[kept].ravel(), held]))
        number = np.full(self.nodes, -1)
        number[used] = np.arange(len(used))
        found = self.keeping(kept)
        return replace(found, nodes=len(used), ends=number[found.ends]), used


def strain_rows(network: FibreNetwork) -> tuple[sparse.csr_array, Array, Array]:
    """Rows R (K, N d) and M (K, d d), weights (K,): E = 1/2 sum of weight (R u + M e)^2.

    u: displacements node by node. e: mean displacement gradient, row by row.
    """
    size, count = network.dimensions, len(network.ends)
    length = np.linalg.norm(network.span, axis=1)
    along = network.span / length[:, None]
    if size == 2:
        across = np.stack([-along[:, 1], along[:, 0]], axis=1)[:, None]
    else:
        across = np.eye(size) - along[:, :, None] * along[:, None, :]
    first, second = network.pairs[:, 0], network.pairs[:, 1]
    hinge, inside = np.arange(len(second)), first >= 0
    follow = _table(hinge, second, len(hinge), count)
    follow -= _table(hinge[inside], first[inside], len(hinge), count)
    turned = _blocks(across / length[:, None, None])
    each = np.arange(count)
    difference = _table(each, network.ends[:, 1], count, network.nodes)
    difference -= _table(each, network.ends[:, 0], count, network.nodes)
    strains = sparse.vstack(
        [_blocks(along[:, None]), sparse.kron(follow, np.eye(across.shape[1])) @ turned]
    )
    mean = np.einsum("sb,ac->sacb", network.span, np.eye(size)).reshape(count * size, size * size)
    stiffness = np.repeat(2.0 * network.bend / network.reach, across.shape[1])
    rows = (strains @ sparse.kron(difference, np.eye(size))).tocsr()
    return rows, strains @ mean, np.concatenate([network.stretch / length, stiffness])


def _table(rows: Indices, columns: Indices, height: int, width: int) -> sparse.csr_array:
    """Ones at the given places."""
    return sparse.csr_array((np.ones(len(rows)), (rows, columns)), shape=(height, width))


def _blocks(matrices: Array) -> sparse.csr_array:
    """Matrices (S, a, b) along the diagonal of one of S a rows and S b columns."""
    count, height, width = matrices.shape
    place = np.arange(count + 1)
    shape = (count * height, count * width)
    return sparse.bsr_array((matrices, place[:-1], place), shape=shape).tocsr()


def _squared(rows: sparse.csr_array, weights: Array) -> sparse.csr_array:
    return (rows.T @ (sparse.diags_array(weights) @ rows)).tocsr()


def factor_of(matrix: sparse.csr_array) -> SuperLU:
    """Sparse factors of a symmetric positive definite matrix."""
    return splu(
        matrix.tocsc(),
        permc_spec="MMD_AT_PLUS_A",
        diag_pivot_thresh=0.0,
        options={"SymmetricMode": True},
    )


def equilibrium(matrix: sparse.csr_array, right: Array) -> Array:
    """Displacements u (n,) or (n, m) of matrix u = right (the same shape).

    Mechanisms that the forces do not move stay nearly as they are. Raises ValueError where the
    forces move one.
    """
    diagonal = matrix.diagonal()
    ground = _SHIFT * np.where(diagonal > 0.0, diagonal, 1.0)
    factor = factor_of(matrix + sparse.diags_array(ground))
    found, left = np.zeros_like(right), 1.0
    for _ in range(_CORRECTIONS):
        found, before = found + factor.solve(right - matrix @ found), left
        rest = np.linalg.norm(right - matrix @ found)
        left = float(rest / (np.linalg.norm(right) or 1.0))
        if left <= _CLOSE or left > 0.5 * before:
            break
    if left > _MOVES:
        raise ValueError("the forces move a mechanism of the network")
    return found


def homogenised(network: FibreNetwork, gradients: Array) -> tuple[Array, Array]:
    """Energies (J) of a cell: (G, G) forms of mean displacement gradients (G, d, d), relaxed and
    affine. E = 1/2 a . form . a for a gradient of amplitudes a; nodes move freely in the relaxed
    form, and with the mean strain in the affine one, which bounds it from above."""
    rows, mean, weights = strain_rows(network)
    applied = mean @ gradients.reshape(len(gradients), -1).T
    weighted = weights[:, None] * applied
    strains = rows @ equilibrium(_squared(rows, weights), -(rows.T @ weighted)) + applied
    return strains.T @ (weights[:, None] * strains), applied.T @ weighted


def held_displacements(network: FibreNetwork, held: Indices, moved: Array, force: Array) -> Array:
    """(N, d) m, displacements of a network with nodes held (H,) at moved (H, d) m under forces
    (N, d) N on the others. ValueError where they move a mechanism."""
    system = held_system(network, held, moved)
    result = np.zeros(network.nodes * network.dimensions)
    right = system.right + force.ravel()[system.free]
    result[system.free] = equilibrium(system.matrix, right)
    places = result.reshape(-1, network.dimensions)
    places[held] = moved
    return places


@dataclass(frozen=True)
class HeldSystem:
    """matrix: (n, n) N/m, of the free unknowns. right: (n,) N, from what is held. free: (n,) their
    places among all N d."""

    matrix: sparse.csr_array
    right: Array
    free: Indices


def held_system(network: FibreNetwork, held: Indices, moved: Array) -> HeldSystem:
    """Equations of a network with nodes held (H,) at moved (H, d) m."""
    size = network.dimensions
    rows, _, weights = strain_rows(network)
    matrix = _squared(rows, weights)
    fixed = (held[:, None] * size + np.arange(size)).ravel()
    free = np.setdiff1d(np.arange(network.nodes * size), fixed)
    lines = matrix[free]
    return HeldSystem(lines[:, free], -(lines[:, fixed] @ moved.ravel()), free)


def network_energy(network: FibreNetwork, displacements: Array) -> float:
    """Energy (J) of displacements (N, d) m, without mean strain."""
    rows, _, weights = strain_rows(network)
    return 0.5 * float(weights @ (rows @ displacements.ravel()) ** 2)


def strung(
    places: Array, fibres: Sequence[Sequence[int]], stretch: float, bend: float
) -> FibreNetwork:
    """Fibres through nodes at places (N, d) m; fibres: their nodes in turn."""
    fibre = np.repeat(np.arange(len(fibres)), [len(nodes) for nodes in fibres])
    node, follows = np.concatenate(fibres), following(fibre)
    span = places[node[follows + 1]] - places[node[follows]]
    return joined(len(places), node, follows, span, (stretch, bend))


def following(fibre: Indices) -> Indices:
    """(S,) places after which the fibre goes on. fibre: (K,) of every stop, stop by stop."""
    return np.flatnonzero(fibre[1:] == fibre[:-1])


def joined(
    nodes: int, node: Indices, follows: Indices, span: Array, section: tuple[float, float]
) -> FibreNetwork:
    """Fibres whose stops are known. node: (K,) of every stop. follows: (S,), as of `following`.
    span: (S, d) m. section: N and N m^2, stretching and bending stiffness."""
    joint = np.flatnonzero(follows[1:] == follows[:-1] + 1)
    length, (stretch, bend) = np.linalg.norm(span, axis=1), section
    ends = np.stack([node[follows], node[follows + 1]], axis=1)
    return FibreNetwork(
        nodes=nodes,
        ends=ends,
        span=span,
        stretch=np.full(len(ends), stretch),
        pairs=np.stack([joint, joint + 1], axis=1),
        reach=length[joint] + length[joint + 1],
        bend=np.full(len(joint), bend),
    )


Method = Literal["pcg", "minres", "gmres", "direct"]
Preconditioner = Literal["NONE", "P_J", "P_Db", "P_Ab", "P_S", "P_AS"]
METHODS: tuple[Method, ...] = get_args(Method)
PRECONDITIONERS: tuple[Preconditioner, ...] = get_args(Preconditioner)
SYMMETRIC = ("NONE", "P_J", "P_Db", "P_S")

# S has no zeros: beyond this number of unknowns of a direction it does not fit into memory
_MAX_DENSE = 6000
# directions that GMRES keeps before it begins anew
_RESTART = 100


@dataclass(frozen=True)
class KrylovSolution:
    """iterations: of the method, 0 for the direct solution. seconds: processor time with that of
    the preconditioner, preparing: its share of it. unknowns: of the system. residual: |b - H u|
    over |b|. entries: numbers kept for the preconditioner or the factors. displacements: (n,) m, in
    the order of the system. early: iterations of GMRES until the residual that the preconditioner
    was applied to is small, by which others count; those of the method elsewhere."""

    iterations: int
    seconds: float
    preparing: float
    unknowns: int
    residual: float
    entries: int
    displacements: Array
    early: int


def solve(
    system: HeldSystem,
    method: Method,
    preconditioner: Preconditioner = "NONE",
    tolerance: float = 1e-10,
    most: int = 100_000,
    directions: int = 2,
) -> KrylovSolution:
    """Solution of a network's equations, from zero until the residual is tolerance |b|.

    most: iterations. directions: of space; the direction of an unknown is its place modulo them.
    Raises InputError where method and preconditioner do not go together, or S would be too large.
    """
    _check(len(system.right), method, preconditioner)
    order = np.argsort(system.free % directions, kind="stable")
    starts = np.searchsorted(system.free[order] % directions, np.arange(directions + 1))
    matrix, right = system.matrix[order][:, order], system.right[order]
    begin, early = time.process_time(), 0
    if method == "direct":
        factor = factor_of(matrix)
        prepared = time.process_time()
        found, iterations, entries = factor.solve(right), 0, factor.nnz
    else:
        apply, entries = _prepared(matrix, preconditioner, starts)
        prepared = time.process_time()
        operator = LinearOperator(matrix.shape, matvec=lambda given: apply(given.ravel()))
        count = _Count(matrix, right, tolerance, tolerance * float(np.linalg.norm(apply(right))))
        found, iterations = count.run(method, operator, most)
        early = count.early or iterations
    seconds = time.process_time() - begin
    residual = float(np.linalg.norm(right - matrix @ found) / (np.linalg.norm(right) or 1.0))
    moved = np.empty_like(found)
    moved[order] = found
    spent = seconds, prepared - begin
    return KrylovSolution(iterations, *spent, len(right), residual, int(entries), moved, early)


def _check(unknowns: int, method: Method, preconditioner: Preconditioner) -> None:
    problems = []
    if method in ("pcg", "minres") and preconditioner not in SYMMETRIC:
        text = f"{preconditioner} is not allowed with {method}. Give {', '.join(SYMMETRIC)}"
        problems.append(Problem("network", "preconditioner", text))
    if method != "direct" and preconditioner in ("P_S", "P_AS") and unknowns > 2 * _MAX_DENSE:
        text = f"{preconditioner} takes up to {2 * _MAX_DENSE} unknowns, not {unknowns}"
        problems.append(Problem("network", "preconditioner", text))
    require(*problems)


def _prepared(
    matrix: sparse.csr_array, kind: Preconditioner, starts: Indices
) -> tuple[Callable[[Array], Array], int]:
    """Return the inverse of a preconditioner, and how many numbers it stores.

    starts: (d + 1,) of the unknowns of the directions.
    """
    if kind == "NONE":
        return lambda given: given, 0
    if kind == "P_J":
        diagonal = matrix.diagonal()
        return lambda given: given / diagonal, len(diagonal)
    parts = [slice(a, b) for a, b in pairwise(starts.tolist())]
    factors = [factor_of(matrix[each, each]) for each in parts[:1]]
    entries, solves = factors[0].nnz, [factors[0].solve]
    if kind in ("P_Db", "P_Ab"):
        factors += [factor_of(matrix[each, each]) for each in parts[1:]]
        entries, solves = sum(each.nnz for each in factors), [each.solve for each in factors]
    else:
        corner = matrix[parts[0], parts[1]].toarray()
        schur = matrix[parts[1], parts[1]].toarray() - corner.T @ solves[0](corner)
        cholesky = linalg.cho_factor(schur)
        entries += schur.size
        solves.append(lambda given: linalg.cho_solve(cholesky, given))
    coupled = kind in ("P_Ab", "P_AS")
    above = [matrix[each, each.stop :].tocsr() for each in parts]

    def apply(given: Array) -> Array:
        found = np.empty_like(given)
        for each, one, rest in reversed(list(zip(parts, solves, above, strict=True))):
            taken = rest @ found[each.stop :] if coupled and rest.shape[1] else 0.0
            found[each] = one(given[each] - taken)
        return found

    return apply, entries


class _Enough(Exception):
    """The residual is small enough."""


class _Count:
    """Runs a method until the residual is small, and counts."""

    def __init__(
        self, matrix: sparse.csr_array, right: Array, tolerance: float, small: float
    ) -> None:
        self.matrix, self.right, self.tolerance = matrix, right, tolerance
        self.small = small / (float(np.linalg.norm(right)) or 1.0)
        self.iterations = self.early = 0
        self.last = np.zeros_like(right)

    def run(self, method: Method, operator: LinearOperator, most: int) -> tuple[Array, int]:
        if method == "minres":
            # its own test is relative to |H| |u|; the others' is relative to |b|
            ask: dict[str, Any] = {"rtol": 1e-16, "maxiter": most, "callback": self._look}
            with suppress(_Enough):
                minres(self.matrix, self.right, M=operator, **ask)
            return self.last, self.iterations
        settings: dict[str, Any] = {"rtol": self.tolerance, "maxiter": most, "M": operator}
        if method == "gmres":
            settings |= {"restart": _RESTART, "callback_type": "pr_norm"}
        if method == "gmres":
            found, _ = gmres(self.matrix, self.right, callback=self._left, **settings)
        else:
            found, _ = cg(self.matrix, self.right, callback=self._one, **settings)
        return found, self.iterations

    def _one(self, _: Any) -> None:
        self.iterations += 1

    def _left(self, residual: float) -> None:
        self.iterations += 1
        if not self.early and residual <= self.small:
            self.early = self.iterations

    def _look(self, found: Array) -> None:
        self.iterations += 1
        self.last = found.copy()
        left = np.linalg.norm(self.right - self.matrix @ found)
        if left <= self.tolerance * np.linalg.norm(self.right):
            raise _Enough
