"""`featherfx doctor`, `plugins` and `completion`: this installation and other programs."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import click
from click.shell_completion import get_completion_class

from featherfx.baking.install import HOSTS, install, listed
from featherfx.cli.options import json_option, overwrite_option, progress_option
from featherfx.cli.program import Command, CommandGroup, tell
from featherfx.cli.progress import Progress, about


@click.command(
    cls=Command,
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


@click.group(
    cls=CommandGroup,
    epilog="featherfx plugins list\nfeatherfx plugins install houdini",
)
def plugins() -> None:
    """List plugins for other programs, and install them."""


@plugins.command(
    "list",
    cls=Command,
    short_help="List plugins, and which are installed.",
    epilog="featherfx plugins list --json",
)
@json_option("One JSON array.")
def list_command(as_json: bool) -> None:
    """List the programs that there is a plugin for, where it goes, and what is installed."""
    found = listed()
    if as_json:
        click.echo(json.dumps(found, indent=2))
        return
    for each in found:
        place = each["folder"] or "no folder found. Name one with --into"
        state = f"version {each['installed']}" if each["installed"] else "not installed"
        click.echo(f"{each['host']}: {state} ({place})")


@plugins.command(
    "install",
    cls=Command,
    short_help="Install the plugin of a program.",
    help=f"""Install the plugin of HOST, which calls the featherfx that installed it, and print its
    folder. It appears complete or not at all.

    Hosts: {", ".join(HOSTS)}.
    """,
    epilog="""
    featherfx plugins install houdini
    featherfx plugins install usdview --into ~/usd_plugins
    """,
)
@click.argument("host", metavar="HOST", type=click.Choice(tuple(HOSTS), case_sensitive=False))
@click.option(
    "--into",
    type=click.Path(path_type=Path),
    metavar="FOLDER",
    help="Folder that the program searches.  [default: the user's own]",
)
@overwrite_option("Replace a plugin that is installed.")
def install_command(host: str, into: Path | None, overwrite: bool) -> None:
    folder, then = install(host, into, overwrite)
    click.echo(str(folder))
    tell(then)


@click.command(
    cls=Command,
    epilog="""
    featherfx completion bash >> ~/.bashrc
    featherfx completion zsh >> ~/.zshrc
    featherfx completion fish > ~/.config/fish/completions/featherfx.fish
    """,
)
@click.argument("shell", type=click.Choice(("bash", "zsh", "fish")))
@click.pass_context
def completion(ctx: click.Context, shell: str) -> None:
    """Print a script for SHELL, to be read when it starts.

    With it, the tab key completes commands, options and names of files, samples and kinds.
    """
    kind = get_completion_class(shell)
    assert kind is not None
    program = ctx.find_root().command
    click.echo(kind(program, {}, "featherfx", "_FEATHERFX_COMPLETE").source())
