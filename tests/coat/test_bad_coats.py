"""Skins and flows on which a coat cannot lie well: each is reported with its place."""

from __future__ import annotations

import re
import warnings

import numpy as np
import pytest
from pxr import Usd, UsdGeom

import featherfx
from featherfx.errors import InputError, InputWarning

SIDE, STEPS, LENGTH = 0.2, 15, 0.03
FORWARD = "flow = { direction = [1, 0, 0] }"
NUMBER = r"-?[\d.e-]+"


def sheet(keep=lambda x, y: np.full_like(x, True, dtype=bool), z=0.0):
    """Points and quads of a square, of which some quads are left out by their middles."""
    line = np.linspace(-0.5 * SIDE, 0.5 * SIDE, STEPS)
    x, y = (each.ravel() for each in np.meshgrid(line, line, indexing="ij"))
    points = np.stack([x, y, np.full_like(x, z)], axis=1)
    corner = (np.arange(STEPS - 1)[:, None] * STEPS + np.arange(STEPS - 1)).ravel()
    faces = corner[:, None] + [0, STEPS, STEPS + 1, 1]
    middle = points[faces].mean(axis=1)
    return points, faces[keep(middle[:, 0], middle[:, 1])]


def two_sheets(gap):
    points, faces = sheet()
    return np.concatenate([points, points + np.array([0.0, 0.0, gap])]), np.concatenate(
        [faces, faces + len(points)]
    )


def fin(thickness):
    """A closed plate."""
    (points, upper), n = sheet(z=0.5 * thickness), STEPS * STEPS
    rim = np.arange(n).reshape(STEPS, STEPS)
    rim = np.concatenate([rim[:-1, 0], rim[-1, :-1], rim[:0:-1, -1], rim[0, :0:-1]])
    sides = np.stack([np.roll(rim, -1), rim, rim + n, np.roll(rim, -1) + n], axis=1)
    low = points * [1.0, 1.0, -1.0]
    return np.concatenate([points, low]), np.concatenate([upper, upper[:, ::-1] + n, sides])


def ball(radius, stretch=(1.0, 1.0, 1.0)):
    """A cube whose points are moved to a sphere."""
    points, faces, line = [], [], np.linspace(-1.0, 1.0, 9)
    a, b = (each.ravel() for each in np.meshgrid(line, line, indexing="ij"))
    corner = (np.arange(8)[:, None] * 9 + np.arange(8)).ravel()
    quads = corner[:, None] + [0, 9, 10, 1]
    for axis in range(3):
        for side in (1.0, -1.0):
            face = np.stack([side * np.ones_like(a), a, side * b], axis=1)
            faces.append(quads + 81 * len(points))
            points.append(np.roll(face, axis, axis=1))
    every, number = np.unique(np.concatenate(points).round(9), axis=0, return_inverse=True)
    every = radius * every / np.linalg.norm(every, axis=1, keepdims=True)
    return every * stretch, number.ravel()[np.concatenate(faces)]


def region(name, count=60, length=LENGTH, flow=FORWARD, where=""):
    return (
        f"[[region]]\nid = '{name}'\nkind = 'body_contour'\ncount = {count}\nlength = {length}\n"
        f"{where}\n{flow}\n"
    )


def half(name, side, degrees):
    """A region on one side of x = 0 whose feathers point towards it, at an angle to x."""
    x, y = -side * np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    where = f"where = [{{ x = {[-1, 0] if side < 0 else [0, 1]} }}]"
    return region(name, flow=f"flow = {{ direction = [{x}, {y}, 0] }}", where=where)


@pytest.fixture
def write(tmp_path):
    """Write a skin, in a pose a frame if there are several, and a shot with its groom."""

    def make(points, faces, regions, poses=()):
        stage = Usd.Stage.CreateNew(str(tmp_path / "skin.usda"))
        UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.z)
        UsdGeom.SetStageMetersPerUnit(stage, 1.0)
        stage.SetTimeCodesPerSecond(24)
        mesh = UsdGeom.Mesh.Define(stage, "/body")
        mesh.CreateFaceVertexCountsAttr([4] * len(faces))
        mesh.CreateFaceVertexIndicesAttr(faces.ravel().tolist())
        mesh.CreateSubdivisionSchemeAttr("none")
        mesh.CreatePointsAttr(points.astype(np.float32))
        for frame, pose in enumerate(poses, 1):
            mesh.GetPointsAttr().Set(pose.astype(np.float32), frame)
        stage.Save()
        skin = "[skin]\nusd = 'skin.usda'\nprim = '/body'\n"
        (tmp_path / "groom.toml").write_text(f"name = 'g'\n{skin}[layout]\n{regions}")
        path = tmp_path / "shot.toml"
        path.write_text(
            f"name = 's'\ngroom = 'groom.toml'\nframes = [1, {max(len(poses), 1)}]\n"
            f"quality = 'draft'\n{skin}[[detail]]\nlevel = 'rigid'\n"
        )
        return path

    return make


def messages_of(path):
    """Read and lay out the groom of a shot; its warnings, in which the coat names its skin."""
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always", InputWarning)
        featherfx.read_groom(path.with_name("groom.toml"))
    found = [str(each.message) for each in told]
    assert all(": layout: /body: " in each for each in found if "layout" in each)
    return found


def place_in(message):
    """The place (3,) m that a message names."""
    found = re.search(rf"\(({NUMBER}), ({NUMBER}), ({NUMBER})\) m", message)
    return np.array([float(each) for each in found.groups()])


@pytest.mark.parametrize(
    "flow", ["away = [0, 0, 0]", "towards = [0, 0, 0]", "away = [0.04, 0.03, 0]"]
)
def test_a_singular_flow_is_reported_with_its_place(write, flow):
    regions = region("whorl", count=150, flow=f"flow = {{ {flow} }}")
    found = messages_of(write(*sheet(), regions))
    (message,) = (each for each in found if "flow is singular" in each)
    middle = np.array(re.findall(NUMBER, flow.partition("[")[2]), dtype=float)
    assert np.linalg.norm(place_in(message) - middle) < LENGTH


@pytest.mark.parametrize("degrees", [0.0, 2.0, 4.0])
def test_regions_that_flow_towards_each_other_are_reported_at_their_ridge(write, degrees):
    path = write(*sheet(), half("left", -1, degrees) + half("right", 1, degrees))
    told = [each for each in messages_of(path) if "layout" in each]
    assert told
    for message in told:
        if "as at" in message:
            assert abs(place_in(message)[0]) < LENGTH


@pytest.mark.parametrize(
    "skin",
    [
        sheet(lambda x, y: np.hypot(x, y) > 0.04),
        sheet(lambda x, y: (np.abs(y) > 0.02) | (x < 0.0)),
        two_sheets(0.004),
    ],
)
def test_a_skin_with_holes_or_two_sheets_is_reported_with_its_faces(write, skin):
    path = write(*skin, region("all"))
    (message,) = (each for each in messages_of(path) if "closed" in each)
    assert "/body" in message
    assert re.search(r"faces \d+", message)


@pytest.mark.parametrize("thickness", [0.001, 0.002, 0.004])
def test_feathers_on_both_sides_of_a_thin_fin_are_reported_at_its_rim(write, thickness):
    path = write(*fin(thickness), region("both", count=250))
    (message,) = (each for each in messages_of(path) if "flow is singular" in each)
    assert np.abs(place_in(message)).max() > 0.5 * SIDE - LENGTH


def test_a_flat_coat_without_gaps_is_laid_and_told_of_nothing(write):
    path = write(*sheet(), region("close"))
    groom = path.with_name("groom.toml")
    groom.write_text(groom.read_text().replace("[layout]", "[layout]\ngap = 0"))
    with np.errstate(all="raise"):
        assert not [each for each in messages_of(path) if "layout" in each]


@pytest.mark.parametrize(("count", "length"), [(2, 0.01), (5, 0.006), (9, 0.004)])
def test_a_coat_without_overlap_is_reported_with_a_place(write, count, length):
    path = write(*sheet(), region("few", count=count, length=length))
    (message,) = (each for each in messages_of(path) if "none of" in each)
    assert f"none of {count} feathers" in message
    assert np.abs(place_in(message)).max() <= 0.5 * SIDE


@pytest.mark.parametrize("skin", [ball(0.02), ball(0.02, (1.0, 0.5, 0.7)), fin(0.01)])
def test_feathers_longer_than_their_body_are_refused(write, skin):
    path = write(*skin, region("long", length=0.4))
    with pytest.raises(
        InputError, match=r"region\[0\]\.length: .* longer than the whole skin /body"
    ):
        featherfx.read_groom(path.with_name("groom.toml"))


@pytest.mark.parametrize("mirror", [(-1, -1, -1), (1, 1, -1), (-1, 1, 1)])
def test_a_skin_that_turns_inside_out_is_reported_with_its_frame(write, mirror):
    points, faces = ball(0.06)
    path = write(points, faces, region("all", count=20), [points, points, points * mirror])
    with pytest.warns(InputWarning, match="/body: turns inside out at frame 3"):
        assert len(list(featherfx.simulate(featherfx.read_shot(path)))) == 3
