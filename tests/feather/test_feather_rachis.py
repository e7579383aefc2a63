"""The shaft against closed forms and against an independent integration of its frame."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from feather_kinds import NO_VANE, SWAN_PRIMARY, feather_kind
from scipy.spatial.transform import Rotation

from featherfx.feather.build import build_feather
from featherfx.feather.profiles import build_rachis, row_stations
from featherfx.feather.types import RACHIS_PART
from featherfx.groom.course import turn, turned


def test_camber_alone_is_an_arc_towards_ventral():
    length, angle = 0.35, np.radians(40.0)
    rachis = build_rachis(feather_kind(NO_VANE, NO_VANE, camber=40.0, sweep=0.0, twist=0.0), 11)
    radius = length / angle
    end = [radius * np.sin(angle), 0.0, -radius * (1.0 - np.cos(angle))]
    np.testing.assert_allclose(rachis.position[-1], end, atol=1e-16)
    np.testing.assert_allclose(rachis.frame[-1, :, 0], [np.cos(angle), 0, -np.sin(angle)])


def test_sweep_alone_is_an_arc_towards_trailing():
    length, angle = 0.35, np.radians(60.0)
    rachis = build_rachis(feather_kind(NO_VANE, NO_VANE, camber=0.0, sweep=60.0, twist=0.0), 11)
    radius = length / angle
    end = [radius * np.sin(angle), -radius * (1.0 - np.cos(angle)), 0.0]
    np.testing.assert_allclose(rachis.position[-1], end, atol=1e-16)


def test_twist_alone_turns_the_directors_right_handed():
    rachis = build_rachis(feather_kind(NO_VANE, NO_VANE, camber=0.0, sweep=0.0, twist=30.0), 5)
    angle = np.radians(30.0)
    np.testing.assert_allclose(rachis.position[-1], [0.35, 0.0, 0.0])
    np.testing.assert_allclose(rachis.frame[-1, :, 1], [0.0, np.cos(angle), np.sin(angle)])


def test_frames_and_positions_agree_with_a_fine_integration():
    kind = feather_kind(NO_VANE, NO_VANE, camber=50.0, sweep=35.0, twist=-40.0)
    rachis = build_rachis(kind, 6)
    total = np.radians([-40.0, 50.0, -35.0])
    np.testing.assert_allclose(rachis.frame[-1], Rotation.from_rotvec(total).as_matrix())
    middle = (np.arange(20000) + 0.5) / 20000
    tangent = Rotation.from_rotvec(middle[:, None] * total).as_matrix()[..., 0]
    np.testing.assert_allclose(rachis.position[-1], 0.35 * tangent.mean(axis=0), atol=1e-10)


def with_course(course, **angles):
    kind = feather_kind(NO_VANE, NO_VANE, **angles)
    return replace(kind, rachis=replace(kind.rachis, course=course))


def test_a_course_that_is_an_arc_is_that_arc():
    """Two keys are a straight line of turning, as camber, sweep and twist are."""
    arc = build_rachis(feather_kind(NO_VANE, NO_VANE, camber=30.0, sweep=20.0, twist=10.0), 7)
    kind = with_course(((0, 5, 5, 5), (1, 25, 20, 15)), camber=10.0, sweep=5.0, twist=0.0)
    course = build_rachis(kind, 7)
    np.testing.assert_allclose(course.position, arc.position, atol=1e-15)
    np.testing.assert_allclose(course.frame, arc.frame, atol=1e-13)
    for forward in (0.01, 0.2):
        start, way = np.array([0.0, 0.1]), np.full(2, forward)
        steady = way[:, None] * np.radians([10.0, 30.0, -20.0])
        np.testing.assert_allclose(turned(kind.rachis, start, way), steady, atol=1e-14)


def test_a_course_bends_both_ways_as_its_turning_says():
    """In one plane the tangent's angle is the turning itself: its integral is the place."""
    course = ((0, 0, 0, 0), (0.3, 0, 40, 0), (0.7, 0, -30, 0), (1, 0, 10, 0))
    kind = with_course(course, camber=0.0, sweep=15.0, twist=0.0)
    fine, coarse = build_rachis(kind, 2001), build_rachis(kind, 21)
    angle = np.arctan2(fine.frame[:, 1, 0], fine.frame[:, 0, 0])
    at = np.interp([0.3, 0.7, 1.0], fine.station / kind.length, np.degrees(angle))
    np.testing.assert_allclose(at, [-44.5, 19.5, -25.0], atol=0.02)
    tangent = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    steps = np.diff(fine.station)[:, None] * 0.5 * (tangent[1:] + tangent[:-1])
    # a chord of one of its 256 pieces errs by the square of their size
    error = np.abs(fine.position[-1, :2] - steps.sum(axis=0)).max() / kind.length
    assert error < (1.0 / 256.0) ** 2
    np.testing.assert_allclose(fine.position[::100], coarse.position, atol=1e-14)
    assert np.abs(fine.position[:, 2]).max() < 1e-14
    # beyond the tip the arc alone goes on
    beyond = turned(kind.rachis, np.array([1.0]), np.array([0.1]))
    np.testing.assert_allclose(np.degrees(beyond[0]), [0.0, 0.0, -1.5], atol=1e-12)


@pytest.mark.parametrize("angle", [0.0, 1e-12, 1e-5, 0.2499999, 0.2500001, 1.0, 3.0])
def test_a_steady_turn_is_exact_at_every_angle(angle):
    frame, mean_tangent = turn(np.array([0.0, 0.0, angle]))
    exact = [np.cos(angle), np.sin(angle), 0.0]
    np.testing.assert_allclose(frame[:, 0], exact, atol=2e-16)
    half = 0.5 * angle
    chord = np.sinc(half / np.pi) * np.array([np.cos(half), np.sin(half), 0.0])
    np.testing.assert_allclose(mean_tangent, chord, atol=4e-16)


def test_arc_length_between_fine_rows_is_the_length():
    feather = build_feather(SWAN_PRIMARY, 1001, 1)
    polyline = np.linalg.norm(np.diff(feather.rest.nodes[:, 0], axis=0), axis=1).sum()
    assert polyline == pytest.approx(0.35, rel=1e-7)
    assert feather.station[-1] == 0.35


@pytest.mark.parametrize("rows", [3, 4, 7, 21, 60])
@pytest.mark.parametrize("calamus", [0.0, 0.02, 0.15, 0.5, 0.95])
def test_a_row_stands_where_the_vane_begins(rows, calamus):
    station, first = row_stations(2.0, calamus, rows)
    assert len(station) == rows
    assert station[0] == 0.0
    assert station[-1] == 2.0
    assert station[first] == calamus * 2.0
    assert np.all(np.diff(station) > 0.0)
    assert first <= rows - 2


def test_the_section_tapers_and_is_flattened():
    kind = replace(SWAN_PRIMARY, rachis=replace(SWAN_PRIMARY.rachis, taper=2.0))
    rachis = build_rachis(kind, 21)
    assert rachis.width[0] == 0.006
    assert rachis.width[-1] == 0.0008
    share = rachis.station / 0.35
    np.testing.assert_allclose(rachis.width, 0.0008 + 0.0052 * (1.0 - share) ** 2)
    np.testing.assert_allclose(rachis.height, 0.9 * rachis.width)


@pytest.mark.parametrize("mirrored", [False, True])
@pytest.mark.parametrize("share", [0.0, 0.12, 0.5, 1.0])
def test_a_rachis_stands_out_of_the_vane_by_its_share(share, mirrored):
    kind = SWAN_PRIMARY
    kind = replace(kind, rachis=replace(kind.rachis, above_vane=share))
    feather = build_feather(kind, 21, 4, mirrored)
    surface = feather.surface
    tube = np.zeros(len(surface.row), dtype=bool)
    tube[surface.triangles[surface.part == RACHIS_PART]] = True
    vane = np.zeros(len(surface.row), dtype=bool)
    vane[surface.triangles[surface.part != RACHIS_PART]] = True
    assert not surface.offset[vane].any()
    heights = surface.offset[tube, 1]
    rows = surface.row[tube]
    for row, height in enumerate(feather.height):
        own = heights[rows == row]
        # corners of a hexagon are at 0.866 of its radius
        middle, half = height * (share - 0.5), 0.5 * height * np.sin(np.radians(60.0))
        assert own.max() == pytest.approx(max(middle + half, 0.0 if row in (0, 20) else -1.0))
