"""A feather on bodies whose motion is given: weight, friction, speed, what is inside."""

from __future__ import annotations

import numpy as np
import pytest
from contact_cases import (
    GRAVITY,
    THICKNESS,
    free_feathers,
    mass_of,
    positions_of,
    run,
    solver_of,
    vane_nodes,
    velocity_of,
)

from featherfx.mechanics.model import no_loads
from featherfx.solver.contact.surfaces import wall_of
from featherfx.solver.solver import hold_roots

GRID = {"rows": 9, "columns": 4}
FLOOR = np.array([[-9.0, -9, 0], [9, -9, 0], [9, 9, 0], [-9, 9, 0]])
HALVES = np.array([[0, 1, 2], [0, 2, 3]])


def floor(shift=(0.0, 0.0, 0.0)):
    return wall_of(FLOOR, FLOOR + shift, HALVES, 0.02 + abs(shift[2]))


@pytest.mark.verification
def test_a_feather_comes_to_rest_on_the_floor_with_its_weight():
    """The forces' sum is the weight, no gap is off by the tolerance, no step is repeated."""
    model, state = free_feathers("body_contour", [[0, 0, 0.017]], **GRID)
    contact, late = solver_of(model, rounds=20), []
    loads = [no_loads(1, (0.0, 0.0, -GRAVITY))]
    for _ in range(320):
        (state,), (report,), contacts = contact.interval(
            [state], loads, [hold_roots(state)], 4e-3, [floor()]
        )
        contact.accept()
        assert contacts.depth < contact.settings.tolerance + THICKNESS * 0.1
        late.append((report.failed[0], contact.found.contacts["guest_force"].sum()))
    failed, forces = np.array(late).T
    assert failed.sum() == 0.0
    assert forces[-60:] == pytest.approx(mass_of(model) * GRAVITY, rel=2e-3)
    assert np.abs(velocity_of(model, state)).max() < 1e-5


@pytest.mark.verification
@pytest.mark.parametrize(("friction", "degrees"), [(0.3, 30.0), (0.3, 14.0)])
def test_on_an_incline_it_slides_if_the_slope_is_steeper_than_the_friction(friction, degrees):
    """Coulomb: it slides where tan(slope) > mu, with the acceleration g (sin - mu cos)."""
    slope = np.radians(degrees)
    gravity = GRAVITY * np.array([np.sin(slope), 0.0, -np.cos(slope)])
    model, state = free_feathers("body_contour", [[0, 0, 0.006]], **GRID)
    contact = solver_of(model, friction=friction, smoothing=1e-3, rounds=20)
    step, count = 2e-3, 260
    speeds = [
        velocity_of(model, new)[0]
        for new, _ in run(contact, state, step, count, gravity, [floor()])
    ]
    # the mean over the last third, after the landing and the rocking on the shaft's bare base
    landed = 2 * count // 3
    gained = (speeds[-1] - speeds[landed]) / (step * (count - 1 - landed))
    if np.tan(slope) > friction:
        expected = GRAVITY * (np.sin(slope) - friction * np.cos(slope))
        assert gained == pytest.approx(expected, rel=0.02)
    else:
        # it creeps within the slip speed over which friction sets in
        assert abs(speeds[-1]) < contact.settings.smoothing
        assert abs(gained) < 1e-3 * GRAVITY


@pytest.mark.parametrize("speed", [1.0, 50.0])
def test_a_wall_that_strikes_drives_the_feather_before_it(speed):
    """However far the wall goes in a step, no node is behind it afterwards."""
    model, state = free_feathers("body_contour", [[0, 0, 0.02]], **GRID)
    contact, step = solver_of(model, rounds=30), 1e-3
    height = 0.0
    for _ in range(40):
        shift = np.array([0.0, 0.0, speed * step])
        start = FLOOR + np.array([0.0, 0.0, height])
        wall = wall_of(start, start + shift, HALVES, 0.02 + 3.0 * speed * step)
        ((state, _),) = run(contact, state, step, 1, walls=[wall])
        height += speed * step
        # the middle surface of the vane stays half a thickness before the wall
        assert vane_nodes(contact, state)[:, 2].min() > height
    assert height > 0.02
    # it leaves at the wall's speed or faster
    assert velocity_of(model, state)[2] > 0.8 * speed


def test_a_feather_slides_off_a_ball_without_entering_it():
    import trimesh

    radius, centre = 0.03, np.array([0.02, 0.004, -0.035])
    ball = trimesh.creation.icosphere(subdivisions=3, radius=radius)
    points = np.asarray(ball.vertices) + centre
    model, state = free_feathers("body_contour", [[0, 0, 0]], **GRID)
    contact = solver_of(model, rounds=20, friction=0.1)
    wall = wall_of(points, points, np.asarray(ball.faces, dtype=np.int64), 0.02)
    touched = 0
    for _state, report in run(contact, state, 2e-3, 80, (0, 0, -GRAVITY), [wall]):
        touched = max(touched, report.contacts)
        away = np.linalg.norm(vane_nodes(contact, _state) - centre, axis=1)
        # facets lie inside the sphere by 1 - cos of half the angle of an edge
        inner = np.linalg.norm(ball.triangles_center, axis=1).min()
        assert away.min() > inner
    assert touched >= 2


def test_what_is_inside_a_body_at_first_is_left_alone_until_it_comes_out():
    model, state = free_feathers("body_contour", [[0, 0, 0.0]], **GRID)
    nodes = positions_of(state)[0][:, 2]
    level = float(np.median(nodes))
    contact = solver_of(model)
    raised = FLOOR + np.array([0.0, 0.0, level])
    wall = wall_of(raised, raised, HALVES, 0.05, True)
    ((after, _),) = run(contact, state, 1e-3, 1, walls=[wall])
    assert contact.memory.inside.sum() > 5
    found = contact.found.contacts
    assert len(found) > 0  # those just above the wall do touch it
    assert not contact.memory.inside[0, found["row"], found["column"]].any()
    assert np.abs(after.velocity.nodes).max() < 1.0
    # the wall is taken away and comes back below: the nodes count again
    gone = wall_of(FLOOR - 1.0, FLOOR - 1.0, HALVES, 0.05)
    list(run(contact, after, 1e-3, 1, walls=[gone]))
    assert contact.memory.inside.sum() == 0


@pytest.mark.parametrize("winding", [1, -1])
@pytest.mark.parametrize("below", [False, True])
def test_a_sheet_holds_a_feather_on_the_side_where_it_came(winding, below):
    """Neither the winding nor which side it is changes what a sheet in the way does."""
    side = -1.0 if below else 1.0
    model, state = free_feathers("body_contour", [[0, 0, 0.02 * side]], **GRID)
    contact, step, speed = solver_of(model, rounds=30), 1e-3, 2.0
    height = 0.0
    for _ in range(30):
        start = FLOOR + np.array([0.0, 0.0, height])
        end = start + np.array([0.0, 0.0, side * speed * step])
        wall = wall_of(start, end, HALVES[:, ::winding], 0.03, is_open=True)
        ((state, _),) = run(contact, state, step, 1, walls=[wall])
        height += side * speed * step
        assert (side * (vane_nodes(contact, state)[:, 2] - height)).min() > 0.0
    assert side * velocity_of(model, state)[2] > 0.8 * speed


def test_a_feather_that_goes_round_the_rim_of_a_sheet_is_on_its_other_side():
    model, state = free_feathers("body_contour", [[0, 0, 0.01]], **GRID)
    contact = solver_of(model)
    beside = np.array([-9.5, 0.0, 0.0])
    for shift in ([0, 0, 0], beside, beside + np.array([0, 0, 0.03]), [0, 0, 0.03]):
        wall = wall_of(FLOOR + shift, FLOOR + shift, HALVES, 0.1, is_open=True)
        ((after, _),) = run(contact, state, 1e-3, 1, walls=[wall])
        # the feather is never taken along
        assert np.abs(after.velocity.nodes).max() < 1e-3
