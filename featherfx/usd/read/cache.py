"""Caches as numpy arrays."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from pxr import Usd, UsdGeom

from featherfx import usd
from featherfx.algebra.types import Array, Floats, Indices
from featherfx.algebra.vectors import unit
from featherfx.errors import InputError, Problem
from featherfx.phases import LeftOut
from featherfx.usd.read.cached_feather import (
    CachedFeather,
    FeatherMember,
    range_slice,
    read_mesh_feathers,
)
from featherfx.usd.read.drawn_meshes import DrawnMesh, FeatherLabels, drawn_meshes, list_undrawn
from featherfx.usd.read.stage import transform_points
from featherfx.usd.read.values import (
    DEFAULT_TIME,
    EARLIEST_TIME,
    NUMBER_ARRAY,
    VECTOR_ARRAY,
    ArrayKind,
    describe_time,
    open_stage,
    read_array,
    read_note,
    read_scenery,
    read_times,
    usd_errors,
)
from featherfx.usd.types import WET_PRIMVARS, StageSpace
from featherfx.usd.write.output import unique_prim_names
from featherfx.usd.write.prims import SUBSETS

if TYPE_CHECKING:
    from featherfx.usd.read.expand import Expansion


_MAX_FRAMES = 100_000  # of a file whose meshes have no samples that tell which there are


@dataclass(frozen=True)
class CachedPose:
    """One feather at one time, stage units, world space.

    points, velocities, normals: (V, 3), barb_direction: (T, 3), hooked: (T,) 1 to 0 where hooks are
    open; None where not authored (or of another size than the mesh).
    """

    points: Floats
    velocities: Floats | None
    normals: Floats | None
    barb_direction: Floats | None
    hooked: Floats | None


@dataclass
class _CachedMesh:
    """A mesh of the stage.

    Values at the last time code are kept where feathers share it.
    """

    drawn: DrawnMesh
    is_shared: bool
    code: Any = None
    values: dict[str, Any] = field(default_factory=dict)

    def read(self, name: str, code: Any, kind: ArrayKind) -> Any:
        """Return (N, ...) an attribute; None where there is no value."""
        if self.code != code:
            self.code, self.values = code, {}
        if name in self.values:
            return self.values[name]
        skinning = self.drawn.skinning if name == "points" else None
        if skinning is None:
            found = read_array(self.drawn.mesh.GetPrim().GetAttribute(name), code, kind)
        else:
            found = skinning.bind_points() if code.IsDefault() else skinning.points(code)
        if self.is_shared:
            self.values[name] = found
        return found

    def has(self, name: str) -> bool:
        """Return whether the mesh has an attribute."""
        return bool(self.drawn.mesh.GetPrim().HasAttribute(name))

    def matrix(self, code: Any) -> Array:
        """Return (4, 4) from the space of its points to the world."""
        return self.drawn.matrix(code)

    def times(self) -> list[float]:
        """Return time codes of its points."""
        return read_times(self.drawn.mesh.GetPointsAttr())


class _ExpandedMesh:
    """Condensed feathers as one mesh: points alone, in world space."""

    def __init__(self, expansion: Expansion) -> None:
        self._expansion = expansion
        self._code: Any = None
        self._points = np.zeros((0, 3), np.float32)

    def read(self, name: str, code: Any, kind: ArrayKind) -> Any:
        if self.has(name):
            return self._expansion.clumped(code)[:, WET_PRIMVARS.index(name)]
        if name != "points":
            return None
        if self._code != code:
            self._code, self._points = code, self._expansion.points(code).astype(np.float32)
        return self._points

    def has(self, name: str) -> bool:
        return name in WET_PRIMVARS and self._expansion.is_wet

    def matrix(self, code: Any) -> Array:
        return np.eye(4)

    def times(self) -> list[float]:
        return self._expansion.codes()


class _ValueRanges(NamedTuple):
    """Ranges of a feather's values: points and faces of a mesh.

    Of a condensed feather the faces are its rachis.
    """

    mesh: _CachedMesh | _ExpandedMesh
    points: slice
    faces: slice


class Cache:
    """Meshes of a USD file, or its condensed feathers where it has no mesh.

    Purposes other than default and render are left out. to_world: (3, 3), row vectors, from its
    stage to metres and z up. heading: deg, of the creature's forward from x about z, there.
    feathers: one entry per mesh, or instance of one, or feather of a shared one, in the order of
    the stage. frames: start and end time code. scenery: skins and colliders of its shot: role, file
    from its own folder, prim, time code `start` of that file at time code `first`, and `rest`, its
    time code at rest, where that is not its rest pose, and `variant_sets` that are chosen in it.
    Raises InputError if the file cannot be opened or holds no mesh.
    """

    def __init__(self, path: str | Path) -> None:
        self._path, self.path = str(path), Path(path).resolve()
        self._stage = open_stage(path)
        self.frames = (self._stage.GetStartTimeCode(), self._stage.GetEndTimeCode())
        self.has_frames = self._stage.HasAuthoredTimeCodeRange()
        self.frames_per_second = self._stage.GetTimeCodesPerSecond()
        self.meters_per_unit = UsdGeom.GetStageMetersPerUnit(self._stage)
        self.up_axis = str(UsdGeom.GetStageUpAxis(self._stage))
        self.to_world = StageSpace(self.meters_per_unit, self.up_axis).to_world
        self.heading = read_note(self._stage, "heading", 0.0)
        with usd_errors(self._stage.GetPseudoRoot()):
            self.scenery = tuple(read_scenery(self._stage))
        found = [(own, feather) for each in _read_meshes(self._stage) for own, feather in each]
        found = found or list(_read_condensed(self._stage))
        if not found:
            told = "holds no visible mesh. Give a baked cache or a groom"
            if any(prim.HasAttribute("primvars:P_barbl") for prim in self._stage.Traverse()):
                told += (
                    ". Its condensed feathers are without the shapes of `bake --as condensed`, so"
                    " they can only be read as a groom"
                )
            raise InputError(Problem(str(path), "", told))
        self._own = [own for own, _ in found]
        self._last_runs: tuple[list[int], list[list[int]]] = [], []
        names = unique_prim_names([feather.name for _, feather in found])
        self.feathers = tuple(
            replace(feather, name=name) for (_, feather), name in zip(found, names, strict=True)
        )

    @property
    def left(self) -> tuple[LeftOut, ...]:
        """Return what is not drawn of it."""
        return tuple(list_undrawn(self._stage))

    def codes(self) -> list[float]:
        """Return all time codes at which any mesh has points; else whole frames."""
        if not self.has_frames:
            return []
        meshes = {id(own.mesh): own.mesh for own in self._own}.values()
        found = {code for mesh in meshes for code in mesh.times()}
        first, last = self.frames
        return sorted(code for code in found if first <= code <= last) or self.whole_frames()

    def whole_frames(self) -> list[float]:
        """Return time codes of all whole frames. Raises InputError for too many."""
        first, last = self.frames
        if last - first > _MAX_FRAMES:
            message = f"is {last:g}, more than {_MAX_FRAMES} frames after the first, {first:g}"
            raise InputError(Problem(self._path, "endTimeCode", message))
        return [float(code) for code in range(int(np.ceil(first)), int(last) + 1)]

    def pose(self, index: int, time: float | None = None) -> CachedPose:
        """Return feather index at a time code.

        None is the rest pose: the default value, or the first sample where there is no default.
        """
        points, matrix, code = self._placed([index], time)
        direction = self._of_faces(index, "barbDirection", code, VECTOR_ARRAY)
        if direction is not None:
            direction = unit(direction @ matrix[:3, :3])
        velocities, normals = self._directions([index], matrix, code)
        return CachedPose(
            points=transform_points(points, matrix).astype(np.float32),
            velocities=velocities,
            normals=normals,
            barb_direction=direction,
            hooked=self._of_faces(index, "hooked", code, NUMBER_ARRAY),
        )

    def hooked_of(self, chosen: Sequence[int], time: float | None) -> Array:
        """Return (T,) hooks of the triangles of some feathers, one after the other.

        Values are those of `pose`; 1 where there are none.
        """
        found = []
        for index in chosen:
            code = _pose_time(self._own[index], time)
            own = self._of_faces(index, "hooked", code, NUMBER_ARRAY)
            found.append(np.ones(len(self.feathers[index].triangles)) if own is None else own)
        return np.concatenate(found).astype(float)

    @cached_property
    def _is_wet(self) -> bool:
        meshes = {id(own.mesh): own.mesh for own in self._own}.values()
        return any(mesh.has(WET_PRIMVARS[0]) for mesh in meshes)

    def clumped_of(self, chosen: Sequence[int], time: float | None) -> Array:
        """Return (N, 2) how far water draws the ends of barbs together, and into how many clumps.

        The former is 0 to 1, the latter counted along a vane.
        """
        found = np.zeros((len(chosen), 2))
        for place, index in enumerate(chosen) if self._is_wet else ():
            own = self._own[index]
            code = _pose_time(own, time)
            for k, name in enumerate(WET_PRIMVARS):
                values = own.mesh.read(name, code, NUMBER_ARRAY)
                if values is not None and (mine := values[own.faces]).size:
                    found[place, k] = mine[0]
        return found

    def _of_faces(self, index: int, name: str, code: Any, kind: ArrayKind) -> Any:
        """Return (T, ...) values of a primvar for the triangles of feather index."""
        own, feather = self._own[index], self.feathers[index]
        found = own.mesh.read(f"primvars:{name}", code, kind)
        mine = () if found is None else found[own.faces]
        return mine[feather.face] if len(mine) > feather.face.max(initial=0) else None

    def points(self, index: int, time: float | None = None) -> Array:
        """Return (V, 3) points of feather index as `pose` does, faster."""
        return self.points_of([index], time)[0]

    def points_of(self, chosen: Sequence[int], time: float | None = None) -> list[Array]:
        """Return (V, 3) points of each of some feathers as `pose` does.

        It is fastest where feathers of one mesh follow each other.
        """
        found = []
        for run in self._runs(chosen):
            points, matrix, _ = self._placed(run, time)
            moved = _to_world(points, matrix)
            own = [self._own[index].points for index in run]
            ends = [0 if each.start is None else each.start - own[0].start for each in own]
            found += [moved[a:b] for a, b in pairwise([*ends, len(moved)])]
        return found

    def directions_of(
        self, chosen: Sequence[int], time: float | None
    ) -> tuple[Array | None, Array | None]:
        """Return (V, 3) velocities and normals of some feathers, one after the other.

        Where only some have velocities the others have zeros; None where none has. Normals are None
        where a feather lacks them.
        """
        found, places = [], []
        for run in self._runs(chosen):
            points, *place = self._placed(run, time)
            found.append(self._directions(run, *place))
            places.append(np.zeros(points.shape, np.float32))
        rates, normals = zip(*found, strict=True)
        velocities = None
        if any(each is not None for each in rates):
            pairs = zip(rates, places, strict=True)
            velocities = np.concatenate([none if each is None else each for each, none in pairs])
        has_normals = all(each is not None for each in normals)
        return velocities, np.concatenate(normals) if has_normals else None

    def _directions(self, run: Sequence[int], matrix: Array, code: Any) -> tuple[Any, Any]:
        """Return velocities and normals of feathers that follow each other, as of _placed."""
        mesh = self._own[run[0]].mesh
        total = len(mesh.read("points", code, VECTOR_ARRAY))
        cut = slice(self._own[run[0]].points.start, self._own[run[-1]].points.stop)

        def of_points(name: str) -> Any:
            found = mesh.read(name, code, VECTOR_ARRAY)
            return None if found is None or len(found) != total else found[cut]

        normals, velocities = of_points("normals"), of_points("velocities")
        # Normals turn with the inverse transpose; row vectors here.
        return (
            None if velocities is None else velocities @ matrix[:3, :3],
            None if normals is None else unit(normals @ np.linalg.inv(matrix[:3, :3]).T),
        )

    def some_points_of(self, chosen: Sequence[int], time: float | None, among: Indices) -> Array:
        """Return (P, 3) points with the ascending numbers among (P,) of some feathers.

        Feathers and points are those of `points_of`.
        """
        found, before, first = [], 0, 0
        for run in self._runs(chosen):
            points, matrix, _ = self._placed(run, time)
            last = int(np.searchsorted(among, before + len(points)))
            found.append(_to_world(points[among[first:last] - before], matrix))
            before, first = before + len(points), last
        return np.concatenate(found)

    def _runs(self, chosen: Sequence[int]) -> list[list[int]]:
        """Return the feathers in runs whose points follow each other in one mesh."""
        if self._last_runs[0] != (chosen := list(chosen)):
            self._last_runs = chosen, list(self._new_runs(chosen))
        return self._last_runs[1]

    def _new_runs(self, chosen: Sequence[int]) -> Iterator[list[int]]:
        run: list[int] = []
        for index in chosen:
            if run:
                own, last = self._own[index], self._own[run[-1]]
                if own.mesh is not last.mesh or own.points.start != (last.points.stop or -1):
                    yield run
                    run = []
            run.append(index)
        if run:
            yield run

    def _placed(self, run: Sequence[int], time: float | None) -> tuple[Floats, Array, Any]:
        """Return points of a run in their mesh's space, the matrix to the world, and time code."""
        own, last, feather = self._own[run[0]], self._own[run[-1]], self.feathers[run[-1]]
        code = _pose_time(own, time)
        matrix = own.mesh.matrix(code)
        points = own.mesh.read("points", code, VECTOR_ARRAY)
        if points is None:
            raise InputError(
                Problem(self._path, f"{feather.path}.points", f"no value {describe_time(code)}")
            )
        chosen = points[slice(own.points.start, last.points.stop)]
        message, named = "", int(feather.triangles.max(initial=-1)) + (last.points.start or 0)
        if named >= len(points):
            message = f"has {len(points)} points {describe_time(code)}, fewer than its faces name"
        elif not np.isfinite(chosen).all():
            message = f"holds values that are not finite {describe_time(code)}"
        if message:
            raise InputError(Problem(self._path, f"{feather.path}.points", message))
        if not np.isfinite(matrix).all() or np.linalg.det(matrix[:3, :3]) == 0.0:
            message = f"has transforms {describe_time(code)} that are not finite, or flatten it"
            raise InputError(Problem(self._path, feather.path, message))
        return chosen, matrix, code


def _pose_time(own: _ValueRanges, time: float | None) -> Any:
    """Return the time code of a pose."""
    if time is not None:
        return Usd.TimeCode(time)
    return (
        EARLIEST_TIME
        if own.mesh.read("points", DEFAULT_TIME, VECTOR_ARRAY) is None
        else DEFAULT_TIME
    )


def _read_meshes(stage: Any) -> Iterator[list[tuple[_ValueRanges, CachedFeather]]]:
    """Yield the feathers of every drawn mesh; instances share constant parts."""
    known: dict[str, list[tuple[FeatherMember, CachedFeather]]] = {}
    for each in drawn_meshes(stage):
        path = str(each.mesh.GetPath())
        if path not in known:
            known[path] = read_mesh_feathers(each.mesh)
        labels = each.labels
        mesh = _CachedMesh(each, len(known[path]) > 1)
        yield [
            (
                _ValueRanges(mesh, range_slice(member.points), range_slice(member.faces)),
                feather if labels is None else _labelled(feather, labels),
            )
            for member, feather in known[path]
        ]


def _labelled(feather: CachedFeather, labels: FeatherLabels) -> CachedFeather:
    """Return an instance's feather."""
    told = {name: value for name, value in vars(labels).items() if value is not None}
    return replace(feather, **told, is_feather=True)


def _read_condensed(stage: Any) -> Iterator[tuple[_ValueRanges, CachedFeather]]:
    """Yield the condensed feathers of a stage as meshes; none where it has none."""
    if not usd.expand.condensed_prims(stage):
        return
    expansion = usd.expand.expand(stage)
    mesh, rest, colours = _ExpandedMesh(expansion), expansion.points(), expansion.colours
    for number, each in enumerate(expansion.feathers):
        own = _ValueRanges(mesh, each.points, slice(number, number + 1))
        shades = None if colours is None else colours[number]
        film = None if shades is None else shades.shading.get("film")
        yield (
            own,
            CachedFeather(
                path=expansion.path,
                name=each.id,
                id=each.id,
                kind=each.kind,
                region=each.region,
                triangles=each.triangles,
                side=each.side,
                face=np.arange(len(each.triangles)),
                subsets={
                    name: np.flatnonzero(each.side == part)
                    for name, part in SUBSETS.items()
                    if (each.side == part).any()
                },
                rest=rest[each.points].astype(np.float32),
                st=each.st.astype(np.float32),
                colour=None if shades is None else shades.points.astype(np.float32),
                is_feather=True,
                look=each.look,
                barb_count=each.barb_count,
                film=None if film is None else (1e9 * film).astype(np.float32),
            ),
        )


def _to_world(points: Floats, matrix: Array) -> Array:
    """Return points in the world, in double precision."""
    exact: Array = points.astype(float)
    return transform_points(exact, matrix) if (matrix != np.eye(4)).any() else exact
