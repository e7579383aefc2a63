"""Areas and normals that the air presses on: those of the surface, evened out along the shaft."""

import math

import numpy as np
import pytest
from trial_batches import preset_batch

from featherfx.mechanics.air_kernels import EVEN, area_vectors, vane_areas


def areas(model, nodes):
    """Area vectors (n, 1 + 2 m, 3) of the surface, and as the air sees them."""
    local, evened = np.zeros_like(nodes), np.zeros_like(nodes)
    area_vectors(nodes, model.cell_stiffness[0], local)
    vane_areas(model, 0, nodes, evened, np.zeros_like(nodes), np.zeros(nodes.shape[:2]))
    return local, evened


def test_a_flat_vane_keeps_its_areas():
    feather, model = preset_batch("swan_primary", rows=21)
    nodes = feather.rest.nodes.copy()
    nodes[..., 2] = 0.0
    local, evened = areas(model, nodes)
    assert np.linalg.norm(local, axis=-1).sum() > 1e-3
    np.testing.assert_allclose(evened, local, atol=1e-12 * np.abs(local).max())


@pytest.mark.parametrize("waves", [0.25, 1.0, 4.0])
def test_of_the_slope_of_a_wave_so_much_is_left_as_its_length_says(waves):
    """waves: in a barb's length, along the shaft, in the middle of the vane."""
    feather, model = preset_batch("swan_primary", rows=401, columns=2)
    nodes, middle = feather.rest.nodes.copy(), 220
    barb = feather.barb_length[0, middle]
    number = 2.0 * math.pi * waves / barb
    # along barbs in phase, so that rows stay parallel
    height = 1e-4 / number * np.sin(number * (feather.station - feather.station[middle]))
    nodes[..., 2] = height[:, None]
    local, evened = areas(model, nodes)
    near = abs(feather.station - feather.station[middle]) < 0.5 * math.pi / number

    def slope(vectors):
        normals = vectors[near, 1] / np.linalg.norm(vectors[near, 1], axis=-1, keepdims=True)
        return np.ptp(normals[:, 0])

    left = 1.0 / (1.0 + (number * EVEN * barb) ** 2)
    assert slope(evened) / slope(local) == pytest.approx(left, rel=0.1)
    # of a wave as long as the barb, half
    assert waves != 1.0 or left == pytest.approx(0.5, abs=0.01)


def test_normals_turn_with_the_feather():
    feather, model = preset_batch("ornamental_plume", rows=15)
    nodes = feather.rest.nodes.copy()
    nodes += 0.002 * np.random.default_rng(1).normal(size=nodes.shape)
    turn, _ = np.linalg.qr(np.random.default_rng(2).normal(size=(3, 3)))
    turn *= np.linalg.det(turn)
    _, evened = areas(model, nodes)
    _, turned = areas(model, nodes @ turn.T)
    np.testing.assert_allclose(turned, evened @ turn.T, atol=1e-12)
