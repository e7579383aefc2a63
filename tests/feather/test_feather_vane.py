"""Tracing barbs to the outline, and what is said about vanes that cannot be built."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from feather_kinds import LEADING_VANE, NO_VANE, SWAN_PRIMARY, TRAILING_VANE, feather_kind

from featherfx.errors import InputError
from featherfx.feather.barbs import (
    describe_outline_fault,
    distance_outside,
    interpolate_guides,
    outline_curve,
    ray_lengths,
)
from featherfx.feather.build import build_feather
from featherfx.feather.types import LEADING, TRAILING
from featherfx.groom.presets.kinds import Change, adjusted
from featherfx.groom.types import BarbGuide, VaneShape

FLAT = {"camber": 0.0, "sweep": 0.0, "twist": 0.0}
BAND = ((0.0, 0.1), (1.0, 0.1))


def vane(outline, *guides) -> VaneShape:
    return VaneShape(outline, tuple(BarbGuide(*guide) for guide in guides))


def messages(kind, rows=21, columns=6) -> list[str]:
    with pytest.raises(InputError) as caught:
        build_feather(kind, rows, columns)
    return [str(problem) for problem in caught.value.problems]


def test_the_outline_passes_through_its_points_in_order():
    control = LEADING_VANE.outline
    curve = outline_curve(control)
    gaps = np.linalg.norm(curve[:, None] - np.array(control), axis=-1)
    assert np.all(gaps.min(axis=0) < 1e-15)
    assert np.all(np.diff(gaps.argmin(axis=0)) > 0)
    assert curve[:, 1].min() >= 0.0


def test_a_blunt_outline_is_closed_to_the_rachis():
    curve = outline_curve(BAND)
    assert tuple(curve[0]) == (0.0, 0.0)
    assert tuple(curve[-1]) == (1.0, 0.0)
    inside, beyond = np.array([[0.5, 0.05]]), np.array([[0.5, 0.13], [1.2, 0.05]])
    assert distance_outside(curve, inside) == pytest.approx(0.0)
    assert distance_outside(curve, beyond) == pytest.approx([0.03, 0.2])


def test_a_rounded_tip_leads_a_blunt_outline_to_the_rachis():
    square, rounded = outline_curve(BAND), outline_curve(BAND, 0.2)
    assert tuple(rounded[-1]) == (1.0, 0.0)
    # an ellipse with half axes 0.2 and 0.1, and before it the outline as drawn
    x, y = rounded[1:].T
    wanted = 0.1 * np.sqrt(1.0 - np.clip((x - 0.8) / 0.2, 0.0, 1.0) ** 2)
    np.testing.assert_allclose(y, wanted, atol=1e-8)
    # in steps that leave no facet: none reaches over a twentieth of the half axis
    assert np.diff(y[x > 0.8]).min() > -0.05 * 0.1
    assert np.array_equal(outline_curve(BAND, 0.0), square)
    pointed = LEADING_VANE.outline
    assert np.array_equal(outline_curve(pointed, 0.2), outline_curve(pointed))


def sharpest_turn(shape, rows):
    """Largest turn, deg, of the vane's edge from one barb's end to the next, in the lower half."""
    feather = build_feather(feather_kind(shape, NO_VANE, calamus=0.0, **FLAT), rows, 1)
    ends = feather.points[:, 3, :2]
    ends = ends[feather.barb_length[LEADING] > 0.0]
    heading = np.unwrap(np.arctan2(*np.diff(ends, axis=0).T[::-1]))
    turns = np.abs(np.degrees(np.diff(heading)))
    return turns[: rows // 2].max()


def test_a_rounded_base_has_no_corner_where_the_first_barb_would_cut_the_outline():
    # steeper at its base than barbs of 45 degrees, which cut it off
    steep = ((0.0, 0.0), (0.05, 0.2), (0.5, 0.25), (1.0, 0.0))
    square = vane(steep, (0.0, 45.0, 0.0, 0.0))
    rounded = replace(square, rounded_base=0.2)
    first = {"rows": 41, "columns": 1}
    lengths = [
        build_feather(feather_kind(each, NO_VANE, calamus=0.0, **FLAT), **first).barb_length[0]
        for each in (square, rounded)
    ]
    place = np.linspace(0.0, 1.0, 41)
    assert lengths[0][0] > 0.05
    assert lengths[1][0] == 0.0
    # an ellipse's quarter of the way to the outline, and all of it beyond
    way = np.minimum(place / 0.2, 1.0)
    np.testing.assert_allclose(lengths[1], lengths[0] * np.sqrt(way * (2.0 - way)), atol=1e-12)
    # a smooth edge turns half as much at twice the rows
    assert sharpest_turn(rounded, 161) < 0.6 * sharpest_turn(rounded, 81)
    assert sharpest_turn(rounded, 161) < 8.0


def test_rays_end_at_the_first_edge_they_meet():
    curve = outline_curve(BAND)
    root = np.array([0.0, 0.5, 0.95, 1.0, 1.1, -0.1])
    angle = np.full(6, np.pi / 4)
    expected = [0.1 * np.sqrt(2), 0.1 * np.sqrt(2), 0.05 * np.sqrt(2), 0.0, 0.0, 0.0]
    np.testing.assert_allclose(ray_lengths(curve, root, angle, 1e-9), expected, atol=1e-12)


def test_flat_barbs_end_on_the_outline_after_turning_by_their_curl():
    curl = 40.0
    shape = vane(BAND, (0.0, 70.0, curl, 0.0))
    feather = build_feather(feather_kind(shape, NO_VANE, **FLAT), 21, 10)
    row = 8
    barb = feather.rest.nodes[row, :11]
    assert barb[-1, 1] == pytest.approx(0.035, rel=1e-12)
    step = np.diff(barb, axis=0)
    heading = np.degrees(np.arctan2(step[:, 1], step[:, 0]))
    np.testing.assert_allclose(np.diff(heading), -curl / 10, atol=1e-9)
    assert heading[0] == pytest.approx(70.0 - curl / 20)


def test_barb_camber_turns_both_vanes_towards_ventral():
    shape = vane(BAND, (0.0, 60.0, 0.0, 20.0))
    feather = build_feather(feather_kind(shape, shape, **FLAT), 21, 6)
    for side in (LEADING, TRAILING):
        ends = feather.rest.nodes[4:12, (side + 1) * 6]
        length = feather.barb_length[side, 4:12]
        np.testing.assert_allclose(ends[:, 2], -length * np.sin(np.radians(10.0)), rtol=1e-2)


def off_a_wrapped_sheet(sweep, twist=0.0):
    """m, at most, of a vane off a surface of revolution about a line along its root, over the
    height of it at its edge. Its base is rounded and its shaft arched."""
    radius, arch = 0.35 / 3.0, np.radians(24.0) / 0.35
    outline = ((0.0, 0.03), (0.1, 0.14), (0.6, 0.17), (0.97, 0.06), (1.0, 0.0))
    shape = replace(vane(outline, (0.0, 62.0, 5.0, 3.0), (0.7, 40.0, 8.0, 3.0)), rounded_base=0.15)
    kind = feather_kind(shape, shape, camber=24.0, sweep=sweep, twist=twist)
    rest = build_feather(adjusted(kind, Change(wrap=(3.0, 3.0))), 41, 10).rest
    turn, half = arch * 0.35 / 2.0, 0.35 / 2.0
    middle = half * np.sinc(turn / np.pi), -half * np.sin(0.5 * turn) * np.sinc(0.5 * turn / np.pi)
    along, up = (np.cos(turn), -np.sin(turn)), (np.sin(turn), np.cos(turn))
    flat = rest.nodes.reshape(-1, 3)
    way = flat[:, ::2] - middle
    x, z = way @ along, way @ up
    sunk = (1.0 - np.sqrt(1.0 - (arch * x) ** 2)) / arch
    off = np.hypot(flat[:, 1], z + radius) + sunk - radius
    return np.abs(off).max() / (0.5 * flat[:, 1].max() ** 2 / radius)


def test_wrapped_vanes_lie_on_one_sheet_along_all_of_their_shafts():
    assert off_a_wrapped_sheet(0.0) < 0.055
    assert off_a_wrapped_sheet(6.0) < 0.5 * off_a_wrapped_sheet(6.0, twist=-9.0)


def test_guides_are_met_and_not_overshot():
    guides = (BarbGuide(0.1, 70, 5, 0), BarbGuide(0.3, 40, 20, 3), BarbGuide(0.9, 40, 5, 9))
    place = np.linspace(0.0, 1.0, 101)
    angle, curl, camber = np.degrees(interpolate_guides(guides, place))
    for guide in guides:
        at = round(guide.position * 100)
        assert (angle[at], curl[at], camber[at]) == pytest.approx(
            (guide.angle, guide.curl, guide.camber)
        )
    assert np.all(angle[:11] == pytest.approx(70.0))
    assert np.all(np.diff(angle) <= 1e-12)
    assert curl.max() == pytest.approx(20.0)


def test_barbs_below_a_thousandth_of_the_length_are_left_out():
    thin = vane(((0.0, 0.0), (0.5, 0.0009), (1.0, 0.0)), (0.0, 90.0, 0.0, 0.0))
    feather = build_feather(feather_kind(thin, TRAILING_VANE), 21, 6)
    assert np.all(feather.barb_length[LEADING] == 0.0)
    assert not feather.cell[LEADING].any()


def test_barbs_that_cross_are_named_with_kind_side_and_position():
    crossing = vane(BAND, (0.0, 30.0, 0.0, 0.0), (0.5, 30.0, 0.0, 0.0), (0.55, 140.0, 0.0, 0.0))
    found = messages(feather_kind(crossing, TRAILING_VANE), rows=41)
    assert len(found) == 1
    assert "feather kind trial: leading.guides: neighbouring barbs cross" in found[0]
    assert "between positions 0.5" in found[0]


def test_both_vanes_are_reported_at_once():
    crossing = vane(BAND, (0.0, 30.0, 0.0, 0.0), (0.5, 30.0, 0.0, 0.0), (0.55, 140.0, 0.0, 0.0))
    found = messages(feather_kind(crossing, crossing), rows=41)
    assert [message.split(": ")[1] for message in found] == ["leading.guides", "trailing.guides"]


def test_a_shaft_that_sweeps_too_strongly_folds_the_vane():
    wide = vane(((0.0, 0.3), (1.0, 0.3)), (0.0, 80.0, 0.0, 0.0))
    build_feather(feather_kind(wide, wide, sweep=60.0), 21, 6)
    found = messages(feather_kind(wide, wide, sweep=270.0))
    assert len(found) == 1
    assert "trailing.guides: the vane folds over" in found[0]
    assert "sweep" in found[0]


def test_a_barb_that_bulges_over_the_outline_is_named():
    shape = vane(((0.0, 0.05), (1.0, 0.05)), (0.0, 60.0, 118.0, 0.0))
    found = messages(feather_kind(shape, NO_VANE))
    assert any("leaves the outline" in message for message in found)


def test_a_barb_that_turns_back_across_the_rachis_is_named():
    shape = vane(BAND, (0.0, 30.0, 70.0, 0.0))
    found = messages(feather_kind(shape, NO_VANE))
    assert any("turn back across the rachis" in message for message in found)


@pytest.mark.parametrize(
    ("outline", "said"),
    [
        (((0.0, 0.1),), "at least two points"),
        (((0.0, 0.1), (0.0, 0.1), (1.0, 0.0)), "repeats the point"),
        (((0.0, 0.1), (1.0, -0.1)), "Give y >= 0"),
        (((0.0, 0.1), (1.0, float("nan"))), "not finite"),
        (((0.0, 0.0), (0.8, 0.2), (0.8, 0.05), (0.2, 0.2), (1.0, 0.0)), "crosses itself"),
    ],
)
def test_faulty_outlines_are_described(outline, said):
    assert said in describe_outline_fault(outline)
    shape = vane(outline, (0.0, 60.0, 0.0, 0.0))
    assert any(said in message for message in messages(feather_kind(shape, NO_VANE)))


def test_a_sound_outline_has_no_fault():
    assert describe_outline_fault(LEADING_VANE.outline) == ""
    assert describe_outline_fault(TRAILING_VANE.outline) == ""


def test_all_faults_of_the_arguments_are_reported_together():
    bad = replace(SWAN_PRIMARY, length=-1.0, leading=VaneShape(BAND, ()))
    found = messages(bad, rows=2, columns=0)
    for key in ("rows", "columns", "length", "leading.guides"):
        assert any(key in message for message in found)


def test_a_fan_that_would_fold_is_left_out_and_the_barb_is_the_edge():
    outline = ((0.0, 0.0), (0.157, 0.1048), (0.564, 0.1129), (0.894, 0.0995), (1.003, 0.0))
    curled = vane(outline, (0.0, 72.5, 29.0, 13.0), (1.0, 44.0, 4.0, -8.0))
    straight = vane(outline, (0.0, 58.0, 0.0, 0.0), (1.0, 44.0, 0.0, 0.0))
    for shape, spanned in ((curled, False), (straight, True)):
        feather = build_feather(feather_kind(NO_VANE, shape), 36, 8)
        first = np.flatnonzero(feather.barb_length[TRAILING])[0]
        assert feather.station[first] > 0.16 * 0.35, "the first row of the vane has no barb"
        assert feather.cell[TRAILING, first - 1].any() == spanned
        assert feather.cell[TRAILING, first].all()


def test_a_short_end_barb_that_would_fold_the_vane_is_dropped():
    outline = ((0.0, 0.0055), (0.191, 0.109), (0.403, 0.1534), (0.817, 0.0984), (1.0346, 0.0))
    shape = vane(outline, (0.0, 58.0, 27.4, 0.0), (1.0, 46.0, 14.1, 0.0))
    for rows in (42, 60, 80):
        feather = build_feather(feather_kind(NO_VANE, shape, calamus=0.03, **FLAT), rows, 9)
        length = feather.barb_length[TRAILING]
        first = np.flatnonzero(length)[0]
        assert length[first] > 0.5 * length[first + 1]
        assert length[first] > 0.02
