"""The attributes that change: points, extent, normals, velocities, barb direction.

They are authored at Sdf level, without a composed stage: one call per attribute and frame.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Sequence
from typing import Any

from pxr import Sdf

from featherfx.usd import arrays
from featherfx.usd.barbs import BarbFrame
from featherfx.usd.primvars import BARB_DIRECTION
from featherfx.usd.surfaces import SurfaceFrame, SurfaceSet

Key = tuple[str, str]

_TYPES = {
    "points": Sdf.ValueTypeNames.Point3fArray,
    "extent": Sdf.ValueTypeNames.Float3Array,
    "normals": Sdf.ValueTypeNames.Normal3fArray,
    "velocities": Sdf.ValueTypeNames.Vector3fArray,
    BARB_DIRECTION: Sdf.ValueTypeNames.Vector3fArray,
    "accelerations": Sdf.ValueTypeNames.Vector3fArray,
}
_OF_CURVES = ("points", "extent", "velocities", "accelerations")
RATES = ("velocities", "accelerations")
_INTERPOLATION = {"normals": "vertex", BARB_DIRECTION: "uniform"}


class AnimatedPrims:
    """The prims of a cache that move, and how a pose becomes their values.

    meshes, rachises, barbs: prim paths, one of each per feather, None for a feather whose barbs
    are not drawn. accelerations: whether they are written, too. Keys are ("mesh", "rachis" or
    "barbs", attribute name).
    """

    def __init__(
        self,
        meshes: Sequence[Any],
        rachises: Sequence[Any],
        barbs: Sequence[Any],
        surfaces: SurfaceSet,
        accelerations: bool = False,
    ) -> None:
        self.surfaces = surfaces
        names = [name for name in _TYPES if accelerations or name != "accelerations"]
        self.paths: list[dict[Key, Any]] = [
            {("mesh", name): mesh.AppendProperty(name) for name in names}
            | {
                (what, name): path.AppendProperty(name)
                for what, path in (("rachis", rachis), ("barbs", barb))
                for name in names
                if path is not None and name in _OF_CURVES
            }
            for mesh, rachis, barb in zip(meshes, rachises, barbs, strict=True)
        ]

    def create(self, layer: Any, index: int, key: Key) -> Any:
        """The attribute in a layer, as an over where the layer does not define the prim."""
        path, name = self.paths[index][key], key[1]
        attribute = layer.GetAttributeAtPath(path)
        if attribute:
            return attribute
        Sdf.JustCreatePrimAttributeInLayer(layer, path, _TYPES[name])
        attribute = layer.GetAttributeAtPath(path)
        if name in _INTERPOLATION:
            attribute.SetInfo("interpolation", _INTERPOLATION[name])
        return attribute

    def author_defaults(self, layer: Any, index: int, frame: SurfaceFrame) -> None:
        """One pose of a feather as default values; a default pose has no rates."""
        for key, value in self.values(index, frame):
            if key[1] not in RATES:
                self.create(layer, index, key).default = value

    def author_sample(
        self, layer: Any, index: int, codes: Sequence[float], frame: SurfaceFrame
    ) -> None:
        """One pose of a feather at time codes, in a layer that has the attributes."""
        paths, store = self.paths[index], layer.SetTimeSample
        for key, value in self.values(index, frame):
            for code in codes:
                store(paths[key], code, value)

    def values(self, index: int, frame: SurfaceFrame) -> Iterator[tuple[Key, Any]]:
        """A feather's values in a pose."""
        points, faces = self.surfaces.point_slices[index], self.surfaces.face_slices[index]
        shaft, vec3f = self.surfaces.rachis_slices[index], arrays.vec3f
        yield ("mesh", "points"), vec3f(frame.points[points])
        yield ("mesh", "extent"), vec3f(frame.extent[index])
        yield ("mesh", "normals"), vec3f(frame.normals[points])
        yield ("mesh", "velocities"), vec3f(frame.velocities[points])
        yield ("mesh", BARB_DIRECTION), vec3f(frame.barb_direction[faces])
        yield ("rachis", "points"), vec3f(frame.rachis_points[shaft])
        yield ("rachis", "extent"), vec3f(frame.rachis_extent[index])
        yield ("rachis", "velocities"), vec3f(frame.rachis_velocities[shaft])
        if frame.accelerations is not None and frame.rachis_accelerations is not None:
            yield ("mesh", "accelerations"), vec3f(frame.accelerations[points])
            yield ("rachis", "accelerations"), vec3f(frame.rachis_accelerations[shaft])
        if ("barbs", "points") in self.paths[index]:
            yield from self._barb_values(index, frame.barbs)

    def _barb_values(self, index: int, barbs: BarbFrame) -> Iterator[tuple[Key, Any]]:
        own, vec3f = self.surfaces.barbs.slices[index], arrays.vec3f
        yield ("barbs", "points"), vec3f(barbs.points[own])
        yield ("barbs", "extent"), vec3f(barbs.extent[index])
        yield ("barbs", "velocities"), vec3f(barbs.velocities[own])
        if barbs.accelerations is not None:
            yield ("barbs", "accelerations"), vec3f(barbs.accelerations[own])

    def digest(self, index: int, frame: SurfaceFrame) -> str:
        """Short name of a feather's pose: equal poses, equal names."""
        points, shaft = self.surfaces.point_slices[index], self.surfaces.rachis_slices[index]
        digest = hashlib.blake2b(frame.points[points].tobytes(), digest_size=8)
        digest.update(frame.rachis_points[shaft].tobytes())
        digest.update(frame.barbs.points[self.surfaces.barbs.slices[index]].tobytes())
        return digest.hexdigest()
