"""The attributes that change: points, extent, normals, velocities, barb direction.

They are authored at Sdf level, without a composed stage: one call per attribute and frame.
"""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from typing import Any

from pxr import Sdf

from featherfx.usd.types import ACCELERATIONS, DIAGNOSTICS, HOOKS
from featherfx.usd.write.poses import BARB, MESH, RACHIS, Key, PosedFeather, WrittenPose
from featherfx.usd.write.prims import BARB_DIRECTION

_TYPES = {
    "points": Sdf.ValueTypeNames.Point3fArray,
    "extent": Sdf.ValueTypeNames.Float3Array,
    "normals": Sdf.ValueTypeNames.Normal3fArray,
    "velocities": Sdf.ValueTypeNames.Vector3fArray,
    BARB_DIRECTION: Sdf.ValueTypeNames.Vector3fArray,
    ACCELERATIONS: Sdf.ValueTypeNames.Vector3fArray,
}
_PER_FACE = [*HOOKS, *(name for names in DIAGNOSTICS.values() for name in names)]
_TYPES |= dict.fromkeys(_PER_FACE, Sdf.ValueTypeNames.FloatArray)
RATES = ("velocities", ACCELERATIONS)
_INTERPOLATION = {"normals": "vertex"} | dict.fromkeys([BARB_DIRECTION, *_PER_FACE], "uniform")


class AnimatedPrims:
    """The prims of a cache that move, and how a pose becomes their values.

    feathers: one per entry. meshes, rachises, barbs: prim paths, one of each per feather, None
    for what is not drawn of it.
    """

    def __init__(
        self,
        feathers: Sequence[PosedFeather],
        meshes: Sequence[Any],
        rachises: Sequence[Any],
        barbs: Sequence[Any],
    ) -> None:
        self.feathers = feathers
        prims = {MESH: meshes, RACHIS: rachises, BARB: barbs}
        self.paths: list[dict[Key, Any]] = [
            {
                (part, name): prims[part][index].AppendProperty(name)
                for part, name in feather.keys
                if prims[part][index] is not None
            }
            for index, feather in enumerate(feathers)
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

    def author_defaults(self, layer: Any, index: int, pose: WrittenPose) -> None:
        """One pose of a feather as default values; a default pose has no rates."""
        for key, value in pose.values.items():
            if key[1] not in RATES:
                self.create(layer, index, key).default = value.value

    def author_sample(
        self, layer: Any, index: int, codes: Sequence[float], pose: WrittenPose
    ) -> None:
        """One pose of a feather at time codes, in a layer that has the attributes."""
        paths, store = self.paths[index], layer.SetTimeSample
        for key, value in pose.values.items():
            array = value.value
            for code in codes:
                store(paths[key], code, array)

    def digest(self, index: int, pose: WrittenPose) -> str:
        """Short name of a feather's pose: equal poses, equal names."""
        digest = hashlib.blake2b(digest_size=8)
        for part in self.feathers[index].parts:
            digest.update(pose.values[part, "points"].numbers.tobytes())
        for name in HOOKS:
            if (MESH, name) in pose.values:
                digest.update(pose.values[MESH, name].numbers.tobytes())
        return digest.hexdigest()
