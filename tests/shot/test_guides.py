"""Guided feathers: who guides whom, and that deformation is carried without stretch or drift."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from places import SAMPLES
from shingled import in_line

from featherfx.errors import InputError
from featherfx.feather.build import build_feather
from featherfx.feather.types import stacked
from featherfx.groom.types import Placement
from featherfx.shot.detail.guided import Followers, Shapes
from featherfx.shot.detail.guides import guide_weights, make_skin_graph, root_distances
from featherfx.shot.loop.simulate import simulate
from featherfx.shot.patterns import Detail
from featherfx.shot.read.read import read_shot
from featherfx.shot.types import Motion, Shot


def row_of(count: int, frames: int = 5, spread: float = 0.02) -> Shot:
    """Like feathers side by side whose roots swing together."""
    shot = in_line(count, np.array([0.0, spread, 0.0]), frames, rows=13, tolerance=1e-4)
    return replace(shot, gravity=np.array([0.0, 0.0, -9.81]))


def guided(shot: Shot, pattern: str = "*", **values: object) -> Shot:
    return replace(
        shot, details=(*shot.details, Detail(feathers=pattern, level="guided", **values))
    )


def test_a_follower_of_a_like_guide_with_like_motion_is_that_guide() -> None:
    shot = row_of(3)
    simulation = simulate(guided(shot, every=3))
    frames, full = list(simulation), list(simulate(shot))
    levels = [each.level for each in simulation.options]
    assert levels == ["guided", "full", "guided"]
    assert simulation.report["skipped"]["guided feather frames"] == 2 * len(frames)
    bent = np.abs(full[-1].rows[0] - full[0].rows[0] - np.ptp(full[-1].rows[0])).max()
    assert bent > 1e-3
    for frame, other in zip(frames, full, strict=True):
        assert frame.rows[1].tobytes() == other.rows[1].tobytes()
        for f in (0, 2):
            assert frame.rows[f] == pytest.approx(other.rows[f], abs=1e-6)
            # the root's rate is that of a polynomial through the frame
            speed = np.abs(other.row_velocities[f]).max() + 1e-9
            assert (
                np.abs(frame.row_velocities[f] - other.row_velocities[f]).max()
                < 3e-3 * speed + 1e-6
            )


def test_switched_off_nothing_changes() -> None:
    shot = row_of(3, 2)
    same = guided(shot, every=1)
    for frame, other in zip(simulate(same), simulate(shot), strict=True):
        for one, two in zip(frame.rows, other.rows, strict=True):
            assert one.tobytes() == two.tobytes()


def deformed(feathers, rng, size=0.3):
    """Feathers bent at random by their own chains."""
    shapes = Shapes(feathers, [False] * len(feathers))
    turns = shapes.turns(stacked([feather.rest for feather in feathers]))
    assert np.abs(turns.along).max() < 1e-7
    assert np.abs(turns.barbs).max() < 1e-7
    rows = turns.along.shape[1]
    along = rng.normal(0.0, size / rows, turns.along.shape)
    barbs = rng.normal(0.0, 0.2 * size, turns.barbs.shape)
    barbs[:, :, feathers[0].barb_length[0] == 0.0] = 0.0
    return shapes, shapes.posed(type(turns)(along, barbs))


def kinds() -> list[Placement]:
    return list(read_shot(SAMPLES / "swan_wing" / "shot.toml").groom.feathers)


def test_lengths_are_kept_whatever_the_weights() -> None:
    from scipy import sparse

    placements = kinds()
    guides = [build_feather(placements[k].kind, 11, 4) for k in (0, 3, 7)]
    own = [build_feather(placements[k].kind, 11, 4) for k in (2, 9)]
    shapes, points = deformed(guides, np.random.default_rng(3), 4.0)
    weights = sparse.csr_array(np.array([[0.2, 0.5, 0.3], [0.7, 0.3, 0.0]]))
    followed = Followers(Shapes(own, [False, False]), shapes, weights).points(points)
    for f, feather in enumerate(own):
        found, rest_nodes = followed.nodes[f], feather.rest.nodes
        for part in (np.s_[:, 0], np.s_[:, 1:5], np.s_[:, 5:9]):
            axis = 0 if part == np.s_[:, 0] else 1
            lengths, rest = (
                np.linalg.norm(np.diff(each[part], axis=axis), axis=-1)
                for each in (found, rest_nodes)
            )
            assert lengths == pytest.approx(rest, abs=1e-12)
        first, second = followed.directors[f].swapaxes(0, 1)
        assert np.einsum("nk,nk->n", first, second) == pytest.approx(0.0, abs=1e-12)
        assert np.abs(found - rest_nodes).max() > 0.01


def test_a_pose_comes_back_from_its_turns() -> None:
    feathers = [build_feather(kinds()[k].kind, 9, 3) for k in (0, 5)]
    shapes, points = deformed(feathers, np.random.default_rng(5))
    for found, part in zip(shapes.posed(shapes.turns(points)), points, strict=True):
        assert found == pytest.approx(part, abs=1e-9)


def test_a_mirrored_follower_is_the_mirror_image() -> None:
    from scipy import sparse

    kind = kinds()[0].kind
    one, other = (build_feather(kind, 9, 3, mirrored) for mirrored in (False, True))
    shapes, points = deformed([one], np.random.default_rng(7))
    single = sparse.csr_array(np.ones((1, 1)))
    found = Followers(Shapes([other], [True]), shapes, single).points(points)
    image = points.nodes * (1.0, -1.0, 1.0)
    assert found.nodes == pytest.approx(image, abs=1e-9)


def test_rigid_motion_moves_followers_rigidly() -> None:
    """Turning the whole scene turns the result: nothing is measured in the world's axes."""
    from scipy.spatial.transform import Rotation

    shot = guided(row_of(4, 3), every=4)
    turn = Rotation.from_rotvec([0.4, -0.9, 1.3]).as_matrix()
    shift = np.array([3.0, -2.0, 5.0])
    feathers = tuple(
        replace(p, position=turn @ p.position + shift, rotation=turn @ p.rotation)
        for p in shot.groom.feathers
    )
    direction = tuple(turn @ np.array([0.0, 0.0, 1.0]))
    turned = replace(
        shot,
        groom=replace(shot.groom, feathers=feathers),
        gravity=turn @ shot.gravity,
        motion=Motion("shake", shot.motion.values | {"direction": direction}),
    )
    for frame, other in zip(simulate(shot), simulate(turned), strict=True):
        for one, two in zip(frame.rows, other.rows, strict=True):
            image = one @ turn.T
            image[:, 0] += shift
            image[:, 3:] += shift
            assert two == pytest.approx(image, abs=1e-6)


def test_weights_are_normalised_compact_and_smooth() -> None:
    shot = row_of(41, spread=0.01)
    every = np.arange(41)
    guides, weights = guide_weights(shot, every, every[::5])
    dense = weights.toarray()
    assert dense.sum(axis=1) == pytest.approx(1.0)
    assert (np.count_nonzero(dense, axis=1) <= 4).all()
    assert dense[guides] == pytest.approx(np.eye(len(guides)), abs=1e-6)
    # a feather moved by a hair changes its weights by a hair
    moved = list(shot.groom.feathers)
    moved[12] = replace(moved[12], position=np.array([0.0, 0.120001, 0.0]))
    near = replace(shot, groom=replace(shot.groom, feathers=tuple(moved)))
    other = guide_weights(near, every, every[::5])[1].toarray()
    assert np.abs(other - dense).max() < 1e-3


def test_ways_go_along_the_skin() -> None:
    """Two plates face each other 1 cm apart and hang together at one edge, 1 m away."""
    x = np.linspace(0.0, 1.0, 41)
    outline = np.concatenate(
        [np.column_stack([x, np.zeros(41)]), np.column_stack([x, x * 0 + 0.01])[::-1]]
    )
    corners = []
    for (ax, az), (bx, bz) in pairwise(outline):
        for y in np.arange(4) * 0.025:
            a, b, c, d = (ax, y, az), (bx, y, bz), (bx, y + 0.025, bz), (ax, y + 0.025, az)
            corners += [(a, b, c), (a, c, d)]
    roots = np.array([(0.2, 0.05, 0.0), (0.2, 0.05, 0.01), (0.5, 0.05, 0.0)])
    source, root, way = root_distances(
        roots, np.array([0]), make_skin_graph(roots, np.array(corners)), 10.0
    )
    assert source.tolist() == [0, 0, 0]
    assert root.tolist() == [0, 1, 2]
    assert way[0] == 0.0
    assert way[1] == pytest.approx(1.61, rel=0.05)
    assert way[2] == pytest.approx(0.3, rel=0.05)
    _, straight, _ = root_distances(roots, np.array([0]), None, 0.02)
    assert straight.tolist() == [0, 1]


def test_what_cannot_be_guided_is_told() -> None:
    with pytest.raises(InputError, match="no guide for the guided feathers of region 'coat'"):
        list(simulate(guided(row_of(3), every=0)))
    simulation = simulate(
        replace(
            guided(row_of(3, 1), every=0),
            details=(Detail(level="guided", every=0), Detail(feathers="f1", level="full")),
        )
    )
    list(simulation)
    assert [each.level for each in simulation.options] == ["guided", "full", "guided"]


def test_spacing_and_lengths_choose_guides() -> None:
    shot = row_of(21, 0, spread=0.01)
    simulation = simulate(guided(shot, every=1, spacing=0.03))
    list(simulation)
    places = [k for k, each in enumerate(simulation.options) if each.level == "full"]
    assert 3 <= len(places) <= 7
    assert max(min(abs(k - g) for g in places) for k in range(21)) <= 3
    by_length = replace(shot, quality=replace(shot.quality, guided_below=2.0, guided_every=7))
    simulation = simulate(by_length)
    list(simulation)
    assert sum(each.level == "full" for each in simulation.options) == 3


@pytest.mark.parametrize("wanted", [[0, 3, 5], [1], [2, 4, 6, 7]])
def test_some_feathers_alone_are_those_of_the_whole(wanted: list[int]) -> None:
    shot = guided(row_of(8, 3), every=4)
    whole, part = simulate(shot), simulate(shot, wanted=wanted)
    for one, other in zip(whole, part, strict=True):
        for name in ("rows", "row_velocities", "row_accelerations"):
            found = getattr(other, name)
            assert len(found) == len(wanted)
            for f, values in zip(wanted, found, strict=True):
                np.testing.assert_array_equal(values, getattr(one, name)[f])
    assert len(part.feathers) == len(part.options) == len(wanted)
    # guides that nobody wanted follows are not simulated
    simulated = sum(len(group.members) for group in part._run.groups)
    assert simulated <= sum(len(group.members) for group in whole._run.groups) == 2
