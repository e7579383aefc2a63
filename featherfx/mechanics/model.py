"""Constant data of a batch of feathers that share a grid, as the kernels read it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


class VaneHooks(NamedTuple):
    """When gaps between barbs slip and open (vane_hook_kernels), triangle by triangle.

    limit: (F, 2, n-1, m, 2, 2) J, y_w and y_v. growth: (F, 2, n-1, m, 2) 1/J, c. release:
    (F, 2, n-1, m, 2) J, work of slip at level 1 from the strength to the open gap; infinite where
    gaps do not open. strength: (F,) level. opened: (F, 2, n-1, m, 2), n of gaps that are open from
    the start, 0 of the others; those that nothing can close have the limit 0. bounds: (F, 2), for
    strains e_ww and 2 e_vw: a whole gap holds where the sum of their squares, each times its own,
    is below 1. Where all hooks hold whatever happens m is 0, here and in Gaps, and kernels leave
    them out.
    """

    limit: Array
    growth: Array
    release: Array
    strength: Array
    opened: Array
    bounds: Array


class Gaps(NamedTuple):
    """History of the gaps of a feather; those of a state have a leading axis.

    slip: (2, n-1, m, 2, 2), p_w and p_v of triangles A and B. level: (2, n-1, m, 2) of yield, or n
    of an open one (vane_hook_kernels). hooked: (2, n-1, m, 2), the part of the strength that is
    left. spent: (5,) J, what slip and opening have cost so far, what opened gaps have released
    besides, what preening has put in, and what damping has taken. length: (2,) m, of gaps that have
    opened so far, and that were closed again.
    """

    slip: Array
    level: Array
    hooked: Array
    spent: Array
    length: Array


class Model(NamedTuple):
    """F feathers, n rows, m columns a side, C curvature coefficients per barb and direction.

    Nodes and directors of a row: featherfx/feather/types.py; sides are 0 leading, 1 trailing. SI
    units.

    held: (F,) bool, whether row 0 is led by the root frame (else the feather flies free).
    length: (F, n-1) m, rest lengths of the rachis elements.
    rachis_rest: (F, n-1, 6) v0 and p0 of featherfx/mechanics/rachis_kernels.py; with ribbons
        (F, n-1, 8), then nu and f of ribbon_kernels.py.
    rachis_stiffness: (F, n-1, 6) l c (N m) and d / l (N m).
    clamp: (F, 2, n, 4) rest direction of the barbs in the row frame, quaternions.
    joints: (F, 2, n, m, 4) rest turns between segments; the first is the identity but where
        a drawn pose is the balance (solver/inverse_statics.py).
    segment: (F, 2, n) m, length of the barbs' segments.
    shapes: (C, m) part of each curvature shape that falls on each joint.
    barb_stiffness: (F, 2, n, 2 C) N m, normal then in-plane; 1 where there is no barb.
    cell_rest: (F, 2, n-1, m, 2, 3) 1/s, p, 1/h of triangles A and B (vane_membrane_kernels).
    cell_stiffness: (F, 2, n-1, m, 2, 2) N m, b A E_ww and b A E_vw; 0 where there is no triangle.
    hinge_rest: (F, 2, n, m, 3) rest dihedral angle at the barb edge from column j to j + 1, rad,
    and opening (1/m^4) of the triangles above and below it (vane_bending_kernels).
    hinge_stiffness: (F, 2, n, m) N m; 0 where there is no hinge.
    twist_rest: (F, 2, n-1, m, 2) 1 / A^(3/2) (1/m^3) and rest twist (vane_bending_kernels).
    twist_stiffness: (F, 2, n-1, m) N m, 4 D_66; 0 where a cell lacks a triangle.
    mass: (F, n, 1 + 2 m) kg, of the nodes.
    rotary_inertia: (F, n, 2) kg m^2 of the rachis, carried by the directors.
    rachis_area: (F, n) m^2, side area of the rachis that the row stands for, for air drag.
    air_volume: (F, n, 1 + 2 m) m^3, of the air that the vane carries (air_kernels).
    passing: (F, 2, 2) 1 / T, Pa s/m, and (1 - p) / p^2 of both vanes (air_kernels).
    attached: (F, 2) most and slope, 1/rad, of the coefficient of attached flow (node_kernels).
    retardation: (F, 2) s, of the dashpots of rachis and vane. relaxation_time: (F, 2, B) s and
    relaxation_weight: (F, 2, B), of their Maxwell branches (solver/damping); B is 0 without loss.
    cell_guard: (F, 2, n-1, m, 2, 2), G (N m) and n of the compression guard (guard_kernels),
    or (F, 0, 0, 0, 0, 0) where there is none. hooks: of the vane.
    """

    held: NDArray[np.bool_]
    length: Array
    rachis_rest: Array
    rachis_stiffness: Array
    clamp: Array
    joints: Array
    segment: Array
    shapes: Array
    barb_stiffness: Array
    cell_rest: Array
    cell_stiffness: Array
    hinge_rest: Array
    hinge_stiffness: Array
    twist_rest: Array
    twist_stiffness: Array
    mass: Array
    rotary_inertia: Array
    rachis_area: Array
    air_volume: Array
    passing: Array
    attached: Array
    retardation: Array
    relaxation_time: Array
    relaxation_weight: Array
    hooks: VaneHooks
    cell_guard: Array = np.zeros((0, 0, 0, 0, 0, 0))

    @property
    def feathers(self) -> int:
        return self.mass.shape[0]

    @property
    def rows(self) -> int:
        return self.mass.shape[1]

    @property
    def columns(self) -> int:
        return self.joints.shape[3]

    @property
    def coefficients(self) -> int:
        return self.shapes.shape[0]

    def only(self, feather: int) -> Model:
        """The model of one of its feathers."""
        return self.some(slice(feather, feather + 1))

    def some(self, feathers: slice | list[int]) -> Model:
        """The model of some of its feathers; numbers may repeat."""
        parts = {name: value[feathers] for name, value in self.arrays().items() if name != "shapes"}
        return Model.from_arrays(parts | {"shapes": self.shapes})

    def arrays(self) -> dict[str, Any]:
        """All arrays by name, those of hooks as hooks.name."""
        fields: dict[str, Any] = self._asdict()
        hooks = fields.pop("hooks")._asdict()
        return fields | {f"hooks.{name}": value for name, value in hooks.items()}

    @staticmethod
    def from_arrays(arrays: Mapping[str, Any]) -> Model:
        """The model of its `arrays`."""
        fields = {name: value for name, value in arrays.items() if "." not in name}
        return Model(
            hooks=VaneHooks(*(arrays[f"hooks.{name}"] for name in VaneHooks._fields)), **fields
        )

    @property
    def hooked(self) -> bool:
        """Return whether gaps between barbs may slip."""
        return self.hooks.limit.shape[3] > 0

    @property
    def unknowns(self) -> int:
        """Generalised coordinates of one feather."""
        return self.rows * (6 + 4 * self.coefficients)


def no_hooks(feathers: int, rows: int) -> VaneHooks:
    """Those of vanes whose hooks hold whatever happens."""
    none = np.zeros((feathers, 2, rows - 1, 0, 2))
    limit, each = none[..., None].repeat(2, -1), np.zeros(feathers)
    return VaneHooks(limit, none, none, each, none, np.zeros((feathers, 2)))


class Contacts(NamedTuple):
    """K contacts of single nodes with moving planes (contact_kernels), by feather.

    first: (F + 1,) contacts first[f] to first[f + 1] are feather f's. node: (K, 2) row and
    node. normal: (K, 3) unit, out of the other body. offset: (K, 2) m, of the plane at
    the step's start and end. target: (K, 2, 3) m, where the point would be had it gone along with
    the other body. strength: (K, 4) stiffness N/m, force of the iteration before N, bound of the
    friction force N, slip over which friction sets in m.
    """

    first: NDArray[np.int64]
    node: NDArray[np.int64]
    normal: Array
    offset: Array
    target: Array
    strength: Array


def no_contacts(feathers: int) -> Contacts:
    """The contacts of a batch that touches nothing."""
    return Contacts(
        first=np.zeros(feathers + 1, dtype=np.int64),
        node=np.zeros((0, 2), dtype=np.int64),
        normal=np.zeros((0, 3)),
        offset=np.zeros((0, 2)),
        target=np.zeros((0, 2, 3)),
        strength=np.zeros((0, 4)),
    )


class Loads(NamedTuple):
    """Loads on a batch during a step.

    gravity: (3,) m/s^2. air: (4,) air density kg/m^3, normal and tangential vane coefficients,
    rachis coefficient. wind_mean: (F, 3) m/s, or (3,) for all feathers; wind_wave: (3, K) rad/m,
    wind_rate: (K,) rad/s, wind_amplitude: (3, K) m/s, wind_phase: (K,) rad: mean + sum amplitude
    cos(wave.x - rate t + phase). grip_node: (F, G, 2) row and node, row -1 for none.
    grip_start, grip_end: (F, G, 3) m, target at the frame's start and end. grip_stiffness: (F, G)
    N/m. grip_slack: (F, G) m, how far a grip's point is free around the target, or (0, 0).
    max_grip_force: (F, G) N, most that a grip pulls with, or (0, 0) where nothing bounds it. force:
    (F, n, 1 + 2 m, 3) N, dead loads on the nodes at the frame's start, or (F, 0, 0, 3) where there
    are none. force_change: as force, what is added to it linearly up to the frame's
    end, or (0, 0, 0, 3). couple: (F, n, 2, 3) N m, dead loads on the directors, or (0, 0, 2, 3).
    contacts: with other bodies. added_mass: (F,) part of the air that a lone closed vane would
    carry, or (0,) where none is carried. wind_change: (F, 3) m/s^2, of wind_mean from frame to
    frame, which pushes carried air.
    """

    gravity: Array
    air: Array
    wind_mean: Array
    wind_change: Array
    wind_wave: Array
    wind_rate: Array
    wind_amplitude: Array
    wind_phase: Array
    grip_node: NDArray[np.int64]
    grip_start: Array
    grip_end: Array
    grip_stiffness: Array
    force: Array
    contacts: Contacts
    force_change: Array = np.zeros((0, 0, 0, 3))
    couple: Array = np.zeros((0, 0, 2, 3))
    grip_slack: Array = np.zeros((0, 0))
    max_grip_force: Array = np.zeros((0, 0))
    added_mass: Array = np.zeros(0)


def expand_wind(loads: Loads, feathers: int) -> Loads:
    """The same loads with the mean wind of every feather, (F, 3), as the kernels take it.

    A writable copy, row by row: kernels are compiled anew for arrays that are read-only or lie
    otherwise.
    """
    mean = np.broadcast_to(loads.wind_mean, (feathers, 3))
    return loads._replace(wind_mean=np.array(mean, dtype=float, order="C"))


def no_loads(feathers: int, gravity: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> Loads:
    """Loads of a batch in still vacuum under the given gravity (m/s^2)."""
    return Loads(
        gravity=np.array(gravity, float),
        air=np.zeros(4),
        wind_mean=np.zeros((feathers, 3)),
        wind_change=np.zeros((feathers, 3)),
        wind_wave=np.zeros((3, 0)),
        wind_rate=np.zeros(0),
        wind_amplitude=np.zeros((3, 0)),
        wind_phase=np.zeros(0),
        grip_node=np.full((feathers, 0, 2), -1),
        grip_start=np.zeros((feathers, 0, 3)),
        grip_end=np.zeros((feathers, 0, 3)),
        grip_stiffness=np.zeros((feathers, 0)),
        force=np.zeros((feathers, 0, 0, 3)),
        contacts=no_contacts(feathers),
    )
