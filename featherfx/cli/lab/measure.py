"""`featherfx lab measure`: figures of the pages, measured again on this machine."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Iterable
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import click

from featherfx.baking import corpus
from featherfx.baking.pipeline import bake
from featherfx.cli.lab.options_from import show
from featherfx.cli.options import WholeNumber, json_option, readable_path
from featherfx.cli.program import Command, CommandGroup
from featherfx.files.folders import shipped
from featherfx.lab.measure import plumage, program

_SAMPLES = shipped("samples")
_QUICK = ("swan_wing", "feather_pull", "breeze")  # take seconds
_COMPILED = {
    "bake": "swan_wing",
    "contact": "flapping_bird",
    "bird": "pigeon",
}  # works, and their samples


@click.group(cls=CommandGroup, short_help="Measure figures of the pages again.")
def measure() -> None:
    """Measure again what the pages say about this program, and print it.

    Times only mean something on a machine that does nothing else.
    """


def _row(*cells: object) -> None:
    click.echo(f"| {' | '.join('' if each is None else str(each) for each in cells)} |")


def _table(titles: str, rows: Iterable[Iterable[object]]) -> None:
    _row(*titles.split(", "))
    click.echo("|---" * len(titles.split(", ")) + "|")
    for row in rows:
        _row(*row)


@measure.command("house", cls=Command)
@click.argument("folder", type=readable_path(), required=False)
def measure_house(folder: Path | None) -> None:
    """Files and lines of each package, what it holds, and what to change there.

    FOLDER: another package than featherfx.
    """
    for line in program.package_table(folder or Path(program.__file__).parents[2]):
        click.echo(line)


@measure.command("shot", cls=Command)
@click.argument("shots", type=readable_path(), nargs=-1)
@json_option()
def measure_shot(shots: tuple[Path, ...], as_json: bool) -> None:
    """Times, iterations and exactness of shots.

    SHOTS: by default samples that take seconds.
    """
    for shot in shots or [_SAMPLES / name / "shot.toml" for name in _QUICK]:
        show(program.shot_figures(shot), as_json)


@measure.command("corpus", cls=Command)
@click.argument("paths", type=readable_path(), nargs=-1, required=True)
@json_option()
def measure_corpus(paths: tuple[Path, ...], as_json: bool) -> None:
    """Try foreign USD files: inspect, groom each mesh, bake three frames, check.

    PATHS: files, and folders with all below them.
    """
    outcomes = corpus.try_files(corpus.list_files(paths))
    if as_json:
        show(list(outcomes), True)
        return
    titles = "file, meshes, moving, inspect, groom, bake, check, root error (mm), crashes"
    _table(titles, corpus.outcome_rows(outcomes))


@measure.command("scaling", cls=Command)
@click.argument("preset", default="swan_primary")
def measure_scaling(preset: str) -> None:
    """Droop and first frequency of a feather that is held level, by rule of scaling and size."""
    _table(
        "rule, size, tip down (%), barbs down (%), first frequency (Hz)",
        (
            (rule, f"{size:g}", f"{100 * tip:.2f}", f"{100 * barbs:.2f}", f"{rate:.2f}")
            for rule, size, tip, barbs, rate in program.scaling_rows(preset)
        ),
    )


@measure.command("kernels", cls=Command)
def measure_kernels() -> None:
    """Times of the kernels of a Newton iteration; set OPENBLAS_NUM_THREADS=1."""
    _table(
        "feather, kernel, microseconds, million operations, of the peak",
        (
            (name, each, f"{spent:.0f}", count and f"{count / 1e6:.3g}", part and f"{part:.0%}")
            for name, each, spent, count, part in program.kernel_rows()
        ),
    )


@measure.command("compiling", cls=Command)
@click.argument("shot", type=readable_path(), required=False)
@click.option("--write", is_flag=True, help="Write the seconds that progress goes by instead.")
@click.option("--work", type=click.Choice(["layout", *_COMPILED]), hidden=True)
def measure_compiling(shot: Path | None, write: bool, work: str | None) -> None:
    """Processor seconds of compiling in a first bake, by entry.

    SHOT: by default the sample swan_wing.
    """
    if work is not None:
        click.echo(json.dumps(program.measure_entries(lambda: _do(work))))
        return
    if write:
        click.echo(program.write_seconds(["layout", *_COMPILED]))
        return
    entries = program.shot_entries(shot or _SAMPLES / "swan_wing/shot.toml")
    total = "all", sum(each[1] for each in entries), sum(each[2] for each in entries)
    _table(
        "entry, types and lowering (s), LLVM (s)",
        (
            (name.rpartition(".")[2], f"{front:.2f}", f"{llvm:.2f}")
            for name, front, llvm in (*entries, total)
            if front + llvm > 0.1
        ),
    )


@measure.command("calls", cls=Command)
def measure_calls() -> None:
    """Write which kernels works call, for which types: what a bake compiles ahead."""
    click.echo(program.write_calls({work: partial(_do, work) for work in _COMPILED}))


def _do(work: str) -> None:
    """Do what needs kernels of a kind."""
    if work == "layout":
        from featherfx.api import read_groom

        read_groom(_SAMPLES / "pigeon/groom.toml")
        return
    with TemporaryDirectory() as folder:
        shot = _SAMPLES / _COMPILED[work] / "shot.toml"
        bake(shot, Path(folder) / "out.usdc", frames=(1, 2), quality="draft", jobs=2)


@measure.command("plumage", cls=Command)
@click.argument("counts", type=WholeNumber(min=1), nargs=-1)
@click.option("--swan", is_flag=True, help="On a swan that moves, with guides.")
@click.option("--frames", type=WholeNumber(min=2), default=5, show_default=True)
@click.option("--jobs", type=WholeNumber(min=1), default=1, show_default=True)
@click.option("--as", "form", default="mesh", show_default=True, help="What is written.")
@click.option(
    "-o",
    "--output",
    type=click.Path(path_type=Path, file_okay=False),
    help="Folder that keeps inputs and results.",
)
def measure_plumage(
    counts: tuple[int, ...], swan: bool, frames: int, jobs: int, form: str, output: Path | None
) -> None:
    """Time, memory and size of bakes of plumage, by number of feathers.

    COUNTS: by default 20 to 5,000, and for a swan its own number, 25,000. "Each" is processor
    time of simulating and writing, over feathers and frames.
    """
    write = plumage.write_swan if swan else plumage.write_patch
    with TemporaryDirectory() as temporary:
        rows = (
            _baked(write, (output or Path(temporary)) / str(count), count, frames, jobs, form)
            for count in counts or ([25_000] if swan else [20, 50, 100, 200, 500, 1000, 5000])
        )
        _table("feathers, wall s, processor s, set up s, simulating s, each ms, GB, MB", rows)


def _baked(
    write: Any, folder: Path, count: int, frames: int, jobs: int, form: str
) -> tuple[object, ...]:
    """Bake plumage in a process of its own, and return a row of its figures."""
    folder.mkdir(parents=True, exist_ok=True)
    shot, out = write(folder, count, frames), folder / "cache"
    out.mkdir(exist_ok=True)
    command = [sys.executable, "-m", "featherfx", "bake", shot, "-o", out / "plumage.usdc"]
    command += ["--report", folder / "report.json", "--overwrite", "--jobs", str(jobs)]
    command += ["--as", form, *(["--group", "region"] if form == "condensed" else [])]
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL, env=os.environ)
    report = json.loads((folder / "report.json").read_text())
    seconds, feathers = report["seconds"], report["feathers"]
    written = sum(path.stat().st_size for path in out.rglob("*") if path.is_file())
    return (
        feathers,
        f"{report['wall_seconds']:.1f}",
        f"{report['processor_seconds']:.1f}",
        f"{seconds['setting_up']:.1f}",
        f"{seconds['simulating']:.1f}",
        f"{1e3 * (seconds['simulating'] + seconds['writing']) / (feathers * frames):.2f}",
        f"{report['peak_memory_bytes'] / 1e9:.2f}",
        f"{written / 1e6:.1f}",
    )
