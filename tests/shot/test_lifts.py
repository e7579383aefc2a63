"""How far feathers are lifted off each other and off the skin, sample by sample."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from types import SimpleNamespace

import numpy as np
import pytest
from shingled import (
    THICKNESS,
    Sheet,
    askew,
    crossings,
    farthest,
    lay,
    least_gap,
    lifted,
    shingles,
    sinking,
)

from featherfx.algebra.rotation import frames_from, vectors_to_frames
from featherfx.feather.shapes import build_feathers
from featherfx.feather.types import both, stacked, turned
from featherfx.groom.presets.kinds import Change, adjusted
from featherfx.shot.clock import StageClock
from featherfx.shot.frames import FeatherPose, place
from featherfx.shot.layers import layers
from featherfx.shot.layers.lap_kernels import find_laps
from featherfx.shot.layers.pose_kernels import lift_points_of_all, lift_ways
from featherfx.shot.layers.stack import pose_like, scratch_of, sorted_stack
from featherfx.shot.loop.run import drawn_feathers
from featherfx.shot.loop.simulate import simulate
from featherfx.shot.read.read import read_shot
from featherfx.shot.skin import SkinSurfaces


def test_rims_that_cross_between_their_points_are_parted():
    shot = shingles()
    feathers = tuple(askew(each, k) for k, each in enumerate(shot.groom.feathers))
    shot = replace(shot, groom=replace(shot.groom, feathers=feathers))
    plain = [crossings(shot, frame) for frame in simulate(replace(shot, layers=None))]
    laid = [crossings(shot, frame) for frame in simulate(shot)]
    assert min(plain) > 10
    assert max(laid) == 0, (plain, laid)


def test_edges_that_lead_from_the_base_of_a_vane_are_looked_up():
    """Where a vane begins in a point its edges are long, and cross others between their nodes."""
    shot = shingles(2)
    drawn = build_feathers(shot.groom.feathers, shot.quality.rows, shot.quality.columns)
    stack, vanes, rest = layers.shot_stack(shot, drawn)
    pose, scratch = pose_like(rest, vanes.present.shape), scratch_of(vanes, len(stack.pairs))
    lift_points_of_all(vanes, rest, pose, (0, len(drawn)))
    pairs = (0, len(stack.pairs)), np.ones(len(stack.pairs), dtype=np.int8)
    laps = scratch.laps[: find_laps(vanes, stack, pose, 100.0, pairs, scratch.laps, scratch.seen)]
    row, column = laps["node"].T
    between = (laps["part"] > 0.3) & (laps["part"] < 0.7) & (laps["after"][:, 0] == row + 1)
    inner = (column > 0) & (column < vanes.present.shape[2] - 1)
    guest = np.where(laps["above"] == 1, laps["upper"], laps["lower"])
    found = between & inner & (row == vanes.first[guest])
    assert len(set(zip(column[found].tolist(), laps["part"][found].tolist(), strict=True))) >= 8


def test_a_feather_that_lies_far_beneath_what_it_should_lie_over_stays_there():
    shot = shingles(2)
    over, under = shot.groom.feathers
    sunk = over.position - np.array([0.0, 0.0, 0.3 * over.kind.length])
    feathers = replace(over, position=sunk), under
    shot = replace(shot, groom=replace(shot.groom, feathers=feathers))
    for frame, other in zip(simulate(shot), simulate(replace(shot, layers=None)), strict=True):
        for points, before in zip(frame.points, other.points, strict=True):
            np.testing.assert_array_equal(points, before)


def pushed_beneath_a_large_one(limb=(0, 0), depth=0.7, size=3.0, behind=1.0):
    """A small feather that goes beneath a large one within a frame, both slanted, so that boxes
    along the axes meet: their plumage and axes, poses as they were and as they were laid. limb:
    which moves each. depth: of the small one's length; size: of the large one, over that, and
    behind: how far its root stands behind."""
    shot = shingles(2)
    small, large = shot.groom.feathers
    kind = adjusted(large.kind, Change(scale=size))
    back = np.array([behind * small.kind.length, 0.0, 0.0])
    feathers = small, replace(large, kind=kind, prototype=None, position=-back)
    shot = replace(shot, groom=replace(shot.groom, feathers=feathers))
    poses, none = next(iter(simulate(replace(shot, layers=None)))).poses, np.zeros((0, 3))
    slant = frames_from((1.0, 0.0, 1.0), (-1.0, 0.0, 1.0))
    upper, lower = (replace(each, points=turned(slant.T, each.points)) for each in poses)
    drawn = build_feathers(shot.groom.feathers, shot.quality.rows, shot.quality.columns)
    plumage = layers.LayeredPlumage(shot, drawn, np.arange(2), 1)
    plumage.vanes = plumage.vanes._replace(limb=np.array(limb))
    lay(plumage, [upper, lower], none, 0.0, 0.0)
    way = -depth * small.kind.length * slant[:, 2]
    sunk = replace(upper, points=upper.points.shifted(way))
    laid = lay(plumage, [sunk, lower], none, 1.0, 1.0 / shot.frames_per_second)
    return plumage, slant, small, (sunk, lower), laid


def test_a_feather_that_is_pushed_beneath_another_is_laid_over_it():
    plumage, slant, small, (sunk, lower), laid = pushed_beneath_a_large_one()
    before, after = (
        least_gap(*(turned(slant, each.points).rows()[2:] for each in pair))
        for pair in ((sunk, lower), laid)
    )
    assert before < -0.65 * small.kind.length
    assert after > 0.85 * THICKNESS  # the quill stays where it grows
    told = plumage.report()
    assert told["written_depth"]["worst"] < 0.5
    assert told["feathers_lifted"] == 1
    (worst,) = told["worst_lifted"]
    assert (worst["feather"], worst["frame"]) == (small.id, 1.0)
    assert worst["lift"] == pytest.approx(farthest(laid[0], sunk))
    assert worst["of_length"] == pytest.approx(worst["lift"] / plumage.vanes.row[0].sum())


def test_what_needs_a_lift_of_more_than_its_length_is_laid_all_the_same():
    """Lifts faded out from a length on, and left a tenth of it in the other."""
    plumage, _, small, (sunk, _), laid = pushed_beneath_a_large_one((0, 0), 1.1, 8.0, 1.5)
    assert 1.05 < farthest(laid[0], sunk) / small.kind.length < 1.5
    assert plumage.report()["written_depth"]["worst"] < 0.5


def test_what_another_limb_carries_does_not_turn_where_a_feather_is_lifted():
    """A breast's feather swung to and fro over a beating wing that it had lain on."""
    shot = shingles(2)
    drawn = build_feathers(shot.groom.feathers, shot.quality.rows, shot.quality.columns)
    stack, _, rest = layers.shot_stack(shot, drawn)
    upper, lower = stack.pairs[0]
    directors = rest.directors.copy()
    directors[lower, :, 1] += 0.5 * directors[lower, :, 0]  # rolled
    ways = np.zeros((2, 2, directors.shape[1], 3))
    for own, limb in zip(ways, ((0, 0), (0, 1)), strict=True):
        lift_ways(stack, np.array(limb), directors, np.zeros((2, 3)), own)
    alone = directors[upper, :, 1]
    assert np.abs(ways[0, upper] - alone).max() > 0.1
    np.testing.assert_allclose(ways[1, upper], alone, atol=1e-12)


def test_what_a_limb_carries_away_is_not_lifted_to_where_it_lay():
    """A wing that opens passes by what it lay over at rest; feathers of one wing stay in order."""
    lifts = {}
    for limb in ((1, 1), (1, 0), (0, 1)):
        _, _, small, (sunk, _), laid = pushed_beneath_a_large_one(limb)
        lifts[limb] = farthest(laid[0], sunk) / small.kind.length
    assert lifts[1, 1] > 0.65
    assert max(lifts[1, 0], lifts[0, 1]) < 0.05, lifts


@pytest.mark.parametrize(
    ("depth", "over"), [(0.08, True), (0.12, True), (0.15, False), (0.18, False), (0.3, False)]
)
def test_what_a_limb_carries_is_laid_over_or_left_whole(depth, over):
    """There is no depth at which a part of it is undone: that much would be left in the other."""
    plumage, _, small, (sunk, _), laid = pushed_beneath_a_large_one((1, 0), depth)
    assert plumage.report()["written_depth"]["worst"] < 0.5
    lift = farthest(laid[0], sunk) / small.kind.length
    # it begins above the large one, so less than the depth is to be made up for
    assert lift > 0.7 * depth if over else lift < 0.01, lift


def test_lifts_do_not_add_up_over_all_that_lie_beneath():
    """Follicles turn by 27 degrees, so that each feather of 24 is in those beneath it."""
    shot = shingles(24)
    poses, none = next(iter(simulate(replace(shot, layers=None)))).poses, np.zeros((0, 3))
    drawn = build_feathers(shot.groom.feathers, shot.quality.rows, shot.quality.columns)
    plumage = layers.LayeredPlumage(shot, drawn, np.arange(len(poses)), 1)
    lay(plumage, poses, none, 0.0, 0.0)
    down, pressed = frames_from((1.0, 0.0, 0.5), (-0.5, 0.0, 1.0)), []
    for one, pose in zip(shot.groom.feathers, poses, strict=True):
        points = turned(down, pose.points.shifted(-one.position)).shifted(one.position)
        pressed.append(replace(pose, points=points))
    laid = lay(plumage, pressed, none, 1.0, 1.0 / shot.frames_per_second)
    lifts = [
        np.abs(now.points.nodes - before.points.nodes).max()
        for now, before in zip(laid, pressed, strict=True)
    ]
    assert max(lifts[:8]) < 1.3 * max(lifts[8:16])
    assert plumage.report()["written_depth"]["worst"] < 0.5


def test_what_moves_by_nanometres_stays_as_it_is_laid():
    """Wherever its points are: rounded to micrometres they once counted as moved over an edge."""
    shot, none, shake = shingles(12), np.zeros((0, 3)), np.random.default_rng(3)
    drawn = build_feathers(shot.groom.feathers, shot.quality.rows, shot.quality.columns)
    plumage, shown = layers.LayeredPlumage(shot, drawn, np.arange(len(drawn)), 1), []
    for frame in range(6):
        given = []
        for k, (one, feather) in enumerate(zip(shot.groom.feathers, drawn, strict=True)):
            way = askew(one, k, 35.0)
            points = place(feather.rest, way.position, way.rotation)
            edges = 1e-6 * (np.floor(1e6 * points.nodes) + 0.5)
            nodes = edges + 2e-9 * shake.standard_normal(edges.shape)
            rates = both(np.zeros_like, points)
            given.append(FeatherPose(points._replace(nodes=nodes), rates, rates))
        duration = 1.0 / shot.frames_per_second if frame else 0.0
        shown.append(lay(plumage, given, none, float(frame), duration))
    for laid in shown[1:]:
        assert max(farthest(*each) for each in zip(laid, shown[0], strict=True)) < 2e-8


def test_what_lies_askew_on_another_goes_up_with_it():
    """Of 12 feathers rolled by 35 degrees to either side in turn the lowest goes up by a twentieth
    of the length; lifted along their own dorsal sides the highest went up by twice the length."""
    shot, step, none = shingles(12), 0.01, np.zeros((0, 3))
    drawn = build_feathers(shot.groom.feathers, shot.quality.rows, shot.quality.columns)
    plumage, poses, given = layers.LayeredPlumage(shot, drawn, np.arange(len(drawn)), 1), [], []
    for k, (one, feather) in enumerate(zip(shot.groom.feathers, drawn, strict=True)):
        for way, some in ((one, poses), (askew(one, k, 35.0), given)):
            points = place(feather.rest, way.position, way.rotation)
            rates = both(np.zeros_like, points)
            some.append(FeatherPose(points, rates, rates))
    lay(plumage, poses, none, 0.0, 0.0)
    given[-1] = replace(given[-1], points=given[-1].points.shifted(np.array([0.0, 0.0, step])))
    laid = lay(plumage, given, none, 1.0, 1.0 / shot.frames_per_second)
    most = max(farthest(*each) for each in zip(laid, given, strict=True))
    assert step < most < 1.3 * shot.groom.feathers[0].kind.length
    assert plumage.report()["written_depth"]["worst"] < 0.5


def test_what_is_lifted_all_at_once_rises_before_and_falls_after():
    """It stays clear, and goes on from a checkpoint on its way up as it went without one."""
    most = {}
    for ease in (0.0, 0.25):
        shot, plumage, poses = sinking(ease)
        laid, memory = lifted(shot, plumage, poses)
        for pair in laid:
            assert least_gap(*(each.points.rows()[2:] for each in pair)) > 0.85 * THICKNESS
        lifts = np.array(
            [
                one[0].points.nodes - given[0].points.nodes
                for one, given in zip(laid, poses, strict=True)
            ]
        )
        ways = np.linalg.norm(np.diff(lifts, axis=0), axis=-1)
        most[ease] = ways.max() / np.linalg.norm(lifts, axis=-1).max()
        rates = [
            one[0].velocities.nodes - given[0].velocities.nodes
            for one, given in zip(laid, poses, strict=True)
        ]
        step = 1.0 / shot.frames_per_second
        np.testing.assert_allclose(np.array(rates)[1:] * step, np.diff(lifts, axis=0), atol=1e-7)
        again = sinking(ease)[1]
        again.restore(memory)
        for pair, other in zip(laid[6:], lifted(shot, again, poses, 6)[0], strict=True):
            assert all(
                one.points.nodes.tobytes() == two.points.nodes.tobytes()
                for one, two in zip(pair, other, strict=True)
            )
    assert most[0.0] > 0.5
    step = 1.0 / shot.frames_per_second
    assert most[0.25] < 1.05 * step / (0.25 + step)


def test_what_will_be_lifted_again_within_the_ease_sinks_slowly():
    least = {}
    for ease in (0.0, 0.25):
        shot, plumage, poses = sinking(ease, when=(8, 9, 14, 15))
        laid, _ = lifted(shot, plumage, poses)
        lifts = [
            np.abs(one[0].points.nodes - given[0].points.nodes).max()
            for one, given in zip(laid, poses, strict=True)
        ]
        least[ease] = (min(lifts[9:15]) - lifts[0]) / (lifts[9] - lifts[0])
    assert least[0.0] < 0.5
    assert least[0.25] > 0.9


def test_a_feather_that_is_pushed_into_the_skin_is_laid_over_it():
    """It keeps from it what feathers keep from each other, not half a thickness alone."""
    shot = shingles(1)
    pose = next(iter(simulate(replace(shot, layers=None)))).poses[0]
    low = float(pose.points.nodes[..., 2].min())
    surfaces = SkinSurfaces((Sheet(low - 4e-3),), StageClock(frames_per_second=24.0), 1.0, "", "")
    shot = replace(shot, skin=surfaces.bind(shot.groom))
    drawn = build_feathers(shot.groom.feathers, shot.quality.rows, shot.quality.columns)
    plumage = layers.LayeredPlumage(shot, drawn, np.arange(1), 1)
    skin = plumage.skin(0.0)
    lay(plumage, [pose], skin, 0.0, 0.0)
    sunk = replace(pose, points=pose.points.shifted(np.array([0.0, 0.0, -8e-3])))
    laid = lay(plumage, [sunk], skin, 1.0, 1.0 / shot.frames_per_second)[0]
    before, after = (each.points.nodes[4:, :, 2] - skin[0, 2] for each in (sunk, laid))
    assert before.min() < -2e-3
    assert after.min() > 0.5 * THICKNESS + 0.9 * float(plumage.vanes.clear[0])


def test_what_has_left_the_skin_is_not_lifted_to_the_planes_of_its_faces():
    """As a wing does that opens: beside the edge of a skin, and below where it would go on."""
    shot = shingles(1)
    pose = next(iter(simulate(replace(shot, layers=None)))).poses[0]
    length = shot.groom.feathers[0].kind.length
    low = float(pose.points.nodes[..., 2].min()) - 4e-3
    shot = replace(
        shot,
        skin=SkinSurfaces((Sheet(low),), StageClock(frames_per_second=24.0), 1.0, "", "").bind(
            shot.groom
        ),
    )
    drawn = build_feathers(shot.groom.feathers, shot.quality.rows, shot.quality.columns)
    plumage = layers.LayeredPlumage(shot, drawn, np.arange(1), 1)
    skin = plumage.skin(0.0)
    lay(plumage, [pose], skin, 0.0, 0.0)
    gone = replace(pose, points=pose.points.shifted(np.array([0.0, 3.0, -0.5 * length])))
    laid = lay(plumage, [gone], skin, 1.0, 1.0 / shot.frames_per_second)[0]
    assert farthest(laid, gone) == 0.0


def test_no_feather_is_lifted_by_more_than_twice_its_length():
    """The report says how many were lifted as far as that. Rolled by 50 degrees a feather has to be
    lifted by 1 / cos 50 of how deep it is in the skin."""
    shot = shingles(1)
    drawn = build_feathers(shot.groom.feathers, shot.quality.rows, shot.quality.columns)
    one, length = shot.groom.feathers[0], float(np.diff(drawn[0].station).sum())
    rest = place(drawn[0].rest, one.position, one.rotation)
    rolled = place(drawn[0].rest, one.position, askew(one, 0, 50.0).rotation)
    low, none = float(rest.nodes[..., 2].min()) - 4e-3, both(np.zeros_like, rest)
    shot = replace(
        shot,
        skin=SkinSurfaces((Sheet(low),), StageClock(frames_per_second=24.0), 1.0, "", "").bind(
            shot.groom
        ),
    )
    plumage = layers.LayeredPlumage(shot, drawn, np.arange(1), 1)
    for k, (depth, own) in enumerate(((0.0, 1.0), (0.9, np.cos(np.radians(50.0))), (1.8, None))):
        points = (rolled if k else rest).shifted(np.array([0.0, 0.0, -depth * length]))
        pose = FeatherPose(points, none, none)
        laid = lay(plumage, [pose], plumage.skin(0.0), float(k), k / shot.frames_per_second)
        lift = farthest(laid[0], pose) / length
        assert lift == pytest.approx(depth / own, rel=0.1) if own else lift == pytest.approx(2.0)
        assert plumage.report()["feathers_at_limit"] == (0 if own else 1)


def test_no_feather_is_lifted_beyond_the_top_of_what_it_lies_over():
    """A steep feather, half as long, ends short of another, which sinks past its tip with those
    beneath it: under the steep one's plane as that goes on, but soon beside it. Lifted onto that
    plane it would be far above the tip, with all that lies on it, and stay there in the sample."""
    shot = shingles(6)
    over, under, *others = shot.groom.feathers
    steep, length = frames_from((0.57, 0.0, 0.82), (-0.82, 0.0, 0.57)), over.kind.length
    kind = adjusted(under.kind, Change(scale=0.5))
    under = replace(under, kind=kind, prototype=None, rotation=steep, position=np.zeros(3), rank=0)
    grid = shot.quality.rows, shot.quality.columns
    low = place(build_feathers((under,), *grid)[0].rest, under.position, under.rotation)
    high = low.rows()[-1, 0] + np.array([-0.17 * length, 0.0, 0.1 * length])
    way = np.array([0.02 * length, 0.0, -4.0 * THICKNESS])
    flat = [replace(each, position=high + (k + 6) * way) for k, each in enumerate(others)]
    feathers = (replace(over, position=high), under, *flat)
    shot = replace(shot, groom=replace(shot.groom, feathers=feathers))
    drawn, given = build_feathers(feathers, *grid), []
    for sunk in (0.0, 0.2 * length):
        poses = []
        for one, feather in zip(feathers, drawn, strict=True):
            down = (0.0, 0.0, 0.0 if one is under else sunk)
            points = place(feather.rest, one.position - down, one.rotation)
            poses.append(FeatherPose(points, *2 * (both(np.zeros_like, points),)))
        given.append(poses)
    plumage, none = layers.LayeredPlumage(shot, drawn, np.arange(len(drawn)), 1), np.zeros((0, 3))
    lay(plumage, given[0], none, 0.0, 0.0)
    laid = lay(plumage, given[1], none, 1.0, 1.0 / shot.frames_per_second)
    crossed = []
    for share in (1.0, 0.75):
        less = partial(np.average, axis=0, weights=(share, 1.0 - share))
        between = [
            replace(one, points=both(lambda *ends, less=less: less(ends), one.points, two.points))
            for one, two in zip(laid, given[1], strict=True)
        ]
        crossed.append(crossings(shot, SimpleNamespace(poses=between)))
    assert crossed[0] == 0 < crossed[1]
    assert plumage.report()["written_depth"]["worst"] < 0.5


class Ridge(Sheet):
    """A level square with a ridge across it, from one height to another, so wide at its foot."""

    def __init__(self, height: float, top: float, place: float, width: float) -> None:
        along = [(-1.0, height), (place - width, height), (place, top)]
        along += [(place + width, height), (1.0, height)]
        self.rest = np.array([[x, y, z] for x, z in along for y in (-1.0, 1.0)])
        pairs = [(2 * k, 2 * k + 1, 2 * k + 2, 2 * k + 3) for k in range(4)]
        self.triangles = np.array([t for a, b, c, d in pairs for t in ((a, c, b), (c, d, b))])
        self.face = np.arange(len(self.triangles))


def test_skin_does_not_pass_between_the_nodes_of_a_feather_that_lies_on_it():
    """A ridge between two rows at rest, where the shaft's nodes are above the skin."""
    shot = shingles(1)
    drawn = build_feathers(shot.groom.feathers, shot.quality.rows, shot.quality.columns)
    one = shot.groom.feathers[0]
    rest = place(drawn[0].rest, one.position, one.rotation)
    shaft = rest.nodes[:, 0]
    middle, apart = 0.5 * (shaft[5] + shaft[6]), abs(shaft[6, 0] - shaft[5, 0])
    low = float(shaft[5:7, 2].min()) - 1e-4
    surface = Ridge(low, middle[2] + 5e-4, middle[0], 0.2 * apart)
    shot = replace(
        shot,
        skin=SkinSurfaces((surface,), StageClock(frames_per_second=24.0), 1.0, "", "").bind(
            shot.groom
        ),
    )
    plumage, none = layers.LayeredPlumage(shot, drawn, np.arange(1), 1), both(np.zeros_like, rest)
    laid = lay(plumage, [FeatherPose(rest, none, none)], plumage.skin(0.0), 0.0, 0.0)[0]
    after = 0.5 * (laid.points.nodes[5, 0] + laid.points.nodes[6, 0])
    assert after[2] > middle[2] + 4.5e-4


def test_the_depth_that_is_told_is_where_a_feather_stays(tmp_path):
    (tmp_path / "groom.toml").write_text("""name = "two"
[[feather]]
id = "lower"
kind = "body_contour"
position = [0.00128, 0.0287, 0.08424]
direction = [0.3999, -1.6575, -1.0994]
up = [2.4178, 1.0283, -0.6709]
scale = 0.564
[[feather]]
id = "upper"
kind = "swan_secondary"
position = [-0.00613, -0.02805, 0.09497]
direction = [0.5638, 2.2113, -2.0266]
up = [2.0563, -1.9789, -1.5871]
scale = 0.419
""")
    (tmp_path / "shot.toml").write_text("""name = "two"
groom = "groom.toml"
frames = [1, 1]
quality = "draft"
[contact]
forces = false
""")
    shot = read_shot(tmp_path / "shot.toml")
    drawn, first = drawn_feathers(shot), shot.groom.feathers[0].rotation
    laid = layers.LayeredPlumage(shot, drawn, np.arange(2), 1)
    # askew, so that what lifts one feather takes it off the other's side
    turns = (1.641, -1.972, 2.346), (-0.174, 0.21, 2.501)
    places = (0.02334, 0.08227, 0.08828), (0.01916, 0.06388, 0.11837)
    posed = [
        place(feather.rest, np.array(at), vectors_to_frames(np.array(turn)) @ first)
        for feather, at, turn in zip(drawn, places, turns, strict=True)
    ]
    laid.ask([FeatherPose(points, points, points) for points in posed], np.zeros((0, 3)), 0.0)
    shown = stacked([pose.points for pose in laid.lay(1.0)])
    assert laid.lifts.lift.max() > 0.01
    # as if it had been simulated there
    pose, scratch = pose_like(shown, laid.vanes.present.shape), scratch_of(laid.vanes, 1)
    lift_points_of_all(laid.vanes, shown, pose, (0, 2))
    pairs = (0, 1), np.ones(1, dtype=np.int8)
    count = find_laps(laid.vanes, laid.stack, pose, 4.0, pairs, scratch.laps, scratch.seen)
    laps = scratch.laps[:count]
    within = laps["beside"] <= laid.vanes.half.sum()
    assert (laps["base"] - laps["clear"])[within].max(initial=0.0) == 0.0
    assert laid.report()["written_depth"]["worst"] == 0.0


@pytest.mark.parametrize("samples", [1, 3])
def test_what_a_lift_takes_to_others_is_laid_over_these_as_well(monkeypatch, samples):
    """One lies beneath a flat feather. Lifted off that, it comes beneath one on edge that it was
    beside before, and stayed there: nothing but its own lift had moved."""
    pairs, order = np.array([[0, 1], [0, 2]]), np.array([2, 1, 0])
    monkeypatch.setattr(layers, "stack_of", lambda *_: sorted_stack(pairs, order))
    shot, none = shingles(3), np.zeros((0, 3))
    poses = next(iter(simulate(replace(shot, layers=None)))).poses
    drawn = build_feathers(shot.groom.feathers, shot.quality.rows, shot.quality.columns)
    plumage, rest, length = layers.LayeredPlumage(shot, drawn, np.arange(3), 1), drawn[0].rest, 0.2
    edge = frames_from((1.0, 0.0, 0.0), (0.0, -0.7, 0.7))
    # boxes along the axes meet
    slant = frames_from((1.0, 0.0, 1.0), (-1.0, 0.0, 1.0))
    beneath = rest.shifted(np.array([0.0, 0.0, -0.2 * length]))
    beside = turned(edge.T, rest).shifted(length * (0.5 * edge[:, 0] + 0.1 * edge[:, 2]))
    there = [
        replace(pose, points=turned(slant.T, points))
        for pose, points in zip(poses, (beneath, rest, beside), strict=True)
    ]
    ways = [there] if samples == 1 else [poses, *[there] * (samples - 1)]
    for k, way in enumerate(ways):
        plumage.ask(list(way), none, 0.04 if k > 0 else 0.0)
    assert plumage.lifts.depths.max() < 0.5
    assert plumage.lifts.lift[0].max() > 0.25 * length
