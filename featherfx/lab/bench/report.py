"""The page and the files of a benchmark run, written when everything has been measured."""

from __future__ import annotations

import json
import os
import platform
from collections.abc import Sequence
from datetime import UTC, datetime
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from featherfx.lab.bench.tables import (
    Row,
    Table,
    as_csv,
    as_markdown,
    can_plot,
    pareto,
    work_precision_plot,
)

LIBRARIES = ("featherfx", "numpy", "scipy", "numba")
COST, ERROR = "ms a simulated second", "error"


def machine() -> dict[str, Any]:
    """Date, machine and versions of this run."""
    return {
        "date": datetime.now(UTC).strftime("%Y-%m-%d"),
        "processor": _processor(),
        "cores": os.cpu_count(),
        "system": f"{platform.system()} {platform.machine()}",
        "load": round(os.getloadavg()[0], 2) if hasattr(os, "getloadavg") else None,
        "python": platform.python_version(),
        **{name: _version(name) for name in LIBRARIES},
    }


def _version(name: str) -> str:
    try:
        return version(name)
    except PackageNotFoundError:
        return "not installed"


def _processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        return platform.processor() or "unknown"
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.processor() or "unknown"


def front_of(tables: Sequence[Table]) -> Table | None:
    """The settings that no other beats in time and error."""
    found = [table for table in tables if table.name == "front"]
    if not found:
        return None
    rows = pareto(found[0].rows, COST, ERROR)
    note = "The settings of the table of run time against error that no other beats in both."
    return Table("pareto", "Best settings", note, rows)


def page(tables: Sequence[Table], stress: dict[str, Any] | None) -> str:
    """The run as Markdown. stress: the summary of stress.py, where it was run."""
    facts = ", ".join(f"{name} {value}" for name, value in machine().items() if name != "date")
    parts = [f"# Benchmark of {machine()['date']}\n\nMachine and versions: {facts}.\n"]
    front = front_of(tables)
    for table in tables:
        if table.name == "front" and front is not None:
            # the whole list is in the CSV file; the page shows what a user may want to choose
            parts.append(as_markdown(Table("front", table.title, table.note, front.rows)))
        else:
            parts.append(as_markdown(table))
    if stress is not None:
        parts.append(stress_page(stress))
    return "\n".join(parts)


def stress_page(stress: dict[str, Any]) -> str:
    """Counts and worst cases as Markdown."""
    counts: Row = {name: value for name, value in stress.items() if name != "worst"}
    listed = [{"what": name.replace("_", " "), "value": value} for name, value in counts.items()]
    worst = [
        {
            "seed": each["seed"],
            "verdict": each["verdict"],
            "violations": ", ".join(each["violations"]) or "none",
            "iterations": each["iterations"],
            **{name: each["case"][name] for name in ("rows", "length", "pose", "root")},
        }
        for each in stress["worst"]
    ]
    note = (
        "Random feathers, materials, poses, roots and winds. ok: one step a frame; stopped: the"
        " solver gave up with a reason, its state that of the last good step; violations: anything"
        " not finite, a changed input, energy that grew without work."
    )
    return (
        as_markdown(Table("stress", "Stability", note, listed))
        + "\n"
        + as_markdown(Table("worst", "Worst cases", "Violations first, then the dearest.", worst))
    )


def write(folder: Path, tables: Sequence[Table], stress: dict[str, Any] | None) -> list[Path]:
    """Write the page, CSV files, JSON and plots to a folder; returns the files."""
    files: dict[str, bytes] = {"benchmark.md": page(tables, stress).encode()}
    for table in tables:
        files[f"{table.name}.csv"] = as_csv(table).encode()
        if table.name == "front" and can_plot():
            usable = [row for row in table.rows if row[ERROR] < float("inf")]
            for group in ("rows", "coefficients", "radius", "steps per s"):
                name = f"front_{group.replace(' ', '_')}.png"
                files[name] = work_precision_plot(usable, group, COST, ERROR)
    record = {
        "machine": machine(),
        "tables": {table.name: list(table.rows) for table in tables},
        "stress": stress,
    }
    files["benchmark.json"] = (json.dumps(record, indent=1) + "\n").encode()
    folder.mkdir(parents=True, exist_ok=True)
    for name, content in files.items():
        temporary = folder / f".{name}.part"
        temporary.write_bytes(content)
        os.replace(temporary, folder / name)
    return [folder / name for name in files]
