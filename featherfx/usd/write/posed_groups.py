"""Poses of the feathers that share a mesh, in USD arrays.

Many are posed as one surface, since a call of compiled code costs as much as a small feather. Each
value is computed as for the feather alone, so the result is the same to the last bit.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from threading import local
from typing import Any

import numpy as np
from numpy.typing import NDArray

from featherfx import usd
from featherfx.algebra.types import Array, Flags, Floats, Indices
from featherfx.feather.types import RowPoints, share
from featherfx.shot.frames import FeatherPose
from featherfx.usd.arrays import InPlace, new_integers, new_rotations, new_scalars, new_vectors
from featherfx.usd.types import (
    ACCELERATIONS,
    BARB_DIRECTION,
    BARB_NODE_PRIMVARS,
    BARB_PRIM,
    DETAIL_ATTRIBUTE,
    HOOK_PRIMVARS,
    HOOKED_PRIMVAR,
    MESH_PRIM,
    ORIENT_PRIMVAR,
    PER_FACE_PRIMVARS,
    RACHIS_PRIM,
    RATES,
    WET_PRIMVARS,
)
from featherfx.usd.write.output import AttributeKey, MeshGroup
from featherfx.usd.write.poses import (
    DrawnSurface,
    PosedFeather,
    Written,
    WrittenSurface,
    read_only,
    surface_kernels,
)

# feathers whose poses are computed at once; more would only need more memory for what passes
_MAX_JOINED = 500
_local = local()
_ROUNDING = float(np.finfo(np.float32).eps)


class JoinedFeathers:
    """Surfaces of feathers joined to a few large ones.

    Each is `plain` (PosedFeather), and all have as many barb nodes in a row.
    """

    def __init__(self, feathers: Sequence[PosedFeather]) -> None:
        parts = [feathers[k : k + _MAX_JOINED] for k in range(0, len(feathers), _MAX_JOINED)]
        self._blocks = [_JoinedBlock(part) for part in parts]

    @staticmethod
    def of(feathers: Sequence[PosedFeather]) -> JoinedFeathers | None:
        """Return joined feathers; None where some need more than points, normals and directions."""
        same = len({each.grid[1] for each in feathers}) == 1
        plain = len(feathers) > 1 and same and all(each.is_plain for each in feathers)
        return JoinedFeathers(feathers) if plain else None

    def evaluate(
        self, values: Mapping[AttributeKey, InPlace], given: Sequence[FeatherPose]
    ) -> bool:
        """Write the poses of all feathers, except extents; return False if a value is not finite.

        Also False for a pose of another grid; the evaluation feather by feather then names it.
        """
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


class _JoinedBlock:
    """Feathers posed as one surface. grids: of each. counts: elements of each attribute."""

    def __init__(self, feathers: Sequence[PosedFeather]) -> None:
        surfaces = [each.drawn for each in feathers]
        self.grids = [each.grid for each in feathers]
        self._feathers = feathers
        keys = (*feathers[0].keys.vectors, *feathers[0].keys.turns, *feathers[0].keys.whole)
        self.counts = {key: sum(each.count(key) for each in feathers) for key in keys}
        self._stage, self._origin = feathers[0].to_stage, feathers[0].to_origin
        self._form = feathers[0].form
        rachises = [len(each.widths) for each in feathers]
        self._left_leads = np.repeat([each.left_leads for each in feathers], rachises)
        rows = np.cumsum([0, *(grid[0] for grid in self.grids)])
        starts = np.cumsum([0, *(len(each.row) for each in surfaces)])
        thinned = [each.thin for each in feathers if each.thin]
        # rows and nodes that are written, None: all; feathers have the same columns
        self._kept = (
            (_offset_indices([each.rows for each in thinned], rows), thinned[0].nodes)
            if thinned
            else None
        )
        self._count, none = int(starts[-1]), read_only(np.zeros((0, 2)))
        self._drawn = DrawnSurface(
            row=share(_offset_indices([each.row for each in surfaces], rows)),
            node=share(np.concatenate([each.node for each in surfaces])),
            offset=read_only(np.concatenate([each.offset for each in surfaces]), np.float64),
            triangles=share(_offset_indices([each.triangles for each in surfaces], starts)),
            edges=_offset_indices([each.edges for each in surfaces], starts).astype(np.int32),
            lips=none,
            world=none,
            sums=none,
            parted=np.zeros(0, dtype=np.bool_),
            carried=np.zeros((0, 3)),
        )

    def evaluate(self, values: Mapping[AttributeKey, Floats], given: Sequence[FeatherPose]) -> bool:
        """Write poses, as JoinedFeathers.evaluate, to the feathers' own elements."""
        if [np.shape(pose.points.nodes)[:2] for pose in given] != self.grids:
            return False
        points = self._joined([pose.points for pose in given])
        if self._form.thinned:
            posed = [pose.points for pose in given]
            values[RACHIS_PRIM, DETAIL_ATTRIBUTE][:] = usd.forms.find_details(self._feathers, posed)
        if self._origin is not None:
            points = points.shifted(self._origin)
        names = (
            (MESH_PRIM, "points"),
            (MESH_PRIM, "normals"),
            (MESH_PRIM, BARB_DIRECTION),
            (RACHIS_PRIM, "points"),
        )
        written = WrittenSurface(*(values[key] for key in names))
        room = _scratch(self._count)
        drawn = self._drawn._replace(world=room[0], sums=room[1])
        finite = surface_kernels.pose_surface(points, drawn, self._stage, written)
        if self._form.condensed:
            numbers = [values[RACHIS_PRIM, name] for name in (*BARB_NODE_PRIMVARS, ORIENT_PRIMVAR)]
            finite &= usd.forms.condense(points, self._left_leads, self._stage, numbers)
        rates = {"velocities": [pose.velocities for pose in given]}
        if (MESH_PRIM, ACCELERATIONS) in values:
            rates[ACCELERATIONS] = [pose.accelerations for pose in given]
        for name, each in rates.items():
            mesh, rachis = (values[part, name] for part in (MESH_PRIM, RACHIS_PRIM))
            finite &= surface_kernels.write_values(
                self._joined(each), drawn, self._stage, mesh, rachis
            )
        return bool(finite)

    def _joined(self, points: Sequence[RowPoints]) -> RowPoints:
        """Return what is written of the rows of all feathers, one after the other."""
        nodes = np.concatenate([each.nodes for each in points], dtype=np.float64)
        directors = np.concatenate([each.directors for each in points], dtype=np.float64)
        if self._kept is None:
            return RowPoints(nodes, directors)
        rows, columns = self._kept
        return RowPoints(np.take(nodes[rows], columns, axis=1), directors[rows])


def _scratch(count: int) -> Array:
    """Return (2, count, 3) that others of this thread overwrite."""
    room = getattr(_local, "room", None)
    if room is None or room.shape[1] < count:
        _local.room = room = np.zeros((2, count, 3))
    return room[:, :count]


def _offset_indices(indices: Sequence[NDArray[Any]], starts: Indices) -> Indices:
    """Return indices of all feathers. starts: offset of each feather's."""
    return np.concatenate([each + start for each, start in zip(indices, starts, strict=False)])


@dataclass
class WrittenPose:
    """Feathers of a group at one time, stage units and axes, as they are written.

    values: per prim (MESH_PRIM, RACHIS_PRIM, BARB_PRIM) and attribute. finite: (M,) whether the
    values of each feather are. Made once by PosedGroup.new_pose, then overwritten whenever a sample
    has left the layers.
    """

    values: dict[AttributeKey, InPlace]
    finite: Flags

    def corners(self) -> Sequence[Floats]:
        """Return (2, 3) extents of surfaces, or else rachises, and of barbs."""
        parts = (
            (MESH_PRIM, BARB_PRIM)
            if (MESH_PRIM, "extent") in self.values
            else (RACHIS_PRIM, BARB_PRIM)
        )
        drawn = (self.values.get((part, "extent")) for part in parts)
        found = [each.numbers for each in drawn if each is not None]
        if RACHIS_PRIM in parts:
            barbs = (self.values.get((RACHIS_PRIM, name)) for name in BARB_NODE_PRIMVARS)
            numbers = (each.numbers for each in barbs if each is not None)
            found += [np.stack([each.min(axis=0), each.max(axis=0)]) for each in numbers]
        return found


class PosedGroup:
    """The feathers of one mesh, and their evaluation.

    name: of the group's prims. members: numbers of the feathers. feathers: those. alone: whether
    the prims are those of a single feather. is_static, static: which feathers never leave their
    rest pose, all or (M,). parts: the prims, and keys: their written attributes. points: (M + 1,)
    of each part, first point of each feather, and all; faces: likewise, of the mesh.
    """

    def __init__(
        self, group: MeshGroup, posed: Sequence[PosedFeather], static: Sequence[bool], alone: bool
    ) -> None:
        self.name, self.members, self.alone = group.name, group.members, alone
        self.feathers = [posed[k] for k in group.members]
        self.static = np.array([static[k] for k in group.members], dtype=np.bool_)
        self.is_static = bool(self.static.all())
        points = {
            part: _start_offsets([each.points.get(part, 0) for each in self.feathers])
            for part in (MESH_PRIM, RACHIS_PRIM, BARB_PRIM)
        }
        self.points = {part: starts for part, starts in points.items() if starts[-1]}
        self.parts = tuple(self.points)
        self.faces = _start_offsets([f.faces for f in self.feathers])
        self._vectors = dict.fromkeys(key for f in self.feathers for key in f.keys.vectors)
        self._scalars = dict.fromkeys(key for f in self.feathers for key in f.keys.scalars)
        self._turns = dict.fromkeys(key for f in self.feathers for key in f.keys.turns)
        self._whole = dict.fromkeys(key for f in self.feathers for key in f.keys.whole)
        self.columns = self.feathers[0].columns
        self._extents = [(part, "extent") for part in self.parts]
        self.keys: tuple[AttributeKey, ...] = (
            *self._vectors,
            *self._extents,
            *self._scalars,
            *self._turns,
            *self._whole,
        )
        # USD pads the extent of curves by half the greatest width of the prim, in single precision
        widths = {MESH_PRIM: np.zeros(0), RACHIS_PRIM: self.widths, BARB_PRIM: self.barb_widths}
        self._padding = {
            part: np.float32(0.5) * np.float32(each.max(initial=0.0))
            for part, each in widths.items()
        }

    @property
    def is_condensed(self) -> bool:
        """Return whether the rachises carry their barbs."""
        return self.feathers[0].form.condensed

    @property
    def interpolation(self) -> str:
        """Return the interpolation of one value per feather, on curves of one feather each."""
        return "constant" if self.alone else "uniform"

    @cached_property
    def widths(self) -> Array:
        """Return (n,) stage units, diameters of all rachises."""
        return np.concatenate([each.widths for each in self.feathers])

    @property
    def held(self) -> Array:
        """Return (T,) fraction of barbules that are hooked at rest."""
        return np.concatenate([each.held for each in self.feathers])

    @cached_property
    def barb_widths(self) -> Array:
        """Return (K,) stage units, diameters of all barbs."""
        return np.concatenate([each.barb_widths for each in self.feathers])

    def starts(self, key: AttributeKey) -> Indices:
        """Return (M + 1,) first elements of each feather in an attribute, and all."""
        if key[1] in PER_FACE_PRIMVARS:
            return self.faces if key[0] == MESH_PRIM else np.arange(len(self.members) + 1)
        if key[1] == DETAIL_ATTRIBUTE:
            return _start_offsets([each.count(key) for each in self.feathers])
        if key[0] not in self.points:
            return np.zeros(len(self.members) + 1, dtype=np.int64)
        return self.points[key[0]] * (self.columns if key[1] in BARB_NODE_PRIMVARS else 1)

    def new_pose(self, compared: bool = True) -> WrittenPose:
        """Return memory for one pose, which has the static feathers already.

        compared: whether others are compared with it; else unwritten values are shared.
        """
        own = ("points", *RATES) if compared else ()
        shared = {key: room for key, room in self._unwritten.items() if key[1] not in own}
        values: dict[AttributeKey, InPlace] = {
            key: new_vectors(self._count(key)) for key in self._vectors if key not in shared
        }
        values |= shared
        values |= {key: new_vectors(2) for key in self._extents}
        values |= {key: new_scalars(self._count(key)) for key in self._scalars}
        values |= {key: new_rotations(self._count(key)) for key in self._turns}
        values |= {key: new_integers(self._count(key)) for key in self._whole}
        for key in self._scalars:
            values[key].numbers[...] = self.held if key[1] == HOOKED_PRIMVAR else 0.0
        pose = WrittenPose(values, np.ones(len(self.members), np.bool_))
        if not self.is_static:
            for index in np.flatnonzero(self.static).tolist():
                self.feathers[index].rest(self.own(pose, index))
        return pose

    @cached_property
    def _unwritten(self) -> dict[AttributeKey, InPlace]:
        """Return memory, shared by poses, for values that are computed but not written."""
        form = self.feathers[0].form
        return {key: new_vectors(self._count(key)) for key in self._vectors if not form.writes(key)}

    def _count(self, key: AttributeKey) -> int:
        return int(self._starts_of[key][-1])

    def own(self, pose: WrittenPose, index: int) -> Written:
        """Return the views of one feather in a pose.

        They are made on demand, since views of thousands of feathers take more memory than their
        values.
        """
        keys, found = self.feathers[index].keys, {}
        for key in (*keys.vectors, *keys.scalars, *keys.turns, *keys.whole):
            first, end = self._starts_of[key][index : index + 2]
            found[key] = pose.values[key].numbers[first:end]
        return found

    @cached_property
    def _starts_of(self) -> dict[AttributeKey, Indices]:
        """Return the first elements of each feather in each attribute, as of starts."""
        own = (*self._vectors, *self._scalars, *self._turns, *self._whole)
        return {key: self.starts(key) for key in own}

    @cached_property
    def _joined(self) -> JoinedFeathers | None:
        return None if self.static.any() else JoinedFeathers.of(self.feathers)

    def evaluate(self, pose: WrittenPose, given: Sequence[FeatherPose | None]) -> None:
        """Write the pose of each feather, except extents; None: it is in the pose already.

        Raises ValueError for another grid.
        """
        pose.finite[:] = True
        known = [each for each in given if each is not None]
        whole = self._joined if len(known) == len(given) else None
        if whole is not None and whole.evaluate(pose.values, known):
            return
        for index, each in enumerate(given):
            if each is not None and not self.static[index]:
                pose.finite[index] = self.feathers[index].evaluate(self.own(pose, index), each)

    def rest(self) -> WrittenPose:
        """Return the rest pose; its rates are zero."""
        pose = self.new_pose()
        if self._joined is not None and self._joined.evaluate(
            pose.values, [each.at_rest for each in self.feathers]
        ):
            for (_, name), value in pose.values.items():
                if name in RATES:
                    value.numbers[...] = 0.0
        else:
            for index, feather in enumerate(self.feathers):
                pose.finite[index] = feather.rest(self.own(pose, index))
        self.bound(pose)
        return pose

    def not_finite(self, pose: WrittenPose) -> list[int]:
        """Return numbers of the feathers with values that are not finite."""
        return [self.members[k] for k in np.flatnonzero(~pose.finite)]

    def bound(self, pose: WrittenPose) -> None:
        """Set the extents of a pose from its points."""
        for part in self.parts:
            points, extent = (pose.values[part, name].numbers for name in ("points", "extent"))
            surface_kernels.extent(points, self._padding[part], extent)

    def hold(self, pose: WrittenPose, first: WrittenPose, moved: Flags, seconds: float) -> None:
        """Mark feathers that have left their first pose in moved (M,); the others repeat it.

        So a feather is written the same whichever feathers share its prims. seconds: to the next
        sample. A velocity does not count if it moves no point by more than its rounding, at the
        greatest coordinate of a prim.
        """
        for part in self.parts:
            points, rates = (pose.values[part, name].numbers for name in ("points", "velocities"))
            own = first.values[part, "points"].numbers, self.points[part]
            surface_kernels.mark_moved(points, rates, *own, _ROUNDING / seconds, moved)
        moved &= ~self.static
        for index in np.flatnonzero(~(moved | self.static)).tolist():
            now, before = self.own(pose, index), self.own(first, index)
            if self.feathers[index].is_deformed(now, before):
                moved[index] = True
            elif pose is not first:
                for key, numbers in now.items():
                    numbers[...] = before[key]

    def is_at_rest(self, pose: WrittenPose) -> bool:
        """Return whether the rates of a constant pose may be left out without loss to a later bake.

        They may be rounding for a feather that has prims of its own.
        """
        rates = (value for (_, name), value in pose.values.items() if name in RATES)
        return self.alone or not any(value.numbers.any() for value in rates)

    def digest(self, pose: WrittenPose) -> str:
        """Return a short digest of a pose; equal poses have equal ones."""
        named = (
            ("points", *BARB_NODE_PRIMVARS, DETAIL_ATTRIBUTE, *HOOK_PRIMVARS, *WET_PRIMVARS)
            if self.alone
            else {name for _, name in self.keys}
        )
        digest = hashlib.blake2b(digest_size=8)
        for key, value in pose.values.items():
            if key[1] in named and key not in self._unwritten:
                digest.update(value.numbers.tobytes())
        return digest.hexdigest()


def _start_offsets(counts: Sequence[int]) -> Indices:
    return np.concatenate([[0], np.cumsum(counts, dtype=np.int64)])
