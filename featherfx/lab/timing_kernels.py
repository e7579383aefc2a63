"""The two halves of a Newton iteration again and again, to time each without Python's share."""

from featherfx.compiled import kernel
from featherfx.solver.assembly_kernels import assemble
from featherfx.solver.banded_kernels import factorise, solve_factored
from featherfx.solver.vane_pairs_kernels import WHOLE


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
