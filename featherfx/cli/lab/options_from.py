"""Commands made of dataclasses whose fields are declared once (lab/declare.py)."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import MISSING, Field, fields
from pathlib import Path
from tempfile import TemporaryDirectory
from types import UnionType
from typing import Any, Literal, get_args, get_origin, get_type_hints

import click

from featherfx._version import __version__
from featherfx.cli.options import Parsed, WholeNumber, json_option, output_option
from featherfx.cli.program import Command, plain
from featherfx.errors import InputError, Problem
from featherfx.lab.declare import DEFAULTS, MEANING, OPTION, WITHOUT
from featherfx.lab.studies import report as pages
from featherfx.lab.studies.report import Entry, run_all
from featherfx.lab.studies.study import Study, studies


def show(result: Any, as_json: bool) -> None:
    """A dataclass or mapping; names beside values, lists of lists in lines below their name."""
    values = plain(result)
    if as_json:
        click.echo(json.dumps(values))
        return
    for line in _lines(values, ""):
        click.echo(line)


def _lines(values: dict[str, Any], before: str) -> Iterator[str]:
    """Tables in tables by dotted names."""
    for key, value in values.items():
        name = f"{before}{key}"
        if isinstance(value, dict):
            yield from _lines(value, f"{name}.")
        elif isinstance(value, list) and value and isinstance(value[0], dict):
            yield name
            for row in value:
                yield "  " + "  ".join(f"{k} {_text(v)}" for k, v in row.items())
        elif isinstance(value, list) and value and isinstance(value[0], list):
            yield f"{name} ({len(value)})"
            for row in value:
                yield "  " + "  ".join(f"{_text(each):>12}" for each in _flat(row))
        elif isinstance(value, list):
            yield f"{name:20} " + "  ".join(_text(each) for each in value)
        else:
            yield f"{name:20} {_text(value)}"


def _text(value: Any) -> str:
    if value is None:
        return "-"
    return f"{value:.6g}" if isinstance(value, float) else str(value)


def _flat(row: list[Any]) -> list[Any]:
    return [each for part in row for each in (_flat(part) if isinstance(part, list) else [part])]


class Experiment:
    """A command of the lab."""

    def __init__(
        self,
        test: type,
        run: Callable[..., Iterable[Any]],
        *examples: str,
        more: tuple[click.Parameter, ...] = (),
    ) -> None:
        """test: dataclass whose fields are the options and whose docstring is the help. run: called
        with one of them and the values of more parameters; gives the result first, then the files
        that it wrote. examples: arguments, of a command line each."""
        self.test, self.run, self.examples, self.more = test, run, examples, more


def _vector(text: str) -> tuple[float, float, float]:
    try:
        x, y, z = (float(each) for each in text.split(","))
    except ValueError:
        raise ValueError(f"'{text}' is not three numbers such as 0,0,-1.5") from None
    return x, y, z


def command_from(name: str, experiment: Experiment) -> Command:
    """The click command of an experiment."""

    def run(as_json: bool, **values: Any) -> None:
        found = iter(experiment.run(_made(experiment.test, values), **values))
        show(next(found), as_json)
        for file in found:
            click.echo(file, err=as_json)

    as_json = click.Option(
        ["--json", "as_json"], is_flag=True, help="One JSON object on the output, SI units."
    )
    options = _options(experiment.test)
    return Command(
        name,
        callback=run,
        params=[*options, *experiment.more, as_json],
        help=experiment.test.__doc__,
        epilog="\n".join(f"featherfx lab {name} {each}" for each in experiment.examples),
    )


def _options(
    kind: type, without: tuple[str, ...] = (), defaults: Mapping[str, Any] | None = None
) -> list[click.Option]:
    hints, found = get_type_hints(kind), []
    for each in fields(kind):
        if WITHOUT in each.metadata:
            found += _options(hints[each.name], each.metadata[WITHOUT], each.metadata[DEFAULTS])
        elif MEANING in each.metadata and each.name not in without:
            default = (defaults or {}).get(each.name, each.default)
            found.append(_option(each, hints[each.name], default))
    return found


def _option(each: Field[Any], hint: Any, default: Any) -> click.Option:
    if get_origin(hint) is UnionType:
        hint = get_args(hint)[0]
    several = get_origin(hint) is tuple and get_args(hint)[-1] is Ellipsis
    kind: Any = hint
    if several:
        kind = get_args(hint)[0]
    elif get_origin(hint) is tuple:
        kind = Parsed("X,Y,Z", _vector)
    elif get_origin(hint) is Literal:
        kind = click.Choice(get_args(hint))
    name = each.metadata[OPTION] or each.name
    return click.Option(
        [f"--{name.replace('_', '-')}", each.name],
        type=kind,
        is_flag=hint is bool or None,
        multiple=several,
        show_default=hint is not bool,
        help=each.metadata[MEANING],
        **({"required": True} if default is MISSING else {"default": default}),
    )


def _made(kind: type, values: dict[str, Any]) -> Any:
    """An instance of a dataclass from the values of its options, which are taken out."""
    hints, given = get_type_hints(kind), {}
    for each in fields(kind):
        if WITHOUT in each.metadata:
            given[each.name] = _made(hints[each.name], values)
        elif each.name in values:
            given[each.name] = values.pop(each.name)
    return kind(**given)


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
