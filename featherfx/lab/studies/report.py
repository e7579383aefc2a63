"""The page of all studies: our numbers beside the published ones, with the verdict of each."""

from __future__ import annotations

import base64
import csv
import html
import io
import json
import math
import shutil
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from featherfx.files.whole import write_text
from featherfx.lab.bench.report import can_plot, facts_of, machine
from featherfx.lab.studies.runs import Entry
from featherfx.lab.studies.study import Row, StudyResult

COLUMNS = ("quantity", "ours", "unit", "published", "tolerance", "verdict", "note")
COMMAND = "featherfx lab report"
INTRODUCTION = (
    f"This page is what `{COMMAND}` writes; no number on it is typed in. Every study computes its"
    " numbers anew and holds them against published values or against solutions by other means;"
    " the note says which, and, where the two differ, why. SI units."
)
NO_PLOTS = "There are no figures: matplotlib (the optional extra `plots`) is not installed."
STYLE = """
body { font: 15px/1.5 sans-serif; max-width: 70em; margin: 2em auto; padding: 0 1em; }
table { border-collapse: collapse; } td, th { padding: .2em .6em; border-bottom: 1px solid #ddd; }
td.number { text-align: right; font-variant-numeric: tabular-nums; }
.agrees { color: #060; } .differs { color: #a00; font-weight: bold; }
img { max-width: 100%; } figure { margin: 1em 0; } figcaption { color: #444; }
"""


def shown(value: float | None) -> str:
    """Four digits; nothing for no value."""
    return "" if value is None else f"{value:.4g}"


def allowance(row: Row) -> str:
    """How far a row's number may be off, in words."""
    if row.comparison == "relative":
        return f"{100.0 * (row.tolerance or 0.0):.3g} %"
    if row.comparison == "absolute":
        return shown(row.tolerance)
    return "" if row.comparison == "none" else row.comparison


def cells(row: Row) -> list[str]:
    """A row as texts in the order of COLUMNS."""
    numbers = [shown(row.ours), row.unit, shown(row.published), allowance(row)]
    return [row.quantity, *numbers, row.verdict, row.note]


def facts(entries: Sequence[Entry], version: str) -> list[str]:
    """Date, machine and the sum of the verdicts, as sentences."""
    verdicts = [row.verdict for entry in entries for row in entry.result.rows]
    seconds = sum(s for e in entries if math.isfinite(s := e.result.processor_seconds))
    date, listed = facts_of(machine(version))
    return [
        f"Run on {date}; the studies took {seconds:.0f} s of processor time, kernels"
        f" compiled before. Machine and versions: {listed}.",
        f"Of {len(verdicts)} numbers, {verdicts.count('agrees')} agree,"
        f" {verdicts.count('differs')} differ by more than their tolerance and"
        f" {verdicts.count('no comparison')} have nothing to be compared with.",
        *([] if can_plot() else [NO_PLOTS]),
    ]


def taken(result: StudyResult) -> str:
    """How long a study took, in words."""
    return f"{result.seconds:.1f} s, {result.processor_seconds:.1f} s of processor time"


def markdown(entries: Sequence[Entry], version: str, folder: str = ".") -> str:
    """The page as Markdown; folder: of the figures, as the page refers to it."""
    parts = ["# Validation", INTRODUCTION, *facts(entries, version)]
    for study, result in ((entry.study, entry.result) for entry in entries):
        parts.append(f"## {study.title}")
        parts.append(
            f"`{study.name}`, after {study.reproduces}. {result.verdict.capitalize()};"
            f" {taken(result)}."
        )
        lines = ["| " + " | ".join(COLUMNS) + " |", "|---|---:|---|---:|---:|---|---|"]
        lines += [
            "| " + " | ".join(cell.replace("|", "\\|") for cell in cells(row)) + " |"
            for row in result.rows
        ]
        parts.append("\n".join(lines))
        for figure in result.figures:
            parts += [f"![]({folder}/{figure.file.name})", f"*{figure.caption}*"]
    return "\n\n".join(parts) + "\n"


def page(entries: Sequence[Entry], version: str) -> str:
    """The page as one HTML file with its figures inside."""
    parts = [f"<p>{_text(INTRODUCTION)}</p>"]
    parts += [f"<p>{_text(each)}</p>" for each in facts(entries, version)]
    parts.append("<ul>")
    for study, result in ((entry.study, entry.result) for entry in entries):
        link = f'<a href="#{study.name}">{_text(study.title)}</a>'
        parts.append(f'<li>{link}: <span class="{result.verdict}">{result.verdict}</span></li>')
    parts.append("</ul>")
    for entry in entries:
        parts += _section(entry)
    body = "\n".join(parts)
    return (
        '<!doctype html>\n<html lang="en"><head><meta charset="utf-8">'
        f"<title>featherfx: validation</title><style>{STYLE}</style></head>\n"
        f"<body><h1>Validation</h1>\n{body}\n</body></html>\n"
    )


def _section(entry: Entry) -> list[str]:
    study, result = entry.study, entry.result
    head = "".join(f"<th>{_text(name)}</th>" for name in COLUMNS)
    lines = [
        f'<h2 id="{study.name}">{_text(study.title)}</h2>',
        f"<p><code>{study.name}</code>, after {_text(study.reproduces)}; {taken(result)}.</p>",
        f"<table><tr>{head}</tr>",
    ]
    for row in result.rows:
        texts = [_text(cell) for cell in cells(row)]
        kinds = ("", "number", "", "number", "number", row.verdict.split()[0], "")
        pairs = zip(texts, kinds, strict=True)
        columns = "".join(f'<td class="{kind}">{text}</td>' for text, kind in pairs)
        lines.append(f"<tr>{columns}</tr>")
    lines.append("</table>")
    for figure in result.figures:
        data = base64.b64encode(figure.file.read_bytes()).decode("ascii")
        caption = _text(figure.caption)
        lines.append(
            f'<figure><img alt="{caption}" src="data:image/png;base64,{data}">'
            f"<figcaption>{caption}</figcaption></figure>"
        )
    return lines


def _text(text: str) -> str:
    return html.escape(text, quote=True)


def record(entries: Sequence[Entry], version: str) -> dict[str, Any]:
    """All numbers with all digits, for JSON; what is not finite is null."""
    return {
        "machine": machine(version),
        "studies": {
            entry.study.name: {
                "title": entry.study.title,
                "reproduces": entry.study.reproduces,
                "verdict": entry.result.verdict,
                "seconds": _finite(entry.result.seconds),
                "processor_seconds": _finite(entry.result.processor_seconds),
                "rows": [_row(row) for row in entry.result.rows],
                "figures": [
                    {"file": figure.file.name, "caption": figure.caption}
                    for figure in entry.result.figures
                ],
            }
            for entry in entries
        },
    }


def _row(row: Row) -> dict[str, Any]:
    numbers = {"ours": _finite(row.ours), "published": _finite(row.published)}
    return asdict(row) | numbers | {"verdict": row.verdict}


def _finite(value: float | None) -> float | None:
    return value if value is not None and math.isfinite(value) else None


def as_csv(entries: Sequence[Entry]) -> str:
    """All rows of all studies, with all digits."""
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(["study", "quantity", "ours", "unit", "published", "tolerance", "comparison"])
    for entry in entries:
        for row in entry.result.rows:
            numbers = [row.ours, row.unit, row.published, row.tolerance, row.comparison]
            writer.writerow([entry.study.name, row.quantity, *numbers])
    return stream.getvalue()


def write_report(folder: Path, entries: Sequence[Entry], version: str) -> list[Path]:
    """Write validation.html, .json and .csv into the folder; returns the files."""
    files = {
        "validation.html": page(entries, version),
        "validation.json": json.dumps(record(entries, version), indent=1) + "\n",
        "validation.csv": as_csv(entries),
    }
    folder.mkdir(parents=True, exist_ok=True)
    for name, content in files.items():
        write_text(folder / name, content)
    return [folder / name for name in files]


def write_markdown(file: Path, entries: Sequence[Entry], version: str) -> None:
    """Write the page as Markdown, its figures in a folder of the same name beside it."""
    folder = file.with_suffix("")
    for entry in entries:
        for figure in entry.result.figures:
            folder.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(figure.file, folder / figure.file.name)
    file.parent.mkdir(parents=True, exist_ok=True)
    write_text(file, markdown(entries, version, folder.name))
