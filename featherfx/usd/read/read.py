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
from featherfx.usd import arrays
from featherfx.usd.read.animated_mesh import fans
from featherfx.usd.read.drawn_meshes import DrawnMesh, drawn_meshes
from featherfx.usd.read.stage import open_stage

Floats = NDArray[np.float32]
Indices = NDArray[np.int64]


@dataclass(frozen=True)
class CachedFeather:
    """The constant part of one mesh.

    path: of the prim. id, kind, region: labels (id: the prim's name where none is authored).
    triangles: (T, 3) point indices; faces with more sides are cut into fans. side: (T,) 0 leading,
    1 trailing, 2 rachis (0 where unknown). face: (T,) face that the triangle was cut from.
    subsets: name to face indices. rest: (V, 3) and st: (V, 2), None where not authored.
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


@dataclass(frozen=True)
class CachedPose:
    """One feather at one time, stage units, world space.

    points, velocities, normals: (V, 3), barb_direction: (T, 3), extent: (2, 3) in object space;
    None where not authored (or of another size than the mesh).
    """

    points: Floats
    velocities: Floats | None
    normals: Floats | None
    barb_direction: Floats | None
    extent: Floats | None


class Cache:
    """A USD file with its meshes; purposes other than default and render are left out.

    feathers: one entry per mesh, or instance of one, in the order of the stage. frames: start and
    end time code.
    Raises InputError if the file cannot be opened or holds no mesh.
    """

    def __init__(self, path: str | Path) -> None:
        self._stage = open_stage(path)
        self.frames = (self._stage.GetStartTimeCode(), self._stage.GetEndTimeCode())
        self.has_frames = self._stage.HasAuthoredTimeCodeRange()
        self.frames_per_second = self._stage.GetTimeCodesPerSecond()
        self.meters_per_unit = UsdGeom.GetStageMetersPerUnit(self._stage)
        self.up_axis = str(UsdGeom.GetStageUpAxis(self._stage))
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
        found = {code for mesh in self._meshes for code in mesh.GetPointsAttr().GetTimeSamples()}
        first, last = self.frames
        whole = range(int(np.ceil(first)), int(last) + 1)
        return sorted(code for code in found if first <= code <= last) or [float(c) for c in whole]

    def pose(self, index: int, time: float | None = None) -> CachedPose:
        """Feather index at a time code.

        None is the rest pose: the default value, or the first sample where there is no default.
        """
        mesh, feather = self._meshes[index], self.feathers[index]
        code = Usd.TimeCode.Default() if time is None else Usd.TimeCode(time)
        if time is None and mesh.GetPointsAttr().Get(code) is None:
            code = Usd.TimeCode.EarliestTime()
        matrix = self._matrices[index](code)
        points = self._points(index, code)
        if points is None:
            raise InputError(Problem(feather.path, "points", f"no value at {code}"))
        count = len(points)
        barbs = UsdGeom.PrimvarsAPI(mesh).GetPrimvar("barbDirection").GetAttr()
        direction = _get(barbs, code, None)
        if direction is not None:
            fits = len(direction) > feather.face.max(initial=-1)
            direction = _unit(direction[feather.face] @ matrix[:3, :3]) if fits else None
        normals = _get(mesh.GetNormalsAttr(), code, count)
        velocities = _get(mesh.GetVelocitiesAttr(), code, count)
        # Normals turn with the inverse transpose; row vectors here.
        turned = None if normals is None else _unit(normals @ np.linalg.inv(matrix[:3, :3]).T)
        return CachedPose(
            points=(points @ matrix[:3, :3] + matrix[3, :3]).astype(np.float32),
            velocities=None if velocities is None else velocities @ matrix[:3, :3],
            normals=turned,
            barb_direction=direction,
            extent=_get(mesh.GetExtentAttr(), code, 2),
        )

    def _points(self, index: int, code: Any) -> Any:
        """(P, 3) in the space of the mesh's matrix; None where it has none."""
        skinning = self._skinnings[index]
        if skinning is None:
            return _get(self._meshes[index].GetPointsAttr(), code, None)
        moved = skinning.bind_points() if code.IsDefault() else skinning.points(code)
        return np.asarray(moved, dtype=np.float32)


def _constant_parts(drawn: Sequence[DrawnMesh]) -> Iterator[CachedFeather]:
    """Of all meshes; what instances share is read once."""
    known: dict[str, CachedFeather] = {}
    for each in drawn:
        path = str(each.mesh.GetPath())
        if path not in known:
            known[path] = _constant_part(each.mesh)
        labels = each.labels
        yield (
            known[path]
            if labels is None
            else replace(known[path], id=labels.id, kind=labels.kind, region=labels.region)
        )


def _get(attribute: Any, code: Any, count: int | None) -> Any:
    """An attribute's value as numpy; None if there is none, or not of count elements."""
    value = attribute.Get(code) if attribute else None
    if value is None or (count is not None and len(value) != count):
        return None
    return arrays.to_numpy(value)


def _unit(vectors: Any) -> Any:
    length = np.linalg.norm(vectors, axis=1, keepdims=True)
    return vectors / np.where(length > 0, length, 1.0)


def _constant_part(mesh: Any) -> CachedFeather:
    prim, first = mesh.GetPrim(), Usd.TimeCode.EarliestTime()
    primvars = UsdGeom.PrimvarsAPI(prim)
    counts = arrays.to_numpy(mesh.GetFaceVertexCountsAttr().Get(first)).astype(np.int64)
    indices = arrays.to_numpy(mesh.GetFaceVertexIndicesAttr().Get(first)).astype(np.int64)
    points = mesh.GetPointsAttr().Get(first)
    total = 0 if points is None else len(points)
    inside = ((indices >= 0) & (indices < total)).all()
    if counts.sum() != len(indices) or not inside:
        raise InputError(
            Problem(str(prim.GetPath()), "faceVertexIndices", "do not fit the mesh's points")
        )
    corners, face = fans(counts)

    def label(name: str, fallback: str) -> str:
        attribute = primvars.GetPrimvar(name).GetAttr()
        value = attribute.Get() if attribute else None
        return (value if isinstance(value, str) else value[0]) if value else fallback

    side = _get(primvars.GetPrimvar("side").GetAttr(), first, len(counts))
    subsets = UsdGeom.Subset.GetAllGeomSubsets(mesh)
    return CachedFeather(
        path=str(prim.GetPath()),
        id=label("featherId", prim.GetName()),
        kind=label("featherKind", ""),
        region=label("region", ""),
        triangles=indices[corners],
        side=np.full(len(face), LEADING) if side is None else side.astype(np.int64)[face],
        face=face,
        subsets={
            s.GetPrim().GetName(): arrays.to_numpy(s.GetIndicesAttr().Get(first)).astype(np.int64)
            for s in subsets
        },
        rest=_get(primvars.GetPrimvar("rest").GetAttr(), first, total),
        st=_get(primvars.GetPrimvar("st").GetAttr(), first, total),
    )
