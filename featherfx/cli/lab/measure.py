"""`featherfx lab measure` and `bench`: figures of the pages, measured again on this machine."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Iterable
from dataclasses import fields
from functools import partial
from math import degrees
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import click

from featherfx._version import __version__
from featherfx.baking import check
from featherfx.baking.pipeline import bake, read_shot
from featherfx.cli.lab.options_from import show
from featherfx.cli.options import (
    WholeNumber,
    json_option,
    options_of,
    output_option,
    presets_option,
    readable_path,
)
from featherfx.cli.program import Command, CommandGroup, plain, print_json
from featherfx.cli.progress import Progress
from featherfx.files.folders import shipped
from featherfx.lab import program
from featherfx.lab.bench import contact, experiments, peers
from featherfx.lab.bench.promise import measure_promises
from featherfx.lab.bench.report import BenchOptions, ResultTable, machine, page, write, write_files
from featherfx.lab.bench.skips import FULL_BIRDS, QUICK_BIRDS, birds_table, skips_table

_SAMPLES = shipped("samples")
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
    for line in program.package_table(folder or Path(program.__file__).parents[1]):
        click.echo(line)


@measure.command("corpus", cls=Command)
@click.argument("paths", type=readable_path(), nargs=-1, required=True)
@json_option()
def measure_corpus(paths: tuple[Path, ...], as_json: bool) -> None:
    """Try foreign USD files: inspect, groom each mesh, bake three frames, check.

    PATHS: files, and folders with all below them.
    """
    outcomes = check.try_files(check.list_files(paths))
    if as_json:
        show(list(outcomes), True)
        return
    titles = "file, meshes, moving, inspect, groom, bake, check, root error (mm), crashes"
    _table(titles, check.outcome_rows(outcomes))


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
    write = program.write_swan if swan else program.write_patch
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


@click.command(
    cls=Command,
    epilog="""
    featherfx lab motion samples/swan_wing/shot.toml
    featherfx lab motion samples/swan_wing/shot.toml --json
    """,
)
@click.argument("shot", type=click.Path(path_type=Path))
@presets_option
@click.option("--json", "as_json", is_flag=True, help="All joints by frame, SI units, radians.")
def motion(shot: Path, preset_folders: tuple[Path, ...], as_json: bool) -> None:
    """Print how the joints of a shot move.

    A line a frame and wing: elevation, sweep, twist, elbow and wrist in degrees, the fan of the
    hand (1 open, 0 folded), and the span over the largest one of the shot. --json has joints, too:
    position (m) and rotation (quaternion w, x, y, z), and the share of a beat in which a wing
    falls.
    """
    from featherfx.api import read_shot
    from featherfx.shot.motion.joint_tracks import find_tracks, frame_rows, rate_lines

    read = read_shot(shot, preset_folders)
    tracks = find_tracks(read)
    rows = list(frame_rows(read, tracks))
    if as_json:
        print_json(plain({"frames": rows, "rates": tracks.largest_rates()}))
        return
    for row in rows:
        for side, wing in row["wings"].items():
            click.echo(f"frame {row['frame']:4}  {side:5}  {_angles(wing)}")
    for side, wing in tracks.wings.items():
        share = wing.downstroke
        told = "makes no whole beat" if share is None else f"falls for {share:.0%} of a beat"
        click.echo(f"{side} wing {told}")
    for line in rate_lines(tracks.largest_rates()):
        click.echo(line)


def _angles(wing: dict[str, Any]) -> str:
    bends = ("elevation", "sweep", "twist", "elbow", "wrist")
    angles = "  ".join(f"{name} {degrees(wing[name]):6.1f}" for name in bends)
    return f"{angles}  fan {wing['fan']:.2f}  span {wing['span_ratio']:.3f}"


_EXPERIMENTS = {
    "rod": "Bend a rod by its weight and a force at its tip.",
    "modes": "Natural frequencies of a rod, or of a feather in vacuum or air.",
    "air": "Force of a stream of air on a feather, by angle.",
    "fall": "Let a feather fall freely in still air.",
    "release": "Let go a rod that was held straight.",
    "feather": "Shake a feather or pull at its tip.",
    "strip": "Let a clamped strip fall, as other simulators do.",
    "plate": "Bend a rectangular vane of any bending moduli by its weight.",
    "contact": "Stack, slide and throw plates: how contact carries load, beside closed forms.",
    "ribbon": "Hang a ribbon of natural curvature by one end.",
    "fullfeather": "Pull a whole feather in its plane, with one of three vane materials.",
    "unitcell": "Moduli of a vane from its barbs and barbules.",
    "network": "Moduli of a lattice or a random network of fibres.",
    "precondition": "Iterations and time of solving a network, by method and preconditioner.",
    "traction": "Pull a rectangular sample of a vane.",
    "locking": "Error of a tilted test against elements, for ratios of the moduli.",
    "mesoscale": "Barbs as stiff bands, barbules as soft ones.",
    "tear": "Pull a hooked vane apart.",
    "cycle": "Load and unload a hooked vane in turns.",
    "rupture": "Pull a membrane of fibres, such as skin, until it tears.",
    "calibrate": "Moduli of a vane from stress-strain curves.",
    "report": "Run all studies; one page with our numbers beside the published ones.",
    "angles": "Membrane beside bands at all angles, and the shear band.",
}


class Lab(CommandGroup):
    """Lists its commands without their options, which are made when a command is called."""

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        name, command, rest = super().resolve_command(ctx, args)
        if name == "measure":
            command = measure
        elif name == "motion":
            command = motion
        elif name in _EXPERIMENTS:
            from featherfx.cli.lab.experiments import COMMANDS

            command = COMMANDS[name]
        return name, command, rest


def _list(context: click.Context, _: click.Parameter, value: bool) -> None:
    """Print the experiments, then the studies and what each reproduces."""
    if not value or context.resilient_parsing:
        return
    from featherfx.lab.studies.study import STUDIES

    width = max(len(name) for name in (*lab.commands, *(study.name for study in STUDIES)))
    click.echo("experiments")
    for name, command in sorted(lab.commands.items()):
        click.echo(f"  {name.ljust(width)}  {command.short_help}")
    click.echo("studies (featherfx lab report --only NAME)")
    for study in STUDIES:
        click.echo(f"  {study.name.ljust(width)}  {study.title} ({study.reproduces})")
    context.exit()


@click.group(
    cls=Lab,
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


lab.add_command(Command("measure", short_help="Measure figures of the pages again."))
lab.add_command(
    Command("motion", short_help="Move the joints of a shot, and print how wings beat.")
)
for experiment, meaning in _EXPERIMENTS.items():
    lab.add_command(Command(experiment, short_help=meaning))


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
            some = QUICK_BIRDS if options.quick else FULL_BIRDS
            tables.append(birds_table(some, progress))
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
