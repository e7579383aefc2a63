"""`featherfx sample`: a shipped sample, to bake and change."""

from __future__ import annotations

from pathlib import Path

import click

from featherfx.baking.samples import copy_sample, sample_names
from featherfx.cli.program import Command


@click.command(
    cls=Command,
    short_help="Copy a sample, a groom and a shot to start from.",
    epilog="""
    featherfx sample swan_wing
    featherfx sample pigeon -o birds/mine
    """,
)
@click.argument("name", type=click.Choice(sample_names()))
@click.option(
    "-o",
    "--output",
    type=click.Path(path_type=Path),
    metavar="DIR",
    help="New or empty folder for its files.  [default: NAME]",
)
def sample(name: str, output: Path | None) -> None:
    """Copy the files of the sample NAME and print where they are.

    The copy can be baked as it is: featherfx bake DIR/shot.toml.
    """
    for file in copy_sample(name, output or Path(name)):
        click.echo(str(file))
