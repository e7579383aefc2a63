"""`featherfx lab`: virtual experiments on rods and feathers."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import click

from featherfx.cli.lab_full_feather import fullfeather
from featherfx.cli.lab_report import listing, report
from featherfx.cli.lab_ribbon import ribbon
from featherfx.cli.lab_unit_cell import unitcell
from featherfx.cli.options import presets_option
from featherfx.cli.program import Command, Group

if TYPE_CHECKING:
    from featherfx.lab.rod import Rod

Decorated = TypeVar("Decorated", bound=Callable[..., Any])
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


class Vector(click.ParamType):
    """X,Y,Z."""

    name = "X,Y,Z"

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> tuple[float, float, float]:
        if isinstance(value, tuple):
            return value
        try:
            x, y, z = (float(each) for each in value.split(","))
        except ValueError:
            self.fail(f"'{value}' is not three numbers such as 0,0,-1.5", param, ctx)
        return x, y, z


def _options(*options: Callable[[Decorated], Decorated]) -> Callable[[Decorated], Decorated]:
    def decorate(command: Decorated) -> Decorated:
        for option in reversed(options):
            command = option(command)
        return command

    return decorate


rod_options = _options(
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
json_option = click.option(
    "--json", "as_json", is_flag=True, help="One JSON object on the output, SI units."
)


def _list(context: click.Context, _: click.Parameter, value: bool) -> None:
    if not value or context.resilient_parsing:
        return
    for line in listing(lab.commands):
        click.echo(line)
    context.exit()


@click.group(
    cls=Group,
    short_help="Virtual experiments on rods and feathers.",
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


@lab.command(
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
def rod(tip_force: tuple[float, float, float], as_json: bool, **options: Any) -> None:
    """Equilibrium of a clamped rod."""
    from featherfx.lab.experiments import bend

    result = bend(_rod(options), tip_force)
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


@lab.command(
    cls=Command,
    short_help="Natural frequencies of a rod.",
    epilog="featherfx lab modes --length 1 --ei 1 --line-mass 1 --count 4",
)
@rod_options
@mass_option
@click.option("--count", type=int, default=4, show_default=True, help="Frequencies wanted.")
@json_option
def modes(count: int, as_json: bool, **options: Any) -> None:
    """Lowest natural frequencies of a clamped rod about its rest shape.

    A frequency of two modes is listed twice; with --ei2 equal to --ei all of a straight rod's
    bending frequencies are.
    """
    from featherfx.lab.experiments import natural_frequencies

    show({"frequencies_hz": natural_frequencies(_rod(options), count).tolist()}, as_json)


@lab.command(
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
    **options: Any,
) -> None:
    """Release a rod at rest from the straight pose under its weight."""
    from featherfx.lab.experiments import release as let_go

    swing = let_go(
        _rod(options),
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


@lab.command(
    cls=Command,
    short_help="Shake a feather or pull at its tip.",
    epilog="""
    featherfx lab feather --preset swan_primary --shake-amplitude 0.05 --shake-frequency 3
    featherfx lab feather --preset tail_feather --pull 0,0,0.05 --duration 1 --json
    """,
)
@click.option("--preset", required=True, metavar="NAME", help="Feather preset.")
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

    from featherfx.lab.feather import FeatherTest, run_feather

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


lab.add_command(report)
lab.add_command(ribbon)
lab.add_command(unitcell)
lab.add_command(fullfeather)


def _rod(options: dict[str, Any]) -> Rod:
    from featherfx.lab.rod import Rod

    return Rod(**{key: value for key, value in options.items() if key in ROD_KEYS})


def show(values: dict[str, Any], as_json: bool) -> None:
    """One JSON object, or a table: numbers beside their names, lists in lines below them."""
    if as_json:
        click.echo(json.dumps(values))
        return
    for name, value in values.items():
        if not isinstance(value, list):
            click.echo(f"{name:20} {value:.6g}")
        elif value and not isinstance(value[0], list):
            click.echo(f"{name:20} " + "  ".join(f"{each:.6g}" for each in value))
        else:
            click.echo(f"{name} ({len(value)})")
            for row in value:
                click.echo("  " + "  ".join(f"{each:12.6g}" for each in _flat(row)))


def _flat(row: list[Any]) -> list[float]:
    return [each for part in row for each in (_flat(part) if isinstance(part, list) else [part])]
