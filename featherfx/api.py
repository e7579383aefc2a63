"""Grooms, shots and frames as Python objects, for programs that host featherfx.

No function here writes a file or keeps state between calls. USD files are read by whatever `pxr`
the process has, and only where a file is a USD file or names one.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from featherfx.errors import InputError, Problem

if TYPE_CHECKING:
    from featherfx.feather.types import Feather
    from featherfx.groom.types import Groom
    from featherfx.shot.read.sources import SceneReaders
    from featherfx.shot.simulate import Simulation
    from featherfx.shot.types import Quality, Shot

Folders = Iterable[str | Path]


def read_groom(
    path: str | Path,
    preset_folders: Folders = (),
    note: Callable[[Path], object] = lambda path: None,
) -> Groom:
    """The groom of a TOML or USD file: which feathers, where, metres and z up; laid over each other
    where it asks for that.

    preset_folders: searched before the user's and the shipped presets. note: is told every USD
    file that is read. Raises InputError with all problems of the file, of the tables and scenes
    that it names, and of the presets.
    """
    from featherfx.feather.layout.layout import lay_out
    from featherfx.groom.read import read

    return lay_out(read.read_groom(path, preset_folders, scene_readers(note)))


def read_shot(
    path: str | Path,
    preset_folders: Folders = (),
    note: Callable[[Path], object] = lambda path: None,
) -> Shot:
    """The shot of a TOML file with its groom, its feathers laid over each other where the groom
    asks for it, and its roots bound to the skin where it has one.

    preset_folders, note: as in read_groom. Raises InputError with all problems of shot, groom,
    scenes and presets; InputWarning for roots that are far from the skin, and for feathers that
    the layout leaves out or cannot part.
    """
    from featherfx.shot.placement import place_feathers
    from featherfx.shot.read import read

    return place_feathers(read.read_shot(path, preset_folders, scene_readers(note)))


def read_quality(name: str, preset_folders: Folders = ()) -> Quality:
    """A quality preset by its name. Raises InputError."""
    from featherfx.groom.presets.library import plain
    from featherfx.groom.presets.presets import load_preset
    from featherfx.shot.types import Quality

    _, tree = load_preset(f"quality/{name}", preset_folders)
    return Quality(name=name, **plain(tree))


def build(groom: Groom, quality: Quality | str = "final") -> tuple[Feather, ...]:
    """Rest geometry of every feather of a groom, in its order, each in its own frame.

    quality: gives rows and columns; a name is one of the presets on the default search path.
    Raises InputError with the problems of all feathers that cannot be built.
    """
    from featherfx.feather.scaled import feather_of

    grid = read_quality(quality) if isinstance(quality, str) else quality
    feathers, problems = [], dict[Problem, None]()
    for each in groom.feathers:
        try:
            feathers.append(feather_of(each, grid.rows, grid.columns))
        except InputError as error:
            problems |= dict.fromkeys(error.problems)
    if problems:
        raise InputError(*problems)
    return tuple(feathers)


def simulate(
    shot: Shot | str | Path, jobs: int = 1, frames: tuple[int, int] | None = None
) -> Simulation:
    """Simulate a shot, or a shot file; iterate over the result for its frames.

    jobs: threads. frames: first and last of those wanted; those before are computed all the same.
    Raises InputError here and, while iterating, SimulationError.
    """
    from featherfx.shot import simulate as loop

    return loop.simulate(read_shot(shot) if isinstance(shot, str | Path) else shot, jobs, frames)


def scene_readers(note: Callable[[Path], object] = lambda path: None) -> SceneReaders:
    """Readers of USD for read_shot, which import USD when they are first called.

    note: is told every file that is read.
    """
    from featherfx.shot.read.sources import SceneReaders

    def feathers(entry: Any, folder: Path, *arguments: Any) -> Any:
        from featherfx.usd.read.groom import read_feathers

        note(folder / entry["file"])
        return read_feathers(entry, folder, *arguments)

    def skin(entry: Any, paths: Any, folder: Path, *arguments: Any) -> Any:
        from featherfx.usd.read.skin import read_skin

        note(folder / entry["usd"])
        return read_skin(entry, paths, folder, *arguments)

    def curves(path: Path, *arguments: Any) -> Any:
        from featherfx.usd.read.skin import read_curves

        note(path)
        return read_curves(path, *arguments)

    def meshes(path: Path, *arguments: Any) -> Any:
        from featherfx.usd.read.scenes import open_meshes

        note(path)
        return open_meshes(path, *arguments)

    def wind(path: Path, *arguments: Any) -> Any:
        from featherfx.usd.read.scenes import open_wind

        note(path)
        return open_wind(path, *arguments)

    def camera(path: Path, *arguments: Any) -> Any:
        from featherfx.usd.read.camera import open_camera

        note(path)
        return open_camera(path, *arguments)

    return SceneReaders(feathers, skin, curves, meshes, wind, camera)
