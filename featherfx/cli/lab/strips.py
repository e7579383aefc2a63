"""`featherfx lab strip`: the scene for runs beside other simulators."""

from __future__ import annotations

from typing import Any

import click

from featherfx.cli.lab.common import json_option, show
from featherfx.cli.program import Command


@click.command(
    cls=Command,
    short_help="Let a clamped strip fall, as other simulators do.",
    epilog="""
    featherfx lab strip --scene iso --dt 0.0125
    featherfx lab strip --scene feather --dt 0.01 --kinematics barb-curvature --json
    """,
)
@click.option(
    "--scene",
    type=click.Choice(["iso", "feather"]),
    required=True,
    help="iso: an isotropic plate. feather: stiff barbs, a soft vane, a rachis.",
)
@click.option("--dt", "step", type=float, required=True, metavar="DT", help="s, longest step.")
@click.option(
    "--kinematics",
    type=click.Choice(["nodal", "barb-curvature"]),
    default="nodal",
    show_default=True,
    help="barb-curvature: for the feather.",
)
@click.option(
    "--columns", type=int, default=6, show_default=True, help="Cells to each side of the middle."
)
@click.option(
    "--refinement",
    type=int,
    default=1,
    show_default=True,
    help="Cells along the strip, in hundreds.",
)
@click.option(
    "--coefficients",
    type=int,
    default=2,
    show_default=True,
    help="Curvature coefficients per barb and direction.",
)
@click.option(
    "--method",
    type=click.Choice(["improved", "textbook"]),
    default="improved",
    show_default=True,
    help="Of the nodal Newton iterations.",
)
@click.option(
    "--stretch",
    type=click.Choice(["stiff", "inextensible"]),
    default="stiff",
    show_default=True,
    help="Of nodal barbs.",
)
@click.option(
    "--radius",
    type=float,
    default=0.8,
    show_default=True,
    help="1 conserves energy, 0 damps most of what a step does not resolve.",
)
@click.option(
    "--newton",
    type=float,
    default=1e-5,
    show_default=True,
    help="m, last move of a step's iterations.",
)
@json_option
def strip(as_json: bool, **options: Any) -> None:
    """Let a strip of 0.25 x 0.05 m, held at its first two node columns, fall from rest.

    Steps between two output times are equal and not longer than DT.
    """
    from featherfx.lab.feathers.strip import StripTest, run_strip

    run = run_strip(StripTest(**options))
    show(
        {
            "time": run.time.tolist(),
            "tip": run.tip.tolist(),
            "strain_max": run.strain_max,
            "cpu_seconds": run.cpu_seconds,
            "steps": run.steps,
            "iterations": run.iterations,
            "unknowns": run.unknowns,
        },
        as_json,
    )
