"""`featherfx groom`, `export`, `retime` and `sculpt`: grooms at rest, caches in other forms."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields
from pathlib import Path
from typing import Any

import click

from featherfx.baking import pipeline
from featherfx.baking.options import DRAWN, GroomOptions
from featherfx.cli.options import (
    FRAMES,
    NUMBERS,
    RealNumber,
    WholeNumber,
    json_option,
    options_of,
    output_option,
    overwrite_option,
    pairs,
    presets_option,
    progress_option,
    quality_option,
    readable_path,
)
from featherfx.cli.program import Command, print_json
from featherfx.cli.progress import Progress
from featherfx.usd.write.options import StageOptions


@click.command(
    cls=Command,
    epilog="""
    featherfx groom samples/swan_wing/groom.toml -o feathers.usdc
    featherfx groom groom.toml -o feathers.usda --up-axis Y --meters-per-unit 0.01
    featherfx groom bird.usda -o feathers.usdc --render-rows 60 --barbs 300
    featherfx groom bird.toml --coverage -o bare.png
    """,
)
@click.argument("groom", metavar="GROOM", type=readable_path())
@output_option(
    "USD file to write (.usd, .usdc, .usda). With --coverage, a picture (.png).", required=False
)
@click.option("--coverage", is_flag=True, help="Measure the bare skin of each tract instead.")
@json_option("With --coverage: area, bare, count, largest_hole, overlap, exposed of each tract.")
@quality_option(
    "Quality preset that gives rows and columns.  [default: final; preview of coverage]"
)
@presets_option
@progress_option
@options_of(GroomOptions, "instances", *DRAWN, *(each.name for each in fields(StageOptions)))
def groom(
    groom: Path, quality: str | None, style: str, coverage: bool, as_json: bool, **options: Any
) -> None:
    """Write the feathers of GROOM (a TOML or USD file) at rest to USD, without time samples.

    With --coverage, prints how feathers cover the skin, tract by tract, and draws it from six sides
    where -o names a picture. Lengths are in m, areas in m2.
    """
    if coverage:
        _measure_coverage(groom, quality or "preview", style, as_json, options)
        return
    if as_json:
        raise click.UsageError("--json goes with --coverage")
    if options["output"] is None:
        raise click.UsageError("Missing option '-o' / '--output'.")
    with Progress("feathers", style):
        count = pipeline.export_groom(groom, quality=quality or "final", **options)
    feathers = "feather" if count == 1 else "feathers"
    click.echo(f"{options['output']}: {count} {feathers} at rest", err=True)


def _measure_coverage(
    groom: Path, quality: str, style: str, as_json: bool, options: Mapping[str, Any]
) -> None:
    own = {name: options[name] for name in ("output", "preset_folders", "overwrite")}
    usual = {each.name: each.default for each in fields(GroomOptions)}
    for name in sorted(options.keys() - own.keys()):
        if options[name] != usual[name]:
            raise click.UsageError(f"--{name.replace('_', '-')} does not go with --coverage")
    with Progress("feathers", style):
        found = pipeline.measure_coverage(groom, quality=quality, **own)
    if as_json:
        print_json(found)
        return
    for name, each in found["tracts"].items():
        click.echo(
            f"{name}: {each['count']} feathers on {1e4 * each['area']:.3g} cm2,"
            f" {100.0 * each['bare']:.2g} % bare, largest hole {1e3 * each['largest_hole']:.2g} mm,"
            f" overlap {each['overlap']:.2g}, {100.0 * each['exposed']:.2g} % of a vane exposed"
        )


@click.command(
    cls=Command,
    epilog="""
    featherfx export wing.usda -o wing_flat.usdc
    featherfx export wing.usdc -o wing_condensed.usdc --condensed
    featherfx export bird.usda -o bird_rigid.usdc --rigid 0.1
    featherfx export bird.usda -o bird_lod.usdc --lod
    featherfx export wing.usdc -o wing.abc
    featherfx export wing.usdc -o look.glb --frames 1-24
    featherfx export wing.usdc -o web.glb --morph
    """,
)
@click.argument("cache", type=readable_path())
@output_option(
    "File to write: USD (.usd, .usdc, .usda), Alembic (.abc), or a mesh file for each frame"
    " (.glb, .obj, .ply, .stl)."
)
@click.option(
    "--morph", is_flag=True, help="glTF: one animated .glb with a morph target for each frame."
)
@click.option("--condensed", is_flag=True, help="USD: as Houdini's condensed feathers.")
@click.option(
    "--rigid",
    type=RealNumber(min=0.0, min_open=True),
    metavar="MM",
    help="USD: feathers that keep their shape within MM millimetres become transforms.",
)
@click.option(
    "--lod",
    type=NUMBERS,
    is_flag=False,
    flag_value="0.1,0.01,0.001",
    help="USD: add coarser versions as levels of detail; each NUMBER is the share of the view below"
    " which the next is shown (0.1,0.01,0.001 where none are given).",
)
@click.option(
    "--frames", type=FRAMES, help="Alembic, meshes: first and last frame.  [default: all]"
)
@overwrite_option()
@progress_option
def export(
    cache: Path,
    output: Path,
    rigid: float | None,
    lod: list[float] | None,
    overwrite: bool,
    style: str,
    **form: Any,
) -> None:
    """Write CACHE (a USD file of featherfx) in another form."""
    usd, condensed = output.suffix in (".usd", ".usda", ".usdc"), form["condensed"]
    if condensed and not usd:
        raise click.UsageError("--condensed goes with a USD file")
    if rigid is not None and (condensed or not usd):
        raise click.UsageError("--rigid goes with a USD file, without --condensed")
    if lod is not None and (condensed or rigid is not None or not usd):
        raise click.UsageError("--lod goes with a USD file, without --condensed and --rigid")
    if form["frames"] and usd:
        raise click.UsageError("--frames goes with Alembic and mesh files")
    if form["morph"] and output.suffix != ".glb":
        raise click.UsageError("--morph goes with a .glb file")
    with Progress("frames", style):
        if rigid is not None:
            count = pipeline.export_rigid(cache, output, rigid, overwrite)
            told = f"{output}: {count} feather{'s' * (count != 1)} move rigidly"
        elif lod is not None:
            levels = pipeline.export_levels(cache, output, lod, overwrite)
            told = ", ".join(f"{name} {count} triangles" for name, count in levels)
            told = f"{output}: {told}"
        else:
            files = pipeline.export(cache, output, overwrite=overwrite, **form)
            told = f"{len(files)} files beside {files[0]}" if len(files) > 1 else str(files[0])
    click.echo(told, err=True)


@click.command(
    cls=Command,
    epilog="""
    featherfx retime wing.usdc -o slow.usdc --speed 0.25
    featherfx retime wing.usdc -o ramp.usdc --keys 1:1,24:12,60:48
    featherfx retime flap.usdc -o loop.usdc --loop 24
    """,
)
@click.argument("cache", type=readable_path())
@output_option("One plain USD file (.usd, .usdc, .usda).")
@click.option(
    "--speed",
    type=RealNumber(min=0.0, min_open=True),
    help="Speed factor: 0.25 is four times slower, 2 twice as fast.",
)
@click.option(
    "--keys",
    type=pairs("NEW:OLD,...", ":", ",", "keys", "1:1,24:12,48:48"),
    help="New frames and those of the cache that they show.",
)
@click.option(
    "--loop",
    type=WholeNumber(min=1),
    help="Frames at the end of the cache that become a loop; those before them are faded in.",
)
@overwrite_option("Replace a file that exists.")
@progress_option
def retime(
    cache: Path,
    output: Path,
    speed: float | None,
    keys: list[tuple[float, float]] | None,
    loop: int | None,
    overwrite: bool,
    style: str,
) -> None:
    """Write CACHE (a USD file of featherfx) in another time, without simulating it anew.

    Points follow the velocities between frames; velocities are those of the new motion. A loop's
    last frame is its first.
    """
    if sum(each is not None for each in (speed, keys, loop)) != 1:
        raise click.UsageError("Give one of --speed, --keys and --loop")
    with Progress("frames", style):
        pipeline.retime(cache, output, speed=speed, keys=keys, loop=loop, overwrite=overwrite)
    click.echo(str(output), err=True)


@click.command(
    cls=Command,
    epilog="""
    featherfx sculpt wing.usdc --with poses.usd -o sculpted.usdc
    featherfx sculpt wing.usdc --with poses.usd -o sculpted.usdc --fade 12
    """,
)
@click.argument("cache", type=readable_path())
@click.option(
    "--with",
    "poses",
    type=readable_path(),
    required=True,
    help="Meshes or curves named by feather id; their time samples are the frames they hold.",
)
@output_option("One plain USD file (.usd, .usdc, .usda).")
@click.option(
    "--fade",
    type=RealNumber(min=0.0),
    default=6.0,
    show_default=True,
    help="Frames before the first and after the last pose within which it comes and goes; 0: it "
    "holds to both ends.",
)
@overwrite_option("Replace a file that exists.")
@progress_option
def sculpt(
    cache: Path, poses: Path, output: Path, fade: float, overwrite: bool, style: str
) -> None:
    """Write CACHE (a USD file of featherfx) with feathers brought to drawn poses.

    Rachises and barbs keep their lengths, and roots their places. What is not reached is told.
    """
    with Progress("frames", style):
        pipeline.sculpt(cache, output, poses=poses, fade=fade, overwrite=overwrite)
    click.echo(str(output), err=True)
