"""`featherfx bench`: run time against error, and stability, measured on this machine."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from featherfx.cli.options import output_option
from featherfx.cli.program import Command
from featherfx.lab.bench.options import QUICK_STRESS_CASES, STRESS_CASES, BenchOptions


@click.command(
    cls=Command,
    short_help="Measure run time against error, and stability.",
    epilog="""
    featherfx bench --quick
    featherfx bench -o measured
    featherfx bench --stress --cases 1000 -o measured
    featherfx bench --peers -o measured
    featherfx bench --skips samples/swan_wing/shot.toml
    featherfx bench --skips samples/pigeon/shot.toml --only "*guided" --frames 8
    featherfx bench --stress --cases 1000 --seed 1000 -o measured
    featherfx bench --stress --cases 200 --seed 7 --json
    """,
)
@click.option(
    "--quick", is_flag=True, help="A smaller set of settings, in two minutes of one core."
)
@click.option("--stress", is_flag=True, help="Random absurd cases instead of measurements.")
@click.option(
    "--peers", is_flag=True, help='Beside MuJoCo (extra "peers"): error against time of a strip.'
)
@click.option(
    "--skips",
    multiple=True,
    metavar="SHOT",
    type=click.Path(path_type=Path, exists=True, dir_okay=False),
    help="What skipping work saves and costs on a shot; once for each shot.",
)
@click.option(
    "--front", is_flag=True, help="What rows, columns, coefficients and steps miss and cost."
)
@click.option(
    "--promise",
    multiple=True,
    metavar="SHOT",
    type=click.Path(path_type=Path, exists=True, dir_okay=False),
    help="Whether a shot keeps the error that is promised; once for each shot.",
)
@click.option(
    "--error",
    multiple=True,
    type=click.FloatRange(0.01, 20),
    default=(0.5,),
    show_default=True,
    help="Of --promise: errors, percent of a feather's length. Repeatable.",
)
@click.option("--only", default="*", help="Of --skips: names of skips, with * and ?.")
@click.option(
    "--frames", type=click.IntRange(min=2), help="Of --skips and --promise: frames of each."
)
@click.option(
    "--every",
    type=click.IntRange(min=1),
    default=1,
    show_default=True,
    help="Of --skips and --promise: every n-th feather of each shot alone.",
)
@click.option(
    "--cases",
    type=click.IntRange(min=1),
    help=f"Number of random cases.  [default: {STRESS_CASES}, quick: {QUICK_STRESS_CASES}]",
)
@click.option(
    "--json",
    "as_json",
    is_flag=True,
    help="Of --stress: cases, stopped, violations, over_tolerance_share and seconds as JSON.",
)
@click.option("--seed", type=click.IntRange(min=0), default=0, show_default=True, help="First one.")
@click.option("--jobs", type=click.IntRange(min=1), help="Threads.  [default: all cores]")
@output_option(
    "Folder for the page, CSV, JSON and plots; without it the page goes to stdout.",
    required=False,
    file_okay=False,
)
def bench(**values: Any) -> None:
    """Measure the solver on this machine.

    Times only mean something on a machine that does nothing else; ratios within one run hold
    better. Plots need matplotlib (extra "plots"). Exit code 1 if a stress case breaks a promise.

    Tables are written as they come, so that a run that is broken off leaves those it had made.
    Outcomes of stress cases are kept in the output folder as they come: a run that was broken off
    goes on where it stood, and the report is about all cases in the folder.
    """
    options = BenchOptions(**values)
    kinds = options.stress, options.peers, options.front, options.skips, options.promise
    if sum(map(bool, kinds)) > 1:
        names = "--stress, --peers, --front, --skips and --promise"
        raise click.UsageError(f"{names} exclude each other")
    alone = (options.only, options.frames, options.every) == ("*", None, 1)
    if not (options.skips or options.promise) and not alone:
        raise click.UsageError("--only, --frames and --every go with --skips or --promise")
    if options.as_json and not options.stress:
        raise click.UsageError("--json goes with --stress")
    from featherfx.cli.lab.benchmarks import run_benchmarks

    run_benchmarks(options)
