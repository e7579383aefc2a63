"""`featherfx presets`, `sample`, `schema` and `trace`: start files, and presets from pictures."""

from __future__ import annotations

import json
from dataclasses import asdict
from itertools import groupby
from pathlib import Path
from typing import Any

import click

from featherfx.baking.install import copy_sample, sample_names
from featherfx.cli.options import (
    RealNumber,
    json_option,
    output_option,
    overwrite_option,
    pairs,
    presets_option,
    readable_path,
)
from featherfx.cli.program import Command, CommandGroup, print_json
from featherfx.errors import InputError, Problem


@click.group(cls=CommandGroup)
def presets() -> None:
    """List presets and show what they hold."""


@presets.command(
    "list",
    cls=Command,
    short_help="List all presets by family.",
    epilog="featherfx presets list\nfeatherfx presets list --presets mine --json",
)
@presets_option
@json_option("Family, name, file and summary of each; of motions `cites` and `by_eye`, too.")
def list_command(preset_folders: tuple[Path, ...], as_json: bool) -> None:
    """List all presets by family, with the first comment of each file."""
    from featherfx.groom.presets.presets import list_presets

    found = list_presets(preset_folders)
    if as_json:
        print_json({"presets": [asdict(each) | {"path": str(each.path)} for each in found]})
        return
    width = max((len(preset.name) for preset in found), default=0)
    for family, members in groupby(found, key=lambda preset: preset.family):
        click.echo(family)
        for preset in members:
            click.echo(f"  {preset.name.ljust(width)}  {preset.summary}".rstrip())


@presets.command(
    "show",
    cls=Command,
    short_help="Show a preset and where its values come from.",
    epilog="""
    featherfx presets show swan_primary
    featherfx presets show material/vane/swan_vane
    featherfx presets show bird/pigeon --json
    """,
)
@click.argument("name")
@presets_option
@json_option("Values and their files; of birds `tracts` with count, length and cites, too.")
def show_command(name: str, preset_folders: tuple[Path, ...], as_json: bool) -> None:
    """Show the preset NAME merged with all that it extends, and the file of each value."""
    from featherfx.groom.presets.presets import describe_preset, show

    if as_json:
        print_json(describe_preset(name, preset_folders))
    else:
        click.echo(show(name, preset_folders))


@click.command(
    cls=Command,
    help=f"""Copy the files of the sample NAME and print where they are.

    The copy can be baked as it is: featherfx bake DIR/shot.toml.

    Samples: {", ".join(sample_names())}.
    """,
    epilog="""
    featherfx sample swan_wing
    featherfx sample pigeon -o birds/mine
    """,
)
@click.argument("name", metavar="NAME", type=click.Choice(sample_names()))
@output_option("New or empty folder for its files.  [default: NAME]", required=False, metavar="DIR")
def sample(name: str, output: Path | None) -> None:
    for file in copy_sample(name, output or Path(name)):
        click.echo(str(file))


@click.command(
    cls=Command,
    epilog="""
    featherfx schema shot > shot.schema.json
    featherfx schema preset --family material/vane > vane.schema.json
    """,
)
@click.argument("kind", type=click.Choice(("groom", "shot", "flock", "preset")))
@click.option(
    "--family", default="", help="Of presets, the folder that they stand in; default: any family."
)
def schema(kind: str, family: str) -> None:
    """Print the JSON Schema (draft 2020-12) of grooms, shots or presets.

    Editors complete and check TOML files by it: Even Better TOML (VS Code) and others that use
    Taplo take the one that the first line of a file names, "#:schema ./shot.schema.json".
    """
    from featherfx.groom.keys.preset import PRESET_FAMILIES
    from featherfx.shot.read.reference import schema as schema_of

    if family and kind != "preset":
        raise click.UsageError("--family goes with preset")
    if family and family not in PRESET_FAMILIES:
        raise click.BadParameter(
            f"'{family}' is none of {', '.join(PRESET_FAMILIES)}", param_hint="--family"
        )
    click.echo(json.dumps(schema_of(kind, family), indent=2))


@click.command(
    cls=Command,
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
@click.option("--length", type=RealNumber(1e-3, 10), help="m.  [default: the base's]")
@click.option(
    "--threshold",
    type=RealNumber(0, 1),
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
        message = 'needs Pillow. Run pip install "featherfx[preview]"'
        raise InputError(Problem("trace", "", message)) from error
    options["shaft"] = options["shaft"] or ()
    traced, picture = work.trace(photo, work.TraceOptions(**options))
    work.write_traced(traced, picture, output, overlay, overwrite)
    click.echo(
        f"{output}: within {traced.deviation:.2g} % of the length of the silhouette; barbs seen at"
        f" {traced.seen[0]} places of the leading and {traced.seen[1]} of the trailing vane",
        err=True,
    )
