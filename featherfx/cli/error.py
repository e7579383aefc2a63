"""`featherfx error`: how far a shot is from what finer settings would give."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import click

from featherfx.baking import pipeline
from featherfx.cli.lab.show import plain
from featherfx.cli.options import (
    default_jobs,
    presets_option,
    progress_option,
    quality_option,
    readable_path,
)
from featherfx.cli.program import Command
from featherfx.cli.progress import Progress
from featherfx.limits import MOST_JOBS


@click.command(
    cls=Command,
    short_help="Error of a shot, on a few of its feathers.",
    epilog="""
    featherfx error samples/swan_wing/shot.toml
    featherfx error samples/breeze/shot.toml --quality final --json
    """,
)
@click.argument("file", metavar="SHOT", type=readable_path())
@click.option(
    "--feathers",
    type=click.IntRange(1, 100),
    default=4,
    show_default=True,
    help="How many to look at; more are surer and take longer.",
)
@click.option("--jobs", type=click.IntRange(1, MOST_JOBS), help="Threads.  [default: all cores]")
@click.option("--json", "as_json", is_flag=True, help="One JSON object.")
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
    twice the columns, more coefficients and shorter steps, each alone and all together. Feathers do
    not touch in this.
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
    click.echo(json.dumps(values) if as_json else "\n".join(_lines(values)))


def _lines(found: dict[str, Any]) -> list[str]:
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
    touching = ", without contact" if found["contact"] else ""
    lines.append(f"  {found['frames']} frames{touching}, in {found['seconds']:.3g} s")
    return lines
