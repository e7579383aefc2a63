"""What a frame hands on is looked at: one number that is not finite ends the bake by name."""

from __future__ import annotations

import numpy as np
import pytest

from featherfx.feather.types import RowPoints
from featherfx.shot.frames import FeatherPose, not_finite


def some_poses(count: int) -> list[FeatherPose]:
    values = np.random.default_rng(3).normal(size=(count, 7, 7, 3))
    points = [RowPoints(each[:, :5], each[:, 5:]) for each in values]
    return [FeatherPose(each, each, each) for each in points]


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("place", [0, 63, 64, 199])
def test_the_first_with_a_number_that_is_not_finite_is_found(bad, place):
    poses = some_poses(200)
    assert not_finite(poses) is None
    poses[place].points.directors[4, 1, 1] = bad
    assert not_finite(poses) == place
    poses[-1].points.nodes[4, 2, 1] = bad
    assert not_finite(poses) == place


def test_large_numbers_are_finite_though_their_squares_are_not():
    poses = some_poses(3)
    poses[1].points.nodes[:] = 1e200
    assert not_finite(poses) is None
    assert not_finite([]) is None
