"""`featherfx lab`: virtual experiments, imported when one of them is asked for."""

from __future__ import annotations

from math import degrees
from pathlib import Path
from typing import Any

import click

from featherfx.cli.options import presets_option
from featherfx.cli.program import Command, CommandGroup, plain, print_json


@click.command(
    cls=Command,
    epilog="""
    featherfx lab motion samples/swan_wing/shot.toml
    featherfx lab motion samples/swan_wing/shot.toml --json
    """,
)
@click.argument("shot", type=click.Path(path_type=Path))
@presets_option
@click.option("--json", "as_json", is_flag=True, help="All joints by frame, SI units, radians.")
def motion(shot: Path, preset_folders: tuple[Path, ...], as_json: bool) -> None:
    """Print how the joints of a shot move.

    A line a frame and wing: elevation, sweep, twist, elbow and wrist in degrees, the fan of the
    hand (1 open, 0 folded), and the span over the largest one of the shot. --json has joints, too:
    position (m) and rotation (quaternion w, x, y, z), and the share of a beat in which a wing
    falls.
    """
    from featherfx.api import read_shot
    from featherfx.shot.motion.joint_tracks import find_tracks, frame_rows, rate_lines

    read = read_shot(shot, preset_folders)
    tracks = find_tracks(read)
    rows = list(frame_rows(read, tracks))
    if as_json:
        print_json(plain({"frames": rows, "rates": tracks.largest_rates()}))
        return
    for row in rows:
        for side, wing in row["wings"].items():
            click.echo(f"frame {row['frame']:4}  {side:5}  {_angles(wing)}")
    for side, wing in tracks.wings.items():
        share = wing.downstroke
        told = "makes no whole beat" if share is None else f"falls for {share:.0%} of a beat"
        click.echo(f"{side} wing {told}")
    for line in rate_lines(tracks.largest_rates()):
        click.echo(line)


def _angles(wing: dict[str, Any]) -> str:
    bends = ("elevation", "sweep", "twist", "elbow", "wrist")
    angles = "  ".join(f"{name} {degrees(wing[name]):6.1f}" for name in bends)
    return f"{angles}  fan {wing['fan']:.2f}  span {wing['span_ratio']:.3f}"


_EXPERIMENTS = {
    "rod": "Bend a rod by its weight and a force at its tip.",
    "modes": "Natural frequencies of a rod, or of a feather in vacuum or air.",
    "air": "Force of a stream of air on a feather, by angle.",
    "fall": "Let a feather fall freely in still air.",
    "release": "Let go a rod that was held straight.",
    "feather": "Shake a feather or pull at its tip.",
    "strip": "Let a clamped strip fall, as other simulators do.",
    "plate": "Bend a rectangular vane of any bending moduli by its weight.",
    "contact": "Stack, slide and throw plates: how contact carries load, beside closed forms.",
    "ribbon": "Hang a ribbon of natural curvature by one end.",
    "fullfeather": "Pull a whole feather in its plane, with one of three vane materials.",
    "unitcell": "Moduli of a vane from its barbs and barbules.",
    "network": "Moduli of a lattice or a random network of fibres.",
    "precondition": "Iterations and time of solving a network, by method and preconditioner.",
    "traction": "Pull a rectangular sample of a vane.",
    "locking": "Error of a tilted test against elements, for ratios of the moduli.",
    "mesoscale": "Barbs as stiff bands, barbules as soft ones.",
    "tear": "Pull a hooked vane apart.",
    "cycle": "Load and unload a hooked vane in turns.",
    "rupture": "Pull a membrane of fibres, such as skin, until it tears.",
    "calibrate": "Moduli of a vane from stress-strain curves.",
    "report": "Run all studies; one page with our numbers beside the published ones.",
    "angles": "Membrane beside bands at all angles, and the shear band.",
}


class Lab(CommandGroup):
    """Lists its commands without their options, which are made when a command is called."""

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        name, command, rest = super().resolve_command(ctx, args)
        if name == "measure":
            from featherfx.cli.lab.measure import measure as command
        elif name == "motion":
            command = motion
        elif name in _EXPERIMENTS:
            from featherfx.cli.lab.experiments import COMMANDS

            command = COMMANDS[name]
        return name, command, rest


def _list(context: click.Context, _: click.Parameter, value: bool) -> None:
    """Print the experiments, then the studies and what each reproduces."""
    if not value or context.resilient_parsing:
        return
    from featherfx.lab.studies.study import STUDIES

    width = max(len(name) for name in (*lab.commands, *(study.name for study in STUDIES)))
    click.echo("experiments")
    for name, command in sorted(lab.commands.items()):
        click.echo(f"  {name.ljust(width)}  {command.short_help}")
    click.echo("studies (featherfx lab report --only NAME)")
    for study in STUDIES:
        click.echo(f"  {study.name.ljust(width)}  {study.title} ({study.reproduces})")
    context.exit()


@click.group(
    cls=Lab,
    epilog="""
    featherfx lab --list
    featherfx lab rod --length 1 --ei 1 --tip-force 0,0,-2 --json
    """,
)
@click.option(
    "--list",
    is_flag=True,
    is_eager=True,
    expose_value=False,
    callback=_list,
    help="List the experiments and the studies, with what each reproduces.",
)
def lab() -> None:
    """Run virtual experiments on rods and feathers.

    Rods are clamped at the origin and leave along +x; weight acts along -z.
    """


lab.add_command(Command("measure", short_help="Measure figures of the pages again."))
lab.add_command(
    Command("motion", short_help="Move the joints of a shot, and print how wings beat.")
)
for experiment, meaning in _EXPERIMENTS.items():
    lab.add_command(Command(experiment, short_help=meaning))
