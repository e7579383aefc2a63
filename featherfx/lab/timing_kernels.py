"""The two halves of a Newton iteration again and again, to time each without Python's share."""

from featherfx.compiled import kernel
from featherfx.solver.banded_kernels import factorise, solve_factored
from featherfx.solver.newton_kernels import linearise


@kernel
def repeat_iteration(model, loads, f, inertia, turn, centre, coefficient, solve, count, work):
    """Linearise feather f's pose count times and, if solve, factorise and solve as often.

    Arguments as in linearise. Returns how many matrices were positive definite.
    """
    good = 0
    for _ in range(count):
        linearise(model, loads, f, inertia, turn, centre, coefficient, work)
        if solve and factorise(work.system.band):
            solve_factored(work.system.band, work.system.right)
            good += 1
    return good
