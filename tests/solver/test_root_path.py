"""The root's path within a frame against exact motions."""

from __future__ import annotations

import numpy as np
import pytest
from trial_batches import random_quat, rotation_of

from featherfx.algebra.vectors import quats_to_frames
from featherfx.solver.state import RootPath
from featherfx.solver.step.pose_kernels import root_at

SHARES = np.linspace(0.0, 1.0, 23)


def followed(path, base):
    """Positions (S, 3) and rotations (S, 3, 3) at all shares."""
    centres, frames = [], []
    for share in SHARES:
        turn, centre = np.zeros(4), np.zeros(3)
        root_at(RootPath(path[None], base[None]), 0, share, turn, centre)
        centres.append(centre)
        frames.append(quats_to_frames(turn))
    return np.array(centres), np.array(frames)


def test_a_polynomial_motion_is_followed_exactly():
    rng = np.random.default_rng(0)
    base, factors = random_quat(rng), rng.normal(size=(5, 6))
    factors[0, 3:] = 0.0

    def at(share):
        return np.array([share**k for k in range(5)]) @ factors

    path = np.array([at(share) for share in np.linspace(0.0, 1.0, 5)])
    centres, frames = followed(path, base)
    exact = np.array([at(share) for share in SHARES])
    assert centres == pytest.approx(exact[:, :3], abs=1e-12)
    rotations = np.array([rotation_of(each[3:]) for each in exact]) @ quats_to_frames(base)
    assert frames == pytest.approx(rotations, abs=1e-12)


@pytest.mark.parametrize("turns", [0.3, 2.0, 5.0])
def test_a_steady_spin_of_several_turns_is_exact(turns):
    rng = np.random.default_rng(1)
    base, axis = random_quat(rng), np.array([0.0, 0.6, 0.8])
    path = np.zeros((5, 6))
    path[:, 3:] = np.linspace(0.0, 2.0 * np.pi * turns, 5)[:, None] * axis
    _, frames = followed(path, base)
    exact = [rotation_of(2.0 * np.pi * turns * share * axis) for share in SHARES]
    assert frames == pytest.approx(np.array(exact) @ quats_to_frames(base), abs=1e-10)


def test_a_beat_is_followed_with_the_order_of_the_samples():
    """An oscillation of 0.05 m over shares of its period: halving the frame divides the error by
    about 2^5, as a polynomial through five samples must."""
    errors = []
    for part in (0.4, 0.2, 0.1):
        path = np.zeros((5, 6))
        path[:, 2] = 0.05 * np.sin(2.0 * np.pi * (0.1 + part * np.linspace(0.0, 1.0, 5)))
        centres, _ = followed(path, np.array([1.0, 0.0, 0.0, 0.0]))
        errors.append(
            np.abs(centres[:, 2] - 0.05 * np.sin(2.0 * np.pi * (0.1 + part * SHARES))).max()
        )
    assert errors[0] < 1e-3
    assert np.log2(np.array(errors[:-1]) / errors[1:]) == pytest.approx([5.0, 5.0], abs=0.8)


def test_samples_are_met():
    rng = np.random.default_rng(2)
    path, base = rng.normal(size=(4, 6)), random_quat(rng)
    path[0, 3:] = 0.0
    for k in range(4):
        turn, centre = np.zeros(4), np.zeros(3)
        root_at(RootPath(path[None], base[None]), 0, k / 3.0, turn, centre)
        assert centre == pytest.approx(path[k, :3], abs=1e-12)
        exact = rotation_of(path[k, 3:]) @ quats_to_frames(base)
        assert quats_to_frames(turn) == pytest.approx(exact, abs=1e-12)
