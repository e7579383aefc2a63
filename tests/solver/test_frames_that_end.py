"""How far from its solution a step may be where a frame must end."""

import pytest

from featherfx.solver.solver import (
    COARSE_ERROR_RATIO,
    UNSOLVED_DISTANCE_RATIO,
    Settings,
    step_settings,
)
from featherfx.solver.step.step_control_kernels import (
    EXTRAPOLATE,
    FOLLOW_ROOT,
    IMPLICIT_EULER,
    LOAD_PARTS,
    allowed_distance,
    load_parts,
    work_after_failure,
)

LENGTH, WORK = 0.1, 400


def test_the_less_work_is_left_the_farther_a_step_may_be_from_its_solution():
    settings = step_settings(Settings(max_iterations=WORK), 1.0, LENGTH)
    near, far = COARSE_ERROR_RATIO * LENGTH, UNSOLVED_DISTANCE_RATIO * LENGTH
    for left, expected in ((400, 0.0), (200, 0.0), (199, near), (100, near), (99, far), (1, far)):
        assert allowed_distance(settings, left) == pytest.approx(expected)


def test_where_no_shorter_step_is_solved_more_is_allowed_until_all_is():
    settings = step_settings(Settings(max_iterations=WORK), 1.0, LENGTH)
    left, allowed = WORK, []
    while left > 0:
        allowed.append(allowed_distance(settings, left))
        left = work_after_failure(settings, left)
    assert allowed == pytest.approx(
        [0.0, COARSE_ERROR_RATIO * LENGTH, UNSOLVED_DISTANCE_RATIO * LENGTH]
    )


def test_feathers_that_touch_stop_instead():
    settings = step_settings(Settings(max_iterations=WORK), 1.0, LENGTH)._replace(unsolved=0.0)
    assert all(allowed_distance(settings, left) == 0.0 for left in range(WORK + 1))
    assert all(work_after_failure(settings, left) == 0 for left in range(WORK + 1))


def test_a_held_feather_is_tried_in_parts_while_there_is_work_for_all_of_them():
    settings = step_settings(Settings(max_iterations=WORK), 1.0, LENGTH)
    enough = (LOAD_PARTS + 2) * settings.iterations
    assert [
        load_parts(settings, way, enough, True)
        for way in (EXTRAPOLATE, FOLLOW_ROOT, IMPLICIT_EULER)
    ] == [0, LOAD_PARTS, LOAD_PARTS]
    assert load_parts(settings, IMPLICIT_EULER, enough - 1, True) == 0
    assert load_parts(settings, IMPLICIT_EULER, enough, False) == 0
