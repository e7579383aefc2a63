"""Roots on triangles: the closest point, and frames that follow without flips."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from featherfx.groom.skin.skin import bind, bound_before, closest, follow, is_flat


def random_mesh(seed, triangles=120):
    random = np.random.default_rng(seed)
    points = random.normal(size=(90, 3))
    # sizes from tiny to large, as on a real skin
    points[:45] *= 0.02
    faces = random.integers(0, 90, (triangles, 3))
    return points, faces[~is_flat(points, faces)]


def dense(corners, steps=40):
    u, v = np.meshgrid(np.linspace(0, 1, steps + 1), np.linspace(0, 1, steps + 1))
    inside = u + v <= 1 + 1e-9
    weights = np.stack([1 - u - v, u, v], axis=-1)[inside]
    return np.einsum("wk,tkc->twc", weights, corners)


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_no_point_of_any_triangle_is_closer(seed):
    points, faces = random_mesh(seed)
    roots = 1.5 * np.random.default_rng(seed).normal(size=(30, 3))
    corners = points[faces]
    triangle, weights = closest(roots, corners)
    found = np.einsum("fk,fkc->fc", weights, corners[triangle])
    assert (weights >= 0).all()
    np.testing.assert_allclose(weights.sum(axis=1), 1.0, atol=1e-12)
    best = np.linalg.norm(dense(corners)[None] - roots[:, None, None], axis=-1).min(axis=(1, 2))
    distance = np.linalg.norm(found - roots, axis=1)
    spacing = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max() / 40
    assert (distance <= best + 1e-12).all()
    assert (distance >= best - spacing).all()


def test_the_first_of_equally_close_triangles_is_taken():
    corners = np.array([[[0, 0, 0], [1, 0, 0], [0, 1, 0]]] * 3, dtype=float)
    assert closest(np.array([[0.2, 0.2, 0.5]]), corners)[0][0] == 0


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 10_000))
def test_rigid_motion_is_followed_exactly(seed):
    points, faces = random_mesh(seed % 7)
    random = np.random.default_rng(seed)
    roots = random.normal(size=(12, 3))
    binding = bind(roots, points, faces)
    turn, shift = Rotation.random(random_state=seed).as_matrix(), random.normal(size=3)
    positions, turns = follow(binding, (points @ turn.T + shift)[faces][binding.used])
    np.testing.assert_allclose(positions, roots @ turn.T + shift, atol=1e-9)
    np.testing.assert_allclose(turns, np.broadcast_to(turn, turns.shape), atol=1e-7)


def flat_patch():
    points = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], dtype=float)
    return points, np.array([[0, 1, 2], [0, 2, 3]])


def test_stretch_moves_roots_along_but_does_not_turn_them():
    points, faces = flat_patch()
    roots = np.array([[0.7, 0.2, 0.1], [0.2, 0.8, 0.0]])
    binding = bind(roots, points, faces)
    stretch = np.diag([3.0, 0.5, 1.0])
    positions, turns = follow(binding, (points @ stretch)[faces][binding.used])
    np.testing.assert_allclose(turns, np.broadcast_to(np.eye(3), (2, 3, 3)), atol=1e-12)
    np.testing.assert_allclose(positions, [[2.1, 0.1, 0.1], [0.6, 0.4, 0.0]], atol=1e-12)


def test_shear_turns_by_the_polar_angle():
    points, faces = flat_patch()
    binding = bind(np.array([[0.7, 0.2, 0.0]]), points, faces)
    shear = np.array([[1, 0.8, 0], [0, 1, 0], [0, 0, 1.0]])
    _, turns = follow(binding, (points @ shear.T)[faces][binding.used])
    angle = -np.arctan(0.4)  # polar decomposition of simple shear: tan = half the shear
    expected = Rotation.from_rotvec([0, 0, angle]).as_matrix()
    np.testing.assert_allclose(turns[0], expected, atol=1e-12)


def test_no_flips_over_two_turns_of_a_shearing_skin():
    points, faces = flat_patch()
    binding = bind(np.array([[0.7, 0.2, 0.0], [0.3, 0.6, 0.01]]), points, faces)
    before = np.broadcast_to(np.eye(3), (2, 3, 3))
    for angle in np.linspace(0, 4 * np.pi, 200):
        shape = np.array(
            [[1 + 0.5 * np.sin(angle), 0.9 * np.sin(3 * angle), 0], [0, 1, 0], [0, 0, 1]]
        )
        turn = Rotation.from_rotvec(angle * np.array([0.6, 0.0, 0.8])).as_matrix()
        _, turns = follow(binding, (points @ shape.T @ turn.T)[faces][binding.used])
        change = Rotation.from_matrix(turns @ before.transpose(0, 2, 1)).magnitude()
        assert change.max() < 0.25
        before = turns


def test_turns_are_continuous_over_edges():
    """On a crumpled patch, where the turns of neighbouring faces are far apart."""
    x, y = (each.ravel() for each in np.meshgrid(np.linspace(0, 1, 6), np.linspace(0, 1, 6)))
    points = np.column_stack([x, y, np.zeros(36)])
    first = (np.arange(5)[:, None] * 6 + np.arange(5)).ravel()
    faces = np.concatenate(
        [np.stack([first, first + 1, first + 7], 1), np.stack([first, first + 7, first + 6], 1)]
    )
    moved = points + np.random.default_rng(5).normal(0, 0.04, (36, 3))
    along = np.linspace(0.05, 0.95, 4001)
    line = np.column_stack([along, 0.3 + 0.4 * along, np.zeros(4001)])
    for radius in (0.0, 0.15):
        binding = bind(line, points, faces, radius=np.full(4001, radius))
        _, turns = follow(binding, moved[faces][binding.used])
        steps = Rotation.from_matrix(turns[1:] @ turns[:-1].transpose(0, 2, 1)).magnitude()
        # faces differ by up to 0.9 rad at the 10 edges; a way of 1 takes 4000 steps
        assert steps.max() < 0.01


def test_parts_that_do_not_hang_together_do_not_turn_each_other():
    points, faces = flat_patch()
    over = points + np.array([0, 0, 0.05])
    both, all_faces = np.vstack([points, over]), np.vstack([faces, faces + 4])
    roots = np.array([[0.5, 0.5, 0.0], [0.5, 0.5, 0.05]])
    binding = bind(roots, both, all_faces, radius=np.full(2, 0.6))
    turn = Rotation.from_rotvec([0.3, 0, 0]).as_matrix()
    _, turns = follow(binding, np.vstack([points, over @ turn.T])[all_faces][binding.used])
    np.testing.assert_allclose(turns, [np.eye(3), turn], atol=1e-12)


def test_a_skin_that_is_mirrored_keeps_its_outside():
    points, faces = flat_patch()
    roots = np.array([[0.7, 0.2, 0.1]])
    binding = bind(roots, points, faces)
    positions, turns = follow(binding, (points * [-1, 1, 1])[faces][binding.used], True)
    np.testing.assert_allclose(positions, [[-0.7, 0.2, 0.1]], atol=1e-12)
    assert np.linalg.det(turns[0]) == pytest.approx(1.0)
    np.testing.assert_allclose(turns[0] @ [0, 0, 1], [0, 0, 1], atol=1e-12)


def test_flat_triangles_are_known_at_any_size():
    points = np.array([[0, 0, 0], [1, 0, 0], [2, 0, 0], [0, 1, 0]], dtype=float)
    faces = np.array([[0, 1, 2], [0, 1, 3], [1, 1, 1]])
    for size in (1e-6, 1.0, 1e6):
        assert is_flat(size * points, faces).tolist() == [True, False, True]


def test_what_was_bound_before_moves_as_what_is_bound_anew():
    """To the bit; and a radius, a direction or a root that is another is bound by itself."""
    points, faces = random_mesh(4)
    random = np.random.default_rng(4)
    roots, along = random.normal(size=(2, 12, 3))
    moved = points + 0.1 * random.normal(size=points.shape)
    found = []
    for shift, wide in ((0.0, 0.5), (0.0, 0.2), (0.1, 0.5)):
        how = (roots + shift, points, faces, None, np.full(12, wide), along)
        for binding in (bound_before(*how), bound_before(*how)):
            anew = bind(*how)
            assert binding.used.tolist() == anew.used.tolist()
            now = follow(binding, moved[faces][binding.used])
            for one, other in zip(now, follow(anew, moved[faces][anew.used]), strict=True):
                assert one.tobytes() == other.tobytes()
        found.append(b"".join(each.tobytes() for each in now))
    assert len(set(found)) == 3
