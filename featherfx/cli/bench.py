"""`featherfx bench`: run time against error, and stability, measured on this machine."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import click

from featherfx._version import __version__
from featherfx.cli.program import Command
from featherfx.cli.progress import Progress

TABLES, PEER_TABLES = 8, 2
STRESS_CASES, QUICK_STRESS_CASES = 10_000, 200
QUICK_ROWS, MOST_ROWS = 40, 200


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
    """,
)
@click.option("--quick", is_flag=True, help="A smaller set of settings, in about a minute.")
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
@click.option("--only", default="*", help="Of --skips: names of skips, with * and ?.")
@click.option("--frames", type=click.IntRange(min=2), help="Of --skips: frames of each shot.")
@click.option(
    "--every",
    type=click.IntRange(min=1),
    default=1,
    show_default=True,
    help="Of --skips: every n-th feather of each shot alone.",
)
@click.option(
    "--cases",
    type=click.IntRange(min=1),
    help=f"Number of random cases.  [default: {STRESS_CASES}, quick: {QUICK_STRESS_CASES}]",
)
@click.option("--seed", type=click.IntRange(min=0), default=0, show_default=True, help="First one.")
@click.option("--jobs", type=click.IntRange(min=1), help="Threads.  [default: all cores]")
@click.option(
    "-o",
    "--output",
    type=click.Path(path_type=Path, file_okay=False),
    help="Folder for the page, CSV, JSON and plots; without it the page goes to stdout.",
)
def bench(
    quick: bool,
    stress: bool,
    peers: bool,
    skips: tuple[Path, ...],
    only: str,
    frames: int | None,
    every: int,
    cases: int | None,
    seed: int,
    jobs: int | None,
    output: Path | None,
) -> None:
    """Measure the solver on this machine.

    Times only mean something on a machine that does nothing else; ratios within one run hold
    better. Plots need matplotlib (extra "plots"). Exit code 1 if a stress case breaks a promise.

    Tables are written as they come, so that a run that is broken off leaves those it had made.
    Outcomes of stress cases are kept in the output folder as they come: a run that was broken off
    goes on where it stood, and the report is about all cases in the folder.
    """
    if stress + peers + bool(skips) > 1:
        raise click.UsageError("--stress, --peers and --skips exclude each other")
    if not skips and (only != "*" or frames is not None or every != 1):
        raise click.UsageError("--only, --frames and --every go with --skips")
    if peers:
        _beside_peers(quick, output)
        return

    from featherfx.lab.bench.report import page, write

    jobs = jobs or os.cpu_count() or 1
    tables, outcome = [], None
    if skips:
        from featherfx.baking.pipeline import read_shot
        from featherfx.lab.bench.skips import skips_table

        shots = [read_shot(path) for path in skips]
        with Progress("skips") as progress:
            tables.append(skips_table(shots, progress, only, frames, every))
    elif stress:
        seeds = range(seed, seed + (cases or (QUICK_STRESS_CASES if quick else STRESS_CASES)))
        outcome = _stress(seeds, jobs, QUICK_ROWS if quick else MOST_ROWS, output)
    else:
        from featherfx.lab.bench.experiments import all_tables
        from featherfx.lab.bench.extent import FULL, QUICK

        with Progress("tables") as progress:
            for table in all_tables(QUICK if quick else FULL, jobs):
                tables.append(table)
                if output is not None:
                    write(output, tables, None, __version__)
                progress(len(tables), TABLES)
    if output is None:
        click.echo(page(tables, outcome, __version__))
    else:
        for file in write(output, tables, outcome, __version__):
            click.echo(file)
    if outcome is not None and outcome["violations"]:
        click.get_current_context().exit(1)


def _beside_peers(quick: bool, output: Path | None) -> None:
    from featherfx.lab.bench.peers import FULL, QUICK, peer_files, peer_page, peer_tables
    from featherfx.lab.bench.report import write_files

    tables = []
    with Progress("tables") as progress:
        for table in peer_tables(QUICK if quick else FULL):
            tables.append(table)
            progress(len(tables), PEER_TABLES)
    if output is None:
        click.echo(peer_page(tables, __version__))
        return
    for file in write_files(output, peer_files(tables, __version__)):
        click.echo(file)


def _stress(seeds: range, jobs: int, most_rows: int, folder: Path | None) -> dict[str, Any]:
    """Run the cases that the folder does not have yet; the summary of all that it then has."""
    from featherfx.lab.bench.records import append_record, read_records, summary
    from featherfx.lab.bench.stress import Outcome, as_record, run_seeds

    records = read_records(folder) if folder is not None else {}

    def keep(outcome: Outcome) -> None:
        records[outcome.seed] = as_record(outcome)
        if folder is not None:
            append_record(folder, records[outcome.seed])

    with Progress("cases") as progress:
        run_seeds([s for s in seeds if s not in records], jobs, most_rows, progress, keep)
    return summary([records[seed] for seed in sorted(records)])
