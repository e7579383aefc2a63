"""What every simulation of a random case must keep to."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from drawn_cases import Case, pose_of

from featherfx.feather.types import both
from featherfx.mechanics.model import Loads, Model
from featherfx.solver.scratch import make_scratch
from featherfx.solver.solver import Solver, StepReport, describe_overload, specific_energy
from featherfx.solver.state import State
from featherfx.solver.step.energy_kernels import elastic_energy, stored_energy, viscous_energy
from featherfx.solver.types import CONVERGED, Strains

# growth of energy that round-off and Newton's tolerance may cause, share of all energy there is
ENERGY_SLACK = 1e-6
# distance of a state's points from those that its coordinates give, share of the length
_POSE_SLACK = 1e-9
_COUNTED = ("steps", "iterations", "failed", "forced")


@dataclass
class CaseOutcome:
    """Outcome of a case.

    seed, numbers: of the case. status: 0 or why the solver stopped; frame: in which frame. cause:
    what of the input stopped it, empty where nothing is known of.
    steps, iterations, failed, forced: sums over the frames (StepReport).
    energy_gain: largest growth of kinetic and potential energy over a frame, share of all there is;
    None where work is done. unexplained_gain: the same without what the integrator had held in its
    accelerations (solver/step/energy_kernels.py), which frames with steps over the
    tolerance may not give back. unsolved: largest distance of a step from its solution, share of
    the length. violations: what must never happen and did.
    """

    seed: int
    numbers: dict[str, Any]
    status: int = 0
    cause: str = ""
    frame: int = 0
    steps: int = 0
    iterations: int = 0
    failed: int = 0
    forced: int = 0
    energy_gain: float | None = None
    unexplained_gain: float | None = None
    unsolved: float = 0.0
    violations: list[str] = field(default_factory=list)


def energies(model: Model, state: State, loads: Loads) -> tuple[float, float, float]:
    """Kinetic, elastic and gravitational energy of feather 0, J, with springs of dashpots."""
    heavy, nodes = model.mass[0], state.points.nodes[0]
    kinetic = 0.5 * float(np.einsum("np,npk->", heavy, state.velocity.nodes[0] ** 2))
    turning = np.einsum("np,npk->", model.rotary_inertia[0], state.velocity.directors[0] ** 2)
    kinetic += 0.5 * float(turning)
    potential = -float(np.einsum("np,npk,k->", heavy, nodes, loads.gravity))
    strains = pose_of(model, state).strains
    gaps, history = state.gaps_of(0), Strains(*(each[0] for each in state.strains))
    elastic = float(elastic_energy(model, 0, strains, strains, gaps, 0.0, 0.0))
    elastic += viscous_energy(model, 0, strains, history, gaps, 0.0)
    return kinetic, elastic, potential


def run_case(case: Case) -> CaseOutcome:
    """Simulate a case and judge every frame."""
    outcome = CaseOutcome(case.seed, case.numbers)
    state = case.state
    gains, unexplained = [], []
    with Solver(case.model, case.settings) as solver:
        for frame, path in enumerate(case.paths):
            before = state.copy()
            new, report = solver.step(state, case.loads, path, case.duration)
            outcome.frame = frame
            _count(outcome, report)
            outcome.unsolved = max(outcome.unsolved, float(report.move[0]) / case.numbers["length"])
            outcome.violations += _broken_promises(case, before, state, new, report)
            if case.still:
                gains.append(_energy_gain(case, state, new))
                held = 0.0 if report.too_long()[0] else _held(case, state, int(report.steps[0]))
                unexplained.append(gains[-1] - held)
            state = new
            if outcome.status != CONVERGED:
                both_ends = (specific_energy(case.model, each, 0) for each in (before, new))
                outcome.cause = describe_overload(max(both_ends))
                break
    if gains:
        outcome.energy_gain, outcome.unexplained_gain = max(gains), max(unexplained)
        if not outcome.unexplained_gain <= ENERGY_SLACK:
            outcome.violations.append("energy grew")
    return outcome


def _count(outcome: CaseOutcome, report: StepReport) -> None:
    for name in _COUNTED:
        setattr(outcome, name, getattr(outcome, name) + int(getattr(report, name)[0]))
    outcome.status = int(report.status[0])


def _broken_promises(
    case: Case, before: State, given: State, new: State, report: StepReport
) -> list[str]:
    """Check the solver's promises of any step: see the names of the violations."""
    broken = []
    if any(given.arrays()[n].tobytes() != a.tobytes() for n, a in before.arrays().items()):
        broken.append("the given state was changed")
    if not all(np.isfinite(array).all() for array in new.arrays().values()):
        broken.append("not finite")
        return broken
    advanced = float(new.time[0] - given.time[0])
    ended = abs(advanced - case.duration) <= 1e-9 * case.duration
    if ended != (report.status[0] == CONVERGED):
        broken.append("time and status contradict each other")
    if report.steps[0] == 0 and not all(map(np.array_equal, new.points, given.points)):
        broken.append("no step was accepted, and the pose changed")
    if _pose_gap(case.model, new) > _POSE_SLACK * case.numbers["length"]:
        broken.append("points do not belong to the coordinates")
    return broken


def _pose_gap(model: Model, state: State) -> float:
    """Largest distance (m) of the points of feather 0 from those that its coordinates give."""
    gaps = both(np.subtract, pose_of(model, state).points, state.points.at(0))
    return max(float(np.abs(gap).max()) for gap in gaps)


def _energy_gain(case: Case, before: State, after: State) -> float:
    """Growth of the total energy, as a share of all energy that there was to begin with."""
    first = energies(case.model, before, case.loads)
    last = energies(case.model, after, case.loads)
    return (sum(last) - sum(first)) / _all_energy(case, first)


def _held(case: Case, before: State, steps: int) -> float:
    """Energy in the accelerations at the begin of a frame of so many steps, as the same share."""
    h, still = case.duration / max(steps, 1), (0.0, 0.0, 0.0)
    around = make_scratch(case.model).around
    held = float(stored_energy(case.model, 0, h, still, before, around))
    return held / _all_energy(case, energies(case.model, before, case.loads))


def _all_energy(case: Case, first: tuple[float, float, float]) -> float:
    # the fall of the feather's mass by its length is the scale of gravity
    weight = float(case.model.mass[0].sum())
    return first[0] + first[1] + weight * case.numbers["gravity"] * case.numbers["length"]
