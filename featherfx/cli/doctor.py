"""`featherfx doctor`: whether this install works, and what it is made of."""

from __future__ import annotations

import json
from collections.abc import Iterator
from typing import Any

import click

from featherfx.cli.options import json_option, progress_option
from featherfx.cli.program import Command
from featherfx.cli.progress import Progress, about


@click.command(
    cls=Command,
    short_help="Whether this install works, and what it is made of.",
    epilog="""
    featherfx doctor
    featherfx doctor --json > report.json
    """,
)
@json_option()
@click.option("--no-test", is_flag=True, help="Leave out the self-test.")
@progress_option
@click.pass_context
def doctor(ctx: click.Context, as_json: bool, no_test: bool, style: str) -> None:
    """Report versions, folders and extras, bake a sample feather, and say what is wrong.

    The self-test takes two seconds; the first time it also compiles the solver, which takes a
    minute or two. Exits with 1 if there is a problem.
    """
    # reads metadata of packages, which other commands need not
    from featherfx.baking.doctor import examine

    with Progress("checks", style):
        found = examine(not no_test)
    click.echo(json.dumps(found, indent=2) if as_json else "\n".join(_lines(found)))
    for problem in found["problems"]:
        click.echo(f"featherfx: {problem}", err=True)
    if found["problems"]:
        ctx.exit(1)


def _lines(found: dict[str, Any]) -> Iterator[str]:
    """The report for people."""
    yield f"featherfx {found['version']}, Python {found['python']}, {found['executable']}"
    yield f"{found['platform']}, {found['cores']} cores"
    if found["packages"] is None:
        yield "not installed as a package: what it needs is not looked at"
    else:
        installed = (f"{name} {version}" for name, version in found["packages"].items() if version)
        yield f"packages: {', '.join(installed)}"
        for name, extra in found["extras"].items():
            state = "installed" if extra["installed"] else f"needs {', '.join(extra['missing'])}"
            yield f"  extra {name}: {state}"
    if usd := found["usd"]:
        yield f"USD {usd['version']} in {usd['folder']}"
    cache = found["cache"]
    yield f"compiled code: {cache['folder']}, {cache['files']} files, {cache['bytes'] / 1e6:.0f} MB"
    reason = cache["shipped_code_unused"]
    yield "  machine code of the wheel: " + (f"not used ({reason})" if reason else "used")
    if cache["seconds_to_compile"] >= 1.0:
        yield f"  a first bake has yet to compile, {about(cache['seconds_to_compile'])} of one core"
    yield f"{found['presets']} presets, {len(found['samples'])} samples"
    if test := found["self_test"]:
        state = "passed" if test["ok"] else "failed"
        yield f"self-test ({test['sample']}): {state} in {test['seconds']:.1f} s"
