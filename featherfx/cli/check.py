"""`featherfx check`: problems of files, by file and key, and what passes through what in caches."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import click

from featherfx.baking import pipeline
from featherfx.cli.options import (
    FRAMES,
    default_jobs,
    jobs_option,
    json_option,
    presets_option,
    progress_option,
    readable_path,
)
from featherfx.cli.program import Command
from featherfx.cli.progress import Progress
from featherfx.groom.read.places import located


@click.command(
    cls=Command,
    short_help="Check grooms, presets, shots and USD files; count crossings, holes, moves.",
    epilog="""
    featherfx check samples/swan_wing/shot.toml
    featherfx check presets/feather/*.toml wing.usdc
    featherfx check --crossings pigeon.usdc --frames 1-24
    featherfx check --holes top wing.usdc
    """,
)
@click.argument("files", metavar="FILE...", nargs=-1, required=True, type=readable_path())
@presets_option
@click.option(
    "--crossings",
    is_flag=True,
    help="Count triangles of vanes that pass through another or a body, in one USD file.",
)
@click.option(
    "--holes",
    type=click.Choice(("top", "side", "front")),
    help="Find holes in the outline of one USD file, seen so.",
)
@click.option(
    "--moves", is_flag=True, help="Tell how far points move from frame to frame of one cache."
)
@click.option("--frames", type=FRAMES, help="Frames to look at.  [default: all]")
@json_option("What is measured as one JSON object.")
@jobs_option()
@progress_option
@click.pass_context
def check(
    ctx: click.Context,
    files: tuple[Path, ...],
    preset_folders: tuple[Path, ...],
    style: str,
    **options: Any,
) -> None:
    """Check grooms, presets and shots (TOML) and USD files.

    Prints one line per problem (file, key, what is wrong, allowed range) and exits with 1 if
    there is any.

    With --crossings, prints for each whole frame of a cache how many pairs of triangles of vanes
    pass through each other, and of how many pairs of feathers they are. The skin of the shot, and
    meshes that are not feathers, count as one body. With --json also those of shafts.

    With --holes, prints how many places in the outline of what a file draws, its skin too, are
    open though enclosed, and the largest circle that fits into any. What lies beside a leg, as
    between it and the belly, is told apart: 0.4 of its rim is skin without feathers, or a fifth is
    feathers of thighs and a fifth others.

    With --moves, prints for each whole frame but the first the largest move of a point since the
    one before, as a share of its feather's length.
    """
    asked = {name: options.pop(name) for name in _TOLD}
    wanted = [name for name, value in asked.items() if value]
    if len(wanted) > 1 or (wanted and len(files) != 1):
        raise click.UsageError(f"--{wanted[0]} takes one file, and nothing else to measure")
    if wanted:
        _measure(wanted[0], files[0], style, asked["holes"], **options)
        return
    for name, value in options.items():
        if value:
            message = f"--{name.removeprefix('as_')} needs --crossings, --holes or --moves"
            raise click.UsageError(message)
    with Progress("files", style):
        found = [problem for file in files for problem in pipeline.check(file, preset_folders)]
    for problem in dict.fromkeys(found):
        click.echo(located(problem))
    if found:
        ctx.exit(1)
    click.echo(f"{len(files)} checked, no problems", err=True)


class _Told(NamedTuple):
    """What is said of what is measured: the line of a frame, and what all frames have in JSON."""

    line: Callable[[dict[str, Any]], str]
    whole: Callable[[list[dict[str, Any]]], dict[str, Any]]


def _totals(counted: list[dict[str, Any]]) -> dict[str, Any]:
    keys = "crossings", "with_body", "with_shafts"
    total = {key: sum(each[key] for each in counted) for key in keys}
    return total | {"worst_frame": max(counted, key=lambda each: each["crossings"])["frame"]}


def _greatest(key: str) -> Callable[[list[dict[str, Any]]], dict[str, Any]]:
    return lambda counted: {key: max(each[key] for each in counted)}


def _holes_line(each: dict[str, Any]) -> str:
    line = f"{each['holes']}, the widest {1e3 * each['widest']:.2f} mm,"
    gaps = f" and {each['gaps']} beside legs, up to {1e3 * each['widest_gap']:.2f} mm,"
    return line + (gaps if each["gaps"] else "")


_TOLD = {
    "crossings": _Told(lambda each: f"{each['crossings']} in {each['pairs']} pairs", _totals),
    "holes": _Told(_holes_line, _greatest("widest")),
    "moves": _Told(
        lambda each: f"{100.0 * each['largest']:.3g} % of the length of {each['feather']}",
        _greatest("largest"),
    ),
}


def _measure(
    what: str,
    file: Path,
    style: str,
    view: str | None,
    frames: tuple[int, int] | None,
    as_json: bool,
    jobs: int | None,
) -> None:
    if jobs is not None and what != "crossings":
        raise click.UsageError("--jobs goes with --crossings")
    told, counted = _TOLD[what], []
    with Progress(what, style) as progress:
        if what == "crossings":
            found = pipeline.count_crossings(
                file, frames, jobs=jobs or default_jobs(), on_frame=progress
            )
        elif what == "holes":
            found = pipeline.measure_holes(file, str(view), frames, on_frame=progress)
        else:
            found = pipeline.measure_moves(file, frames, on_frame=progress)
        for each in found:
            counted.append(each)
            if not as_json:
                frame = each["frame"]
                at = "at rest" if frame is None else f"at frame {frame:g}"
                click.echo(f"{what}: {told.line(each)} {at}")
    if as_json:
        whole = {"file": str(file), **told.whole(counted), "frames": counted}
        click.echo(json.dumps(whole, indent=2))
