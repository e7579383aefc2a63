"""Iterative solution of a network's equations, with the block preconditioners of Houghton 2020.

    H = [Hxx Hxy; Hxy' Hyy],   S = Hyy - Hxy' Hxx^-1 Hxy

    P_J = diag H        P_Db = [Hxx 0; 0 Hyy]    P_S  = [Hxx 0; 0 S]
                        P_Ab = [Hxx Hxy; 0 Hyy]  P_AS = [Hxx Hxy; 0 S]

Unknowns are ordered x, x, ..., y, y, ... (equations 4.22 and 4.23, section 5.4.2).
"""

from __future__ import annotations

import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from typing import Any, Literal, get_args

import numpy as np
from scipy import linalg, sparse
from scipy.sparse.linalg import LinearOperator, cg, gmres, minres

from featherfx.errors import Problem
from featherfx.lab.declare import require
from featherfx.lab.networks.network import Array, HeldSystem, factor_of

Method = Literal["pcg", "minres", "gmres", "direct"]
Preconditioner = Literal["NONE", "P_J", "P_Db", "P_Ab", "P_S", "P_AS"]
METHODS: tuple[Method, ...] = get_args(Method)
PRECONDITIONERS: tuple[Preconditioner, ...] = get_args(Preconditioner)
SYMMETRIC = ("NONE", "P_J", "P_Db", "P_S")

# S has no zeros: beyond this number of unknowns of a direction it does not fit into memory
MOST_DENSE = 6000
# directions that GMRES keeps before it begins anew
RESTART = 100


@dataclass(frozen=True)
class Solved:
    """iterations: of the method, 0 for the direct solution. seconds: processor time with that of
    the preconditioner, preparing: its share of it. unknowns: of the system. residual: |b - H u|
    over |b|. entries: numbers kept for the preconditioner or the factors. displacements: (n,) m, in
    the order of the system."""

    iterations: int
    seconds: float
    preparing: float
    unknowns: int
    residual: float
    entries: int
    displacements: Array


def solve(
    system: HeldSystem,
    method: Method,
    preconditioner: Preconditioner = "NONE",
    tolerance: float = 1e-10,
    most: int = 100_000,
) -> Solved:
    """Solution of a planar network's equations, from zero until the residual is tolerance |b|.

    most: iterations. Raises InputError where method and preconditioner do not go together, or S
    would be too large.
    """
    _check(len(system.right), method, preconditioner)
    order = np.argsort(system.free % 2, kind="stable")
    matrix, right = system.matrix[order][:, order], system.right[order]
    begin = time.process_time()
    if method == "direct":
        factor = factor_of(matrix)
        prepared = time.process_time()
        found, iterations, entries = factor.solve(right), 0, factor.nnz
    else:
        apply, entries = _prepared(matrix, preconditioner)
        prepared = time.process_time()
        operator = LinearOperator(matrix.shape, matvec=lambda given: apply(given.ravel()))
        count = _Count(matrix, right, tolerance)
        found, iterations = count.run(method, operator, most)
    seconds = time.process_time() - begin
    residual = float(np.linalg.norm(right - matrix @ found) / (np.linalg.norm(right) or 1.0))
    moved = np.empty_like(found)
    moved[order] = found
    return Solved(iterations, seconds, prepared - begin, len(right), residual, int(entries), moved)


def _check(unknowns: int, method: Method, preconditioner: Preconditioner) -> None:
    problems = []
    if method in ("pcg", "minres") and preconditioner not in SYMMETRIC:
        text = f"{preconditioner}; allowed with {method}: {', '.join(SYMMETRIC)}"
        problems.append(Problem("network", "preconditioner", text))
    if method != "direct" and preconditioner in ("P_S", "P_AS") and unknowns > 2 * MOST_DENSE:
        text = f"{preconditioner} for {unknowns} unknowns; allowed: up to {2 * MOST_DENSE}"
        problems.append(Problem("network", "preconditioner", text))
    require(*problems)


def _prepared(
    matrix: sparse.csr_array, kind: Preconditioner
) -> tuple[Callable[[Array], Array], int]:
    """What applies the inverse of a preconditioner, and how many numbers it keeps."""
    if kind == "NONE":
        return lambda given: given, 0
    if kind == "P_J":
        diagonal = matrix.diagonal()
        return lambda given: given / diagonal, len(diagonal)
    half = matrix.shape[0] // 2
    upper, corner = matrix[:half, :half], matrix[:half, half:].tocsr()
    first = factor_of(upper)
    entries = first.nnz
    if kind in ("P_Db", "P_Ab"):
        second = factor_of(matrix[half:, half:])
        entries, lower = entries + second.nnz, second.solve
    else:
        dense = corner.T @ first.solve(corner.toarray())
        factors = linalg.cho_factor(matrix[half:, half:].toarray() - dense)
        entries += half * half

        def lower(given: Array) -> Array:
            return np.asarray(linalg.cho_solve(factors, given))

    coupled = kind in ("P_Ab", "P_AS")

    def apply(given: Array) -> Array:
        below = lower(given[half:])
        above = given[:half] - corner @ below if coupled else given[:half]
        return np.concatenate([first.solve(above), below])

    return apply, entries


class _Enough(Exception):
    """The residual is small enough."""


class _Count:
    """Runs a method until the residual is small, and counts."""

    def __init__(self, matrix: sparse.csr_array, right: Array, tolerance: float) -> None:
        self.matrix, self.right, self.tolerance = matrix, right, tolerance
        self.iterations = 0
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
            settings |= {"restart": RESTART, "callback_type": "pr_norm"}
        solver = cg if method == "pcg" else gmres
        found, _ = solver(self.matrix, self.right, callback=self._one, **settings)
        return found, self.iterations

    def _one(self, _: Any) -> None:
        self.iterations += 1

    def _look(self, found: Array) -> None:
        self.iterations += 1
        self.last = found.copy()
        left = np.linalg.norm(self.right - self.matrix @ found)
        if left <= self.tolerance * np.linalg.norm(self.right):
            raise _Enough
