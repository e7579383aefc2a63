"""`featherfx check`: problems of files, by file and key."""

from __future__ import annotations

from pathlib import Path

import click

from featherfx.baking import pipeline
from featherfx.cli.options import presets_option, progress_option, readable_path
from featherfx.cli.program import Command
from featherfx.cli.progress import Progress
from featherfx.groom.read.places import located


@click.command(
    cls=Command,
    short_help="Check grooms, presets, shots and USD files.",
    epilog="""
    featherfx check samples/swan_wing/shot.toml
    featherfx check presets/feather/*.toml wing.usdc
    """,
)
@click.argument("files", metavar="FILE...", nargs=-1, required=True, type=readable_path())
@presets_option
@progress_option
@click.pass_context
def check(
    ctx: click.Context, files: tuple[Path, ...], preset_folders: tuple[Path, ...], style: str
) -> None:
    """Check grooms, presets and shots (TOML) and USD files.

    Prints one line per problem (file, key, what is wrong, allowed range) and exits with 1 if
    there is any.
    """
    with Progress("files", style):
        found = [problem for file in files for problem in pipeline.check(file, preset_folders)]
    for problem in dict.fromkeys(found):
        click.echo(located(problem))
    if found:
        ctx.exit(1)
    click.echo(f"{len(files)} checked, no problems", err=True)
