"""Coat space: fields over a skin, leaves that never meet, feathers drawn on them."""

from dataclasses import replace

import numpy as np
import pytest
from feather_kinds import feather_kind

from featherfx.algebra.triangulation import make_elements, make_stiffness, weld
from featherfx.coat.carrier import pose_carrier
from featherfx.coat.coat import (
    Overlaps,
    describe_doubts,
    draw,
    find_overlaps,
    fit_ties,
    grow_coat,
    make_plane_forms,
    stack,
)
from featherfx.coat.fields import Follicles
from featherfx.coat.leaf_kernels import trace
from featherfx.feather.build import build_feather
from featherfx.groom.skin.skin import closest
from featherfx.groom.types import BarbGuide, VaneShape

LENGTH = 0.03
VANE = VaneShape(
    ((0.0, 0.0), (0.2, 0.15), (0.6, 0.2), (0.9, 0.1), (1.0, 0.0)),
    (BarbGuide(0.0, 60.0, 20.0), BarbGuide(1.0, 30.0, 10.0)),
)


def contour_kind(sweep=0.0):
    turning = {"camber": 0.0, "sweep": sweep, "twist": 0.0}
    return feather_kind(VANE, VANE, length=LENGTH, calamus=0.1, **turning)


def grid(shape, size, lift=lambda x, y: 0.0 * x):
    """Return points and triangles of a height field over a rectangle, (0, 0) to size."""
    x, y = (np.linspace(0.0, s, n) for s, n in zip(size, shape, strict=True))
    x, y = np.meshgrid(x, y, indexing="ij")
    points = np.stack([x, y, lift(x, y)], axis=-1).reshape(-1, 3)
    number = np.arange(shape[0] * shape[1]).reshape(shape)
    a, b, c, d = number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:]
    faces = np.stack([np.stack([a, b, c], -1), np.stack([a, c, d], -1)]).reshape(-1, 3)
    return points, faces


def follicles(points, faces, places, headings):
    """Return follicles at the places of a skin that are nearest to some (F, 3)."""
    triangle, place = closest(places, points[faces])
    count = len(places)
    return Follicles(
        triangle=triangle,
        place=place,
        position=np.einsum("fk,fkc->fc", place, points[faces][triangle]),
        heading=headings,
        lateral=np.cross([0.0, 0.0, 1.0], headings),
        length=np.full(count, LENGTH),
        width=np.full(count, 0.4 * LENGTH),
        depth=np.full(count, 2e-4),
    )


def forms_of(count, rows=21, columns=4):
    feather = build_feather(contour_kind(), rows, columns)
    arrays = feather.rest.nodes, feather.rest.directors, np.array(0.1 * LENGTH)
    return make_plane_forms(*(np.repeat(each[None], count, axis=0) for each in arrays))


def coat_on(points, faces, spacing=0.006, margin=0.02):
    """Return a coat whose feathers point along x all over a height field."""
    low, high = points.min(axis=0) + margin, points.max(axis=0) - margin
    x, y = (np.arange(a, b, spacing) for a, b in zip(low[:2], high[:2], strict=True))
    x, y = (each.ravel() for each in np.meshgrid(x, y))
    jitter = np.random.default_rng(3).uniform(-0.3, 0.3, (2, len(x))) * spacing
    places = np.stack([x + jitter[0], y + jitter[1], 0.0 * x], axis=1)
    headings = np.tile([1.0, 0.0, 0.0], (len(places), 1))
    return grow_coat(points, faces, follicles(points, faces, places, headings))


FLAT = grid((61, 41), (0.24, 0.12))
HILL = grid((61, 41), (0.24, 0.12), lambda x, y: 0.03 * np.sin(9.0 * x) - 6.0 * (y - 0.06) ** 2)


@pytest.mark.parametrize("skin", [FLAT, HILL])
def test_lengths_are_those_of_the_plane_form(skin):
    coat = coat_on(*skin)
    forms = forms_of(len(coat.values))
    drawn = draw(coat, coat.rest, forms)
    chords = np.linalg.norm(np.diff(drawn.nodes[:, :, 0], axis=1), axis=2)
    assert np.abs(chords / forms.steps - 1.0).max() < 1e-9
    for side in range(2):
        own = drawn.nodes[:, :, 1 + 4 * side : 5 + 4 * side]
        line = np.concatenate([drawn.nodes[:, :, :1], own], axis=2)
        pieces, wanted = np.linalg.norm(np.diff(line, axis=2), axis=3), forms.pieces[:, side]
        assert np.abs(pieces - wanted).max() < 1e-9 * LENGTH
    frames = np.concatenate(
        [np.cross(drawn.directors[:, :, 0], drawn.directors[:, :, 1])[:, :, None], drawn.directors],
        axis=2,
    )
    assert np.abs(frames @ frames.transpose(0, 1, 3, 2) - np.eye(3)).max() < 1e-9


def test_phi_is_the_way_along_a_steady_flow():
    coat = coat_on(*FLAT)
    x = coat.mesh.points[:, 0]
    inner = (x > 0.05) & (x < 0.19)
    slope = np.polyfit(x[inner], coat.fields.phi[inner], 1)[0]
    assert slope == pytest.approx(1.0, abs=0.01)
    assert coat.fields.gain[inner] == pytest.approx(LENGTH, rel=0.02)
    assert describe_doubts(coat) == []


def test_a_coat_is_thicker_where_more_feathers_need_room():
    thin, thick, bent = (
        coat_on(*skin, spacing=spacing).fields.thickness.mean()
        for skin, spacing in ((FLAT, 0.02), (FLAT, 0.005), (HILL, 0.005))
    )
    assert 0.05 * LENGTH < thin < thick < bent < 0.1 * LENGTH


def test_a_plane_form_stays_itself_on_a_flat_leaf():
    """Far downstream of its root a leaf is nearly flat: what is drawn there is the plane form."""
    coat = coat_on(*FLAT)
    thin = replace(coat, fields=coat.fields._replace(thickness=1e-7 + 0.0 * coat.fields.phi))
    thin = replace(thin, depths=0.0 * coat.depths)
    feather = build_feather(contour_kind(20.0), 21, 4)
    arrays = (feather.rest.nodes, feather.rest.directors, np.array(0.1 * LENGTH))
    middle = np.argmin(np.linalg.norm(coat.follicles.position - [0.12, 0.06, 0.0], axis=1))
    drawn = draw(thin, coat.rest, make_plane_forms(*(a[None] for a in arrays)), np.array([middle]))
    wanted = feather.rest.nodes + drawn.nodes[0, 0, 0]
    assert np.abs(drawn.nodes[0, ..., :2] - wanted[..., :2]).max() < 2e-6


def test_who_starts_upstream_lies_higher():
    """Leaves of different values never meet, whatever the skin does."""
    coat = coat_on(*HILL)
    forms, number = forms_of(1), np.array([len(coat.values) // 2])
    heights = []
    for earlier in np.linspace(0.0, 0.02, 9):
        own = replace(coat, values=coat.values - earlier, depths=0.0 * coat.depths)
        drawn = draw(own, coat.rest, forms, number)
        heights.append(drawn.places[0].ravel())
    assert (np.diff(heights, axis=0) > 0.0).all()


def test_follicles_lie_in_the_skin_and_vanes_above_it():
    coat = coat_on(*FLAT)
    drawn = draw(coat, coat.rest, forms_of(len(coat.values)))
    assert drawn.nodes[:, 0, 0, 2] == pytest.approx(-2e-4, abs=5e-5)
    shown = forms_of(1).sunk[0] == 0.0
    assert drawn.nodes[:, shown][..., 2].min() > 1e-4


def test_ties_keep_overlapping_values_a_gap_apart():
    rng = np.random.default_rng(5)
    values, count = rng.uniform(0.0, 0.03, 300), 900
    pairs = np.unique(np.sort(rng.integers(0, 300, (count, 2)), axis=1), axis=0)
    pairs = pairs[pairs[:, 0] < pairs[:, 1]]
    gaps = rng.uniform(0.5e-4, 2e-4, len(pairs))
    fit = fit_ties(values, np.full(300, LENGTH), Overlaps(pairs, gaps))
    apart = np.abs(np.diff(fit.values[pairs], axis=1)[:, 0])
    assert (fit.shares == 1.0).all()
    assert (apart >= gaps * (1.0 - 1e-6)).all()
    # a crowd without room keeps a smaller gap, which is told
    crowd = np.stack(np.triu_indices(80, 1), axis=1)
    tight = fit_ties(np.zeros(80), np.full(80, LENGTH), Overlaps(crowd, np.full(len(crowd), 1e-3)))
    assert (tight.shares < 1.0).any()
    assert tight.shares.min() > 0.5 * np.median(tight.shares) > 0.05
    assert np.abs(tight.values).max() <= 0.36 * LENGTH


def test_stacked_leaves_are_apart_where_feathers_overlap():
    """By the gap over the rise of a leaf, T / q."""
    coat = coat_on(*FLAT, spacing=0.01)
    forms, fields = forms_of(len(coat.values), columns=3), coat.fields
    stacked, report = stack(coat, forms)
    assert report.pairs > len(coat.values)
    assert (report.shares == 1.0).all()
    drawn, covered = draw(coat, coat.rest, forms), forms.sunk > 0.0
    pairs = find_overlaps(drawn, covered, fields, coat.mesh.faces).pairs
    least = fields.gap.min() / (fields.thickness / fields.gain).max()
    before, after = (np.abs(np.diff(v[pairs])).min() for v in (coat.values, stacked.values))
    assert before < 0.1 * least < least <= after


@pytest.mark.parametrize("angle", [3.0, 15.0, 40.0])
def test_feathers_deviate_as_far_as_their_leaves_have_room(angle):
    """Tilts and rolls that differ at random keep every two that overlap in order, all along."""
    points, faces = FLAT
    x, y = (each.ravel() for each in np.mgrid[0.02:0.2:0.01, 0.02:0.1:0.01])
    tilt, roll = np.radians(angle) * np.random.default_rng(8).normal(size=(2, len(x)))
    tilt, roll = np.clip(tilt, -1.2, 1.2), np.clip(roll, -1.2, 1.2)
    heading = np.stack([np.cos(tilt), 0.0 * tilt, np.sin(tilt)], axis=1)
    places = np.stack([x, y, 0.0 * x], axis=1)
    own = follicles(points, faces, places, heading)
    side = np.stack([0.0 * roll, np.cos(roll), np.sin(roll)], axis=1)
    coat, forms = grow_coat(points, faces, own._replace(lateral=side)), forms_of(len(x))
    stacked, _ = stack(coat, forms)
    lift, rolled = stacked.deviations.T
    assert lift.max() > 0.0
    assert (np.abs(rolled) <= np.abs(coat.deviations[:, 1])).all()
    fields = coat.fields
    flat = draw(replace(stacked, deviations=0.0 * stacked.deviations), coat.rest, forms)
    overlaps = find_overlaps(flat, forms.sunk > 0.0, fields, coat.mesh.faces)
    swap = np.argsort(stacked.values[overlaps.pairs], axis=1)
    upper, lower = np.take_along_axis(overlaps.pairs, swap, axis=1).T
    apart = (stacked.values[lower] - stacked.values[upper]) / fields.gain.mean()
    for high in np.linspace(0.3, 1.1, 9):
        low = np.maximum(high - apart, 0.0)
        rise = fields.thickness.mean() * (high - low)
        assert (rise + lift[upper] * high**2 - lift[lower] * low**2 > 0.5 * rise).all()


def test_a_coat_goes_with_its_skin():
    """Turned and moved as a whole, it is the same coat."""
    coat = coat_on(*HILL)
    forms = forms_of(len(coat.values), rows=11, columns=2)
    turn = np.linalg.qr(np.random.default_rng(2).normal(size=(3, 3)))[0]
    turn *= np.sign(np.linalg.det(turn))
    still = draw(coat, coat.rest, forms)
    moved = pose_carrier(coat.mesh, coat.mesh.points @ turn.T + [0.3, -2.0, 0.7])
    there = draw(coat, moved, forms)
    assert np.abs(there.nodes - (still.nodes @ turn.T + [0.3, -2.0, 0.7])).max() < 1e-8
    assert np.abs(there.directors - still.directors @ turn.T).max() < 1e-6


def test_a_carrier_fills_creases_and_lies_on_the_skin():
    points, faces = grid((61, 41), (0.24, 0.12), lambda x, y: 0.004 * np.abs(y - 0.06) / 0.06)
    coat = coat_on(points, faces)
    above = coat.rest.points[:, 2] - points[:, 2]
    inner = ((points[:, :2] > 0.03) & (points[:, :2] < [0.21, 0.09])).all(axis=1)  # of its reach
    assert above[inner].min() > -1e-5
    away = np.abs(points[:, 1] - 0.06)
    assert above[away < 1e-9].mean() > 5.0 * np.abs(above[inner & (away > 0.02)]).mean()


def test_feathers_go_straight_on_over_a_border():
    points, faces = FLAT
    places = np.array([[0.225, 0.05 + 0.001 * k, 0.0] for k in range(20)])
    headings = np.tile([1.0, 0.0, 0.0], (20, 1))
    coat = grow_coat(points, faces, follicles(points, faces, places, headings))
    drawn = draw(coat, coat.rest, forms_of(20))
    assert drawn.nodes[:, -1, 0, 0].min() > 0.225 + 0.95 * LENGTH
    tips = drawn.nodes[:, -1, 0] - drawn.nodes[:, -3, 0]
    assert np.degrees(np.arcsin(tips[:, 2] / np.linalg.norm(tips, axis=1))).max() < 10.0


@pytest.mark.parametrize("y", np.linspace(0.0521, 0.0679, 9))
def test_a_line_goes_straight_on_over_triangles_that_lie_upside_down(y):
    """As meshes from volumes have some: there it goes back, and then on as before."""
    coat = coat_on(*FLAT)
    points = coat.rest.points.copy()
    middle = np.linalg.norm(points - [0.12, 0.06, points[0, 2]], axis=1).argmin()
    points[middle] += [0.0055, 0.0007, 1e-5]  # of edges 4 mm by 3 mm
    elements = make_elements(points, coat.mesh.faces)
    assert (elements.normals[:, 2] < 0.0).sum() > 1
    arrays = coat.arrays(replace(coat.rest, points=points, elements=elements))
    triangle, place = closest(np.array([[0.11, y, points[0, 2]]]), points[coat.mesh.faces])
    there, b, d, left = trace(arrays, triangle[0], tuple(place[0]), (1.0, 0.0, 0.0), 0.03)
    end = np.array(b) @ points[coat.mesh.faces[there]]
    np.testing.assert_allclose(end[1], y, atol=2e-5)
    assert 0.13 < end[0] < 0.1401
    assert left == 0.0
    np.testing.assert_allclose(d, [1.0, 0.0, 0.0], atol=2e-2)


def test_a_flow_that_meets_itself_is_reported_with_its_place():
    points, faces = FLAT
    places = np.array(
        [[x, y, 0.0] for x in (0.114, 0.118, 0.122, 0.126) for y in (0.05, 0.06, 0.07)]
    )
    headings = np.where(places[:, :1] < 0.12, 1.0, -1.0) * [1.0, 0.0, 0.0]
    around = follicles(points, faces, places, headings)
    (doubt,) = describe_doubts(grow_coat(points, faces, around))
    assert "singular" in doubt
    assert "(0.1" in doubt


@pytest.mark.parametrize("angle", [60.0, 67.0, 75.0])
def test_flows_that_meet_run_along_their_ridge(angle):
    """Feathers from both sides of a line point across it; far from it they keep their flow."""
    points, faces = FLAT
    x, y = np.meshgrid(np.arange(0.03, 0.2, 0.007), np.arange(0.01, 0.115, 0.007))
    x, y = x.ravel(), y.ravel()
    across = np.sin(np.radians(angle)) * np.where(y < 0.06, 1.0, -1.0)
    headings = np.stack([np.full(len(x), np.cos(np.radians(angle))), across, 0.0 * x], axis=1)
    places = np.stack([x, y, 0.0 * x], axis=1)
    found = grow_coat(points, faces, follicles(points, faces, places, headings)).follicles.heading
    off = np.degrees(np.arcsin(np.abs(found[:, 1])))
    near, far = np.abs(y - 0.06) < 0.2 * LENGTH, np.abs(y - 0.06) > 1.2 * LENGTH
    assert off[near].max() < 0.8 * angle
    assert np.abs(off[far] - angle).max() < 10.0
    assert found[:, 0].min() > 0.0


def test_elements_know_linear_functions():
    points, faces = HILL
    elements = make_elements(points, faces)
    slopes = np.einsum("tki,tk->ti", elements.gradients, points[faces] @ [2.0, -1.0, 0.5])
    own = np.array([2.0, -1.0, 0.5])
    flat = own - (elements.normals @ own)[:, None] * elements.normals
    assert np.abs(slopes - flat).max() < 1e-9
    assert np.abs(make_stiffness(elements, faces).sum(axis=0)).max() < 1e-9
    welded, triangles = weld(points[faces])
    assert (welded[triangles] == points[faces]).all()
    assert len(welded) == len(points)
