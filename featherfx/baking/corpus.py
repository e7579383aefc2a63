"""Corpus test: foreign USD files read, groomed, baked and checked, with an outcome of each step.

On each mesh that a stage holds a region grows feathers, which are baked over three frames as rigid
bodies and checked. Roots are compared with USD's own evaluation of the mesh, skinning included, on
the cage of a subdivided one.
"""

from __future__ import annotations

import json
import math
import warnings
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from multiprocessing import TimeoutError, get_context
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from featherfx.baking.pipeline import bake, check, export_groom
from featherfx.errors import InputError
from featherfx.usd.check.skins import measure_roots
from featherfx.usd.read.contents import PrimReport, inspect_stage

_SUFFIXES = (".usd", ".usda", ".usdc", ".usdz")
_MAX_SECONDS = 300.0  # s, of one file
_COUNT = 4  # feathers of a mesh
_FRAMES = 3
_LENGTH_RATIO, _MIN_LENGTH, _MAX_LENGTH = 0.1, 1e-4, 1.0  # of a mesh's diagonal; m


@dataclass
class FileOutcome:
    """Outcome of one file. inspect, groom, bake, check: ok, or why not. meshes: that were groomed,
    of those that the stage holds. moving: of those. root_error: m, largest distance of a root from
    its place on the mesh as USD evaluates it; None where none was compared.
    """

    file: str
    inspect: str = "-"
    groom: str = "-"
    bake: str = "-"
    check: str = "-"
    meshes: tuple[int, int] = (0, 0)
    moving: int = 0
    root_error: float | None = None
    crashes: list[str] = field(default_factory=list)

    def run(self, step: str, work: Callable[[], Any]) -> Any:
        """Return what a step returns; None, after noting why, where it does not. The first failure
        of a step stays."""
        try:
            found = work()
        except InputError as error:
            setattr(self, step, f"refused: {error.problems[0]}")
        except Exception as error:  # whatever a file brings about is an outcome
            setattr(self, step, "crash")
            self.crashes.append(f"{step}: {type(error).__name__}: {error}")
        else:
            if getattr(self, step) == "-":
                setattr(self, step, "ok")
            return found
        return None


def list_files(paths: Sequence[Path]) -> list[Path]:
    """Return USD files, and those in folders and below."""
    found = [sorted(path.rglob("*")) if path.is_dir() else [path] for path in paths]
    return [file for each in found for file in each if file.suffix.lower() in _SUFFIXES]


def try_files(files: Sequence[Path]) -> Iterator[FileOutcome]:
    """Try files one after the other, in a process that USD may end."""
    pool = get_context("spawn").Pool(1)
    for file in files:
        try:
            yield pool.apply_async(try_file, (file,)).get(_MAX_SECONDS)
        except TimeoutError:
            pool.terminate()
            pool = get_context("spawn").Pool(1)
            told = f"ended the process, or took more than {_MAX_SECONDS:g} s"
            yield FileOutcome(str(file), crashes=[told])
    pool.terminate()


def try_file(file: Path) -> FileOutcome:
    """Try a file: inspect, groom, bake and check."""
    outcome = FileOutcome(str(file))
    with warnings.catch_warnings(), TemporaryDirectory(prefix="featherfx-") as name:
        warnings.simplefilter("ignore")
        folder = Path(name)
        report = outcome.run("inspect", lambda: inspect_stage(file))
        if report is None:
            return outcome
        if report.problems:
            outcome.inspect = f"ok, {len(report.problems)} told: {report.problems[0]}"
        every = report.of_kind("mesh")
        meshes = [each for each in every if each.triangles]
        outcome.meshes = len(meshes), len(every)
        outcome.moving = sum(each.moves is not None for each in meshes)
        for is_drawn in (True, False) if meshes else ():
            _grow_feathers(outcome, _write_files(folder, file, meshes, is_drawn))
        if outcome.bake == "ok":
            cache = folder / "cache.usda"
            outcome.root_error = outcome.run("bake", lambda: measure_roots(cache, file))
    return outcome


def _grow_feathers(outcome: FileOutcome, shot: Path) -> None:
    """Groom, bake and check a shot, as far as it goes."""
    groom, cache = shot.with_name("groom.toml"), shot.with_name("cache.usda")
    grown = shot.with_name("grown.usda")
    if not outcome.run("groom", lambda: export_groom(groom, grown, overwrite=True)):
        return
    options: dict[str, Any] = {"group": "feather", "overwrite": True}
    if outcome.run("bake", lambda: bake(shot, cache, **options)) is None:
        return
    if problems := outcome.run("check", lambda: check(cache)):
        outcome.check = f"{len(problems)} problems: {problems[0]}"


def _write_files(folder: Path, file: Path, meshes: Sequence[PrimReport], is_drawn: bool) -> Path:
    """Write a groom and a shot; return the shot."""
    skin = (
        f"[skin]\nusd = {json.dumps(str(file.absolute()))}\nprim = {json.dumps(meshes[0].path)}\n"
    )
    skin += f"subdivision = {json.dumps(is_drawn)}\n"
    groom = f'name = "corpus"\n{skin}'
    for number, mesh in enumerate(meshes):
        diagonal = math.hypot(*(mesh.size or (0.0,)))
        length = min(max(_LENGTH_RATIO * diagonal, _MIN_LENGTH), _MAX_LENGTH)
        groom += (
            f'[[region]]\nid = "r{number}"\nkind = "covert"\nprim = {json.dumps(mesh.path)}\n'
            f"count = {_COUNT}\nlength = {length}\nflow = {{ direction = [1, 0.3, 0.2] }}\n"
        )
    (folder / "groom.toml").write_text(groom)
    moves = [each.moves[0] for each in meshes if each.moves is not None]
    first = math.floor(min(moves, default=1.0))
    shot = folder / "shot.toml"
    shot.write_text(
        f'name = "corpus"\ngroom = "groom.toml"\nframes = [{first}, {first + _FRAMES - 1}]\n'
        f'quality = "draft"\npreroll = 0\nsettle = false\n{skin}extrapolation = "hold"\n'
        '[[detail]]\nlevel = "rigid"\n'
    )
    return shot


def outcome_rows(outcomes: Iterable[FileOutcome]) -> Iterator[tuple[object, ...]]:
    """Yield the cells of each file as it comes, then those of all."""
    done = []
    for each in outcomes:
        done.append(each)
        error = None if each.root_error is None else f"{1e3 * each.root_error:.3g}"
        meshes = f"{each.meshes[0]} of {each.meshes[1]}"
        steps = each.inspect, each.groom, each.bake, each.check
        yield each.file, meshes, each.moving, *steps, error, "; ".join(each.crashes)
    crashes = sum(bool(each.crashes) for each in done)
    errors = [each.root_error for each in done if each.root_error is not None]
    told = f"{len(done)} files", "", "", "", "", "", "", f"{1e3 * max(errors, default=0.0):.3g}"
    yield *told, f"{crashes} crashes"
