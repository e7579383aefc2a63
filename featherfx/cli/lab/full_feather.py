"""`featherfx lab fullfeather`."""

from __future__ import annotations

from typing import Any

import click

from featherfx.cli.lab.common import show
from featherfx.cli.program import Command


@click.command(
    cls=Command,
    short_help="Pull a whole feather in its plane, with one of three vane materials.",
    epilog="""
    featherfx lab fullfeather --scene side
    featherfx lab fullfeather --scene tip --material isotropic --distance 0.2 --json
    """,
)
@click.option(
    "--scene",
    type=click.Choice(["tip", "side"]),
    required=True,
    help="Pull the rachis' tip, or the edge of the trailing vane.",
)
@click.option(
    "--material",
    type=click.Choice(["barbs", "cloth", "isotropic"]),
    default="barbs",
    show_default=True,
    help="Of the vane.",
)
@click.option("--distance", type=float, default=0.1, show_default=True, help="Share of the length.")
@click.option("--parts", type=int, default=10, show_default=True, help="Equal steps of the pull.")
@click.option("--rows", type=int, default=41, show_default=True, help="Rachis rows.")
@click.option("--columns", type=int, default=8, show_default=True, help="Barb columns a side.")
@click.option("--nodal", is_flag=True, help="Barbs in the nodal kinematics, as a check.")
@click.option("--json", "as_json", is_flag=True, help="One JSON object on the output, SI units.")
def fullfeather(material: str, nodal: bool, as_json: bool, **options: Any) -> None:
    """Pull a flat feather of 0.2 m, held at its base, along the plane of its vane.

    Keys: rachis_deflection (over the length), barb_strain, force, wavelength (null or nan: no
    wrinkles) and amplitude of the wrinkles along the edges, iterations, seconds, points.
    """
    from featherfx.lab.feathers.full_feather import FullPull, pull_feather

    found = pull_feather(FullPull(**options), material, nodal=nodal)
    wavelength = found.wavelength if found.wavelength == found.wavelength else None
    show(
        {
            "rachis_deflection": found.rachis_deflection,
            "barb_strain": found.barb_strain,
            "force": found.force,
            "wavelength": wavelength if as_json else found.wavelength,
            "amplitude": found.amplitude,
            "iterations": found.iterations,
            "seconds": found.seconds,
            "points": found.points.tolist(),
        },
        as_json,
    )
