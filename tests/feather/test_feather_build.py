"""What a built feather promises, over random kinds."""

from __future__ import annotations

from dataclasses import fields, replace

import numpy as np
import pytest
import trimesh
from feather_kinds import LEADING_VANE, NO_VANE, SWAN_PRIMARY, TRAILING_VANE, feather_kind, kinds
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from featherfx.errors import InputError
from featherfx.feather.build import build_feather
from featherfx.feather.types import LEADING, RACHIS_PART, TRAILING, Feather, barb_slice
from featherfx.groom.types import BarbGuide, FeatherKind, VaneShape

SIZES = {"rows": st.integers(3, 30), "columns": st.integers(1, 8)}


def build_or_skip(kind: FeatherKind, rows: int, columns: int, mirrored: bool = False) -> Feather:
    try:
        return build_feather(kind, rows, columns, mirrored)
    except InputError:
        assume(False)
        raise


def mesh(feather: Feather, part: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Points, triangles and barb directions of one part."""
    surface = feather.surface
    chosen = surface.part == part
    points = surface.points(feather.rest)
    return points, surface.triangles[chosen], surface.barb_direction[chosen]


def barb_nodes(feather: Feather, side: int) -> np.ndarray:
    """(n, m + 1, 3), root first."""
    nodes = feather.rest.nodes
    return np.concatenate((nodes[:, :1], nodes[:, barb_slice(side, feather.columns)]), axis=1)


def barb_angle(feather: Feather, side: int) -> np.ndarray:
    """(n,) deg, between the shaft's tangent and the first segment of the barb."""
    directors = feather.rest.directors
    tangent = np.cross(directors[:, 0], directors[:, 1])
    first = barb_nodes(feather, side)[:, 1] - feather.rest.nodes[:, 0]
    length = np.maximum(np.linalg.norm(first, axis=1), 1e-30)
    return np.degrees(np.arccos(np.clip(np.sum(first * tangent, axis=1) / length, -1.0, 1.0)))


def normals(points: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """(T, 3), half the cross product: area times unit normal."""
    a, b, c = (points[triangles[:, k]] for k in range(3))
    return 0.5 * np.cross(b - a, c - a)


@settings(max_examples=40, deadline=None, derandomize=True)
@given(kind=kinds(flat=True), mirrored=st.booleans(), **SIZES)
def test_flat_feathers_have_only_triangles_that_face_dorsal(kind, rows, columns, mirrored):
    feather = build_or_skip(kind, rows, columns, mirrored)
    for side, outward in ((LEADING, 1.0), (TRAILING, -1.0)):
        points, triangles, _ = mesh(feather, side)
        area = normals(points, triangles)[:, 2]
        assert np.all(area > 1e-10 * kind.length**2)
        middle = points[triangles].mean(axis=1)[:, 1]
        assert np.all(middle * outward * (-1.0 if mirrored else 1.0) > 0.0)


@settings(max_examples=40, deadline=None, derandomize=True)
@given(kind=kinds(), mirrored=st.booleans(), **SIZES)
def test_every_vane_triangle_has_one_edge_along_its_barb(kind, rows, columns, mirrored):
    feather = build_or_skip(kind, rows, columns, mirrored)
    node = {
        tuple(point): (side, row, column)
        for side in (LEADING, TRAILING)
        for row, barb in enumerate(barb_nodes(feather, side))
        for column, point in enumerate(barb)
        if column > 0 and feather.barb_length[side, row] > 0.0
    }
    root = {tuple(point): row for row, point in enumerate(feather.rest.nodes[:, 0])}
    for side in (LEADING, TRAILING):
        points, triangles, directions = mesh(feather, side)
        for triangle, direction in zip(triangles, directions, strict=True):
            corners = [tuple(points[corner]) for corner in triangle]
            place = [node.get(c) or (side, root[c], 0) for c in corners]
            along = []
            for k in range(3):
                ends = sorted((place[k], place[k - 1]))
                if ends[0][:2] == ends[1][:2] and ends[1][2] - ends[0][2] == 1:
                    pair = sorted((k, (k - 1) % 3), key=lambda i: place[i])
                    along.append(np.subtract(corners[pair[1]], corners[pair[0]]))
            assert len(along) == 1
            unit = along[0] / np.linalg.norm(along[0])
            np.testing.assert_allclose(direction, unit, atol=1e-9)


@settings(max_examples=40, deadline=None, derandomize=True)
@given(kind=kinds(), **SIZES)
def test_barbs_are_equally_divided_and_directors_orthonormal(kind, rows, columns):
    feather = build_or_skip(kind, rows, columns)
    for side in (LEADING, TRAILING):
        step = np.linalg.norm(np.diff(barb_nodes(feather, side), axis=1), axis=-1)
        expected = np.broadcast_to(feather.barb_length[side][:, None] / columns, step.shape)
        np.testing.assert_allclose(step, expected, rtol=0.0, atol=1e-12)
        bare = feather.barb_length[side] == 0.0
        assert np.all(barb_nodes(feather, side)[bare] == feather.rest.nodes[bare, :1])
        assert np.all(feather.barb_length[side][~bare] > 0.9e-3 * kind.length)
        assert np.all((feather.barb_span[side] > 0.0) == ~bare)
    d2, d3 = feather.rest.directors[:, 0], feather.rest.directors[:, 1]
    for first, second, value in ((d2, d2, 1.0), (d3, d3, 1.0), (d2, d3, 0.0)):
        np.testing.assert_allclose(np.sum(first * second, axis=1), value, atol=2e-15)


@settings(max_examples=40, deadline=None, derandomize=True)
@given(kind=kinds(), sides=st.integers(3, 9), **SIZES)
def test_the_rachis_is_a_closed_tube_round_the_shaft(kind, rows, columns, sides):
    build_or_skip(kind, rows, columns)
    feather = build_feather(kind, rows, columns, False, sides)
    points, triangles, _ = mesh(feather, RACHIS_PART)
    tube = trimesh.Trimesh(points, triangles, process=False)
    assert tube.is_watertight
    assert tube.is_winding_consistent
    assert tube.volume > 0.0, "triangles face outwards"


def test_the_tube_holds_the_volume_of_its_elliptic_sections():
    feather = build_feather(SWAN_PRIMARY, 81, 2, False, 48)
    points, triangles, _ = mesh(feather, RACHIS_PART)
    section = 0.25 * np.pi * feather.width * feather.height
    expected = np.trapezoid(section, feather.station)
    volume = trimesh.Trimesh(points, triangles, process=False).volume
    assert volume == pytest.approx(expected, rel=5e-3)


@settings(max_examples=40, deadline=None, derandomize=True)
@given(kind=kinds(), **SIZES)
def test_surface_is_compact_and_texture_in_range(kind, rows, columns):
    surface = build_or_skip(kind, rows, columns).surface
    assert np.array_equal(np.unique(surface.triangles), np.arange(len(surface.row)))
    assert surface.st.min() >= 0.0
    assert surface.st.max() <= 1.0
    np.testing.assert_allclose(np.linalg.norm(surface.barb_direction, axis=1), 1.0, atol=1e-14)


@settings(max_examples=40, deadline=None, derandomize=True)
@given(kind=kinds(), **SIZES)
def test_a_mirrored_feather_is_the_exact_mirror_image(kind, rows, columns):
    one = build_or_skip(kind, rows, columns)
    other = build_feather(kind, rows, columns, True)
    reflection = [1.0, -1.0, 1.0]
    assert np.array_equal(other.rest.nodes, one.rest.nodes * reflection)
    surface, image = one.surface, other.surface
    assert np.array_equal(image.points(other.rest), surface.points(one.rest) * reflection)
    assert np.array_equal(image.part, surface.part)
    assert np.array_equal(image.st, surface.st)
    assert np.array_equal(image.barb_direction, surface.barb_direction * reflection)
    normals_of = [np.cross(*each.rest.directors.swapaxes(0, 1)) for each in (other, one)]
    np.testing.assert_allclose(normals_of[0], normals_of[1] * reflection)
    assert np.array_equal(other.rest.directors[0], [[0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
    normal = normals(surface.points(one.rest), surface.triangles)
    turned = normals(image.points(other.rest), image.triangles)
    np.testing.assert_allclose(turned, normal * reflection, atol=1e-18)


def test_building_again_gives_the_same_bytes():
    first = build_feather.__wrapped__(SWAN_PRIMARY, 21, 6)
    second = build_feather.__wrapped__(replace(SWAN_PRIMARY), 21, 6)
    for record, again in ((first, second), (first.surface, second.surface)):
        for entry in fields(record):
            value = getattr(record, entry.name)
            if isinstance(value, np.ndarray):
                assert value.tobytes() == getattr(again, entry.name).tobytes()


def test_equal_kinds_share_one_feather_that_nobody_can_change():
    feather = build_feather(SWAN_PRIMARY, 21, 6)
    assert build_feather(replace(SWAN_PRIMARY), 21, 6) is feather
    with pytest.raises(ValueError, match="read-only"):
        feather.rest.nodes[0, 0, 0] = 1.0


def test_a_swan_primary_has_the_drawn_proportions():
    feather = build_feather(SWAN_PRIMARY, 41, 6)
    flat = feather_kind(LEADING_VANE, TRAILING_VANE, camber=0.0, sweep=0.0, twist=0.0)
    points, _, _ = mesh(build_feather(flat, 81, 12), TRAILING)
    assert -points[:, 1].min() == pytest.approx(0.12 * 0.35, rel=0.02)
    points, _, _ = mesh(build_feather(flat, 81, 12), LEADING)
    assert points[:, 1].max() == pytest.approx(0.036 * 0.35, rel=0.02)
    trailing = feather.barb_length[TRAILING]
    assert trailing[-1] < 0.1 * trailing.max()
    assert np.all(feather.rest.nodes[0, 0] == 0.0)
    assert feather.rest.nodes[-1, 0, 2] < 0.0, "camber is towards ventral"
    assert feather.rest.nodes[-1, 0, 1] < 0.0, "sweep is towards trailing"


def test_a_vane_may_be_absent_on_one_side():
    feather = build_feather(feather_kind(NO_VANE, TRAILING_VANE), 21, 6)
    assert np.all(feather.barb_length[LEADING] == 0.0)
    assert not feather.cell[LEADING].any()
    assert not np.any(feather.surface.part == LEADING)
    assert feather.cell[TRAILING].any()
    bare = build_feather(feather_kind(NO_VANE, NO_VANE), 9, 3)
    assert set(bare.surface.part) == {RACHIS_PART}


@pytest.mark.parametrize("rows", [3, 4, 5])
@pytest.mark.parametrize("columns", [1, 5])
def test_few_rows_still_make_a_vane(rows, columns):
    feather = build_feather(SWAN_PRIMARY, rows, columns)
    assert feather.rows == rows
    assert feather.columns == columns
    assert feather.cell[TRAILING].any()
    assert np.any(np.isclose(feather.station, 0.15 * 0.35, rtol=1e-14))


def test_barbs_stand_for_the_stretch_of_rachis_nearest_to_them():
    blunt = VaneShape(((0.0, 0.1), (1.0, 0.1)), (BarbGuide(0.0, 90.0, 0.0, 0.0),))
    feather = build_feather(feather_kind(blunt, NO_VANE), 21, 4)
    assert feather.barb_length[LEADING, 3:] == pytest.approx(0.035)
    assert feather.barb_span[LEADING].sum() == pytest.approx(0.85 * 0.35)
    few = build_feather(SWAN_PRIMARY, 3, 2)
    assert np.all(few.barb_span[few.barb_length > 0.0] > 0.0)


def test_barbs_keep_their_length_and_angle_on_a_strongly_swept_shaft():
    plain = dict(camber=0.0, sweep=0.0, twist=0.0)
    flat = build_feather(feather_kind(LEADING_VANE, TRAILING_VANE, **plain), 31, 20)
    swept = feather_kind(LEADING_VANE, TRAILING_VANE, camber=30.0, sweep=60.0, twist=20.0)
    curved = build_feather(swept, 31, 20)
    np.testing.assert_allclose(curved.barb_length, flat.barb_length, rtol=2e-4)
    for side in (LEADING, TRAILING):
        ratio = normals(*mesh(curved, side)[:2]), normals(*mesh(flat, side)[:2])
        area, drawn = (np.linalg.norm(vector, axis=1) for vector in ratio)
        assert np.all((area > 0.75 * drawn) & (area < 1.1 * drawn))
        grown = curved.barb_length[side] > 0.0
        np.testing.assert_allclose(
            barb_angle(curved, side)[grown], barb_angle(flat, side)[grown], atol=1.0
        )
