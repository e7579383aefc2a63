"""Random feathers far beyond what grows: the solver keeps its promises, or stops with a reason."""

from __future__ import annotations

import json
import os
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path

from drawn_cases import draw_case
from judged_cases import run_case

from featherfx.solver.solver import COARSE_ERROR_RATIO

from .cases import Failure, Found, child, ended_by, nothing


def run(cases: Sequence[int], seed: int, keep: Path | None = None) -> Iterator[Found]:
    """Outcomes of each case by name.

    done: all frames. named: stopped with a reason. judged: a promise was broken. hang, crash: ended
    by a bound or a signal. steps, steps_over_tolerance, iterations: sums. unsolved: cases with a
    step that is more than 1 % of the length from its solution.
    """
    run_case(draw_case(0, 14))  # kernels are loaded once, for all
    with tempfile.TemporaryDirectory() as name:
        log = Path(name) / "log"
        for number in cases:
            result = nothing()
            end = child(log, lambda file, number=number: _write(file, seed, number))
            text = log.read_text()
            log.unlink()
            if os.WIFSIGNALED(end) or end:
                outcome = ended_by(end)[0] if os.WIFSIGNALED(end) else "broken"
                result.outcomes[outcome] += 1
                result.failures.append(Failure(number, text))
            else:
                found = json.loads(text)
                result.outcomes.update(found["counts"])
                if found["violations"]:
                    result.failures.append(Failure(number, ", ".join(found["violations"])))
            result.through.append(number)
            yield result


def _write(file: int, seed: int, number: int) -> None:
    """Run a case and write what it adds up to."""
    outcome = run_case(draw_case(1_000_000 * seed + number))
    end = "judged" if outcome.violations else "named" if outcome.status else "done"
    counts = {
        end: 1,
        "steps": outcome.steps,
        "steps_over_tolerance": outcome.forced,
        "iterations": outcome.iterations,
        "unsolved": int(outcome.unsolved > COARSE_ERROR_RATIO),
    }
    os.write(file, json.dumps({"counts": counts, "violations": outcome.violations}).encode())
