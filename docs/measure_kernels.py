"""Prints the table of a Newton iteration's kernels in docs/benchmarks.md.

OPENBLAS_NUM_THREADS=1 python docs/measure_kernels.py

Hero and production feather of the benchmarks, in the middle of their shake: processor time of each
kernel, called in a compiled loop, the least of several runs; floating-point operations by formula,
a product and its sum as two, where loops over numbers are what a kernel does; and what share they
are of the peak, that of BLAS's product of matrices in the same run. What a kernel reads and writes
is given beside it: all of it fits the second-level cache of a core.
"""

from __future__ import annotations

from collections.abc import Callable
from time import thread_time

import numpy as np

from featherfx.algebra.array_kernels import copy_values
from featherfx.feather.build import build_feather
from featherfx.jit.compiled import kernel
from featherfx.lab.bench.shake import root_paths, swan_primary
from featherfx.mechanics.batch import make_model
from featherfx.mechanics.model import expand_wind, no_loads
from featherfx.solver.solver import Settings, Solver, rest_state
from featherfx.solver.step.assembly_kernels import assemble
from featherfx.solver.step.banded_kernels import factorise, solve_factored
from featherfx.solver.step.integrator_kernels import IntegratorFactors, integrator_of
from featherfx.solver.step.modes import with_damping
from featherfx.solver.step.newton_kernels import evaluate
from featherfx.solver.step.pose_kernels import add_increment, barb_jacobians
from featherfx.solver.vane.assembly_kernels import add_rows
from featherfx.solver.vane.pairs_kernels import FORCES_ONLY, WHOLE_STIFFNESS

FEATHERS = {"hero": (41, 10, 2), "production": (21, 6, 2)}
STEP, STEPS = 1.0 / 384.0, 40
CALLS, RUNS = 200, 7


@kernel
def _assemblies(count, wanted, model, loads, factors, work):
    for _ in range(count):
        assemble(model, loads, 0, 0.0, factors, wanted, 0.0, work)


@kernel
def _products(count, model, work):
    for _ in range(count):
        add_rows(model, 0, 0.0, True, work)


@kernel
def _jacobians(count, model, work):
    for _ in range(count):
        barb_jacobians(model.shapes, work.now, work.axes, work.jacobian)


@kernel
def _energies(count, model, loads, factors, work):
    for _ in range(count):
        evaluate(model, loads, 0, 0.0, factors, work.trial, work.around)


@kernel
def _increments(count, model, work):
    for _ in range(count):
        right, gradient = work.system.right, work.beam.gradient
        add_increment(model.length[0], work.now, right, 1.0, work.trial, gradient)


@kernel
def _factors(count, band, system):
    for _ in range(count):
        copy_values(band, system.band)
        factorise(system.band, system.panel)


@kernel
def _copies(count, band, system):
    for _ in range(count):
        copy_values(band, system.band)


@kernel
def _solutions(count, right, system):
    for _ in range(count):
        copy_values(right, system.right)
        solve_factored(system.band, system.right)


def microseconds(call: Callable[[int], None]) -> float:
    """Processor time of one of CALLS calls, the least of RUNS."""
    call(1)
    best = np.inf
    for _ in range(RUNS):
        begin = thread_time()
        call(CALLS)
        best = min(best, thread_time() - begin)
    return float(1e6 * best / CALLS)


def peak() -> float:
    """Thousand million operations a second of a product of matrices."""
    size = 512
    a = np.random.default_rng(1).uniform(size=(size, size))
    best = np.inf
    for _ in range(20):
        begin = thread_time()
        a @ a
        best = min(best, thread_time() - begin)
    return float(2.0 * size**3 / best / 1e9)


def products(n: int, m: int, c: int) -> float:
    """Operations of add_rows: K J of all barbs, of shifts as sums of blocks, then their products
    with J of this row and the next two, of rows as forces and moments."""
    lanes, wide = 4 * ((m + 1) // 4 + 1), 6 + 2 * c
    along = 108.0 * (wide - 3) + 27.0
    each = 15.0 * wide + 6.0 * (wide - 6) * wide
    return 2.0 * n * lanes * (along + 3.0 * each)


def measure(name: str) -> None:
    n, m, c = FEATHERS[name]
    kind = swan_primary()
    model = with_damping(make_model([build_feather(kind, n, m)], [kind], c), [kind])
    loads = expand_wind(no_loads(1), 1)
    state = rest_state(model, np.zeros((1, 3)), np.eye(3)[None])
    solver = Solver(model, Settings(1e30, 1e-6, 1, 0.8))
    for k in range(STEPS):
        state, _ = solver.step(state, no_loads(1), root_paths(k * STEP, (k + 1) * STEP, 1), STEP)
    work, integrator = solver._work(), integrator_of(0.8, STEP)
    factors = IntegratorFactors(integrator.inertia, integrator.rate, 1.0 / STEP)
    size, width = work.system.band.shape
    assemble(model, loads, 0, 0.0, factors, WHOLE_STIFFNESS, 0.0, work)
    band, right = work.system.band.copy(), work.system.right.copy()
    copied = microseconds(lambda k: _copies(k, band, work.system))
    found = {
        "whole assembly": (
            microseconds(lambda k: _assemblies(k, WHOLE_STIFFNESS, model, loads, factors, work)),
            None,
        ),
        "of it K J and products with J": (
            microseconds(lambda k: _products(k, model, work)),
            products(n, m, c),
        ),
        "of it derivatives of barbs' nodes": (
            microseconds(lambda k: _jacobians(k, model, work)),
            None,
        ),
        "forces alone": (
            microseconds(lambda k: _assemblies(k, FORCES_ONLY, model, loads, factors, work)),
            None,
        ),
        "increment of a pose": (microseconds(lambda k: _increments(k, model, work)), None),
        "points, strains and energy": (
            microseconds(lambda k: _energies(k, model, loads, factors, work)),
            None,
        ),
        "factorisation": (
            microseconds(lambda k: _factors(k, band, work.system)) - copied,
            float(size) * (width - 1) * (width + 2),
        ),
    }
    _factors(1, band, work.system)
    solved = microseconds(lambda k: _solutions(k, right, work.system))
    found["solution"] = solved, 4.0 * size * (width - 1)
    best = peak()
    for what, (time, count) in found.items():
        told = f"{count / 1e6:.3g} | {1e-3 * count / time:.1f} | " if count else " | | "
        share = f"{100e-3 * count / time / best:.0f} %" if count else ""
        print(f"| {name} | {what} | {time:.0f} | {told}{share} |", flush=True)
    kilobytes = band.nbytes / 1024.0
    print(f"{name}: {size} unknowns, band {width}, {kilobytes:.0f} KiB; peak {best:.1f} GFlop/s")


if __name__ == "__main__":
    print("| feather | kernel | microseconds | million operations | GFlop/s | of the peak |")
    print("|---|---|---|---|---|---|")
    for each in FEATHERS:
        measure(each)
