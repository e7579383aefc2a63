"""`featherfx stats` and `error`: contents, expected cost and estimated error of a shot."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from featherfx.baking import pipeline
from featherfx.baking.options import TRIAL_SECONDS
from featherfx.cli.options import (
    RealNumber,
    WholeNumber,
    default_jobs,
    jobs_option,
    json_option,
    presets_option,
    progress_option,
    quality_option,
    readable_path,
)
from featherfx.cli.program import Command, plain, print_json
from featherfx.cli.progress import Progress
from featherfx.errors import as_figure


@click.command(
    cls=Command,
    epilog="""
    featherfx stats samples/pigeon/shot.toml
    featherfx stats samples/pigeon/groom.toml --json
    """,
)
@click.argument("file", metavar="SHOT|GROOM", type=readable_path())
@jobs_option("Threads of the bake that is predicted.")
@json_option("One JSON object; SI units, bytes.")
@quality_option("Quality preset.  [default: the shot's, or final]")
@presets_option
@click.option(
    "--seconds",
    "budget",
    type=RealNumber(0.1, 3600.0),
    help="CPU time for reading and for trying a part of the shot, without compiling, from which the"
    f" rest is predicted; more is surer.  [default: {TRIAL_SECONDS:g}, or a sixth of the bake's, up"
    " to a minute]",
)
@progress_option
def stats(
    file: Path,
    jobs: int | None,
    as_json: bool,
    quality: str | None,
    preset_folders: tuple[Path, ...],
    budget: float | None,
    style: str,
) -> None:
    """Tell what a SHOT or GROOM (a TOML file) holds.

    Feathers by region and kind, and how those of a layout overlap; of a shot also what its bake
    will cost, measured on a part of it.
    """
    with Progress("trials", style):
        found = pipeline.stats(
            file,
            quality=quality,
            jobs=jobs or default_jobs(),
            preset_folders=preset_folders,
            budget=budget,
        )
    if as_json:
        print_json(found)
    else:
        click.echo("\n".join(_lines(found)))


def _lines(stats: dict[str, Any]) -> list[str]:
    """The figures for people."""
    lines = [f"{stats['name']}: {stats['feathers']} feathers of {stats['shapes']} shapes"]
    lines += [f"  region {name or '(none)'}: {count}" for name, count in stats["regions"].items()]
    lines += [f"  kind {name}: {count}" for name, count in stats["kinds"].items()]
    low, high = (1e3 * stats["length"][key] for key in ("least", "greatest"))
    lines.append(f"length: {low:.3g} to {high:.3g} mm")
    lines.append(
        f"mesh points at quality {stats['quality']}: {stats['mesh_points']}"
        f" ({stats['mesh_points_of_shapes']} where shapes are instanced)"
    )
    if (coat := stats["layout"]) is not None:
        lines.append(
            f"layout: {coat['feathers']} feathers, {coat['neighbours_of_each']:.1f} neighbours a"
            f" feather, {coat['pairs']} pairs; {coat['feathers_with_smaller_gap']} with a smaller"
            f" gap, {coat['feathers_without_gap']} with none"
        )
    if "bake" in stats:
        lines += _bake_lines(stats["bake"])
    return lines


def _bake_lines(bake: dict[str, Any]) -> list[str]:
    lines = [
        f"bake of {bake['frames']} frames: {bake['unknowns']} unknowns,"
        f" {as_figure(1e3 * bake['seconds_of_a_feather_and_frame'])} ms a feather and frame"
        f" (by {bake['tried_feathers']} feathers and {bake['tried_frames']} frames)"
    ]
    if len(bake["levels"]) > 1:
        levels = ", ".join(f"{count:.0f} {level}" for level, count in bake["levels"].items())
        lines.append(f"  levels: {levels}")
    parts = ", ".join(
        f"{name.replace('_', ' ')} {as_figure(seconds)}"
        for name, seconds in bake["seconds"].items()
    )
    lines.append(
        f"  about {as_figure(bake['wall_seconds'])} s ({as_figure(bake['low']['wall_seconds'])} to"
        f" {as_figure(bake['high']['wall_seconds'])}) with {bake['jobs']} jobs ({parts};"
        f" learnt in {as_figure(bake['trial_seconds'])} s,"
        f" {as_figure(bake['compiling_seconds'])} s of them compiling)"
    )
    lines.append(
        f"  about {as_figure(bake['processor_seconds'])} s"
        f" ({as_figure(bake['low']['processor_seconds'])} to"
        f" {as_figure(bake['high']['processor_seconds'])}) of processor time, whatever else is"
        f" running: meanwhile its threads had {as_figure(bake['cores'])} cores"
    )
    lines.append(
        f"  about {as_figure(bake['memory_bytes'] / 1e6)} MB of memory,"
        f" {as_figure(bake['bytes_of_the_cache'] / 1e6)} MB of samples"
    )
    return lines


@click.command(
    cls=Command,
    epilog="""
    featherfx error samples/swan_wing/shot.toml
    featherfx error samples/breeze/shot.toml --quality final --json
    """,
)
@click.argument("file", metavar="SHOT", type=readable_path())
@click.option(
    "--feathers",
    type=WholeNumber(1, 100),
    default=4,
    show_default=True,
    help="How many to look at; more are surer and take longer.",
)
@jobs_option()
@json_option()
@quality_option("Quality preset.  [default: the shot's, or final]")
@presets_option
@progress_option
def error(
    file: Path,
    feathers: int,
    jobs: int | None,
    as_json: bool,
    quality: str | None,
    preset_folders: tuple[Path, ...],
    style: str,
) -> None:
    """Estimate how far the nodes of a SHOT (a TOML file) are from where finer settings have them.

    The feathers that bend most, are longest, or are pulled are simulated again with twice the rows,
    twice the columns, more coefficients and shorter steps, each alone and all together; their first
    frame is tried on four times the rows and columns, too. Where feathers touch, they touch
    colliders and each other; what others do to them is left out.
    """
    with Progress("comparisons", style):
        found = pipeline.error_of(
            file,
            quality=quality,
            feathers=feathers,
            jobs=jobs or default_jobs(),
            preset_folders=preset_folders,
        )
    values = plain(found)
    if as_json:
        print_json(values)
    else:
        click.echo("\n".join(_error_lines(values)))


def _error_lines(found: dict[str, Any]) -> list[str]:
    lines = [
        f"error {found['error_mm']:.3g} mm; {found['error_percent']:.3g} % of the length"
        f" ({found['feather']})"
    ]
    lines += [
        f"  {name}: {part['mm']:.3g} mm, {part['percent']:.3g} %"
        for name, part in found["parts"].items()
    ]
    for name, grid in zip(found["feathers"], found["resolutions"], strict=True):
        lines.append(
            f"  {name}: {grid['level']}, {grid['rows']} rows, {grid['columns']} columns,"
            f" {grid['coefficients']} coefficients"
        )
    touching = ", without contact of other feathers" if found["contact"] else ""
    lines.append(f"  {found['frames']} frames{touching}, in {found['seconds']:.3g} s")
    return lines
