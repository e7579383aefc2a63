"""The shaft against closed forms and against an independent integration of its frame."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from feather_kinds import NO_VANE, SWAN_PRIMARY, feather_kind
from scipy.spatial.transform import Rotation

from featherfx.feather.build import build_feather
from featherfx.feather.rachis import build_rachis, row_stations, turn


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
