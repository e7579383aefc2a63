"""`featherfx lab feather`: one feather, shaken or pulled at its tip."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from featherfx.cli.lab.common import Vector, json_option, show
from featherfx.cli.options import presets_option
from featherfx.cli.program import Command


@click.command(
    cls=Command,
    short_help="Shake a feather or pull at its tip.",
    epilog="""
    featherfx lab feather --preset swan_primary --shake-amplitude 0.05 --shake-frequency 3
    featherfx lab feather --preset tail_feather --pull 0,0,0.05 --duration 1 --json
    """,
)
@click.option("--preset", required=True, metavar="NAME", help="Feather preset.")
@click.option(
    "--kinematics",
    type=click.Choice(["nodal", "barb-curvature"]),
    default="barb-curvature",
    show_default=True,
    help="nodal: every node is free, the reference.",
)
@click.option("--rows", type=int, default=21, show_default=True, help="Rachis rows.")
@click.option("--columns", type=int, default=6, show_default=True, help="Barb columns a side.")
@click.option(
    "--coefficients",
    type=int,
    default=2,
    show_default=True,
    help="Curvature coefficients per barb and direction; 0: rigid barbs.",
)
@click.option("--shake-amplitude", type=float, help="m, of the root along z.")
@click.option("--shake-frequency", type=float, help="Hz.")
@click.option("--pull", type=Vector(), help="m, displacement of the tip, reached at the end.")
@click.option("--duration", type=float, default=0.5, show_default=True, help="s.")
@click.option(
    "--tolerance",
    type=float,
    default=1e-4,
    show_default=True,
    help="m, local error that a step may have.",
)
@click.option("--fixed-step", type=float, metavar="DT", help="s, instead of the error control.")
@presets_option
@json_option
def feather(
    shake_amplitude: float | None,
    shake_frequency: float | None,
    preset_folders: tuple[Path, ...],
    as_json: bool,
    **options: Any,
) -> None:
    """Settle a feather under gravity in vacuum, then shake its root or pull at its tip."""
    if (shake_amplitude is None) != (shake_frequency is None):
        raise click.UsageError("--shake-amplitude and --shake-frequency belong together")
    if shake_amplitude is not None and options["pull"] is not None:
        raise click.UsageError("--pull and --shake-amplitude exclude each other")

    from featherfx.lab.feathers.feather import FeatherTest, run_feather

    shake = None
    if shake_amplitude is not None and shake_frequency is not None:
        shake = (shake_amplitude, shake_frequency)
    run = run_feather(FeatherTest(shake=shake, **options), preset_folders)
    show(
        {
            "points": run.points.tolist(),
            "iterations_per_step": run.iterations_per_step,
            "steps": run.steps,
            "unknowns": run.unknowns,
            "barb_strain_max": run.barb_strain_max,
            "seconds": run.seconds,
            "seconds_assembly": run.seconds_assembly,
            "seconds_solve": run.seconds_solve,
        },
        as_json,
    )
