"""Feathers on a skin that bends, stretches and turns: leaves, lengths and rates."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from places import SAMPLES

from featherfx.algebra.rotation import vectors_to_frames
from featherfx.feather.placed_feathers import build_feathers
from featherfx.feather.types import RowPoints, both, stacked
from featherfx.shot.clock import StageClock
from featherfx.shot.coat.leaves import SkinLeaves
from featherfx.shot.frames import place
from featherfx.shot.read.read import read_shot
from featherfx.shot.roots import RootFrames
from featherfx.shot.sources import TimedSurface

SIDE, STEPS = 0.8, 41
GRID = np.linspace(-0.5 * SIDE, 0.5 * SIDE, STEPS)
AXIS = np.array([0.3, -0.5, 0.8])


class Sheet:
    """A square skin whose points are a function of the time."""

    bones, st, sampled, time_codes_per_second = None, None, (0.0, 1.0), 1.0

    def __init__(self, moved) -> None:
        x, y = np.meshgrid(GRID, GRID, indexing="ij")
        self.rest = np.stack([x.ravel(), y.ravel(), np.zeros(x.size)], axis=1)
        corner = (np.arange(STEPS - 1)[:, None] * STEPS + np.arange(STEPS - 1)).ravel()
        low = np.stack([corner, corner + STEPS, corner + 1], axis=1)
        high = np.stack([corner + 1, corner + STEPS, corner + STEPS + 1], axis=1)
        self.triangles, self._moved = np.concatenate([low, high]), moved

    def points(self, code: float) -> np.ndarray:
        return self._moved(self.rest, code)


def turned(points, time):
    return points @ vectors_to_frames(time * AXIS).T + time * np.array([0.2, 0.1, 0.0])


def bent(points, time):
    """On a cylinder about y, stretched along x."""
    curvature, stretch = 2.0 * np.sin(2.0 * time), 1.0 + 0.15 * np.sin(3.0 * time)
    angle = curvature * stretch * points[:, 0]
    half = 0.5 * angle
    x = stretch * points[:, 0] * np.sinc(angle / np.pi)
    z = -stretch * points[:, 0] * np.sin(half) * np.sinc(half / np.pi)
    return np.stack([x, points[:, 1], z], axis=1)


def plumage(moved):
    """Two feathers, the first of which starts upstream, and their leaves."""
    one = read_shot(SAMPLES / "feather_pull" / "shot.toml").groom.feathers[0]
    tilt = vectors_to_frames(np.array([0.0, -0.03, 0.0]))
    placements = [
        replace(one, id=f"f{k}", position=np.array([-0.1 + 0.05 * k, 0.0, 1e-3]), rotation=tilt)
        for k in range(2)
    ]
    drawn = build_feathers(tuple(placements), 11, 4)
    surface = TimedSurface(Sheet(moved), StageClock())
    leaves = SkinLeaves(surface, placements, drawn, np.arange(2))
    assert leaves.members.tolist() == [0, 1]
    return placements, drawn, leaves


def drawn_at(parts, time, roots=None, step=1e-2):
    """Points and rates of rigid feathers at a time. roots: positions, rotations; default: rest."""
    placements, drawn, leaves = parts
    still = np.array([p.position for p in placements]), np.array([p.rotation for p in placements])
    position, rotation = still if roots is None else roots
    rest = stacked([place(f.rest, p, r) for f, p, r in zip(drawn, position, rotation, strict=True)])
    still_rates = [both(np.zeros_like, rest) for _ in range(2)]
    held = RootFrames(*map(np.zeros_like, (position, rotation)))
    frames = [RootFrames(position, rotation), held, held]
    return leaves.follow([rest, *still_rates], frames, (time - step, time), 2)


def lengths(points: RowPoints) -> np.ndarray:
    """(F, K) m, of all pieces of rachis and barbs."""
    nodes = points.nodes
    m = (nodes.shape[2] - 1) // 2
    parts = [np.diff(nodes[:, :, 0], axis=1)]
    for first in (1, 1 + m):
        barb = np.concatenate([nodes[:, :, :1], nodes[:, :, first : first + m]], axis=2)
        parts.append(np.diff(barb, axis=2))
    return np.concatenate(
        [np.linalg.norm(each, axis=-1).reshape(len(nodes), -1) for each in parts], axis=1
    )


def test_a_skin_at_rest_leaves_feathers_as_they_are():
    parts = plumage(lambda points, time: points)
    placements, drawn, _ = parts
    found = drawn_at(parts, 0.5)
    for k, (own, feather) in enumerate(zip(placements, drawn, strict=True)):
        rest = place(feather.rest, own.position, own.rotation)
        np.testing.assert_allclose(found[0].nodes[k], rest.nodes, atol=1e-7)
    assert np.abs(found[1].nodes).max() < 1e-6


def test_a_skin_that_turns_turns_feathers_with_it():
    parts = plumage(turned)
    placements, drawn, _ = parts
    turn, shift = vectors_to_frames(0.4 * AXIS), 0.4 * np.array([0.2, 0.1, 0.0])
    roots = (
        np.array([turn @ p.position + shift for p in placements]),
        np.array([turn @ p.rotation for p in placements]),
    )
    found = drawn_at(parts, 0.4, roots, step=0.0)[0]
    for k, feather in enumerate(drawn):
        rest = place(feather.rest, roots[0][k], roots[1][k])
        np.testing.assert_allclose(found.nodes[k], rest.nodes, atol=1e-7)
        np.testing.assert_allclose(found.directors[k], rest.directors, atol=1e-6)


@pytest.mark.parametrize("time", [0.2, 0.5, 0.9, 1.3])
def test_lengths_hold_and_heights_go_with_places_of_the_skin(time):
    """A node that comes to lie over another place of the skin has the height of its leaf there."""
    parts = plumage(bent)
    placements, _, _ = parts
    curvature, stretch = 2.0 * np.sin(2.0 * time), 1.0 + 0.15 * np.sin(3.0 * time)
    radius, roots = 1.0 / curvature, np.array([p.position for p in placements])
    angle = curvature * stretch * roots[:, 0]
    turn = vectors_to_frames(np.stack([0.0 * angle, angle, 0.0 * angle], axis=1))
    position = bent(roots * [1.0, 1.0, 0.0], time) + roots[:, 2:] * turn[:, :, 2]
    rotation = turn @ np.array([p.rotation for p in placements])
    rest = drawn_at(parts, 0.0, step=0.0)[0]
    found = drawn_at(parts, time, (position, rotation), step=0.0)[0]
    np.testing.assert_allclose(lengths(found), lengths(rest), rtol=1e-6, atol=1e-12)
    x, _, z = np.moveaxis(found.nodes[:, :, 0], -1, 0)
    height = np.hypot(x, z + radius) - radius if radius > 0 else -np.hypot(x, z + radius) - radius
    at = np.arctan2(x * np.sign(radius), (z + radius) * np.sign(radius)) * radius / stretch
    for k in range(2):
        own = rest.nodes[k, :, 0]
        inside = at[k] <= own[-1, 0]
        leaf = np.interp(at[k], own[:, 0], own[:, 2])
        np.testing.assert_allclose(height[k][inside], leaf[inside], atol=2.5e-4)


def test_velocities_are_derivatives_of_what_is_drawn():
    parts, h = plumage(bent), 1e-3
    nodes = [drawn_at(parts, 0.6 + k * h, step=h)[0].nodes for k in (-2, -1, 1, 2)]
    five = (nodes[0] - 8.0 * nodes[1] + 8.0 * nodes[2] - nodes[3]) / (12.0 * h)
    speed = drawn_at(parts, 0.6, step=h)[1].nodes
    rms = np.sqrt((five**2).sum(axis=-1).mean())
    off = np.linalg.norm(speed - five, axis=-1)
    assert np.percentile(off, 99) < 0.03 * rms
