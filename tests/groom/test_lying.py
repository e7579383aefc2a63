"""Feathers that lie along a skin that bends and twists beneath them."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from featherfx.algebra.vectors import frames_from
from featherfx.groom.regions.kinds import SkinBends, bends_of_skin, laid_along
from featherfx.groom.skin.points import SkinSurface

RADIUS, LENGTH = 0.02, 0.016
LOCAL = np.array([(0.3, 0.0, 0.0), (0.6, 0.0, 0.0), (0.9, 0.0, 0.0)])


@pytest.fixture(scope="module")
def tube():
    """A tube about x, its triangles a fortieth of a turn wide."""
    along, around = np.linspace(-0.05, 0.05, 41), np.linspace(0.0, 2.0 * np.pi, 81)[:-1]
    x, angle = np.meshgrid(along, around, indexing="ij")
    points = np.stack([x, RADIUS * np.cos(angle), RADIUS * np.sin(angle)], axis=2)
    number = np.arange(points[:, :, 0].size).reshape(x.shape)
    first, beside = number[:-1], np.roll(number[:-1], -1, axis=1)
    behind, last = number[1:], np.roll(number[1:], -1, axis=1)
    halves = (first, last, behind), (first, beside, last)
    faces = np.concatenate([np.stack(each, axis=-1).reshape(-1, 3) for each in halves])
    return SkinSurface(SimpleNamespace(points=points.reshape(-1, 3), triangles=faces))


def roots(surface, count=24):
    own = np.flatnonzero(np.abs(surface.corners.mean(axis=1)[:, 0]) < 0.01)[::7][:count]
    return surface.at(own, np.full((len(own), 3), 1.0 / 3.0))


def directions(points, degrees):
    """Unit, along the skin, turned from the tube's axis."""
    axis = np.broadcast_to((1.0, 0.0, 0.0), points.normal.shape)
    aside = np.cross(points.normal, axis)
    turned = np.cos(np.radians(degrees)) * axis + np.sin(np.radians(degrees)) * aside
    return turned - (turned * points.normal).sum(axis=1, keepdims=True) * points.normal


def heights(points, rotations, local):
    world = points.position[:, None] + LENGTH * np.einsum("nij,kj->nki", rotations, local)
    return np.linalg.norm(world[..., 1:], axis=2) - RADIUS


def test_a_skin_falls_off_beneath_feathers_as_it_bends(tube):
    points = roots(tube)
    for degrees, turning in ((0.0, 0.0), (90.0, np.degrees(0.5 * LENGTH / RADIUS) * 2.0)):
        found = bends_of_skin(points, directions(points, degrees), np.full(len(points), LENGTH))
        # the chord of half a length sees less of the turning than an arc would
        assert np.abs(found.along - turning).max() < 0.2 * max(turning, 15.0)
    # barbs go forward by 0.3 and aside by 0.25 lengths: only the way aside goes round the tube
    along = bends_of_skin(points, directions(points, 0.0), np.full(len(points), LENGTH))
    round_it = np.degrees(np.arctan(0.25 * LENGTH / RADIUS)) * 0.25 / np.hypot(0.3, 0.25)
    assert along.across == pytest.approx(np.full(len(points), round_it), abs=2.0)


def test_an_oblique_feather_turns_with_the_skin_that_twists_beneath_it(tube):
    """At 45 deg a tube twists by sin 45 cos 45 / R along the shaft; half of that at its middle."""
    points, length = roots(tube), np.full(24, LENGTH)
    for degrees in (45.0, -45.0):
        along = directions(points, degrees)
        start = frames_from(along, points.normal)
        bends = bends_of_skin(points, along, length)
        laid = laid_along(points, start, length, np.zeros(24), bends)
        change = np.swapaxes(start, 1, 2) @ laid
        rolled = np.degrees(np.arctan2(change[:, 2, 1], change[:, 1, 1]))
        twist = np.degrees(0.5 * LENGTH / RADIUS) * np.sign(degrees)
        # the sides that are looked at lie at 0.5 and 0.8 of the length
        assert np.abs(rolled).mean() == pytest.approx(0.65 * abs(twist), rel=0.25)
        assert (np.sign(rolled) == np.sign(rolled[0])).all()
    sides = np.array([(0.65, 0.2, 0.0), (0.65, -0.2, 0.0)])
    before, after = (np.ptp(heights(points, each, sides), axis=1).mean() for each in (start, laid))
    assert after < 0.3 * before


def test_a_feather_stands_at_its_tilt_to_the_skin_all_along(tube):
    points, length = roots(tube), np.full(24, LENGTH)
    along = directions(points, 90.0)
    bends = bends_of_skin(points, along, length)
    bends = SkinBends(np.zeros(24), bends.across)  # a straight shaft around a tube
    laid = laid_along(points, frames_from(along, points.normal), length, np.full(24, 5.0), bends)
    high = heights(points, laid, LOCAL) / LENGTH
    wanted = LOCAL[:, 0] * np.sin(np.radians(5.0))
    # as near as a straight line comes to it: below it in the middle, above it at the tip
    assert np.abs(high - wanted).max() < 0.12
    assert (np.sign((high - wanted)[:, 2]) > 0).all()
    assert (high - wanted).mean() == pytest.approx(0.0, abs=0.04)
