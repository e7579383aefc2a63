"""How far from its solution a step may be where a frame must end."""

import pytest

from featherfx.solver.solver import COARSE, UNSOLVED, Settings, step_settings
from featherfx.solver.step.retry_kernels import allowed_now, given_up

LENGTH, WORK = 0.1, 400


def test_the_less_work_is_left_the_farther_a_step_may_be_from_its_solution():
    settings = step_settings(Settings(max_iterations=WORK), 1.0, LENGTH)
    near, far = COARSE * LENGTH, UNSOLVED * LENGTH
    for left, expected in ((400, 0.0), (200, 0.0), (199, near), (100, near), (99, far), (1, far)):
        assert allowed_now(settings, left) == pytest.approx(expected)


def test_where_no_shorter_step_is_solved_more_is_allowed_until_all_is():
    settings = step_settings(Settings(max_iterations=WORK), 1.0, LENGTH)
    left, allowed = WORK, []
    while left > 0:
        allowed.append(allowed_now(settings, left))
        left = given_up(settings, left)
    assert allowed == pytest.approx([0.0, COARSE * LENGTH, UNSOLVED * LENGTH])


def test_feathers_that_touch_stop_instead():
    settings = step_settings(Settings(max_iterations=WORK), 1.0, LENGTH)._replace(unsolved=0.0)
    assert all(allowed_now(settings, left) == 0.0 for left in range(WORK + 1))
    assert all(given_up(settings, left) == 0 for left in range(WORK + 1))
