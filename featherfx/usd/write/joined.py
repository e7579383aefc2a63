"""Many feathers posed as one surface: compiled code is called once for hundreds of them.

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
from featherfx.usd.arrays import Floats, InPlace
from featherfx.usd.types import ACCELERATIONS, BARB_DIRECTION, MESH, ORIENT, P_BARB, RACHIS
from featherfx.usd.write import surface_kernels
from featherfx.usd.write.poses import Key, PosedFeather, condense, fixed
from featherfx.usd.write.surface_kernels import DrawnSurface, WrittenSurface

Array = NDArray[np.float64]

# feathers whose poses are computed at once; more would only need more memory for what passes
AT_ONCE = 500


class JoinedFeathers:
    """The surfaces of feathers as a few large ones; each is `plain` (PosedFeather), and all have as
    many barb nodes in a row."""

    def __init__(self, feathers: Sequence[PosedFeather]) -> None:
        parts = [feathers[k : k + AT_ONCE] for k in range(0, len(feathers), AT_ONCE)]
        most = max(sum(len(each.drawn.row) for each in part) for part in parts)
        scratch = np.zeros((2, most, 3))
        self._blocks = [_Block(part, scratch) for part in parts]

    @staticmethod
    def of(feathers: Sequence[PosedFeather]) -> JoinedFeathers | None:
        """None where some of the feathers ask for more than points, normals and directions."""
        same = len({each.grid[1] for each in feathers}) == 1
        plain = len(feathers) > 1 and same and all(each.is_plain for each in feathers)
        return JoinedFeathers(feathers) if plain else None

    def evaluate(self, values: Mapping[Key, InPlace], given: Sequence[FeatherPose]) -> bool:
        """Write the poses of all feathers, but for extents; False where a value is not finite, or a
        pose is of another grid, which feather by feather can be told."""
        begin, first = dict.fromkeys(values, 0), 0
        for block in self._blocks:
            own = {}
            for key, count in block.counts.items():
                own[key] = values[key].numbers[begin[key] : begin[key] + count]
                begin[key] += count
            if not block.evaluate(own, given[first : first + len(block.grids)]):
                return False
            first += len(block.grids)
        return True


class _Block:
    """Feathers that are posed as one surface. grids: of each. counts: elements of each attribute.
    scratch: (2, V, 3), which others overwrite."""

    def __init__(self, feathers: Sequence[PosedFeather], scratch: Array) -> None:
        surfaces = [each.drawn for each in feathers]
        self.grids = [each.grid for each in feathers]
        keys = (*feathers[0].vectors, *feathers[0].turns)
        self.counts = {key: sum(each.count(key) for each in feathers) for key in keys}
        self._stage, self._origin = feathers[0].to_stage, feathers[0].to_origin
        self._form = feathers[0].form
        counts = [grid[0] for grid in self.grids]
        self._left_leads = np.repeat([each.left_leads for each in feathers], counts)
        rows = np.cumsum([0, *counts])
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
            world=scratch[0, :count],
            sums=scratch[1, :count],
            parted=np.zeros(0, dtype=np.bool_),
            carried=np.zeros((0, 3)),
        )

    def evaluate(self, values: Mapping[Key, Floats], given: Sequence[FeatherPose]) -> bool:
        """As of JoinedFeathers, to the feathers' own elements of the attributes."""
        if [np.shape(pose.points.nodes)[:2] for pose in given] != self.grids:
            return False
        points = _joined([pose.points for pose in given])
        if self._origin is not None:
            points = points.shifted(self._origin)
        names = (MESH, "points"), (MESH, "normals"), (MESH, BARB_DIRECTION), (RACHIS, "points")
        written = WrittenSurface(*(values[key] for key in names))
        finite = surface_kernels.pose_surface(points, self._drawn, self._stage, written)
        if self._form.condensed:
            numbers = [values[RACHIS, name] for name in (*P_BARB, ORIENT)]
            finite &= condense(points, self._left_leads, self._stage, numbers)
        rates = {"velocities": [pose.velocities for pose in given]}
        if (MESH, ACCELERATIONS) in values:
            rates[ACCELERATIONS] = [pose.accelerations for pose in given]
        for name, each in rates.items():
            mesh, shaft = (values[part, name] for part in (MESH, RACHIS))
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
