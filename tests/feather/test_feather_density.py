"""One feather at two densities: what the map between their material points keeps."""

from __future__ import annotations

from functools import partial

import numpy as np
import pytest
from places import SAMPLES
from scipy.spatial.transform import Rotation

import featherfx
from featherfx.feather.barb_looks import barb_curves, render_feather
from featherfx.feather.build import build_feather
from featherfx.feather.density import density_map, hermite_weights
from featherfx.feather.shapes import carry_motion, carry_points, scaled_map
from featherfx.feather.types import RowPoints, barb_slice, both, scale_feather, turned
from featherfx.shot.frames import place

GRID = (21, 6)


def kind_of(sample):
    return featherfx.read_groom(SAMPLES / sample / "groom.toml").feathers[0].kind


@pytest.fixture(scope="module")
def swan():
    return kind_of("swan_wing")


def bent(feather, amount=0.5):
    """A feather rolled up and twisted smoothly along x; its rows stay rigid."""
    nodes = feather.rest.nodes
    share = feather.station / feather.station[-1]
    turns = Rotation.from_rotvec(amount * np.stack([share**2, share**2, 0 * share], axis=-1))
    local = RowPoints(nodes - nodes[:, :1], feather.rest.directors)
    tangent = turns.as_matrix() @ np.gradient(nodes[:, 0], feather.station, axis=0)[..., None]
    step = 0.5 * (tangent[1:] + tangent[:-1])[..., 0] * np.diff(feather.station)[:, None]
    shaft = np.concatenate([[[0, 0, 0]], np.cumsum(step, axis=0)])
    points = turned(turns.as_matrix().swapaxes(1, 2), local)
    return RowPoints(points.nodes + shaft[:, None], points.directors)


@pytest.mark.parametrize("sample", ["swan_wing", "breeze"])
@pytest.mark.parametrize("grid", [(81, 12), (33, 5), (11, 3), GRID])
@pytest.mark.parametrize("mirrored", [False, True])
def test_rest_and_rigid_motions_are_exact(sample, grid, mirrored):
    kind = kind_of(sample)
    coarse = build_feather(kind, *GRID, mirrored)
    fine = build_feather(kind, *grid, mirrored)
    mapped = density_map(coarse, fine)
    both(partial(np.testing.assert_allclose, atol=1e-14), mapped(coarse.rest), fine.rest)
    turn, shift = Rotation.from_rotvec([0.7, -1.9, 1.1]).as_matrix(), np.array([3.0, -2.0, 0.5])
    moved = mapped(place(coarse.rest, shift, turn))
    expected = place(fine.rest, shift, turn)
    both(partial(np.testing.assert_allclose, atol=1e-13), moved, expected)


def test_one_map_serves_points_and_rates(swan):
    coarse, fine = build_feather(swan, *GRID), build_feather(swan, 60, 10)
    mapped = density_map(coarse, fine)
    random = np.random.default_rng(4)
    start, rate = (both(lambda part: random.normal(size=part.shape), coarse.rest) for _ in range(2))

    def later(values, rates):
        return both(lambda x, v: x + 0.25 * v, values, rates)

    after, expected = mapped(later(start, rate)), later(mapped(start), mapped(rate))
    both(partial(np.testing.assert_allclose, atol=1e-9), after, expected)


def test_barbs_of_common_rows_go_through_the_simulated_nodes(swan):
    """Twice the columns on the same rows: every second node is a simulated one, in any pose."""
    coarse, fine = build_feather(swan, *GRID), build_feather(swan, GRID[0], 2 * GRID[1])
    random = np.random.default_rng(8)
    pose = both(lambda part: part + 0.01 * random.normal(size=part.shape), coarse.rest)
    mapped = density_map(coarse, fine)(pose)
    np.testing.assert_allclose(mapped.nodes[:, 0], pose.nodes[:, 0], atol=1e-14)
    np.testing.assert_allclose(mapped.directors, pose.directors, atol=1e-14)
    for side in (0, 1):
        grown = coarse.barb_length[side] > 0
        ours = mapped.nodes[grown, barb_slice(side, 12)][:, 1::2]
        theirs = pose.nodes[grown, barb_slice(side, 6)]
        np.testing.assert_allclose(ours, theirs, atol=1e-13)


def test_a_bent_feather_converges_with_the_simulated_rows(swan):
    """Against the same smooth bending of the fine feather itself, as a share of its length."""
    errors = []
    fine = build_feather(swan, 161, 6)
    wanted = bent(fine)
    for rows in (11, 21, 41):
        coarse = build_feather(swan, rows, 6)
        # rows of the coarse feather stand where the finest puts them
        station = np.stack(
            [np.interp(coarse.station, fine.station, c) for c in wanted.nodes[:, 0].T], -1
        )
        pose = bent(coarse)
        pose.nodes[:] += (station - pose.nodes[:, 0])[:, None]
        error = np.linalg.norm(density_map(coarse, fine)(pose).nodes - wanted.nodes, axis=-1)
        errors.append(error.max() / swan.length)
    assert errors[1] < 2e-3
    assert errors[2] < 0.6 * errors[1] < 0.36 * errors[0]


def pieces(feather, nodes):
    """(2, n, m) of the barbs that there are, over their lengths at rest."""
    found = []
    for each in (nodes, feather.rest.nodes):
        barbs = [each[:, barb_slice(side, feather.columns)] for side in (0, 1)]
        chains = [np.concatenate([each[:, :1], barb], axis=1) for barb in barbs]
        found.append(np.linalg.norm(np.diff(chains, axis=2), axis=-1))
    there = feather.barb_length > 0.0
    return found[0][there] / found[1][there]


@pytest.mark.parametrize("sample", ["swan_wing", "breeze"])
def test_barbs_keep_their_lengths_on_another_grid_and_rates_are_those_of_the_places(sample):
    kind, step = kind_of(sample), 1e-4
    coarse, fine = build_feather(kind, 8, 3), build_feather(kind, 21, 6)
    to_fine = density_map(coarse, fine)

    def pose(time):
        turn = Rotation.from_rotvec([time, 0.0, 2.0 * time]).as_matrix()
        return place(bent(coarse, np.sin(3.0 * time)), np.array([time, 0.3, 0.0]), turn)

    before, now, after = (pose(0.4 + k * step) for k in (-1, 0, 1))
    rate = both(lambda a, b: (b - a) / (2.0 * step), before, after)
    second = both(lambda a, b, c: (a - 2.0 * b + c) / step**2, before, now, after)
    points, rates, seconds = carry_motion(to_fine, now, rate, second)
    linear = to_fine(now).nodes
    assert np.abs(pieces(fine, linear) - 1.0).max() > 1e-3
    assert np.abs(pieces(fine, points.nodes) - 1.0).max() < 1e-12
    assert np.abs(points.nodes - linear).max() < 3e-3 * kind.length
    a, b, c = (carry_motion(to_fine, each, rate, second)[0].nodes for each in (before, now, after))
    assert rates.nodes == pytest.approx((c - a) / (2.0 * step), abs=1e-5)
    assert seconds.nodes == pytest.approx((a - 2.0 * b + c) / step**2, abs=1e-4)
    assert carry_points(to_fine, coarse.rest).nodes == pytest.approx(fine.rest.nodes, abs=1e-14)


def test_interpolation_is_smooth_and_reproduces_parabolas():
    knots = np.array([0.0, 0.1, 0.3, 0.35, 0.7, 1.0])
    places = np.linspace(0.0, 1.0, 57)
    values, slopes = hermite_weights(knots, places)
    np.testing.assert_allclose(values @ (3 * knots**2 - knots), 3 * places**2 - places, atol=1e-13)
    np.testing.assert_allclose(slopes @ (3 * knots**2 - knots), 6 * places - 1, atol=1e-12)
    data = np.random.default_rng(1).normal(size=6)
    for knot in knots[1:-1]:
        left, right = hermite_weights(knots, np.array([knot - 1e-9, knot + 1e-9]))[1] @ data
        assert abs(left - right) < 1e-5


def test_barbs_are_as_many_as_asked_for_and_follow_the_vane(swan):
    coarse = build_feather(swan, *GRID)
    barbs = barb_curves(swan, GRID, 300, False)
    for side in (0, 1):
        assert abs(np.sum(barbs.side == side) - 300) <= 3
    np.testing.assert_allclose(barbs.points_map(coarse.rest), barbs.points, atol=1e-14)
    assert barbs.widths.shape == barbs.points.shape[:2]
    # as wide as they are apart, which is less across oblique barbs than along the rachis
    apart = swan.length * (1.0 - swan.calamus) / 300
    assert np.all(barbs.widths < 1.1 * apart)
    assert np.all(barbs.widths.mean(axis=1) > 0.2 * apart)
    lengths = np.linalg.norm(np.diff(barbs.points_map(bent(coarse)), axis=1), axis=2).sum(axis=1)
    rest = np.linalg.norm(np.diff(barbs.points, axis=1), axis=2).sum(axis=1)
    assert np.abs(lengths - rest).max() < 2e-3 * rest.max()


def test_equal_grids_need_no_map(swan):
    feather, mapped = render_feather(swan, GRID, GRID, False)
    assert mapped is None
    assert feather.rows == GRID[0]


def test_the_map_of_a_larger_feather_is_the_scaled_map(swan):
    small = [build_feather(swan, rows, columns) for rows, columns in ((9, 3), GRID)]
    large = [scale_feather(each, 1.7) for each in small]
    unit, own = density_map(*small), density_map(*large)
    found, random = scaled_map(unit, 1.7, small[0].rows), np.random.default_rng(1)
    values = both(lambda part: random.normal(size=part.shape), small[0].rest)
    for scaled_part, part, unscaled in zip(found(values), own(values), unit(values), strict=True):
        assert scaled_part == pytest.approx(part, rel=1e-9, abs=1e-9)
        assert np.abs(unscaled - part).max() > 1e-5
    assert scaled_map(unit, 1.0, small[0].rows) is unit
