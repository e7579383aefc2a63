"""Grooms, shots and frames as Python objects, for programs that host featherfx.

No function here writes a file or keeps state between calls. USD files are read by whatever `pxr`
the process has, and only where a file is a USD file or names one.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import replace
from importlib import import_module
from numbers import Integral
from pathlib import Path
from typing import TYPE_CHECKING, Any

from featherfx.errors import InputError, Problem, require_type
from featherfx.feather.placed_feathers import build_feathers
from featherfx.feather.types import Feather
from featherfx.files.folders import folders_of
from featherfx.groom.document import Document
from featherfx.groom.presets.presets import read_quality as read_quality
from featherfx.groom.read.read import load_tables
from featherfx.groom.read.read import read_groom as read_groom_file
from featherfx.groom.read.space import SceneReaders
from featherfx.groom.types import Groom
from featherfx.phases import Progress, StageRead, listen_to_reads, phase, tells_progress
from featherfx.shot.loop.placement import lay_out, place_feathers
from featherfx.shot.read.read import read_shot as read_shot_file
from featherfx.shot.types import Quality, Shot

if TYPE_CHECKING:
    from featherfx.shot.loop.simulate import Checkpoint, Simulation

Folders = Iterable[str | Path]


@tells_progress
def read_groom(
    path: str | Path, preset_folders: Folders = (), *, progress: Progress = False
) -> Groom:
    """Read the groom of a TOML or USD file, and layer its feathers where it has a layout.

    preset_folders: searched before the user's and the shipped presets. progress: as of
    featherfx.phases.tells_progress. Raises InputError with all
    problems of the file, of the tables and scenes that it names, and of the presets.
    """
    groom: Groom = open_document("groom", path, preset_folders).read()
    return groom


@tells_progress
def read_shot(
    path: str | Path, preset_folders: Folders = (), *, progress: Progress = False
) -> Shot:
    """Read the shot of a TOML file with its groom, and bind its roots to the skin where it has one.

    preset_folders, progress: as in read_groom. Raises InputError with all problems of shot, groom,
    scenes and presets; InputWarning for roots that are far from the skin, and for feathers that the
    layout leaves out or cannot part.
    """
    shot: Shot = open_document("shot", path, preset_folders).read()
    return shot


def open_document(kind: str, path: str | Path, preset_folders: Folders = ()) -> Document:
    """Load the tables of a groom or shot file, not yet checked. Raises InputError."""
    require_type(kind, path, str | Path, f"the path of a {kind} file")
    source = Path(path)
    return Document(kind, load_tables(source), source, folders_of(preset_folders))


def read_document(document: Document) -> Groom | Shot:
    """Read the groom or shot of a document, which it has with what was read. Raises InputError."""
    files: list[Path] = []
    reads: list[StageRead] = []
    with listen_to_reads(reads.append):
        read: Groom | Shot
        if document.kind == "groom":
            read = lay_out(groom_as_written(document, files.append))
        else:
            shot = place_feathers(shot_as_written(document, files.append))
            read = replace(shot, groom=shot.groom.documented(_groom_document(document, shot)))
    return read.documented(replace(document, files=tuple(files), reads=tuple(reads)))


def _groom_document(document: Document, shot: Shot) -> Document:
    """Return the tables of a shot's groom, with the shot's overrides. document: of the shot."""
    tables, source = document.tables["groom"], document.source
    if isinstance(tables, str):
        source = shot.groom.source
        tables = load_tables(source)
    groom = Document("groom", tables, source, document.preset_folders)
    overrides = document.tables.get("overrides")
    return groom.with_overrides(overrides) if overrides else groom


def groom_as_written(
    document: Document, note: Callable[[Path], object] = lambda path: None
) -> Groom:
    """Read the groom before its feathers are laid over each other, which costs most.

    note: is told every USD file that is read. Raises InputError.
    """
    with phase("reading", 1.0):
        return read_groom_file(*_arguments(document, note))


def shot_as_written(document: Document, note: Callable[[Path], object] = lambda path: None) -> Shot:
    """Read the shot before its feathers are placed, which costs most; as groom_as_written."""
    with phase("reading", 1.0):
        return read_shot_file(*_arguments(document, note))


def _arguments(document: Document, note: Callable[[Path], object]) -> tuple[Any, ...]:
    return document.source, document.preset_folders, scene_readers(note), document.tables


def build(groom: Groom, quality: Quality | str = "final") -> tuple[Feather, ...]:
    """Build the rest geometry of every feather of a groom, in its order, each in its own frame.

    quality: gives rows and columns; a name is one of the presets on the default search path.
    Raises InputError with the problems of all feathers that cannot be built.
    """
    require_type("groom", groom, Groom, "a Groom, such as shot.groom or read_groom(path)")
    require_type("quality", quality, str | Quality, "a preset's name, or a Quality")
    grid = read_quality(quality) if isinstance(quality, str) else quality
    return tuple(build_feathers(groom.feathers, grid.rows, grid.columns))


def simulate(
    shot: Shot | str | Path,
    jobs: int = 1,
    frames: tuple[int, int] | None = None,
    start: Checkpoint | None = None,
) -> Simulation:
    """Simulate a shot, or a shot file; iterate over the result for its frames.

    jobs: threads. frames: first and last of those wanted; those before are computed all the same.
    start: `checkpoint()` of another simulation, to go on after its last frame; the shot may differ
    from that one's in its loads and motion, not in feathers, quality or frame rate. Raises
    InputError here and, while iterating, SimulationError.
    """
    # the solver takes its time to load, which nothing else here needs
    from featherfx.shot.loop import simulate as loop

    require_type("shot", shot, Shot | str | Path, "a Shot, or the path of a shot file")
    whole = read_shot(shot) if isinstance(shot, str | Path) else shot
    require_type("jobs", jobs, Integral, "a whole number of threads")
    if jobs < 1:
        raise InputError(Problem("simulate", "jobs", f"{jobs} is not allowed. Give 1 or more"))
    if frames is not None:
        # raise TypeError or InputError for what is no range of frames of a shot
        require_type("frames", frames, tuple | list, "(first, last)")
        for each in frames:
            require_type("frames", each, Integral, "whole numbers")
        first, last = whole.first_frame, whole.last_frame
        if len(frames) != 2 or not first <= frames[0] <= frames[1] <= last:
            told = f"{tuple(frames)} is no range of its frames"
            told += f". Give (first, last) in {first} to {last}"
            raise InputError(Problem(str(whole.source), "frames", told))
    if start is not None:
        require_type("start", start, loop.Checkpoint, "a checkpoint() of another simulation")
    return loop.simulate(whole, jobs, frames, start=start)


def scene_readers(note: Callable[[Path], object] = lambda path: None) -> SceneReaders:
    """Readers of USD for read_shot, which import USD when they are first called.

    note: is told every file that is read.
    """

    def reader(module: str, name: str, file: Callable[..., Path]) -> Callable[..., Any]:
        def read(*arguments: Any) -> Any:
            note(file(*arguments))
            return getattr(import_module(f"featherfx.usd.read.{module}"), name)(*arguments)

        return read

    def itself(path: Path, *_: Any) -> Path:
        return path

    return SceneReaders(
        feathers=reader(
            "groom", "read_feathers", lambda entry, folder, *_: _located(folder, entry["file"])
        ),
        skin=reader(
            "skin", "read_skin", lambda skin, paths, folder, *_: _located(folder, skin["usd"])
        ),
        curves=reader(
            "skin", "read_curves", lambda folder, entry, *_: _located(folder, entry["usd"])
        ),
        meshes=reader("scenes", "open_meshes", itself),
        wind=reader("scenes", "open_wind", itself),
        attribute=reader("scenes", "open_attribute", itself),
        camera=reader("scenes", "open_camera", itself),
        poses=reader("scenes", "read_poses", itself),
        instances=reader("scenes", "read_instances", itself),
        file=_located,
    )


def _located(folder: Path, name: str) -> Path:
    """Find a file as USD does; USD is imported only for what is not in the folder."""
    path = folder / name
    if path.exists():
        return path
    found: Path = import_module("featherfx.usd.read.values").locate_file(folder, name)
    return found
