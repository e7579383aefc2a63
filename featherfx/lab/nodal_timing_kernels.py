"""The two halves of a nodal Newton iteration again and again, without Python's share."""

from featherfx.compiled import kernel
from featherfx.solver.banded_kernels import factorise, solve_factored
from featherfx.solver.nodal_assembly_kernels import nodal_assemble


@kernel
def repeat_nodal_iteration(model, nodal, loads, f, factors, solve, count, work):
    """Assemble at the pose work.now count times and, if solve, factorise and solve as often.

    Other arguments as in nodal_assemble. Returns how many matrices were positive definite.
    """
    good, system = 0, work.system
    for _ in range(count):
        nodal_assemble(model, nodal, loads, f, 0.0, factors, False, work.before, work)
        if solve and factorise(system.band, system.panel):
            solve_factored(system.band, system.right)
            good += 1
    return good
