"""Feathers on a skin that bends, stretches and turns: leaves, lengths and rates."""

from __future__ import annotations

import re
import warnings
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from places import SAMPLES
from pxr import Usd, UsdGeom

import featherfx
from featherfx.algebra.vectors import unit, vectors_to_frames
from featherfx.coat.carrier import pose_carrier
from featherfx.feather.crossings import find_intersections, make_patches
from featherfx.feather.leaves import lay_out
from featherfx.feather.placed_feathers import build_feathers
from featherfx.feather.types import RACHIS_PART, RowPoints, both, stacked
from featherfx.groom.skin.skin import closest
from featherfx.groom.types import Groom, Layout
from featherfx.shot.coat.leaf_kernels import find_folds
from featherfx.shot.coat.leaves import CarriedPoints, MovingCoat
from featherfx.shot.frames import FeatherPose, StageClock, place
from featherfx.shot.loop.simulate import simulate
from featherfx.shot.read.read import read_shot
from featherfx.shot.roots import RootFrames
from featherfx.shot.sources import TimedSurface

SIDE, STEPS = 0.8, 41
GRID = np.linspace(-0.5 * SIDE, 0.5 * SIDE, STEPS)
AXIS = np.array([0.3, -0.5, 0.8])


class Sheet:
    """A square skin whose points are a function of the time."""

    bones, st, sampled, time_codes_per_second = None, None, (0.0, 1.0), 1.0

    def __init__(self, moved, hollow=0.0) -> None:
        x, y = (each.ravel() for each in np.meshgrid(GRID, GRID, indexing="ij"))
        self.rest = rolled(x, y, hollow)
        corner = (np.arange(STEPS - 1)[:, None] * STEPS + np.arange(STEPS - 1)).ravel()
        low = np.stack([corner, corner + STEPS, corner + 1], axis=1)
        high = np.stack([corner + 1, corner + STEPS, corner + STEPS + 1], axis=1)
        self.triangles, self._moved = np.concatenate([low, high]), moved

    def points(self, code: float) -> np.ndarray:
        return self._moved(self.rest, code)


def rolled(x, y, hollow):
    """Points (N, 3) of a plane rolled up about x, to a hollow of a curvature."""
    half = 0.5 * hollow * y
    chord = y * np.sinc(half / np.pi)
    return np.stack([x, chord * np.cos(half), chord * np.sin(half)], axis=1)


def turned(points, time):
    return points @ vectors_to_frames(time * AXIS).T + time * np.array([0.2, 0.1, 0.0])


def bent(points, time):
    """On a cylinder about y, stretched along x."""
    curvature, stretch = 2.0 * np.sin(2.0 * time), 1.0 + 0.15 * np.sin(3.0 * time)
    angle = curvature * stretch * points[:, 0]
    half = 0.5 * angle
    x = stretch * points[:, 0] * np.sinc(angle / np.pi)
    z = -stretch * points[:, 0] * np.sin(half) * np.sinc(half / np.pi)
    return np.stack([x, points[:, 1], z], axis=1)


def plumage(moved, hollow=0.0, above=None):
    """Feathers in rows that point along x, as they lie on a sheet, and their coat in motion.

    hollow: curvature of the sheet at rest, 1/m. above: as of MovingCoat.
    """
    one = read_shot(SAMPLES / "feather_pull" / "shot.toml").groom.feathers[0]
    sheet, size = Sheet(moved, hollow), one.kind.length
    x, y = np.meshgrid(np.arange(-0.3, 0.31, 0.4 * size), [-0.3 * size, 0.0, 0.25 * size])
    places = rolled(x.ravel(), y.ravel(), hollow)
    feathers = tuple(
        replace(one, id=f"f{k}", position=place, grown=True) for k, place in enumerate(places)
    )
    corners = sheet.rest[sheet.triangles]
    groom = lay_out(Groom("rows", Path("rows.toml"), feathers, skin=corners, layout=Layout()))
    drawn = build_feathers(groom.feathers, 11, 4)
    skin = CarriedPoints(groom.coat.coat.mesh.points, [TimedSurface(sheet, StageClock())])
    bent = np.arange(len(drawn))
    coat = MovingCoat(groom.coat.coat, skin, groom.feathers, drawn, bent, above)
    return groom.feathers, drawn, coat


def drawn_at(parts, time, roots=None, step=1e-2, bend=None, led=None):
    """Points and rates of feathers at a time. roots: positions, rotations; default: rest. bend:
    changes their points (RowPoints) on these roots. led: rotations, default those of roots."""
    placements, drawn, coat = parts
    still = np.array([p.position for p in placements]), np.array([p.rotation for p in placements])
    position, rotation = still if roots is None else roots
    rest = stacked([place(f.rest, p, r) for f, p, r in zip(drawn, position, rotation, strict=True)])
    rest = rest if bend is None else bend(rest)
    still_rates = [both(np.zeros_like, rest) for _ in range(2)]
    held = RootFrames(*map(np.zeros_like, (position, rotation)))
    frames = [RootFrames(position, rotation), held, held]
    moved = frames if led is None else [RootFrames(position, led), held, held]
    return coat.follow([rest, *still_rates], frames, (time - step, time), moved)


def lengths(points: RowPoints) -> np.ndarray:
    """(F, K) m, of all pieces of rachis and barbs."""
    nodes = points.nodes
    m = (nodes.shape[2] - 1) // 2
    parts = [np.diff(nodes[:, :, 0], axis=1)]
    for first in (1, 1 + m):
        barb = np.concatenate([nodes[:, :, :1], nodes[:, :, first : first + m]], axis=2)
        parts.append(np.diff(barb, axis=2))
    return np.concatenate(
        [np.linalg.norm(each, axis=-1).reshape(len(nodes), -1) for each in parts], axis=1
    )


@pytest.mark.parametrize("rates", [0, 1])
def test_rates_that_nobody_asks_for_are_nan_and_change_nothing_else(rates):
    _, _, coat = parts = plumage(bent)
    found, follow = drawn_at(parts, 0.5), coat.follow
    coat.follow = lambda *given: follow(*given, rates=rates)
    without = drawn_at(parts, 0.5)
    assert np.abs(found[1].nodes).max() > 0.0 < np.abs(found[2].nodes).max()
    for own, other in zip(found[: 1 + rates], without, strict=True):
        np.testing.assert_array_equal(own.nodes, other.nodes)
    assert len(without) == 1 + rates
    poses = [*FeatherPose.each(without)]
    assert all(np.isnan(part).all() for pose in poses for part in pose.accelerations)
    assert all(np.isnan(part).all() == (rates == 0) for pose in poses for part in pose.velocities)


def test_a_skin_at_rest_leaves_feathers_as_they_are():
    parts = plumage(lambda points, time: points)
    placements, drawn, _ = parts
    found = drawn_at(parts, 0.5)
    for k, (own, feather) in enumerate(zip(placements, drawn, strict=True)):
        rest = place(feather.rest, own.position, own.rotation)
        np.testing.assert_allclose(found[0].nodes[k], rest.nodes, atol=1e-7)
    assert np.abs(found[1].nodes).max() < 1e-6


def test_a_skin_that_turns_turns_feathers_with_it():
    parts = plumage(turned)
    placements, drawn, _ = parts
    turn, shift = vectors_to_frames(0.4 * AXIS), 0.4 * np.array([0.2, 0.1, 0.0])
    roots = (
        np.array([turn @ p.position + shift for p in placements]),
        np.array([turn @ p.rotation for p in placements]),
    )
    found = drawn_at(parts, 0.4, roots)[0]
    for k, feather in enumerate(drawn):
        rest = place(feather.rest, roots[0][k], roots[1][k])
        np.testing.assert_allclose(found.nodes[k], rest.nodes, atol=1e-7)
        np.testing.assert_allclose(found.directors[k], rest.directors, atol=1e-6)


def folded(points, time):
    """Shut like a book about the y axis, by 160 degrees at the time 1."""
    angle = np.radians(160.0) * time * np.clip(0.5 + points[:, 0] / 0.05, 0.0, 1.0)
    x, z = np.cos(angle) * points[:, 0], np.sin(angle) * points[:, 0]
    return np.stack([x, points[:, 1] + 0.03 * np.sin(3.0 * angle), z], axis=1)


def nodes_folded(parts, time):
    """Nodes at a time of the folded sheet."""
    position = np.array([each.position for each in parts[0]])
    ahead = (position[:, 0] > 0.0)[:, None]
    turn = vectors_to_frames(np.radians(160.0) * time * ahead * [0.0, -1.0, 0.0])
    rotations = turn @ np.array([each.rotation for each in parts[0]])
    return drawn_at(parts, time, (folded(position, time), rotations))[0].nodes


def jumps(parts, times):
    """Largest second differences of points between times, over the lengths of feathers (F,)."""
    posed = [nodes_folded(parts, time) for time in times]
    away = np.linalg.norm(np.diff(posed, 2, axis=0), axis=-1).max(axis=(0, 2, 3))
    return away / [each.kind.length for each in parts[0]]


def sharpest_turn(nodes):
    """Degrees from one piece of a rachis to the next, at most."""
    ways = unit(np.diff(nodes[:, :, 0], axis=1))
    return np.degrees(np.arccos(np.minimum((ways[:, 1:] * ways[:, :-1]).sum(axis=-1), 1.0))).max()


def test_feathers_bridge_a_crease_without_a_jump():
    """Where the skin folds beneath them images fold, too, and shafts drawn along them break."""
    parts, times = plumage(folded), np.linspace(0.0, 1.0, 49)
    assert sharpest_turn(nodes_folded(parts, 1.0)) > 90.0
    assert not parts[2].find_bridges([0.0]).any()
    shares = parts[2].shares = parts[2].find_bridges(times[::4])
    assert shares.max() == 1.0
    assert jumps(parts, times).max() < 0.1
    assert sharpest_turn(nodes_folded(parts, 1.0)) < 15.0
    far = np.array([not -0.3 < each.position[0] < 0.05 for each in parts[0]])
    assert far.any()
    assert not shares[far].any()
    # those that the other half, at 80 degrees, folds onto lean on it; the crease itself is round
    behind = np.array([each.position[0] < -0.03 for each in parts[0]])
    x, _, z = np.moveaxis(nodes_folded(parts, 0.5)[behind], -1, 0)
    angle = np.degrees(np.arctan2(z, x))[np.hypot(x, z) > 0.03]
    assert (angle[(angle > -90.0) & (angle < 90.0)] > 65.0).all()
    assert shares[behind].max() == 1.0


def find_images(coat, time):
    """(F, n, 1 + 2 m, 3) m, images of nodes at a time."""
    carrier = pose_carrier(coat._coat.mesh, coat._skin.at(time))
    arrays, found = coat._coat.arrays(carrier), []
    for f in range(len(coat._rest.nodes)):
        room, folds = coat._make_room(), np.zeros((f + 1, 2))
        find_folds(arrays, coat._straight, coat._rest.nodes, room, folds, f, f + 1)
        found.append(room.image[..., :3].copy())
    return np.array(found)


def triangulated(grid):
    """(T, 3, 3) m, corners of the triangles between the nodes (n, 1 + 2 m, 3) of a vane."""
    m = (grid.shape[1] - 1) // 2
    sides = grid[:, [*range(2 * m, m, -1), *range(m + 1)]]
    a, b, c, d = sides[:-1, :-1], sides[1:, :-1], sides[:-1, 1:], sides[1:, 1:]
    return np.concatenate(
        [np.stack(each, axis=2).reshape(-1, 3, 3) for each in ((a, b, c), (b, d, c))]
    )


@pytest.mark.parametrize(("along", "across"), [(0.0, 0.5), (0.4, 0.0)])
def test_barbs_run_along_a_skin_that_is_squeezed_beneath_them(along, across):
    """Into a trough that opens along the feathers: inner halves of barbs lie on their images."""

    def trough(points, time):
        x, y = (1.0 - along * time) * points[:, 0], (1.0 - across * time) * points[:, 1]
        radius = 0.15 * np.exp(3.0 * points[:, 0])
        angle, rise = y / radius, time * radius
        side = time * radius * np.sin(angle) + (1.0 - time) * y
        return np.stack([x, side, points[:, 2] + rise * (1.0 - np.cos(angle))], axis=1)

    parts = plumage(trough)
    position = np.array([each.position for each in parts[0]])
    roots = trough(position, 1.0), np.array([each.rotation for each in parts[0]])
    inner, away = [1, 2, 5, 6], []
    for drawn, images in zip(
        drawn_at(parts, 1.0, roots)[0].nodes, find_images(parts[2], 1.0), strict=True
    ):
        nodes, vane = drawn[3:6, inner].reshape(-1, 3), triangulated(images)
        triangle, weights = closest(nodes, vane)
        away.append(nodes - np.einsum("nk,nkc->nc", weights, vane[triangle]))
    assert np.median(np.linalg.norm(away, axis=-1)) < (2e-7 if across else 2.5e-5)


def heights(points: RowPoints, time: float) -> np.ndarray:
    """(F, n) m, of rachises over the bent sheet, and (F, n) m, x of the sheet beneath."""
    curvature, stretch = 2.0 * np.sin(2.0 * time), 1.0 + 0.15 * np.sin(3.0 * time)
    radius = 1.0 / curvature
    x, _, z = np.moveaxis(points.nodes[:, :, 0], -1, 0)
    height = np.sign(radius) * (np.hypot(x, z + radius) - abs(radius))
    return height, np.arctan2(
        x * np.sign(radius), (z + radius) * np.sign(radius)
    ) * radius / stretch


@pytest.mark.parametrize("time", [0.2, 0.5, 0.9, 1.3])
def test_lengths_and_the_order_of_leaves_hold_on_a_bent_skin(time):
    parts = plumage(bent)
    rest = drawn_at(parts, 0.0)[0]
    found = drawn_at(parts, time)[0]
    np.testing.assert_allclose(lengths(found), lengths(rest), rtol=1e-6, atol=1e-12)
    quills = (np.linalg.norm(x.nodes[:, 2, 0] - x.nodes[:, 0, 0], axis=1) for x in (rest, found))
    np.testing.assert_allclose(*quills, rtol=1e-9)  # which do not bend
    assert_in_order(parts[0], *heights(found, time))


def assert_in_order(placements, height, at, overlapping=True):
    """Whoever is ranked higher lies higher along the same line of the sheet."""
    rows = np.unique([p.position[1].round(6) for p in placements])
    for row in rows:
        own = [k for k, p in enumerate(placements) if p.position[1].round(6) == row]
        own.sort(key=lambda k: placements[k].rank)
        for low, high in pairwise(own):
            inside = (at[high] > at[low, 1]) & (at[high] < at[low, -1])
            under = np.interp(at[high][inside], at[low], height[low])
            assert inside.any() or not overlapping
            assert (height[high][inside] > under).all()


@pytest.mark.parametrize("rise", [-0.2, 0.3, 0.6])
def test_what_bends_one_feather_lifts_those_around_in_their_order(rise):
    """One feather is turned about its root, up or into the skin."""
    parts = plumage(lambda points, time: points)
    placements = parts[0]
    one = len(placements) // 2

    def bend(points: RowPoints) -> RowPoints:
        turn = vectors_to_frames(np.array([0.0, -rise, 0.0]))
        nodes, directors = points.nodes.copy(), points.directors.copy()
        root = nodes[one, 0, 0].copy()
        nodes[one] = (nodes[one] - root) @ turn.T + root
        directors[one] = directors[one] @ turn.T
        return RowPoints(nodes, directors)

    rest, found = drawn_at(parts, 0.0)[0], drawn_at(parts, 0.0, bend=bend)[0]
    np.testing.assert_allclose(lengths(found), lengths(rest), rtol=1e-6, atol=1e-12)
    rachis = found.nodes[:, :, 0]
    assert np.sign(rise) * (rachis[one, -1, 2] - rest.nodes[one, -1, 0, 2]) > 1e-5
    assert_in_order(placements, rachis[:, :, 2], rachis[:, :, 0])
    assert rachis[:, :, 2].min() > rest.nodes[:, :, 0, 2].min() - 1e-9


@pytest.mark.parametrize("angle", [0.2, -0.7])
def test_a_turn_within_the_vane_stays_on_the_leaf(angle):
    parts = plumage(lambda points, time: points)
    one, led = len(parts[0]) // 2, np.array([p.rotation for p in parts[0]])
    turn = led[one] @ vectors_to_frames(np.array([0.0, 0.0, angle])) @ led[one].T
    led[one] = turn @ led[one]

    def bend(points: RowPoints) -> RowPoints:
        position = parts[0][one].position
        nodes, directors = points.nodes.copy(), points.directors.copy()
        nodes[one] = (nodes[one] - position) @ turn.T + position
        directors[one] = directors[one] @ turn.T
        return RowPoints(nodes, directors)

    rest, found = drawn_at(parts, 0.0)[0], drawn_at(parts, 0.0, bend=bend, led=led)[0]
    ways = [each.nodes[one, -1, 0] - each.nodes[one, 0, 0] for each in (rest, found)]
    before, after = (np.arctan2(way[1], way[0]) for way in ways)
    assert after - before == pytest.approx(angle, abs=0.02)
    (x, _, z), (at, _, height) = found.nodes[one, 3:, 0].T, rest.nodes[one, :, 0].T
    np.testing.assert_allclose(z, np.interp(x, at, height), atol=1e-4)
    np.testing.assert_allclose(
        np.delete(found.nodes, one, 0), np.delete(rest.nodes, one, 0), atol=2e-4
    )


def test_velocities_are_derivatives_of_what_is_drawn():
    parts, h = plumage(bent), 1e-3
    nodes = [drawn_at(parts, 0.6 + k * h, step=h)[0].nodes for k in (-2, -1, 1, 2)]
    five = (nodes[0] - 8.0 * nodes[1] + 8.0 * nodes[2] - nodes[3]) / (12.0 * h)
    speed = drawn_at(parts, 0.6, step=h)[1].nodes
    rms = np.sqrt((five**2).sum(axis=-1).mean())
    off = np.linalg.norm(speed - five, axis=-1)
    assert np.percentile(off, 99) < 0.03 * rms


@pytest.fixture
def sheet_shot(tmp_path):
    """Write a shot of rigid feathers on a square skin, of which poses gives points a frame."""

    def make(poses, more="", region="length = 0.03"):
        side = np.linspace(0.0, 0.1, 6)
        stage = Usd.Stage.CreateInMemory()
        UsdGeom.SetStageUpAxis(stage, "Z")
        UsdGeom.SetStageMetersPerUnit(stage, 1.0)
        stage.SetTimeCodesPerSecond(24)
        mesh = UsdGeom.Mesh.Define(stage, "/skin")
        x, y = (each.ravel() for each in np.meshgrid(side, side, indexing="ij"))
        corner = (np.arange(5)[:, None] * 6 + np.arange(5)).ravel()
        mesh.CreateFaceVertexCountsAttr([4] * 25)
        mesh.CreateFaceVertexIndicesAttr(
            np.stack([corner, corner + 6, corner + 7, corner + 1], axis=1).ravel().tolist()
        )
        mesh.CreateSubdivisionSchemeAttr("none")
        points = mesh.CreatePointsAttr()
        for frame in range(1, 4):
            found = poses(np.stack([x, y, 0.0 * x], axis=1), frame - 1)
            points.Set(found.astype(np.float32), frame)
        stage.Export(str(tmp_path / "skin.usda"))
        (tmp_path / "groom.toml").write_text(
            "name = 'g'\n[skin]\nusd = 'skin.usda'\nprim = '/skin'\n[layout]\n[[region]]\n"
            f"id = 'r'\nkind = 'body_contour'\ncount = 20\n{region}\n"
            "flow = { direction = [1, 0, 0] }\n"
        )
        shot = tmp_path / "shot.toml"
        shot.write_text(
            "name = 's'\ngroom = 'groom.toml'\nframes = [1, 3]\nquality = 'draft'\n"
            f"[skin]\nusd = 'skin.usda'\nprim = '/skin'\n[[detail]]\nlevel = 'rigid'\n{more}"
        )
        return featherfx.read_shot(shot)

    return make


SLOW = 5e-5  # m a frame


@pytest.mark.parametrize(
    "poses",
    [
        lambda points, k: points + SLOW * k * np.array([0.0, 1.0, 1.0]),
        lambda points, k: points @ vectors_to_frames(SLOW * k / 0.1 * AXIS),
        lambda points, k: points * (1.0 + SLOW * k / 0.1),
    ],
)
def test_velocities_on_a_slow_skin_have_no_noise_of_single_precision(sheet_shot, poses):
    frames = list(simulate(sheet_shot(poses), subframes=8))
    poses = [[(pose.points.nodes, pose.velocities.nodes) for pose in each.poses] for each in frames]
    # samples of one straight line of the drawn skin
    nodes, speeds = np.moveaxis(np.array(poses)[:9], 2, 0)
    first, second, _, fourth, fifth = (nodes[k : k + 5] for k in range(5))
    five = (first - 8.0 * second + 8.0 * fourth - fifth) / (12.0 / 24.0 / 8.0)
    off = np.linalg.norm(speeds[2:7] - five, axis=-1)
    rms = np.sqrt((five**2).sum(axis=-1).mean())
    assert np.percentile(off, 99) < 0.03 * rms


@pytest.mark.parametrize(("length", "roll"), [(0.006, 40.0), (0.03, 0.52)])
def test_a_channel_rolls_feathers_as_far_as_leaves_leave_room(sheet_shot, length, roll):
    turned = {}
    for angle in (0, 40):
        shot = sheet_shot(
            lambda points, k: points + np.outer(0.02 * k * points[:, 0], [0.0, 0.0, 1.0]),
            f"[[channel]]\nname = 'turn'\nkeys = [[1, {angle}]]\n",
            f"length = {length}",
        )
        with warnings.catch_warnings(record=True) as told:
            warnings.simplefilter("always")
            *_, last = simulate(shot)
        turned[angle] = [pose.points.directors[1, 1] for pose in last.poses]
    found = [np.degrees(np.arccos(a @ b)) for a, b in zip(*turned.values(), strict=True)]
    assert np.median(found) == pytest.approx(roll, rel=0.1)
    said = [str(each.message) for each in told if "of the coat roll" in str(each.message)]
    assert len(said) == (roll < 40.0)
    assert all("of 40 degrees" in each for each in said)


@pytest.mark.parametrize("name", ["turn", "fan"])
def test_a_coat_that_channels_move_without_a_skin_is_told(sheet_shot, tmp_path, name):
    sheet_shot(lambda points, k: points, f"[[channel]]\nname = '{name}'\nkeys = [[1, 5]]\n")
    text = re.sub(r"(?m)^\[skin\]\n|^(usd|prim) = .*\n", "", (tmp_path / "shot.toml").read_text())
    (tmp_path / "bare.toml").write_text(text)
    shot = featherfx.read_shot(tmp_path / "bare.toml")
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        list(simulate(shot))
    said = [str(each.message) for each in told if "one by one" in str(each.message)]
    assert len(said) == (name == "turn")
    assert all("20 feathers of the coat" in each for each in said)


def count_intersecting(drawn, points: RowPoints) -> int:
    """Count the pairs of feathers whose vanes intersect."""
    own = points.each()
    placed = [feather.surface.points(each) for feather, each in zip(drawn, own, strict=True)]
    meshes = [
        (each, feather.surface.triangles, feather.surface.part == RACHIS_PART, k)
        for k, (each, feather) in enumerate(zip(placed, drawn, strict=True))
    ]
    found = find_intersections(np.concatenate(placed), make_patches(meshes))
    return int((found.vanes > 0).sum())


@pytest.mark.parametrize("pitch", [-60.0, -10.0, 10.0, 35.0, 80.0])
@pytest.mark.parametrize("chosen", [slice(None), slice(0, None, 3), slice(20)])
def test_feathers_that_channels_raise_stay_in_order(pitch, chosen):
    """All of them, some among others, and one side of a border, on a bent skin."""
    placements, drawn, _ = parts = plumage(bent)
    led = np.array([each.rotation for each in placements])
    turn = vectors_to_frames(np.array([0.0, -np.radians(pitch), 0.0]))
    led[chosen] = led[chosen] @ turn

    def bend(points: RowPoints) -> RowPoints:
        roots = [RowPoints(points.nodes[:, :1, :1], points.directors[:, :1])]
        return stacked(
            [place(f.rest, x[0, 0], r) for f, x, r in zip(drawn, roots[0].nodes, led, strict=True)]
        )

    rest, still = drawn_at(parts, 0.0)[0], drawn_at(parts, 0.5)[0]
    found = drawn_at(parts, 0.5, bend=bend, led=led)[0]
    np.testing.assert_allclose(lengths(found), lengths(rest), rtol=1e-6, atol=1e-12)
    up, at = heights(found, 0.5)
    assert_in_order(placements, up, at, overlapping=pitch < 70.0)
    assert count_intersecting(drawn, found) <= count_intersecting(drawn, still)
    if pitch > 0.0 and chosen == slice(None):
        angles = [
            np.degrees(np.arctan2(up[:, -1] - up[:, 3], at[:, -1] - at[:, 3]))
            for up, at in (heights(each, 0.5) for each in (still, found))
        ]
        assert np.median(angles[1] - angles[0]) == pytest.approx(pitch, rel=0.2)


def test_barbs_that_channels_raise_from_a_hollow_do_not_turn_over():
    """Normals of a hollow meet over it, at less than half of the length of its feathers."""
    parts = plumage(lambda points, time: points, hollow=10.5, above=np.empty((0, 3)))
    placements, drawn, _ = parts
    led = np.array([each.rotation for each in placements])
    led = led @ vectors_to_frames(np.array([0.0, -np.radians(60.0), 0.0]))
    turned = [place(f.rest, p.position, r) for f, p, r in zip(drawn, placements, led, strict=True)]
    rest = drawn_at(parts, 0.0)[0]
    found = drawn_at(parts, 0.0, bend=lambda _: stacked(turned), led=led)[0]
    np.testing.assert_allclose(lengths(found), lengths(rest), rtol=1e-6, atol=1e-12)
    assert np.median(found.nodes[:, -1, 0, 2] - rest.nodes[:, -1, 0, 2]) > 0.005
    first = [each.nodes[:, :, 1::4] - each.nodes[:, :, :1] for each in (rest, found)]
    assert np.sum(first[0] * first[1], axis=-1).min() > -1e-12


@pytest.mark.parametrize(("asked", "length"), [("tilt", 0.03), ("roll", 0.03), ("roll", 0.006)])
def test_variation_without_room_is_reported(sheet_shot, tmp_path, asked, length):
    region = f"length = {length}\nvariation = {{ {asked} = 12 }}"
    shot = sheet_shot(lambda points, k: points, region=region)
    report = featherfx.bake(shot, tmp_path / "cache.usdc").report["variation_cut"]
    if length < 0.01:  # feathers that do not overlap
        assert report == {}
        return
    own, name = {"tilt": ("tip", "roll"), "roll": ("roll", "tip")}[asked]
    assert 10 < report["feathers"] <= report["coat"] == 20
    assert name not in report
    assert report[own]["feather"].startswith("r_")
    asked_most = {"tip": length * np.sin(np.radians(40.0)), "roll": 40.0}[own]
    assert 0.1 * asked_most < report[own]["median"] < report[own]["worst"] < asked_most


def test_variation_without_room_is_reported_by_share(sheet_shot, tmp_path):
    shot = sheet_shot(lambda points, k: points, region="length = 0.03\nvariation = { tilt = 12 }")
    path = tmp_path / "cache.usdc"
    shares = [
        featherfx.bake(shot, path, feathers=(k, 3)).report["variation_cut"] for k in (1, 2, 3)
    ]
    whole = featherfx.bake(shot, tmp_path / "whole.usdc").report["variation_cut"]
    for name in ("coat", "feathers"):
        assert sum(each[name] for each in shares) == whole[name]
    worst = max((each["tip"] for each in shares), key=lambda each: each["worst"])
    assert {"worst": worst["worst"], "feather": worst["feather"]} == {
        "worst": whole["tip"]["worst"],
        "feather": whole["tip"]["feather"],
    }


@pytest.mark.parametrize("level", ["guided", "rigid"])
def test_shares_of_a_coat_lie_on_the_field_of_the_whole(sheet_shot, level):
    def waved(points, k):
        return points + np.outer(0.002 * k * np.sin(40.0 * points[:, 0]), (0.0, 0.0, 1.0))

    more = (
        "level = 'guided'\nevery = 4" if level == "guided" else "feathers='r_[0-7]*'\nlevel='full'"
    )
    shot = sheet_shot(waved, f"[[detail]]\n{more}\n[wind]\nbase = 'breeze'\n")
    whole = list(simulate(shot))
    moved = max(np.abs(pose.velocities.nodes).max() for pose in whole[-1].poses)
    assert moved > 1e-3
    for wanted in (range(0, 7), range(7, 8), range(8, 20)):
        for frame, expected in zip(simulate(shot, wanted=wanted), whole, strict=True):
            for number, pose in zip(wanted, frame.poses, strict=True):
                for name, off in (("points", 1e-12), ("velocities", 1e-9), ("accelerations", 1e-6)):
                    one, other = (getattr(of, name) for of in (pose, expected.poses[number]))
                    np.testing.assert_allclose(one.nodes, other.nodes, rtol=0.0, atol=off)
