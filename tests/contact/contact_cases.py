"""Feathers on walls and on each other, and measures that share no line with the solver."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from trial_batches import preset_batch

from featherfx.algebra.types import Array
from featherfx.mechanics.barb_kernels import node_index
from featherfx.mechanics.model import Model, no_loads
from featherfx.solver.contact.interval import ContactSolver
from featherfx.solver.contact.types import (
    Candidates,
    ContactReport,
    ContactSettings,
    IntervalOptions,
    Wall,
)
from featherfx.solver.solver import Settings, Solver, hold_roots
from featherfx.solver.state import State, rest_state

THICKNESS = 1.2e-4
GRAVITY = 9.81


def free_feathers(name: str, positions: Any, **grid: int) -> tuple[Model, State]:
    """Feathers of a preset that fly, in their rest pose, unturned."""
    positions = np.asarray(positions, dtype=float)
    _, model = preset_batch(name, count=len(positions), **grid)
    model.held[:] = False
    return model, rest_state(model, positions, np.tile(np.eye(3), (len(positions), 1, 1)))


def solver_of(model: Model, pairs: Any = (), order: Any = (), **settings: Any) -> ContactSolver:
    solver = Solver(model, Settings(max_substeps=1, newton=1e-10))
    pairs = np.asarray(pairs, dtype=np.int64).reshape(-1, 2)
    return ContactSolver(
        [solver],
        Candidates(pairs, np.asarray(order, dtype=np.int64), np.zeros(len(pairs))),
        [0.5 * THICKNESS] * model.feathers,
        ContactSettings(**settings),
    )


def run(
    contact: ContactSolver,
    state: State,
    step: float,
    count: int,
    gravity: Sequence[float] = (0.0, 0.0, 0.0),
    walls: Sequence[Wall] = (),
    shortest: float = np.inf,
    turns: bool = True,
) -> Iterator[tuple[State, ContactReport]]:
    """The states after each of `count` steps (s). One that cannot be solved, or leaves contacts off
    by more than half a thickness, is taken in halves, as a shot does, where these are no shorter
    than the shortest. turns: as Manner's, from the second step on."""
    loads = [no_loads(len(state.rotation), (gravity[0], gravity[1], gravity[2]))]

    def advance(state: State, step: float) -> tuple[State, ContactReport]:
        (new,), (report,), contacts = contact.interval(
            [state], loads, [hold_roots(state)], step, walls, manner
        )
        failed, far = report.status.any(), contacts.residual > 0.5 * THICKNESS
        if failed or (far and 0.5 * step >= shortest):
            assert 0.5 * step >= shortest
            return advance(advance(state, 0.5 * step)[0], 0.5 * step)
        contact.accept()
        return new, contacts

    manner = IntervalOptions()
    for _ in range(count):
        state, contacts = advance(state, step)
        manner = IntervalOptions(turns=turns)
        yield state, contacts


def positions_of(state: State) -> Array:
    """(F, k, 3) nodes."""
    return state.points.nodes.reshape(len(state.rotation), -1, 3)


def momentum(model: Model, state: State) -> Array:
    """(3,) N s."""
    return np.einsum("fnp,fnpk->k", model.mass, state.velocity.nodes)


def mass_of(model: Model) -> float:
    """kg, of all feathers."""
    return float(model.mass.sum())


def velocity_of(model: Model, state: State) -> Array:
    """(3,) m/s, of the centre of mass."""
    return momentum(model, state) / mass_of(model)


def crossings(first: tuple[Array, Array], second: tuple[Array, Array]) -> int:
    """How many edges of one surface (points (V, 3), triangles (T, 3)) pierce the other's triangles.

    Each edge is cut with each triangle's plane; the cut is looked up in barycentric coordinates.
    """
    points, triangles = first
    edges = np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]])
    edges = np.unique(np.sort(edges), axis=0)
    start, end = points[edges[:, 0]], points[edges[:, 1]]
    a, b, c = (second[0][second[1][:, k]] for k in range(3))
    normal = np.cross(b - a, c - a)
    height = start @ normal.T - np.einsum("tk,tk->t", a, normal)
    rise = (end - start) @ normal.T
    share = -height / np.where(rise == 0.0, 1e-300, rise)
    e, t = np.nonzero((share > 0.0) & (share < 1.0))
    cut = start[e] + share[e, t, None] * (end - start)[e] - a[t]
    size = np.einsum("tk,tk->t", normal, normal)[t]
    v = np.einsum("ik,ik->i", np.cross(cut, (c - a)[t]), normal[t]) / size
    w = np.einsum("ik,ik->i", np.cross((b - a)[t], cut), normal[t]) / size
    return int(np.count_nonzero((v >= 0.0) & (w >= 0.0) & (v + w <= 1.0)))


def surfaces(model: Model, state: State) -> list[tuple[Array, NDArray[np.int64]]]:
    """(points, triangles) of the vanes of a batch, from the model's cells."""
    m, found = model.columns, []
    for f in range(model.feathers):
        points = state.points.nodes[f]
        triangles = []
        for side, i, j, half in np.argwhere(model.cell_stiffness[f, ..., 0] != 0.0):
            near, far = node_index(side, j, m), node_index(side, j + 1, m)
            corners = [(i, near), (i, far), (i + 1, near)]
            if half == 1:
                corners = [(i, far), (i + 1, far), (i + 1, near)]
            triangles.append([row * points.shape[1] + p for row, p in corners])
        found.append((points.reshape(-1, 3), np.array(triangles)))
    return found


def vane_nodes(contact: ContactSolver, state: State, f: int = 0) -> Array:
    """(k, 3) nodes of a feather that a triangle has; the calamus has none."""
    present = contact.surfaces.present[f]
    m = present.shape[1] // 2
    points = [*range(2 * m, m, -1), *range(1 + m)]
    return state.points.nodes[f][:, points][present != 0]


def share_above(guest: Array, host: tuple[Array, NDArray[np.int64]]) -> float:
    """Share of nodes (k, 3) that are on the upper side of a surface, of those that are over it.

    By the nearest of 21 points of every triangle and its normal; all are turned up at rest.
    """
    from scipy.spatial import cKDTree

    points, triangles = host
    a, b, c = (points[triangles[:, k]] for k in range(3))
    shares = np.array([(i, j, 5 - i - j) for i in range(6) for j in range(6 - i)]) / 5.0
    samples = np.einsum("sk,ktx->tsx", shares, np.stack([a, b, c]))
    normal = np.cross(b - a, c - a)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    _, found = cKDTree(samples.reshape(-1, 3)).query(guest)
    away = guest - samples.reshape(-1, 3)[found]
    height = np.einsum("ik,ik->i", away, normal[found // len(shares)])
    over = np.abs(height) > 0.7 * np.linalg.norm(away, axis=1)
    return float((height[over] > 0.0).mean())


def turned_up(surface: tuple[Array, NDArray[np.int64]]) -> NDArray[np.int64]:
    """Triangles (T, 3) of a surface, each so that its normal has a positive z."""
    points, triangles = surface
    a, b, c = (points[triangles[:, k]] for k in range(3))
    down = np.cross(b - a, c - a)[:, 2] < 0.0
    return np.where(down[:, None], triangles[:, ::-1], triangles)
