"""Many feathers posed as one surface: compiled code is called once for all of them.

A call costs as much as a small feather. Each value is computed as for the feather alone, so the
result is the same to the last bit.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from featherfx.feather.types import RowPoints
from featherfx.shot.frames import FeatherPose
from featherfx.usd.arrays import InPlace
from featherfx.usd.types import ACCELERATIONS, BARB_DIRECTION, MESH, ORIENT, P_BARB, RACHIS
from featherfx.usd.write import surface_kernels
from featherfx.usd.write.poses import Key, PosedFeather, condense, fixed
from featherfx.usd.write.surface_kernels import DrawnSurface, WrittenSurface


class JoinedFeathers:
    """The surfaces of feathers as one; each is `plain` (PosedFeather), and all have as many barb
    nodes in a row."""

    def __init__(self, feathers: Sequence[PosedFeather]) -> None:
        surfaces = [each.drawn for each in feathers]
        self._grids = [each.grid for each in feathers]
        self._stage, self._origin = feathers[0].to_stage, feathers[0].to_origin
        self._form = feathers[0].form
        counts = [grid[0] for grid in self._grids]
        self._left_leads = np.repeat([each.left_leads for each in feathers], counts)
        rows = np.cumsum([0, *(grid[0] for grid in self._grids)])
        starts = np.cumsum([0, *(len(each.row) for each in surfaces)])
        count = int(starts[-1])
        none = fixed(np.zeros((0, 2)))
        self._drawn = DrawnSurface(
            row=fixed(_counted_on([each.row for each in surfaces], rows)),
            node=fixed(np.concatenate([each.node for each in surfaces])),
            offset=fixed(np.concatenate([each.offset for each in surfaces]), np.float64),
            triangles=fixed(_counted_on([each.triangles for each in surfaces], starts)),
            edges=_counted_on([each.edges for each in surfaces], starts).astype(np.int32),
            lips=none,
            world=np.zeros((count, 3)),
            sums=np.zeros((count, 3)),
            parted=np.zeros(0, dtype=np.bool_),
            carried=np.zeros((0, 3)),
        )

    @staticmethod
    def of(feathers: Sequence[PosedFeather]) -> JoinedFeathers | None:
        """None where some of the feathers ask for more than points, normals and directions."""
        same = len({each.grid[1] for each in feathers}) == 1
        plain = len(feathers) > 1 and same and all(each.is_plain for each in feathers)
        return JoinedFeathers(feathers) if plain else None

    def evaluate(self, values: Mapping[Key, InPlace], given: Sequence[FeatherPose]) -> bool:
        """Write the poses of all feathers, but for extents; False where a value is not finite, or a
        pose is of another grid, which feather by feather can be told."""
        if [np.shape(pose.points.nodes)[:2] for pose in given] != self._grids:
            return False
        points = _joined([pose.points for pose in given])
        if self._origin is not None:
            points = points.shifted(self._origin)
        names = (MESH, "points"), (MESH, "normals"), (MESH, BARB_DIRECTION), (RACHIS, "points")
        written = WrittenSurface(*(values[key].numbers for key in names))
        finite = surface_kernels.pose_surface(points, self._drawn, self._stage, written)
        if self._form.condensed:
            numbers = [values[RACHIS, name].numbers for name in (*P_BARB, ORIENT)]
            finite &= condense(points, self._left_leads, self._stage, numbers)
        rates = {"velocities": [pose.velocities for pose in given]}
        if (MESH, ACCELERATIONS) in values:
            rates[ACCELERATIONS] = [pose.accelerations for pose in given]
        for name, each in rates.items():
            mesh, shaft = (values[part, name].numbers for part in (MESH, RACHIS))
            finite &= surface_kernels.write_values(
                _joined(each), self._drawn, self._stage, mesh, shaft
            )
        return bool(finite)


def _joined(points: Sequence[RowPoints]) -> RowPoints:
    """The rows of all feathers, one after the other."""
    nodes = np.concatenate([each.nodes for each in points], dtype=np.float64)
    return RowPoints(nodes, np.concatenate([each.directors for each in points], dtype=np.float64))


def _counted_on(indices: Sequence[NDArray[Any]], starts: NDArray[np.int64]) -> NDArray[np.int64]:
    """Indices of all feathers; starts: what each feather's count from."""
    return np.concatenate([each + start for each, start in zip(indices, starts, strict=False)])
