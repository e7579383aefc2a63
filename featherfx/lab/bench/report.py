"""Tables of a benchmark run, and the page and files that are made of them."""

from __future__ import annotations

import csv
import importlib.util
import io
import json
import os
import platform
from collections.abc import Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from functools import partial
from importlib.metadata import version
from pathlib import Path
from typing import Any, BinaryIO

from featherfx.files.atomic_write import write_whole
from featherfx.limits import option


@dataclass(frozen=True)
class BenchOptions:
    """Choice and extent of the measurements."""

    quick: bool = option(False, "A smaller set of settings, in two minutes of one core.")
    peers: bool = option(
        False, 'Beside MuJoCo and Newton (extra "peers"): error against time of strips.'
    )
    contact: bool = option(False, "Ways to solve the contact forces of a stack, side by side.")
    birds: bool = option(False, "Whole birds at each quality, beside a fine reference.")
    skips: tuple[Path, ...] = option(
        (),
        "What skipping work saves and costs on a shot; once for each shot.",
        several=True,
        there=True,
        metavar="SHOT",
    )
    promise: int | None = option(
        None, "Number of random shots of which the promised error is measured.", least=1
    )
    only: str = option("*", "Of --skips: names of skips, with * and ?.")
    frames: int | None = option(None, "Of --skips: frames of each.", least=2)
    every: int = option(1, "Of --skips: every n-th feather of each shot alone.", least=1)
    as_json: bool = option(
        False, "Of --promise and --birds: what is measured, as JSON.", flag="--json"
    )
    seed: int = option(0, "First one, of --promise.", least=0)
    jobs: int | None = option(None, "Threads.  [default: all cores]", least=1)
    output: Path | None = None


_LIBRARIES = ("numpy", "scipy", "numba")
_INTRODUCTION = """\
This page is what `featherfx bench -o DIR` writes; no number
on it is typed in. The swan primary of the presets, 0.35 m long, is shaken by its root in vacuum.
Times are processor times of one thread, so that other work on the machine disturbs them little;
only the table of threads is wall time. Compare ratios, not milliseconds, between machines.
"""
_COST, _ERROR = "ms a simulated second", "error"


def machine(program: str) -> dict[str, Any]:
    """Date, machine and versions of this run. program: version of featherfx."""
    return {
        "date": datetime.now(UTC).strftime("%Y-%m-%d"),
        "processor": _processor(),
        "cores": os.cpu_count(),
        "system": f"{platform.system()} {platform.machine()}",
        "load": round(os.getloadavg()[0], 2) if hasattr(os, "getloadavg") else None,
        "python": platform.python_version(),
        "featherfx": program,
        **{name: version(name) for name in _LIBRARIES},
    }


def facts_of(found: dict[str, Any]) -> tuple[str, str]:
    """Date of a machine's record, and the rest of it in words."""
    rest = ", ".join(f"{name} {value}" for name, value in found.items() if name != "date")
    return found["date"], rest


def _processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        return platform.processor() or "unknown"
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.processor() or "unknown"


def page(tables: Sequence[ResultTable], program: str) -> str:
    """The run as Markdown. program: version."""
    date, facts = facts_of(machine(program))
    parts = [
        f"# Benchmarks\n\n{_INTRODUCTION}",
        f"Measured on {date}. Machine and versions: {facts}.\n",
    ]
    for table in tables:
        if table.name == "front":
            # the whole list is in the CSV file; the page shows what a user may want to choose
            table = replace(table, rows=pareto(table.rows, _COST, _ERROR))
        parts.append(as_markdown(table))
    return "\n".join(parts)


def write(folder: Path, tables: Sequence[ResultTable], program: str) -> list[Path]:
    """Write the page, CSV files, JSON and plots to a folder; returns the files."""
    files: dict[str, bytes] = {"benchmark.md": page(tables, program).encode()}
    for table in tables:
        files[f"{table.name}.csv"] = as_csv(table).encode()
        if table.name == "front" and can_plot():
            usable = [row for row in table.rows if row[_ERROR] < float("inf")]
            for group in ("rows", "coefficients", "radius", "steps per s"):
                name = f"front_{group.replace(' ', '_')}.png"
                files[name] = work_precision_plot(usable, group, _COST, _ERROR)
    record = {
        "machine": machine(program),
        "tables": {table.name: list(table.rows) for table in tables},
    }
    files["benchmark.json"] = (json.dumps(record, indent=1) + "\n").encode()
    return write_files(folder, files)


def write_files(folder: Path, files: dict[str, bytes]) -> list[Path]:
    """Write files by name to a folder, which is made where it is not there; returns them."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, content in files.items():
        write_whole(folder / name, partial(_put, content))
    return [folder / name for name in files]


def _put(content: bytes, file: BinaryIO) -> None:
    file.write(content)


Row = dict[str, Any]


@dataclass(frozen=True)
class ResultTable:
    """name: of the CSV file. title, note: for the page. rows: all with the same keys."""

    name: str
    title: str
    note: str
    rows: Sequence[Row]


def as_csv(table: ResultTable) -> str:
    """The table with all digits."""
    stream = io.StringIO()
    writer = csv.DictWriter(stream, list(table.rows[0]), lineterminator="\n")
    writer.writeheader()
    writer.writerows(table.rows)
    return stream.getvalue()


def shown(value: Any) -> str:
    """A value with three digits."""
    if isinstance(value, float):
        return f"{value:.3g}"
    return str(value)


def as_markdown(table: ResultTable) -> str:
    """A heading, the note and the table with three digits."""
    names = list(table.rows[0])
    lines = [f"## {table.title}", "", table.note, ""]
    lines.append("| " + " | ".join(names) + " |")
    lines.append("|" + "|".join(" ---: " for _ in names) + "|")
    lines += ["| " + " | ".join(shown(row[name]) for name in names) + " |" for row in table.rows]
    return "\n".join(lines) + "\n"


def pareto(rows: Sequence[Row], cost: str, error: str) -> list[Row]:
    """Rows that no other beats in cost and error at once, cheapest first."""
    front: list[Row] = []
    for row in sorted(rows, key=lambda each: (each[cost], each[error])):
        if not front or row[error] < front[-1][error]:
            front.append(row)
    return front


def can_plot() -> bool:
    """Return whether matplotlib (the optional extra `plots`) is installed."""
    return importlib.util.find_spec("matplotlib") is not None


def work_precision_plot(rows: Sequence[Row], group: str, cost: str, error: str) -> bytes:
    """PNG of error against cost on logarithmic axes, one colour per value of group."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(7.0, 5.0), layout="constrained")
    axes = figure.add_subplot()
    for value in dict.fromkeys(row[group] for row in rows):
        members = [row for row in rows if row[group] == value]
        axes.plot([r[cost] for r in members], [r[error] for r in members], ".", label=str(value))
    front = pareto(rows, cost, error)
    axes.plot([r[cost] for r in front], [r[error] for r in front], "k-", lw=0.8, label="front")
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.set_xlabel(cost)
    axes.set_ylabel(error)
    axes.grid(True, which="both", lw=0.3)
    axes.legend(title=group, fontsize="small")
    stream = io.BytesIO()
    figure.savefig(stream, format="png", dpi=120)
    return stream.getvalue()
