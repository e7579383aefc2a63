"""`featherfx presets`: which presets there are, and what is in them."""

from __future__ import annotations

from itertools import groupby
from pathlib import Path

import click

from featherfx.cli.options import presets_option
from featherfx.cli.program import Command, CommandGroup


@click.group(cls=CommandGroup)
def presets() -> None:
    """List presets and show what they hold."""


@presets.command(
    "list",
    cls=Command,
    short_help="List all presets by family.",
    epilog="featherfx presets list\nfeatherfx presets list --presets mine",
)
@presets_option
def list_command(preset_folders: tuple[Path, ...]) -> None:
    """List all presets by family, with the first comment of each file."""
    from featherfx.groom.presets.presets import list_presets

    found = list_presets(preset_folders)
    width = max((len(preset.name) for preset in found), default=0)
    for family, members in groupby(found, key=lambda preset: preset.family):
        click.echo(family)
        for preset in members:
            click.echo(f"  {preset.name.ljust(width)}  {preset.summary}".rstrip())


@presets.command(
    "show",
    cls=Command,
    short_help="Show a preset and where its values come from.",
    epilog="featherfx presets show swan_primary\nfeatherfx presets show material/vane/swan_vane",
)
@click.argument("name")
@presets_option
def show_command(name: str, preset_folders: tuple[Path, ...]) -> None:
    """Show the preset NAME merged with all that it extends, and the file of each value."""
    from featherfx.groom.presets.presets import show

    click.echo(show(name, preset_folders))
