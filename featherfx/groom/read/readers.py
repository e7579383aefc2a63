"""Readers of scenes that a groom asks for; whoever knows USD hands them over."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from featherfx.algebra.types import Array
from featherfx.groom.keys.problems import Place

if TYPE_CHECKING:
    from featherfx.groom.read.rachis_curve import DrawnBarbs
    from featherfx.groom.skin.points import SkinSource


@dataclass(frozen=True)
class DrawnFeather:
    """One feather as found in a scene; metres, groom's frame (z up).

    label: prim path, with the number of the curve or instance where there are several. name: what
    to call it where no id is given. id, kind, region, skin: as given, else empty. points: (k, 3)
    the shaft, root first; a single point where nothing is drawn, and then direction is given.
    direction, up: (3,) or None. scale: factor of the length (of the kind, where nothing is drawn).
    mirrored: whether transforms mirror it. skin_uv: (2,) or None. barbs: of a condensed feather.
    """

    label: str
    name: str
    id: str
    kind: str
    region: str
    points: Array
    direction: Array | None
    up: Array | None
    scale: float
    mirrored: bool
    skin: str
    skin_uv: tuple[float, float] | None
    barbs: DrawnBarbs | None


# (checked entry of [[usd]], folder that its file is relative to, place of the entry) to the file
# and its feathers; raises InputError
SceneReader = Callable[[dict[str, Any], Path, Place], tuple[Path, list[DrawnFeather]]]
# (folder, checked keys of a curve, place) to its polylines (k, 3) m; raises InputError
CurveReader = Callable[[Path, dict[str, Any], Place], list[Array]]
# checked keys of [skin], paths of meshes with what names them, folder, [skin]; raises InputError
SkinsReader = Callable[[dict[str, Any], dict[str, Place], Path, Place], "dict[str, SkinSource]"]


def cache_skins(read: SkinsReader) -> SkinsReader:
    """A reader that reads each mesh of a groom once."""
    known: dict[str, SkinSource] = {}

    def reader(
        skin: dict[str, Any], paths: dict[str, Place], folder: Path, place: Place
    ) -> dict[str, SkinSource]:
        missing = {path: at for path, at in paths.items() if path not in known}
        known.update(read(skin, missing, folder, place) if missing else {})
        return {path: known[path] for path in paths}

    return reader


@dataclass(frozen=True)
class GroomReaders:
    """Readers of scenes for a groom; each raises InputError with the place of its table.

    file: where a file is that is named by someone in a folder.
    """

    feathers: SceneReader
    skin: SkinsReader
    curves: CurveReader
    file: Callable[[Path, str], Path]


@dataclass(frozen=True)
class SceneReaders(GroomReaders):
    """Readers of scenes. Each raises InputError, of what stands at the place.

    feathers, skin: see GroomReaders. meshes: (file, prim paths or names with the key that names
    each, checked keys of [skin] or [[collider]], place) to surfaces. wind: (file, checked keys of
    [wind_usd], place). attribute: the same of a curve. camera: (file, prim path, place) to a
    featherfx.shot.sources.Camera. poses: (file, time code or None, place) to the points (V, 3) m of
    the feathers' meshes there, or else of their shafts' curves (k, 3), by id. instances: (file,
    path of a PointInstancer, time codes, place) to the ids of its points, their places (K, N, 3) m
    and turns (K, N, 4), quaternions x, y, z, w, or None.
    """

    meshes: Callable[[Path, Mapping[str, Place], Mapping[str, Any], Place], Any]
    wind: Callable[[Path, dict[str, Any], Place], Any]
    attribute: Callable[[Path, dict[str, Any], Place], Any]
    camera: Callable[[Path, str, Place], Any]
    poses: Callable[[Path, float | None, Place], Any]
    instances: Callable[[Path, str, Any, Place], Any]
