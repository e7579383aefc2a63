"""Iterations of both kinematics over and over at one pose, to be timed."""

from __future__ import annotations

from featherfx.jit.compiled import kernel
from featherfx.lab.nodal.newton_kernels import nodal_assemble
from featherfx.solver.step.assembly_kernels import assemble
from featherfx.solver.step.banded_kernels import factorise, solve_factored
from featherfx.solver.types import WHOLE_STIFFNESS


@kernel
def repeat_iteration(model, loads, f, factors, solve, count, work):
    """Assemble at the pose work.now count times and, if solve, factorise and solve as often.

    Other arguments as in assemble. Returns how many matrices were positive definite.
    """
    good = 0
    for _ in range(count):
        assemble(model, loads, f, 0.0, factors, WHOLE_STIFFNESS, 0.0, work)
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
