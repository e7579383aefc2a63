"""Direct and iterative solution, on lattices of growing size and on the matrix of a vane."""

from __future__ import annotations

import time
from pathlib import Path

import numpy as np
from scipy import sparse

from featherfx.algebra.types import Array
from featherfx.feather.build import build_feather
from featherfx.lab.feathers.feather import feather_kind
from featherfx.lab.networks.experiments import NetworkPlan, sheared_system
from featherfx.lab.networks.krylov import Method, Preconditioner, solve
from featherfx.lab.networks.network import HeldSystem
from featherfx.lab.nodal.model import nodal_model
from featherfx.lab.nodal.solver import NodalSolver
from featherfx.lab.nodal.state import nodal_rest_state
from featherfx.lab.studies.study import Comparisons, StudyResult, independent, published
from featherfx.mechanics.batch import make_model
from featherfx.mechanics.model import no_loads
from featherfx.solver.solver import Settings
from featherfx.solver.step.banded_kernels import factorise, solve_factored
from featherfx.solver.types import panel_shape

# nodes in a row of the lattices; the last has 99,456 unknowns
_SIZES = (48, 112, 224)
_GRAVITY, _ROWS, _COLUMNS = (0.0, 0.0, -9.81), 41, 8
# 1/s^2, what inertia adds in a step of 1/240 s of the solver's second order
_INERTIA = (1.5 * 240.0) ** 2
_CHOICES: tuple[Preconditioner, ...] = ("P_J", "P_Db", "P_Ab")
_TOLERANCE = 1e-8


def lattices(folder: Path) -> StudyResult:
    """A sparse factorisation beside PCG with P_Db: time, kept numbers, iterations."""
    rows = Comparisons()
    source = published(
        "Houghton 2020, table 5.4 and section 5.3.1, in words: the count does not grow"
    )
    for size in _SIZES:
        system = sheared_system(NetworkPlan(size=size).layout(periodic=False))
        text = f"{len(system.right)} unknowns"
        by_factors = solve(system, "direct")
        by_steps = solve(system, "pcg", "P_Db")
        rows.compare(
            f"iterations of PCG with P_Db, {text}",
            by_steps.iterations,
            21,
            2.0,
            source,
            absolute=True,
        )
        for name, found in (("sparse factorisation", by_factors), ("PCG with P_Db", by_steps)):
            note = f"{found.preparing:.3g} s of it preparing"
            text_of = f"processor time of the {name}, {text}"
            rows.report(text_of, found.seconds, unit="s", note=note)
            rows.report(f"numbers kept by the {name}, {text}", found.entries)
        apart = by_steps.displacements - by_factors.displacements
        rows.bound(
            f"difference of the two solutions over the largest displacement, {text}",
            float(np.abs(apart).max() / np.abs(by_factors.displacements).max()),
            independent("the other of the two methods"),
            at_most=1e-7,
        )
    return StudyResult(rows)


def vane(folder: Path) -> StudyResult:
    """The banded solver of the nodal feather beside preconditioned iterations on its matrix."""
    rows = Comparisons()
    kind = feather_kind("swan_primary")
    feather = build_feather(kind, _ROWS, _COLUMNS)
    model = make_model([feather], [kind], 2)
    nodes = nodal_model(model, [feather], [kind], bending="barbs")
    solver = NodalSolver(model, nodes, Settings(newton=1e-7 * kind.length))
    state = nodal_rest_state(model, nodes, np.zeros((1, 3)), np.eye(3)[None])
    loads = no_loads(1, _GRAVITY)
    found = solver.system(state, loads, 0, _INERTIA)
    exact, seconds = _banded(found.band, -found.gradient)
    text = f"{len(exact)} unknowns, a step of 1/240 s"
    rows.report(f"processor time of the banded solver, {text}", seconds, unit="s")
    system = HeldSystem(_whole(found.band), -found.gradient, np.arange(len(exact)))
    for choice in _CHOICES:
        method: Method = "gmres" if choice == "P_Ab" else "pcg"
        solved = solve(system, method, choice, _TOLERANCE, 20_000, directions=3)
        note = f"residual {solved.residual:.1e}"
        rows.report(
            f"iterations of {method.upper()} with {choice}, {text}", solved.iterations, note=note
        )
        ratio = solved.seconds / seconds
        rows.report(f"its time over the banded solver's, {choice}, {text}", ratio, unit="s/s")
    factors = solve(system, "direct", directions=3)
    apart = np.abs(factors.displacements - exact).max() / np.abs(exact).max()
    rows.bound(
        f"difference of the banded solution over its largest value, {text}",
        float(apart),
        independent("a sparse factorisation (SuperLU)"),
        at_most=1e-6,
    )
    return StudyResult(rows)


def _banded(band: Array, right: Array) -> tuple[Array, float]:
    """Solution, and least processor time of five."""
    panel = np.zeros(panel_shape(band.shape[1]))
    seconds = []
    for _ in range(6):
        factors, found = band.copy(), right.copy()
        begin = time.process_time()
        if not factorise(factors, panel):
            raise ArithmeticError("the vane's matrix is not positive definite")
        solve_factored(factors, found)
        seconds.append(time.process_time() - begin)
    return found, min(seconds[1:])


def _whole(band: Array) -> sparse.csr_array:
    """Sparse matrix of a band: band[j, d] of unknowns j and j + d."""
    size = len(band)
    j, d = np.nonzero(band)
    inside = j + d < size
    j, d = j[inside], d[inside]
    lower = sparse.coo_array((band[j, d], (j + d, j)), shape=(size, size)).tocsr()
    upper = sparse.triu(lower.T, 1)
    return sparse.csr_array(lower + upper)
