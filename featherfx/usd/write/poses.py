"""Poses of one feather, computed by compiled code in the memory of USD arrays."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from functools import cache, cached_property
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from featherfx import usd
from featherfx.algebra.types import Array, Floats, Indices
from featherfx.algebra.vectors import unit
from featherfx.feather.shapes import carry_motion
from featherfx.feather.types import (
    RACHIS_PART,
    BarbCurves,
    Feather,
    FeatherSurface,
    PointMap,
    RowPoints,
    both,
)
from featherfx.jit.compiled import KernelModule
from featherfx.shot.frames import FeatherPose
from featherfx.usd.types import (
    ACCELERATIONS,
    BARB_DIRECTION,
    BARB_NODE_PRIMVARS,
    BARB_PRIM,
    DETAIL_ATTRIBUTE,
    ENERGY_DENSITY,
    HOOK_PRIMVARS,
    HOOKED_PRIMVAR,
    MESH_PRIM,
    ORIENT_PRIMVAR,
    PER_FACE_PRIMVARS,
    RACHIS_PRIM,
    RATES,
    SLIP_PRIMVAR,
    STRAIN_ACROSS,
    STRAIN_SHEAR,
    WET_PRIMVARS,
    FeatherEntry,
    StageSpace,
)
from featherfx.usd.write.output import AttributeKey, CacheForm, find_keys

if TYPE_CHECKING:
    from featherfx.feather.detail import ThinnedGrid
    from featherfx.feather.splits import SplitEdges

surface_kernels = KernelModule("featherfx.usd.write.surface_kernels")

_NONE, _ONE = np.zeros(0), np.ones(1)


class DrawnSurface(NamedTuple):
    """A surface of V points and T triangles; row, node, offset, lips: as in Surface.

    edges: (T, 2), a triangle's along its barb. Scratch: world (V, 3) m, points or rates in double
    precision, for what is derived of them; sums (V, 3) of normals; parted (L,) whether lips are
    open, and carried (L, 3) where they are then, or their rates.
    """

    row: Indices
    node: Indices
    offset: Array
    triangles: Indices
    edges: NDArray[np.int32]
    lips: Indices
    world: Array
    sums: Array
    parted: NDArray[np.bool_]
    carried: Array


class ToStage(NamedTuple):
    """units: stage units per metre. y_up: whether y points up (x, y, z becomes x, z, -y)."""

    units: float
    y_up: bool


class WrittenSurface(NamedTuple):
    """points, normals: (V, 3). directions: (T, 3) unit, of barbs. rachis: (n, 3) points."""

    points: Floats
    normals: Floats
    directions: Floats
    rachis: Floats


# What is written of one feather: the elements of each attribute that are its own.
Written = Mapping[AttributeKey, Floats]


class PosedFeather:
    """The constant arrays of one feather of a cache, and its evaluation.

    id: of the feather. widths, barb_widths: (n,) and (B K,) stage units, diameters of rachis and
    barbs; those of the rachis are of the circle of its section's area. parts: its prims. points: of
    each, and faces: of its mesh. held: (faces,) fraction of barbules that are hooked at rest. keys:
    attributes of the parts. form: which of these are written; a mesh that is not has neither points
    nor faces. thin: which rows and nodes are, None: all. rest_points: of the feather, in its own
    frame. length: m, of its rachis.
    """

    def __init__(
        self,
        entry: FeatherEntry,
        surface: _SharedSurface,
        space: StageSpace,
        extras: Collection[str],
        form: CacheForm = CacheForm(),
    ) -> None:
        """extras: ACCELERATIONS, names of DIAGNOSTICS."""
        self.form, self.rest_points = form, entry.feather.rest
        self.thin: ThinnedGrid | None = None
        if form.thinned:
            self.thin = usd.forms.choose_rows_and_nodes(entry.feather.rows, entry.feather.columns)
        self.columns = self.thin.columns if self.thin else entry.feather.columns
        self.length = float(entry.feather.station[-1])
        self.left_leads = form.condensed and usd.forms.left_leads(entry.feather)
        self._entry, self._surface, self.id = entry, surface, entry.id
        self._space = space
        self.to_stage, self.to_origin = _stage_transform(space)
        self._accelerations = ACCELERATIONS in extras
        feather, barbs = entry.feather, entry.barbs
        widths = np.sqrt(feather.width * feather.height)
        self.widths = space.lengths(widths[self.thin.rows] if self.thin else widths)
        self.barb_widths = space.lengths(barbs.drawn_widths) if barbs else _NONE
        self.has_barbs = len(self.barb_widths) > 0
        self.parts = (
            (MESH_PRIM, RACHIS_PRIM, BARB_PRIM) if self.has_barbs else (MESH_PRIM, RACHIS_PRIM)
        )
        counts = {
            MESH_PRIM: len(surface.drawn.row),
            RACHIS_PRIM: len(self.widths),
            BARB_PRIM: len(self.barb_widths),
        }
        self.points = {part: counts[part] for part in self.parts}
        self.faces = len(surface.drawn.triangles)
        every = np.broadcast_to(_ONE, self.faces)
        self.held = every if entry.held is None else entry.held[: self.faces]
        split = entry.feather.split
        self._split = np.where(split, 0.0, 1.0) if split.size else None
        self._hooks = entry.hooked and self.faces > 0
        kinds = self.parts, frozenset(extras), form
        self.keys = find_keys(*kinds, self.faces > 0, self._hooks, entry.wet)

    def count(self, key: AttributeKey) -> int:
        """Return the elements of an attribute."""
        if key[1] in PER_FACE_PRIMVARS:
            return self.faces if key[0] == MESH_PRIM else 1
        if key[1] == DETAIL_ATTRIBUTE:
            return int(self.rest_points.nodes.size)
        return self.points[key[0]] * (self.columns if key[1] in BARB_NODE_PRIMVARS else 1)

    @property
    def drawn(self) -> DrawnSurface:
        """Return its surface for kernels."""
        return self._surface.drawn

    @property
    def grid(self) -> tuple[int, int]:
        """Return rows, and nodes of each, of its poses."""
        rows, nodes = self._entry.rest_points.nodes.shape[:2]
        return rows, nodes

    @property
    def at_rest(self) -> FeatherPose:
        """Return the rest pose, for callers that set its rates to zero."""
        points = self._entry.rest_points
        return FeatherPose(points, points, points)

    @property
    def is_plain(self) -> bool:
        """Return whether only its surface is written, and follows from its nodes alone."""
        alone = self._entry.points_map is None and len(self._surface.drawn.lips) == 0
        return alone and not self.has_barbs and not self.keys.scalars

    @property
    def bytes_per_sample(self) -> int:
        """Return the bytes of one pose, with an extent for each prim."""
        kinds = (
            (self.keys.vectors, 12),
            (self.keys.scalars, 4),
            (self.keys.turns, 8),
            (self.keys.whole, 4),
        )
        extents = 24 * len(set(self.parts) & set(self.form.parts))
        return extents + sum(
            size * self.count(key) for keys, size in kinds for key in keys if self.form.writes(key)
        )

    def rest(self, out: Written) -> bool:
        """Write the rest pose, whose rates are zero; return whether it is finite.

        A groom that is nearer to the world's origin than to the root prim rests about the former,
        since single precision would lose its barbs from there.
        """
        barbs, shift, nodes = self._entry.barbs, self.to_origin, self._entry.rest_points
        first = nodes.nodes.reshape(-1, 3)[0]
        if shift is not None and np.linalg.norm(first) < np.linalg.norm(first + shift):
            shift = None
        nodes = nodes if shift is None else nodes.shifted(shift)
        self._note_hooks(out, self._split)
        self._surface.carry(nodes)
        finite = self._place(out, _contiguous(nodes))
        if self.has_barbs and barbs:
            points = barbs.points if shift is None else barbs.points + shift
            finite &= self._write_barbs(barbs, np.reshape(points, (-1, 3)), out)
        for (_, name), numbers in out.items():
            if name in RATES:
                numbers[...] = 0.0
        return finite

    def evaluate(self, out: Written, given: FeatherPose) -> bool:
        """Write a pose, m and per second; return whether points and rates are finite.

        Raises ValueError for another grid.
        """
        own = self._entry.points_map
        found, expected = np.shape(given.points.nodes), self._entry.rest_points.nodes.shape
        if own is None and found != expected:
            raise ValueError(f"'{self.id}': {found}, not {expected} nodes")
        points = given.points if self.to_origin is None else given.points.shifted(self.to_origin)
        moving = points, given.velocities, given.accelerations
        names = ("velocities", ACCELERATIONS)[: 1 + self._accelerations]
        rates = dict(zip(names, moving[1:], strict=False))
        self._note_hooks(out, self._hooked(given), given.gaps.slip if given.gaps else None)
        for key in self.keys.wet:
            out[key][:] = given.clumped[WET_PRIMVARS.index(key[1])]
        self._surface.carry(points)
        mesh, *changes = map(_contiguous, carry_motion(own, *moving) if own else moving)
        finite = self._place(out, mesh)
        for (name, values), drawn in zip(rates.items(), changes, strict=False):
            second = values if name == ACCELERATIONS else None
            self._surface.carry_rates(points, given.velocities, second)
            drawn = self.thin.select(drawn) if self.thin else drawn
            rates_out = out[MESH_PRIM, name], out[RACHIS_PRIM, name]
            surface = self._surface.drawn
            finite &= bool(surface_kernels.write_values(drawn, surface, self.to_stage, *rates_out))
        return finite & self._barbs(out, points, rates, given) if self.has_barbs else finite

    def _barbs(
        self, out: Written, points: RowPoints, rates: Mapping[str, RowPoints], given: FeatherPose
    ) -> bool:
        """Write barbs of a pose, and their rates; return whether all are finite."""
        from featherfx.feather.barb_looks import clumped

        barbs = self._entry.barbs
        assert barbs is not None
        hooked = self._hooked(given)
        strands = None if hooked is None or barbs.strands is None else barbs.strands.parted(hooked)
        curves, finite = _barb_points(barbs.points_map, points), True
        if strands is not None:
            from featherfx.feather.splits import difference_rates

            curves = strands.joined(curves, strands.positions(points))
        finite &= self._write_barbs(barbs, clumped(barbs, curves, *given.clumped), out)
        for name, values in rates.items():
            curves = _barb_points(barbs.points_map, values)
            if strands is not None:
                second = values if name == ACCELERATIONS else None
                rate = difference_rates(strands.positions, points, given.velocities, second)
                curves = strands.joined(curves, rate)
            curves = barbs.drawn(clumped(barbs, curves, *given.clumped))
            finite &= self._write(curves, out[BARB_PRIM, name])
        return finite

    def _write_barbs(self, barbs: BarbCurves, points: Array, out: Written) -> bool:
        """Write points of barbs, and their normals; return whether all are finite."""
        normals = unit(barbs.drawn(barbs.normals(points)))
        out[BARB_PRIM, "normals"][:] = self._space.directions(normals)
        return self._write(barbs.drawn(points), out[BARB_PRIM, "points"])

    def _hooked(self, given: FeatherPose) -> Array | None:
        """Return hooks of all triangles; None where all hold.

        A feather that is not simulated in full has its splits of the rest state.
        """
        return given.gaps.hooked if given.gaps else self._split

    def is_deformed(self, now: Written, before: Written) -> bool:
        """Return whether the feather, as written, differs from an earlier pose by more than its
        points."""
        own = [
            *((MESH_PRIM, name) for name in HOOK_PRIMVARS),
            *((RACHIS_PRIM, name) for name in BARB_NODE_PRIMVARS),
        ]
        own += (*self.keys.wet, *self.keys.whole)
        return any((now[key] != before[key]).any() for key in own if key in now)

    def _place(self, out: Written, points: RowPoints) -> bool:
        """Write points of mesh and rachis, and derived values; return whether all are finite."""
        if self.thin:
            out[RACHIS_PRIM, DETAIL_ATTRIBUTE][:] = usd.forms.find_details([self], [points])
            points = self.thin.select(points)
        written = WrittenSurface(
            out[MESH_PRIM, "points"],
            out[MESH_PRIM, "normals"],
            out[MESH_PRIM, BARB_DIRECTION],
            out[RACHIS_PRIM, "points"],
        )
        finite = surface_kernels.pose_surface(points, self._surface.drawn, self.to_stage, written)
        if self.keys.scalars and self.faces:
            self._diagnose(out)
        if self.form.condensed:
            numbers = [out[RACHIS_PRIM, name] for name in (*BARB_NODE_PRIMVARS, ORIENT_PRIMVAR)]
            finite &= usd.forms.condense(points, self.left_leads, self.to_stage, numbers)
        return bool(finite)

    def _diagnose(self, out: Written) -> None:
        """Write strain and energy of the surface that was placed last."""
        surface = self._surface
        corners, rest = surface.unstrained
        across, shear = np.zeros((2, len(surface.drawn.edges)))
        surface_kernels.face_strains(surface.drawn.world, corners, rest, across, shear)
        if (MESH_PRIM, STRAIN_ACROSS) in out:
            out[MESH_PRIM, STRAIN_ACROSS][:] = across
            out[MESH_PRIM, STRAIN_SHEAR][:] = shear
        if (MESH_PRIM, ENERGY_DENSITY) in out:
            density = out[MESH_PRIM, ENERGY_DENSITY]
            surface_kernels.energy_density(across, shear, *self._entry.vane_stiffness, density)
            density *= self.held
            if self._entry.stiffened is not None:
                density *= self._entry.stiffened[: len(density)]

    def _note_hooks(self, out: Written, hooked: Array | None, slip: Array | None = None) -> None:
        """Write open split edges, and hooks and slip of each face; None: all hooks hold."""
        surface = self._surface
        surface.part(hooked)
        if not self._hooks:
            return
        held, slipped = out[MESH_PRIM, HOOKED_PRIMVAR], out[MESH_PRIM, SLIP_PRIMVAR]
        held[:], slipped[:] = self.held, 0.0
        cells = surface.cells
        if hooked is not None:
            held[: len(cells)] *= hooked.ravel()[cells]
        if slip is not None:
            slipped[: len(cells)] = np.linalg.norm(slip.reshape(-1, 2)[cells], axis=1)

    def _write(self, world: Array, out: Floats) -> bool:
        return bool(surface_kernels.write_points(world, self.to_stage, out))


@cache
def _stage_transform(space: StageSpace) -> tuple[ToStage, Array | None]:
    """Return the transform to a stage, and to its root prim; None at the world's origin."""
    to_origin = -np.array(space.origin) if space.is_moved else None
    return ToStage(1.0 / space.meters_per_unit, space.up_axis == "Y"), to_origin


class _SharedSurface:
    """Arrays of a surface that all feathers of one shape share, as kernels take them."""

    def __init__(
        self, feather: Feather, edges: NDArray[np.int32], scratch: Array, drawn: bool
    ) -> None:
        """edges: as of barb_edges. scratch: (2, V, 3), also of others, between whose poses it is
        overwritten. drawn: whether the surface is; else nothing of it is computed."""
        self._feather, surface, all_of_it = feather, feather.surface, slice(None if drawn else 0)
        lips = surface.lips[all_of_it]
        self.drawn = DrawnSurface(
            row=read_only(surface.row[all_of_it]),
            node=read_only(surface.node[all_of_it]),
            offset=read_only(surface.offset[all_of_it], np.float64),
            triangles=read_only(surface.triangles[all_of_it]),
            edges=edges[all_of_it],
            lips=read_only(lips),
            world=scratch[0][all_of_it],
            sums=scratch[1][all_of_it],
            parted=np.zeros(len(lips), dtype=np.bool_),
            carried=np.zeros((len(lips), 3)),
        )
        self._lips: SplitEdges | None = None
        if len(lips):
            from featherfx.feather.splits import SplitEdges

            self._lips = SplitEdges.from_feather(feather)

    @property
    def cells(self) -> NDArray[np.int64]:
        """Return cells with faces, in the order of the faces."""
        return np.flatnonzero(self._feather.cell)

    def part(self, hooked: Array | None) -> None:
        """Open the edges of gaps that are open, and close the others; None: all hooks hold."""
        self.drawn.parted[:] = False
        if self._lips and hooked is not None:
            self.drawn.parted[:] = self._lips.open(hooked)

    def carry(self, points: RowPoints) -> None:
        """Set positions of open edges; points: of the feather."""
        if self._lips and self.drawn.parted.any():
            self.drawn.carried[:] = self._lips.positions(points)

    def carry_rates(
        self, points: RowPoints, velocities: RowPoints, accelerations: RowPoints | None
    ) -> None:
        """Set their velocities, or their accelerations where those are given."""
        if self._lips and self.drawn.parted.any():
            from featherfx.feather.splits import difference_rates

            self.drawn.carried[:] = difference_rates(
                self._lips.positions, points, velocities, accelerations
            )

    @cached_property
    def unstrained(self) -> tuple[Indices, Array]:
        """Return rest values as find_rest_strain does; only diagnostics use them."""
        surface = self._feather.surface
        return find_rest_strain(surface, self.drawn.edges, surface.points(self._feather.rest))


def make_posed_feathers(
    entries: Sequence[FeatherEntry],
    space: StageSpace,
    extras: Collection[str] = (),
    form: CacheForm = CacheForm(),
) -> list[PosedFeather]:
    """Return all feathers of a cache.

    Arrays of entries that share a Feather are made once; where no surface is drawn all share one.
    """
    drawn = MESH_PRIM in form.parts
    shapes: dict[int, _SharedSurface] = {}
    # feathers that differ in size alone have one topology
    edges: dict[tuple[int, int], NDArray[np.int32]] = {}
    scratch: dict[int, Array] = {}
    for feather in (entry.feather for entry in entries):
        surface = feather.surface
        topology = id(surface.triangles), id(surface.barb_direction)
        if topology not in edges:
            edges[topology] = find_barb_edges(surface, surface.points(feather.rest))
        if (shape := id(feather) if drawn else 0) not in shapes:
            own = scratch.setdefault(len(surface.row), np.zeros((2, len(surface.row), 3)))
            shapes[shape] = _SharedSurface(feather, edges[topology], own, drawn)
    return [
        PosedFeather(entry, shapes[id(entry.feather) if drawn else 0], space, extras, form)
        for entry in entries
    ]


def find_barb_edges(surface: FeatherSurface, points: Array) -> NDArray[np.int32]:
    """Return (T, 2) the edge of each triangle along its barb, directed as barb_direction.

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


def find_rest_strain(
    surface: FeatherSurface, edges: NDArray[np.int32], points: Array
) -> tuple[Indices, Array]:
    """Return corners (T, 3), barb edge first, and rest values (T, 3) of membrane_strain.

    points: (V, 3) surface points at rest. The height over the edge is negative on faces at the
    root's side of their barb, so that `across` points to the tip everywhere. Else the shear would
    change its sign from face to face.
    """
    opposite = surface.triangles.sum(axis=1) - edges.sum(axis=1)
    corners = np.column_stack([edges, opposite]).astype(np.int64)
    start, end, third = (points[corners[:, k]] for k in range(3))
    edge = np.linalg.norm(end - start, axis=1)
    along = np.einsum("tc,tc->t", third - start, end - start) / np.maximum(edge, 1e-300)
    reach = np.einsum("tc,tc->t", third - start, third - start)
    height = np.sqrt(np.maximum(reach - along**2, 0.0))
    sound = (surface.part != RACHIS_PART) & (edge > 0.0) & (height > 0.0)
    height *= np.where(surface.row[opposite] > surface.row[edges[:, 0]], 1.0, -1.0)
    rest = np.zeros(corners.shape)
    rest[sound] = np.column_stack([1.0 / edge[sound], along[sound], 1.0 / height[sound]])
    return corners, rest


def _contiguous(values: RowPoints) -> RowPoints:
    return both(lambda part: np.ascontiguousarray(part, dtype=np.float64), values)


def _barb_points(points_map: PointMap, values: RowPoints) -> Array:
    """Return (K, 3) points or rates of barbs."""
    return np.ascontiguousarray(points_map(values), dtype=np.float64).reshape(-1, 3)


def read_only(values: NDArray[Any], kind: Any = np.int64) -> NDArray[Any]:
    """Return a read-only array; kernels are compiled for constant arrays."""
    own = np.ascontiguousarray(values, dtype=kind).view()
    own.flags.writeable = False
    return own
