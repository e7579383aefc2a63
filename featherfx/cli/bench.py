"""`featherfx bench`: run time against error, measured on this machine."""

from __future__ import annotations

from dataclasses import fields
from typing import Any

import click

from featherfx.cli.options import options_of, output_option
from featherfx.cli.program import Command
from featherfx.lab.bench.options import BenchOptions


@click.command(
    cls=Command,
    epilog="""
    featherfx bench --quick
    featherfx bench -o measured
    featherfx bench --peers -o measured
    featherfx bench --contact
    featherfx bench --birds --quick --json
    featherfx bench --skips samples/swan_wing/shot.toml
    featherfx bench --skips samples/pigeon/shot.toml --only "*guided" --frames 8
    featherfx bench --promise 40 --seed 7 --json
    """,
)
@options_of(BenchOptions, *(each.name for each in fields(BenchOptions) if each.metadata))
@output_option(
    "Folder for the page, CSV, JSON and plots; without it the page goes to stdout.",
    required=False,
    file_okay=False,
)
def bench(**values: Any) -> None:
    """Measure the solver on this machine.

    Times only mean something on a machine that does nothing else; ratios within one run hold
    better. Plots need matplotlib (extra "plots"). Exit code 1 if a
    promised error is broken.

    Tables are written as they come, so that a run that is broken off leaves those it had made.
    """
    options = BenchOptions(**values)
    names = "peers", "contact", "birds", "skips", "promise"
    if sum(bool(getattr(options, name)) for name in names) > 1:
        told = ", ".join(f"--{name}" for name in names[:-1])
        raise click.UsageError(f"{told} and --{names[-1]} exclude each other")
    if not options.skips and (options.frames, options.every) != (None, 1):
        raise click.UsageError("--frames and --every go with --skips")
    if options.only != "*" and not options.skips:
        raise click.UsageError("--only goes with --skips")
    if options.as_json and not (options.promise or options.birds):
        raise click.UsageError("--json goes with --promise and --birds")
    from featherfx.cli.lab.benchmarks import run_benchmarks

    run_benchmarks(options)
