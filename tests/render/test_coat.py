"""How coats of small feathers take light, and shadows that are finer than pixels."""

from __future__ import annotations

import numpy as np
import pytest

from featherfx.algebra.vectors import unit
from featherfx.render.geometry import geometry_of, joined
from featherfx.render.light_kernels import VANE
from featherfx.render.strips import _PLACES, coat_fractions, coat_normals, mixed

pytest.importorskip("embreex", reason="no wheel for this platform")


def shingles(count, tilt, facing=1.0, height=0.0):
    """Corners and triangles of count squared feathers of 20 mm, each twice as long as their
    distance, their sides lifted in turns."""
    corner = np.array([(0.0, -5.0), (20.0, -5.0), (20.0, 5.0), (0.0, 5.0)]) * 1e-3
    points, triangles = [], []
    for k in range(count * count):
        roll = tilt * (-1) ** k
        z = np.full(4, height) + np.tan(roll) * corner[:, 1]
        shift = np.array([10e-3 * (k // count), 5e-3 * (k % count), 0.0])
        points.append(np.column_stack([corner, z]) + shift)
        quad = np.array([(0, 1, 2), (0, 2, 3)]) + 4 * k
        triangles.append(quad if facing > 0.0 else quad[:, ::-1])
    return np.concatenate(points), np.concatenate(triangles)


def test_neighbours_are_lit_alike_and_what_looks_elsewhere_is_not_among_them():
    above, first = shingles(8, np.radians(25))
    below, second = shingles(8, np.radians(25), facing=-1.0, height=-2e-3)
    triangles = np.concatenate([first, second + len(above)])
    owner = np.repeat(np.arange(128), 2)
    heights = np.tile([0.7, 0.3], 128)
    found = coat_normals(np.concatenate([above, below]), triangles, owner, heights)
    assert found.shape == (128, _PLACES, 3)
    there = found[:, 1:3]
    assert np.degrees(np.arccos(there[:64, ..., 2])).max() < 15.0
    assert np.degrees(np.arccos(-there[64:, ..., 2])).max() < 15.0
    # ends without a triangle's middle
    assert not found[:, [0, 3]].any()


def test_feathers_that_are_large_in_the_picture_keep_their_shape():
    fractions = coat_fractions(np.array([10.0, 100.0, 200.0, 4000.0]))
    assert (np.diff(fractions) <= 0.0).all()
    assert fractions[1] > 0.5
    assert fractions[-1] < 0.05
    own, coat = np.zeros((2, 1, 1, 3)), np.zeros((2, 1, 1, 3))
    own[..., 0], coat[..., 2] = 1.0, 1.0
    between = mixed(own, coat, np.array([0.0, 0.5]))
    assert between[0] == pytest.approx(own[0])
    assert between[1, 0, 0] == pytest.approx(unit(np.array([1.0, 0.0, 1.0])))


@pytest.mark.parametrize(("pixels", "seen"), [(2.0, False), (30.0, True)])
def test_a_vane_close_above_another_casts_no_shadow_finer_than_pixels(pixels, seen):
    from featherfx.render.camera import framing
    from featherfx.render.tracer import Tracer

    size = (160, 120)
    pixel = 0.1 / size[1]
    corner = np.array([(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)])
    sheets = []
    for half, height in ((0.05, 0.0), (0.012, pixels * pixel)):
        points = np.column_stack([half * corner, np.full(4, height)])
        up = np.tile([0.0, 0.0, 1.0], (4, 1))
        triangles = np.array([(0, 1, 2), (0, 2, 3)])
        sheets.append(geometry_of(points, triangles, VANE, up, np.full(3, 0.3)))
    eye = framing(np.array([1.0, 0.0, 0.0]), np.array([0.0, 1.0, 0.0]), sheets[0].points, size)
    drawer = Tracer(joined(sheets), eye, 16, False)
    tops = range(0, size[1], 16)
    for top in tops:
        drawer.trace(top)
    shown = np.concatenate([drawer.rows(top) for top in tops])
    inside = shown[12:-12, 32:-32].sum(axis=2).astype(float)
    assert (inside.min() < 0.85 * np.median(inside)) == seen
