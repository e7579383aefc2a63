"""What becomes of a step that was tried: it is taken, or tried once more in another way.

A step is tried from the predicted pose, then from the rigidly moved one, then by implicit Euler,
and is then cut. Steps that were cut grow again from their own length, by implicit Euler if that
was needed, because where Newton failed it mostly fails again at once. Implicit Euler is also taken
where the shortest step misses the tolerance by far: the other method may gain energy from motions
that it does not resolve.
"""

from featherfx.jit.compiled import kernel
from featherfx.solver.step.energy_promise_kernels import GREW
from featherfx.solver.step.newton_kernels import CONVERGED

# columns of a feather's counters
STEPS, ITERATIONS, MATRICES, REJECTED, FAILED, FALLBACKS, FORCED, ERROR, MOVE, STATUS = range(10)
COUNTERS = 10
# how a step is tried, in this order
GO_ON, FOLLOW, BACKWARD = 0, 1, 2
# error over tolerance beyond which a step that may not be shorter is taken by implicit Euler
LOST = 30.0
# Newton iterations beyond which the next step is not made longer
HARD = 12
# a regular step may be cut this far when Newton fails, by this share each time
SMALLEST_SHARE, CUT = 1e6, 0.25


@kernel
def count_try(counters, verdict, option, effort, error, limits, move):
    """Add a try to the counters.

    effort: (iterations, of them with a new matrix). move: m, distance from the solution.
    """
    counters[ITERATIONS] += effort[0]
    counters[MATRICES] += effort[1]
    counters[verdict] += 1
    if verdict == STEPS:
        counters[FALLBACKS] += 1 if option == BACKWARD else 0
        counters[FORCED] += 1 if error > limits[1] else 0
        counters[ERROR] = max(counters[ERROR], error)
        counters[MOVE] = max(counters[MOVE], move)


@kernel
def stop(counters, status):
    """Note why the frame was not finished."""
    counters[STATUS] = status
    return status


@kernel
def next_step(h, done, duration):
    """Length (s) of a step if h is wanted, and the share of the frame (duration, of which done
    have passed, s) at its end: no step leaves a much shorter one behind."""
    left = duration - done
    if h > 0.999 * left:
        return left, 1.0
    step = 0.5 * left if h > 0.6 * left else h
    return step, (done + step) / duration


@kernel
def _length_for(error, tolerance, step, least, most):
    """Length whose error would be a little below the tolerance, within least to most of step."""
    change = 0.9 * (tolerance / max(error, 1e-30)) ** (1.0 / 3.0)
    return step * min(most, max(least, change))


@kernel
def judge(h, step, option, first, status, error, limits):
    """What becomes of a step: (STEPS, REJECTED or FAILED, next wanted length h, next option).

    h: s, wanted length; step: s, the one tried. first: option of a fresh step. status: of
    Newton, or GREW. error: m. limits: (shortest regular step s, tolerance m, error in m that no
    step may have where it can be shorter, Newton iterations beyond which the next step is not made
    longer). The next h is 0 where a step cannot be cut further.
    """
    shortest, tolerance, coarse, _ = limits
    smallest, shorter = shortest / SMALLEST_SHARE, CUT * step
    if status == GREW:
        # another start of Newton would find the same
        option = max(option, FOLLOW)
    if status != CONVERGED:
        option = BACKWARD if step < 0.999 * shortest and option < BACKWARD else option + 1
        if option <= BACKWARD:
            return FAILED, h, option
        return FAILED, shorter if shorter >= smallest else 0.0, first
    if error > tolerance and step > 1.001 * shortest:
        return REJECTED, max(shortest, _length_for(error, tolerance, step, 0.2, 1.0)), first
    lost = error > LOST * tolerance
    if lost and option != BACKWARD:
        return REJECTED, h, BACKWARD
    if lost and error > coarse and shorter > smallest:
        return REJECTED, shorter, option
    return STEPS, h, option


@kernel
def after_step(step, option, first, error, limits, effort):
    """The next (h, option) where a step was taken; arguments as in judge and count_try."""
    shortest, tolerance, _, hard = limits
    # an iteration with a matrix at hand costs a quarter of one with a new one
    costly = (effort[0] + 3 * effort[1]) // 4
    most = 1.0 if costly > hard or error > LOST * tolerance else 2.0
    h = max(min(shortest, most * step), _length_for(error, tolerance, step, 0.5, most))
    option = BACKWARD if option == BACKWARD and step < 0.999 * shortest else first
    return h, option
