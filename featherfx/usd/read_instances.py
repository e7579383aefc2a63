"""Instances read back; what writes them stands in featherfx/usd/instances.py."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from pxr import Usd, UsdGeom

Array = NDArray[np.float64]


class Instances:
    """The instances of one PointInstancer, read back: prototypes and transforms.

    prims: per instance, its prototype's root. labels: per instance, primvar names to texts.
    """

    def __init__(self, prim: Any) -> None:
        self._instancer = UsdGeom.PointInstancer(prim)
        targets = self._instancer.GetPrototypesRel().GetForwardedTargets()
        roots = [prim.GetStage().GetPrimAtPath(target) for target in targets]
        first = Usd.TimeCode.EarliestTime()
        indices = self._instancer.GetProtoIndicesAttr().Get(first)
        self.prims = [roots[index] for index in indices or []]
        self._labels = {}
        for name in ("featherId", "featherKind", "region"):
            primvar = UsdGeom.PrimvarsAPI(prim).GetPrimvar(name)
            values = primvar.ComputeFlattened(first) if primvar and primvar.HasValue() else None
            if values is not None and len(values) == len(self.prims):
                self._labels[name] = values
        self._known: dict[Any, Array] = {}

    def label(self, name: str, index: int, fallback: str) -> str:
        """A text of one instance."""
        return str(self._labels[name][index]) if name in self._labels else fallback

    def matrix(self, index: int, code: Any) -> Array:
        """(4, 4) from the prototype's own space to the world at a time code, row vectors."""
        if code not in self._known:
            masked = UsdGeom.PointInstancer.IgnoreMask
            values = self._instancer.ComputeInstanceTransformsAtTime(
                code, code, UsdGeom.PointInstancer.IncludeProtoXform, masked
            )
            world = np.array(self._instancer.ComputeLocalToWorldTransform(code))
            self._known = {code: np.asarray(values).reshape(-1, 4, 4) @ world}
        return np.asarray(self._known[code][index])
