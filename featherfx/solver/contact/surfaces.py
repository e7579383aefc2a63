"""Surfaces of feathers as contact sees them.

Feathers of several grids stand side by side, their points on the widest grid of all; points that a
smaller grid lacks stay zero, and no surface has them.

Memory for the states of some batches, and views of it.

To tell where every array of a state lies takes Python longer than feathers of a small shot take to
solve, so only what differs from one room to the next is asked for.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from featherfx.algebra.types import Flags
from featherfx.algebra.views import Views, views_of
from featherfx.feather.types import barb_slice
from featherfx.jit.compiled import KernelModule
from featherfx.mechanics.model import Model
from featherfx.solver.contact.types import (
    RIM_SAMPLES,
    Array,
    Bytes,
    ContactMemory,
    CubeGrid,
    Indices,
    MovingBodies,
    VaneSurfaces,
    Wall,
)
from featherfx.solver.state import State


class StateBuffer(NamedTuple):
    """States of all batches, views of them and of their rows of numbers, one for each feather."""

    states: list[State]
    views: Views
    rows: Views


class StateBuffers:
    """Makes room for states that are like some, one per batch. before: a room to be written over
    again and again."""

    def __init__(self, like: Sequence[State]) -> None:
        arrays = [list(state.arrays().items()) for state in like]
        self._forms = [[(name, each.shape, each.dtype) for name, each in some] for some in arrays]
        self._whole = views_of(like).views
        self._rows = views_of([_rows(state) for state in like]).views
        # a view has the address of each array, and behind it its shape and strides
        self._at_whole = _addresses([each.ndim for _, each in arrays[0]])
        self._at_rows = _addresses([2 for _ in arrays[0]])
        self.before = self.made(np.zeros)

    def made(self, new: Callable[..., Any]) -> StateBuffer:
        """A room of arrays as np.empty or np.zeros makes them."""
        states = [
            State.from_arrays({name: new(shape, dtype) for name, shape, dtype in forms})
            for forms in self._forms
        ]
        addresses = [[each.ctypes.data for each in state.arrays().values()] for state in states]
        whole, rows = self._whole.words.copy(), self._rows.words.copy()
        whole[:, self._at_whole] = rows[:, self._at_rows] = addresses
        return StateBuffer(
            states, self._whole._replace(words=whole), self._rows._replace(words=rows)
        )


def put(given: State, state: State, some: Flags) -> None:
    """Copy some feathers (F,) of a state into another, in place."""
    whole, arrays = bool(some.all()), given.arrays()
    for name, array in state.arrays().items():
        if whole:
            array[...] = arrays[name]
        else:
            array[some] = arrays[name][some]


def _addresses(dimensions: Sequence[int]) -> NDArray[np.int64]:
    return np.cumsum([0, *(1 + 2 * each for each in dimensions[:-1])])


def _rows(state: State) -> tuple[Array, ...]:
    """All arrays of a state, a row of numbers per feather."""
    return tuple(array.reshape(len(array), -1) for array in state.arrays().values())


# FIT for a wall, which does not yield, over that of the node
WALL_FIT = 2.0
# part of the shaft within which the clamp at its root makes contacts no stiffer: there, gaps of
# nanometres would switch forces that Newton then hunts for, and a feather that flies has no clamp
NEAR_ROOT = 0.4
# the same towards an obstacle: there a spring as soft as the node farther out closes a few
# hundredths of its gap in a round
NEAR_ROOT_OF_OBSTACLE = 0.2
# depth, over the feather's length, beyond which a point counts as on the other side of something
# else; how much farther barbs' tips are apart than rows, over the barbs' length
_DEEPEST, _FAN = 0.1, 0.3


@dataclass(frozen=True)
class Grids:
    """The grids of B bodies in batches.

    first: (G + 1,) first body of each batch. rows, columns: (G,) of the batches.
    """

    first: Indices
    rows: Indices
    columns: Indices

    @property
    def bodies(self) -> int:
        return int(self.first[-1])

    @property
    def most_rows(self) -> int:
        return int(self.rows.max(initial=1))

    @property
    def most_columns(self) -> int:
        return int(self.columns.max(initial=0))

    def own_columns(self) -> Indices:
        """(B,) columns of each body's grid."""
        return np.repeat(self.columns, np.diff(self.first))

    def put(self, values: Array, batch: int, bodies: Indices | slice, to: Array) -> None:
        """Write values (k, n, 1 + 2 m, ...) of some bodies (counted in their batch) to those of
        all, (B, most rows, 1 + 2 most columns, ...)."""
        m, trailing = int(self.columns[batch]), 1 + self.most_columns
        own = to[self.first[batch] : self.first[batch + 1], : self.rows[batch]]
        own[bodies, :, : 1 + m] = values[:, :, : 1 + m]
        own[bodies, :, trailing : trailing + m] = values[:, :, 1 + m :]

    def of(self, values: Array, batch: int, bodies: Indices | slice) -> Array:
        """(k, n, 1 + 2 m, ...) values of some bodies (counted in their batch) from those of all."""
        m, trailing = int(self.columns[batch]), 1 + self.most_columns
        own = values[self.first[batch] : self.first[batch + 1], : self.rows[batch]][bodies]
        return np.concatenate([own[:, :, : 1 + m], own[:, :, trailing : trailing + m]], axis=2)

    def together(self, parts: Sequence[Array], free: Flags | None = None) -> Array:
        """(B, most rows, 1 + 2 most columns, ...) from one (F, n, 1 + 2 m, ...) per batch; zero of
        bodies that are not free (B,)."""
        shape = self.bodies, self.most_rows, 1 + 2 * self.most_columns
        found, some = np.zeros(shape + parts[0].shape[3:]), np.arange(self.bodies)
        if free is not None:
            some = some[free]
        first = np.searchsorted(some, self.first)
        for batch, values in enumerate(parts):
            own = some[first[batch] : first[batch + 1]] - self.first[batch]
            whole = len(own) == len(values)
            chosen = slice(None) if whole else own
            self.put(values[chosen], batch, chosen, found)
        return found


def grids_of(models: Sequence[Model]) -> Grids:
    """The grids of some batches."""
    counts = np.array([model.feathers for model in models], dtype=np.int64)
    return Grids(
        first=np.concatenate([[0], np.cumsum(counts)]),
        rows=np.array([model.rows for model in models], dtype=np.int64),
        columns=np.array([model.columns for model in models], dtype=np.int64),
    )


class VaneShapes(NamedTuple):
    """F vanes on one grid. cell: (F, 2, n - 1, m, 2) which triangles there are. segment: (F, 2, n)
    m, of barbs, between two nodes. length: (F, n - 1) m, of the shaft between rows."""

    cell: Flags
    segment: Array
    length: Array


def shapes_of(models: Sequence[Model]) -> list[VaneShapes]:
    """The vanes of some batches."""
    return [
        VaneShapes(model.cell_stiffness[..., 0] != 0.0, model.segment, model.length)
        for model in models
    ]


def surfaces_of(
    shapes: Sequence[VaneShapes], grids: Grids, halves: Sequence[float] | Array
) -> VaneSurfaces:
    """Surfaces of all feathers of some batches. halves: m, half thickness of each body's vane."""
    bodies, rows, m = grids.bodies, grids.most_rows, grids.most_columns
    exists = np.zeros((bodies, 2, rows - 1, m, 2), dtype=bool)
    for (cell, _, _), low, high in zip(shapes, grids.first[:-1], grids.first[1:], strict=True):
        exists[low:high, :, : cell.shape[2], : cell.shape[3]] = cell
    present = np.zeros((bodies, rows, 2 * m + 1), dtype=np.int8)
    for side in range(2):
        node = np.zeros((bodies, rows, m + 1), dtype=bool)
        first, second = exists[:, side, :, :, 0], exists[:, side, :, :, 1]
        node[:, :-1, :-1] |= first
        node[:, :-1, 1:] |= first | second
        node[:, 1:, :-1] |= first | second
        node[:, 1:, 1:] |= second
        if side == 0:
            present[:, :, m:] |= node
        else:
            present[:, :, m::-1] |= node
    half = np.broadcast_to(np.asarray(halves)[:, None, None], (bodies, rows, 1 + 2 * m))
    columns = grids.own_columns()
    guests = _guests(present, columns)
    for (_, segment, _), low, high in zip(shapes, grids.first[:-1], grids.first[1:], strict=True):
        # nodes of barbs without length are all where the shaft is, which is the guest then
        own = guests[low:high, : segment.shape[2]]
        for side, barb in ((0, slice(m + 1, 2 * m + 1)), (1, slice(0, m))):
            gone = segment[:, side] == 0.0
            own[..., m] |= gone & own[..., barb].any(axis=2)
            own[..., barb][gone] = 0
    far = np.concatenate([_far(each) for each in shapes])
    return VaneSurfaces(
        present, guests, exists.astype(np.int8), np.array(half, dtype=float), columns, far
    )


def as_torn(
    surfaces: VaneSurfaces, grids: Grids, models: Sequence[Model], states: Sequence[State]
) -> VaneSurfaces:
    """The same surfaces without what spans gaps that have opened: barbs beside them are fibres,
    whose nodes touch others, and others go between them."""
    guests, exists = surfaces.guests.copy(), surfaces.exists.copy()
    nodes, parts = surfaces.present.shape[2], RIM_SAMPLES - 1
    for model, state, low, high in zip(
        models, states, grids.first[:-1], grids.first[1:], strict=True
    ):
        if not model.hooked:
            continue
        # what is loose by its kind is a mat of many barbs, which nothing passes
        torn = (state.gaps.hooked == 0.0) & (model.hooks.limit[..., 0] > 0.0)
        exists[low:high, :, : torn.shape[2], : torn.shape[3]][torn] = 0
        rim = torn[:, :, :, -1].any(axis=-1)
        for side, first in ((1, nodes), (0, nodes + parts)):
            points = guests[low:high, : torn.shape[2], first : first + parts]
            points[rim[:, side]] = 0
    return surfaces._replace(guests=guests, exists=exists)


def _far(shapes: VaneShapes) -> Array:
    """(F,) m, VaneSurfaces.far: where the deepest comes back from, and half a cell's size."""
    row, length = shapes.length.max(axis=1), shapes.length.sum(axis=1)
    segment = shapes.segment.max(axis=(1, 2), initial=0.0)
    return _DEEPEST * length + row + segment + _FAN * shapes.cell.shape[3] * segment


def moving_bodies(start: Array, ahead: Array, impedance: Array) -> MovingBodies:
    """Bodies (B, n, 1 + 2 m, 3) whose boxes are yet to be fitted, none of them led."""
    bodies, rows = start.shape[:2]
    return MovingBodies(
        start=start,
        ahead=ahead,
        boxes=np.zeros((bodies, rows, 6)),
        bounds=np.zeros((bodies, 6)),
        impedance=impedance,
        leeway=impedance,
        whole=impedance,
        firm=impedance,
        led=np.zeros(bodies, dtype=np.int8),
        way=np.zeros(bodies),
        swing=np.zeros(bodies),
        slab=np.zeros((bodies, 5)),
    )


def _guests(present: Bytes, columns: Indices) -> Bytes:
    """(B, n, W): all nodes, and points of the rims between rows that both have one."""
    parts, middle, each = [], present.shape[2] // 2, np.arange(len(present))
    for way in (-1, 1):
        end = present[each, :, middle + way * columns]
        rim = np.zeros(present.shape[:2], dtype=np.int8)
        rim[:, :-1] = end[:, :-1] & end[:, 1:]
        parts.append(np.repeat(rim[:, :, None], RIM_SAMPLES - 1, axis=2))
    return np.concatenate([present, *parts], axis=2)


def elastic_stiffness(model: Model, near_root: float = NEAR_ROOT) -> Array:
    """(F, n, 1 + 2 m) N/m, how stiff a feather is at its nodes, apart from inertia.

    Between that of a single force, 3 B / s^3 on a barb at s from its root, and that of a force on
    all nodes of the barb, 8 B / (L^3 m): their geometric mean; shaft and barb in series. Of the
    shaft, 3 B / s^3 from near_root of its length on, and as there before; what is not held at its
    root has no clamp, and is no stiffer than at NEAR_ROOT.
    """
    m, count = model.columns, model.coefficients
    station = np.cumsum(model.length, axis=1)
    bending = (model.rachis_stiffness[:, :, 4:] * model.length[:, :, None]).min(axis=2)
    shaft = np.full(model.mass.shape[:2], np.inf)
    clamped = np.where(model.held, near_root, NEAR_ROOT)
    near = np.maximum(station, clamped[:, None] * station[:, -1:])
    shaft[:, 1:] = 3.0 * bending[:, :1] / near**3
    shaft[:, 0] = shaft[:, 1]
    stiffness = np.repeat(shaft[:, :, None], 1 + 2 * m, axis=2)
    if m and count:
        length = model.segment * m
        with np.errstate(divide="ignore"):
            root = model.barb_stiffness[..., 0] / length**2
        root[length == 0.0] = np.inf
        nodes = np.arange(1, m + 1)
        barb = np.sqrt(24.0 * m**2 / nodes**3) * root[..., None]
        for side in range(2):
            part = stiffness[:, :, barb_slice(side, m)]
            soft = barb[:, side]
            with np.errstate(divide="ignore"):
                part[...] = 1.0 / (1.0 / part + 1.0 / soft)
    return np.where(np.isfinite(stiffness), stiffness, 0.0)


def carried_mass(model: Model) -> Array:
    """(F, n, 1 + 2 m) kg, masses of the nodes; those of barbs without length, which are where the
    shaft is, count as that. A ribbon is rigid within its plane and across its width: what strikes
    its edge moves the strip, a quarter of its mass at an end and all of it in the middle, as of a
    rigid rod. It counts as all."""
    mass, m = model.mass.copy(), model.columns
    for side in range(2):
        part = mass[:, :, barb_slice(side, m)]
        part[...] = np.where(model.segment[:, side, :, None] == 0.0, mass[:, :, :1], part)
    flat = model.rachis_rest[:, :, 7:].any(axis=(1, 2))
    mass[flat] = model.mass[flat].sum(axis=(1, 2), keepdims=True)
    return mass


def no_memory(surfaces: VaneSurfaces) -> ContactMemory:
    """Nothing touched yet."""
    return ContactMemory(
        key=np.zeros(0, dtype=np.int64),
        force=np.zeros((0, 2)),
        side=np.zeros(0, dtype=np.int8),
        wall=np.zeros(surfaces.guests.shape),
        inside=np.zeros(surfaces.guests.shape, dtype=np.int64),
        surprise=np.full(len(surfaces.far), np.inf),
    )


wall_kernels = KernelModule("featherfx.solver.contact.wall_kernels")

_MAX_CUBES = 200_000


def wall_of(
    start: Array,
    end: Array,
    triangles: Indices,
    reach: float,
    beginning: bool = False,
    is_open: bool = False,
) -> Wall:
    """The wall of a mesh (V, 3), m, with triangles (T, 3).

    reach: m, distance at which its triangles are found; at least the way of a node against the
    wall in the interval. beginning: whether nodes inside are to be left alone until they come out.
    is_open: whether it is a sheet, which has the side on which a node comes.
    """
    corners = start[triangles]
    low = corners.min(axis=(0, 1)) - reach
    size = corners.max(axis=(0, 1)) + reach - low
    edges = np.linalg.norm(np.roll(corners, 1, axis=1) - corners, axis=2)
    edge = max(float(np.median(edges)), reach, float(np.prod(size) / _MAX_CUBES) ** (1.0 / 3.0))
    cubes = np.maximum(np.ceil(size / edge), 1.0).astype(np.int64)
    grid = CubeGrid(low, edge, float(reach), cubes)
    counts = np.zeros(int(cubes.prod()), dtype=np.int64)
    wall_kernels.count_cells(start, triangles, grid, counts)
    first = np.concatenate([[0], np.cumsum(counts)])
    items = np.zeros(int(first[-1]), dtype=np.int64)
    wall_kernels.fill_cells(start, triangles, grid, first[:-1].copy(), items)
    return Wall(
        np.ascontiguousarray(start, dtype=float),
        np.ascontiguousarray(end, dtype=float),
        np.ascontiguousarray(triangles, dtype=np.int64),
        grid,
        first,
        items,
        int(beginning),
        int(is_open),
    )
