"""`featherfx retime`: a cache slower, faster, along keys, or as a loop."""

from __future__ import annotations

from pathlib import Path

import click

from featherfx.baking import pipeline
from featherfx.cli.options import Pairs, readable_path
from featherfx.cli.program import Command


@click.command(
    cls=Command,
    short_help="Write a cache slower, faster, or as a loop.",
    epilog="""
    featherfx retime wing.usdc -o slow.usdc --speed 0.25
    featherfx retime wing.usdc -o ramp.usdc --keys 1:1,24:12,60:48
    featherfx retime flap.usdc -o loop.usdc --loop 24
    """,
)
@click.argument("cache", type=readable_path())
@click.option(
    "-o",
    "--output",
    required=True,
    type=click.Path(path_type=Path),
    help="One plain USD file (.usd, .usdc, .usda).",
)
@click.option("--speed", type=float, help="Frames of the cache that pass in a new one.")
@click.option(
    "--keys",
    type=Pairs("NEW:OLD,...", ":", ",", "keys", "1:1,24:12,48:48"),
    help="New frames and those of the cache that they show.",
)
@click.option(
    "--loop",
    type=click.IntRange(min=1),
    help="Frames at the end of the cache that become a loop; those before them are faded in.",
)
@click.option("--overwrite", is_flag=True, help="Replace a file that exists.")
def retime(
    cache: Path,
    output: Path,
    speed: float | None,
    keys: list[tuple[float, float]] | None,
    loop: int | None,
    overwrite: bool,
) -> None:
    """Write CACHE (a USD file of featherfx) in another time, without simulating it anew.

    Points follow the velocities between frames; velocities are those of the new motion. A loop's
    last frame is its first.
    """
    if sum(each is not None for each in (speed, keys, loop)) != 1:
        raise click.UsageError("give one of --speed, --keys and --loop")
    pipeline.retime(cache, output, speed=speed, keys=keys, loop=loop, overwrite=overwrite)
    click.echo(str(output), err=True)
