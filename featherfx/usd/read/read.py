"""Caches read back: what pictures, tests and checks need of a USD file, as numpy arrays."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pxr import Usd, UsdGeom

from featherfx.errors import InputError, Problem
from featherfx.feather.types import LEADING
from featherfx.usd.read.animated_mesh import fans, topology_of
from featherfx.usd.read.drawn_meshes import DrawnMesh, drawn_meshes
from featherfx.usd.read.opening import open_stage
from featherfx.usd.read.values import (
    DEFAULT,
    EARLIEST,
    INTEGERS,
    NUMBERS,
    PAIRS,
    VECTORS,
    Kind,
    array_of,
    at,
    elements,
    fault,
    flattened,
    numbers_of,
    reading,
    sized_array,
    text_of,
    times_of,
    value_of,
)

Array = NDArray[np.float64]
Floats = NDArray[np.float32]
Indices = NDArray[np.int64]

MOST_FRAMES = 100_000  # of a file whose meshes have no samples that tell which there are


@dataclass(frozen=True)
class CachedFeather:
    """The constant part of one mesh.

    path: of the prim. id, kind, region: labels (id: the prim's name where none is authored).
    is_feather: whether an id is authored.
    triangles: (T, 3) point indices; faces with more sides are cut into fans. side: (T,) 0 leading,
    1 trailing, 2 rachis (0 where unknown). face: (T,) face that the triangle was cut from.
    subsets: name to face indices. rest: (V, 3), st: (V, 2) and colour: (V, 3), displayColor (the
    mean of a point's faces where it is of faces), None where not authored.
    """

    path: str
    id: str
    kind: str
    region: str
    triangles: Indices
    side: Indices
    face: Indices
    subsets: Mapping[str, Indices]
    rest: Floats | None
    st: Floats | None
    colour: Floats | None
    is_feather: bool


@dataclass(frozen=True)
class CachedPose:
    """One feather at one time, stage units, world space.

    points, velocities, normals: (V, 3), barb_direction: (T, 3), hooked: (T,) 1 to 0 where hooks are
    open, extent: (2, 3) in object space; None where not authored (or of another size than the
    mesh).
    """

    points: Floats
    velocities: Floats | None
    normals: Floats | None
    barb_direction: Floats | None
    hooked: Floats | None
    extent: Floats | None


class Cache:
    """A USD file with its meshes; purposes other than default and render are left out.

    feathers: one entry per mesh, or instance of one, in the order of the stage. frames: start and
    end time code. scenery: skins and colliders of its shot: role, file from its own folder, prim,
    and time code `start` of that file at time code `first`.
    Raises InputError if the file cannot be opened or holds no mesh.
    """

    def __init__(self, path: str | Path) -> None:
        self._path = str(path)
        self._stage = open_stage(path)
        self.frames = (self._stage.GetStartTimeCode(), self._stage.GetEndTimeCode())
        self.has_frames = self._stage.HasAuthoredTimeCodeRange()
        self.frames_per_second = self._stage.GetTimeCodesPerSecond()
        self.meters_per_unit = UsdGeom.GetStageMetersPerUnit(self._stage)
        self.up_axis = str(UsdGeom.GetStageUpAxis(self._stage))
        with reading(self._stage.GetPseudoRoot()):
            self.scenery = tuple(_scenery(self._stage))
        drawn = list(drawn_meshes(self._stage))
        if not drawn:
            raise InputError(Problem(str(path), "", "holds no visible mesh"))
        self._meshes = [each.mesh for each in drawn]
        self._matrices = [each.matrix for each in drawn]
        self._skinnings = [each.skinning for each in drawn]
        self.feathers = tuple(_constant_parts(drawn))

    def codes(self) -> list[float]:
        """All time codes at which any mesh has points; whole frames where none has samples."""
        if not self.has_frames:
            return []
        found = {code for mesh in self._meshes for code in times_of(mesh.GetPointsAttr())}
        first, last = self.frames
        return sorted(code for code in found if first <= code <= last) or self.whole_frames()

    def whole_frames(self) -> list[float]:
        """Time codes of all whole frames. Raises InputError where they are beyond number."""
        first, last = self.frames
        if last - first > MOST_FRAMES:
            message = f"is {last:g}, more than {MOST_FRAMES} frames after the first, {first:g}"
            raise InputError(Problem(self._path, "endTimeCode", message))
        return [float(code) for code in range(int(np.ceil(first)), int(last) + 1)]

    def pose(self, index: int, time: float | None = None) -> CachedPose:
        """Feather index at a time code.

        None is the rest pose: the default value, or the first sample where there is no default.
        """
        mesh, feather = self._meshes[index], self.feathers[index]
        points, matrix, code = self._placed(index, time)
        count = len(points)
        direction = _of_faces(mesh, "barbDirection", code, VECTORS, feather.face)
        if direction is not None:
            direction = _unit(direction @ matrix[:3, :3])
        normals = _sized(mesh.GetNormalsAttr(), code, VECTORS, count)
        velocities = _sized(mesh.GetVelocitiesAttr(), code, VECTORS, count)
        # Normals turn with the inverse transpose; row vectors here.
        turned = None if normals is None else _unit(normals @ np.linalg.inv(matrix[:3, :3]).T)
        return CachedPose(
            points=(points @ matrix[:3, :3] + matrix[3, :3]).astype(np.float32),
            velocities=None if velocities is None else velocities @ matrix[:3, :3],
            normals=turned,
            barb_direction=direction,
            hooked=_of_faces(mesh, "hooked", code, NUMBERS, feather.face),
            extent=_sized(mesh.GetExtentAttr(), code, VECTORS, 2),
        )

    def points(self, index: int, time: float | None = None) -> Array:
        """(V, 3) points of feather index as `pose` has them, faster."""
        points, matrix, _ = self._placed(index, time)
        return np.asarray(points @ matrix[:3, :3] + matrix[3, :3])

    def _placed(self, index: int, time: float | None) -> tuple[Floats, Array, Any]:
        """Points in the space of the mesh's matrix, that matrix, and the time code they are of."""
        mesh, feather = self._meshes[index], self.feathers[index]
        code = DEFAULT if time is None else Usd.TimeCode(time)
        if time is None and value_of(mesh.GetPointsAttr(), code) is None:
            code = EARLIEST
        matrix = self._matrices[index](code)
        points = self._points(index, code)
        if points is None:
            raise InputError(Problem(self._path, f"{feather.path}.points", f"no value {at(code)}"))
        self._check_pose(feather, points, matrix, code)
        return points, matrix, code

    def _check_pose(self, feather: CachedFeather, points: Floats, matrix: Array, code: Any) -> None:
        """Raise InputError for a pose that cannot be drawn."""
        message = ""
        if feather.triangles.max(initial=-1) >= len(points):
            message = f"has {len(points)} points {at(code)}, fewer than its faces name"
        elif not np.isfinite(points).all():
            message = f"holds values that are not finite {at(code)}"
        if message:
            raise InputError(Problem(self._path, f"{feather.path}.points", message))
        if not np.isfinite(matrix).all() or np.linalg.det(matrix[:3, :3]) == 0.0:
            message = f"has transforms {at(code)} that are not finite, or flatten it"
            raise InputError(Problem(self._path, feather.path, message))

    def _points(self, index: int, code: Any) -> Floats | None:
        """(P, 3) in the space of the mesh's matrix; None where it has none."""
        skinning = self._skinnings[index]
        if skinning is None:
            return array_of(self._meshes[index].GetPointsAttr(), code, VECTORS)
        return skinning.bind_points() if code.IsDefault() else skinning.points(code)


def _constant_parts(drawn: Sequence[DrawnMesh]) -> Iterator[CachedFeather]:
    """Of all meshes; what instances share is read once."""
    known: dict[str, CachedFeather] = {}
    for each in drawn:
        path = str(each.mesh.GetPath())
        if path not in known:
            known[path] = _constant_part(each.mesh)
        labels = each.labels
        yield (
            known[path] if labels is None else replace(known[path], **vars(labels), is_feather=True)
        )


def _scenery(stage: Any) -> Iterator[dict[str, Any]]:
    """The scenery of a shot as its cache tells it; entries that are not as written are left out."""
    told = stage.GetRootLayer().customLayerData.get("featherfx")
    entries = told.get("scenery") if isinstance(told, dict) else None
    kinds = {"role": str, "file": str, "prim": str, "start": float, "first": float}
    for entry in entries.values() if isinstance(entries, dict) else ():
        if isinstance(entry, dict) and all(
            isinstance(entry.get(key), kind) for key, kind in kinds.items()
        ):
            yield entry


def _of_faces(mesh: Any, name: str, code: Any, kind: Any, face: Indices) -> Any:
    """(T, ...) values of a primvar of faces for triangles; None where there are none that fit."""
    found = array_of(UsdGeom.PrimvarsAPI(mesh).GetPrimvar(name).GetAttr(), code, kind)
    if found is None or len(found) <= face.max(initial=-1):
        return None
    return found[face]


def _sized(attribute: Any, code: Any, kind: Kind, count: int) -> Any:
    """An array (count, ...); None if there is none, or not of count elements."""
    value = array_of(attribute, code, kind)
    return value if value is None or len(value) == count else None


def _unit(vectors: Any) -> Any:
    length = np.linalg.norm(vectors, axis=1, keepdims=True)
    return vectors / np.where(length > 0, length, 1.0)


def _constant_part(mesh: Any) -> CachedFeather:
    prim = mesh.GetPrim()
    primvars = UsdGeom.PrimvarsAPI(prim)
    counts, indices = topology_of(mesh)
    points = array_of(mesh.GetPointsAttr(), EARLIEST, VECTORS)
    total = 0 if points is None else len(points)
    inside = ((indices >= 0) & (indices < total)).all()
    if (counts < 0).any() or counts.sum() != len(indices) or not inside:
        raise fault(mesh.GetFaceVertexIndicesAttr(), "do not fit the mesh's points and counts")
    corners, face = fans(counts)

    def label(name: str, fallback: str) -> str:
        return text_of(primvars.GetPrimvar(name).GetAttr()) or fallback

    def own(name: str, kind: Kind, count: int) -> Any:
        return _sized(primvars.GetPrimvar(name).GetAttr(), EARLIEST, kind, count)

    side = own("side", INTEGERS, len(counts))
    authored = text_of(primvars.GetPrimvar("featherId").GetAttr())
    subsets = UsdGeom.Subset.GetAllGeomSubsets(mesh)
    return CachedFeather(
        path=str(prim.GetPath()),
        id=authored or prim.GetName(),
        kind=label("featherKind", ""),
        region=label("region", ""),
        triangles=indices[corners],
        side=np.full(len(face), LEADING) if side is None else side.astype(np.int64)[face],
        face=face,
        subsets={
            s.GetPrim().GetName(): sized_array(s.GetIndicesAttr(), EARLIEST, INTEGERS).astype(
                np.int64
            )
            for s in subsets
        },
        rest=own("rest", VECTORS, total),
        st=own("st", PAIRS, total),
        colour=_vertex_colours(
            primvars.FindPrimvarWithInheritance("displayColor"), counts, indices, total
        ),
        is_feather=bool(authored),
    )


def _vertex_colours(primvar: Any, counts: Any, indices: Any, total: int) -> Floats | None:
    """(V, 3) of a colour primvar of any interpolation; None where none fits the mesh."""
    value = flattened(primvar, EARLIEST)
    if value is None or not len(indices):
        return None
    colours = numbers_of(elements(value), VECTORS, primvar.GetAttr()).astype(np.float32)
    if len(colours) == 1:
        return np.repeat(colours, total, axis=0)
    interpolation = str(primvar.GetInterpolation())
    if interpolation == UsdGeom.Tokens.uniform and len(colours) == len(counts):
        colours = np.repeat(colours, counts, axis=0)
    elif interpolation != UsdGeom.Tokens.faceVarying or len(colours) != len(indices):
        return colours if len(colours) == total else None
    around = np.maximum(np.bincount(indices, minlength=total), 1)
    sums = [np.bincount(indices, colours[:, k], total) for k in range(3)]
    return np.asarray(np.stack(sums, axis=1) / around[:, None], dtype=np.float32)
