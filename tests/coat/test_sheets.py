"""Sheets of fans, sewn to skins: closed, around all feathers, and carried by the skin."""

import numpy as np
import pytest

from featherfx.algebra.vectors import from_rotation_vector
from featherfx.coat import sheets
from featherfx.coat.sheets import BearingPoints, raise_onto, sew_fan
from featherfx.errors import InputWarning

LENGTH = 0.15


def ball(rings=40, around=48, radii=(0.06, 0.025, 0.03)):
    """Return points and triangles of an ellipsoid whose poles are along x."""
    polar = np.linspace(0.0, np.pi, rings + 1)[1:-1]
    turn = np.linspace(0.0, 2.0 * np.pi, around, endpoint=False)
    body = np.stack(
        np.broadcast_arrays(
            np.cos(polar)[:, None],
            *(np.sin(polar)[:, None] * each for each in (np.cos(turn), np.sin(turn))),
        ),
        axis=-1,
    ).reshape(-1, 3)
    points = np.concatenate([body, [[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0]]]) * radii
    number = np.arange(len(body)).reshape(rings - 1, around)
    after = np.roll(number, -1, axis=1)
    quads = number[:-1], number[1:], after[1:], after[:-1]
    a, b, c, d = (each.ravel() for each in quads)
    front = np.stack([np.full(around, len(body)), number[0], after[0]], axis=1)
    rear = np.stack([np.full(around, len(body) + 1), after[-1], number[-1]], axis=1)
    return points, np.concatenate([front, np.stack([a, b, c], 1), np.stack([a, c, d], 1), rear])


def fan(count=6, spread=20.0, droop=0.0):
    """Return rachises (K, n, 3) of a fan that points to -x, and points of their vanes."""
    angles = np.radians(np.linspace(-spread, spread, count))
    way = LENGTH * np.linspace(0.0, 1.0, 15)
    nodes = np.stack(
        [
            -0.05 - np.outer(np.cos(angles), way),
            np.outer(np.sin(angles), way),
            np.zeros((count, 15)),
        ],
        axis=-1,
    )
    nodes[..., 2] -= droop * way**2 + 0.0005 * np.abs(np.arange(count) - count / 2)[:, None]
    aside = np.array([0.0, 0.01, 0.0])
    return nodes, np.concatenate([nodes + aside, nodes, nodes - aside]).reshape(-1, 3)


def volume(points, faces):
    return np.linalg.det(points[faces]).sum() / 6.0


@pytest.mark.parametrize("turn", [(0.0, 0.0, 0.0), (0.3, -1.0, 2.0)])
@pytest.mark.parametrize(("spread", "droop"), [(4.0, 0.0), (20.0, 1.0), (50.0, -0.5)])
def test_a_sheet_closes_the_skin_around_its_feathers(turn, spread, droop):
    points, faces = ball()
    nodes, vanes = fan(spread=spread, droop=droop)
    turned = from_rotation_vector(np.array(turn))
    sewn, found = sew_fan(points @ turned.T, faces, nodes @ turned.T, vanes @ turned.T)
    edges = np.concatenate([found[:, [k, (k + 1) % 3]] for k in range(3)])
    assert len(np.unique(edges, axis=0)) == len(edges)
    back = {tuple(each) for each in edges[:, ::-1].tolist()}
    assert back == {tuple(each) for each in edges.tolist()}
    assert len(np.unique(found)) == len(sewn)
    assert volume(sewn, found) > volume(points, faces) > 0.0
    # around each vane the sheet turns once: the winding number
    corners = sewn[found][None] - (vanes @ turned.T)[::7, None, None]
    size = np.linalg.norm(corners, axis=3)
    a, b, c = np.moveaxis(corners, 2, 0)
    below = size.prod(axis=2)
    for first, second, third in ((a, b, 2), (b, c, 0), (c, a, 1)):
        below = below + (first * second).sum(axis=2) * size[:, :, third]
    winding = np.arctan2(np.linalg.det(corners), below).sum(axis=1) / (2.0 * np.pi)
    assert (winding > 0.99).all()


def test_a_skin_that_no_loop_cuts_stays_as_it_is():
    points, faces = ball()
    nodes, vanes = fan()
    far = np.array([-1.0, 0.0, 0.0])
    same, still = sew_fan(points, faces, nodes + far, vanes + far)
    assert same is points
    assert still is faces


NONE, FLOW = np.zeros((0, 3)), np.array([1.0, 0.0, 0.0])


def plate_over(points, height):
    """Which points a square plate covers, and points of it."""
    x, y = np.meshgrid(*[np.linspace(-0.02, 0.02, 33)] * 2)
    above = np.stack([x, y, np.full_like(x, height)], axis=-1).reshape(-1, 3)
    return np.abs(points[:, :2]).max(axis=1) < 0.021, above


def square(across=0.0):
    """A sheet of 20 cm, V-shaped across a valley by a slope."""
    x, y = (each.ravel() for each in np.meshgrid(*[np.linspace(-0.1, 0.1, 41)] * 2, indexing="ij"))
    corner = (np.arange(40)[:, None] * 41 + np.arange(40)).ravel()
    cells = corner[:, None] + np.array([[0, 41, 42], [0, 42, 1]]).reshape(1, -1)
    return np.stack([x, y, across * np.abs(y)], axis=1), cells.reshape(-1, 3)


def test_a_skin_rises_to_feathers_over_it_as_a_ramp():
    """A plane rises over a plate 1 cm high, by less than 1 to 1 around it, and elsewhere stays, as
    it does under what is hidden."""
    points, faces = square()
    x, y = points[:, :2].T
    plate, above = plate_over(points, 0.01)
    hidden = (np.abs(y) < 0.03) & (x > 0.027)
    raised = raise_onto(points, faces, BearingPoints(above, NONE, NONE), FLOW)
    rise = raised[:, 2]
    np.testing.assert_allclose(raised[:, :2], points[:, :2], atol=1e-12)
    assert 0.0095 < rise[plate].min() < rise.max() < 0.0115  # m
    assert np.abs(rise[(np.abs(x) > 0.095) | (np.abs(y) > 0.045)]).max() < 5e-4
    assert np.abs(np.diff(rise.reshape(41, 41), axis=0)).max() < 0.005
    beside = points[hidden] + (0.0, 0.0, 0.008)
    under = raise_onto(points, faces, BearingPoints(above, beside, beside), FLOW)[:, 2]
    assert under[hidden].max() < 0.3 * rise[hidden].max()
    assert under[plate].min() > 0.009
    shown = raise_onto(points, faces, BearingPoints(above, beside, NONE), FLOW)[:, 2]
    assert shown[hidden].min() > 0.0075


def test_a_skin_that_finds_no_rest_under_feathers_is_told(monkeypatch):
    monkeypatch.setattr(sheets, "_MAX_ROUNDS", 1)
    points, faces = square()
    _, above = plate_over(points, 0.01)
    with pytest.warns(InputWarning, match="found no rest in 1 rounds"):
        raise_onto(points, faces, BearingPoints(above, NONE, NONE), FLOW)


def test_a_skin_that_rises_over_a_crease_does_not_fold():
    """Normals of a valley meet below a plate that is high over it."""
    points, faces = square(across=0.6)
    _, above = plate_over(points, 0.03)
    raised = raise_onto(points, faces, BearingPoints(above, NONE, NONE), FLOW)
    a, b, c = raised[faces].transpose(1, 0, 2)
    assert np.cross(b - a, c - a)[:, 2].min() > 0.0
    assert raised[:, 2][np.abs(points[:, :2]).max(axis=1) < 0.015].min() > 0.026
