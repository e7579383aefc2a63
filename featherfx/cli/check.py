"""`featherfx check` and `inspect`: problems, measurements and contents of files."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from featherfx.baking import pipeline
from featherfx.cli.options import (
    FRAMES,
    default_jobs,
    jobs_option,
    json_option,
    presets_option,
    progress_option,
    readable_path,
)
from featherfx.cli.program import Command, print_json
from featherfx.cli.progress import Progress
from featherfx.errors import InputError, Problem, some_of
from featherfx.groom.read.toml_text import located

if TYPE_CHECKING:
    from featherfx.usd.read.contents import PrimReport, StageReport


@click.command(
    cls=Command,
    epilog="""
    featherfx check samples/swan_wing/shot.toml
    featherfx check presets/feather/*.toml wing.usdc
    featherfx check --crossings pigeon.usdc --frames 1-24
    featherfx check --plumage pigeon.usdc --skin samples/pigeon/body.usdc /pigeon/body
    featherfx check --explain samples/swan_wing/shot.toml
    """,
)
@click.argument("files", metavar="FILE...", nargs=-1, required=True, type=readable_path())
@presets_option
@click.option(
    "--crossings",
    is_flag=True,
    help="Count triangles of vanes that pass through another or a body, in one USD file.",
)
@click.option(
    "--plumage",
    is_flag=True,
    help="Measure how the contour feathers of one cache lie on a skin, tract by tract.",
)
@click.option(
    "--skin",
    type=(readable_path(), str),
    metavar="FILE PRIM",
    help="With --plumage, the skin: a USD file and its mesh.",
)
@click.option("--strict", is_flag=True, help="Exit with 1 where a cache passes a bound, too.")
@click.option(
    "--explain", is_flag=True, help="Tell how the feathers of one shot are simulated, and why."
)
@click.option("--feather", metavar="ID", help="With --explain, this feather alone.")
@click.option("--frames", type=FRAMES, help="Frames to look at.  [default: all]")
@json_option("Measures of one file, or the explanation, as one JSON object.")
@jobs_option()
@progress_option
@click.pass_context
def check(
    ctx: click.Context,
    files: tuple[Path, ...],
    preset_folders: tuple[Path, ...],
    style: str,
    strict: bool,
    as_json: bool,
    **options: Any,
) -> None:
    """Check grooms, presets and shots (TOML) and USD files.

    Prints one line per problem (file, key, what is wrong, allowed range) and exits with 1 if
    there is any.

    Caches are measured, and a warning names feather, frame and figure where a bound is passed:
    rachises and barbs within 0.5 % of their length at rest; points that jump from one sample to the
    next by 10 % of their feather's length, and by three times what its root does; velocities within
    3 % of the motion, where samples are close enough to tell. With --json of one cache these are
    `lengths`, `pops` and `velocity_mismatch`, or `not_measured` has the reasons.

    With --crossings, prints for each whole frame of a cache how many pairs of triangles of vanes
    pass through each other, and of how many pairs of feathers they are. The skin of the shot, and
    meshes that are not feathers, count as one body. With --json also those of shafts.

    With --plumage, prints of each tract, and of all contour feathers (whose ids name neither wing
    nor tail), the angle of rachises to the skin at their middle and tip, the heights of tips over
    the skin, how much feathers overlap, and how many pairs intersect, at one frame (--frames,
    default the first).

    With --explain, prints how each feather of a shot is simulated, and the key, preset, table or
    rule that each option comes from; feathers that are alike share a line.
    """
    measure = _choose_measure(files, as_json, options)
    if measure == "explain":
        _explain(files[0], preset_folders, options["feather"], as_json)
    elif measure == "plumage":
        _measure_plumage(files[0], style, as_json, options)
    elif measure:
        _count_crossings(files[0], style, as_json, options)
    else:
        problems, measured = _check_files(files, preset_folders, style)
        _print_findings(files[0], problems, measured, as_json)
        if problems or (strict and any(each.get("bounds_passed") for each in measured.values())):
            ctx.exit(1)
        click.echo(f"{len(files)} checked, no problems", err=True)


_MEASURES = "crossings", "explain", "plumage"
# options, and the measures that use them
_NEEDS = {
    "skin": ("plumage",),
    "feather": ("explain",),
    "frames": ("crossings", "plumage"),
    "jobs": ("crossings",),
}


def _choose_measure(files: Sequence[Path], as_json: bool, options: Mapping[str, Any]) -> str:
    """Return the measure that options name, empty without one. UsageError where they misfit."""
    measures = [name for name in _MEASURES if options[name]]
    if len(measures) > 1 or (measures and len(files) != 1):
        raise click.UsageError(f"--{measures[0]} takes one file, and nothing else to measure")
    if as_json and len(files) != 1:
        raise click.UsageError("--json takes one file")
    measure = measures[0] if measures else ""
    for name, users in _NEEDS.items():
        if options[name] and measure not in users:
            raise click.UsageError(f"--{name} needs {' or '.join(f'--{each}' for each in users)}")
    if measure == "plumage" and not options["skin"]:
        raise click.UsageError("--plumage needs --skin FILE PRIM")
    return measure


def _check_files(
    files: Sequence[Path], preset_folders: Sequence[Path], style: str
) -> tuple[list[Problem], dict[Path, dict[str, Any]]]:
    """Return the problems of files, and the measures of those that are caches."""
    problems: list[Problem] = []
    measured: dict[Path, dict[str, Any]] = {}
    with Progress("files", style):
        for file in files:
            found = pipeline.check(file, preset_folders)
            if file.suffix in (".usd", ".usda", ".usdc") and pipeline.is_cache(file):
                try:
                    measured[file] = pipeline.judge_complete_cache(file)
                except InputError as error:
                    measured[file] = {"not_measured": [located(each) for each in error.problems]}
                    known = {each.key for each in found}
                    found += [each for each in error.problems if each.key not in known]
            problems += found
    return list(dict.fromkeys(problems)), measured


def _print_findings(
    file: Path,
    problems: Sequence[Problem],
    measured: Mapping[Path, Mapping[str, Any]],
    as_json: bool,
) -> None:
    """Print problems and passed bounds; as JSON those of one file, with its measures."""
    lines = [located(problem) for problem in problems]
    if as_json:
        whole = {"file": str(file), "problems": lines, **measured.get(file, {})}
        print_json(whole)
    elif lines:
        click.echo("\n".join(lines))
    for name, found in measured.items():
        if "not_measured" in found:
            click.echo(f"featherfx: warning: {name}: cannot be measured", err=True)
        for text in found.get("bounds_passed", ()):
            click.echo(f"featherfx: warning: {name}: {text}", err=True)


def _explain(
    file: Path, preset_folders: Sequence[Path], feather: str | None, as_json: bool
) -> None:
    feathers, motion = pipeline.explain_options(file, preset_folders, feather)
    if as_json:
        print_json({"feathers": feathers, "motion": motion})
    else:
        click.echo("\n".join(pipeline.explained_lines(feathers, motion)))


def _measure_plumage(file: Path, style: str, as_json: bool, options: Mapping[str, Any]) -> None:
    skin, prim = options["skin"]
    with Progress("files", style):
        tracts = pipeline.measure_plumage(file, skin, prim, options["frames"])
    lines = (_plumage_line(tract, each) for tract, each in tracts.items())
    click.echo(json.dumps(tracts, indent=2) if as_json else "\n".join(lines))


def _plumage_line(tract: str, each: dict[str, float]) -> str:
    return (
        f"{tract}: {each['feathers']} feathers at {each['angle_mid_p50']:.1f} degrees (90 %:"
        f" {each['angle_mid_p90']:.1f}; tips {each['angle_tip_p50']:.1f}), tips up to"
        f" {100.0 * each['tip_height_p90']:.0f} % of the length (90 %) over the skin and"
        f" {1e3 * each['neighbour_height_p50']:.2g} mm apart, overlap {each['overlap']:.2g},"
        f" {each['intersecting_pairs']} pairs intersect"
    )


def _count_crossings(file: Path, style: str, as_json: bool, options: Mapping[str, Any]) -> None:
    counted, jobs = [], options["jobs"] or default_jobs()
    with Progress("crossings", style) as progress:
        for each in pipeline.count_crossings(file, options["frames"], jobs=jobs, on_frame=progress):
            counted.append(each)
            if not as_json:
                frame = each["frame"]
                at = "at rest" if frame is None else f"at frame {frame:g}"
                click.echo(f"crossings: {each['crossings']} in {each['pairs']} pairs {at}")
    if as_json:
        keys = "crossings", "with_body", "with_shafts"
        total = {key: sum(each[key] for each in counted) for key in keys}
        worst = max(counted, key=lambda each: each["crossings"])["frame"]
        print_json({"file": str(file), **total, "worst_frame": worst, "frames": counted})


_MAX_SHOWN = 40  # prims of a kind, joints of a skeleton; --json has all
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
    if as_json:
        print_json(asdict(report))
    else:
        click.echo("\n".join(_lines(report)))
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
        for prim in prims[:_MAX_SHOWN]:
            yield f"  {prim.path}: {', '.join(_facts(prim, parts))}"
            details = list(_details(prim))
            yield from ["    the same as the one before"] if details == before else details
            before = details or None
        if len(prims) > _MAX_SHOWN:
            yield f"  and {len(prims) - _MAX_SHOWN} more (--json has all)"
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
            yield f"    {title}: {some_of(names, _MAX_SHOWN)}"
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
