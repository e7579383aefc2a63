"""Iterative solution of a network's equations, with the block preconditioners of Houghton 2020.

    H = [Hxx Hxy; Hxy' Hyy],   S = Hyy - Hxy' Hxx^-1 Hxy

    P_J = diag H        P_Db = [Hxx 0; 0 Hyy]    P_S  = [Hxx 0; 0 S]
                        P_Ab = [Hxx Hxy; 0 Hyy]  P_AS = [Hxx Hxy; 0 S]

Unknowns are ordered x, x, ..., y, y, ... (equations 4.22 and 4.23, section 5.4.2). P_Db and P_Ab
go with any number of directions.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, Literal, get_args

import numpy as np
from scipy import linalg, sparse
from scipy.sparse.linalg import LinearOperator, cg, gmres, minres

from featherfx.algebra.types import Array, Indices
from featherfx.errors import InputError, Problem, require
from featherfx.lab.networks.network import HeldSystem, factor_of

Method = Literal["pcg", "minres", "gmres", "direct", "cholmod"]
Preconditioner = Literal["NONE", "P_J", "P_Db", "P_Ab", "P_S", "P_AS"]
METHODS: tuple[Method, ...] = get_args(Method)
PRECONDITIONERS: tuple[Preconditioner, ...] = get_args(Preconditioner)
DIRECT = ("direct", "cholmod")
SYMMETRIC = ("NONE", "P_J", "P_Db", "P_S")

# S has no zeros: beyond this number of unknowns of a direction it does not fit into memory
_MAX_DENSE = 6000
# directions that GMRES keeps before it begins anew
_RESTART = 100


@dataclass(frozen=True)
class KrylovSolution:
    """iterations: of the method, 0 for the direct solution. seconds: processor time with that of
    the preconditioner, preparing: its share of it. unknowns: of the system. residual: |b - H u|
    over |b|. entries: numbers kept for the preconditioner or the factors, 0 where CHOLMOD does not
    tell. displacements: (n,) m, in
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
    Raises InputError where method and preconditioner do not go together, S would be too large, or
    CHOLMOD is not there.
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
    elif method == "cholmod":
        cholesky = _cholmod(matrix)
        prepared = time.process_time()
        found, iterations, entries = cholesky(right), 0, 0
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


def _cholmod(matrix: sparse.csr_array) -> Callable[[Array], Array]:
    """Return a solver with a symmetric positive definite matrix, by the wheel of cvxopt."""
    try:
        from cvxopt import cholmod, spmatrix
        from cvxopt import matrix as vector
    except ImportError as error:
        told = "cholmod, which needs cvxopt: pip install cvxopt"
        raise InputError(Problem("network", "method", told)) from error
    lower = sparse.tril(matrix).tocoo()
    places = (vector(each.astype(np.int64)) for each in (lower.row, lower.col))
    given = spmatrix(vector(lower.data), *places, matrix.shape)
    factor = cholmod.symbolic(given)
    try:
        cholmod.numeric(given, factor)
    except ArithmeticError as error:
        raise ValueError("a factor of it is singular") from error

    def solved(right: Array) -> Array:
        found = vector(right)
        cholmod.solve(factor, found)
        return np.array(found).ravel()

    return solved


def _check(unknowns: int, method: Method, preconditioner: Preconditioner) -> None:
    problems = []
    if method in ("pcg", "minres") and preconditioner not in SYMMETRIC:
        text = f"{preconditioner} is not allowed with {method}. Give {', '.join(SYMMETRIC)}"
        problems.append(Problem("network", "preconditioner", text))
    if method not in DIRECT and preconditioner in ("P_S", "P_AS") and unknowns > 2 * _MAX_DENSE:
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
