"""`featherfx bake`: simulate a shot and write it to USD."""

from __future__ import annotations

from dataclasses import fields
from pathlib import Path
from typing import Any

import click

from featherfx.baking import pipeline
from featherfx.baking.options import DRAWN, BakeOptions, FlockOptions
from featherfx.cli.options import (
    RealNumber,
    WholeNumber,
    default_jobs,
    jobs_option,
    options_of,
    output_option,
    presets_option,
    progress_option,
    readable_path,
)
from featherfx.cli.program import Command, tell
from featherfx.cli.progress import Progress
from featherfx.limits import MAX_JOBS, MAX_SHARES, TASK_HOURS
from featherfx.usd.write.options import StageOptions

_STAGE = tuple(each.name for each in fields(StageOptions) if each.name != "overwrite")
_OF_DASK = ("scheduler", "workers", "shares")
_OF_TASKS = ("task_shares", "task_hours")
# keys of a report that notes are printed for
_NOTED = (
    "again", "variation_cut", "worst_substeps", "worst_unsolved", "error_not_promised", "contact",
    "bounds_passed", "undefined", "over_promised", "grips_at_limit",
)  # fmt: skip


@click.command(
    cls=Command,
    epilog="""
    featherfx bake samples/swan_wing/shot.toml -o swan_wing.usdc
    featherfx bake shot.toml --frames 1-12 --quality draft --overwrite
    featherfx bake shot.toml -o wing.usdc --render-rows 120 --render-columns 16 --barbs 400
    featherfx bake shot.toml -o wing.usda --meters-per-unit 0.01 --up-axis Y --report wing.json
    featherfx bake samples/flock/shot.toml --birds 20 -o flock.usda
    featherfx bake a.toml b.toml --engine dask --workers 2 -o caches
    """,
    sections={
        "What is simulated": "--quality",
        "What is written": "--chunk",
        "The USD stage": "--meters-per-unit",
        "Farms": "--feathers",
        "Messages": "--report",
    },
)
@click.argument("shots", metavar="SHOT...", type=readable_path(), nargs=-1, required=True)
@output_option(
    "USD file to write (.usd, .usdc, .usda); for several shots a folder."
    "  [default: the shot's name with .usdc]",
    required=False,
)
@options_of(BakeOptions, "frames", "resume", "overwrite")
@jobs_option("Threads; the result does not depend on it.")
@options_of(BakeOptions, "quality", "error")
@options_of(FlockOptions, "birds")
@presets_option
@options_of(BakeOptions, "chunk", "subframes", "form", "group", *DRAWN)
@options_of(BakeOptions, "velocities", "accelerations", "diagnostics", *_STAGE)
@options_of(BakeOptions, "feathers")
@click.option(
    "--plan",
    type=WholeNumber(1, MAX_SHARES),
    metavar="N",
    help="Do not bake: write N work items for a farm, with their commands, and a job template of"
    " Open Job Description.",
)
@click.option(
    "--task-shares",
    type=WholeNumber(1, MAX_SHARES),
    metavar="M",
    help="With --plan: a task of the job template bakes M shares; the scheduler must know Open Job"
    " Description's task chunking.",
)
@click.option(
    "--task-hours",
    type=RealNumber(0.01, 10_000.0),
    metavar="HOURS",
    help=f"With --plan: a task that takes longer is stopped.  [default: {TASK_HOURS:g}]",
)
@click.option(
    "--engine",
    type=click.Choice(["local", "dask"]),
    default="local",
    show_default=True,
    help="dask: bake all shots as one job of a Dask cluster, each cut into shares.",
)
@click.option(
    "--scheduler",
    metavar="ADDRESS",
    help="dask: address of a scheduler that runs.  [default: a cluster is started]",
)
@click.option(
    "--workers",
    type=WholeNumber(1, MAX_JOBS),
    help="dask: processes to start; with --scheduler, workers to wait for."
    "  [default: all cores; with --scheduler 1]",
)
@click.option(
    "--shares",
    type=WholeNumber(1, MAX_SHARES),
    help="dask: shares that each shot is cut into.  [default: about two for each worker]",
)
@options_of(BakeOptions, "report")
@click.option(
    "--strict",
    is_flag=True,
    help="Exit with 1 where what is written passes a bound of `featherfx check`.",
)
@progress_option
@click.pass_context
def bake(
    ctx: click.Context,
    shots: tuple[Path, ...],
    style: str,
    plan: int | None,
    engine: str,
    strict: bool,
    **options: Any,
) -> None:
    """Simulate the feathers of SHOT (a TOML file) and write them to USD.

    The output appears under its name when it is complete, never before. What a bake that was
    stopped has finished stays beside it for --resume.
    """
    farm = {name: options.pop(name) for name in _OF_DASK}
    tasks = {name: options.pop(name) for name in _OF_TASKS}
    tasks = {name: value for name, value in tasks.items() if value is not None}
    if tasks and not plan:
        raise click.UsageError("--task-shares and --task-hours go with --plan")
    each_share = options.pop("feathers") or [None]
    if len(each_share) > 1 and (options["report"] or engine == "dask"):
        raise click.UsageError("several --feathers write no --report, and are not for dask")
    options["feathers"] = each_share[0]
    if strict and (plan or engine == "dask"):
        raise click.UsageError("--strict judges what is baked here. Use featherfx check --strict")
    flocks = [each for each in shots if _is_flock(each)]
    if flocks and (engine == "dask" or len(shots) > 1):
        told = "--plan and --feathers cut a flock for farms. Bake one at a time"
        raise click.UsageError(f"{flocks[0]} is a flock: {told}")
    if not flocks and options.pop("birds") is not None:
        raise click.UsageError(f"--birds is for flocks, and {shots[0]} has no [[flock]]")
    if engine == "dask":
        if plan:
            raise click.UsageError("--plan is for farms of other kinds. Leave out --engine dask")
        from featherfx.cli.farm import bake_on_cluster

        bake_on_cluster(shots, style, options, farm)
        return
    for output in (each for each in shots[1:] if each.suffix in (".usd", ".usda", ".usdc")):
        raise click.UsageError(f"{output} is no shot. Write -o {output} for what is written")
    if len(shots) > 1 or any(farm.values()):
        raise click.UsageError(
            "several shots, --scheduler, --workers and --shares are for --engine dask. Add it, or"
            " bake one shot at a time"
        )
    if plan:
        from featherfx.cli.farm import write_plan

        write_plan(ctx, shots[0], style, {"shares": plan, **tasks}, options)
        return
    baked = _bake_flock if flocks else _bake
    passed = [baked(shots[0], style, {**options, "feathers": share}) for share in each_share]
    if strict and any(passed):
        ctx.exit(1)


def _is_flock(shot: Path) -> bool:
    """Return whether a file is one of a flock; bakes tell of those that cannot be read."""
    from featherfx.groom.read.toml_file import load_toml

    return shot.suffix == ".toml" and shot.is_file() and "flock" in load_toml(shot)


def _bake_flock(flock: Path, style: str, options: dict[str, Any]) -> list[str]:
    """Bake a flock; return the bounds that its caches pass."""
    options["jobs"] = options["jobs"] or default_jobs()
    with Progress("frames", style) as progress:
        result = pipeline.bake_flock(flock, on_frame=progress, **options)
    told = ", ".join(f"{count} {way}" for way, count in result["birds"].items() if count)
    birds = sum(result["birds"].values())
    what = f"{birds} birds ({told})"
    if options["feathers"] is not None:
        i, n = options["feathers"]
        what = f"share {i} of {n}, {len(result['caches'])} caches; the stage is not written"
    tell(f"{result['output']}: {what} in {result['wall_seconds']:.1f} s")
    if error := result["replay_error"]:
        told = f"{error['percent_p50']:.2g} % of their length at the median, 99 % within"
        far = f"{error['percent_p99']:.2g} %, where {error['bird']} is simulated"
        tell(f"feathers of a replay are {told} {far}")
    from featherfx.cli.bake_warnings import print_bake_notes

    known: set[str] = set()
    for name, each in result["caches"].items():
        # what caches have in common is told once
        new = {key: value for key, value in each.items() if f"{key}: {value}" not in known}
        known |= {f"{key}: {value}" for key, value in each.items() if key in _NOTED}
        if any(new.get(key) for key in _NOTED):
            tell(f"{name}:")
            print_bake_notes(new)
    return [text for each in result["caches"].values() for text in each.get("bounds_passed", [])]


def _bake(shot: Path, style: str, options: dict[str, Any]) -> list[str]:
    """Bake a shot; return the bounds that the cache passes."""
    options["jobs"] = options["jobs"] or default_jobs()
    with Progress("frames", style) as progress:
        result = pipeline.bake(shot, on_frame=progress, **options)
    counts = [(result["feathers"], "feather"), (result["frames"], "frame")]
    told = ", ".join(f"{count} {what}{'s' * (count != 1)}" for count, what in counts)
    tell(f"{result['output']}: {told} in {result['wall_seconds']:.1f} s")
    if any(result.get(key) for key in _NOTED):
        from featherfx.cli.bake_warnings import print_bake_notes

        print_bake_notes(result)
    passed: list[str] = result.get("bounds_passed", [])
    return passed
