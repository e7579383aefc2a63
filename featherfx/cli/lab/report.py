"""`featherfx lab report`."""

from __future__ import annotations

import json
import os
from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import click

from featherfx._version import __version__
from featherfx.cli.options import WholeNumber, json_option, output_option
from featherfx.cli.program import Command
from featherfx.errors import InputError, Problem
from featherfx.lab.studies import report as pages
from featherfx.lab.studies.report import Entry, run_all
from featherfx.lab.studies.study import Study, studies


@click.command(
    cls=Command,
    epilog="""
    featherfx lab report -o validation
    featherfx lab report -o validation --only elastica --only ribbon_hanging
    featherfx lab report -o validation --markdown docs/validation.md
    featherfx lab report -o validation --only elastica --markdown docs/validation.md
    featherfx lab report -o validation --against docs/validation/validation.json
    featherfx lab report --only elastica --json
    """,
)
@output_option(
    "Folder for validation.html, its pictures, and all numbers as CSV and JSON.",
    required=False,
    file_okay=False,
)
@click.option("--only", multiple=True, metavar="NAME", help="A study, can be given several times.")
@click.option(
    "--markdown",
    type=click.Path(path_type=Path, dir_okay=False),
    metavar="FILE",
    help="The page as Markdown too, figures and numbers in a folder of its name beside it;"
    " studies that are not run stay as they are there.",
)
@click.option(
    "--against",
    type=click.Path(path_type=Path, dir_okay=False, exists=True),
    metavar="FILE",
    help="Numbers of an earlier report (JSON): exit with 1 if one has moved by more than a tenth of"
    " its tolerance.",
)
@json_option("All numbers as one JSON object.")
@click.option(
    "--jobs",
    type=WholeNumber(min=1),
    help="Studies run at a time; the numbers do not depend on it.  [default: all cores]",
)
def report(
    output: Path | None,
    only: tuple[str, ...],
    markdown: Path | None,
    against: Path | None,
    as_json: bool,
    jobs: int | None,
) -> None:
    """Run the studies and hold their numbers against published ones and other solutions.

    Figures need matplotlib (extra "plots"); without it there are tables. Exit code 0 also where
    numbers differ: the page says so.
    """
    if output is None and not as_json:
        raise click.UsageError("give --output FOLDER, --json or both")
    chosen = studies(only)
    before = read_record(against, chosen) if against is not None else None

    def tell(entry: Entry, done: int, total: int) -> None:
        text = f"{done} of {total}: {entry.study.name}, {entry.result.verdict}"
        click.echo(f"{text}, {pages.taken(entry.result)}", err=True)

    with ExitStack() as stack:
        folder = output or Path(stack.enter_context(TemporaryDirectory()))
        folder.mkdir(parents=True, exist_ok=True)
        entries = run_all(chosen, folder, tell, jobs or os.cpu_count() or 1)
        written = pages.write_report(folder, entries, __version__) if output is not None else []
        if markdown is not None:
            pages.write_markdown(markdown, entries, __version__)
            written.append(markdown)
    if as_json:
        click.echo(json.dumps(pages.record(entries, __version__), indent=1))
    else:
        for file in written:
            click.echo(file)
        for entry in entries:
            click.echo(f"{entry.study.name.ljust(20)} {entry.result.verdict}")
    if before is not None and (moved := pages.moved(entries, before)):
        raise InputError(*(Problem(str(against), "", each) for each in moved))


def read_record(file: Path, chosen: Sequence[Study]) -> dict[str, Any]:
    """Numbers of an earlier report. Raises InputError for what is none or lacks a study."""
    try:
        found: dict[str, Any] = json.loads(file.read_bytes())
        lacking = [each.name for each in chosen if each.name not in found["studies"]]
    except (ValueError, KeyError, TypeError) as error:
        raise InputError(Problem(str(file), "", "is not the JSON of a report")) from error
    if lacking:
        raise InputError(*(Problem(str(file), name, "study is not in it") for name in lacking))
    return found
