"""Caches that are there, in other forms, and joined from shares."""

from __future__ import annotations

from pathlib import Path

from featherfx.baking.task import part_path
from featherfx.usd.convert.alembic import export_alembic
from featherfx.usd.convert.condensed import export_condensed
from featherfx.usd.convert.merge import flatten, join_shares
from featherfx.usd.convert.mesh_files import export_morph, mesh_sequence
from featherfx.usd.write.output import SUFFIXES, check_output


def export(
    cache: str | Path,
    output: str | Path,
    *,
    condensed: bool = False,
    morph: bool = False,
    frames: tuple[int, int] | None = None,
    overwrite: bool = False,
) -> list[Path]:
    """Write a cache in another form and return the files.

    output: .usd, .usdc or .usda for one plain file of the whole cache, or with condensed for
    Houdini's condensed feathers; .abc for one Alembic file (needs the extra "alembic"); .glb,
    .obj, .ply or .stl for a file per frame, or with morph for one .glb whose morph targets are the
    frames. Of Alembic and these, frames gives the first and last.
    Raises InputError.
    """
    path = Path(output)
    if path.suffix == ".abc":
        return [export_alembic(cache, path, frames, overwrite)]
    if path.suffix == ".glb" and morph:
        return [export_morph(cache, path, frames, overwrite)]
    if path.suffix not in SUFFIXES:
        chosen = range(frames[0], frames[1] + 1) if frames else None
        return mesh_sequence(cache, path, chosen, overwrite)
    if condensed:
        export_condensed(cache, path, overwrite)
    else:
        flatten(cache, path, overwrite)
    return [path]


def join(output: str | Path, shares: int, overwrite: bool = False) -> int:
    """Write the root of a cache that was baked in shares of its feathers; return their number.

    output: name of the whole; the shares stand beside it (featherfx.baking.task.part_path). Raises
    InputError where one is missing or was baked with other settings.
    """
    path = check_output(output, overwrite)
    parts = [part_path(path, (k, shares)) for k in range(1, shares + 1)]
    return join_shares(path, parts, overwrite)
