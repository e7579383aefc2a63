"""`featherfx bake` and `featherfx groom`: the two commands that write USD."""

from __future__ import annotations

import logging
from collections.abc import Collection, Iterator, Sequence
from dataclasses import fields
from pathlib import Path
from typing import Any

import click
from click.core import ParameterSource

from featherfx.baking import pipeline
from featherfx.baking.options import BakeOptions, DrawnOptions, GroomOptions
from featherfx.cli.log import tell
from featherfx.cli.options import (
    default_jobs,
    jobs_option,
    options_of,
    output_option,
    overwrite_option,
    presets_option,
    progress_option,
    quality_option,
    readable_path,
)
from featherfx.cli.program import Command
from featherfx.cli.progress import Progress
from featherfx.farm import origin
from featherfx.files.gc_pause import seldom_collected
from featherfx.limits import MOST_JOBS, MOST_SHARES, TASK_HOURS
from featherfx.usd.write.options import StageOptions

STAGE = tuple(each.name for each in fields(StageOptions))
IN_STAGE = tuple(each for each in STAGE if each != "overwrite")
DRAWN = tuple(each.name for each in fields(DrawnOptions) if each.name != "preset_folders")
MOST_CHANGES = 12  # told of a bake that took over what they do not touch
# Options of a bake that a plan sets itself, or that belong to one worker.
PER_WORKER = (
    "--output", "--plan", "--feathers", "--resume", "--progress", "--report", "--presets",
    "--log", "--verbose", "--task-shares", "--task-hours",
)  # fmt: skip
# of a report, counts of sub-steps that were too long, and for what
TOO_LONG = {
    "substeps_over_tolerance": "{} with a local error above the tolerance",
    "substeps_with_barbs_passing": "{} in which loose barbs pass through each other",
    "substeps_with_hooks_slipping": "{} in which hooks slip by more than a step should",
}
FIXED = "[contact] steps"
OF_DASK = ("scheduler", "workers", "shares")
OF_TASKS = ("task_shares", "task_hours")


@click.command(
    cls=Command,
    short_help="Simulate a shot and write it to USD.",
    epilog="""
    featherfx bake samples/swan_wing/shot.toml -o swan_wing.usdc
    featherfx bake shot.toml --frames 1-12 --quality draft --overwrite
    featherfx bake shot.toml -o wing.usdc --render-rows 120 --render-columns 16 --barbs 400
    featherfx bake shot.toml -o wing.usda --meters-per-unit 0.01 --up-axis Y --report wing.json
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
@presets_option
@options_of(BakeOptions, "chunk", "subframes", "form", "group", *DRAWN)
@options_of(BakeOptions, "velocities", "accelerations", "diagnostics", *IN_STAGE)
@options_of(BakeOptions, "feathers")
@click.option(
    "--plan",
    type=click.IntRange(1, MOST_SHARES),
    metavar="N",
    help="Do not bake: write N work items for a farm, with their commands, and a job template of"
    " Open Job Description.",
)
@click.option(
    "--task-shares",
    type=click.IntRange(1, MOST_SHARES),
    metavar="M",
    help="With --plan: a task of the job template bakes M shares; the scheduler must know Open Job"
    " Description's task chunking.",
)
@click.option(
    "--task-hours",
    type=click.FloatRange(0.01, 10_000.0),
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
    type=click.IntRange(1, MOST_JOBS),
    help="dask: processes to start; with --scheduler, workers to wait for."
    "  [default: all cores; with --scheduler 1]",
)
@click.option(
    "--shares",
    type=click.IntRange(1, MOST_SHARES),
    help="dask: shares that each shot is cut into.  [default: about two for each worker]",
)
@options_of(BakeOptions, "report")
@progress_option
@click.pass_context
def bake(
    ctx: click.Context,
    shots: tuple[Path, ...],
    style: str,
    plan: int | None,
    engine: str,
    **options: Any,
) -> None:
    """Simulate the feathers of SHOT (a TOML file) and write them to USD.

    The output appears under its name when it is complete, never before. What a bake that was
    stopped has finished stays beside it for --resume.
    """
    farm = {name: options.pop(name) for name in OF_DASK}
    tasks = {name: options.pop(name) for name in OF_TASKS}
    tasks = {name: value for name, value in tasks.items() if value is not None}
    if tasks and not plan:
        raise click.UsageError("--task-shares and --task-hours go with --plan")
    each_share = options.pop("feathers") or [None]
    if len(each_share) > 1 and (options["report"] or engine == "dask"):
        raise click.UsageError("several --feathers write no --report, and are not for dask")
    options["feathers"] = each_share[0]
    if engine == "dask":
        if plan:
            raise click.UsageError("--plan is for farms of other kinds; leave out --engine dask")
        bake_many(shots, style, options, farm)
        return
    if len(shots) > 1 or any(farm.values()):
        raise click.UsageError(
            "several shots, --scheduler, --workers and --shares are for --engine dask"
        )
    if plan:
        _plan(ctx, shots[0], style, {"shares": plan, **tasks}, options)
        return
    for share in each_share:
        _bake(shots[0], style, {**options, "feathers": share})


def _plan(
    ctx: click.Context,
    shot: Path,
    style: str,
    cut: dict[str, Any],
    options: dict[str, Any],
) -> None:
    """Write a plan. cut: into how many shares, and what is said of tasks."""
    given, folders = _given(ctx, PER_WORKER), options["preset_folders"]
    with Progress("shares", style):
        written = pipeline.plan(
            shot,
            options["output"],
            options=given,
            preset_folders=folders,
            overwrite=options["overwrite"],
            **cut,
        )
    for path in written:
        click.echo(str(path), err=True)


def _bake(shot: Path, style: str, options: dict[str, Any]) -> None:
    options["jobs"] = options["jobs"] or default_jobs()
    with Progress("frames", style) as progress:
        result = pipeline.bake(shot, on_frame=progress, **options)
    tell(
        f"{result['output']}: {result['feathers']} feathers, {result['frames']} frames"
        f" in {result['wall_seconds']:.1f} s"
    )
    if again := result.get("again"):
        laid = again.get("feathers_laid_again", 0)
        tell(
            f"{again['feathers_simulated']} feathers simulated again,"
            + (f" {laid} laid over these anew," if laid else "")
            + f" {again['feathers_taken_over']} taken over from the cache that was there"
        )
        for change in again["changed"][:MOST_CHANGES]:
            tell(f"  {change}")
        if len(again["changed"]) > MOST_CHANGES:
            tell(f"  and {len(again['changed']) - MOST_CHANGES} more changes")
    _warn_of(result)
    _say_what_is_not_promised(result)


def _warn_of(result: dict[str, Any]) -> None:
    """What the report of a bake, or of a share, gives reason to warn of."""
    if result.get("worst_substeps"):
        tell("\n".join(_too_long(result)))
    if result.get("worst_unsolved"):
        tell("\n".join(_unsolved(result)))
    promised = result.get("error_promised")
    if promised is not None and result["error_estimated"] > promised:
        tell(_missed(promised, result["error_estimated"]))
    if result.get("contact", {}).get("feathers_lifted"):
        tell("\n".join(_lifted(result["contact"])))


def _say_what_is_not_promised(result: dict[str, Any]) -> None:
    """Of a report, or of one of the shares of a shot."""
    if why := result.get("error_not_promised"):
        found = f"{result['error_estimated']:.2g} % is estimated for each feather by itself"
        tell(f"featherfx: no error is promised: {why}; {found}")


def _unsolved(result: dict[str, Any]) -> Iterator[str]:
    """The warning of steps that are no solutions: of which feathers, and where."""
    count = result["feathers_unsolved"]
    yield (
        f"featherfx: warning: {count} feather{'s have' if count > 1 else ' has'} sub-steps that"
        " were not solved: poses that feathers can have, where forces do not balance; look at"
        " how roots move, at grips, forces and stiffness"
    )
    for each in result["worst_unsolved"]:
        far = f"{1e3 * each['distance']:.3g} mm"
        yield f"  {each['feather']} at frame {each['frame']:g}: {far} from the solution"


def _missed(promised: float, estimated: float) -> str:
    """The warning of an error that is estimated to be more than was asked for, both percent.

    What is estimated goes with about the power 0.6 of what is asked for (docs/detail.md).
    """
    return (
        f"featherfx: warning: an error of {promised:g} % was asked for, {estimated:.2g} % is"
        " estimated: feathers bent farther, or erred more in a step, than their loads told;"
        f" ask for {promised * (promised / estimated) ** 1.6:.2g} %"
    )


def _too_long(result: dict[str, Any]) -> Iterator[str]:
    """The warning of sub-steps that were too long: how many, why, what helps, and where."""
    count = result["feathers_over_tolerance"]
    told = "; ".join(text.format(result[key]) for key, text in TOO_LONG.items() if result[key])
    yield (
        f"featherfx: warning: sub-steps of {count} feather{'s' if count > 1 else ''} were longer"
        f" than their errors allow: {told}."
        f" None shorter is allowed: {_shorter(result['substep_limits'])}"
    )
    for each in result["worst_substeps"]:
        yield f"  {each['feather']} at frame {each['frame']:g}: {', '.join(_why(each))}"


def _shorter(limits: dict[str, int]) -> str:
    """What lets steps be shorter, where these limits bound them."""
    fixed = limits.get(FIXED)
    leave = [f"leave out {FIXED} = {fixed}, which fixes their number"] if fixed else []
    raised = [f"{key} ({most})" for key, most in limits.items() if key != FIXED]
    return ", and ".join(leave + ([f"raise {' and '.join(raised)}"] if raised else []))


def _why(each: dict[str, Any]) -> Iterator[str]:
    """Of one feather and frame, what its sub-steps were too long for."""
    if count := each["substeps"]:
        over = each["error"] / each["tolerance"]
        yield (
            f"error of {1e3 * each['error']:.3g} mm, {over:.3g} times the tolerance, in"
            f" {_substeps(count)}"
        )
    if count := each["substeps_with_barbs_passing"]:
        yield f"loose barbs pass through each other in {_substeps(count)}"
    if count := each["substeps_with_hooks_slipping"]:
        yield f"hooks slip too far in {_substeps(count)}"


def _substeps(count: int) -> str:
    return f"{count} sub-step{'' if count == 1 else 's'}"


def _lifted(contact: dict[str, Any]) -> Iterator[str]:
    """The warning of feathers that are shown far from where they were simulated."""
    count, worst = contact["feathers_lifted"], contact["worst_lifted"]
    yield (
        f"featherfx: warning: {count} feather{'s are' if count > 1 else ' is'} lifted out of the"
        " skin and of what is beneath by a quarter of the length or more; wind or motion presses"
        " them in: shelter them from the wind ([[shelter]]), make them stiffer, or let them push"
        " ([contact] forces, regions)"
    )
    if contact["feathers_at_limit"]:
        yield (
            f"  {contact['feathers_at_limit']} of them by twice their length, the most; what would"
            " have to be lifted more stays deep (contact.written_depth of the report)"
        )
    for each in worst:
        yield (
            f"  {each['feather']} at frame {each['frame']:g}: {1e3 * each['lift']:.2g} mm,"
            f" {100 * each['of_length']:.0f} % of its length"
        )


def _given(ctx: click.Context, left_out: Collection[str]) -> list[str]:
    """The options of a command as they were given, as arguments again."""
    given: list[str] = []
    for param in ctx.command.params:
        source = ctx.get_parameter_source(param.name or "")
        if source is not ParameterSource.COMMANDLINE or param.opts[-1] in left_out:
            continue
        if isinstance(param, click.Option):
            value: Any = ctx.params.get(param.name or "")
            for each in value if param.multiple else [value]:
                given += [param.opts[-1]] if param.is_flag else [param.opts[-1], _as_text(each)]
    return given


def _as_text(value: Any) -> str:
    if isinstance(value, Path):
        return str(value.absolute())
    if isinstance(value, list):
        return ",".join(value)
    return f"{value[0]}-{value[1]}" if isinstance(value, tuple) else str(value)


@click.command(
    cls=Command,
    short_help="Join a cache that was baked in shares of its feathers.",
    epilog="featherfx join wing.usdc --shares 4",
)
@click.argument("output", type=click.Path(path_type=Path))
@click.option(
    "--shares",
    type=click.IntRange(1, MOST_SHARES),
    required=True,
    help="Number of shares, as N of I/N.",
)
@overwrite_option("Replace the output if it exists.")
def join(output: Path, shares: int, overwrite: bool) -> None:
    """Write OUTPUT, a USD file that names the shares beside it (OUTPUT.1ofN.usdc and so on)."""
    click.echo(f"{output}: {pipeline.join(output, shares, overwrite)} feathers", err=True)


@click.command(
    cls=Command,
    short_help="Write a groom's feathers at rest to USD.",
    epilog="""
    featherfx groom samples/swan_wing/groom.toml -o feathers.usdc
    featherfx groom groom.toml -o feathers.usda --up-axis Y --meters-per-unit 0.01
    featherfx groom bird.usda -o feathers.usdc --render-rows 60 --barbs 300
    """,
)
@click.argument("groom", metavar="GROOM", type=readable_path())
@output_option("USD file to write (.usd, .usdc, .usda).")
@quality_option("Quality preset that gives rows and columns.  [default: final]")
@presets_option
@progress_option
@options_of(GroomOptions, "instances", *DRAWN, *STAGE)
def groom(groom: Path, quality: str | None, style: str, **options: Any) -> None:
    """Write the feathers of GROOM (a TOML or USD file) at rest to USD, without time samples."""
    with Progress("feathers", style):
        count = pipeline.export_groom(groom, quality=quality or "final", **options)
    click.echo(f"{options['output']}: {count} feathers at rest", err=True)


class _Lines(logging.Handler):
    """What a job says of shots, shares and workers, beside its bar."""

    def __init__(self, progress: Progress) -> None:
        super().__init__()
        self._progress = progress

    def emit(self, record: logging.LogRecord) -> None:
        warning = "warning: " if record.levelno >= logging.WARNING else ""
        self._progress.say(f"featherfx: {warning}{record.getMessage()}")


def bake_many(
    shots: Sequence[Path], style: str, options: dict[str, Any], farm: dict[str, Any]
) -> None:
    """Bake shots as one job and say what came of it."""
    if not farm["scheduler"]:
        origin.begin()
    # an extra, which takes its time to load
    with seldom_collected():
        from featherfx.farm.bake_many import bake_many as bake

    if options["jobs"] is None:
        # workers of this machine share its cores (Engine.share_out)
        options["jobs"] = 1 if farm["scheduler"] else default_jobs()
    output = options.pop("output") or Path(".")
    log = logging.getLogger("featherfx.farm")
    with Progress("frames", style) as progress:
        lines = _Lines(progress)
        log.addHandler(lines)
        log.setLevel(logging.INFO)
        try:
            result = bake(shots, output, on_frame=progress, **farm, **options)
        finally:
            log.removeHandler(lines)
    for each in result["shots"]:
        told = f"{each['feathers']} feathers, {each['frames']} frames"
        tell(f"{each['output']}: {told}")
        for share in each["shares"]:
            _warn_of(share)
        for share in each["shares"][:1]:
            _say_what_is_not_promised(share)
    tell(f"{result['workers']} workers, {result['wall_seconds']:.1f} s")
