"""Colliders from USD files, end to end: shot file, stage in other units and axes, simulation."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from pxr import Usd, UsdGeom, Vt

from featherfx.api import read_shot
from featherfx.errors import InputError
from featherfx.shot.loop.simulate import simulate

RADIUS, RISE, FRAMES = 0.02, 0.015, 10
GROOM = """name = "pair"
[[feather]]
id = "low"
kind = "body_contour"
position = [0, 0, 0]
[[feather]]
id = "high"
kind = "body_contour"
position = [0.005, 0.002, 0.002]
"""
SHOT = """name = "bump"
groom = "groom.toml"
frames = [1, 10]
frames_per_second = 24
settle = false
quality = { base = "draft", rows = 9, simulated_rows = 9, simulated_columns = 4 }
[contact]
[[collider]]
usd = "body.usda"
prims = ["/world/ball"]
"""


def ball(code: float) -> tuple[np.ndarray, np.ndarray]:
    """Centre (3,) m in the shot's frame at a frame number, and the faces of the ball's mesh."""
    import trimesh

    mesh = trimesh.creation.icosphere(subdivisions=3, radius=RADIUS)
    rise = RISE * min(max((code - 1.0) / (FRAMES - 1.0), 0.0), 1.0)
    return np.array([0.035, 0.0, -RADIUS - 0.017 + rise]), mesh


def write_body(path: Path) -> None:
    """The ball in centimetres with y up, moved by its parent; time samples at every frame."""
    stage = Usd.Stage.CreateNew(str(path))
    UsdGeom.SetStageMetersPerUnit(stage, 0.01)
    UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.y)
    stage.SetTimeCodesPerSecond(24.0)
    world = UsdGeom.Xform.Define(stage, "/world")
    move = world.AddTranslateOp()
    mesh = UsdGeom.Mesh.Define(stage, "/world/ball")
    mesh.CreateSubdivisionSchemeAttr("none")
    _, shape = ball(1.0)
    x, y, z = 100.0 * np.asarray(shape.vertices).T
    mesh.CreatePointsAttr(Vt.Vec3fArray.FromNumpy(np.stack([x, z, -y], axis=1).astype(np.float32)))
    mesh.CreateFaceVertexCountsAttr([3] * len(shape.faces))
    mesh.CreateFaceVertexIndicesAttr(shape.faces.ravel().tolist())
    for code in range(1, FRAMES + 1):
        x, y, z = 100.0 * ball(code)[0]
        move.Set((x, z, -y), float(code))
    stage.GetRootLayer().Save()


@pytest.fixture
def shot_file(tmp_path: Path) -> Path:
    (tmp_path / "groom.toml").write_text(GROOM)
    (tmp_path / "shot.toml").write_text(SHOT)
    write_body(tmp_path / "body.usda")
    return tmp_path / "shot.toml"


def nearest(simulation, frame) -> float:
    """m, least distance of a vane's point from the ball's centre."""
    centre, _ = ball(frame.number)
    found = []
    for feather, pose in zip(simulation.feathers, frame.poses, strict=True):
        surface = feather.surface
        vane = np.unique(surface.triangles[surface.part < 2])
        found.append(np.linalg.norm(surface.points(pose.points)[vane] - centre, axis=1).min())
    return min(found)


def test_a_ball_of_a_usd_file_lifts_the_feathers(shot_file):
    shot = read_shot(shot_file)
    simulation = simulate(shot)
    frames = list(simulation)
    contact = simulation.report["contact"]
    assert contact["bodies"] == 1
    assert contact["most_contacts"] > 2
    # the flat faces lie inside the sphere by no more than this
    inner = np.linalg.norm(ball(1.0)[1].triangles_center, axis=1).min()
    for frame in frames:
        assert nearest(simulation, frame) > inner
    # what the ball came through without contact
    free = simulate(read_shot(without_contact(shot_file)))
    assert nearest(free, list(free)[-1]) < inner - 1e-3


def without_contact(path: Path) -> Path:
    other = path.with_name("free.toml")
    other.write_text(path.read_text().replace("[contact]", "[contact]\nenabled = false"))
    return other


LEVEL = -0.018
COVERED = """name = "covered"
groom = "groom.toml"
frames = [1, 3]
frames_per_second = 24
settle = false
gravity = [0, 0, -600]
quality = { base = "draft", rows = 9, simulated_rows = 9, simulated_columns = 4 }
[skin]
usd = "skin.usda"
prim = "/skin"
tolerance = 0.02
[contact]
"""


def write_skin(path: Path) -> None:
    """A level sheet under the feathers, of 64 squares."""
    stage = Usd.Stage.CreateNew(str(path))
    UsdGeom.SetStageMetersPerUnit(stage, 1.0)
    UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.z)
    x, y = np.meshgrid(np.linspace(-0.1, 0.1, 9), np.linspace(-0.1, 0.1, 9))
    points = np.stack([x, y, np.full_like(x, LEVEL)], axis=2).reshape(-1, 3)
    first = (np.arange(8)[:, None] * 9 + np.arange(8)).ravel()
    mesh = UsdGeom.Mesh.Define(stage, "/skin")
    mesh.CreateSubdivisionSchemeAttr("none")
    mesh.CreatePointsAttr(Vt.Vec3fArray.FromNumpy(points.astype(np.float32)))
    mesh.CreateFaceVertexCountsAttr([4] * 64)
    mesh.CreateFaceVertexIndicesAttr((first[:, None] + [0, 1, 10, 9]).ravel().tolist())
    stage.GetRootLayer().Save()


def lowest(simulation, frame) -> float:
    """m, of the vanes' points that are not within it from the start."""
    found = []
    for feather, pose in zip(simulation.feathers, frame.poses, strict=True):
        surface = feather.surface
        vane = np.unique(surface.triangles[surface.part < 2])
        found.append(surface.points(pose.points)[vane, 2].min())
    return min(found)


def test_the_skin_holds_what_is_pressed_onto_it(tmp_path):
    (tmp_path / "groom.toml").write_text(GROOM)
    write_skin(tmp_path / "skin.usda")
    found = {}
    for told in ("", "skin = false"):
        (tmp_path / "shot.toml").write_text(f"{COVERED}{told}\n")
        simulation = simulate(read_shot(tmp_path / "shot.toml"))
        found[told] = [lowest(simulation, frame) for frame in simulation]
        assert simulation.report["contact"]["bodies"] == int("skin" not in told)
    held, through = found.values()
    assert held[0] > LEVEL
    assert min(held) > LEVEL - 2e-5
    assert min(through) < LEVEL - 2e-3


def test_a_collider_that_is_not_there_is_named(shot_file):
    shot_file.write_text(SHOT.replace("/world/ball", "/world/bell"))
    with pytest.raises(InputError, match="/world/bell"):
        read_shot(shot_file)
