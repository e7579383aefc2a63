"""Surfaces of feathers as contact sees them, and the search for what touches."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from featherfx.feather.types import without_directors
from featherfx.mechanics.model import Contacts, Model, no_contacts
from featherfx.solver.contact.find_kernels import find_contacts
from featherfx.solver.contact.grids import Grids, grids_of
from featherfx.solver.contact.list_kernels import (
    COLUMN,
    GUEST,
    GUEST_FORCE,
    HOST,
    HOST_FORCE,
    INTEGERS,
    PAIR,
    ROW,
    SIDE,
    VALUES,
)
from featherfx.solver.contact.search_kernels import RIM_PARTS, row_boxes
from featherfx.solver.contact.wall import Wall
from featherfx.solver.contact.wall_kernels import find_wall_contacts

Array = NDArray[np.float64]
Indices = NDArray[np.int64]
Bytes = NDArray[np.int8]

FIRST_ROOM = 1024
# FIT for a wall, which does not yield, over that of the node
WALL_FIT = 4.0
# share of the shaft within which the clamp at its root makes contacts no stiffer: there, gaps of
# nanometres would switch forces that Newton then hunts for, and a feather that flies has no clamp
NEAR_ROOT = 0.4
# depth, as a share of the feather's length, beyond which a point counts as on the other side of
# something else; how much farther barbs' tips are apart than rows, as a share of the barbs' length
DEEPEST, FAN = 0.1, 0.3


class Skin(NamedTuple):
    """Constant surfaces of B bodies on the widest grid (grids). present: (B, n, 2 m + 1),
    which nodes a triangle has. guests: (B, n, W) points that may touch others
    (search_kernels.guest_point). exists: (B, 2, n-1, m, 2) triangles. half: (B, n, P) m,
    half thickness at the material points. columns: (B,) of each body's own grid. far: (B,) m, from
    the nearest node, of points that may still be in the vane or touch it."""

    present: Bytes
    guests: Bytes
    exists: Bytes
    half: Array
    columns: Indices
    far: Array


class Scene(NamedTuple):
    """B bodies in an interval. start: (B, n, P, 3) m, its begin; ahead: where they will be about
    its end. boxes: (B, n, 6) and bounds: (B, 6) m, around both. impedance: (B, n, P) N/m. way: (B,)
    m, farthest that a node goes."""

    start: Array
    ahead: Array
    boxes: Array
    bounds: Array
    impedance: Array
    way: Array


class Memory(NamedTuple):
    """What is kept between intervals. key: (K,) ascending, pair, row and guest's column of K
    contacts of feathers, as one number; force: (K, 2) N, on guest and host; side: (K,) of the host.
    wall: (B, n, W) N, forces of walls. inside: (B, n, W), guests grown into one."""

    key: Indices
    force: Array
    side: Bytes
    wall: Array
    inside: Bytes


def no_memory(skin: Skin) -> Memory:
    """Nothing touched yet."""
    return Memory(
        key=np.zeros(0, dtype=np.int64),
        force=np.zeros((0, 2)),
        side=np.zeros(0, dtype=np.int8),
        wall=np.zeros(skin.guests.shape),
        inside=np.zeros(skin.guests.shape, dtype=np.int8),
    )


def remembered(touch: Touch, count: int, order: Indices, skin: Skin, memory: Memory) -> Memory:
    """What the next search needs of the contacts found: forces, and sides that no order tells."""
    who, value = touch.who[:count], touch.value[:count]
    wall = np.zeros_like(memory.wall)
    on_wall = who[:, HOST] < 0
    body, row, column = who[on_wall][:, [GUEST, ROW, COLUMN]].T
    wall[body, row, column] = value[on_wall, GUEST_FORCE]
    who, forces = who[~on_wall], value[~on_wall][:, [GUEST_FORCE, HOST_FORCE]]
    kept = (forces > 0.0).any(axis=1) | (order[who[:, PAIR]] == 0)
    _, rows, columns = skin.guests.shape
    key = (who[kept, PAIR] * rows + who[kept, ROW]) * columns + who[kept, COLUMN]
    side = who[kept, SIDE].astype(np.int8)
    return Memory(key, forces[kept], side, wall, memory.inside.copy())


class Touch(NamedTuple):
    """Room for K contacts (list_kernels): who (K, 8), corner (K, 3, 2) row and material
    point, weight (K, 3), normal (K, 3), value (K, 9), place_start and place_now (K, 3) m, of the
    host's point; place (6,), guest and guest_ahead (3,) are scratch."""

    who: Indices
    corner: Indices
    weight: Array
    normal: Array
    value: Array
    place_start: Array
    place_now: Array
    place: Indices
    guest: Array
    guest_ahead: Array


def grids_of_models(models: Sequence[Model]) -> Grids:
    """The grids of some batches."""
    return grids_of(
        [model.feathers for model in models],
        [model.rows for model in models],
        [model.columns for model in models],
    )


def skin_of(models: Sequence[Model], grids: Grids, halves: Sequence[float] | Array) -> Skin:
    """Surfaces of all feathers of some batches. halves: m, half thickness of each body's vane."""
    bodies, rows, m = grids.bodies, grids.most_rows, grids.most_columns
    exists = np.zeros((bodies, 2, rows - 1, m, 2), dtype=bool)
    for model, low, high in zip(models, grids.first[:-1], grids.first[1:], strict=True):
        cells = model.cell_stiffness[..., 0] != 0.0
        exists[low:high, :, : cells.shape[2], : cells.shape[3]] = cells
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
    half = np.broadcast_to(np.asarray(halves)[:, None, None], (bodies, rows, 3 + 2 * m))
    columns = grids.own_columns()
    guests = _guests(present, columns)
    far = np.concatenate([_far(model) for model in models])
    return Skin(present, guests, exists.astype(np.int8), np.array(half, dtype=float), columns, far)


def _far(model: Model) -> Array:
    """(F,) m, Skin.far: the deepest that a point is brought back from, and half a cell's size."""
    row, length = model.length.max(axis=1), model.length.sum(axis=1)
    segment = model.segment.max(axis=(1, 2), initial=0.0)
    return DEEPEST * length + row + segment + FAN * model.columns * segment


def scene_of(start: Array, ahead: Array, impedance: Array) -> Scene:
    """A scene (B, n, P, 3) whose boxes are yet to be fitted."""
    bodies, rows = start.shape[:2]
    away = np.linalg.norm(without_directors(ahead - start), axis=3)
    return Scene(
        start=start,
        ahead=ahead,
        boxes=np.zeros((bodies, rows, 6)),
        bounds=np.zeros((bodies, 6)),
        impedance=impedance,
        way=away.max(axis=(1, 2)),
    )


def _guests(present: Bytes, columns: Indices) -> Bytes:
    """(B, n, W): all nodes, and points of the rims between rows that both have one."""
    parts, middle, each = [], present.shape[2] // 2, np.arange(len(present))
    for way in (-1, 1):
        end = present[each, :, middle + way * columns]
        rim = np.zeros(present.shape[:2], dtype=np.int8)
        rim[:, :-1] = end[:, :-1] & end[:, 1:]
        parts.append(np.repeat(rim[:, :, None], RIM_PARTS - 1, axis=2))
    return np.concatenate([present, *parts], axis=2)


def elastic_stiffness(model: Model) -> Array:
    """(F, n, P) N/m, how stiff a feather is at its nodes, apart from inertia.

    Between that of a single force, 3 B / s^3 on a barb at s from its root, and that of a force on
    all nodes of the barb, 8 B / (L^3 m): their geometric mean; shaft and barb in series. Of the
    shaft, 3 B / s^3 from NEAR_ROOT of its length on, and as there before.
    """
    m, count = model.columns, model.coefficients
    station = np.cumsum(model.length, axis=1)
    bending = (model.rachis_stiffness[:, :, 4:] * model.length[:, :, None]).min(axis=2)
    shaft = np.full(model.mass.shape[:2], np.inf)
    near = np.maximum(station, NEAR_ROOT * station[:, -1:])
    shaft[:, 1:] = 3.0 * bending[:, :1] / near**3
    shaft[:, 0] = shaft[:, 1]
    stiffness = np.repeat(shaft[:, :, None], 3 + 2 * m, axis=2)
    if m and count:
        length = model.segment * m
        root = model.barb_stiffness[..., 0] / np.where(length > 0.0, length, np.inf) ** 2
        nodes = np.arange(1, m + 1)
        barb = np.sqrt(24.0 * m**2 / nodes**3) * root[..., None]
        for side in range(2):
            part = stiffness[:, :, 3 + side * m : 3 + (side + 1) * m]
            soft = barb[:, side]
            with np.errstate(divide="ignore"):
                part[...] = 1.0 / (1.0 / part + 1.0 / soft)
    return np.where(np.isfinite(stiffness), stiffness, 0.0)


class Found(NamedTuple):
    """Contacts found last, so many of a Touch."""

    touch: Touch
    number: int


def list_contacts(
    pairs: Indices,
    order: Indices,
    skin: Skin,
    scene: Scene,
    memory: Memory,
    margin: float,
    recovery: float,
    walls: Sequence[Wall] = (),
    before: Found | None = None,
    stale: NDArray[np.bool_] | None = None,
    room: Touch | None = None,
) -> Found:
    """Contacts of pairs (N, 2), guest and host; boxes of the scene are refitted.

    order, margin as in ContactSolver. recovery: m, that a depth is reduced by. before: contacts
    that hold on for pairs of bodies that are not stale (B,). room: to be written over; not before.
    """
    before = before or Found(new_touch(1), 0)
    anew = np.ones(len(skin.far), dtype=np.int8) if stale is None else stale.astype(np.int8)
    touch = room or new_touch()
    _refit(scene, skin)
    limits = np.array([margin, recovery, WALL_FIT])
    while True:
        count = int(
            find_contacts(
                pairs, order, skin, scene, memory, limits, before.touch, before.number, anew, touch
            )
        )
        for wall in walls:
            if count <= len(touch.who):
                count = int(find_wall_contacts(wall, skin, scene, memory, limits, touch, count))
        if count <= len(touch.who):
            return Found(touch, count)
        touch = new_touch(2 * count)


def new_touch(count: int = FIRST_ROOM) -> Touch:
    """Room for that many contacts."""
    return Touch(
        who=np.zeros((count, INTEGERS), dtype=np.int64),
        corner=np.zeros((count, 3, 2), dtype=np.int64),
        weight=np.zeros((count, 3)),
        normal=np.zeros((count, 3)),
        value=np.zeros((count, VALUES)),
        place_start=np.zeros((count, 3)),
        place_now=np.zeros((count, 3)),
        place=np.zeros(6, dtype=np.int64),
        guest=np.zeros(3),
        guest_ahead=np.zeros(3),
    )


def new_planes(bodies: int, count: int = FIRST_ROOM) -> Contacts:
    """Room for that many plane contacts of some bodies."""
    return no_contacts(bodies)._replace(
        node=np.zeros((count, 2), dtype=np.int64),
        normal=np.zeros((count, 3)),
        offset=np.zeros((count, 2)),
        target=np.zeros((count, 2, 3)),
        strength=np.zeros((count, 4)),
    )


def _refit(scene: Scene, skin: Skin) -> None:
    """Boxes around each body's rows at both ends of the interval."""
    boxes, bounds = np.zeros_like(scene.boxes), np.zeros_like(scene.bounds)
    for body in range(len(scene.start)):
        row_boxes(scene.start[body], skin.present[body], boxes[body], bounds[body])
        row_boxes(scene.ahead[body], skin.present[body], scene.boxes[body], scene.bounds[body])
    for mine, other in ((scene.boxes, boxes), (scene.bounds, bounds)):
        np.minimum(mine[..., :3], other[..., :3], out=mine[..., :3])
        np.maximum(mine[..., 3:], other[..., 3:], out=mine[..., 3:])
