"""Contacts that open or close while a step is solved."""

from __future__ import annotations

import numpy as np
import pytest
from trial_batches import at_origin, preset_batch

from featherfx.mechanics.model import Contacts, no_loads
from featherfx.solver.scratch import make_scratch
from featherfx.solver.solver import Settings, Solver, hold_roots
from featherfx.solver.step.active_contact_kernels import (
    add_contacts_to_matrix,
    linearise_contacts,
    switch_contacts,
)
from featherfx.solver.step.banded_kernels import factorise, solve_factored


def planes(rng, nodes, points, heights, forces):
    """Contacts of nodes (K, 2) with planes whose gaps at points (n, 1 + 2 m, 3) are heights (m)."""
    count = len(nodes)
    normal = rng.normal(size=(count, 3)) * 0.2 + [0.0, 0.0, 1.0]
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    level = np.einsum("kx,kx->k", normal, points[tuple(nodes.T)]) - heights
    strength = np.zeros((count, 4))
    strength[:, 0], strength[:, 1] = rng.uniform(2.0, 8.0, count), forces
    return Contacts(
        first=np.array([0, count]),
        node=nodes,
        normal=normal,
        offset=np.stack([level, level], axis=1),
        target=np.zeros((count, 2, 3)),
        strength=strength,
    )


def some_planes(rng, model, points, count):
    """So many, a few micrometres off; half of them pressed before."""
    rows, columns = np.arange(2, model.rows), np.arange(1, 1 + 2 * model.columns)
    nodes = np.stack([rng.choice(rows, count), rng.choice(columns, count)], axis=1)
    pressed = rng.random(count) < 0.5
    heights = rng.normal(size=count) * 2e-5
    return planes(rng, nodes, points, heights, np.where(pressed, 1e-4, 0.0))


@pytest.mark.parametrize("count", [8, 60])
def test_a_step_ends_where_contacts_press_as_they_will(count):
    """Of 0.5 d.A d + g.d + sum <P - r n.J d>^2 / (2 r), with any matrix, gradient and Jacobian."""
    rng = np.random.default_rng(count)
    _, model = preset_batch("swan_primary", rows=11, columns=4)
    work, points = make_scratch(model), at_origin(model).points.nodes[0]
    size, width = work.system.band.shape
    contacts = some_planes(rng, model, points, count)
    place = points.shape[1] // 2
    jacobian = work.jacobian.reshape(*work.jacobian.shape[:3], 3, -1)
    jacobian[..., : place + 1] = rng.normal(size=(*jacobian.shape[:4], place + 1))
    slopes, own = np.zeros((count, size)), jacobian.shape[2] - 6
    for k, (row, node) in enumerate(contacts.node):
        side = int(node > place)
        slope = np.einsum("axj,x->aj", jacobian[row, side], contacts.normal[k])
        at = row * (6 + 2 * own)
        columns = [*range(at, at + 6), *range(at + 6 + side * own, at + 6 + (side + 1) * own)]
        slopes[k, columns] = slope[:, node - side * place]
    near = np.abs(np.subtract.outer(np.arange(size), np.arange(size)))
    matrix = np.where(near < width, rng.normal(size=(size, size)), 0.0)
    matrix = 0.05 * (matrix + matrix.T) + 3.0 * np.eye(size)
    gradient, stiffness = 1e-3 * rng.normal(size=size), contacts.strength[:, 0]
    push = contacts.strength[:, 1] - stiffness * (
        np.einsum("kx,kx->k", contacts.normal, points[tuple(contacts.node.T)])
        - contacts.offset[:, 1]
    )
    on = push > 0.0
    band, right = work.system.band, work.system.right
    for j in range(size):
        band[j, : min(width, size - j)] = matrix[j : j + width, j]
    right[:] = slopes[on].T @ push[on] - gradient
    where = 0, 1.0, points
    add_contacts_to_matrix(model, contacts, *where, True, work)
    linearise_contacts(model, contacts, *where, work)
    work.closing.right[:] = right
    turned = []
    for _ in range(8):
        assert factorise(band, work.system.panel)
        solve_factored(band, right)
        turned.append(switch_contacts(model, contacts, 0, right, False, work))
        if turned[-1] == 0:
            break
        step = right.copy()
        band[:], right[:] = work.closing.band, work.closing.right
    assert turned[0] > 0
    assert turned[-1] == 0
    pressed = np.maximum(0.0, push - stiffness * (slopes @ right))
    left = matrix @ right + gradient - slopes.T @ pressed
    # where they are left a part of CLEAR from where they open
    assert np.abs(left).max() < 1e-4 * np.abs(gradient).max()
    assert np.abs(right - step).max() > 1e-7


def test_contacts_that_open_and_close_ask_for_no_new_matrix():
    """A vane between 60 planes, beside the same vane without them."""
    rng = np.random.default_rng(1)
    _, model = preset_batch("swan_primary", rows=11, columns=4)
    state, free = at_origin(model), no_loads(1, (0.0, 0.0, -9.81))
    contacts = some_planes(rng, model, state.points.nodes[0], 60)
    solver = Solver(model, Settings(tolerance=1.0, newton=1e-9, max_substeps=1))
    spent = {}
    for name, loads in (("free", free), ("pressed", free._replace(contacts=contacts))):
        _, report = solver.step(state, loads, hold_roots(state), 2e-3)
        assert report.status[0] == 0
        spent[name] = int(report.iterations[0]), int(report.matrices[0])
    assert spent["pressed"][0] <= spent["free"][0] + 2
    assert spent["pressed"][1] <= spent["free"][1]
