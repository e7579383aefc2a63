"""What a vane's hinges and a shaft's elements do beyond all that grows: they fold over and meet
their guard, smoothly."""

from __future__ import annotations

import numpy as np
import pytest
from derivatives import derivative_fault
from drawn_cases import draw_case
from judged_cases import run_case
from trial_batches import rod

from featherfx.mechanics.guard_kernels import (
    add_turn_guard_stiffness,
    add_turn_guard_stress,
    turn_guard_total,
)
from featherfx.mechanics.vane_bending_kernels import folded

MODEL = rod(4)
REST = np.array([0.0, 0.0, 0.0, 0.1, -0.2, 0.3])
BENT = MODEL._replace(rachis_rest=MODEL.rachis_rest + REST)


def strain_of(turn):
    """Strains from rest of an element whose rows are turned by turn (3,) rad."""
    return np.array([0.0, 0.0, 0.0, *turn]) - REST


def guard(turn):
    return turn_guard_total(BENT, 0, strain_of(turn)[None])


def stress_at(turn):
    stress = np.zeros(6)
    add_turn_guard_stress(BENT, 0, 0, strain_of(turn), stress)
    return stress[3:]


def turns(angle, count=3):
    directions = np.random.default_rng(1).normal(size=(count, 3))
    return angle * directions / np.linalg.norm(directions, axis=1)[:, None]


def test_the_guard_asks_for_nothing_up_to_four_radians_and_for_all_there_is_at_a_full_turn():
    for turn in turns(3.999):
        assert guard(turn) == 0.0
        assert not stress_at(turn).any()
    stiffest = MODEL.rachis_stiffness[0, :, 3:].max()
    assert guard(turns(6.27)[0]) > 100.0 * stiffest
    assert guard(turns(2.0 * np.pi + 1e-9)[0]) == np.inf


@pytest.mark.parametrize("angle", [4.05, 5.0, 6.1])
def test_its_derivatives(angle):
    rng, slopes = np.random.default_rng(2), np.zeros((6, 12))
    slopes[3:, :3] = np.eye(3)
    for turn in turns(angle):
        assert derivative_fault(lambda x, at=turn: guard(at + x), stress_at(turn), rng, 0.05) == ""
        matrix, direction = np.zeros((12, 12)), rng.normal(size=3)
        add_turn_guard_stiffness(BENT, 0, 0, strain_of(turn), slopes, matrix)
        whole = (np.tril(matrix) + np.tril(matrix, -1).T)[:3, :3]
        assert np.linalg.eigvalsh(whole).min() > 0.0
        assert (
            derivative_fault(
                lambda x, at=turn, way=direction: way @ stress_at(at + x),
                whole @ direction,
                rng,
                0.05,
            )
            == ""
        )


def test_a_hinge_is_its_angle_up_to_two_radians_and_has_no_turns_beyond():
    for angle in (0.0, 0.3, -2.0):
        assert folded(angle) == (angle, 1.0)
    for angle in (0.3, 2.4, -3.0):
        assert folded(angle + 4.0 * np.pi) == pytest.approx(folded(angle), abs=1e-12)
    fold, slope = folded(np.pi)
    assert slope == pytest.approx(0.0, abs=1e-12)
    assert 2.0 < abs(fold) < np.pi


@pytest.mark.parametrize("angle", [1.9999, 2.3, -2.9, 11.9])
def test_the_slope_of_a_fold(angle):
    step = 1e-6
    slope = (folded(angle + step)[0] - folded(angle - step)[0]) / (2.0 * step)
    assert folded(angle)[1] == pytest.approx(slope, abs=1e-6)


@pytest.mark.parametrize("seed", [930422, 930563])
def test_feathers_that_are_wound_up_are_solved(seed):
    """Spun roots and crumpled poses, whose shafts had stuck where two rows had turned all the way
    round."""
    outcome = run_case(draw_case(seed, 14))
    assert (outcome.status, outcome.violations) == (0, [])
