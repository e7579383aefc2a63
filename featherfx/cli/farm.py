"""Bakes on a farm: plans, jobs of a Dask cluster, and `featherfx join`."""

from __future__ import annotations

import logging
from collections.abc import Collection, Sequence
from pathlib import Path
from typing import Any

import click
from click.core import ParameterSource

from featherfx.baking import pipeline
from featherfx.cli.bake_warnings import print_missing_promise, print_warnings
from featherfx.cli.options import WholeNumber, default_jobs, overwrite_option
from featherfx.cli.program import Command, tell
from featherfx.cli.progress import Progress
from featherfx.farm import origin
from featherfx.files.process import seldom_collected
from featherfx.limits import MAX_SHARES

# Options of a bake that a plan sets itself, or that belong to one worker.
_PER_WORKER = (
    "--output", "--plan", "--feathers", "--resume", "--progress", "--report", "--presets",
    "--log", "--verbose", "--task-shares", "--task-hours",
)  # fmt: skip


def write_plan(
    ctx: click.Context, shot: Path, style: str, cut: dict[str, Any], options: dict[str, Any]
) -> None:
    """Write the work items and job template of a bake; cut: arguments of plan about shares."""
    given, folders = _given(ctx, _PER_WORKER), options["preset_folders"]
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


class _JobLog(logging.Handler):
    """Log handler that prints what a job says of shots, partitions and workers beside its bar."""

    def __init__(self, progress: Progress) -> None:
        super().__init__()
        self._progress = progress

    def emit(self, record: logging.LogRecord) -> None:
        warning = "warning: " if record.levelno >= logging.WARNING else ""
        self._progress.say(f"featherfx: {warning}{record.getMessage()}")


def bake_on_cluster(
    shots: Sequence[Path], style: str, options: dict[str, Any], farm: dict[str, Any]
) -> None:
    """Bake shots as one job of a Dask cluster and print the result."""
    if not farm["scheduler"]:
        origin.begin()
    # an extra, which takes its time to load
    with seldom_collected():
        from featherfx.farm.job import bake_many as bake

    if options["jobs"] is None:
        # workers of this machine share its cores (Engine.share_out)
        options["jobs"] = 1 if farm["scheduler"] else default_jobs()
    output = options.pop("output") or Path(".")
    log = logging.getLogger("featherfx.farm")
    with Progress("frames", style) as progress:
        lines = _JobLog(progress)
        log.addHandler(lines)
        log.setLevel(logging.INFO)
        try:
            result = bake(shots, output, progress=progress, **farm, **options)
        finally:
            log.removeHandler(lines)
    for each in result["shots"]:
        told = f"{each['feathers']} feathers, {each['frames']} frames"
        tell(f"{each['output']}: {told}")
        for share in each["shares"]:
            print_warnings(share)
        for share in each["shares"][:1]:
            print_missing_promise(share)
    tell(f"{result['workers']} workers, {result['wall_seconds']:.1f} s")


@click.command(cls=Command, epilog="featherfx join wing.usdc --shares 4")
@click.argument("output", type=click.Path(path_type=Path))
@click.option(
    "--shares",
    type=WholeNumber(1, MAX_SHARES),
    required=True,
    help="Number of shares, as N of I/N.",
)
@overwrite_option("Replace the output if it exists.")
def join(output: Path, shares: int, overwrite: bool) -> None:
    """Write OUTPUT, a USD file that names the shares beside it (OUTPUT.1ofN.usdc and so on)."""
    click.echo(f"{output}: {pipeline.join(output, shares, overwrite)} feathers", err=True)
