"""`featherfx lab ribbon`."""

from __future__ import annotations

from typing import Any

import click

from featherfx.cli.lab.common import show
from featherfx.cli.program import Command


@click.command(
    cls=Command,
    short_help="Hang a ribbon of natural curvature by one end.",
    epilog="""
    featherfx lab ribbon --length 0.5 --width 0.01 --rigidity 2e-4 --density 0.1 --rest-curvature 60
    featherfx lab ribbon --length 0.2 --width 0.01 --rigidity 2e-4 --density 0.1 --sadowsky --json
    """,
)
@click.option("--length", type=float, required=True, help="m.")
@click.option("--width", type=float, required=True, help="m.")
@click.option("--tip-width", type=float, help="m, the width tapers linearly.  [default: width]")
@click.option(
    "--rigidity", type=float, required=True, help="N m, of the plate: Y h^3 / (12 (1 - nu^2))."
)
@click.option("--density", type=float, required=True, help="kg/m^2.")
@click.option("--rest-curvature", type=float, default=0.0, show_default=True, help="1/m.")
@click.option("--poisson", type=float, default=0.5, show_default=True, help="Poisson's ratio.")
@click.option("--elements", type=int, default=20, show_default=True, help="Of the ribbon.")
@click.option(
    "--grading", type=float, default=1.0, show_default=True, help="Above 1: finer at the clamp."
)
@click.option("--sadowsky", is_flag=True, help="The limit of a narrow ribbon.")
@click.option(
    "--clamp",
    type=click.Choice(["level", "down", "up"]),
    default="level",
    show_default=True,
    help="Direction at the clamp.",
)
@click.option("--planar", is_flag=True, help="Stay in the plane of the clamp, stable or not.")
@click.option("--json", "as_json", is_flag=True, help="One JSON object on the output, SI units.")
def ribbon(
    density: float, sadowsky: bool, clamp: Any, planar: bool, as_json: bool, **options: Any
) -> None:
    """Rest shape of a developable strip under its weight.

    Unknowns are its normal curvature and the slope of its rulings; gravity is along -y, the width
    along z. `stability` is the lowest eigenvalue of the energy's Hessian, in units of rigidity
    times width over length with curvatures times the length: negative where the shape is not
    stable, which only --planar shows.
    """
    from featherfx.lab.ribbons.energy import Ribbon
    from featherfx.lab.ribbons.experiments import hang

    body = Ribbon(surface_density=density, finite_width=not sadowsky, **options)
    hung = hang(body, clamp, planar=planar)
    rest, size = hung.rest, body.elements + 1
    show(
        {
            "tip": rest.curve.points[-1].tolist(),
            "points": rest.curve.points.tolist(),
            "curvature": rest.unknowns[:size].tolist(),
            "ruling": rest.unknowns[size:].tolist(),
            "out_of_plane": hung.out_of_plane,
            "energy": rest.energy,
            "stability": rest.stability,
            "iterations": rest.iterations,
            "residual": rest.residual,
            "seconds": hung.seconds,
        },
        as_json,
    )
