"""Feathers against feathers: momentum, energy, order, speed."""

from __future__ import annotations

import numpy as np
import pytest
from contact_cases import (
    THICKNESS,
    free_feathers,
    momentum,
    run,
    share_above,
    solver_of,
    surfaces,
    turned_up,
    vane_nodes,
)
from trial_batches import at_origin, preset_batch

from featherfx.mechanics.model import no_loads
from featherfx.solver.contact.interval import ContactSolver
from featherfx.solver.contact.types import Candidates, ContactSettings, IntervalOptions
from featherfx.solver.solver import Settings, Solver
from featherfx.solver.state import RootPath, hold_roots, rest_state
from featherfx.solver.step.integrator_kernels import integrator_of

GRID = {"rows": 11, "columns": 4}
PAIR = [(0, 1), (1, 0)]
ORDERED, UNORDERED = [-1, 1], [0, 0]


def closing(speed, place=(0.02, 0.01, 0.012)):
    """Two feathers, the second above the first and coming down at a speed (m/s)."""
    model, state = free_feathers("swan_primary", [[0, 0, 0], place], **GRID)
    state.velocity.nodes[1, :, :, 2] -= speed
    return model, state


def kinetic(model, state):
    inertia = model.mass, model.rotary_inertia
    return 0.5 * sum(
        np.einsum("fnp,fnpk,fnpk->", mass, rate, rate)
        for mass, rate in zip(inertia, state.velocity, strict=True)
    )


@pytest.mark.verification
@pytest.mark.parametrize("order", [ORDERED, UNORDERED])
@pytest.mark.parametrize(("speed", "friction"), [(5.0, 0.0), (4.0, 0.3)])
def test_a_collision_in_flight_keeps_momentum_and_makes_no_energy(order, speed, friction):
    """With friction at 5 m/s, kinetic energy overshoots by half for two of these steps."""
    model, state = closing(speed, place=(0.02, 0.01, 0.001))
    contact = solver_of(model, PAIR, order, rounds=300, tolerance=1e-7, friction=friction)
    before, energy = momentum(model, state), kinetic(model, state)
    most = 0
    for _state, report in run(contact, state, 2e-4, 25):
        most = max(most, report.contacts)
        assert kinetic(model, _state) <= energy * (1.0 + 1e-6)
    assert most > 5
    change = np.linalg.norm(momentum(model, _state) - before)
    assert change < 1e-3 * np.linalg.norm(before)
    # the struck feather has taken on a part of it
    assert momentum(model, _state)[2] < 0.0
    assert _state.velocity.nodes[0, :, 0, 2].mean() < -0.2


def test_feathers_are_looked_for_where_their_roots_take_them():
    """Short feathers whose roots are moved off from rest by 4 mm in a step are solved but once."""
    model, state = free_feathers("body_contour", [[0, 0, 0], [0.01, 0, 0.004]], **GRID)
    model.held[:] = True
    way = np.linspace(0.0, 1.0, 5)[:, None] ** 2 * [0.0, 0.004, 0.0, 0.0, 0.0, 0.0]
    samples = np.zeros((2, 5, 6)) + way
    samples[:, :, :3] += state.centre[:, :1]
    path = RootPath(samples, state.rotation[:, 0].copy())
    contact = solver_of(model, PAIR, ORDERED)
    (new,), _, report = contact.interval([state], [no_loads(2)], [path], 1.0 / 48.0)
    moved = new.points.nodes[:, :, :, 1] - state.points.nodes[:, :, :, 1]
    assert moved.min() > 0.003
    assert report.solves == 2


@pytest.mark.verification
def test_the_first_accelerations_of_a_pair_belong_together():
    """In the first step of all, in which the vanes meet; with gaps that press it was 0.05 %."""
    model, state = closing(5.0, place=(0.02, 0.01, 0.001))
    contact = solver_of(model, PAIR, ORDERED, rounds=300, tolerance=1e-7, friction=0.3)
    before = momentum(model, state)
    *_, (after, report) = run(contact, state, 2e-4, 1)
    assert report.contacts > 0
    assert np.linalg.norm(momentum(model, after) - before) < 1e-4 * np.linalg.norm(before)


@pytest.mark.parametrize("order", [pytest.param(ORDERED, marks=pytest.mark.slow), UNORDERED])
def test_nothing_passes_at_fifty_metres_a_second(order):
    """One on top of the other they close by 5 mm, 40 thicknesses, in a step that is cut only where
    it cannot be solved, and do not pass.

    A few nodes of the crumpled vanes are beside a fold, where above and below mean little.
    """
    model, state = closing(50.0, place=(0.003, 0.002, 0.012))
    triangles = turned_up(surfaces(model, state)[0])
    shares = {}
    for name, pairs in (("free", ()), ("touching", PAIR)):
        contact = solver_of(model, pairs, order if pairs else (), rounds=30)
        *_, (_state, _) = run(contact, state, 1e-4, 8, shortest=1e-5)
        under = surfaces(model, _state)[0][0], triangles
        shares[name] = share_above(vane_nodes(contact, _state, 1), under)
    assert shares["free"] < 0.05
    assert shares["touching"] > 0.9
    # they share their momentum, and the vanes, which give, throw them apart again
    speeds = _state.velocity.nodes[:, :, 0, 2].mean(axis=1)
    assert speeds[0] < -15.0
    assert -50.0 / 3.0 < speeds[1] - speeds[0] < 0.5 * 50.0


def test_both_sides_of_every_contact_feel_the_same_force():
    model, state = closing(2.0, place=(0.02, 0.01, 0.001))
    contact = solver_of(model, PAIR, ORDERED, rounds=300, tolerance=1e-7)
    compared = 0
    for _, report in run(contact, state, 3e-4, 10):
        contacts = contact.found.contacts
        guest, host = contacts["guest_force"], contacts["host_force"]
        closed = np.maximum(guest, host) > 0.0
        compared += int(closed.sum())
        assert report.residual < 1e-7
        assert np.abs(guest - host).sum() <= 0.02 * guest.sum() + 1e-9
        # and where both press there is no gap
        assert np.all(np.abs(contacts["gap"][(guest > 0.0) & (host > 0.0)]) < 3e-6)
    assert compared > 20


def arrays_of(state):
    """All arrays of a state."""
    return state.arrays().values()


def test_feathers_apart_are_stepped_as_if_there_were_no_contact():
    """Bit by bit, and with one solve each."""
    model, state = closing(1.0, place=(0.02, 0.01, 0.2))
    alone = solver_of(model)
    touching = solver_of(model, PAIR, ORDERED)
    for (a, first), (b, second) in zip(
        run(alone, state, 1e-3, 5), run(touching, state, 1e-3, 5), strict=True
    ):
        assert all(map(np.array_equal, arrays_of(a), arrays_of(b)))
        assert first.solves == second.solves == 2
        assert second.contacts == 0


def test_all_batches_keep_to_the_strictest_tolerance():
    """Two feathers that swing, each a batch of its own."""
    _, model = preset_batch("swan_primary", **GRID)
    start = at_origin(model)
    start.spin[:, 1:, 1] = 20.0
    start.velocity.nodes[..., 2] = -20.0 * start.points.nodes[..., 0]
    found = {}
    for name, tolerances in (("one", (1e-3, 1e-5)), ("both", (1e-5, 1e-5)), ("none", (1e-3, 1e-3))):
        solvers = [Solver(model, Settings(each, newton=1e-8)) for each in tolerances]
        contact = ContactSolver(
            solvers,
            Candidates(np.zeros((0, 2), dtype=np.int64), np.zeros(0, dtype=np.int64), np.zeros(0)),
            [0.5 * THICKNESS] * 2,
            ContactSettings(),
        )
        states, loads, paths = [start] * 2, [no_loads(1)] * 2, [hold_roots(start)] * 2
        (first, _), reports, _ = contact.interval(
            states, loads, paths, 1.0 / 48.0, manner=IntervalOptions(substeps=1024)
        )
        found[name] = first.points.nodes, int(reports[0].steps[0])
    assert found["one"][1] == found["both"][1] > 2 * found["none"][1]
    assert np.array_equal(found["one"][0], found["both"][0])


def one_swings_onto_another():
    """Two held feathers and their solver, and the state in which one comes down on the other."""
    _, model = preset_batch("swan_primary", count=2, **GRID)
    start = rest_state(model, np.array([[0.0] * 3, [0.0, 0.0, 3e-4]]), np.stack([np.eye(3)] * 2))
    start.spin[1, 1:, 1] = 2.0
    start.velocity.nodes[1, ..., 2] = -2.0 * start.points.nodes[1, ..., 0]
    solver = Solver(model, Settings(max_substeps=1, newton=2e-7))
    touching = Candidates(np.array(PAIR), np.array(ORDERED), np.zeros(len(PAIR)))
    return ContactSolver([solver], touching, [0.5 * THICKNESS] * 2, ContactSettings()), start


def swung(prepare, count=12):
    """Nodes after so many steps, matrices and solves that they took, and most contacts; prepare: is
    called with the solver before each step."""
    contact, state = one_swings_onto_another()
    sums, most = np.zeros(2), 0
    for _ in range(count):
        prepare(contact)
        loads, paths = [no_loads(2)], [hold_roots(state)]
        (state,), (report,), touched = contact.interval([state], loads, paths, 3e-4)
        assert not report.status.any()
        contact.accept()
        sums += report.matrices.sum(), touched.solves
        most = max(most, touched.contacts)
    return state.points.nodes, *sums, most


def test_matrices_are_kept_over_rounds_and_steps_of_a_frame():
    """Beside the same with every step a frame of its own."""
    nodes, matrices, solves, most = swung(lambda contact: None)
    nodes_anew, matrices_anew, solves_anew, _ = swung(ContactSolver.begin_frame)
    assert most > 5
    assert matrices < 0.6 * matrices_anew
    assert solves <= 1.2 * solves_anew
    assert np.abs(nodes - nodes_anew).max() < 0.2 * THICKNESS


def test_what_a_thread_has_solved_before_changes_nothing():
    def used(contact):
        contact.begin_frame()
        for work in contact._team.works.tuples:
            work.closing.turns[:] = 0.5
            work.closing.stiff[:], work.closing.nodes[:] = 1.0, 1.0

    assert np.array_equal(swung(ContactSolver.begin_frame)[0], swung(used)[0])


def test_a_feather_that_slipped_through_comes_back_at_the_recovery_speed():
    """Starts 3 mm on the wrong side; the order brings it back, without a kick. Not right below
    the other: edges that leave each other together may kick (docs/contact.md)."""
    model, state = free_feathers("swan_primary", [[0, 0, 0], [2e-3, 6e-4, -0.003]], **GRID)
    contact = solver_of(model, PAIR, ORDERED, rounds=30, recovery=0.1)
    heights, step = [], 2e-3
    for new, _ in run(contact, state, step, 25):
        heights.append(float((new.points.nodes[1, :, 0, 2] - new.points.nodes[0, :, 0, 2]).mean()))
        assert np.abs(new.velocity.nodes[:, :, 0]).max() < 1.0
    # both feathers give way, and one that is pushed goes on
    rates = np.diff(heights) / step
    assert 0.05 < rates[:5].mean() < 0.3
    assert rates.max() < 0.5
    assert heights[-1] > 0.0


def test_what_comes_around_a_rim_stays_on_the_side_where_it_comes():
    """One is to lie over the other, and is thrown under it from beside it: nothing touches, and
    both move as if alone. Without that it counts as 8 mm deep, and is pulled through."""
    model, state = free_feathers("swan_primary", [[0, 0, 0], [0.03, 0.09, -0.008]], **GRID)
    state.velocity.nodes[1, :, :, 1] -= 20.0
    *_, (alone, _) = run(solver_of(model), state, 2e-4, 20)
    contact = solver_of(model, PAIR, ORDERED)
    steps = list(run(contact, state, 2e-4, 20))
    around, _ = steps[-1]
    assert max(report.depth for _, report in steps) < 2.0 * THICKNESS
    found = contact.found.contacts
    turned = found["side"] != np.array(ORDERED)[found["pair"]]
    assert turned.sum() > 10
    assert np.abs(around.points.nodes - alone.points.nodes).max() < 1e-9
    contact = solver_of(model, PAIR, ORDERED)
    assert max(report.depth for _, report in run(contact, state, 2e-4, 20, turns=False)) > 4e-3


def test_the_steps_estimate_of_inertia_is_the_integrators():
    """The rounds' stiffness relies on inertia = 2 / h^2 at radius 0."""
    assert integrator_of(0.0, 0.1).inertia == pytest.approx(2.0 / 0.1**2)


def test_what_is_off_is_told_of_the_last_round():
    """A body that its neighbours have moved since it was solved counts as it is then."""
    places = [[0.004 * f, 0.003 * f, 4e-4 * f] for f in range(5)]
    model, state = free_feathers("body_contour", places, **GRID)
    state.velocity.nodes[-1, ..., 2] = -8.0
    pairs = [[f + a, f + 1 - a] for a in (0, 1) for f in range(4)]
    contact = solver_of(model, pairs, [-1] * 4 + [1] * 4, rounds=2)
    _, _, report = contact.interval([state], [no_loads(5)], [hold_roots(state)], 3e-4)
    found = contact.found.contacts
    felt = found["guest_force"], found["host_force"]
    wrong = np.abs(np.minimum(found["gap"], np.minimum(*felt) / found["stiffness"]))
    wrong = np.maximum(wrong, np.abs(felt[0] - felt[1]) / found["stiffness"])
    assert wrong.max() > contact.settings.tolerance
    for role in ("guest", "host"):
        assert np.all(report.off[found[role]] >= (1.0 - 1e-9) * wrong)
