"""The page of all studies: our numbers beside what they are held against, with the verdicts.

Run studies, in several processes if wished; kernels are compiled before the times are taken.
"""

from __future__ import annotations

import base64
import csv
import html
import io
import json
import math
import multiprocessing
import os
import shutil
from collections.abc import Callable, Sequence
from concurrent.futures import Future, ProcessPoolExecutor, as_completed
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from featherfx.errors import SimulationError
from featherfx.files.atomic_write import write_text
from featherfx.lab.bench.report import can_plot, facts_of, machine
from featherfx.lab.full_feather import FullPull, pull_feather
from featherfx.lab.ribbons.rod import ReleaseTest, Rod, natural_frequencies, release
from featherfx.lab.studies.study import (
    STUDIES,
    Comparisons,
    Figure,
    Kind,
    Row,
    Source,
    Study,
    StudyResult,
    ourselves,
    run_study,
)

# libraries of linear algebra that would start a thread for each core in each process
_THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")


@dataclass(frozen=True)
class Entry:
    """A study and what it found."""

    study: Study
    result: StudyResult


Progress = Callable[[Entry, int, int], None]


def run_all(
    chosen: Sequence[Study],
    folder: Path,
    progress: Progress | None = None,
    jobs: int = 1,
    compile_first: Sequence[Callable[[], None]] | None = None,
) -> list[Entry]:
    """Run studies, pictures into the folder; entries in the order given, whatever ends first.

    A study that the solver cannot finish is on the page as one that differs, with its reason.
    progress: told the entry that is done, how many are, and of how many. jobs: processes; with one
    all runs in this process. compile_first: what compiles the kernels; _FAMILIES if not given.
    """
    first = _FAMILIES if compile_first is None else compile_first
    if jobs > 1 and len(chosen) > 1:
        return _in_processes(chosen, folder, progress, min(jobs, len(chosen)), first)
    for family in first:
        family()
    entries = []
    for study in chosen:
        entries.append(_run(study, folder))
        if progress is not None:
            progress(entries[-1], len(entries), len(chosen))
    return entries


def _in_processes(
    chosen: Sequence[Study],
    folder: Path,
    progress: Progress | None,
    jobs: int,
    compile_first: Sequence[Callable[[], None]],
) -> list[Entry]:
    # a fresh process, not a fork: threads of numba do not survive one
    context = multiprocessing.get_context("spawn")
    before = {name: os.environ.get(name) for name in _THREADS}
    os.environ.update({name: value or "1" for name, value in before.items()})
    try:
        with ProcessPoolExecutor(jobs, context) as pool:
            for family in [pool.submit(each) for each in compile_first]:
                family.result()
            waiting: dict[Future[Entry], int] = {
                pool.submit(_run, study, folder): k for k, study in enumerate(chosen)
            }
            done: dict[int, Entry] = {}
            for future in as_completed(waiting):
                entry = done[waiting[future]] = future.result()
                if progress is not None:
                    progress(entry, len(done), len(chosen))
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
    return [done[k] for k in range(len(chosen))]


def compile_rods() -> None:
    """Compile the barb-curvature solver, which rods share."""
    rod = Rod(1.0, 1.0, segments=8)
    natural_frequencies(rod, 1)
    release(ReleaseTest(rod, 0.01, 1e-3, samples=1))


def compile_nodal() -> None:
    """Compile the nodal solver, with bending of barbs and with hinges."""
    pull = FullPull("tip", 1e-3, parts=1, rows=9, columns=2, nodal=True)
    pull_feather(pull)
    pull_feather(replace(pull, material="isotropic"))


_FAMILIES: tuple[Callable[[], None], ...] = (compile_rods, compile_nodal)


def _run(study: Study, folder: Path) -> Entry:
    try:
        return Entry(study, run_study(study, folder))
    except SimulationError as error:
        rows = Comparisons()
        rows.bound("finished", 0.0, ourselves("the solver"), at_least=1.0, note=str(error))
        return Entry(study, StudyResult(rows))


_COLUMNS = (
    "quantity",
    "ours",
    "unit",
    "reference",
    "tolerance",
    "kind",
    "verdict",
    "held against",
    "note",
)
# how far a number may be from the one on the page: of a row's tolerance; of itself where it has
# none; and what is rounding
_STILL, _STILL_ALONE, _ROUNDING = 0.1, 1e-3, 1e-9
RECORD_FILE = "validation.json"
_COMMAND = "featherfx lab report"
_INTRODUCTION = (
    f"This page is what `{_COMMAND}` writes; no number on it is typed in. Every study computes its"
    " numbers anew. The kind of a row says what they are held against: *published*, a number that"
    " is printed in the text, or what it says in words; *independent*, a solution by another method"
    " or of another model, which is named;"
    " *self*, our own input, finer mesh or fit, or what is true by construction, which confirms"
    " only that the program agrees with itself. Pages are those of the texts' own tables of"
    " contents: a range, where they tell only where a section begins and ends. The copies that we"
    " have of Jouve et al. 2024 (10 pages) and Charrondiere et al. 2019 (7 pages) carry none. SI"
    " units."
)
_MISSED = "differs", "fails"
_DIFFERENCES = "## What differs\n\nRows that miss their tolerance, and statements that fail."
NO_PLOTS = "There are no figures: matplotlib (the optional extra `plots`) is not installed."
_STYLE = """
body { font: 15px/1.5 sans-serif; max-width: 70em; margin: 2em auto; padding: 0 1em; }
table { border-collapse: collapse; } td, th { padding: .2em .6em; border-bottom: 1px solid #ddd; }
td.number { text-align: right; font-variant-numeric: tabular-nums; }
.agrees, .holds { color: #060; } .differs, .fails { color: #a00; font-weight: bold; }
img { max-width: 100%; } figure { margin: 1em 0; } figcaption { color: #444; }
"""


def shown(value: float | None) -> str:
    """Four digits; nothing for no value."""
    return "" if value is None else f"{value:.4g}"


def allowance(row: Row) -> str:
    """Describe the tolerance of a row's number."""
    if row.comparison == "relative":
        return f"{100.0 * (row.tolerance or 0.0):.3g} %"
    if row.comparison == "absolute":
        return shown(row.tolerance)
    return "" if row.comparison == "none" else row.comparison


def cells(row: Row) -> list[str]:
    """A row as texts in the order of _COLUMNS."""
    numbers = [shown(row.ours), row.unit, shown(row.reference), allowance(row)]
    kind, text = (row.source.kind, row.source.text) if row.source is not None else ("", "")
    return [row.quantity, *numbers, kind, row.verdict, text, row.note]


def facts(entries: Sequence[Entry], version: str) -> list[str]:
    """Date, machine and the sum of the verdicts, as sentences."""
    rows = [row for entry in entries for row in entry.result.rows]
    seconds = sum(s for e in entries if math.isfinite(s := e.result.processor_seconds))
    date, listed = facts_of(machine(version))
    held, failed = (sum(row.verdict == each for row in rows) for each in ("holds", "fails"))
    return [
        f"Last written on {date}; the studies took {seconds:.0f} s of processor time, kernels"
        f" compiled before. Machine and versions: {listed}.",
        f"Of {len(rows)} numbers, {_sum_of(rows, 'published')} with published ones and"
        f" {_sum_of(rows, 'independent')} with independent solutions; {_sum_of(rows, 'self')} with"
        f" ourselves, which does not count; {sum(row.source is None for row in rows)} have nothing"
        f" to be compared with. A bound that a text states in words is no agreement: {held} such"
        f" statements hold of ours and {failed} fail.",
        *([] if can_plot() else [NO_PLOTS]),
    ]


def _sum_of(rows: Sequence[Row], kind: Kind) -> str:
    """Describe how many rows of a kind agree and differ."""
    verdicts = [row.verdict for row in rows if row.source is not None and row.source.kind == kind]
    return f"{verdicts.count('agrees')} agree and {verdicts.count('differs')} differ"


def taken(result: StudyResult) -> str:
    """Describe how long a study took."""
    return f"{result.seconds:.1f} s, {result.processor_seconds:.1f} s of processor time"


def markdown(
    entries: Sequence[Entry], version: str, folder: str = ".", title: str = "Validation"
) -> str:
    """The page as Markdown, rows that differ last; folder: of the figures, relative to the page."""
    parts = [f"# {title}", _INTRODUCTION, *facts(entries, version)]
    for study, result in ((entry.study, entry.result) for entry in entries):
        parts.append(f"## {study.title}")
        parts.append(
            f"`{study.name}`, after {study.reproduces}. {result.verdict.capitalize()};"
            f" {taken(result)}."
        )
        parts += _tables([row for row in result.rows if row.verdict not in _MISSED])
        for figure in result.figures:
            parts += [f"![]({folder}/{figure.file.name})", f"*{figure.caption}*"]
    different = [row for entry in entries for row in entry.result.rows if row.verdict in _MISSED]
    parts += [_DIFFERENCES, *_tables(different)] if different else []
    return "\n\n".join(parts) + "\n"


def _tables(rows: Sequence[Row]) -> list[str]:
    """The rows as a Markdown table; none without rows."""
    lines = ["| " + " | ".join(_COLUMNS) + " |", "|---|---:|---|---:|---:|---|---|---|---|"]
    lines += [
        "| " + " | ".join(cell.replace("|", "\\|") for cell in cells(row)) + " |" for row in rows
    ]
    return ["\n".join(lines)] if rows else []


def page(entries: Sequence[Entry], version: str) -> str:
    """The page as one HTML file with its figures inside."""
    parts = [f"<p>{_text(_INTRODUCTION)}</p>"]
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
        f"<title>featherfx: validation</title><style>{_STYLE}</style></head>\n"
        f"<body><h1>Validation</h1>\n{body}\n</body></html>\n"
    )


def _section(entry: Entry) -> list[str]:
    study, result = entry.study, entry.result
    head = "".join(f"<th>{_text(name)}</th>" for name in _COLUMNS)
    lines = [
        f'<h2 id="{study.name}">{_text(study.title)}</h2>',
        f"<p><code>{study.name}</code>, after {_text(study.reproduces)}; {taken(result)}.</p>",
        f"<table><tr>{head}</tr>",
    ]
    for row in result.rows:
        texts = [_text(cell) for cell in cells(row)]
        styles = ("", "number", "", "number", "number", "", row.verdict.split()[0], "", "")
        pairs = zip(texts, styles, strict=True)
        columns = "".join(f'<td class="{style}">{text}</td>' for text, style in pairs)
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
    return {
        "quantity": row.quantity,
        "value": _finite(row.ours),
        "unit": row.unit,
        "reference": _finite(row.reference),
        "tolerance": row.tolerance,
        "comparison": row.comparison,
        "kind": row.source.kind if row.source is not None else None,
        "verdict": row.verdict,
        "source": row.source.text if row.source is not None else "",
        "note": row.note,
    }


def moved(entries: Sequence[Entry], before: dict[str, Any]) -> list[str]:
    """Numbers that are no longer those of an earlier record, in words.

    before: of `record`. One may move by a tenth of its tolerance, or of what is left to its bound;
    one that nothing is compared with, by a thousandth, and times as they like. Raises KeyError of a
    study that is not in it.
    """
    found = []
    for entry in entries:
        rows = before["studies"][entry.study.name]["rows"]
        names = [row.quantity for row in entry.result.rows]
        if names != [row["quantity"] for row in rows]:
            found.append(f"{entry.study.name}: other numbers than before")
            continue
        for row, old in zip(entry.result.rows, rows, strict=True):
            text = f"{entry.study.name}, {row.quantity}"
            if _has_moved(row, math.nan if old["value"] is None else old["value"]):
                found.append(f"{text}: {old['value']} -> {row.ours}")
            if (old["kind"], old["source"]) != (_row(row)["kind"], _row(row)["source"]):
                found.append(f"{text}: held against something else")
    return found


def _has_moved(row: Row, before: float) -> bool:
    if row.source is not None:
        return abs(row.ours - before) > _STILL * _room(row)
    if row.is_time or (math.isnan(row.ours) and math.isnan(before)):
        return False
    return not math.isclose(row.ours, before, rel_tol=_STILL_ALONE, abs_tol=_ROUNDING)


def _room(row: Row) -> float:
    """Return the tolerance of a number, in its unit."""
    assert row.reference is not None
    if row.comparison in ("at most", "at least"):
        return abs(row.ours - row.reference)
    fraction = abs(row.reference) if row.comparison == "relative" else 1.0
    return (row.tolerance or 0.0) * fraction


def kept(entries: Sequence[Entry], before: dict[str, Any], folder: Path) -> list[Entry]:
    """Entries, and those that an earlier record (of `record`) has and they have not, in the order
    of the list. folder: of the earlier figures."""
    new = {entry.study.name: entry for entry in entries}
    old = before["studies"]
    return [
        new[study.name] if study.name in new else Entry(study, _result(old[study.name], folder))
        for study in STUDIES
        if study.name in new or study.name in old
    ]


def _result(old: dict[str, Any], folder: Path) -> StudyResult:
    def number(value: float | None) -> float:
        return math.nan if value is None else float(value)

    rows = [
        Row(
            quantity=row["quantity"],
            ours=number(row["value"]),
            unit=row["unit"],
            reference=row["reference"],
            tolerance=row["tolerance"],
            comparison=row["comparison"],
            source=Source(row["kind"], row["source"]) if row["kind"] else None,
            note=row["note"],
        )
        for row in old["rows"]
    ]
    figures = [Figure(folder / each["file"], each["caption"]) for each in old["figures"]]
    times = number(old["seconds"]), number(old["processor_seconds"])
    return StudyResult(rows, figures, *times)


def _finite(value: float | None) -> float | None:
    return value if value is not None and math.isfinite(value) else None


def as_csv(entries: Sequence[Entry]) -> str:
    """All rows of all studies, with all digits."""
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    names = ["quantity", "value", "unit", "reference", "tolerance", "comparison", "kind", "source"]
    writer.writerow(["study", *names])
    for entry in entries:
        for row in map(_row, entry.result.rows):
            writer.writerow([entry.study.name, *(row[name] for name in names)])
    return stream.getvalue()


def write_report(folder: Path, entries: Sequence[Entry], version: str) -> list[Path]:
    """Write validation.html, .json and .csv into the folder; returns the files."""
    files = {
        "validation.html": page(entries, version),
        RECORD_FILE: json.dumps(record(entries, version), indent=1) + "\n",
        "validation.csv": as_csv(entries),
    }
    folder.mkdir(parents=True, exist_ok=True)
    for name, content in files.items():
        write_text(folder / name, content)
    return [folder / name for name in files]


def write_markdown(file: Path, entries: Sequence[Entry], version: str) -> None:
    """Write the page of feathers as Markdown, and beside it that of networks and skin.

    Figures and numbers (JSON) of both go to a folder of the same name. Studies that were not run
    stay as they are there.
    """
    folder = file.with_suffix("")
    folder.mkdir(parents=True, exist_ok=True)
    if (before := folder / RECORD_FILE).exists():
        entries = kept(entries, json.loads(before.read_bytes()), folder)
    write_text(folder / RECORD_FILE, json.dumps(record(entries, version), indent=1) + "\n")
    for entry in entries:
        for figure in entry.result.figures:
            if figure.file.parent != folder:
                shutil.copyfile(figure.file, folder / figure.file.name)
    file.parent.mkdir(parents=True, exist_ok=True)
    networks = [entry for entry in entries if entry.study.is_of_networks]
    feathers = [entry for entry in entries if not entry.study.is_of_networks]
    other, title = file.with_stem(f"{file.stem}_networks"), "Validation of networks and skin"
    write_text(file, markdown(feathers, version, folder.name, "Validation of feathers"))
    write_text(other, markdown(networks, version, folder.name, title))
