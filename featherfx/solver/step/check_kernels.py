"""Whether a step that Newton leaves may be taken as it is: nearly solved, without gained energy."""

from featherfx.jit.compiled import kernel
from featherfx.solver.step.energy_promise_kernels import (
    GREW,
    held_energy,
    left_alone,
    rounding_energy,
    solved_energy,
    state_energy,
)
from featherfx.solver.step.integrator_kernels import EULER
from featherfx.solver.step.newton_kernels import CONVERGED, NOT_CONVERGED

# share of a step's own error that it may be away from its solution when its iterations are used up
NEARLY = 0.01


@kernel
def energy_promise(model, loads, f, path, duration, state):
    """What the steps of a frame may not gain: (whether anything is promised, velocity of the root
    m/s, energy by which rounding may raise it J), and the energy at the frame's start (J)."""
    alone, drift = left_alone(model, loads, f, path, duration)
    if not alone:
        return (alone, drift, 0.0), 0.0
    return (alone, drift, rounding_energy(model, f)), state_energy(model, loads, f, drift, state)


@kernel
def nearly_solved(status, used_up, move, error):
    """Newton's status, of a step whose distance move (m) from its solution is far below its error.

    used_up: whether Newton had no iterations left.
    """
    if status == NOT_CONVERGED and used_up and move <= NEARLY * error:
        return CONVERGED
    return status


@kernel
def check_promise(
    model, loads, f, h, radius, status, error, limits, promise, energy, rate, state, work
):
    """(status, share of its velocities that the step may keep, energy after it in J).

    The step of h (s) is in work.now. limits: as in retry_kernels.judge. promise, energy: of
    energy_promise, the latter now. rate: of the integrator. A resolved step may give back what the
    integrator holds. Where the share would be negative the status becomes GREW.
    """
    alone, drift, growth = promise
    if not alone or status != CONVERGED:
        return status, 1.0, energy
    if radius != EULER and error <= min(limits[1], limits[2]):
        growth += held_energy(
            model.mass[f], h, drift, state.velocity[f], state.acceleration[f], state.smoothed[f]
        )
    past = work.around.past
    keeps, after = solved_energy(model, loads, f, drift, energy, growth, rate, work.now, past)
    return GREW if keeps < 0.0 else status, keeps, after
