"""Whole tasks from file to file: what the commands do, for programs that import featherfx."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Unpack

from featherfx.api import Folders, read_groom, read_quality, read_shot, scene_readers
from featherfx.baking.bake import bake, drawn_entries, metadata_of
from featherfx.baking.plan import plan
from featherfx.baking.stats import plumage_stats
from featherfx.baking.task import Drawn, StageOptions, all_of, part_path, stage_space
from featherfx.errors import InputError, Problem

if TYPE_CHECKING:
    from featherfx.feather.types import Feather
    from featherfx.groom.types import Groom

__all__ = [
    "bake",
    "check",
    "export",
    "export_groom",
    "join",
    "plan",
    "plumage_stats",
    "read_shot",
]


def export_groom(
    groom_path: str | Path,
    output: str | Path,
    *,
    quality: str = "final",
    preset_folders: Folders = (),
    instances: bool | None = None,
    render_rows: int | None = None,
    render_columns: int | None = None,
    barbs: int | None = None,
    **stage: Unpack[StageOptions],
) -> int:
    """Write the rest feathers of a groom to USD, without time samples; return their number.

    quality: name of the preset that gives rows and columns. instances: whether feathers of one
    shape are instances of a prototype, or each a mesh and a curve of its own; None: instances
    where at least half of the feathers repeat and no barbs are drawn. render_rows, render_columns,
    barbs: as in bake. Raises InputError with every problem.
    """
    from featherfx.feather.scaled import repeated_shapes
    from featherfx.usd.read.inputs import refuse_inputs
    from featherfx.usd.write.names import unique_prim_names
    from featherfx.usd.write.output import check_output, output_files

    folders, drawn = tuple(preset_folders), Drawn(render_rows, render_columns, barbs)
    read: list[Path] = [Path(groom_path)]
    groom, grid, path, *_ = all_of(
        lambda: read_groom(groom_path, folders, read.append),
        lambda: read_quality(quality, folders),
        lambda: check_output(output, stage.get("overwrite", False), stage.get("layout", "flat")),
        drawn.check,
    )
    if instances and barbs:
        raise InputError(Problem("groom", "barbs", "are not drawn of instances; leave one out"))
    refuse_inputs(output_files(path, "payload"), read)
    options = {**stage, **stage_space(stage, groom, None)}
    metadata = metadata_of(groom, grid)
    first, chosen = repeated_shapes(groom.feathers)
    if instances or (instances is None and not barbs and 2 * len(first) <= len(chosen)):
        from featherfx.usd.write.instances import write_instances

        shapes = _prototypes(groom, first, drawn.grid(grid))
        write_instances(path, groom.feathers, shapes, chosen, metadata=metadata, **options)
        return len(chosen)
    names = unique_prim_names([each.id for each in groom.feathers])
    moving = drawn_entries(groom, grid, drawn, names, None)
    entries = [replace(entry, static=True) for entry in moving]

    from featherfx.usd.write.write import CacheWriter

    with CacheWriter(path, entries, None, metadata=metadata, **options):
        pass
    return len(entries)


def _prototypes(groom: Groom, first: Sequence[int], grid: tuple[int, int]) -> list[Feather]:
    """Rest geometry of every shape, at the size of its prototype."""
    from featherfx.feather.scaled import feather_of

    placements = [replace(groom.feathers[k], size=1.0) for k in first]
    return all_of(*(partial(feather_of, placement, *grid) for placement in placements))


def export(
    cache: str | Path,
    output: str | Path,
    *,
    condensed: bool = False,
    frames: tuple[int, int] | None = None,
    overwrite: bool = False,
) -> list[Path]:
    """Write a cache in another form and return the files.

    output: .usd, .usdc or .usda for one plain file of the whole cache, or with condensed for
    Houdini's condensed feathers; .abc for one Alembic file (needs the extra "alembic"); .glb,
    .obj, .ply or .stl for a file per frame. Of Alembic and these, frames gives the first and last.
    Raises InputError.
    """
    from featherfx.usd.write.output import SUFFIXES

    path = Path(output)
    if path.suffix == ".abc":
        from featherfx.usd.convert.alembic import export_alembic

        return [export_alembic(cache, path, frames, overwrite)]
    if path.suffix not in SUFFIXES:
        from featherfx.usd.convert.export import mesh_sequence

        chosen = range(frames[0], frames[1] + 1) if frames else None
        return mesh_sequence(cache, path, chosen, overwrite)
    if condensed:
        from featherfx.usd.convert.condensed import export_condensed

        export_condensed(cache, path, overwrite)
    else:
        from featherfx.usd.convert.export import flatten

        flatten(cache, path, overwrite)
    return [path]


def join(output: str | Path, shares: int, overwrite: bool = False) -> int:
    """Write the root of a cache that was baked in shares of its feathers; return their number.

    output: name of the whole; the shares stand beside it (featherfx.baking.task.part_path). Raises
    InputError where one is missing or was baked with other settings.
    """
    from featherfx.usd.write.join import join_shares

    path = Path(output)
    parts = [part_path(path, (k, shares)) for k in range(1, shares + 1)]
    return join_shares(path, parts, overwrite)


def check(path: str | Path, preset_folders: Folders = ()) -> list[Problem]:
    """What is wrong with a groom, preset, shot or USD file; empty when nothing is.

    Grooms and shots without a wrong value are also tried: their feathers are built and the motion
    is fitted to the joints.
    """
    path, folders = Path(path), tuple(preset_folders)
    if not path.is_file():
        return [Problem(str(path), "", "is a folder" if path.is_dir() else "file does not exist")]
    if path.suffix in (".usd", ".usda", ".usdc"):
        from featherfx.usd.check.check import check_file as check_usd

        return check_usd(path)
    if path.suffix != ".toml":
        suffixes = ".toml, .usd, .usda and .usdc"
        return [Problem(str(path), "", f"suffix '{path.suffix}' is not one of {suffixes}")]

    from featherfx.shot.read.read import check_file

    try:
        tried = _tried(path, folders)
    except InputError as error:
        # the reader finds all that is wrong in the files; what it does not, shows when it is tried
        return check_file(path, folders, scene_readers()) or list(error.problems)
    return check_file(path, folders, scene_readers()) if tried is None else tried


def _tried(path: Path, folders: Sequence[str | Path]) -> list[Problem] | None:
    """Problems of a shot or groom that show only when feathers are built and moved.

    None where it is neither. Raises InputError where it holds a wrong value.
    """
    import tomllib

    from featherfx.feather.scaled import feather_of, repeated_shapes
    from featherfx.shot.motion.motion import root_motion

    try:
        keys = tomllib.loads(path.read_text(encoding="utf-8-sig"))
    except (OSError, ValueError):
        return None
    tasks: list[Callable[[], Any]] = []
    if "groom" in keys:
        shot = read_shot(path, folders)
        groom, grid = shot.groom, shot.quality
        tasks.append(lambda: root_motion(shot))
    elif {"feather", "row", "table", "usd", "region"} & keys.keys():
        groom, grid = read_groom(path, folders), read_quality("final", folders)
    else:
        return None
    first, _ = repeated_shapes(groom.feathers)
    tasks += [partial(feather_of, groom.feathers[k], grid.rows, grid.columns) for k in first]
    try:
        all_of(*tasks)
    except InputError as error:
        return list(error.problems)
    return []
