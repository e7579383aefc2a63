"""Four numbers at a time give what each of them gives."""

from math import ceil, sqrt

import numpy as np

from featherfx.algebra.vector_kernels import arctan2, cosine, cross
from featherfx.algebra.views import (
    chosen,
    follow,
    increase,
    lane,
    load,
    put,
    spread,
    totals,
    transposed,
    where_there,
)
from featherfx.jit.compiled import kernel

A, B = np.random.default_rng(3).uniform(0.5, 2.0, (2, 16))


@kernel
def _calculated(a, b, out):
    for j in range(0, 16, 4):
        x, y = load(a, j), load(b, j)
        put(out[0], j, (x + 2.0 * y - y / x) * -x)
        put(out[1], j, sqrt(x) + max(x, y) - 1.0 / max(y, 1.0))
        put(out[2], j, spread(lane(x, 2)))
        put(out[3], j, chosen(x, y, ceil(x), min(y, 1.0)))


def test_they_calculate_as_numbers_do():
    out = np.zeros((4, 16))
    _calculated(A, B, out)
    np.testing.assert_allclose(out[0], -(A + 2.0 * B - B / A) * A, rtol=1e-14)
    np.testing.assert_allclose(
        out[1], np.sqrt(A) + np.maximum(A, B) - 1.0 / np.maximum(B, 1.0), rtol=1e-14
    )
    np.testing.assert_array_equal(out[2], np.repeat(A[2::4], 4))
    np.testing.assert_array_equal(out[3], np.where(A > B, np.ceil(A), np.minimum(B, 1.0)))


@kernel
def _crossed(a, b, out):
    x, y, z = cross(
        (load(a[0], 0), load(a[1], 0), load(a[2], 0)), (load(b[0], 0), load(b[1], 0), load(b[2], 0))
    )
    put(out[0], 0, x)
    put(out[1], 0, y)
    put(out[2], 0, z)


def test_vectors_of_them_are_vectors():
    a, b, out = A[:12].reshape(3, 4), B[:12].reshape(3, 4), np.zeros((3, 4))
    _crossed(a, b, out)
    np.testing.assert_allclose(out, np.cross(a, b, axis=0), atol=1e-14)


@kernel
def _moved(a, weight, out):
    w, x, y, z = load(a, 0), load(a, 4), load(a, 8), load(a, 12)
    for k, line in enumerate(transposed(w, x, y, z)):
        put(out[k], 0, line)
    put(out[4], 0, totals(w, x, y, z))
    put(out[5], 0, follow(w, x))
    put(out[6], 0, where_there(load(weight, 0), w))
    increase(out[7], 2, 1.5)
    increase(out[7], 2, 1.5)


def test_they_are_summed_and_moved():
    out, lines, weight = np.zeros((8, 4)), A.copy().reshape(4, 4), np.array([1.0, 0.0, -2.0, 0.0])
    lines[0, 3] = np.nan  # which a weight of zero hides
    _moved(lines.reshape(16), weight, out)
    np.testing.assert_array_equal(out[:4], lines.T)
    np.testing.assert_allclose(out[4, 1:], lines[1:].sum(1), rtol=1e-15)
    np.testing.assert_array_equal(out[5], lines.reshape(16)[3:7])
    np.testing.assert_array_equal(out[6], [lines[0, 0], 0.0, lines[0, 2], 0.0])
    np.testing.assert_array_equal(out[7], [0.0, 0.0, 3.0, 0.0])


@kernel
def _angles(y, x, out):
    for j in range(0, y.shape[0], 4):
        put(out, j, arctan2(load(y, j), load(x, j)))


def test_angles_are_right_all_around():
    turn = np.pi * np.linspace(-1.0, 1.0, 4002)[1:-1]
    size = np.random.default_rng(4).uniform(-9.0, 9.0, turn.size)
    y, x, out = 10.0**size * np.sin(turn), 10.0**size * np.cos(turn), np.zeros(turn.size)
    _angles(y, x, out)
    np.testing.assert_allclose(out, np.arctan2(y, x), rtol=1e-15, atol=1e-300)
    mirrored = np.zeros(turn.size)
    _angles(-y, x, mirrored)
    np.testing.assert_array_equal(mirrored, -out)


@kernel
def _cosines(angles, out):
    for j in range(angles.size):
        out[j] = cosine(angles[j])


def test_cosines_are_those_of_the_library():
    multiples = np.pi * np.linspace(-6.0, 6.0, 25)
    angles = np.concatenate([np.random.default_rng(5).uniform(-1e4, 1e4, 5000), multiples])
    out = np.zeros(len(angles))
    _cosines(angles, out)
    slack = 4e-16 + 2.5e-16 * np.abs(angles)
    assert (np.abs(out - np.cos(angles)) < slack).all()
    lost = np.array([np.nan, np.inf, -np.inf])
    _cosines(lost, out)
    assert np.isnan(out[:3]).all()
