"""Checks of files of every kind."""

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

from featherfx.api import Folders, read_groom, read_quality, read_shot, scene_readers
from featherfx.baking.bake import bake
from featherfx.baking.entries import refuse_too_large
from featherfx.baking.export import export_groom
from featherfx.baking.options import DrawnOptions
from featherfx.errors import InputError, Problem, all_of, require_type
from featherfx.feather.placed_feathers import build_feathers
from featherfx.feather.shapes import distinct_shapes
from featherfx.groom.read.toml_file import load_toml
from featherfx.groom.types import Groom
from featherfx.limits import MAX_TRIED, irregular
from featherfx.phases import Progress, tells_progress
from featherfx.shot.loop.run import ShotRun
from featherfx.shot.loop.skin_stages import CutStage
from featherfx.shot.motion.joint_tracks import find_tracks, rate_lines
from featherfx.shot.motion.motion import root_motion
from featherfx.shot.options import ShotOptions
from featherfx.shot.read.read import check_file
from featherfx.shot.types import Shot
from featherfx.usd.check.skins import measure_roots
from featherfx.usd.read.contents import PrimReport, inspect_stage

Explained = dict[str, dict[str, dict[str, Any]]]
JointRates = dict[str, dict[str, float]]

# units of options that have one
_UNITS = {
    "tolerance": "m", "newton_tolerance": "m", "contact_tolerance": "m",
    "unpressed_newton_tolerance": "m", "max_substeps": "a frame",
}  # fmt: skip
# ids that a line of like feathers names
_MAX_NAMED = 3


def explain_options(
    path: str | Path, preset_folders: Folders = (), feather: str | None = None
) -> tuple[Explained, JointRates]:
    """Return how the feathers of a shot are simulated: by id, by option, `value` and `from`; and
    the largest speed (m/s), turn (rad/s) and acceleration (m/s2) of its joints, none where a skin
    alone moves it.

    feather: id of one of them; default: all. Raises InputError for what is wrong with the shot, and
    where it has no such feather.
    """
    shot = read_shot(path, preset_folders)
    run = ShotRun(shot, 1, 1, None)
    if shot.has_moving_roots:
        CutStage(run)  # options follow the roots as a bake moves them
    found = explained_options(shot, run.options)
    moves = shot.skin is None or shot.motion.of_limbs
    rates = find_tracks(shot).largest_rates() if moves else {}
    if feather is None:
        return found, rates
    if feather not in found:
        some = ", ".join(list(found)[:_MAX_NAMED])
        message = f"The shot has no feather '{feather}'. Give one of its ids, such as {some}."
        raise InputError(Problem(str(path), "", message))
    return {feather: found[feather]}, rates


def explained_options(shot: Shot, options: ShotOptions) -> Explained:
    """Return resolved options of a shot by id, by option, `value` and `from`."""
    return {
        placement.id: {
            name: {"value": value, "from": own.sources.get(name, "default")}
            for name, value in own.values().items()
            if value is not None
        }
        for placement, own in zip(shot.groom.feathers, options.feathers, strict=True)
    }


def explained_lines(found: Explained, rates: JointRates) -> Iterator[str]:
    """Yield explained options for people: a line for feathers with the same ones, or of a single
    feather a line for each option; and a line for each joint that moves."""
    yield from rate_lines(rates)
    if len(found) == 1:
        ((name, options),) = found.items()
        yield name
        yield from (f"  {_text(option, each)}" for option, each in options.items())
        return
    alike: dict[str, list[str]] = {}
    for name, options in found.items():
        line = "; ".join(_text(option, each) for option, each in options.items())
        alike.setdefault(line, []).append(name)
    for line, names in alike.items():
        yield f"{_named(names)}: {line}"


def _text(option: str, each: dict[str, Any]) -> str:
    value = each["value"]
    text = f"{value:.4g}" if isinstance(value, float) else str(value)
    unit = _UNITS.get(option, "")
    return f"{option} {text}{unit and ' '}{unit} ({each['from']})"


def _named(names: Sequence[str]) -> str:
    if len(names) == 1:
        return names[0]
    more = ", ..." if len(names) > _MAX_NAMED else ""
    return f"{len(names)} feathers ({', '.join(names[:_MAX_NAMED])}{more})"


@tells_progress
def check(
    source: str | Path | Shot | Groom, preset_folders: Folders = (), *, progress: Progress = False
) -> list[Problem]:
    """Find the problems of a groom, preset, shot or USD file, or of a groom or shot in memory.

    Grooms and shots without a wrong value are also tried: their feathers are built and the motion
    is fitted to the joints. progress: as of featherfx.phases.tells_progress. InputWarning for what
    of a shot's channels and targets is not felt.
    """
    folders = tuple(preset_folders)
    if isinstance(source, Shot | Groom):
        return _tried(source)
    require_type("source", source, str | Path, "a Shot, a Groom, or the path of a file")
    path = Path(source)
    if not path.is_file():
        odd = irregular(path)
        told = f"{odd}. Name a file" if odd else "there is no such file. Check the path"
        return [Problem(str(path), "", told)]
    if path.suffix in (".usd", ".usda", ".usdc"):
        # checks of other files do without USD
        from featherfx.usd.check.check import check_file as check_usd

        return check_usd(path)
    if path.suffix != ".toml":
        suffixes = ".toml, .usd, .usda and .usdc"
        return [Problem(str(path), "", f"suffix '{path.suffix}' is not one of {suffixes}")]
    if "flock" in load_toml(path):
        from featherfx.shot.read.flock import read_flock

        try:
            read_flock(path, folders, scene_readers())
        except InputError as error:
            return list(error.problems)
        return []
    try:
        given = _shot_or_groom(path, folders)
        tried = None if given is None else _tried(given)
    except InputError as error:
        # the reader finds all that is wrong in the files; what it does not, shows when it is tried
        return check_file(path, folders, scene_readers()) or list(error.problems)
    return check_file(path, folders, scene_readers()) if tried is None else tried


def _shot_or_groom(path: Path, folders: Sequence[str | Path]) -> Shot | Groom | None:
    """Read a shot or groom; None where the file is neither. Raises InputError."""
    keys = load_toml(path)
    if "groom" in keys:
        return read_shot(path, folders)
    if {"feather", "row", "table", "usd", "region"} & keys.keys():
        return read_groom(path, folders)
    return None


def _tried(given: Shot | Groom) -> list[Problem]:
    """Problems of a shot or groom that show only when feathers are built and moved."""
    tasks: list[Callable[[], Any]] = []
    if isinstance(given, Shot):
        groom, grid = given.groom, given.quality
        tasks.append(lambda: _try_motion(given))
    else:
        folders = given.document.preset_folders if given.document else ()
        groom, grid = given, read_quality("final", folders)
    refuse_too_large(groom, grid, DrawnOptions(), str(given.source))
    first, _ = distinct_shapes(groom.feathers)
    tried = first[:: 1 + len(first) // MAX_TRIED]
    some = [groom.feathers[k] for k in tried]
    tasks.append(lambda: build_feathers(some, grid.rows, grid.columns))
    try:
        all_of(*tasks)
    except InputError as error:
        return list(error.problems)
    return []


def _try_motion(shot: Shot) -> None:
    """Fit the motion of a shot to its joints, and files of its targets to its feathers; warn of
    channels that are not felt. Raises InputError."""
    motion = root_motion(shot)
    if not (shot.targets or shot.channels):
        return
    # what only directed shots load
    from featherfx.shot.direction.channels import FELT, warn_of_unfelt
    from featherfx.shot.direction.targets import refuse_other_shapes
    from featherfx.shot.loop.run import drawn_feathers
    from featherfx.shot.options import resolve_options

    felt = any(channel.name in FELT for channel in shot.channels)
    drawn = drawn_feathers(shot) if shot.targets or felt else ()
    refuse_other_shapes(shot, drawn, motion)
    if felt:
        warn_of_unfelt(shot, resolve_options(shot, drawn, motion).feathers)


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
