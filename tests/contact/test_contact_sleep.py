"""Bodies of every kind wake the feathers that they come near."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from pxr import Gf, Usd, UsdGeom, UsdSkel, Vt

import featherfx

GROOM = """
name = "one"
[[feather]]
id = "held"
kind = "swan_primary"
position = [0, 0, 0]
"""
SHOT = """
name = "rising"
groom = "groom.toml"
frames = [1, 8]
frames_per_second = 24
motion = "hold"
quality = "draft"
gravity = [0, 0, 0]
[contact]
[[collider]]
usd = "body.usda"
prims = ["/body/mesh"]
"""
LAST, SPEED, BELOW = 8, 1.2, 0.22


def ball(radius=0.04, sides=8):
    """(V, 3) and faces of a ball round the place that it rises at."""
    points = [(0.0, 0.0, -radius), (0.0, 0.0, radius)]
    for k in range(1, sides):
        height = -np.cos(np.pi * k / sides)
        ring = np.sin(np.pi * k / sides)
        for j in range(sides):
            angle = 2.0 * np.pi * j / sides
            at = ring * np.cos(angle), ring * np.sin(angle), height
            points.append(tuple(radius * each for each in at))
    faces = []
    for j in range(sides):
        after = (j + 1) % sides
        faces.append((0, 2 + after, 2 + j))
        top = 2 + (sides - 2) * sides
        faces.append((1, top + j, top + after))
        for k in range(sides - 2):
            low, high = 2 + k * sides, 2 + (k + 1) * sides
            faces.append((low + j, low + after, high + after))
            faces.append((low + j, high + after, high + j))
    return np.array(points) + np.array((0.15, 0.0, -BELOW)), faces


def way(frame):
    return (0.0, 0.0, SPEED * (frame - 1) / 24.0)


def by_points(stage, mesh, points):
    for frame in (1, LAST):
        values = Vt.Vec3fArray.FromNumpy((points + way(frame)).astype(np.float32))
        mesh.GetPointsAttr().Set(values, frame)


def by_transform(stage, mesh, points):
    move = mesh.AddTranslateOp()
    for frame in (1, LAST):
        move.Set(Gf.Vec3d(*way(frame)), frame)


def by_parent(stage, mesh, points):
    move = UsdGeom.Xformable(stage.GetPrimAtPath("/body")).AddTranslateOp()
    for frame in (1, LAST):
        move.Set(Gf.Vec3d(*way(frame)), frame)


def by_skeleton(stage, mesh, points):
    skeleton = UsdSkel.Skeleton.Define(stage, "/body/skeleton")
    animation = UsdSkel.Animation.Define(stage, "/body/skeleton/animation")
    identity = Vt.Matrix4dArray([Gf.Matrix4d(1.0)])
    skeleton.CreateJointsAttr(["root"])
    skeleton.CreateBindTransformsAttr(identity)
    skeleton.CreateRestTransformsAttr(identity)
    animation.CreateJointsAttr(["root"])
    animation.CreateRotationsAttr(Vt.QuatfArray([Gf.Quatf(1.0)]))
    animation.CreateScalesAttr(Vt.Vec3hArray([Gf.Vec3h(1.0)]))
    for frame in (1, LAST):
        animation.CreateTranslationsAttr().Set(Vt.Vec3fArray([Gf.Vec3f(*way(frame))]), frame)
    binding = UsdSkel.BindingAPI.Apply(skeleton.GetPrim())
    binding.CreateAnimationSourceRel().SetTargets([animation.GetPath()])
    bound = UsdSkel.BindingAPI.Apply(mesh.GetPrim())
    bound.CreateSkeletonRel().SetTargets([skeleton.GetPath()])
    bound.CreateJointIndicesPrimvar(False, 1).Set(Vt.IntArray([0] * len(points)))
    bound.CreateJointWeightsPrimvar(False, 1).Set(Vt.FloatArray([1.0] * len(points)))


def shot_with(folder, animate):
    points, faces = ball()
    stage = Usd.Stage.CreateNew(str(folder / "body.usda"))
    UsdGeom.SetStageUpAxis(stage, "Z")
    UsdGeom.SetStageMetersPerUnit(stage, 1.0)
    stage.SetTimeCodesPerSecond(24)
    UsdSkel.Root.Define(stage, "/body")
    mesh = UsdGeom.Mesh.Define(stage, "/body/mesh")
    mesh.CreateSubdivisionSchemeAttr("none")
    mesh.CreatePointsAttr(Vt.Vec3fArray.FromNumpy(points.astype(np.float32)))
    mesh.CreateFaceVertexCountsAttr([len(face) for face in faces])
    mesh.CreateFaceVertexIndicesAttr([k for face in faces for k in face])
    animate(stage, mesh, points)
    stage.Save()
    (folder / "groom.toml").write_text(GROOM)
    (folder / "shot.toml").write_text(SHOT)
    return featherfx.read_shot(folder / "shot.toml")


def moves(shot):
    simulation = featherfx.simulate(shot)
    frames = [frame.rows[0] for frame in simulation]
    slept = simulation.report["skipped"]["sleeping feather frames"]
    return np.array([np.abs(points - frames[0]).max() for points in frames]), slept


@pytest.mark.parametrize(
    "animate",
    [
        pytest.param(by_points, marks=pytest.mark.slow),
        pytest.param(by_transform, marks=pytest.mark.slow),
        pytest.param(by_parent, marks=pytest.mark.slow),
        by_skeleton,
    ],
)
def test_a_body_that_comes_near_wakes(tmp_path, animate):
    shot = shot_with(tmp_path, animate)
    assert shot.sleep
    (asleep, slept), (awake, _) = moves(shot), moves(replace(shot, sleep=False))
    assert awake[-1] > 0.02
    assert slept >= 3
    np.testing.assert_allclose(asleep, awake, atol=5e-4)
