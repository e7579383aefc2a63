"""`featherfx preview`: a picture of a cache."""

from __future__ import annotations

from pathlib import Path

import click

from featherfx.cli.options import Size, readable_path
from featherfx.cli.program import Command
from featherfx.limits import MOST_SHEET


@click.command(
    cls=Command,
    short_help="Draw a USD file to PNG.",
    epilog="""
    featherfx preview swan_wing.usdc -o wing.png --frame 12
    featherfx preview swan_wing.usdc -o beat.png --sheet 8 --view front
    featherfx preview swan_wing.usdc -o strain.png --frame 12 --colour strain --size 1920x1080
    """,
)
@click.argument("file", type=readable_path())
@click.option(
    "-o",
    "--output",
    required=True,
    type=click.Path(path_type=Path),
    help="PNG file to write.",
)
@click.option(
    "--frame",
    "frames",
    type=float,
    multiple=True,
    metavar="N",
    help="Frame to draw; repeat it for several files, or for the frames of a sheet.",
)
@click.option(
    "--sheet",
    type=click.IntRange(1, MOST_SHEET),
    metavar="N",
    help="Contact sheet of N frames spread over the file, or of those of --frame.",
)
@click.option(
    "--colour",
    type=click.Choice(["shaded", "barb", "region", "strain"]),
    default="shaded",
    show_default=True,
    help="Shaded vanes, barb angle, region, or strain across the barbs.",
)
@click.option("--size", type=Size(), help="Pixels of one picture.")
@click.option(
    "--view",
    type=click.Choice(["auto", "top", "side", "front"]),
    default="auto",
    show_default=True,
    help="Where the camera stands; auto looks onto the vanes.",
)
@click.option("--overwrite", is_flag=True, help="Replace files that exist.")
def preview(
    file: Path,
    output: Path,
    frames: tuple[float, ...],
    sheet: int | None,
    colour: str,
    size: tuple[int, int] | None,
    view: str,
    overwrite: bool,
) -> None:
    """Draw the feathers of FILE (USD) to PNG, without a screen or a GPU.

    Needs the extra `preview`: pip install "featherfx[preview]".
    """
    if sheet and frames and len(frames) != sheet:
        raise click.UsageError(f"--sheet {sheet} and {len(frames)} times --frame do not agree")

    from featherfx.render.picture import render

    chosen = list(frames) or (_spread(file, sheet) if sheet else None)
    for written in render(
        file,
        output,
        chosen,
        size=size,
        colour=colour,
        sheet=bool(sheet),
        view=view,
        overwrite=overwrite,
    ):
        click.echo(str(written), err=True)


def _spread(file: Path, count: int) -> list[float] | None:
    """Up to count frames spread over a file; None for one without frames."""
    from featherfx.usd.read.read import Cache

    cache = Cache(file)
    if not cache.has_frames:
        return None
    first, last = cache.frames
    steps = min(count, int(last - first) + 1)
    return [first + round(k * (last - first) / max(steps - 1, 1)) for k in range(steps)]
