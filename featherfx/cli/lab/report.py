"""`featherfx lab report`."""

from __future__ import annotations

import os
from pathlib import Path

import click

from featherfx._version import __version__
from featherfx.cli.program import Command
from featherfx.lab.studies import report as pages
from featherfx.lab.studies.registry import studies
from featherfx.lab.studies.runs import Entry, run_all


@click.command(
    cls=Command,
    epilog="""
    featherfx lab report -o validation
    featherfx lab report -o validation --only elastica --only ribbon_hanging
    featherfx lab report -o validation --markdown docs/validation.md
    """,
)
@click.option(
    "-o",
    "--output",
    type=click.Path(path_type=Path, file_okay=False),
    required=True,
    help="Folder for validation.html, its pictures, and all numbers as CSV and JSON.",
)
@click.option("--only", multiple=True, metavar="NAME", help="A study, can be given several times.")
@click.option(
    "--markdown",
    type=click.Path(path_type=Path, dir_okay=False),
    metavar="FILE",
    help="The page as Markdown too, its figures in a folder of its name beside it.",
)
@click.option(
    "--jobs",
    type=click.IntRange(min=1),
    help="Studies run at a time; the numbers do not depend on it.  [default: all cores]",
)
def report(output: Path, only: tuple[str, ...], markdown: Path | None, jobs: int | None) -> None:
    """Run the studies and hold their numbers against the published ones.

    Figures need matplotlib (extra "plots"); without it there are tables. Exit code 0 also where
    numbers differ: the page says so.
    """
    chosen = studies(only)
    output.mkdir(parents=True, exist_ok=True)

    def tell(entry: Entry, done: int, total: int) -> None:
        text = f"{done} of {total}: {entry.study.name}, {entry.result.verdict}"
        click.echo(f"{text}, {pages.taken(entry.result)}", err=True)

    entries = run_all(chosen, output, tell, jobs or os.cpu_count() or 1)
    for file in pages.write_report(output, entries, __version__):
        click.echo(file)
    if markdown is not None:
        pages.write_markdown(markdown, entries, __version__)
        click.echo(markdown)
    for entry in entries:
        click.echo(f"{entry.study.name.ljust(20)} {entry.result.verdict}")
