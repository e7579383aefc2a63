"""`featherfx preview`: pictures of a cache."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from featherfx.cli.options import (
    FRAMES,
    WholeNumber,
    jobs_option,
    options_of,
    output_option,
    overwrite_option,
    progress_option,
    readable_path,
)
from featherfx.cli.program import Command
from featherfx.cli.progress import Progress
from featherfx.limits import MAX_SHEET
from featherfx.render.options import PictureOptions


@click.command(
    cls=Command,
    epilog="""
    featherfx preview swan_wing.usdc -o wing.png --frame 12
    featherfx preview swan_wing.usdc -o beat.png --sheet 8 --view front
    featherfx preview swan_wing.usdc -o one.png --feather right_primary_03 --frame 12
    featherfx preview new.usdc -o both.png --against old.usdc --frame 12
    featherfx preview wing.usda -o shot.mp4 --camera /cameras/main --frames 1-24
    featherfx preview swan_wing.usdc -o strain.png --frame 12 --colour strain --size 1920x1080
    """,
)
@click.argument("file", type=readable_path())
@output_option("File to write: .png, or a film as .gif or .mp4.")
@click.option(
    "--frame",
    "single",
    type=float,
    multiple=True,
    metavar="N",
    help="Frame to draw; repeat it for several files, or for the frames of a sheet.",
)
@click.option("--frames", "span", type=FRAMES, help="First and last frame to draw.")
@click.option(
    "--sheet",
    type=WholeNumber(1, MAX_SHEET),
    metavar="N",
    help="Contact sheet of N frames spread over the file, or of those of --frame.",
)
@click.option(
    "--turntable",
    type=WholeNumber(1, MAX_SHEET),
    metavar="N",
    help="N views around the upright axis.",
)
@options_of(
    PictureOptions,
    *("colour", "size", "view", "framing", "camera", "feathers", "regions", "surroundings"),
    *("against", "scenery", "bare", "floor", "samples", "rate"),
)
@click.option(
    "--f-stop", type=float, default=0.0, metavar="N", help="Blur of a lens, such as 2.8; 0: none."
)
@jobs_option("Threads that draw.")
@progress_option
@overwrite_option()
def preview(
    file: Path,
    output: Path,
    single: tuple[float, ...],
    span: tuple[int, int] | None,
    sheet: int | None,
    turntable: int | None,
    samples: str,
    style: str,
    **options: Any,
) -> None:
    """Draw the feathers of FILE (USD), without a screen or a GPU.

    Skin and colliders of the shot are drawn with them. The camera is the same for all frames and
    all calls on one file. Needs the extra `preview`: pip install "featherfx[preview]"; films as
    .mp4 need `film`.
    """
    frames = _frames(file, single, span, None if turntable else sheet)

    from featherfx.render.picture import render

    with Progress("drawing", style):
        written = render(
            file,
            output,
            frames=frames,
            sheet=bool(sheet),
            turntable=turntable or 0,
            samples=int(samples),
            **options,
        )
    for path in written:
        click.echo(str(path), err=True)


def _frames(
    file: Path, single: tuple[float, ...], span: tuple[int, int] | None, sheet: int | None
) -> list[float] | None:
    """The frames that the options name; None leaves them open."""
    if single and span:
        raise click.UsageError("--frame and --frames exclude each other")
    if span:
        frames = [float(frame) for frame in range(span[0], min(span[1], span[0] + 10**5) + 1)]
    else:
        frames = list(single)
    if sheet and frames and len(frames) != sheet:
        told = "--frames" if span else f"{len(frames)} times --frame"
        raise click.UsageError(f"--sheet {sheet} and {told} do not agree")
    return frames or (_spread(file, sheet) if sheet else None)


def _spread(file: Path, count: int) -> list[float] | None:
    """Up to count frames spread over a file; None for one without frames."""
    from featherfx.usd.read.cache import Cache

    cache = Cache(file)
    if not cache.has_frames:
        return None
    first, last = cache.frames
    steps = min(count, int(last - first) + 1)
    return [first + round(k * (last - first) / max(steps - 1, 1)) for k in range(steps)]
