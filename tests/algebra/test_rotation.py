"""Arrays of rotations have the bits of scipy's, which is loaded only for what is no rotation."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from featherfx.algebra.vectors import (
    frames_to_quats,
    quats_to_frames,
    rotation_vectors,
    vectors_to_frames,
)


def quats_of(frames):
    return np.roll(Rotation.from_matrix(frames).as_quat(), 1, axis=-1)


def test_rotations_have_the_bits_of_scipys():
    random = np.random.default_rng(1)
    sizes = random.choice([0.0, 1e-6, 1e-3, 1.0, 2.0, 9.0], size=(5000, 1))
    vectors = random.normal(size=(5000, 3)) * sizes
    frames = vectors_to_frames(vectors)
    assert np.array_equal(frames, Rotation.from_rotvec(vectors).as_matrix())
    half_turns = 2.0 * np.eye(3)[:, :, None] * np.eye(3)[:, None] - np.eye(3)
    for some in (frames, half_turns):
        assert np.array_equal(frames_to_quats(some), quats_of(some))
        assert np.array_equal(rotation_vectors(some), Rotation.from_matrix(some).as_rotvec())
    quats = random.normal(size=(5000, 4))
    turned = Rotation.from_quat(np.roll(quats, -1, axis=-1)).as_matrix()
    assert np.array_equal(quats_to_frames(quats), turned)


def test_what_is_no_rotation_is_made_one_or_refused():
    drifted = vectors_to_frames(np.array([[0.3, 0.2, 0.1]])) * 1.001
    assert np.array_equal(frames_to_quats(drifted), quats_of(drifted))
    with pytest.raises(ValueError, match="determinant"):
        frames_to_quats(-np.eye(3)[None])
    with pytest.raises(ValueError, match="length 0"):
        quats_to_frames(np.zeros((1, 4)))
