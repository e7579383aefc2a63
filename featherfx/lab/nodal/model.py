"""Constant data of the nodal kinematics, beside the Model of the same batch.

The unknowns are the positions of the nodes themselves and the world rotations of the rows' frames.
They are numbered row by row, and within a row from the end of the trailing barb over the rachis and
the frame to the end of the leading one; nodes of a barb of length zero are their row's rachis node.
So no energy couples unknowns further apart than about two rows.

Tables of the vane's bending by dihedral angles: separate hinges, or a plate.

    hinge    W = 1/2 D(beta) s^2 / (A_1 + A_2) (t - t0)^2
             D(beta) = (D_p - D_b) / 2 cos(2 beta) + (D_p + D_b) / 2
    plate    W = 1/2 A (D_b k_vv^2 + D_p k_ww^2 + 2 D_t k_vw^2),      k = R^-1 (t - t0)

D_b bending along the barbs, D_p across them, D_t in twist, N m; s rest length of the edge, A rest
areas, beta the angle between edge and barb at rest, the average of both triangles weighted by
their areas; t dihedral angles, R the angles of a triangle for unit curvatures of its patch.

Source of the hinge: Jouve 2024, eq. 6.2 to 6.5, with the factor of
featherfx/mechanics/vane_bending_kernels.py, under which D_p is the modulus of a strip of barbs
that is rolled up; eq. 6.2 with 6.3 as printed means a modulus 27 times smaller. Hinges at all
edges mix bending with twist on such a grid, so the bending that they give depends on the grid.
The plate does not: R maps every constant curvature exactly, so it converges to the Kirchhoff
plate (Oñate and Zárate 2000, basic shell triangle, on this grid). At a free edge the missing
angle takes the value of least energy, which is the edge's natural condition.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal, NamedTuple

import numpy as np

from featherfx.algebra.types import Array, Flags, Indices
from featherfx.algebra.vectors import frames_to_quats
from featherfx.errors import Problem, require
from featherfx.feather.profiles import hooked_stiffness
from featherfx.feather.types import Feather
from featherfx.groom.types import FeatherKind
from featherfx.lab.nodal.energy_kernels import (
    angles_per_curvature,
    barb_turns,
    half_bandwidth,
    hinge_turns,
)
from featherfx.mechanics.batch import MIN_HOOKED, row_frames
from featherfx.mechanics.model import Model
from featherfx.mechanics.resolution import MIN_BARB_STIFFNESS
from featherfx.mechanics.vane_rest import barb_nodes, cell_weights


def hinge_places(cell: Flags) -> Flags:
    """(3, 2, n, m) which hinges have both triangles; cell: (2, n-1, m, 2)."""
    sides, cells, columns, _ = cell.shape
    active = np.zeros((3, sides, cells + 1, columns), dtype=np.bool_)
    active[0, :, 1:-1] = cell[:, 1:, :, 0] & cell[:, :-1, :, 1]
    active[1, :, :-1] = cell[..., 0] & cell[..., 1]
    active[2, :, :-1, 1:] = cell[:, :, 1:, 0] & cell[:, :, :-1, 1]
    active[2, 0, :-1, 0] = cell[0, :, 0, 0] & cell[1, :, 0, 0]
    return active


def barb_hinges(nodes: Array, area: Array, active: Flags, held: Array, across: float) -> Array:
    """(2, n-1, m, 2, 3, 3) tables of hinges at the barb edges only, as of oriented_hinges.

    held: (2, n-1, m, 2), share of the modulus that each triangle has.
    """
    edge = np.diff(nodes, axis=2)[:, 1:-1]
    softer = area[:, 1:, :, 0] / held[:, 1:, :, 0] + area[:, :-1, :, 1] / held[:, :-1, :, 1]
    there = active[0, :, 1:-1] & (softer > 0.0)
    stiffness = across * np.einsum("...k,...k", edge, edge) / np.where(there, softer, 1.0)
    modes = np.zeros((*area.shape, 3, 3))
    modes[:, 1:, :, 0, 0, 0] = np.sqrt(np.where(there, stiffness, 0.0))
    return modes


def oriented_hinges(nodes: Array, area: Array, active: Flags, along: Array, across: float) -> Array:
    """(2, n-1, m, 2, 3, 3) tables of hinges at all edges, but not where the vanes meet.

    nodes: (2, n, m + 1, 3) m, column 0 on the rachis. area: (2, n-1, m, 2) m^2, of the triangles.
    active: (3, 2, n, m). along: (m,) N m, modulus along the barbs by column; across: N m.
    """
    low, high = nodes[:, :-1], nodes[:, 1:]
    barb_low, barb_high = np.diff(low, axis=2), np.diff(high, axis=2)
    first, second = area[..., 0], area[..., 1]
    diagonal = high[:, :, :-1] - low[:, :, 1:]
    row_edge = (high - low)[:, :, :-1]
    before = np.zeros_like(second)
    before[:, :, 1:] = second[:, :, :-1]
    barb_before = np.zeros_like(barb_high)
    barb_before[:, :, 1:] = barb_high[:, :, :-1]
    below = np.zeros_like(second)
    below[:, 1:] = second[:, :-1]
    kinds = (
        (barb_low, barb_low, barb_low, first, below),
        (diagonal, barb_low, barb_high, first, second),
        (row_edge, barb_low, barb_before, first, before),
    )
    modes = np.zeros((*area.shape, 3, 3))
    for kind, (edge, barb_1, barb_2, area_1, area_2) in enumerate(kinds):
        total = area_1 + area_2
        there = active[kind, :, :-1] & (total > 0.0)
        if kind == 2:
            there[:, :, 0] = False
        safe = np.where(there, total, 1.0)
        tilt = (area_1 * _angle(edge, barb_1) + area_2 * _angle(edge, barb_2)) / safe
        modulus = 0.5 * (across - along) * np.cos(2.0 * tilt) + 0.5 * (across + along)
        square = np.einsum("...k,...k", edge, edge)
        modes[:, :, :, 0, kind, kind] = np.sqrt(np.where(there, modulus * square / safe, 0.0))
    return modes


def plate_tables(points: Array, area: Array, active: Flags, moduli: Array) -> Array:
    """(2, n-1, m, 2, 3, 3) tables of a plate.

    points: (n, 1 + 2 m, 3) m at rest. area: (2, n-1, m, 2) m^2. active: (3, 2, n, m). moduli:
    (3, 3) N m, for k = (k_vv, k_ww, k_vw): along the leading vane's barbs, across them towards the
    tip, and in twist; W = 1/2 A k.moduli k.
    """
    response = np.zeros((*area.shape, 3, 3))
    angles_per_curvature(
        np.ascontiguousarray(points),
        active,
        np.zeros((6, 2), np.int64),
        np.zeros((4, 3)),
        np.zeros(18),
        response,
    )
    flat = response.reshape(-1, 3, 3)
    # a triangle's own axes lead away from the rachis and, in the second of a cell, to the base
    twist = np.ones(area.shape)
    twist[1] *= -1.0
    twist[..., 1] *= -1.0
    table = np.zeros_like(flat)
    for t in np.flatnonzero(area.reshape(-1) > 0.0):
        axes = np.array([1.0, 1.0, twist.reshape(-1)[t]])
        table[t] = _triangle_table(flat[t], moduli * np.outer(axes, axes) * area.reshape(-1)[t])
    return table.reshape(*area.shape, 3, 3)


def _triangle_table(response: Array, weight: Array) -> Array:
    """(3, 3) table of one triangle whose missing hinges have rows of zeros in response (3, 3)."""
    there = np.any(response != 0.0, axis=1)
    if not there.any():
        return np.zeros((3, 3))
    # least energy among the curvatures that have the angles there are
    angles = response[there]
    stiffness = np.linalg.inv(angles @ np.linalg.solve(weight, angles.T))
    values, vectors = np.linalg.eigh(stiffness)
    table = np.zeros((3, 3))
    table[: len(values), there] = np.sqrt(np.maximum(values, 0.0))[:, None] * vectors.T
    return table


def _angle(first: Array, second: Array) -> Array:
    """Angle between lines, 0..pi/2; 0 where one has no length."""
    dot = np.abs(np.einsum("...k,...k", first, second))
    size = np.linalg.norm(first, axis=-1) * np.linalg.norm(second, axis=-1)
    return np.arccos(np.clip(np.divide(dot, size, out=np.ones_like(dot), where=size > 0), 0, 1))


Bending = Literal["barbs", "hinges", "plate"]
Stretch = Literal["stiff", "inextensible"]
Section = Literal["vane", "carried"]


class NodalModel(NamedTuple):
    """F feathers, n rows, m columns a side; sides as in Model.

    slot: (F, n, 1 + 2 m) first of a node's three unknowns, -1 where it is prescribed; frame_slot:
    (F, n) the same of the rows' frames. size: (F,) unknowns of a feather. band: half-bandwidth of
    the widest. rest_nodes: (F, n, 1 + 2 m, 3) m and rest_rotation: (F, n, 4), in the root's frame.
    present: (F, 2, n) bool, barbs that there are. stretch_inverse: (F, 2, n, m) 1/s, of the
    segment up to node j + 1, and stretch_stiffness: (F, 2, n, m) N m. bend_rest: (F, 2, n, m, 2)
    rad, (s, b) at joint j (0: the clamp), and bend_stiffness: N m. hinge_active, hinge_rest:
    (F, 3, 2, n, m) bool and rad. plate: (F, 2, n-1, m, 2, 3, 3) sqrt(N m), the tables of
    vane_plate. has_rachis: false for loose barbs. inextensible: whether stretch is a constraint.
    carried: whether the sections of barbs are carried along them, else they follow the vane.
    """

    slot: Indices
    frame_slot: Indices
    size: Indices
    band: int
    rest_nodes: Array
    rest_rotation: Array
    present: Flags
    stretch_inverse: Array
    stretch_stiffness: Array
    bend_rest: Array
    bend_stiffness: Array
    hinge_active: Flags
    hinge_rest: Array
    plate: Array
    has_rachis: bool
    inextensible: bool
    carried: bool


def nodal_model(
    model: Model,
    feathers: Sequence[Feather],
    kinds: Sequence[FeatherKind],
    *,
    bending: Bending = "barbs",
    stretch: Stretch = "stiff",
    section: Section = "vane",
    has_rachis: bool = True,
    pinned: Flags | None = None,
) -> NodalModel:
    """Constant arrays of the nodal kinematics for a batch made by make_model.

    feathers, kinds: those of the batch. bending: how the vane bends out of its plane: "barbs":
    every barb a rod, and hinges at the barb edges, the energies of the barb-curvature kinematics;
    "hinges": hinges at all edges whose modulus depends on their angle to the barbs; "plate": an
    orthotropic plate of barb_bending_normal along the barbs and bending_across across them and in
    twist, over both vanes as one where there is no rachis. Barbs bend within the vane in all three.
    stretch: "stiff": with the modulus `along`; "inextensible": the limit, by multipliers.
    section: what a barb's bending out of the vane and within it refers to: "vane": the vane's
    normal at the node, as barbules hold it; "carried": a section carried along the barb without
    twist from its clamp, as in the barb-curvature kinematics; it wants a rachis.
    has_rachis: whether there is a rachis; without one its points are plain nodes. pinned:
    (n, 1 + 2 m) nodes that follow the root rigidly besides the held root itself; a rachis node
    that does, does so with its frame.

    InputError for an unknown bending, stretch or section or a pinned of another shape.
    """
    _check(model, bending, stretch, section, has_rachis, pinned)
    carried = section == "carried"
    known: dict[tuple[int, FeatherKind, bool], dict] = {}
    parts = []
    for f, (feather, kind) in enumerate(zip(feathers, kinds, strict=True)):
        key = (id(feather), kind, bool(model.held[f]))
        if key not in known:
            known[key] = _one(model, f, feather, kind, bending, carried, has_rachis, pinned)
        parts.append(known[key])
    band = max(int(part.pop("band")) for part in known.values())
    arrays = {name: np.stack([part[name] for part in parts]) for name in parts[0]}
    if carried:
        band = max(band, 3 * (model.columns + 2) - 1)
    return NodalModel(
        **arrays,
        band=band,
        has_rachis=has_rachis,
        inextensible=stretch == "inextensible",
        carried=carried,
    )


def _check(
    model: Model, bending: str, stretch: str, section: str, has_rachis: bool, pinned: Flags | None
) -> None:
    problems = []
    for key, value, allowed in (
        ("bending", bending, Bending.__args__),  # type: ignore[attr-defined]
        ("stretch", stretch, Stretch.__args__),  # type: ignore[attr-defined]
        ("section", section, Section.__args__),  # type: ignore[attr-defined]
    ):
        if value not in allowed:
            problems.append(Problem("", key, f"'{value}' is not one of {', '.join(allowed)}"))
    if section == "carried" and not has_rachis:
        problems.append(Problem("", "section", "'carried' begins at a clamp. Give a rachis"))
    shape = model.mass.shape[1:]
    if pinned is not None and pinned.shape != shape:
        problems.append(Problem("", "pinned", f"shape {pinned.shape} is not allowed. Give {shape}"))
    if model.hooked:
        message = "the nodal kinematics has no gaps that slip or open. Give closed, no splits"
        problems.append(Problem("", "vane_material.hooks", message))
    if model.rachis_rest.shape[2] > 6:
        message = "true is not allowed. The nodal kinematics has no ribbons. Give false"
        problems.append(Problem("", "vane_material.ribbon", message))
    require(*problems)


def _one(
    model: Model,
    f: int,
    feather: Feather,
    kind: FeatherKind,
    bending: Bending,
    carried: bool,
    has_rachis: bool,
    pinned: Flags | None,
) -> dict:
    """The arrays of NodalModel for one feather."""
    vane = kind.vane_material
    present = feather.barb_length > 0.0
    area = np.where(feather.cell, model.cell_stiffness[f, ..., 0], 0.0)
    held = np.maximum(hooked_stiffness(kind, feather), MIN_HOOKED)
    area = area / (
        vane.modulus_across_barbs * vane.thickness * held * cell_weights(feather.columns)[..., 0]
    )
    nodes = np.ascontiguousarray(feather.rest.nodes)
    rotation = frames_to_quats(row_frames(feather.rest.directors))
    active = hinge_places(feather.cell)
    plate = _bending_tables(feather, kind, bending, area, held, active, has_rachis)
    used = np.any(plate != 0.0, axis=-2)
    active = _used_hinges(active, used)
    bend_stiffness = _bend_stiffness(feather, kind, bending, has_rachis)
    bend_rest = np.zeros(bend_stiffness.size)
    barb_turns(
        rotation, nodes, model.clamp[f], bend_stiffness, carried, np.zeros((3, 3)), bend_rest
    )
    hinge_rest = np.zeros(active.size)
    hinge_turns(nodes, active, hinge_rest)
    slot, frame_slot, size = _slots(
        present, feather.columns, has_rachis, bool(model.held[f]), pinned
    )
    inverse, stretch_stiffness = _stretch(feather, kind, area)
    return {
        "slot": slot,
        "frame_slot": frame_slot,
        "size": np.int64(size),
        "band": half_bandwidth(slot, frame_slot, feather.cell, np.zeros((6, 2), np.int64)),
        "rest_nodes": nodes,
        "rest_rotation": rotation,
        "present": present,
        "stretch_inverse": inverse,
        "stretch_stiffness": stretch_stiffness,
        "bend_rest": bend_rest.reshape(bend_stiffness.shape),
        "bend_stiffness": bend_stiffness,
        "hinge_active": active,
        "hinge_rest": hinge_rest.reshape(active.shape),
        "plate": plate,
    }


def _slots(
    present: Flags, columns: int, has_rachis: bool, held: bool, pinned: Flags | None
) -> tuple[Indices, Indices, int]:
    """First unknown of every node (n, 1 + 2 m) and frame (n,), and how many unknowns there are."""
    rows = present.shape[1]
    slot = np.full((rows, 1 + 2 * columns), -1, dtype=np.int64)
    frame_slot = np.full(rows, -1, dtype=np.int64)
    fixed = np.zeros(slot.shape, dtype=np.bool_) if pinned is None else pinned.copy()
    if held:
        fixed[0, 0] = True
    leading, trailing = np.arange(1, 1 + columns), np.arange(2 * columns, columns, -1)
    count = 0
    for i in range(rows):
        for p in [*(trailing if present[1, i] else ()), 0, *(leading if present[0, i] else ())]:
            if not fixed[i, p]:
                slot[i, p] = count
                count += 3
            if p == 0 and has_rachis and not fixed[i, 0]:
                frame_slot[i] = count
                count += 3
        for side, nodes in ((0, leading), (1, trailing)):
            if not present[side, i]:
                slot[i, nodes] = slot[i, 0]
    return slot, frame_slot, count


def _stretch(feather: Feather, kind: FeatherKind, area: Array) -> tuple[Array, Array]:
    """stretch_inverse and stretch_stiffness, (2, n, m)."""
    length = np.linalg.norm(np.diff(barb_nodes(feather.rest.nodes), axis=2), axis=-1)
    beside = np.zeros_like(length)
    beside[:, :-1] += area[..., 0]
    beside[:, 1:] += area[..., 1]
    there = (feather.barb_length > 0.0)[:, :, None] & (length > 0.0)
    inverse = np.divide(1.0, length, out=np.zeros_like(length), where=there)
    vane = kind.vane_material
    return inverse, np.where(there, vane.modulus_along_barbs * vane.thickness * beside, 0.0)


def _taper(fraction: Array, kind: FeatherKind) -> Array:
    """Bending stiffness of a barb at fractions of its length, relative to its root's."""
    return np.maximum((1.0 - fraction) ** kind.vane_material.barb_taper, MIN_BARB_STIFFNESS)


def _bend_stiffness(
    feather: Feather, kind: FeatherKind, bending: Bending, has_rachis: bool
) -> Array:
    """(2, n, m, 2) N m, out of the vane and within it; joint 0 is the clamp."""
    vane, columns = kind.vane_material, feather.columns
    segment = feather.barb_length / columns
    bundle = np.divide(feather.barb_span, segment, out=np.zeros_like(segment), where=segment > 0)
    joints = _taper(np.arange(columns) / columns, kind)
    joints[0] = 2.0 * _taper(np.array(0.25 / columns), kind) if has_rachis else 0.0
    moduli = np.array([vane.barb_bending_normal, vane.barb_bending_in_plane])
    stiffness = bundle[:, :, None, None] * joints[:, None] * moduli
    # the elastic clamp is in series with the half segment next to the rachis
    clamp = np.array([vane.barb_clamp_normal, vane.barb_clamp_in_plane])
    joint = stiffness[:, :, 0]
    compliant = feather.barb_span[:, :, None] + joint * clamp
    softer = feather.barb_span[:, :, None] * joint
    stiffness[:, :, 0] = np.divide(softer, compliant, out=np.zeros_like(joint), where=compliant > 0)
    if bending != "barbs":
        stiffness[:, :, 1:, 0] = 0.0
    return stiffness


def _bending_tables(
    feather: Feather,
    kind: FeatherKind,
    bending: Bending,
    area: Array,
    held: Array,
    active: Flags,
    has_rachis: bool,
) -> Array:
    vane, columns = kind.vane_material, feather.columns
    nodes, across = barb_nodes(feather.rest.nodes), vane.bending_across
    if bending == "barbs":
        return barb_hinges(nodes, area, active, held, across)
    if bending == "hinges":
        along = vane.barb_bending_normal * _taper((np.arange(columns) + 0.5) / columns, kind)
        return oriented_hinges(nodes, area, active, along, across)
    if has_rachis:
        active = active.copy()
        active[2, :, :, 0] = False
    moduli = np.diag([vane.barb_bending_normal, vane.bending_across, 2.0 * vane.bending_across])
    return plate_tables(feather.rest.nodes, area, active, moduli)


def _used_hinges(active: Flags, used: Flags) -> Flags:
    """Hinges that a table weighs; used: (2, n-1, m, 2, 3)."""
    result = np.zeros_like(active)
    for kind in range(2):
        first, second = used[..., 0, kind], used[..., 1, kind]
        result[kind, :, :-1] |= first
        result[kind, :, (1 if kind == 0 else 0) : (None if kind == 0 else -1)] |= second
    result[2, :, :-1] |= used[..., 0, 2]
    result[2, :, :-1, 1:] |= used[:, :, :-1, 1, 2]
    result[2, 0, :, 0] |= result[2, 1, :, 0]
    result[2, 1, :, 0] = False
    return result & active
