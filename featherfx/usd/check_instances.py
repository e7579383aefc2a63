"""The checks of one point instancer."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from pxr import Usd, UsdGeom

from featherfx.usd import arrays

_PER_INSTANCE = ("positions", "orientations", "orientationsf", "scales", "velocities", "ids")


def instancer_problems(prim: Any) -> Iterator[tuple[str, str]]:
    """(attribute, message) of everything that is wrong at the first time."""
    instancer, first = UsdGeom.PointInstancer(prim), Usd.TimeCode.EarliestTime()
    indices = arrays.to_numpy(instancer.GetProtoIndicesAttr().Get(first)).astype(np.int64)
    targets = instancer.GetPrototypesRel().GetForwardedTargets()
    for target in targets:
        if not prim.GetStage().GetPrimAtPath(target):
            yield "prototypes", f"names {target}, which does not exist"
    wrong = indices[(indices < 0) | (indices >= len(targets))]
    if len(wrong):
        yield "protoIndices", f"{wrong[0]} is out of range, allowed 0 to {len(targets) - 1}"
    for name in _PER_INSTANCE:
        attribute = prim.GetAttribute(name)
        value = attribute.Get(first) if attribute else None
        if value is None:
            if name == "positions" and len(indices):
                yield name, "has no value"
            continue
        if len(value) != len(indices):
            yield name, f"{len(value)} values for {len(indices)} instances"
        if name == "ids" and len(set(value)) < len(value):
            yield name, f"{len(value)} values, {len(set(value))} different; ids are unique"
        if name in ("positions", "scales") and not np.isfinite(arrays.to_numpy(value)).all():
            yield name, "holds values that are not finite"
