"""The space that a groom is written in: its points and directions in metres of the groom's frame.

A groom may be written in the units and axes of its skin. What its tables hold is found by the types
of their keys, so every point may be a landmark of the skin too.

Besides: readers of scenes that a groom asks for; whoever knows USD hands them over.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from featherfx.algebra.types import Array, Flags
from featherfx.algebra.vectors import distinct
from featherfx.errors import InputError
from featherfx.groom.course import Mirror
from featherfx.groom.keys.groom import GROOM_FILE
from featherfx.groom.keys.places import (
    SPHERE_TABLE,
    Direction,
    Length,
    Named,
    Point,
    Preset,
    Sphere,
    the_one,
)
from featherfx.groom.keys.problems import INVALID, Place
from featherfx.groom.keys.values import ArrayOf, Either, Partial, Table, Tables

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


_NAMES = ("vertex", "joint", "primvar")
# by which the axes of a prim may differ from a rotation and one scale
_SHEARED = 1e-4


@dataclass(frozen=True)
class Space:
    """A point x of the space stands at unit * axes x + origin in the groom's frame.

    axes: (3, 3) rotation, columns the axes of the space. unit: m. origin: (3,) m. left: (3,) unit,
    to the body's left, in the space's axes. given: whether it is another than the groom's frame.
    """

    axes: Array
    unit: float
    origin: Array
    left: Array
    given: bool = True

    def points(self, typed: Array) -> Array:
        """(..., 3) m in the groom's frame, of points of the space."""
        if not self.given:
            return typed
        return np.asarray(self.unit * (typed @ self.axes.T) + self.origin)

    def directions(self, typed: Array) -> Array:
        """(..., 3) in the groom's frame, of directions along the space's axes."""
        return np.asarray(typed @ self.axes.T) if self.given else typed

    def local(self, points: Array) -> Array:
        """(..., 3) points of the space, of points (..., 3) m of the groom's frame."""
        return np.asarray((points - self.origin) @ self.axes / self.unit) if self.given else points

    def is_left(self, points: Array) -> Flags:
        """(N,) whether points (N, 3) m of the groom's frame are on the body's left."""
        return np.asarray(self.local(points) @ self.left > 0.0)

    @property
    def forward(self) -> Array:
        """Return (3,) the body's forward in the groom's frame, level; 0 where left is upright."""
        return np.cross(self.axes @ self.left, [0.0, 0.0, 1.0])

    def mirror(self, axis: str) -> Mirror:
        """The plane at 0 of an axis, "x", "y" or "z"."""
        normal = self.axes[:, "xyz".index(axis)]
        return Mirror(normal, float(normal @ self.origin))


_GROOM_SPACE = Space(np.eye(3), 1.0, np.zeros(3), np.array([0.0, 1.0, 0.0]), False)


def in_groom(parts: dict[str, Any], place: Place, read: SkinsReader | None) -> Space:
    """The space of a groom, whose checked keys are changed to stand in the groom's frame.

    read: of skins. Problems go to place; what cannot be placed is INVALID.
    """
    skins = _Skins(parts["skin"], place, read)
    space = None
    with place.problems.collecting():
        space = _space(parts["space"], skins, place.child("space"))
    # of a space or a skin that cannot be read one problem is enough
    placing = _Placing(space or _GROOM_SPACE, skins if space else None)
    for name, key in GROOM_FILE.keys.items():
        parts[name] = placing.value(key.type, parts[name], place.child(name))
    _face(parts, placing.space)
    return placing.space


def _face(parts: dict[str, Any], space: Space) -> None:
    """Turn wings, tails and crests as the body stands, where they do not say how."""
    ahead = space.forward if space.forward.any() else np.array([1.0, 0.0, 0.0])
    ahead = ahead / np.linalg.norm(ahead)
    usual = {"forward": tuple(ahead), "up": (0.0, 0.0, 1.0), "direction": tuple(-ahead)}
    for name in ("wing", "tail", "crest"):
        for _, entry in parts[name]:
            entry |= {key: usual[key] for key in usual if entry.get(key, ahead) is None}


@dataclass(frozen=True)
class _Skins:
    """The skins of a groom, read when they are needed. skin: checked keys of [skin]."""

    skin: Any
    place: Place
    read: SkinsReader | None

    def find(self, prim: str | None, at: Place) -> SkinSource:
        """A skin by its path, that of [skin] by default. Raises InputError, of no problem where
        [skin] itself is known to be wrong."""
        if self.skin is None:
            at.refuse("is taken from the skin, and there is no [skin]. Add [skin]")
        if self.read is None:
            at.refuse("is of a USD scene, which featherfx.read_groom and the commands read")
        if not isinstance(self.skin, dict):
            raise InputError
        skin, folder = self.place.child("skin"), Path(self.place.source).parent
        path, named = (prim, at) if prim else (str(self.skin["prim"]), skin)
        return self.read(self.skin, {path: named.child("prim")}, folder, skin)[path]


def _space(checked: Any, skins: _Skins, place: Place) -> Space | None:
    """None where the table is wrong. Raises InputError where it cannot be placed."""
    if checked is None:
        return _GROOM_SPACE
    if checked is INVALID:
        return None
    of, left = checked["of"], checked["left"]
    if left is None and of != "groom":
        place.child("left").refuse("is missing. Give the axis of the space that is the body's left")
    side = _axis(left or "y")
    if of == "groom":
        return Space(np.eye(3), 1.0, np.zeros(3), side, False)
    source = skins.find(None, place.child("of"))
    matrix = source.stage_matrix if of == "stage" else source.own_matrix
    linear, origin = matrix[:3, :3].T, matrix[3, :3]
    unit = float(np.cbrt(np.linalg.det(linear)))
    axes = linear / (unit or 1.0)
    if not unit > 0.0 or np.abs(axes.T @ axes - np.eye(3)).max() > _SHEARED:
        message = "mirrored" if unit < 0.0 else "stretched or sheared"
        place.child("of").refuse(f"{source.path} is {message} by its transforms, expects 'stage'")
    if of != "body":
        return Space(axes, unit, origin, side)
    points = source.points[distinct(source.triangles)] @ axes
    low, high = points.min(axis=0), points.max(axis=0)
    return Space(axes, float(np.linalg.norm(high - low)), axes @ (0.5 * (low + high)), side)


def _axis(name: str) -> Array:
    sign = -1.0 if name.startswith("-") else 1.0
    return sign * np.eye(3)["xyz".index(name[-1])]


@dataclass(frozen=True)
class _Placing:
    """Turns checked values of a space into those of the groom's frame. skins: None where points
    cannot be placed."""

    space: Space
    skins: _Skins | None

    def value(self, kind: Any, value: Any, place: Place) -> Any:
        """A value of a type; INVALID after adding problems."""
        if value is None or value is INVALID or isinstance(kind, Preset):
            return value
        match kind:
            case Point() | Direction() | Length() if self.skins is None:
                return INVALID
            case Point():
                return self._point(value, place)
            case Sphere():
                return self._table(SPHERE_TABLE, value, place)
            case Direction():
                return tuple(self.space.directions(np.array(value)).tolist())
            case Length():
                return self.space.unit * value
            case Either():
                option = kind.options.get(list if isinstance(value, tuple) else type(value))
                return value if option is None else self.value(option, value, place)
            case ArrayOf():
                items = [self.value(kind.item, v, place.item(k)) for k, v in enumerate(value)]
                return INVALID if any(each is INVALID for each in items) else tuple(items)
            case Table():
                return self._table(kind, value, place)
            case Partial():
                return self._table(kind.table, value, place)
            case Tables():
                each = [(at, self._table(kind.table, table, at)) for at, table in value]
                return [(at, table) for at, table in each if table is not INVALID]
            case Named():
                return {k: self.value(kind.item, v, place.child(k)) for k, v in value.items()}
        return value

    def _table(self, kind: Table, value: dict[str, Any], place: Place) -> Any:
        found = {
            name: self.value(kind.keys[name].type, each, place.child(name))
            for name, each in value.items()
        }
        return INVALID if any(each is INVALID for each in found.values()) else found

    def _point(self, value: Any, place: Place) -> Any:
        if not isinstance(value, dict):
            return tuple(self.space.points(np.array(value)).tolist()) if self.space.given else value
        assert self.skins is not None
        with place.problems.collecting():
            name = the_one(_NAMES, value, place)
            found = _landmark(self.skins.find(value["prim"], place), name, value[name], place)
            offset = self.space.unit * self.space.directions(np.array(value["offset"]))
            return tuple((found + offset).tolist())
        return INVALID


def _landmark(skin: SkinSource, name: str, value: Any, place: Place) -> Array:
    """(3,) m. Raises InputError."""
    at = place.child(name)
    if name == "joint":
        return skin.joint(value, at)
    if name == "vertex":
        if value >= len(skin.points):
            points = f"{skin.path} has points 0 to {len(skin.points) - 1}"
            at.refuse(f"{value} is out of range, {points}")
        return skin.points[value]
    from featherfx.groom.skin.points import SkinSurface

    corners = skin.weights(value, at)
    surface = SkinSurface(skin)
    # a linear weight over a triangle: integrals of it and of it times the place
    fraction = np.maximum(corners, 0.0)
    whole = surface.areas * fraction.mean(axis=1)
    if not whole.sum() > 0.0:
        at.refuse(f"primvar '{value}' on {skin.path} is nowhere above 0")
    summed = np.einsum("tk,tkc->tc", fraction, surface.corners)
    across = fraction.sum(axis=1)[:, None] * surface.corners.sum(axis=1)
    return np.asarray((surface.areas[:, None] * (summed + across)).sum(axis=0) / 12.0 / whole.sum())
