"""Feathers of regions laid over each other at rest, and the order of those that are not."""

import warnings
from dataclasses import replace
from operator import attrgetter

import numpy as np
import pytest
from crossed import crossed
from scipy.optimize import minimize

import featherfx
from featherfx.algebra.triangulation import weld
from featherfx.algebra.vectors import frames_from
from featherfx.api import scene_readers
from featherfx.errors import InputError, InputWarning
from featherfx.feather.build import build_feather
from featherfx.feather.crossings import near_pairs, segment_distance, strips_of
from featherfx.feather.density import density_map
from featherfx.feather.leaves import _sew_tails
from featherfx.feather.placed_feathers import build_feathers
from featherfx.feather.shapes import (
    build_plane_feathers,
    carry_motion,
    distinct_shapes,
    with_detail,
)
from featherfx.feather.types import RowPoints, scale_feather
from featherfx.groom.keys.problems import Place, Problems
from featherfx.groom.presets.kinds import Change, adjusted, kind_of
from featherfx.groom.presets.presets import load_preset
from featherfx.groom.read.read import read_groom
from featherfx.groom.types import Placement, Turning
from featherfx.lab.program import write_patch
from featherfx.shot.loop.placement import lay_out
from featherfx.usd.read.cache import Cache

ROW = """
name = "row"
[layout]
[[row]]
id = "f"
kind = "body_contour"
count = 6
first = { position = [0, 0, 0], direction = [-1, 0, 0], up = [0, 0, 1] }
last = { position = [-0.02, 0, 0], direction = [-1, 0, 0], up = [0, 0, 1] }
"""


@pytest.fixture(scope="module")
def kind():
    _, tree = load_preset("feather/body_contour")
    found = kind_of("body_contour", tree, Place("", "", Problems()))
    # 3 cm long, flat
    return adjusted(found, Change(scale=0.5, camber=-found.rachis.camber, hollow=-8.0))


def placed(kind, name, position, direction=(-1, 0, 0), **more):
    rotation = frames_from(direction, (0, 0, 1))
    return Placement(name, kind, "body", np.array(position, float), rotation, **more)


def test_feathers_that_may_meet_are_near_and_on_one_side(kind):
    below = placed(kind, "below", (0, 0, -0.001))
    below = replace(below, rotation=frames_from((-1, 0, 0), (0, 0, -1)))
    row = [placed(kind, f"f{k}", (-0.4 * kind.length * k, 0, 0)) for k in range(8)]
    pairs = near_pairs(strips_of([*row, below]))
    places = np.array([each.position for each in row])
    assert {(k, k + 1) for k in range(7)} <= set(map(tuple, pairs.tolist()))
    assert pairs.max() < len(row)
    assert np.linalg.norm(places[pairs[:, 1]] - places[pairs[:, 0]], axis=1).max() < 2 * kind.length


@pytest.fixture(scope="module")
def patch(tmp_path_factory):
    """A shot of 150 contour feathers on an egg, as it is read, and with its layout."""
    path = write_patch(tmp_path_factory.mktemp("patch"), 150, 3)
    groom = read_groom(path.with_name("groom.toml"), (), scene_readers())
    return path, groom, lay_out(groom)


def test_feathers_of_a_region_bend_onto_their_skin_without_crossing(patch):
    _, placed_groom, laid = patch
    assert len(crossed(placed_groom.feathers)) > 30
    assert len(crossed(laid.feathers)) <= 2
    assert [f.id for f in laid.feathers] == [f.id for f in placed_groom.feathers]
    # they lie on the egg: no more than a tenth of their length above it
    ends = [
        feather.rest.nodes[-1, 0] @ own.rotation.T + own.position
        for own, feather in zip(laid.feathers, build_feathers(laid.feathers, 21, 6), strict=True)
    ]
    egg = np.linalg.norm(np.array(ends) / (0.45, 0.22, 0.2), axis=1) - 1.0
    heights = 0.2 * egg / np.array([f.kind.length for f in laid.feathers])
    assert 0.02 < np.median(heights) < 0.12


@pytest.mark.parametrize("grid", [(9, 2), (21, 6)])
def test_rachis_and_barbs_are_as_long_as_those_of_the_kind(patch, grid):
    _, _, laid = patch
    own, plane = build_feathers(laid.feathers, *grid), build_plane_feathers(laid.feathers, *grid)
    for bent, flat in zip(own, plane, strict=True):
        chords = [np.linalg.norm(np.diff(f.rest.nodes[:, 0], axis=0), axis=1) for f in (bent, flat)]
        assert chords[0] == pytest.approx(chords[1], rel=1e-9)
        for side in range(2):
            first = 1 + side * grid[1]
            ends = [f.rest.nodes[:, first] - f.rest.nodes[:, 0] for f in (bent, flat)]
            lengths = [np.linalg.norm(each, axis=1) for each in ends]
            assert lengths[0] == pytest.approx(lengths[1], rel=1e-9, abs=1e-12)
        assert np.array_equal(bent.rest.directors[0], np.eye(3)[1:])
        assert not bent.rest.nodes[0, 0].any()
        # no rachis is higher than the room between leaves
        assert np.abs(bent.surface.offset[:, 1]).max() <= np.abs(flat.surface.offset[:, 1]).max()


def test_feathers_of_one_topology_share_it_and_those_of_a_leaf_keep_their_kinds(patch):
    *_, groom = patch
    one = next(each for each in groom.feathers if each.leaf is not None)
    other = replace(one, kind=adjusted(one.kind, Change(angle=10.0)), prototype=None)
    (first,), (second,) = (build_feathers([each], 9, 3) for each in (one, other))
    for a, b in ((first, second), build_plane_feathers([one, other], 9, 3)):
        assert a.surface.triangles is b.surface.triangles
        assert not a.surface.triangles.flags.writeable
    assert np.abs(first.rest.nodes - second.rest.nodes).max() > 1e-4


def test_a_map_between_grids_leads_from_leaf_to_leaf(patch):
    """And its rates are those of what it gives."""
    _, _, laid = patch
    some = laid.feathers[:3]
    pairs = zip(build_feathers(some, 9, 2), build_feathers(some, 21, 6), strict=True)
    flats = zip(build_plane_feathers(some, 9, 2), build_plane_feathers(some, 21, 6), strict=True)
    for (coarse, fine), flat in zip(pairs, flats, strict=True):
        to_fine = with_detail(density_map(*flat), coarse, fine)
        random, step = np.random.default_rng(1), 1e-4
        rates = RowPoints(*(random.normal(scale=0.02, size=each.shape) for each in coarse.rest))
        still = RowPoints(*(np.zeros_like(each) for each in coarse.rest))
        found = carry_motion(to_fine, coarse.rest, rates, still)
        assert np.abs(found.points.nodes - fine.rest.nodes).max() < 1e-12
        assert np.abs(found.points.directors - fine.rest.directors).max() < 1e-9
        ahead, behind = (
            carry_motion(
                to_fine,
                RowPoints(*(x + t * v for x, v in zip(coarse.rest, rates, strict=True))),
                rates,
                still,
            ).points.nodes
            for t in (step, -step)
        )
        speed = np.abs(found.velocities.nodes).max()
        assert np.abs((ahead - behind) / (2 * step) - found.velocities.nodes).max() < 1e-5 * speed
        bend = (ahead - 2.0 * found.points.nodes + behind) / step**2
        assert np.abs(bend - found.accelerations.nodes).max() < 1e-3 * np.abs(bend).max() + 1e-6


@pytest.mark.parametrize(("ahead", "said"), [(0.456, True), (0.45, True), (0.6, False)])
def test_a_tail_that_no_sheet_joins_to_the_skin_is_reported(patch, kind, ahead, said):
    """One that stands on a skin of larger faces or just off it, not one far from it."""
    _, placed_groom, _ = patch
    points, faces = weld(placed_groom.skin)
    fan = [
        placed(
            kind,
            f"tail_{k}",
            (-ahead, 0.004 * k, 0.0),
            (-1.0, 0.2 * k, 0.0),
            turning=Turning(("tail", "tail_left"), 1.0, np.zeros(3)),
        )
        for k in range(-2, 3)
    ]
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        sewn, _ = _sew_tails(replace(placed_groom, feathers=tuple(fan)), points, faces)
    assert [("tail 'tail'" in str(each.message)) for each in caught] == [True] * said
    assert sewn is points


def test_a_leaf_is_the_shape_without_load(patch, tmp_path):
    path, _, _ = patch
    text = path.read_text().replace('motion = { base = "shake", amplitude = 0.01 }', "")
    text = "\n".join(line for line in text.splitlines() if not line.startswith("wind"))
    still = path.with_name("still.toml")
    still.write_text(text.replace('quality = "draft"', 'quality = "draft"\ngravity = [0, 0, 0]'))
    featherfx.bake(still, tmp_path / "still.usdc", frames=(1, 2))
    cache = Cache(tmp_path / "still.usdc")
    number = range(len(cache.feathers))
    first, last = (np.concatenate(cache.points_of(number, time)) for time in (1.0, 2.0))
    assert np.abs(first - last).max() < 1e-6


def test_a_layout_without_regions_is_reported(tmp_path):
    (tmp_path / "groom.toml").write_text(ROW)
    with pytest.warns(InputWarning, match="there are no regions"):
        groom = featherfx.read_groom(tmp_path / "groom.toml")
    assert groom.coat is None


def test_feathers_of_a_layout_are_no_instances(patch, tmp_path):
    path, _, _ = patch
    with pytest.raises(InputError, match="no two feathers"):
        featherfx.export_groom(path.with_name("groom.toml"), tmp_path / "x.usdc", instances=True)


def test_distance_of_segments():
    random = np.random.default_rng(4)
    first, along, second, across = random.normal(size=(4, 20, 3))
    found = segment_distance(first, along, second, across)
    for k in range(20):

        def apart(s, k=k):
            return np.linalg.norm(first[k] + s[0] * along[k] - second[k] - s[1] * across[k])

        starts = [(0.1, 0.1), (0.9, 0.1), (0.1, 0.9), (0.9, 0.9)]
        least = min(minimize(apart, s, bounds=[(0, 1)] * 2).fun for s in starts)
        assert found[k] == pytest.approx(least, abs=1e-6)


@pytest.mark.parametrize("mirrored", [False, True])
def test_a_scaled_feather_is_the_feather_of_the_scaled_kind(kind, mirrored):
    wanted = build_feather(adjusted(kind, Change(scale=1.7)), 11, 4, mirrored)
    found = scale_feather(build_feather(kind, 11, 4, mirrored), 1.7)
    names = ("station", "width", "height", "barb_length", "barb_span")
    for name in ("rest.nodes", "rest.directors", *names):
        ours, theirs = (attrgetter(name)(each) for each in (found, wanted))
        assert np.allclose(ours, theirs, rtol=1e-12, atol=1e-15)
    for mine, theirs in zip((found,), (wanted,), strict=True):
        assert np.allclose(mine.surface.points(mine.points), theirs.surface.points(theirs.points))
    assert np.array_equal(found.surface.triangles, wanted.surface.triangles)


def test_repeated_shapes(kind):
    other = adjusted(kind, Change(width=1.2))
    feathers = [
        placed(kind, "a", (0, 0, 0)),
        placed(kind, "b", (0, 0, 0), prototype=kind, size=1.0),
        placed(other, "c", (0, 0, 0)),
        placed(kind, "d", (0, 0, 0), mirrored=True),
    ]
    assert distinct_shapes(feathers) == ([0, 2, 3], [0, 0, 1, 2])
