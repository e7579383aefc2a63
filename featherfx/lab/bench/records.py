"""Outcomes of random cases on disk, one JSON object a line, and what they add up to."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from statistics import fmean, quantiles
from typing import Any

from featherfx.errors import InputError, Problem
from featherfx.lab.bench.stress import ENERGY_SLACK, WORST
from featherfx.solver.status import CONVERGED, TOO_MUCH_WORK, reason_of

FILE = "stress_cases.jsonl"
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
            found[int(record["seed"])] = {"unexplained_gain": record["unexplained_gain"]} | record
        except (ValueError, KeyError, TypeError) as error:
            raise InputError(
                Problem(str(path), f"line {number}", "not a record of a case; remove the file")
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
        **{f"stopped: {reason}": count for reason, count in sorted(reasons.items())},
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
    }


def _reason(status: int) -> str:
    """Why a case stopped; cases of different sizes have different limits."""
    return "the limit of Newton iterations" if status == TOO_MUCH_WORK else reason_of(status)


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
