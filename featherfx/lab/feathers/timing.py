"""What one Newton iteration costs: its assembly, and its factorisation with the solution."""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np

from featherfx.jit.compiled import kernel
from featherfx.lab.nodal.assembly_kernels import nodal_assemble
from featherfx.lab.nodal.model import NodalModel
from featherfx.lab.nodal.settle import nodal_system
from featherfx.lab.nodal.state import NodalState, make_nodal_work
from featherfx.lab.rods.experiments import posed
from featherfx.mechanics.model import Loads, Model
from featherfx.solver.state import State
from featherfx.solver.step.assembly_kernels import assemble
from featherfx.solver.step.banded_kernels import factorise, solve_factored
from featherfx.solver.step.integrator_kernels import Factors
from featherfx.solver.vane.pairs_kernels import WHOLE

TIMED_ITERATIONS, TIMED_RUNS = 10, 8
# repeat(factors, solve, count): that many iterations, with the factorisation if solve
Repeat = Callable[[Factors, bool, int], object]


def curvature_repeat(model: Model, loads: Loads, state: State) -> Repeat:
    """Iterations of the barb-curvature kinematics at a pose."""
    work = posed(model, loads, state)
    return lambda factors, solve, count: repeat_iteration(
        model, loads, 0, factors, solve, count, work
    )


def nodal_repeat(model: Model, nodal: NodalModel, loads: Loads, state: NodalState) -> Repeat:
    """Iterations of the nodal kinematics at a pose."""
    work = make_nodal_work(model, nodal)
    nodal_system(model, nodal, loads, 0, 0.0, state, work)
    return lambda factors, solve, count: repeat_nodal_iteration(
        model, nodal, loads, 0, factors, solve, count, work
    )


def iteration_seconds(repeat: Repeat, step: float) -> tuple[float, float]:
    """Seconds of one assembly, and of one factorisation with solution; step: s, of the inertia."""
    factors = Factors(1.0 / step**2, 1.0 / step, 1.0 / step)
    seconds = []
    for solve in (False, True):
        repeat(factors, solve, 1)
        best = np.inf
        # the shortest of several runs: other work on the machine only ever adds
        for _ in range(TIMED_RUNS):
            begin = time.perf_counter()
            repeat(factors, solve, TIMED_ITERATIONS)
            best = min(best, time.perf_counter() - begin)
        seconds.append(float(best) / TIMED_ITERATIONS)
    return seconds[0], max(seconds[1] - seconds[0], 0.0)


@kernel
def repeat_iteration(model, loads, f, factors, solve, count, work):
    """Assemble at the pose work.now count times and, if solve, factorise and solve as often.

    Other arguments as in assemble. Returns how many matrices were positive definite.
    """
    good = 0
    for _ in range(count):
        assemble(model, loads, f, 0.0, factors, WHOLE, 0.0, work)
        if solve and factorise(work.system.band, work.system.panel):
            solve_factored(work.system.band, work.system.right)
            good += 1
    return good


@kernel
def repeat_nodal_iteration(model, nodal, loads, f, factors, solve, count, work):
    """Assemble at the pose work.now count times and, if solve, factorise and solve as often.

    Other arguments as in nodal_assemble. Returns how many matrices were positive definite.
    """
    good, system = 0, work.system
    for _ in range(count):
        nodal_assemble(model, nodal, loads, f, 0.0, factors, False, work)
        if solve and factorise(system.band, system.panel):
            solve_factored(system.band, system.right)
            good += 1
    return good
