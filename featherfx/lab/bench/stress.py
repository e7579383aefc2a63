"""Random cases: what every simulation must keep to, the outcomes on disk, what they add up to."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from dataclasses import asdict, dataclass, field
from pathlib import Path
from statistics import fmean, quantiles
from time import thread_time
from typing import Any

import numpy as np

from featherfx.errors import InputError, Problem
from featherfx.feather.types import both
from featherfx.lab.bench.cases import Case, draw_case, pose_of, zipped
from featherfx.mechanics.model import Loads, Model
from featherfx.solver.scratch import make_scratch
from featherfx.solver.solver import (
    COARSE_ERROR_RATIO,
    Solver,
    StepReport,
    describe_overload,
    specific_energy,
)
from featherfx.solver.state import State
from featherfx.solver.status import (
    CONVERGED,
    TOO_MUCH_WORK,
    reason_of,
)
from featherfx.solver.step.energy_kernels import elastic_energy, stored_energy

# growth of energy that round-off and Newton's tolerance may cause, share of all energy there is
ENERGY_SLACK = 1e-6
# distance of a state's points from those that its coordinates give, share of the length
_POSE_SLACK = 1e-9
WORST = 5
_COUNTED = ("steps", "iterations", "rejected", "failed", "fallbacks", "forced")


@dataclass
class CaseOutcome:
    """Outcome of a case.

    seed, numbers: of the case. status: 0 or why the solver stopped; frame: in which frame. cause:
    what of the input stopped it, empty where nothing is known of.
    steps, iterations, rejected, failed, fallbacks, forced: sums over the frames (StepReport).
    energy_gain: largest growth of kinetic and potential energy over a frame, share of all there is;
    None where work is done. unexplained_gain: the same without what the integrator had held in its
    accelerations (solver/step/energy_kernels.py), which frames with steps over the
    tolerance may not give back. unsolved: largest distance of a step from its solution, share of
    the length. violations: what must never happen and did. seconds: processor
    time.
    """

    seed: int
    numbers: dict[str, Any]
    status: int = 0
    cause: str = ""
    frame: int = 0
    steps: int = 0
    iterations: int = 0
    rejected: int = 0
    failed: int = 0
    fallbacks: int = 0
    forced: int = 0
    energy_gain: float | None = None
    unexplained_gain: float | None = None
    unsolved: float = 0.0
    violations: list[str] = field(default_factory=list)
    seconds: float = 0.0

    @property
    def verdict(self) -> str:
        """ok (one step a frame), sub-stepped, or stopped with a status."""
        if self.status != CONVERGED:
            return "stopped"
        return "ok" if self.steps == self.frame + 1 and not self.failed else "sub-stepped"


def energies(model: Model, state: State, loads: Loads) -> tuple[float, float, float]:
    """Kinetic, elastic and gravitational energy of feather 0, J."""
    heavy, nodes = model.mass[0], state.points.nodes[0]
    kinetic = 0.5 * float(np.einsum("np,npk->", heavy, state.velocity.nodes[0] ** 2))
    turning = np.einsum("np,npk->", model.rotary_inertia[0], state.velocity.directors[0] ** 2)
    kinetic += 0.5 * float(turning)
    potential = -float(np.einsum("np,npk,k->", heavy, nodes, loads.gravity))
    strains = pose_of(model, state).strains
    elastic = float(elastic_energy(model, 0, strains, strains, state.gaps_of(0), 0.0))
    return kinetic, elastic, potential


def run_case(case: Case) -> CaseOutcome:
    """Simulate a case and judge every frame."""
    outcome = CaseOutcome(case.seed, case.numbers)
    start = thread_time()
    state = case.state
    gains, unexplained = [], []
    with Solver(case.model, case.settings) as solver:
        for frame, path in enumerate(case.paths):
            if case.strokes:
                state = zipped(case.model, state, case.strokes[frame])
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
    outcome.seconds = thread_time() - start
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


def run_seeds(
    seeds: Iterable[int],
    jobs: int = 1,
    most_rows: int = 200,
    hooks: bool = False,
    progress: Callable[[int, int], None] | None = None,
    keep: Callable[[CaseOutcome], None] | None = None,
) -> list[CaseOutcome]:
    """Outcomes of the cases of the seeds, in their order.

    most_rows, hooks: of draw_case. progress: called as (done, total). keep: called with each
    outcome as soon as it is there.
    """
    listed = list(seeds)

    def one(seed: int) -> CaseOutcome:
        return run_case(draw_case(seed, most_rows, hooks))

    with ThreadPoolExecutor(jobs) as pool:
        futures = [pool.submit(one, seed) for seed in listed]
        try:
            for done, future in enumerate(as_completed(futures), 1):
                if keep is not None:
                    keep(future.result())
                if progress is not None:
                    progress(done, len(listed))
        except BaseException:
            pool.shutdown(cancel_futures=True)
            raise
    return [future.result() for future in futures]


def as_record(outcome: CaseOutcome) -> dict[str, Any]:
    """An outcome as plain data for JSON."""
    values = asdict(outcome) | {"verdict": outcome.verdict}
    return values | {"case": values.pop("numbers")}


FILE = "stress_cases.jsonl"
# that records of earlier versions may lack
_NEEDED = "unexplained_gain", "cause", "unsolved"
Record = dict[str, Any]


def read_records(folder: Path) -> dict[int, Record]:
    """Records of earlier runs by seed; a last line that was cut off is left out.

    Raises InputError where another line is not a record.
    """
    path = folder / FILE
    if not path.exists():
        return {}
    text = path.read_text(encoding="utf-8")
    lines = text.split("\n")
    found = {}
    for number, line in enumerate(lines[:-1], 1):
        try:
            record = json.loads(line)
            found[int(record["seed"])] = {name: record[name] for name in _NEEDED} | record
        except (ValueError, KeyError, TypeError) as error:
            raise InputError(
                Problem(str(path), f"line {number}", "not a record of a case. Remove the file")
            ) from error
    if lines[-1]:
        path.write_text("".join(line + "\n" for line in lines[:-1]), encoding="utf-8")
    return found


def append_record(folder: Path, record: Record) -> None:
    """Add a record to the folder's file, which a run that is killed leaves as it is."""
    folder.mkdir(parents=True, exist_ok=True)
    with (folder / FILE).open("a", encoding="utf-8") as stream:
        stream.write(json.dumps(record) + "\n")


def summary(records: Sequence[Record]) -> Record:
    """Counts, and the worst cases: violations first, then stopped ones, then the dearest."""
    ranked = sorted(
        records,
        key=lambda r: (bool(r["violations"]), r["status"] != CONVERGED, r["iterations"]),
        reverse=True,
    )
    still = [r for r in records if r["energy_gain"] is not None]
    gains = [r["energy_gain"] for r in still]
    verdicts = Counter(r["verdict"] for r in records)
    reasons = Counter(_reason(r["status"]) for r in records if r["status"] != CONVERGED)
    return {
        "cases": len(records),
        "ok": verdicts["ok"],
        "sub_stepped": verdicts["sub-stepped"],
        "stopped": verdicts["stopped"],
        "stopped_by_the_input": sum(bool(r["cause"]) for r in records),
        **{f"stopped: {reason}": count for reason, count in sorted(reasons.items())},
        "with_unsolved_steps": sum(r["unsolved"] > COARSE_ERROR_RATIO for r in records),
        "violations": sum(bool(r["violations"]) for r in records),
        "still_cases": len(gains),
        "still_cases_rippling": sum(g > ENERGY_SLACK for g in gains),
        "largest_energy_gain": max(gains, default=0.0),
        "largest_unexplained_gain": max((r["unexplained_gain"] for r in still), default=0.0),
        "steps": sum(r["steps"] for r in records),
        "implicit_euler_steps": sum(r["fallbacks"] for r in records),
        "steps_over_tolerance": sum(r["forced"] for r in records),
        "iterations": sum(r["iterations"] for r in records),
        **_seconds([r["seconds"] for r in records]),
        "worst": ranked[:WORST],
        "stopped_cases": [_stop_of(r) for r in records if r["status"] != CONVERGED],
    }


def _stop_of(record: Record) -> Record:
    """Describe the case that stopped: frame, reason, and the input that causes it."""
    reason = _reason(record["status"])
    return {name: record[name] for name in ("seed", "frame", "cause")} | {"reason": reason}


def short(summed: Record) -> Record:
    """The figures of a summary that programs ask for. over_tolerance_share: of all steps. seconds:
    of processor, of all cases."""
    return {
        "cases": summed["cases"],
        "stopped": summed["stopped"],
        "stopped_by_the_input": summed["stopped_by_the_input"],
        "with_unsolved_steps": summed["with_unsolved_steps"],
        "violations": summed["violations"],
        "over_tolerance_share": summed["steps_over_tolerance"] / max(summed["steps"], 1),
        "seconds": summed["seconds_a_case"] * summed["cases"],
        "median_seconds": summed["median_seconds"],
        "stopped_cases": summed["stopped_cases"],
    }


def _reason(status: int) -> str:
    """Why a case stopped; cases of different sizes have different limits."""
    return "the limit of work" if status == TOO_MUCH_WORK else reason_of(status)


def _seconds(seconds: list[float]) -> dict[str, float]:
    """Processor time of a case: mean and distribution."""
    cuts = quantiles(seconds, n=100, method="inclusive") if len(seconds) > 1 else seconds * 99
    return {
        "seconds_a_case": fmean(seconds),
        "median_seconds": cuts[49],
        "seconds_of_the_dearest_tenth": cuts[89],
        "seconds_of_the_dearest_hundredth": cuts[98],
        "most_seconds": max(seconds),
    }
