"""The attributes that change: points, extent, normals, velocities, barb direction.

They are authored at Sdf level, without a composed stage: one call per attribute and frame.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from pxr import Sdf

from featherfx.usd.arrays import vec3h
from featherfx.usd.types import (
    ACCELERATIONS,
    BARB_DIRECTION,
    DETAIL,
    HALF_VELOCITIES,
    ORIENT,
    P_BARB,
    PER_FACE,
    RATES,
)
from featherfx.usd.write.forms import Form, Key
from featherfx.usd.write.layout import SCOPES
from featherfx.usd.write.output import unique_prim_names
from featherfx.usd.write.posed_groups import PosedGroup, WrittenPose

_TYPES = {
    "points": Sdf.ValueTypeNames.Point3fArray,
    "extent": Sdf.ValueTypeNames.Float3Array,
    "normals": Sdf.ValueTypeNames.Normal3fArray,
    "velocities": Sdf.ValueTypeNames.Vector3fArray,
    BARB_DIRECTION: Sdf.ValueTypeNames.Vector3fArray,
    ACCELERATIONS: Sdf.ValueTypeNames.Vector3fArray,
    HALF_VELOCITIES: Sdf.ValueTypeNames.Vector3hArray,
    ORIENT: Sdf.ValueTypeNames.QuathArray,
    DETAIL: Sdf.ValueTypeNames.IntArray,
    **dict.fromkeys(P_BARB, Sdf.ValueTypeNames.Point3fArray),
}
_TYPES |= {name: Sdf.ValueTypeNames.FloatArray for name in PER_FACE if name != BARB_DIRECTION}
_INTERPOLATION = dict.fromkeys(("normals", ORIENT, HALF_VELOCITIES, *P_BARB), "vertex")
_INTERPOLATION |= dict.fromkeys(PER_FACE, "uniform")


class AnimatedPrims:
    """The prims of a cache that move, and how a pose becomes their values.

    groups: the feathers of each mesh, or of curves where there is none. prims: per group, the path
    of each part that is drawn of it. form: what of these is written. paths: per group, those
    of what is written.
    """

    def __init__(
        self,
        groups: Sequence[PosedGroup],
        prims: Sequence[Mapping[str, Any]],
        form: Form = Form(),
    ) -> None:
        self.groups, self.prims, self.form = groups, prims, form
        self.paths: list[dict[Key, Any]] = [
            {
                (part, name): own[part].AppendProperty(
                    HALF_VELOCITIES if name == "velocities" and form.half else name
                )
                for part, name in group.keys
                if part in own and form.writes((part, name))
            }
            for group, own in zip(groups, prims, strict=True)
        ]

    @staticmethod
    def of_cache(groups: Sequence[PosedGroup], root: Any, form: Form) -> AnimatedPrims:
        """Those of a cache. root: path of the prim above all."""
        prims: list[dict[str, Any]] = [{} for _ in groups]
        for part, (scope, end) in SCOPES.items():
            names = unique_prim_names([group.name + end for group in groups])
            for group, own, name in zip(groups, prims, names, strict=True):
                if part in group.parts and part in form.parts:
                    own[part] = root.AppendPath(f"{scope}/{name}")
        return AnimatedPrims(groups, prims, form)

    def create(self, layer: Any, index: int, key: Key) -> Any:
        """The attribute in a layer, as an over where the layer does not define the prim."""
        path = self.paths[index][key]
        name = path.name
        attribute = layer.GetAttributeAtPath(path)
        if attribute:
            return attribute
        Sdf.JustCreatePrimAttributeInLayer(layer, path, _TYPES[name])
        attribute = layer.GetAttributeAtPath(path)
        if name in _INTERPOLATION:
            attribute.SetInfo("interpolation", _INTERPOLATION[name])
        if name in P_BARB:
            attribute.SetInfo("elementSize", self.groups[index].columns)
        return attribute

    def author_defaults(self, layer: Any, index: int, pose: WrittenPose) -> None:
        """One pose of a group as default values; a default pose has no rates."""
        for key in self.paths[index]:
            if key[1] not in RATES:
                self.create(layer, index, key).default = pose.values[key].value

    def author_sample(
        self, layer: Any, index: int, codes: Sequence[float], pose: WrittenPose
    ) -> None:
        """One pose of a group at time codes, in a layer that has the attributes."""
        paths, store = self.paths[index], layer.SetTimeSample
        for key, path in paths.items():
            array = pose.values[key].value
            if path.name == HALF_VELOCITIES:
                array = vec3h(pose.values[key].numbers)
            for code in codes:
                store(path, code, array)
