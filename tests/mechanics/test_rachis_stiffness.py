"""Geometric stiffness of a rachis element, by second differences, and its stable part."""

from __future__ import annotations

import numpy as np
import pytest
from trial_batches import random_quat, turned

from featherfx.mechanics.rachis_kernels import (
    rachis_geometric_stiffness,
    rachis_stabilising_stiffness,
    rachis_strain,
)

LENGTH = 0.7
KINDS = {"force": slice(0, 3), "moment": slice(3, 6), "both": slice(0, 6)}


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("angle", [0.0, 1e-9, 1e-3, 0.3, 2.0, 3.1, 5.0])
def test_it_is_the_second_derivative_of_the_strains_under_stress(kind, angle):
    rng = np.random.default_rng(round(1e3 * angle))
    first, points = random_quat(rng), rng.normal(size=(2, 3))
    axis = rng.normal(size=3)
    second = turned(first, angle * axis / np.linalg.norm(axis))
    second *= np.copysign(1.0, (first @ second) * (np.pi - angle))
    stress, strain = np.zeros(6), np.zeros(6)
    stress[KINDS[kind]] = rng.normal(size=6)[KINDS[kind]]
    halfway, lower = np.zeros((3, 3)), np.zeros((12, 12))
    rachis_strain(first, second, *points, LENGTH, halfway, strain)
    assert np.linalg.norm(strain[3:]) == pytest.approx(angle, abs=1e-6)
    rachis_geometric_stiffness(*points, LENGTH, halfway, strain, stress, lower)
    matrix = np.tril(lower) + np.tril(lower, -1).T

    def work(y):
        a, b = turned(first, y[3:6]), turned(second, y[9:12])
        a, b = np.copysign(1.0, a @ first) * a, np.copysign(1.0, b @ second) * b
        out = np.zeros(6)
        rachis_strain(a, b, points[0] + y[:3], points[1] + y[6:9], LENGTH, np.zeros((3, 3)), out)
        return stress @ out

    for _ in range(8):
        x = rng.normal(size=12)
        step = 1e-3
        expected = (work(step * x) - 2.0 * work(0.0 * x) + work(-step * x)) / step**2
        assert x @ matrix @ x == pytest.approx(expected, rel=1e-4, abs=2e-4)


@pytest.mark.parametrize("pull", [1.0, -1.0])
def test_tension_stiffens_and_compression_adds_nothing(pull):
    rng = np.random.default_rng(4)
    turn, points = random_quat(rng), rng.normal(size=(2, 3))
    halfway, strain, lower = np.zeros((3, 3)), np.zeros(6), np.zeros((12, 12))
    rachis_strain(turn, turn, *points, LENGTH, halfway, strain)
    stress = np.concatenate([pull * halfway.T @ (points[1] - points[0]), np.zeros(3)])
    rachis_stabilising_stiffness(*points, LENGTH, halfway, stress, lower)
    values = np.linalg.eigvalsh(np.tril(lower) + np.tril(lower, -1).T)
    assert values.min() > -1e-12
    assert values.max() > 0.1 if pull > 0.0 else not lower.any()
