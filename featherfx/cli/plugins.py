"""`featherfx plugins`: what stands in other programs."""

from __future__ import annotations

import json
from pathlib import Path

import click

from featherfx.baking.plugins import HOSTS, install, listed
from featherfx.cli.log import tell
from featherfx.cli.options import json_option, overwrite_option
from featherfx.cli.program import Command, CommandGroup


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
        place = each["folder"] or "no folder found; name one with --into"
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
@click.argument("host", metavar="HOST", type=click.Choice(tuple(HOSTS)))
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
