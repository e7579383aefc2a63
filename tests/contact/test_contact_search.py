"""The search for contacts: pairs that are left out, and the work of several threads."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from contact_cases import THICKNESS, free_feathers
from scipy.spatial.transform import Rotation

from featherfx.solver.contact.list_kernels import colour_island, colour_some
from featherfx.solver.contact.run import Marks, islands_before, no_colours
from featherfx.solver.contact.search import Searcher, neighbours
from featherfx.solver.contact.search_kernels import guest_place
from featherfx.solver.contact.surfaces import (
    WALL_FIT,
    grids_of,
    moving_bodies,
    no_memory,
    shapes_of,
    surfaces_of,
    wall_of,
)
from featherfx.solver.contact.types import Candidates, SearchSettings

FEATHERS, MARGIN = 8, 6.0 * THICKNESS
# what a search finds; the rest of a contact is measured later
TOLD = ("pair", "row", "column", "side", "corner", "weight", "start_gap", "thickness", "spared")


def turned(points, turn, rng):
    """A pose (n, 1 + 2 m, 3) turned by up to `turn` rad about its middle, around any axis."""
    axis = rng.normal(size=3)
    x, y, z = axis / np.linalg.norm(axis) * turn * rng.uniform(-1.0, 1.0)
    middle = points.mean(axis=(0, 1))
    return middle + (points - middle) @ (np.eye(3) + np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]]))


class Scene:
    """Feathers in a loose stack that drift, turn and bend; every pair in both roles."""

    def __init__(self, seed, size=(0.01, 0.01, 0.006)):
        self.rng = np.random.default_rng(seed)
        places = self.rng.uniform(-1.0, 1.0, (FEATHERS, 3)) * size
        model, state = free_feathers("body_contour", places, rows=7, columns=3)
        grids = grids_of([model])
        self.surfaces = surfaces_of(shapes_of([model]), grids, [0.5 * THICKNESS] * FEATHERS)
        self.points = grids.together([state.points.nodes])
        self.margins = np.full(FEATHERS, MARGIN)
        pairs = np.array([(a, b) for a in range(FEATHERS) for b in range(FEATHERS) if a != b])
        self.above = np.where(places[pairs[:, 0], 2] > places[pairs[:, 1], 2], 1, -1)
        chosen = self.rng.random(len(pairs)) < 0.9
        self.candidates = Candidates(pairs, np.where(chosen, self.above, 0), np.zeros(len(pairs)))

    def searches(self, count, drift=3e-4, turn=0.02):
        """Poses one after the other, each feather with a speed of its own; some stay."""
        speed = self.rng.normal(size=(FEATHERS, 1, 1, 3)) * drift
        speed[: FEATHERS // 4] = 0.0
        for _ in range(count):
            start = self.points
            ahead = start + speed * self.rng.uniform(-0.3, 1.0)
            for body in range(FEATHERS // 4, FEATHERS):
                ahead[body] = turned(ahead[body], turn, self.rng)
                ahead[body, :, :, 2] += 2e-5 * self.rng.normal(size=ahead.shape[1:3])
            bodies = moving_bodies(start, ahead, np.ones(start.shape[:3]))
            memory = no_memory(self.surfaces)
            yield SearchSettings(
                self.surfaces, bodies, memory, self.margins, MARGIN, 1e-4, WALL_FIT
            )
            # what was tried is not always where they go
            self.points = ahead if self.rng.random() < 0.7 else start


def assert_same(first, second):
    assert first.number == second.number
    for name in TOLD:
        assert np.array_equal(first.contacts[name], second.contacts[name]), name


@pytest.mark.parametrize("seed", range(6))
def test_what_is_left_out_is_no_contact(seed):
    scene = Scene(seed)
    if seed % 2:
        scene.margins *= np.linspace(0.3, 1.0, FEATHERS)
    kept, most, left_out, pairs = Searcher(scene.candidates, scene.surfaces), 0, 0, set()
    for search in scene.searches(40):
        anew = Searcher(scene.candidates, scene.surfaces)
        # vanes so thick that no point is above what it may meet
        anew._clearance.half[:] = 1.0
        found = kept.find(search)
        assert_same(found, anew.find(search))
        most = max(most, found.number)
        pairs.add(len(np.unique(found.contacts["pair"])))
        left_out += anew.looked_at - kept.looked_at
    # the scene is one: contacts come and go, and some pairs were not looked at
    assert most > 20
    assert len(pairs) > 3
    assert left_out > 0


def test_feathers_that_go_together_stay_left_out():
    """A bird that walks: what cannot touch moves far, but not past each other."""
    scene = Scene(4)
    kept = Searcher(scene.candidates, scene.surfaces)
    for search in scene.searches(12, drift=0.0, turn=0.0):
        kept.find(search)
    assert kept.looked_at < 0.9 * len(scene.candidates.pairs)
    for _ in range(3):
        scene.points = scene.points @ Rotation.random(rng=scene.rng).as_matrix() + 0.05
        bodies = moving_bodies(scene.points, scene.points, np.ones(scene.points.shape[:3]))
        before, search = kept.looked_at, search._replace(bodies=bodies)
        found = kept.find(search)
        assert kept.looked_at <= before
        assert_same(found, Searcher(scene.candidates, scene.surfaces).find(search))


def test_a_jump_is_seen():
    scene = Scene(3)
    kept = Searcher(scene.candidates, scene.surfaces)
    for search in scene.searches(20):
        kept.find(search)
    for way in (0.004, -0.004):
        scene.points[0, :, :, 2] += way
        (search,) = scene.searches(1)
        assert_same(kept.find(search), Searcher(scene.candidates, scene.surfaces).find(search))


@pytest.mark.parametrize("seed", range(3))
def test_what_pressed_in_a_search_of_a_step_is_found_in_the_next(seed):
    """Feathers that come from afar and are pressed apart again: without the contact they would be
    led to where they met first, and poses would alternate as long as a step is searched."""
    scene = Scene(seed, (1e-3, 1e-3, 1e-4))
    candidates = scene.candidates._replace(order=scene.above)
    rank = np.argsort(np.argsort(scene.points[:, 0, 0, 2]))
    (met,) = scene.searches(1, drift=0.0, turn=0.0)
    up = MARGIN * rank[:, None, None, None] * np.array((0.0, 0.0, 1.0))
    ones = np.ones(met.bodies.ahead.shape[:3])

    def search(lift, memory, again):
        bodies = moving_bodies(met.bodies.ahead + 4.0 * up, met.bodies.ahead + lift * up, ones)
        return met._replace(bodies=bodies, memory=memory, again=again)

    found = Searcher(candidates, scene.surfaces).find(search(0.0, met.memory, False))
    found.contacts["guest_force"] = found.contacts["host_force"] = 1.0
    memory = found.remembered(candidates.order, met.memory)
    alone = Searcher(candidates, scene.surfaces).find(search(3.0, memory, False))
    again = Searcher(candidates, scene.surfaces).find(search(3.0, memory, True))
    assert found.number > 100
    # but for steep places at the hosts' ends
    assert alone.number < 0.05 * found.number
    # but for what is beside the host now
    assert again.number > 0.5 * found.number
    pairs = (len(np.unique(each.contacts["pair"])) for each in (again, found))
    assert next(pairs) > 0.9 * next(pairs)


def flat_vane():
    """Nodes (n, 1 + 2 m, 3) m of the vanes of flat_pair where they lie in each other."""
    return free_feathers("body_contour", np.zeros((1, 3)), rows=7, columns=3)[1].points.nodes[0]


def tilted(degrees):
    """By how much (m) each of them moves as the vane turns about its middle."""
    flat, tilt = flat_vane(), Rotation.from_euler("x", degrees, degrees=True)
    middle = flat.mean(axis=(0, 1))
    return middle + (flat - middle) @ tilt.as_matrix() - flat


def flat_pair(order, start, ahead, recovery=1e-6, above=False):
    """Contacts of a vane that is moved off a flat host by start and ahead (m) with that host.

    above: whether all its points were above the host before."""
    model, state = free_feathers("body_contour", np.zeros((2, 3)), rows=7, columns=3)
    grids = grids_of([model])
    surfaces = surfaces_of(shapes_of([model]), grids, [0.5 * THICKNESS] * 2)
    candidates = Candidates(np.array([(0, 1)]), np.array([order]), np.zeros(1))
    poses = [grids.together([state.points.nodes]) for _ in range(2)]
    poses[0][0] += start
    poses[1][0] += ahead
    known = no_memory(surfaces)
    if above:
        key, side = np.arange(known.wall[0].size), np.ones(known.wall[0].size, dtype=np.int8)
        known = known._replace(key=key, force=np.zeros((len(key), 2)), side=side)
    bodies = moving_bodies(*poses, np.ones(poses[0].shape[:3]))
    margins = np.full(2, MARGIN)
    search = SearchSettings(surfaces, bodies, known, margins, MARGIN, recovery, WALL_FIT, True)
    return Searcher(candidates, surfaces).find(search).contacts


def test_where_vanes_cross_no_depth_has_to_be_taken_back():
    """A vane through another: points on either side of where they cross are nearer to it than both
    are thick, and what would bring one out presses its neighbour in."""
    found = {}
    for name, move in (("within", np.array([0.0, 0.0, 0.6 * THICKNESS])), ("across", tilted(2.0))):
        contacts, points = flat_pair(1, move, move, recovery=1.0), flat_vane() + move
        x = np.stack([guest_place(points, c["row"], c["point"], c["fraction"]) for c in contacts])
        away = x - contacts["place_start"]
        height = np.sign(away[:, 2]) * np.linalg.norm(away, axis=1)
        found[name] = contacts, contacts["thickness"] - contacts["side"] * height
    contacts, depth = found["within"]
    assert set(contacts["side"]) == {1}
    # the vanes are curved
    assert np.all(np.abs(depth / THICKNESS - 0.45) < 0.1)
    # of what is in another all but a twentieth of the thickness, as ever
    assert contacts["spared"].max() < 0.06 * THICKNESS
    contacts, depth = found["across"]
    assert set(contacts["side"]) == {-1, 1}
    # nearest to the middle of a triangle, so that the way there is the height
    deep = (depth > 0.1 * THICKNESS) & (contacts["weight"].min(axis=1) > 1e-3)
    assert deep.sum() > 4
    assert np.allclose(contacts["spared"][deep], depth[deep], rtol=0.02)


def test_what_comes_around_a_rim_without_an_order_keeps_no_side():
    below = np.array([0.0, 0.0, -10.0 * THICKNESS])
    beside = below + np.array([0.0, 0.05, 0.0])
    pressed = flat_pair(0, below, below, above=True)
    assert len(pressed) >= 20
    assert pressed["spared"].min() > 8.0 * THICKNESS
    around = flat_pair(0, beside, below, above=True)
    assert len(around) < 0.5 * len(pressed)
    assert around["spared"].max() < THICKNESS


def test_what_comes_from_beside_to_where_rims_cross_begins_with_no_depth():
    contacts = flat_pair(1, tilted(6.0) + np.array([0.0, 2e-3, 0.0]), tilted(6.0))
    assert set(contacts["side"]) == {-1, 1}
    # below planes that it was beside
    assert contacts["thickness"].min() < -2.0 * THICKNESS
    assert contacts["spared"].max() < THICKNESS


def test_threads_change_no_contact(monkeypatch):
    monkeypatch.setattr("featherfx.solver.contact.search._MIN_POINTS", 500)
    scene = Scene(1)

    with ThreadPoolExecutor(3) as pool:

        def for_each(function, numbers):
            list(pool.map(function, numbers))

        one = Searcher(scene.candidates, scene.surfaces)
        three = Searcher(scene.candidates, scene.surfaces, 3, for_each)
        found = None
        for search in scene.searches(6):
            first, second = one.find(search), three.find(search)
            assert_same(first, second)
            # again, only for some bodies
            stale = scene.rng.random(FEATHERS) < 0.4
            assert_same(one.find(search, (), first, stale), three.find(search, (), second, stale))
            found = second
    assert found is not None
    assert found.number > 20


def test_the_order_of_work_changes_nothing_of_what_has_grown_into_walls():
    """Two floors, the second beneath all: what has grown into the first stays so, whichever is
    looked at first and last."""
    scene = Scene(1)
    corners = np.array([[-1.0, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]])
    halves = np.array([[0, 1, 2], [0, 2, 3]])
    walls = [
        wall_of(corners + z, corners + z, halves, 0.1, True) for z in ((0, 0, 0), (0, 0, -0.05))
    ]

    def backwards(function, numbers):
        for number in reversed(list(numbers)):
            function(number)

    (search,) = scene.searches(1)
    inside = []
    for for_each, known in ((None, walls[:1]), (None, walls), (backwards, walls)):
        search.memory.inside[:] = 0
        Searcher(scene.candidates, scene.surfaces, 2, for_each).find(search, known)
        inside.append(search.memory.inside.copy())
    assert 20 < np.count_nonzero(inside[0]) < np.count_nonzero(scene.surfaces.guests)
    assert np.array_equal(inside[0], inside[1])
    assert np.array_equal(inside[0], inside[2])


def test_bodies_that_touch_differ_in_colour():
    rng = np.random.default_rng(5)
    pairs = rng.integers(0, 40, (90, 2))
    pairs = pairs[pairs[:, 0] != pairs[:, 1]]
    active = rng.random(41) < 0.8
    colours, marks = no_colours(41), in_one_island(active)
    near, islands = neighbours(pairs, 41), islands_before(1, marks.island, 1)
    colour_some(near, marks, islands, colours)
    colour, alone = colours.colour, no_colours(41)
    assert colour_island(0, near, marks, islands, alone) == colours.number[0]
    assert (alone.colour == colour).all()
    assert (colour[~active] == -1).all()
    both = active[pairs].all(axis=1)
    assert (colour[pairs[both, 0]] != colour[pairs[both, 1]]).all()
    # the first that is free
    for body in np.flatnonzero(active):
        near = np.concatenate([pairs[pairs[:, 0] == body, 1], pairs[pairs[:, 1] == body, 0]])
        taken = set(colour[near[(near < body) & active[near]]].tolist())
        assert colour[body] == min(set(range(41)) - taken)
    # all of them by colours, each once
    count = int(colours.number[0])
    bodies, first = colours.bodies[: colours.first[count]], colours.first[: count + 1]
    assert (np.repeat(np.arange(count), np.diff(first)) == colour[bodies]).all()
    assert sorted(bodies.tolist()) == np.flatnonzero(active).tolist()


def test_threads_share_islands_that_are_large_beside_all_others():
    island = np.repeat([0, 1, 2, -1], [50, 30, 20, 3])
    assert islands_before(3, island, 1).alone.tolist() == [0, 1, 2]
    assert islands_before(3, island, 2).alone.tolist() == [1, 2]
    # of few bodies, two that are alike
    island = np.repeat([0, 1], [10, 10])
    assert islands_before(2, island, 2).alone.tolist() == [0, 1]
    assert islands_before(1, np.zeros(10, dtype=np.int64), 2).alone.tolist() == []


def in_one_island(active):
    """Marks of bodies of which some are to be solved."""
    bodies = len(active)
    return Marks(
        mine=np.ones(bodies, dtype=np.int8),
        island=np.zeros(bodies, dtype=np.int64),
        fresh=np.zeros(bodies, dtype=np.int8),
        active=active.astype(np.int8),
        moves=np.zeros(bodies),
        way=np.zeros(bodies),
        moved=np.ones(bodies, dtype=np.int8),
        worst=np.zeros(bodies),
        open_by=np.zeros(bodies),
        depth=np.zeros(bodies),
        solves=np.zeros(bodies, dtype=np.int64),
        status=np.zeros(bodies),
        fixed=np.zeros(bodies, dtype=np.int8),
    )
