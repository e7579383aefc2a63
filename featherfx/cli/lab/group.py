"""`featherfx lab`: virtual experiments, each family in a file of its own."""

from __future__ import annotations

import click

from featherfx.cli.lab.feathers import feather
from featherfx.cli.lab.full_feather import fullfeather
from featherfx.cli.lab.report import listing, report
from featherfx.cli.lab.ribbons import ribbon
from featherfx.cli.lab.rods import modes, release, rod
from featherfx.cli.lab.strips import strip
from featherfx.cli.lab.unit_cell import unitcell
from featherfx.cli.lab.vane import angles, calibrate, locking, mesoscale, traction
from featherfx.cli.program import Group


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


for experiment in (rod, modes, release, feather, strip, ribbon, fullfeather, unitcell, report):
    lab.add_command(experiment)
for experiment in (traction, locking, mesoscale, calibrate, angles):
    lab.add_command(experiment)
