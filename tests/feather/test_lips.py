"""Lips of a vane that may split: they coincide while it is whole, and follow their barbs."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from featherfx.algebra.vectors import from_rotation_vector
from featherfx.feather.build import build_feather
from featherfx.feather.splits import SplitEdges, difference_rates
from featherfx.feather.types import RowPoints, both, turned
from featherfx.lab.feather import feather_kind

KIND = feather_kind("swan_primary")
OPEN = replace(KIND, vane_material=replace(KIND.vane_material, hooks="open"))


@pytest.fixture(params=[False, True], ids=["right", "mirrored"])
def mirrored(request):
    return request.param


@pytest.fixture
def feather(mirrored):
    return build_feather(OPEN, 11, 4, mirrored)


@pytest.fixture
def bent(feather):
    """The feather bent smoothly, rows turned with it."""
    nodes = feather.rest.nodes.copy()
    nodes[..., 2] += 1.5 * nodes[..., 0] ** 2 + 2.0 * nodes[..., 1] ** 2
    return RowPoints(nodes, feather.rest.directors)


def test_only_vanes_that_may_open_have_lips(feather):
    assert len(feather.surface.lips) > 20
    for hooks in ("closed", "slip"):
        kind = replace(KIND, vane_material=replace(KIND.vane_material, hooks=hooks))
        assert len(build_feather(kind, 11, 4).surface.lips) == 0


def test_closed_lips_are_the_same_place_in_any_pose(feather, bent, mirrored):
    """Faces are those of a vane that cannot split, to the bit."""
    whole = build_feather(KIND, 11, 4, mirrored)
    ours, theirs = feather.surface, whole.surface
    np.testing.assert_array_equal(
        ours.points(bent)[ours.triangles], theirs.points(bent)[theirs.triangles]
    )
    lip, other = ours.lips[ours.lips[:, 1] >= 0].T
    np.testing.assert_array_equal(ours.points(bent)[lip], ours.points(bent)[other])
    np.testing.assert_array_equal(ours.st[lip], ours.st[other])


def test_open_lips_at_rest_are_where_they_were(feather):
    lips = SplitEdges.from_feather(feather)
    at_rest = feather.surface.points(feather.rest)[lips.point]
    np.testing.assert_allclose(lips.positions(feather.rest), at_rest, atol=1e-15)


def test_open_lips_move_rigidly_with_their_barb_and_leave_the_next_one(feather, bent):
    lips = SplitEdges.from_feather(feather)
    turn = from_rotation_vector(np.array([0.3, -1.0, 0.7]))
    moved = turned(turn.T, bent).shifted(np.array([1.0, 2.0, 3.0]))
    expected = lips.positions(bent) @ turn.T + [1.0, 2.0, 3.0]
    np.testing.assert_allclose(lips.positions(moved), expected, atol=1e-14)
    # a row that is carried away leaves the lips of the strip beneath it where they are
    away = RowPoints(bent.nodes.copy(), bent.directors)
    away.nodes[6] += 0.01
    own = lips.row == 5
    assert own.any()
    np.testing.assert_array_equal(lips.positions(away)[own], lips.positions(bent)[own])


def test_rates_are_those_of_the_carried_points(feather, bent):
    rng = np.random.default_rng(4)
    lips = SplitEdges.from_feather(feather)
    v, a = (both(lambda part: rng.normal(size=part.shape), bent) for _ in range(2))

    def at(t):
        return lips.positions(both(lambda x, u, w: x + t * u + 0.5 * t * t * w, bent, v, a))

    velocity = (at(1e-6) - at(-1e-6)) / 2e-6
    second = (at(3e-5) - 2 * at(0.0) + at(-3e-5)) / 9e-10
    assert np.abs(velocity).max() > 1.0
    np.testing.assert_allclose(
        difference_rates(lips.positions, bent, v), velocity, rtol=1e-3, atol=1e-3
    )
    spread = np.abs(second).max()
    np.testing.assert_allclose(
        difference_rates(lips.positions, bent, v, a), second, rtol=1e-2, atol=1e-2 * spread
    )


def test_lips_part_where_all_triangles_that_meet_in_them_are_open(feather):
    lips, hooked = SplitEdges.from_feather(feather), np.ones(feather.cell.shape)
    assert not lips.open(hooked).any()
    hooked[0, 5, 2:] = 0.0  # from the third cell of a leading barb to its end
    parted = lips.open(hooked)
    node = feather.surface.node[lips.point[parted]]
    np.testing.assert_array_equal(np.sort(node), [3, 4])
    assert (lips.row[parted] == 5).all()
    hooked[0, 5, 3, 1] = 0.5  # hooks that are weak still hold
    np.testing.assert_array_equal(feather.surface.node[lips.point[lips.open(hooked)]], [])
