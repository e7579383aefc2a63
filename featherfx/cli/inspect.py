"""`featherfx inspect`: what a USD file holds for grooms and shots to name."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

import click

from featherfx.baking import pipeline
from featherfx.cli.options import json_option, readable_path
from featherfx.cli.program import Command

if TYPE_CHECKING:
    from featherfx.usd.read.inspect import PrimReport, StageReport

_MOST_SHOWN = 40  # prims of a kind, joints of a skeleton; --json has all
_TITLES = {
    "mesh": ("meshes", "faces"),
    "skeleton": ("skeletons", "joints"),
    "curves": ("curves", "curves"),
    "camera": ("cameras", ""),
    "instancer": ("instancers", "instances"),
    "points": ("points", ""),
}


@click.command(
    cls=Command,
    short_help="What a USD file holds for grooms and shots to name.",
    epilog="""
    featherfx inspect samples/pigeon/body.usdc
    featherfx inspect character.usda --json
    """,
)
@click.argument("file", metavar="FILE.usd", type=readable_path())
@json_option("One JSON object, of all prims.")
@click.pass_context
def inspect(ctx: click.Context, file: Path, as_json: bool) -> None:
    """Tell what a USD file holds: units, axis, rates and range; meshes, skeletons with their
    joints, curves, cameras, instancers and points, with their primvars.

    Exits with 1 where something in the file cannot be read; the rest is told all the same.
    """
    report = pipeline.inspect_stage(file)
    click.echo(json.dumps(asdict(report), indent=2) if as_json else "\n".join(_lines(report)))
    for problem in report.problems:
        click.echo(f"featherfx: {problem}", err=True)
    if report.problems:
        ctx.exit(1)


def _lines(report: StageReport) -> Iterator[str]:
    """The report for people."""
    unit = "" if report.meters_per_unit_is_authored else " (not authored)"
    yield report.file
    yield f"  {report.meters_per_unit:g} m per unit{unit}, {report.up_axis} up"
    known = report.start is not None and report.end is not None
    codes = f"{report.start:g} to {report.end:g}" if known else "not authored"
    rates = f"{report.time_codes_per_second:g} time codes and {report.frames_per_second:g} frames"
    yield f"  time codes {codes}, {rates} per second"
    yield f"  default prim {report.default_prim or '(none)'}"
    for kind, (title, parts) in _TITLES.items():
        prims = report.of_kind(kind)
        if prims:
            yield f"{title}: {len(prims)}"
        before = None
        for prim in prims[:_MOST_SHOWN]:
            yield f"  {prim.path}: {', '.join(_facts(prim, parts))}"
            details = list(_details(prim))
            yield from ["    the same as the one before"] if details == before else details
            before = details or None
        if len(prims) > _MOST_SHOWN:
            yield f"  and {len(prims) - _MOST_SHOWN} more (--json has all)"
    if not report.prims:
        yield "holds no mesh, skeleton, curves, camera, instancer or points"


def _facts(prim: PrimReport, parts: str) -> Iterator[str]:
    yield prim.type
    if parts:
        yield f"{prim.parts} {parts if prim.parts != 1 else parts.removesuffix('s')}"
    if prim.points and prim.kind != "instancer":
        yield f"{prim.points} points"
    if prim.size is not None:
        yield " x ".join(f"{each:.3g}" for each in prim.size) + " m"
    if prim.sampled is None:
        yield "still"
    else:
        yield f"moves from {prim.sampled[0]:g} to {prim.sampled[1]:g}"
    if prim.samples > 1:
        yield f"{prim.samples} samples"
    if prim.skeleton:
        yield f"moved by {prim.skeleton}"
    if prim.in_instance:
        yield "in an instance"


def _details(prim: PrimReport) -> Iterator[str]:
    if prim.kind == "mesh" and prim.box is not None:
        ends = zip("xyz", *prim.box, strict=True)
        told = ", ".join(f"{axis} {low:.4g} to {high:.4g}" for axis, low, high in ends)
        yield f"    at rest, in its own units: {told}"
    for title, names in (
        ("joints", _short(prim.joints)),
        ("subsets", prim.subsets),
        ("prototypes", prim.prototypes),
    ):
        if names:
            yield f"    {title}: {_listed(names)}"
    for each in prim.primvars:
        size = f" of {each.element_size}" if each.element_size > 1 else ""
        count = f"{each.count} value{'' if each.count == 1 else 's'}"
        above = ", inherited" if each.inherited else ""
        yield f"    primvar {each.name}: {each.type}, {each.interpolation}{size}, {count}{above}"


def _short(joints: Sequence[str]) -> list[str]:
    """The last parts of the paths of joints where no other ends alike: shots take these, too."""
    last = [path.rpartition("/")[2] for path in joints]
    ends = Counter(last)
    return [end if ends[end] == 1 else path for path, end in zip(joints, last, strict=True)]


def _listed(names: Sequence[str]) -> str:
    more = f" and {len(names) - _MOST_SHOWN} more" if len(names) > _MOST_SHOWN else ""
    return ", ".join(names[:_MOST_SHOWN]) + more
