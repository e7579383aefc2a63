"""Results as rows of named values: CSV, Markdown tables and, where matplotlib is there, plots."""

from __future__ import annotations

import csv
import importlib.util
import io
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

Row = dict[str, Any]


@dataclass(frozen=True)
class Table:
    """name: of the CSV file. title, note: for the page. rows: all with the same keys."""

    name: str
    title: str
    note: str
    rows: Sequence[Row]


def as_csv(table: Table) -> str:
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


def as_markdown(table: Table) -> str:
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
    """Whether matplotlib (the optional extra `plots`) is installed."""
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
