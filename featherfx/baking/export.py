"""Exports: a groom at rest to USD, and a cache to other forms."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

from featherfx.api import groom_as_written, open_document, read_groom, read_quality
from featherfx.baking.entries import drawn_entries, metadata_of, refuse_too_large, scenery_of_groom
from featherfx.baking.options import GroomOptions, make_options, takes
from featherfx.baking.task import in_space
from featherfx.errors import InputError, Problem, all_of, require, require_type
from featherfx.feather.placed_feathers import build_feathers
from featherfx.feather.shapes import distinct_shapes
from featherfx.groom.types import Groom
from featherfx.phases import Progress, phase, tells_progress
from featherfx.render.options import find_missing_libraries
from featherfx.shot.loop.placement import lay_out
from featherfx.usd.types import choose_origin
from featherfx.usd.write.cache_writer import CachePlace, CacheWriter
from featherfx.usd.write.forms import write_instances
from featherfx.usd.write.options import BY_FEATHER, StageOptions, WriteOptions, check_ranges
from featherfx.usd.write.output import (
    USD_SUFFIXES,
    check_output,
    find_file_problems,
    output_files,
    refuse_inputs,
    unique_prim_names,
)


@takes(GroomOptions)
@tells_progress
def export_groom(
    groom_path: str | Path, output: str | Path, *, progress: Progress = False, **options: Any
) -> int:
    """Write the rest feathers of a groom to USD, without time samples; return their number.

    progress: as of featherfx.phases.tells_progress. options: fields of
    featherfx.baking.options.GroomOptions. quality: name of the preset that gives rows and columns.
    instances: whether feathers of one shape are instances of a prototype, or each a mesh and a
    curve of its own; None: instances where at least a third of the feathers repeat and neither
    barbs nor textures are written. The others are as in bake. Raises InputError with every problem.
    """
    require_type("groom_path", groom_path, str | Path, "the path of a groom file")
    return _export(groom_path, output, make_options(GroomOptions, options))


def _export(groom_path: str | Path, output: str | Path, options: GroomOptions) -> int:
    read: list[Path] = [Path(groom_path)]

    def as_written() -> Groom:
        document = open_document("groom", groom_path, options.preset_folders)
        return groom_as_written(document, read.append)

    groom, grid, path, *_ = all_of(
        as_written,
        lambda: read_quality(options.quality, options.preset_folders),
        lambda: check_output(output, options.overwrite, options.layout),
        lambda: check_ranges(options),
    )
    for key in ("barbs", "textures"):
        if options.instances and getattr(options, key):
            raise InputError(Problem("groom", key, "not written of instances. Leave one out"))
    refuse_inputs(output_files(path, "payload"), read)
    groom = lay_out(groom)
    if options.instances and groom.coat is not None:
        message = "no two feathers of a [layout] have one shape. Leave instances or [layout] out"
        raise InputError(Problem("groom", "instances", message))
    options = in_space(options, groom, None)
    metadata = metadata_of(groom, grid) | scenery_of_groom(groom, Path(path))
    first, chosen = distinct_shapes(groom.feathers)
    own = options.barbs or options.textures
    repeat = not own and groom.coat is None and 3 * len(first) <= 2 * len(chosen)
    instanced = repeat if options.instances is None else options.instances
    refuse_too_large(groom, grid, options, str(groom_path), instanced)
    if instanced:
        # at the size of each prototype
        placements = [replace(groom.feathers[k], size=1.0) for k in first]
        shapes = build_feathers(placements, *options.grid(grid))
        write_instances(path, groom.feathers, shapes, chosen, options, metadata)
        return len(chosen)
    names = unique_prim_names([each.id for each in groom.feathers])
    moving = drawn_entries(groom, grid, options, names, None)
    entries = [replace(entry, static=True) for entry in moving]
    written = {each.name: getattr(options, each.name) for each in fields(StageOptions)}
    origin = choose_origin([each.position for each in groom.feathers])
    stage = WriteOptions(**written, group=BY_FEATHER)
    place = CachePlace(origin=origin)
    with CacheWriter(path, entries, None, options=stage, place=place, metadata=metadata):
        pass
    return len(entries)


@tells_progress
def measure_coverage(
    groom_path: str | Path,
    output: str | Path | None = None,
    *,
    quality: str = "preview",
    preset_folders: Iterable[str | Path] = (),
    overwrite: bool = False,
    progress: Progress = False,
) -> dict[str, Any]:
    """Measure how feathers cover the skin of a groom, tract by tract (render/coverage.py).

    output: picture to draw, .png; None: nothing is written. quality: name of the preset that gives
    rows and columns. preset_folders, progress: as in read_groom. Raises InputError.
    """
    picture = None if output is None else Path(output)
    problems = find_missing_libraries("groom", picture)
    if picture is not None:
        problems += find_file_problems([picture], overwrite)
        if picture.suffix.lower() != ".png":
            told = f"suffix '{picture.suffix}' is not .png. Name a .png file for the coverage"
            problems.append(Problem(str(picture), "", told))
    require(*problems)
    grid = read_quality(quality, preset_folders)
    from featherfx.groom.regions.regions import collect_regions

    with collect_regions() as grown:
        groom = read_groom(groom_path, preset_folders)
    if not grown:
        told = "there is no [[region]] or [bird], whose skin a coverage is measured on. Add one"
        raise InputError(Problem(str(groom_path), "", told))
    from featherfx.render.coverage import Coverage

    coverage = Coverage(groom, grown[-1], build_feathers(groom.feathers, grid.rows, grid.columns))
    with phase("finishing"):
        found = coverage.measure()
        if picture is not None:
            coverage.draw(picture)
    return found


@tells_progress
def export(
    cache: str | Path,
    output: str | Path,
    *,
    condensed: bool = False,
    morph: bool = False,
    frames: tuple[int, int] | None = None,
    overwrite: bool = False,
    progress: Progress = False,
) -> list[Path]:
    """Write a cache in another form and return the files.

    output: .usd, .usdc or .usda for one plain file of the whole cache, or with condensed for
    Houdini's condensed feathers; .abc for one Alembic file (needs the extra "alembic"); .glb,
    .obj, .ply or .stl for a file per frame, or with morph for one .glb whose morph targets are the
    frames. Of Alembic and these, frames gives the first and last. progress: as of
    featherfx.phases.tells_progress. Raises InputError.
    """
    require_type("cache", cache, str | Path, "the path of a cache, such as cache.path")
    if frames is not None:
        require_type("frames", frames, tuple | list, "(first, last)")
    path = Path(output)
    if path.suffix == ".abc":
        from featherfx.usd.convert.alembic import export_alembic

        return [export_alembic(cache, path, frames, overwrite)]
    if path.suffix == ".glb" and morph:
        from featherfx.usd.convert.mesh_files import export_morph

        return [export_morph(cache, path, frames, overwrite)]
    if path.suffix not in USD_SUFFIXES:
        from featherfx.usd.convert.mesh_files import mesh_sequence

        chosen = range(frames[0], frames[1] + 1) if frames else None
        return mesh_sequence(cache, path, chosen, overwrite)
    if condensed:
        from featherfx.usd.convert.condensed import export_condensed

        export_condensed(cache, path, overwrite)
    else:
        from featherfx.usd.convert.merge import flatten

        flatten(cache, path, overwrite)
    return [path]
