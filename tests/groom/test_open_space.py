"""Room above a skin: balls that touch it from outside."""

import numpy as np
import pytest
import trimesh

from featherfx.groom.skin.points import room_above

MOST = 1.0


def sphere(radius):
    mesh = trimesh.creation.icosphere(4, radius=radius)
    points = np.array(mesh.vertices)
    return points, points / radius


def test_outside_a_sphere_there_is_all_room():
    points, normals = sphere(0.1)
    assert room_above(points, normals, MOST) == pytest.approx(MOST)


def test_within_a_sphere_the_room_is_its_radius():
    points, normals = sphere(0.1)
    assert room_above(points, -normals, MOST) == pytest.approx(0.1, rel=1e-3)


def test_between_two_planes_it_is_half_their_distance():
    grid = np.stack(np.meshgrid(*[np.linspace(-0.1, 0.1, 81)] * 2), axis=-1).reshape(-1, 2)
    points = np.concatenate([np.column_stack([grid, np.full(len(grid), z)]) for z in (0.0, 0.02)])
    normals = np.zeros_like(points)
    normals[:, 2] = np.where(points[:, 2] == 0.0, 1.0, -1.0)
    room = room_above(points, normals, MOST)
    inner = np.abs(points[:, :2]).max(axis=1) < 0.05
    assert room[inner] == pytest.approx(0.01, rel=1e-6)


def test_in_the_corner_of_two_planes():
    # floor z = 0 and wall x = 0: a ball that touches the floor at x has the radius x
    steps = np.arange(0.0, 0.06, 0.002)
    a, b = (each.ravel() for each in np.meshgrid(steps, np.arange(-0.03, 0.03, 0.002)))
    floor, wall = np.column_stack([a, b, 0 * a]), np.column_stack([0 * a, b, a])
    points = np.concatenate([floor, wall[a > 0]])
    normals = np.zeros_like(points)
    normals[: len(floor), 2], normals[len(floor) :, 0] = 1.0, 1.0
    room = room_above(points, normals, MOST)
    near = (np.abs(b) < 0.002) & (a > 0.009) & (a < 0.025)
    assert room[: len(floor)][near] == pytest.approx(a[near], rel=0.01)


def test_no_normal_no_room():
    points, normals = sphere(0.1)
    normals[0] = 0.0
    assert room_above(points, normals, MOST)[0] == 0.0
