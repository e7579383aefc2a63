"""`featherfx doctor`, `plugins`, `completion`, `presets`, `sample`, `schema` and `trace`.

This installation and other programs, start files, and presets from pictures.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import asdict
from itertools import groupby
from pathlib import Path
from typing import Any

import click
from click.shell_completion import get_completion_class

from featherfx.baking.install import HOSTS, copy_sample, install, listed, sample_names
from featherfx.cli.options import (
    RealNumber,
    json_option,
    output_option,
    overwrite_option,
    pairs,
    presets_option,
    progress_option,
    readable_path,
)
from featherfx.cli.program import Command, CommandGroup, print_json, tell
from featherfx.cli.progress import Progress, about
from featherfx.errors import InputError, Problem


@click.command(
    cls=Command,
    epilog="""
    featherfx doctor
    featherfx doctor --json > report.json
    """,
)
@json_option()
@click.option("--no-test", is_flag=True, help="Leave out the self-test.")
@progress_option
@click.pass_context
def doctor(ctx: click.Context, as_json: bool, no_test: bool, style: str) -> None:
    """Report versions, folders and extras, bake a sample feather, and say what is wrong.

    The self-test takes two seconds; the first time it also compiles the solver, which takes a
    minute or two. Exits with 1 if there is a problem.
    """
    # reads metadata of packages, which other commands need not
    from featherfx.baking.install import examine

    with Progress("checks", style):
        found = examine(not no_test)
    click.echo(json.dumps(found, indent=2) if as_json else "\n".join(_lines(found)))
    for problem in found["problems"]:
        click.echo(f"featherfx: {problem}", err=True)
    if found["problems"]:
        ctx.exit(1)


def _lines(found: dict[str, Any]) -> Iterator[str]:
    """The report for people."""
    yield f"featherfx {found['version']}, Python {found['python']}, {found['executable']}"
    yield f"{found['platform']}, {found['cores']} cores"
    if found["packages"] is None:
        yield "not installed as a package: what it needs is not looked at"
    else:
        installed = (f"{name} {version}" for name, version in found["packages"].items() if version)
        yield f"packages: {', '.join(installed)}"
        for name, extra in found["extras"].items():
            state = "installed" if extra["installed"] else f"needs {', '.join(extra['missing'])}"
            yield f"  extra {name}: {state}"
    if usd := found["usd"]:
        yield f"USD {usd['version']} in {usd['folder']}"
    cache = found["cache"]
    yield f"compiled code: {cache['folder']}, {cache['files']} files, {cache['bytes'] / 1e6:.0f} MB"
    reason = cache["shipped_code_unused"]
    yield "  machine code of the wheel: " + (f"not used ({reason})" if reason else "used")
    if cache["seconds_to_compile"] >= 1.0:
        yield f"  a first bake has yet to compile, {about(cache['seconds_to_compile'])} of one core"
    yield f"{found['presets']} presets, {len(found['samples'])} samples"
    if test := found["self_test"]:
        state = "passed" if test["ok"] else "failed"
        yield f"self-test ({test['sample']}): {state} in {test['seconds']:.1f} s"


@click.group(cls=CommandGroup, epilog="featherfx plugins list\nfeatherfx plugins install houdini")
def plugins() -> None:
    """List plugins for other programs, and install them."""


@plugins.command(
    "list",
    cls=Command,
    short_help="List plugins, and which are installed.",
    epilog="featherfx plugins list --json",
)
@json_option("One JSON array.")
def list_plugins(as_json: bool) -> None:
    """List the programs that there is a plugin for, where it goes, and what is installed."""
    found = listed()
    if as_json:
        click.echo(json.dumps(found, indent=2))
        return
    for each in found:
        place = each["folder"] or "no folder found. Name one with --into"
        state = f"version {each['installed']}" if each["installed"] else "not installed"
        click.echo(f"{each['host']}: {state} ({place})")


@plugins.command(
    "install",
    cls=Command,
    short_help="Install the plugin of a program.",
    help=f"""Install the plugin of HOST, which calls the featherfx that installed it, and print its
    folder. It appears complete or not at all.

    Hosts: {", ".join(HOSTS)}.
    """,
    epilog="""
    featherfx plugins install houdini
    featherfx plugins install usdview --into ~/usd_plugins
    """,
)
@click.argument("host", metavar="HOST", type=click.Choice(tuple(HOSTS), case_sensitive=False))
@click.option(
    "--into",
    type=click.Path(path_type=Path),
    metavar="FOLDER",
    help="Folder that the program searches.  [default: the user's own]",
)
@overwrite_option("Replace a plugin that is installed.")
def install_command(host: str, into: Path | None, overwrite: bool) -> None:
    folder, then = install(host, into, overwrite)
    click.echo(str(folder))
    tell(then)


@click.command(
    cls=Command,
    epilog="""
    featherfx completion bash >> ~/.bashrc
    featherfx completion zsh >> ~/.zshrc
    featherfx completion fish > ~/.config/fish/completions/featherfx.fish
    """,
)
@click.argument("shell", type=click.Choice(("bash", "zsh", "fish")))
@click.pass_context
def completion(ctx: click.Context, shell: str) -> None:
    """Print a script for SHELL, to be read when it starts.

    With it, the tab key completes commands, options and names of files, samples and kinds.
    """
    kind = get_completion_class(shell)
    assert kind is not None
    program = ctx.find_root().command
    click.echo(kind(program, {}, "featherfx", "_FEATHERFX_COMPLETE").source())


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
def list_known(preset_folders: tuple[Path, ...], as_json: bool) -> None:
    """List all presets by family, with the first comment of each file."""
    from featherfx.shot.read.reference import list_presets

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
    from featherfx.shot.read.reference import describe_preset, show

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
