"""`featherfx schema`: what files may hold, for editors and other programs."""

from __future__ import annotations

import json

import click

from featherfx.cli.program import Command


@click.command(
    cls=Command,
    short_help="Print the JSON Schema of grooms, shots or presets.",
    epilog="""
    featherfx schema shot > shot.schema.json
    featherfx schema preset --family material/vane > vane.schema.json
    """,
)
@click.argument("kind", type=click.Choice(("groom", "shot", "preset")))
@click.option(
    "--family", default="", help="Of presets, the folder that they stand in; default: any family."
)
def schema(kind: str, family: str) -> None:
    """Print the JSON Schema (draft 2020-12) of grooms, shots or presets.

    Editors complete and check TOML files by it: Even Better TOML (VS Code) and others that use
    Taplo take the one that the first line of a file names, "#:schema ./shot.schema.json".
    """
    from featherfx.shot.read import schema as schemas

    if family and kind != "preset":
        raise click.UsageError("--family goes with preset")
    if family and family not in schemas.FAMILIES:
        raise click.BadParameter(
            f"'{family}' is none of {', '.join(schemas.FAMILIES)}", param_hint="--family"
        )
    click.echo(json.dumps(schemas.schema(kind, family), indent=2))
