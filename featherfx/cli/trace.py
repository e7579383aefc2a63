"""`featherfx trace`: a feather preset from a picture."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from featherfx.cli.options import output_option, overwrite_option, pairs, readable_path
from featherfx.cli.program import Command
from featherfx.errors import InputError, Problem


@click.command(
    cls=Command,
    short_help="Make a feather preset of a picture.",
    epilog="""
    featherfx trace gull_p9.jpg -o presets/feather/gull_p9.toml --length 0.343
    featherfx trace scan.png -o presets/feather/scan.toml --overlay scan_traced.png
    featherfx trace mask.png -o presets/feather/mask.toml --shaft '40,900 55,500 60,30'
    """,
)
@click.argument("photo", type=readable_path())
@output_option("Preset to write, .toml.")
@click.option(
    "--overlay", type=click.Path(path_type=Path), help="Picture with the feather over it."
)
@click.option(
    "--base",
    default="primary",
    show_default=True,
    help="Feather preset for what a picture cannot tell.",
)
@click.option("--length", type=click.FloatRange(1e-3, 10), help="m.  [default: the base's]")
@click.option(
    "--threshold",
    type=click.FloatRange(0, 1),
    help="Distance in colour from the border at which the feather begins.  [default: found]",
)
@click.option("--turned", is_flag=True, help="The thicker end is the base.")
@click.option(
    "--shaft",
    type=pairs("COLUMN,ROW ...", ",", None, "pixels", "'40,900 60,30'"),
    help="Pixels on the shaft, base to tip.  [default: found]",
)
@click.option(
    "--leading",
    type=click.Choice(["left", "right"]),
    help="Side of the leading vane, seen from base to tip.  [default: the narrower]",
)
@overwrite_option()
def trace(photo: Path, output: Path, overlay: Path | None, overwrite: bool, **options: Any) -> None:
    """Make a feather preset of PHOTO, a picture of one feather that lies flat on a plain ground.

    The silhouette gives the outlines, the shaft where it shows its course, and barbs that show
    their angles.
    """
    try:
        from featherfx.trace import trace as work
    except ImportError as error:
        message = 'needs Pillow; pip install "featherfx[preview]"'
        raise InputError(Problem("trace", "", message)) from error
    options["shaft"] = options["shaft"] or ()
    traced, picture = work.trace(photo, work.TraceOptions(**options))
    work.write_traced(traced, picture, output, overlay, overwrite)
    click.echo(
        f"{output}: within {traced.deviation:.2g} % of the length of the silhouette; barbs seen at"
        f" {traced.seen[0]} places of the leading and {traced.seen[1]} of the trailing vane",
        err=True,
    )
