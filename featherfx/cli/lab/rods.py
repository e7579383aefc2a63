"""`featherfx lab rod`, `modes` and `release`: rods clamped at the origin."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import click

from featherfx.cli.lab.common import Vector, json_option, options, show
from featherfx.cli.program import Command

if TYPE_CHECKING:
    from featherfx.lab.rods.rod import Rod

ROD_KEYS = (
    "length",
    "ei",
    "ei2",
    "gj",
    "ea",
    "ga",
    "taper",
    "rest_curvature",
    "line_mass",
    "line_weight",
    "segments",
)

rod_options = options(
    click.option("--length", type=float, required=True, help="m."),
    click.option("--ei", type=float, required=True, help="Bending in the xy plane, N m^2."),
    click.option(
        "--ei2", type=float, help="Bending out of the xy plane, N m^2.  [default: that of --ei]"
    ),
    click.option("--gj", type=float, help="Torsion, N m^2.  [default: that of --ei]"),
    click.option("--ea", type=float, help="Stretch, N.  [default: inextensible]"),
    click.option("--ga", type=float, help="Shear, N.  [default: unshearable]"),
    click.option(
        "--taper",
        type=float,
        default=0.0,
        show_default=True,
        help="Share C of the width lost at the tip: stiffness (1 - C s/L)^4, mass (1 - C s/L)^2.",
    ),
    click.option(
        "--rest-curvature",
        type=float,
        default=0.0,
        show_default=True,
        help="1/m, in the xy plane, towards +y.",
    ),
    click.option(
        "--segments", type=int, default=40, show_default=True, help="Elements of the rod."
    ),
)
weight_option = click.option(
    "--line-weight",
    type=float,
    default=0.0,
    show_default=True,
    help="N/m at the clamp, along -z; tapers as the mass does.",
)
mass_option = click.option(
    "--line-mass", type=float, default=1.0, show_default=True, help="kg/m at the clamp."
)


@click.command(
    cls=Command,
    short_help="Bend a rod by its weight and a force at its tip.",
    epilog="""
    featherfx lab rod --length 1 --ei 1 --tip-force 0,0,-2
    featherfx lab rod --length 78.54 --ei 833333 --rest-curvature 0.01 --tip-force 0,0,300 --json
    """,
)
@rod_options
@weight_option
@click.option("--tip-force", type=Vector(), default=(0.0, 0.0, 0.0), help="N, keeps its direction.")
@json_option
def rod(tip_force: tuple[float, float, float], as_json: bool, **values: Any) -> None:
    """Equilibrium of a clamped rod."""
    from featherfx.lab.rods.experiments import bend

    result = bend(_rod(values), tip_force)
    show(
        {
            "tip": result.tip.tolist(),
            "points": result.points.tolist(),
            "iterations": result.iterations,
            "residual": result.residual,
            "seconds": result.seconds,
        },
        as_json,
    )


@click.command(
    cls=Command,
    short_help="Natural frequencies of a rod.",
    epilog="featherfx lab modes --length 1 --ei 1 --line-mass 1 --count 4",
)
@rod_options
@mass_option
@click.option("--count", type=int, default=4, show_default=True, help="Frequencies wanted.")
@json_option
def modes(count: int, as_json: bool, **values: Any) -> None:
    """Lowest natural frequencies of a clamped rod about its rest shape.

    A frequency of two modes is listed twice; with --ei2 equal to --ei all of a straight rod's
    bending frequencies are.
    """
    from featherfx.lab.rods.experiments import natural_frequencies

    show({"frequencies_hz": natural_frequencies(_rod(values), count).tolist()}, as_json)


@click.command(
    cls=Command,
    short_help="Let go a rod that was held straight.",
    epilog="featherfx lab release --length 1 --ei 1 --line-weight 1 --duration 4 --tolerance 1e-5",
)
@rod_options
@weight_option
@mass_option
@click.option("--duration", type=float, required=True, help="s.")
@click.option(
    "--tolerance",
    type=float,
    default=1e-4,
    show_default=True,
    help="m, local error that a step may have.",
)
@click.option(
    "--loss-factor",
    type=float,
    default=0.0,
    show_default=True,
    help="Of the material, at the first natural frequency.",
)
@click.option(
    "--samples", type=int, default=100, show_default=True, help="Output times after the first."
)
@click.option(
    "--radius",
    type=float,
    default=0.8,
    show_default=True,
    help="1 conserves energy, 0 damps most of what a step does not resolve.",
)
@json_option
def release(
    duration: float,
    tolerance: float,
    loss_factor: float,
    samples: int,
    radius: float,
    as_json: bool,
    **values: Any,
) -> None:
    """Release a rod at rest from the straight pose under its weight."""
    from featherfx.lab.rods.experiments import release as let_go

    swing = let_go(
        _rod(values),
        duration,
        tolerance,
        loss_factor=loss_factor,
        samples=samples,
        radius=radius,
    )
    show(
        {
            "time": swing.time.tolist(),
            "tip": swing.tip.tolist(),
            "energy": swing.energy.tolist(),
            "steps": swing.steps,
            "seconds": swing.seconds,
        },
        as_json,
    )


def _rod(values: dict[str, Any]) -> Rod:
    from featherfx.lab.rods.rod import Rod

    return Rod(**{key: value for key, value in values.items() if key in ROD_KEYS})
