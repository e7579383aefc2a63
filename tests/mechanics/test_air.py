"""Areas and normals that the air presses on: those of the surface, evened out along the shaft."""

import math

import numpy as np
import pytest
from scipy.special import k1
from trial_batches import preset_batch

from featherfx.mechanics.air_kernels import EVEN_BARB_DIFFERENCE, area_vectors, vane_areas


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


@pytest.mark.parametrize("waves", [0.25, 0.6, 2.4])
def test_of_the_slope_of_a_wave_so_much_is_left_as_its_length_says(waves):
    """waves: in the vane's width, along the shaft, in the middle of the vane."""
    feather, model = preset_batch("swan_primary", rows=401, columns=2)
    nodes, middle = feather.rest.nodes.copy(), 220
    barbs = feather.barb_length[:, middle].sum()
    number = 2.0 * math.pi * waves / (0.64 * barbs)
    # along barbs in phase, so that rows stay parallel
    height = 1e-4 / number * np.sin(number * (feather.station - feather.station[middle]))
    nodes[..., 2] = height[:, None]
    local, evened = areas(model, nodes)
    near = abs(feather.station - feather.station[middle]) < 0.5 * math.pi / number

    def slope(vectors):
        normals = vectors[near, 1] / np.linalg.norm(vectors[near, 1], axis=-1, keepdims=True)
        return np.ptp(normals[:, 0])

    left = 1.0 / (1.0 + (number * EVEN_BARB_DIFFERENCE * barbs) ** 2)
    assert slope(evened) / slope(local) == pytest.approx(left, rel=0.1)
    # of a wave 1.67 times as long as the vane is wide, half
    assert waves != 0.6 or left == pytest.approx(0.5, abs=0.01)


def test_waves_are_evened_as_a_strip_in_potential_flow_turns_air_aside():
    """Half of the apparent mass of a strip of chord c is left at k c = 3.76, as
    EVEN_BARB_DIFFERENCE has it; chords are 0.64 of the barbs of flight feathers."""
    assert apparent_mass(0.01) == pytest.approx(1.0, abs=1e-3)
    assert apparent_mass(50.0) == pytest.approx(8.0 / (math.pi * 50.0), rel=0.03)
    assert apparent_mass(0.64 / EVEN_BARB_DIFFERENCE) == pytest.approx(0.5, abs=0.01)
    feather, _ = preset_batch("swan_primary", rows=41)
    nodes, rows = feather.rest.nodes, range(12, 30)
    ends = nodes[:, [feather.columns, 2 * feather.columns]]
    widths = [np.interp(nodes[rows, 0, 0], ends[:, s, 0], abs(ends[:, s, 1])) for s in range(2)]
    chord = np.mean(sum(widths) / feather.barb_length[:, rows].sum(axis=0))
    assert chord == pytest.approx(0.64, abs=0.03)


def apparent_mass(number: float, panels: int = 200) -> float:
    """Of a strip that moves across itself by cos(k s), over that of long waves; number: k c.

    The potential jumps by g across it, so that g (k K1(k r) / r) / (2 pi), summed over the strip
    (Hadamard's finite part), is the velocity; panels of equal jump, narrow at the edges.
    """
    k, turn = 0.5 * number, math.pi / panels
    edge, at = -np.cos(turn * np.arange(panels + 1)), -np.cos(turn * (np.arange(panels) + 0.5))
    half, middle = 0.5 * np.diff(edge), 0.5 * (edge[1:] + edge[:-1])
    speed = 1.0 / (at[:, None] - edge[1:]) - 1.0 / (at[:, None] - edge[:-1])
    for place, weight in zip(*np.polynomial.legendre.leggauss(8), strict=True):
        r = np.maximum(abs(at[:, None] - middle - half * place), 1e-7)
        speed += weight * half * (k * k1(k * r) / r - 1.0 / r**2)
    jump = np.linalg.solve(speed, np.full(panels, -2.0 * math.pi))
    # of long waves the jump is 2 (1 - x^2)^(1/2)
    return float(2.0 * (jump @ half) / math.pi)


def test_normals_turn_with_the_feather():
    feather, model = preset_batch("ornamental_plume", rows=15)
    nodes = feather.rest.nodes.copy()
    nodes += 0.002 * np.random.default_rng(1).normal(size=nodes.shape)
    turn, _ = np.linalg.qr(np.random.default_rng(2).normal(size=(3, 3)))
    turn *= np.linalg.det(turn)
    _, evened = areas(model, nodes)
    _, turned = areas(model, nodes @ turn.T)
    np.testing.assert_allclose(turned, evened @ turn.T, atol=1e-12)
