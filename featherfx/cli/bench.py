"""`featherfx bench`: run time against error, measured on this machine."""

from __future__ import annotations

import json
import os
from dataclasses import fields
from typing import Any

import click

from featherfx._version import __version__
from featherfx.baking.pipeline import read_shot
from featherfx.cli.options import options_of, output_option
from featherfx.cli.program import Command
from featherfx.cli.progress import Progress
from featherfx.lab.bench import birds, contact, experiments, peers
from featherfx.lab.bench.promise import measure_promises
from featherfx.lab.bench.report import (
    BenchOptions,
    ResultTable,
    machine,
    page,
    write,
    write_files,
)
from featherfx.lab.bench.skips import skips_table

_TABLES, _PEER_TABLES = 7, 3


def run_benchmarks(options: BenchOptions) -> None:
    """Measure, and print the page or write the files. Exit code 1 if a promised error is broken."""
    if options.peers:
        _beside_peers(options)
        return
    if options.promise:
        _promise(options)
        return
    tables: list[ResultTable] = []
    output, jobs = options.output, options.jobs or os.cpu_count() or 1
    if options.skips:
        shots = [read_shot(path) for path in options.skips]
        with Progress("skips") as progress:
            rest = (options.only, options.frames, options.every)
            tables.append(skips_table(shots, progress, *rest))
    elif options.birds:
        with Progress("bakes") as progress:
            some = birds.QUICK_BIRDS if options.quick else birds.FULL_BIRDS
            tables.append(birds.birds_table(some, progress))
    elif options.contact:
        stacks = contact.QUICK_STACKS if options.quick else contact.FULL_STACKS
        tables += contact.contact_tables(stacks)
    else:
        extent = experiments.QUICK_EXTENT if options.quick else experiments.FULL_EXTENT
        with Progress("tables") as progress:
            for table in experiments.all_tables(extent, jobs):
                tables.append(table)
                if output is not None:
                    write(output, tables, __version__)
                progress(len(tables), _TABLES)
    if output is None:
        click.echo(json.dumps(tables[0].rows) if options.as_json else page(tables, __version__))
    else:
        for file in write(output, tables, __version__):
            click.echo(file)


def _beside_peers(options: BenchOptions) -> None:
    tables = []
    with Progress("tables") as progress:
        for table in peers.peer_tables(peers.QUICK_RATES if options.quick else peers.FULL_RATES):
            tables.append(table)
            progress(len(tables), _PEER_TABLES)
    if options.output is None:
        click.echo(peers.peer_page(tables, __version__))
        return
    for file in write_files(options.output, peers.peer_files(tables, __version__)):
        click.echo(file)


def _promise(options: BenchOptions) -> None:
    """Measure random shots; print or write counts and cases. Exit code 1 if any is broken."""
    assert options.promise is not None
    with Progress("shots") as progress:
        found = measure_promises(options.promise, options.seed, progress)
    if options.output is not None:
        record = {"machine": machine(__version__), "seed": options.seed, **found}
        text = json.dumps(record, indent=1) + "\n"
        for file in write_files(options.output, {"promise.json": text.encode()}):
            click.echo(file)
    elif options.as_json:
        click.echo(json.dumps(found))
    else:
        for case in found["cases"]:
            click.echo(
                f"{case['outcome']:9} shot {case['seed']}, {case['feather']}: reached"
                f" {case['reached']:.3g} of {case['promised']:g} %"
            )
        names = "kept", "broken", "undefined", "told"
        click.echo(", ".join(f"{found[name]} {name}" for name in names))
    if found["broken"]:
        click.get_current_context().exit(1)


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

    run_benchmarks(options)
