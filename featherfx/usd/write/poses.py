"""What is written of a feather in one pose, computed by compiled code into USD's own arrays."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from featherfx.feather.clumps import clumped
from featherfx.feather.lips import Lips, Parted, carried_rates
from featherfx.feather.types import RACHIS as SHAFT
from featherfx.feather.types import Feather, PointMap, RowMap, RowPoints, Surface, both
from featherfx.shot.types import FeatherPose
from featherfx.usd.arrays import Floats, InPlace, Scalars, Vec3f
from featherfx.usd.space import StageSpace
from featherfx.usd.types import (
    ACCELERATIONS,
    DIAGNOSTICS,
    ENERGY_DENSITY,
    HOOKED,
    HOOKS,
    SLIP,
    STRAIN_ACROSS,
    STRAIN_SHEAR,
    FeatherEntry,
)
from featherfx.usd.write import surface_kernels
from featherfx.usd.write.prims import BARB_DIRECTION
from featherfx.usd.write.surface_kernels import DrawnSurface, ToStage, WrittenMesh

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

Key = tuple[str, str]
MESH, RACHIS, BARB = "mesh", "rachis", "barbs"

_ROUNDING = float(np.finfo(np.float32).eps)


@dataclass
class WrittenPose:
    """One feather at one time, stage units and axes, as it is written.

    values: per prim (MESH, RACHIS, BARB) and attribute. finite: whether points and rates are.
    Made once by PosedFeather.new_pose, then written to as often as a sample has left the layers.
    """

    values: dict[Key, InPlace]
    finite: bool = True

    def corners(self) -> Sequence[Floats]:
        """(2, 3) extents of surface and barbs."""
        parts = (self.values.get((part, "extent")) for part in (MESH, BARB))
        return [part.numbers for part in parts if part is not None]


class PosedFeather:
    """The constant arrays of one feather of a cache, and its evaluation.

    widths, barb_widths: (n,) and (B K,) stage units, diameters of shaft and barbs; those of the
    shaft are of the circle of its section's area. parts: the prims that it has. keys: what is
    written of them. extras: ACCELERATIONS, names of DIAGNOSTICS.
    """

    def __init__(
        self, entry: FeatherEntry, surface: _Surface, space: StageSpace, extras: Collection[str]
    ) -> None:
        self._entry, self._surface = entry, surface
        self._to_stage = ToStage(1.0 / space.meters_per_unit, space.up_axis == "Y")
        self._to_origin = -np.array(space.origin) if space.is_moved else None
        self._accelerations = ACCELERATIONS in extras
        self._held = 1.0 if entry.held is None else entry.held
        feather, barbs = entry.feather, entry.barbs
        self.widths = space.lengths(np.sqrt(feather.width * feather.height))
        self.barb_widths = space.lengths(barbs.widths.ravel()) if barbs else np.zeros(0)
        self._half_width, self._half_barb = _padding(self.widths), _padding(self.barb_widths)
        self.has_barbs = len(self.barb_widths) > 0
        self.parts = (MESH, RACHIS, BARB) if self.has_barbs else (MESH, RACHIS)
        counts = {MESH: len(surface.drawn.row), RACHIS: feather.rows, BARB: len(self.barb_widths)}
        each = ("points", "velocities", *([ACCELERATIONS] * self._accelerations))
        self._sizes = {(part, name): counts[part] for part in self.parts for name in each}
        self._sizes |= {(part, "extent"): 2 for part in self.parts}
        self._sizes[MESH, "normals"] = counts[MESH]
        self._sizes[MESH, BARB_DIRECTION] = len(surface.drawn.triangles)
        asked = [name for extra, names in DIAGNOSTICS.items() if extra in extras for name in names]
        asked += HOOKS if entry.hooked else ()
        self._scalars = {(MESH, name): len(surface.drawn.triangles) for name in asked}
        self.keys: tuple[Key, ...] = (*self._sizes, *self._scalars)

    @property
    def bytes_per_sample(self) -> int:
        """Bytes of one pose."""
        return 12 * sum(self._sizes.values()) + 4 * sum(self._scalars.values())

    def new_pose(self) -> WrittenPose:
        """Room for one pose."""
        room: dict[Key, InPlace] = {key: Vec3f(count) for key, count in self._sizes.items()}
        return WrittenPose(room | {key: Scalars(count) for key, count in self._scalars.items()})

    def rest(self) -> WrittenPose:
        """The rest pose; its rates are zero."""
        pose, barbs = self.new_pose(), self._entry.barbs
        split, nodes = self._entry.feather.split, self._from_origin(self._entry.rest_points)
        self._note_hooks(pose, np.where(split, 0.0, 1.0) if split.size else None)
        self._surface.carry(nodes)
        pose.finite = self._place(pose, _plain_points(nodes))
        if self.has_barbs and barbs:
            points = barbs.points if self._to_origin is None else barbs.points + self._to_origin
            pose.finite &= self._barb_points(pose, np.reshape(points, (-1, 3)))
        for (_, name), value in pose.values.items():
            if name in ("velocities", ACCELERATIONS):
                value.numbers[...] = 0.0
        return pose

    def evaluate(self, pose: WrittenPose, given: FeatherPose) -> None:
        """Write what is given of the feather, m and per second, to pose.

        Raises ValueError for another grid.
        """
        own, barbs = self._entry.points_map, self._entry.barbs
        found, expected = np.shape(given.points.nodes), self._entry.rest_points.nodes.shape
        if own is None and found != expected:
            raise ValueError(f"'{self._entry.id}': {found}, not {expected} nodes")
        points = self._from_origin(given.points)
        rates = {"velocities": given.velocities}
        if self._accelerations:
            rates[ACCELERATIONS] = given.accelerations
        gaps = given.gaps
        self._note_hooks(pose, gaps.hooked if gaps else None, gaps.slip if gaps else None)
        self._surface.carry(points)
        pose.finite = self._place(pose, _mapped(own, points))
        for name, values in rates.items():
            second = values if name == ACCELERATIONS else None
            self._surface.carry_rates(points, given.velocities, second)
            pose.finite &= self._rates(pose, name, _mapped(own, values))
        if not self.has_barbs or barbs is None:
            return
        strands = self._strands(gaps.hooked) if gaps else None
        curves = _curves(barbs.points_map, points)
        if strands is not None:
            curves = strands.joined(curves, strands.carried(points))
        curves = clumped(barbs, curves, *given.clumped)
        pose.finite &= self._barb_points(pose, curves)
        for name, values in rates.items():
            curves, out = _curves(barbs.points_map, values), pose.values[BARB, name].numbers
            if strands is not None:
                second = values if name == ACCELERATIONS else None
                rate = carried_rates(strands.carried, points, given.velocities, second)
                curves = strands.joined(curves, rate)
            curves = clumped(barbs, curves, *given.clumped)
            pose.finite &= bool(surface_kernels.write_points(curves, 1, self._to_stage, out))

    def _strands(self, hooked: Array) -> Parted | None:
        """Those of its barbs' points that go along with a strip that has parted."""
        strands = self._entry.barbs.strands if self._entry.barbs else None
        return None if strands is None else strands.parted(hooked)

    def _from_origin(self, points: RowPoints) -> RowPoints:
        """Points as seen from where the root prim stands."""
        return points if self._to_origin is None else points.shifted(self._to_origin)

    def changed(self, pose: WrittenPose, reference: WrittenPose, seconds: float) -> bool:
        """Whether the feather, as written, differs from a reference pose, or is on its way.

        seconds: to the next sample. A velocity that until then carries no point farther than its
        rounding, at the greatest coordinate of a prim, does not count.
        """
        now, before = pose.values, reference.values
        own = [(MESH, name) for name in HOOKS if (MESH, name) in now]
        if any((now[key].numbers != before[key].numbers).any() for key in own):
            return True
        return any(
            surface_kernels.changed(
                now[part, "points"].numbers,
                now[part, "velocities"].numbers,
                before[part, "points"].numbers,
                _ROUNDING / seconds,
            )
            for part in self.parts
        )

    def _place(self, pose: WrittenPose, points: RowPoints) -> bool:
        """Points of mesh and shaft, and what follows from them; whether all are finite."""
        drawn, stage, values = self._surface.drawn, self._to_stage, pose.values
        names = ("points", "normals", BARB_DIRECTION, "extent")
        mesh = WrittenMesh(*(values[MESH, name].numbers for name in names))
        finite = surface_kernels.pose_surface(points, drawn, stage, mesh)
        shaft = values[RACHIS, "points"].numbers
        finite &= _write_shaft(points, stage, shaft)
        surface_kernels.extent(shaft, self._half_width, values[RACHIS, "extent"].numbers)
        if self._scalars:
            self._diagnose(pose)
        return bool(finite)

    def _diagnose(self, pose: WrittenPose) -> None:
        """Strain and energy of the surface that was placed last."""
        surface, values = self._surface, pose.values
        across, shear = surface.strains
        corners, rest = surface.unstrained
        surface_kernels.face_strains(surface.drawn.world, corners, rest, across, shear)
        if (MESH, STRAIN_ACROSS) in values:
            values[MESH, STRAIN_ACROSS].numbers[:] = across
            values[MESH, STRAIN_SHEAR].numbers[:] = shear
        if (MESH, ENERGY_DENSITY) in values:
            out = values[MESH, ENERGY_DENSITY].numbers
            surface_kernels.energy_density(across, shear, *self._entry.vane_stiffness, out)
            out *= self._held

    def _note_hooks(
        self, pose: WrittenPose, hooked: Array | None, slip: Array | None = None
    ) -> None:
        """Which lips are open, and hooks and slip of each face; None for hooks that all hold."""
        surface, values = self._surface, pose.values
        surface.part(hooked)
        if not self._entry.hooked:
            return
        held, slipped = values[MESH, HOOKED].numbers, values[MESH, SLIP].numbers
        held[:], slipped[:] = self._held, 0.0
        faces = len(surface.cells)
        if hooked is not None:
            held[:faces] *= hooked.ravel()[surface.cells]
        if slip is not None:
            slipped[:faces] = np.linalg.norm(slip.reshape(-1, 2)[surface.cells], axis=1)

    def _rates(self, pose: WrittenPose, name: str, values: RowPoints) -> bool:
        drawn, stage = self._surface.drawn, self._to_stage
        out, shaft = pose.values[MESH, name].numbers, pose.values[RACHIS, name].numbers
        surface_kernels.combine(values, drawn)
        finite = surface_kernels.write_points(drawn.world, 1, stage, out)
        finite &= _write_shaft(values, stage, shaft)
        return bool(finite)

    def _barb_points(self, pose: WrittenPose, points: Array) -> bool:
        out, corners = pose.values[BARB, "points"].numbers, pose.values[BARB, "extent"].numbers
        finite = surface_kernels.write_points(points, 1, self._to_stage, out)
        surface_kernels.extent(out, self._half_barb, corners)
        return bool(finite)


class _Surface:
    """Arrays of a surface that all feathers of one shape share, as the kernels take them."""

    def __init__(self, feather: Feather, edges: NDArray[np.int32]) -> None:
        """edges: as of barb_edges."""
        self._feather, surface = feather, feather.surface
        vertices = (len(surface.row), 3)
        self.drawn = DrawnSurface(
            row=_plain(surface.row),
            node=_plain(surface.node),
            offset=np.ascontiguousarray(surface.offset, dtype=np.float64),
            triangles=_plain(surface.triangles),
            edges=edges,
            lips=_plain(surface.lips),
            world=np.zeros(vertices),
            sums=np.zeros(vertices),
            parted=np.zeros(len(surface.lips), dtype=np.bool_),
            carried=np.zeros((len(surface.lips), 3)),
        )
        # faces of vanes are in the order of cells
        self.cells = np.flatnonzero(feather.cell)
        self._lips = Lips.of(feather) if len(surface.lips) else None
        self.strains = np.zeros((2, len(edges)))

    def part(self, hooked: Array | None) -> None:
        """Open the lips of gaps that are open, and close the others; None where all hold."""
        self.drawn.parted[:] = False
        if self._lips and hooked is not None:
            self.drawn.parted[:] = self._lips.open(hooked)

    def carry(self, points: RowPoints) -> None:
        """Set where open lips are; points: of the feather."""
        if self._lips and self.drawn.parted.any():
            self.drawn.carried[:] = self._lips.carried(points)

    def carry_rates(
        self, points: RowPoints, velocities: RowPoints, accelerations: RowPoints | None
    ) -> None:
        """Set their velocities, or their accelerations where those are given."""
        if self._lips and self.drawn.parted.any():
            self.drawn.carried[:] = carried_rates(
                self._lips.carried, points, velocities, accelerations
            )

    @cached_property
    def unstrained(self) -> tuple[Indices, Array]:
        """As of strain_rest; only diagnostics ask for it."""
        surface = self._feather.surface
        return strain_rest(surface, self.drawn.edges, surface.points(self._feather.rest))


def posed_feathers(
    entries: Sequence[FeatherEntry], space: StageSpace, extras: Collection[str] = ()
) -> list[PosedFeather]:
    """All feathers of a cache; arrays of entries that share a Feather are made once."""
    shapes: dict[int, _Surface] = {}
    # feathers that differ in size alone have one topology
    edges: dict[tuple[int, int], NDArray[np.int32]] = {}
    for feather in (entry.feather for entry in entries):
        surface = feather.surface
        topology = id(surface.triangles), id(surface.barb_direction)
        if topology not in edges:
            edges[topology] = barb_edges(surface, surface.points(feather.rest))
        if id(feather) not in shapes:
            shapes[id(feather)] = _Surface(feather, edges[topology])
    return [PosedFeather(entry, shapes[id(entry.feather)], space, extras) for entry in entries]


def barb_edges(surface: Surface, points: Array) -> NDArray[np.int32]:
    """(T, 2) the edge of each triangle that runs along its barb, directed as barb_direction.

    points: (V, 3) surface points at rest, feather frame.
    """
    starts, ends = surface.triangles, np.roll(surface.triangles, -1, axis=1)
    along = points[ends] - points[starts]
    length = np.linalg.norm(along, axis=2)
    cosine = np.einsum("tec,tc->te", along, surface.barb_direction) / np.maximum(length, 1e-300)
    triangle = np.arange(len(cosine))
    edge = np.argmax(np.abs(cosine), axis=1)
    pair = np.stack([starts[triangle, edge], ends[triangle, edge]], axis=1)
    directed = np.where((cosine[triangle, edge] < 0)[:, None], pair[:, ::-1], pair)
    return directed.astype(np.int32)


def strain_rest(surface: Surface, edges: NDArray[np.int32], points: Array) -> tuple[Indices, Array]:
    """Corners (T, 3), barb edge first, and rest values (T, 3) of membrane_strain in the vanes.

    points: (V, 3) surface points at rest. The height over the edge is negative on faces that lie
    at the root's side of their barb, so that `across` points to the tip everywhere: else the
    shear would change its sign from face to face.
    """
    opposite = surface.triangles.sum(axis=1) - edges.sum(axis=1)
    corners = np.column_stack([edges, opposite]).astype(np.int64)
    start, end, third = (points[corners[:, k]] for k in range(3))
    edge = np.linalg.norm(end - start, axis=1)
    along = np.einsum("tc,tc->t", third - start, end - start) / np.maximum(edge, 1e-300)
    reach = np.einsum("tc,tc->t", third - start, third - start)
    height = np.sqrt(np.maximum(reach - along**2, 0.0))
    sound = (surface.part != SHAFT) & (edge > 0.0) & (height > 0.0)
    height *= np.where(surface.row[opposite] > surface.row[edges[:, 0]], 1.0, -1.0)
    rest = np.zeros(corners.shape)
    rest[sound] = np.column_stack([1.0 / edge[sound], along[sound], 1.0 / height[sound]])
    return corners, rest


def _mapped(points_map: RowMap | None, values: RowPoints) -> RowPoints:
    """Points or rates of what is drawn, from those of a frame."""
    return _plain_points(values if points_map is None else points_map(values))


def _plain_points(values: RowPoints) -> RowPoints:
    return both(lambda part: np.ascontiguousarray(part, dtype=np.float64), values)


def _curves(points_map: PointMap, values: RowPoints) -> Array:
    """(K, 3) points or rates of barbs."""
    return np.ascontiguousarray(points_map(values), dtype=np.float64).reshape(-1, 3)


def _write_shaft(values: RowPoints, stage: ToStage, out: Floats) -> bool:
    nodes = values.nodes
    flat = nodes.reshape(-1, 3)
    return bool(surface_kernels.write_points(flat, nodes.shape[1], stage, out))


def _padding(widths: Array) -> np.float32:
    """What USD pads the extent of curves by: half the greatest width, in single precision."""
    return np.float32(0.5) * np.float32(widths.max(initial=0.0))


def _plain(indices: Indices) -> Indices:
    return np.ascontiguousarray(indices, dtype=np.int64)
