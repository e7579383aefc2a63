"""The `featherfx` command. Commands import what they need when they run, not before."""

from __future__ import annotations

import click

from featherfx._version import __version__
from featherfx.cli.bake import bake, groom, join
from featherfx.cli.bench import bench
from featherfx.cli.check import check
from featherfx.cli.completion import completion
from featherfx.cli.doctor import doctor
from featherfx.cli.export import export, retime
from featherfx.cli.inspect import inspect
from featherfx.cli.lab.group import lab
from featherfx.cli.plugins import plugins
from featherfx.cli.presets import presets, sample, schema
from featherfx.cli.preview import preview
from featherfx.cli.program import Program, leave
from featherfx.cli.stats import error, stats
from featherfx.cli.trace import trace
from featherfx.cli.tune import tune
from featherfx.cli.view import view


@click.group(cls=Program, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(__version__, prog_name="featherfx")
def main() -> None:
    """Feathers from groom files to simulated USD caches.

    Exit codes: 0 done, 1 the input is wrong or the work failed, 2 wrong usage.
    """


for command in (
    bake,
    join,
    export,
    retime,
    groom,
    check,
    inspect,
    schema,
    stats,
    error,
    presets,
    trace,
    sample,
    preview,
    view,
    tune,
    lab,
    bench,
    plugins,
    doctor,
    completion,
):
    main.add_command(command)


def run() -> None:
    """The command as a process of its own."""
    try:
        main(prog_name="featherfx")
    except SystemExit as end:
        leave(end.code)
        raise
