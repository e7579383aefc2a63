"""The attributes that change: points, extent, normals, velocities, barb direction.

They are authored at Sdf level, without a composed stage: one call per attribute and frame. A
feather gets samples from the moment that it first differs from its rest pose; until then nothing
is stored, and a feather that never moves ends with default values only.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pxr import Sdf

from featherfx.usd import arrays
from featherfx.usd.primvars import BARB_DIRECTION
from featherfx.usd.surfaces import SurfaceFrame, SurfaceSet

_TYPES = {
    "points": Sdf.ValueTypeNames.Point3fArray,
    "extent": Sdf.ValueTypeNames.Float3Array,
    "normals": Sdf.ValueTypeNames.Normal3fArray,
    "velocities": Sdf.ValueTypeNames.Vector3fArray,
    BARB_DIRECTION: Sdf.ValueTypeNames.Vector3fArray,
}
_INTERPOLATION = {"normals": "vertex", BARB_DIRECTION: "uniform"}

Pose = list[tuple[str, Any]]


class SampleWriter:
    """Writes poses of many feathers into two layers (which may be one and the same).

    layer: takes the samples of moving feathers and their default values. static_layer: takes the
    default values of feathers that never move. meshes, rachises: prim paths.
    """

    def __init__(
        self,
        layer: Any,
        static_layer: Any,
        meshes: Sequence[Any],
        rachises: Sequence[Any],
        surfaces: SurfaceSet,
    ) -> None:
        self._layer, self._static_layer = layer, static_layer
        self._surfaces = surfaces
        self._paths = [
            {("mesh", name): mesh.AppendProperty(name) for name in _TYPES}
            | {
                ("rachis", name): rachis.AppendProperty(name)
                for name in ("points", "extent", "velocities")
            }
            for mesh, rachis in zip(meshes, rachises, strict=True)
        ]
        self.moving: NDArray[np.bool_] = np.zeros(len(self._paths), dtype=bool)
        self._codes: list[float] = []

    def write(self, code: float, frame: SurfaceFrame) -> None:
        """Add one frame at a time code."""
        with Sdf.ChangeBlock():
            for index in np.flatnonzero(self._surfaces.moved(frame) & ~self.moving):
                self._start(int(index))
            for index in np.flatnonzero(self.moving):
                self._set(int(index), (code,), frame)
        self._codes.append(code)

    def finish(self) -> None:
        """Author the rest pose of the feathers that never moved."""
        with Sdf.ChangeBlock():
            for index in np.flatnonzero(~self.moving):
                self._set_defaults(int(index), self._static_layer)

    def _start(self, index: int) -> None:
        """From now on a feather has samples; the frames that it sat out hold its rest pose."""
        self.moving[index] = True
        self._set_defaults(index, self._layer)
        for owner, name in (("mesh", "velocities"), ("rachis", "velocities")):
            _create(self._layer, self._paths[index][owner, name], name)
        if self._codes:
            self._set(index, self._codes, self._surfaces.rest)

    def _set_defaults(self, index: int, layer: Any) -> None:
        for (owner, name), value in self._values(index, self._surfaces.rest):
            if name != "velocities":
                attribute = _create(layer, self._paths[index][owner, name], name)
                attribute.default = value

    def _set(self, index: int, codes: Sequence[float], frame: SurfaceFrame) -> None:
        paths, store = self._paths[index], self._layer.SetTimeSample
        for key, value in self._values(index, frame):
            for code in codes:
                store(paths[key], code, value)

    def _values(self, index: int, frame: SurfaceFrame) -> Iterator[tuple[tuple[str, str], Any]]:
        points, faces = self._surfaces.point_slices[index], self._surfaces.face_slices[index]
        shaft, vec3f = self._surfaces.rachis_slices[index], arrays.vec3f
        yield ("mesh", "points"), vec3f(frame.points[points])
        yield ("mesh", "extent"), vec3f(frame.extent[index])
        yield ("mesh", "normals"), vec3f(frame.normals[points])
        yield ("mesh", "velocities"), vec3f(frame.velocities[points])
        yield ("mesh", BARB_DIRECTION), vec3f(frame.barb_direction[faces])
        yield ("rachis", "points"), vec3f(frame.rachis_points[shaft])
        yield ("rachis", "extent"), vec3f(frame.rachis_extent[index])
        yield ("rachis", "velocities"), vec3f(frame.rachis_velocities[shaft])


def _create(layer: Any, path: Any, name: str) -> Any:
    Sdf.JustCreatePrimAttributeInLayer(layer, path, _TYPES[name])
    attribute = layer.GetAttributeAtPath(path)
    if name in _INTERPOLATION:
        attribute.SetInfo("interpolation", _INTERPOLATION[name])
    return attribute
