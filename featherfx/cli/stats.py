"""`featherfx stats`: what a groom or shot holds, and what a bake will cost."""

from __future__ import annotations

import json
import os
from pathlib import Path

import click

from featherfx.cli.options import presets_option, quality_option, readable_path
from featherfx.cli.program import Command


@click.command(
    cls=Command,
    short_help="Counts, overlap, penetration and expected cost.",
    epilog="""
    featherfx stats samples/pigeon/shot.toml
    featherfx stats samples/pigeon/groom.toml --json
    """,
)
@click.argument("file", metavar="SHOT|GROOM", type=readable_path())
@click.option("--jobs", type=click.IntRange(min=1), help="Of the bake.  [default: all cores]")
@click.option("--json", "as_json", is_flag=True, help="One JSON object; SI units, bytes.")
@quality_option("Quality preset.  [default: the shot's, or final]")
@presets_option
def stats(
    file: Path,
    jobs: int | None,
    as_json: bool,
    quality: str | None,
    preset_folders: tuple[Path, ...],
) -> None:
    """Tell what a SHOT or GROOM (a TOML file) holds.

    Feathers by region and kind, how they overlap and where they pass through each other at rest;
    of a shot also what its bake will cost, measured on a few of its feathers.
    """
    from featherfx.pipeline import plumage_stats
    from featherfx.plumage_stats import as_lines

    found = plumage_stats(
        file, quality=quality, jobs=jobs or os.cpu_count() or 1, preset_folders=preset_folders
    )
    click.echo(json.dumps(found, indent=2) if as_json else "\n".join(as_lines(found)))
