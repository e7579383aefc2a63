"""Coverts above and below a thin wing, which curl through it and through each other at rest."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from pxr import Usd, UsdGeom, Vt

from featherfx.api import read_shot
from featherfx.shot.loop.simulate import Simulation, simulate

# m, half the wing's thickness
HALF = 0.001
ROW = """[[row]]
id = "{name}"
kind = "covert"
count = 3
first = {{ position = [0.04, 0.035, {height}], direction = [-1, 0, 0], up = [0, 0, {up}] }}
last = {{ position = [0.04, -0.035, {height}], direction = [-1, 0, 0], up = [0, 0, {up}] }}
scale = [2.2, 2.2]
width = 1.2
lift = -0.0005
"""
SHOT = """name = "plate"
groom = "groom.toml"
frames = [1, 1]
frames_per_second = 24
quality = { base = "draft", rows = 7, simulated_rows = 7, simulated_columns = 2 }
overrides = { "*" = { stiffness = 0.1 } }
[contact]
"""
SKIN = '[skin]\nusd = "plate.usda"\nprim = "/plate"\n'
COLLIDER = '[[collider]]\nusd = "plate.usda"\nprims = ["/plate"]\n'


def write_plate(path: Path) -> None:
    import trimesh

    mesh = trimesh.creation.box((0.4, 0.3, 2.0 * HALF)).subdivide().subdivide().subdivide()
    stage = Usd.Stage.CreateNew(str(path))
    UsdGeom.SetStageMetersPerUnit(stage, 1.0)
    UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.z)
    plate = UsdGeom.Mesh.Define(stage, "/plate")
    plate.CreateSubdivisionSchemeAttr("none")
    points = np.asarray(mesh.vertices, dtype=np.float32) - np.float32([0.1, 0.0, 0.0])
    plate.CreatePointsAttr(Vt.Vec3fArray.FromNumpy(points))
    plate.CreateFaceVertexCountsAttr([3] * len(mesh.faces))
    plate.CreateFaceVertexIndicesAttr(mesh.faces.ravel().tolist())
    stage.GetRootLayer().Save()


def settled(folder: Path, body: str) -> tuple[Simulation, list[np.ndarray]]:
    """The shot, and m, how far each feather's vane is on its own side of the plate's middle."""
    write_plate(folder / "plate.usda")
    rows = [ROW.format(name=n, height=up * 0.003, up=up) for n, up in (("upper", 1), ("under", -1))]
    on_skin = body if body == SKIN else ""
    (folder / "groom.toml").write_text(f'name = "plate"\n{on_skin}' + "".join(rows))
    (folder / "shot.toml").write_text(SHOT + body + ("tolerance = 0.05\n" if on_skin else ""))
    simulation = simulate(read_shot(folder / "shot.toml"))
    (frame,) = simulation
    sides = []
    for feather, points in zip(simulation.feathers, frame.rows, strict=True):
        vane = np.unique(feather.surface.triangles[feather.surface.part < 2])
        height = feather.surface.points(points)[vane, 2]
        sides.append(height if feather.surface.points(points)[0, 2] > 0.0 else -height)
    return simulation, sides


@pytest.mark.parametrize("body", [SKIN, COLLIDER], ids=["skin", "collider"])
def test_coverts_of_both_sides_stay_on_theirs(tmp_path, body):
    simulation, sides = settled(tmp_path, body)
    contact = simulation.report["contact"]
    assert contact["feathers_raised_before_settling"] == 6
    assert contact["depth_after_settling"] < 1e-4
    assert min(side.min() for side in sides) > 0.9 * HALF
