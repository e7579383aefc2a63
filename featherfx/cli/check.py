"""`featherfx check`: problems of files, by file and key, and what passes through what in caches."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import click

from featherfx.baking import pipeline
from featherfx.cli.options import (
    FrameRange,
    default_jobs,
    jobs_option,
    presets_option,
    progress_option,
    readable_path,
)
from featherfx.cli.program import Command
from featherfx.cli.progress import Progress
from featherfx.groom.read.places import located


@click.command(
    cls=Command,
    short_help="Check grooms, presets, shots and USD files; count crossings.",
    epilog="""
    featherfx check samples/swan_wing/shot.toml
    featherfx check presets/feather/*.toml wing.usdc
    featherfx check --crossings pigeon.usdc --frames 1-24
    """,
)
@click.argument("files", metavar="FILE...", nargs=-1, required=True, type=readable_path())
@presets_option
@click.option(
    "--crossings",
    is_flag=True,
    help="Count triangles of vanes that pass through another or a body, in one USD file.",
)
@click.option("--frames", type=FrameRange(), help="Frames to count in.  [default: all]")
@click.option("--json", "as_json", is_flag=True, help="Crossings as one JSON object.")
@jobs_option()
@progress_option
@click.pass_context
def check(
    ctx: click.Context,
    files: tuple[Path, ...],
    preset_folders: tuple[Path, ...],
    crossings: bool,
    style: str,
    **options: Any,
) -> None:
    """Check grooms, presets and shots (TOML) and USD files.

    Prints one line per problem (file, key, what is wrong, allowed range) and exits with 1 if
    there is any.

    With --crossings, prints for each whole frame of a cache how many pairs of triangles of vanes
    pass through each other, and of how many pairs of feathers they are. The skin of the shot, and
    meshes that are not feathers, count as one body. With --json also those of shafts.
    """
    if crossings:
        if len(files) != 1:
            raise click.UsageError("--crossings takes one file")
        _crossings(files[0], style, **options)
        return
    for name, value in options.items():
        if value:
            raise click.UsageError(f"--{name.removeprefix('as_')} needs --crossings")
    with Progress("files", style):
        found = [problem for file in files for problem in pipeline.check(file, preset_folders)]
    for problem in dict.fromkeys(found):
        click.echo(located(problem))
    if found:
        ctx.exit(1)
    click.echo(f"{len(files)} checked, no problems", err=True)


def _crossings(
    file: Path, style: str, frames: tuple[int, int] | None, as_json: bool, jobs: int | None
) -> None:
    counted = []
    with Progress("crossings", style) as progress:
        for each in pipeline.count_crossings(
            file, frames, jobs=jobs or default_jobs(), on_frame=progress
        ):
            counted.append(each)
            if not as_json:
                at = "at rest" if each["frame"] is None else f"at frame {each['frame']:g}"
                click.echo(f"crossings: {each['crossings']} in {each['pairs']} pairs {at}")
    if as_json:
        keys = "crossings", "with_body", "with_shafts"
        total = {key: sum(each[key] for each in counted) for key in keys}
        worst = max(counted, key=lambda each: each["crossings"])["frame"]
        told = {"file": str(file), **total, "worst_frame": worst, "frames": counted}
        click.echo(json.dumps(told, indent=2))
