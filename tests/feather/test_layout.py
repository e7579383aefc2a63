"""Feathers laid over each other at rest."""

from dataclasses import replace
from operator import attrgetter
from pathlib import Path

import numpy as np
import pytest
import trimesh
from places import SAMPLES
from scipy.optimize import minimize

import featherfx
from featherfx.algebra.rotation import frames_from
from featherfx.errors import InputError, InputWarning
from featherfx.feather.build import build_feather, distinct_shapes, scale_feather
from featherfx.feather.layout.layout import cover, laid_out, lay_out, measure_layout
from featherfx.feather.layout.overlap import segment_distance, shingle_pairs, strips_of
from featherfx.feather.shapes import build_feathers
from featherfx.files.disk_cache import nothing_kept
from featherfx.groom.keys.problems import Place, Problems
from featherfx.groom.presets.kinds import Change, adjusted, kind_of
from featherfx.groom.presets.presets import load_preset
from featherfx.groom.types import Groom, Layout, Placement
from featherfx.phases import Account
from featherfx.shot.loop.placement import place_feathers
from featherfx.shot.read.read import read_shot

CLEARANCE = 2e-4
SAMPLE = SAMPLES / "feather_pull" / "shot.toml"


@pytest.fixture(scope="module")
def kind():
    _, tree = load_preset("feather/body_contour")
    found = kind_of("body_contour", tree, Place("", "", Problems()))
    # 3 cm long, flat
    return adjusted(found, Change(scale=0.5, camber=-found.rachis.camber, hollow=-8.0))


def placed(kind, name, position, direction=(-1, 0, 0), **more):
    rotation = frames_from(direction, (0, 0, 1))
    return Placement(name, kind, "body", np.array(position, float), rotation, **more)


def groom_of(*feathers, skin=None, **limits):
    usual = {"clearance": CLEARANCE, "most_tilt": 30.0, "most_tilt_placed": 30.0, "most_lift": 1e-3}
    layout = Layout(**usual | limits)
    return Groom("g", Path("g.toml"), tuple(feathers), layout=layout, skin=skin)


def field(kind, rows=8, columns=6, step=0.008):
    """Feathers on a plane in staggered rows, combed along -x."""
    return [
        placed(kind, f"f{i}_{j}", (-step * i, 0.9 * step * (j + 0.5 * (i % 2)), 0.0))
        for i in range(rows)
        for j in range(columns)
    ]


def test_the_upstream_feather_lies_over(kind):
    feathers = [placed(kind, "down", (-0.01, 0, 0)), placed(kind, "up", (0, 0.001, 0))]
    pairs, order = shingle_pairs(strips_of(feathers))
    assert pairs.tolist() == [[1, 0]]
    assert order.tolist() == [0, 1]


def test_layers_and_stacks_go_before_places(kind):
    feathers = [
        placed(kind, "down", (-0.01, 0, 0), layer=1),
        placed(kind, "up", (0, 0.001, 0)),
    ]
    assert shingle_pairs(strips_of(feathers))[0].tolist() == [[0, 1]]
    feathers = [placed(kind, f"row{k}", (-0.001 * k, 0.004 * k, 0), stack=k + 1) for k in range(4)]
    assert all(upper > lower for upper, lower in shingle_pairs(strips_of(feathers))[0])


def test_what_lies_in_another_layer_does_not_disturb_the_order_within_one(kind):
    feathers = field(kind)
    x = np.array([each.position[0] for each in feathers])
    # combed against the others, over all of them
    against = [
        placed(kind, f"x{k}", (-0.008 * k, 0.02, 0.002), direction=(1, 0, 0), layer=1)
        for k in range(8)
    ]
    pairs, _ = shingle_pairs(strips_of([*feathers, *against]))
    upper, lower = pairs[(pairs < len(feathers)).all(axis=1)].T
    assert (np.abs(x[upper] - x[lower]) > 1e-3).sum() > 100
    assert (x[upper] > x[lower] - 1e-9).all()


def test_an_order_without_rings_and_no_far_pairs(kind):
    feathers = field(kind)
    pairs, order = shingle_pairs(strips_of(feathers))
    rank = np.argsort(order)
    assert (rank[pairs[:, 0]] > rank[pairs[:, 1]]).all()
    positions = np.array([f.position for f in feathers])
    way = positions[pairs[:, 1]] - positions[pairs[:, 0]]
    assert np.linalg.norm(way, axis=1).max() < 2 * kind.length
    # rows are 8 mm apart: whoever is a row further upstream lies over
    apart = np.abs(way[:, 0]) > 0.004
    assert (way[apart, 0] < 0).all()


def test_opposite_sides_of_a_wing_do_not_lie_over_each_other(kind):
    above = placed(kind, "above", (0, 0, 0.001))
    rotation = frames_from((-1, 0, 0), (0, 0, -1))
    below = replace(above, id="below", position=np.array([0, 0, -0.001]), rotation=rotation)
    assert len(shingle_pairs(strips_of([above, below]))[0]) == 0


def test_feathers_are_cleared(kind):
    before = measure_layout(groom_of(*field(kind)))
    assert (before.gaps < 0.5 * CLEARANCE).sum() > 100
    groom, report = laid_out(groom_of(*field(kind)))
    assert report.unresolved == ()
    assert report.gaps.min() > 0.9 * CLEARANCE
    assert np.abs(report.raised).max() < 30.0
    # the report is that of the groom that comes out
    assert np.allclose(np.sort(measure_layout(groom).gaps), np.sort(report.gaps), atol=1e-9)


def test_cleared_feathers_do_not_meet_as_meshes(kind):
    groom, _ = laid_out(groom_of(*field(kind, 4, 3)))
    meshes = []
    for feather in groom.feathers:
        (built,) = build_feathers([feather], 21, 6)
        vanes = built.surface.triangles[built.surface.part != 2]
        points = built.surface.points(built.points) @ feather.rotation.T + feather.position
        meshes.append(trimesh.Trimesh(points, vanes, process=False))
    depths = []
    for upper, lower in measure_layout(groom).pairs:
        # rays straight up from the lower feather's points have to meet the upper one above
        start, up = meshes[lower].vertices, groom.feathers[lower].rotation[:, 2]
        hits, rays, _ = meshes[upper].ray.intersects_location(
            start - 0.01 * up, np.tile(up, (len(start), 1))
        )
        depths.append(((hits - start[rays]) @ up).min(initial=np.inf))
    assert np.isfinite(depths).any()
    # the layout sees shapes on a coarser grid; the meshes are clear to a fifth of the clearance
    assert min(depths) > 0.2 * CLEARANCE


def test_threads_change_nothing(kind, monkeypatch):
    box = trimesh.creation.box((0.3, 0.3, 0.01)).apply_translation((0.0, 0.0, -0.0051))
    skin = np.array(box.vertices)[np.array(box.faces)]
    found = []
    for threads in (1, 3):
        monkeypatch.setattr("os.cpu_count", lambda threads=threads: threads)
        with nothing_kept():
            found.append(laid_out(groom_of(*field(kind), skin=skin))[1])
    for name in ("gaps", "skin_gaps", "raised", "rolled", "lifted", "shortened"):
        one, several = (getattr(each, name) for each in found)
        assert one.tobytes() == several.tobytes()


def test_a_change_moves_only_what_it_reaches(kind):
    """One that is rolled, in a corner of 120 that all hang together, moves another at most nearby,
    and leaves the rest of them to the last digit."""
    feathers = field(kind, 12, 10)
    turned = frames_from((-1, 0, 0), (0, 0.2, 1))
    changed = [replace(feathers[0], rotation=turned), *feathers[1:]]
    with nothing_kept():
        before, after = (laid_out(groom_of(*each))[0].feathers for each in (feathers, changed))
    same = np.array(
        [
            one.position.tobytes() == other.position.tobytes()
            and one.rotation.tobytes() == other.rotation.tobytes()
            for one, other in zip(before, after, strict=True)
        ]
    ).reshape(12, 10)
    assert not same[0, 0]
    assert same[4:].all()
    assert same[:, 5:].all()


def test_what_lies_beneath_stays_where_it_is(kind):
    """Where feathers push those beneath, one laid on top moves 6 others."""
    feathers = field(kind)
    top = replace(feathers[7], id="top", layer=1)
    with nothing_kept():
        before, after = (laid_out(groom_of(*each))[0] for each in (feathers, [*feathers, top]))
    *beneath, above = after.feathers
    for one, other in zip(before.feathers, beneath, strict=True):
        assert one.rotation.tobytes() == other.rotation.tobytes()
        assert one.position.tobytes() == other.position.tobytes()
    assert not np.array_equal(above.rotation, top.rotation)


def test_a_layout_that_is_kept_is_that_of_the_feathers_as_they_are(kind):
    """Sizes of a shape, places and layers are looked at; what no layout depends on is not."""
    feathers = [replace(each, prototype=kind) for each in field(kind)]
    large = adjusted(kind, Change(scale=1.1))
    others = [
        replace(feathers[7], kind=large, size=1.1),
        replace(feathers[7], position=feathers[7].position + 0.002),
        replace(feathers[7], layer=1),
        replace(feathers[7], mirrored=True),
    ]
    laid_out(groom_of(*feathers))
    for other in others:
        groom = groom_of(*feathers[:7], other, *feathers[8:])
        with nothing_kept():
            anew = laid_out(groom)[1]
        kept = laid_out(groom)[1]
        assert kept.raised.tobytes() == anew.raised.tobytes()
        assert kept.lifted.tobytes() == anew.lifted.tobytes()


def test_the_skin_is_cleared(kind):
    sphere = trimesh.creation.icosphere(4, radius=0.1)
    corners = np.array(sphere.vertices)[np.array(sphere.faces)]
    bent = adjusted(kind, Change(camber=60.0))
    feather = placed(bent, "a", (0, 0, 0.1))
    before = measure_layout(groom_of(feather, skin=corners))
    assert before.skin_gaps[0] < -1e-3
    _, report = laid_out(groom_of(feather, skin=corners))
    assert report.skin_gaps[0] > 0.8 * CLEARANCE
    assert report.raised[0] > 5.0


@pytest.mark.parametrize("height", [0.002, 0.008])
def test_a_grown_feather_is_not_pierced_by_the_skin_between_its_samples(kind, height):
    """A needle that no sample is over: the feather is raised, or left out where that is high."""
    base = 1e-4 * np.array([[-1, -1, 0], [1, -1, 0], [0, 1, 0]]) + (-0.0112, 0.0017, -0.01)
    apex = np.array([-0.0112, 0.0017, height])
    needle = [[base[0], base[1], apex], [base[1], base[2], apex], [base[2], base[0], apex]]
    corners = np.array([*needle, [(0.05, -0.05, -0.01), (0.05, 0.05, -0.01), (-0.1, 0, -0.01)]])
    feather = placed(kind, "a", (0, 0, 0), grown=True)

    def pierced(groom):
        (built,) = build_feathers(groom.feathers, 21, 6)
        vanes = built.surface.triangles[built.surface.part != 2]
        points = built.surface.points(built.points) @ groom.feathers[0].rotation.T
        vane = trimesh.Trimesh(points + groom.feathers[0].position, vanes, process=False)
        hits, _, _ = vane.ray.intersects_location([base.mean(axis=0)], [(0.0, 0.0, 1.0)])
        return hits[:, 2].min(initial=np.inf) < height

    groom = groom_of(feather, skin=corners, most_lift=0.0)
    assert measure_layout(groom).skin_gaps[0] > 0.0
    assert pierced(groom)
    result, report = laid_out(limited(groom, drop=1e-4, least_size=0.9))
    if height < 0.005:
        assert report.dropped == ()
        assert not pierced(result)
    else:
        assert report.dropped == ("a",)


def test_what_cannot_be_resolved_is_reported(kind):
    feathers = field(kind)
    limits = {"most_tilt_placed": 0.0, "most_lift": 0.0}
    groom, report = laid_out(groom_of(*feathers, **limits))
    assert len(report.unresolved) == (report.gaps < 0).sum() > 0
    assert report.unresolved[0].depth == pytest.approx(-report.gaps.min())
    assert all(
        np.array_equal(a.rotation, b.rotation)
        for a, b in zip(groom.feathers, feathers, strict=True)
    )
    with pytest.warns(InputWarning, match="still pass through each other"):
        lay_out(groom_of(*feathers, **limits))


def crossing(kind):
    """A placed feather, and a grown one of a lower layer whose tip passes through it."""
    above = placed(kind, "placed", (0, 0, 0.0), layer=1)
    below = placed(kind, "grown", (0.015, 0, -0.002), (-1, 0, 0.25), grown=True)
    return groom_of(above, below, most_tilt=0.0, most_tilt_placed=0.0, most_lift=0.0)


def limited(groom, **limits):
    return replace(groom, layout=replace(groom.layout, **limits))


def test_a_grown_feather_is_shortened_until_it_is_clear(kind):
    groom = crossing(kind)
    assert laid_out(groom)[1].unresolved[0].depth > 1e-3
    result, report = laid_out(limited(groom, least_size=0.2))
    assert report.unresolved == report.dropped == ()
    assert report.shortened[0] == 1.0
    assert 0.2 < report.shortened[1] < 1.0
    short = result.feathers[1]
    assert short.kind.length == pytest.approx(report.shortened[1] * kind.length)
    found = scale_feather(build_feather(short.prototype, 5, 2, False), short.size)
    assert found.points == pytest.approx(build_feather(short.kind, 5, 2, False).points)
    # no shorter than allowed
    _, report = laid_out(limited(groom, least_size=0.95))
    assert report.shortened[1] == pytest.approx(0.95)
    assert report.unresolved


def test_a_grown_feather_that_does_not_come_clear_is_dropped(kind):
    groom = crossing(kind)
    result, report = laid_out(limited(groom, drop=1e-4))
    assert [f.id for f in result.feathers] == ["placed"]
    assert report.dropped == ("grown",)
    assert report.unresolved == ()
    with pytest.warns(InputWarning, match="1 feathers that did not come clear are left out: grown"):
        lay_out(limited(groom, drop=1e-4))
    # a depth below the limit is kept and told, and placed feathers always are
    assert laid_out(limited(groom, drop=0.1))[1].dropped == ()
    both = replace(groom, feathers=tuple(replace(f, grown=False) for f in groom.feathers))
    assert laid_out(limited(both, drop=1e-4, least_size=0.2))[1].unresolved


def test_few_are_dropped_where_one_is_in_the_way_of_many(kind):
    feathers = [replace(f, grown=True) for f in field(kind, 4, 4)]
    spike = placed(kind, "spike", (-0.01, 0.01, -0.004), (0, 0.3, 1), grown=True, layer=1)
    limits = {"most_tilt": 30.0, "drop": 2e-4}
    _, report = laid_out(
        groom_of(*feathers, replace(spike, rotation=frames_from((-1, 0, 0.6), (0, 0, 1))), **limits)
    )
    assert report.unresolved == () or report.unresolved[0].depth <= 2e-4
    # two that are deep, and one whose mesh alone is pierced, between samples
    assert len(report.dropped) <= 3


def test_feathers_are_shortened_before_they_are_dropped(kind):
    """Where what still crosses after the rounds of shortening is dropped at once, 15 are."""
    dropped = 0
    for seed in range(3):
        random = np.random.default_rng(seed)
        places = random.uniform(0.0, 0.03, (24, 2))
        turns, rises = random.uniform(-1.0, 1.0, 24), random.uniform(-0.3, 0.3, 24)
        ways = np.column_stack([-np.cos(turns), np.sin(turns), rises])
        feathers = [
            placed(kind, f"r{k}", (*place, 0.0), way, grown=True)
            for k, (place, way) in enumerate(zip(places, ways, strict=True))
        ]
        _, report = laid_out(groom_of(*feathers, most_tilt=10.0, drop=2e-4, least_size=0.3))
        assert report.unresolved == ()
        assert min(report.shortened) >= 0.3 - 1e-12
        dropped += len(report.dropped)
    assert dropped <= 12


@pytest.mark.parametrize("drop", [None, 1e-4])
def test_the_time_left_is_told(kind, drop):
    told = []
    with nothing_kept(), Account(told.append):
        laid_out(limited(groom_of(*field(kind)), drop=drop))
    parts = [each for each in told if each.name == "layout"]
    done = [each.done for each in parts]
    assert done == sorted(done)
    assert [each.left is None for each in parts] == [number < 2 for number in range(len(parts))]
    assert parts[-1].ended
    assert parts[-1].done == parts[-1].total


def test_no_layout_changes_nothing(kind):
    groom = replace(groom_of(*field(kind, 2, 2)), layout=None)
    assert laid_out(groom) == (groom, None)


def test_cover_of_one_and_of_two(kind):
    one, two = placed(kind, "a", (0, 0, 0)), placed(kind, "b", (0, 0, 0.001))
    assert cover(groom_of(one)) == 1.0
    # the vanes' maps leave out a rim of less than a node
    assert 1.9 < cover(groom_of(one, two)) <= 2.0


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


def test_a_shot_is_read_as_written_and_its_feathers_are_placed_after_that(tmp_path):
    (tmp_path / "groom.toml").write_text(ROW)
    (tmp_path / "shot.toml").write_text('name = "s"\ngroom = "groom.toml"\nframes = [1, 2]\n')
    shot = read_shot(tmp_path / "shot.toml")
    assert all(
        np.array_equal(f.rotation, shot.groom.feathers[0].rotation) for f in shot.groom.feathers
    )
    placed_shot = featherfx.read_shot(tmp_path / "shot.toml")
    assert [f.rank for f in placed_shot.groom.feathers] == [5, 4, 3, 2, 1, 0]
    for a, b in zip(placed_shot.groom.feathers, lay_out(shot.groom).feathers, strict=True):
        assert np.array_equal(a.rotation, b.rotation)
        assert np.array_equal(a.position, b.position)


@pytest.mark.filterwarnings("ignore:.*are left out")
def test_a_feather_that_is_left_out_cannot_be_gripped(kind):
    shot = replace(read_shot(SAMPLE), groom=limited(crossing(kind), drop=1e-4))
    (grip,) = shot.grips
    gripped = replace(shot, grips=(replace(grip, feather="placed"),))
    assert [f.id for f in place_feathers(gripped).groom.feathers] == ["placed"]
    with pytest.raises(InputError) as caught:
        place_feathers(replace(shot, grips=(*gripped.grips, replace(grip, feather="grown"))))
    assert [problem.key for problem in caught.value.problems] == ["grip[1].feather"]
