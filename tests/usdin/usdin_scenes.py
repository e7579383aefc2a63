"""Small USD scenes and shots, written to a folder by the tests of this package."""

from pathlib import Path

import numpy as np
from places import COARSE
from pxr import Gf, Sdf, Usd, UsdGeom, UsdSkel, Vt

from featherfx.groom.course import turn

TYPES = Sdf.ValueTypeNames


def new_stage(path, meters_per_unit=1.0, up_axis="Z", codes_per_second=24.0):
    stage = Usd.Stage.CreateNew(str(path))
    UsdGeom.SetStageMetersPerUnit(stage, meters_per_unit)
    UsdGeom.SetStageUpAxis(stage, up_axis)
    stage.SetTimeCodesPerSecond(codes_per_second)
    return stage


def arc(length=0.2, camber=30.0, sweep=10.0, points=21):
    """A shaft in the feather's frame that turns steadily."""
    share = np.linspace(0.0, 1.0, points)
    _, mean = turn(share[:, None] * np.radians([0.0, camber, -sweep]))
    return length * share[:, None] * mean


def add_curves(stage, path, curves, kind="covert", up=(0, 0, 1), ids=None, **primvars):
    prim = UsdGeom.BasisCurves.Define(stage, path)
    prim.CreateTypeAttr("linear")
    prim.CreateCurveVertexCountsAttr([len(curve) for curve in curves])
    prim.CreatePointsAttr(Vt.Vec3fArray.FromNumpy(np.vstack(curves).astype(np.float32)))
    api = UsdGeom.PrimvarsAPI(prim)
    if kind:
        api.CreatePrimvar("featherKind", TYPES.String, "constant").Set(kind)
    if up is not None:
        api.CreatePrimvar("up", TYPES.Vector3f, "constant").Set(Gf.Vec3f(*up))
    if ids:
        api.CreatePrimvar("featherId", TYPES.StringArray, "uniform").Set(ids)
    for name, (kind_of, value) in primvars.items():
        api.CreatePrimvar(name, kind_of, "uniform").Set(value)
    return prim


def add_matrix(prim, rows, time=None):
    op = UsdGeom.Xformable(prim).GetOrderedXformOps()
    op = op[0] if op else UsdGeom.Xformable(prim).AddTransformOp()
    op.Set(
        Gf.Matrix4d(*np.asarray(rows, float).ravel().tolist()), *(() if time is None else (time,))
    )


def rigid(degrees, axis, shift):
    """(4, 4) row-vector matrix."""
    turned = Gf.Matrix4d().SetRotate(Gf.Rotation(Gf.Vec3d(*axis), degrees))
    return np.array(turned * Gf.Matrix4d().SetTranslate(Gf.Vec3d(*shift)))


def sheet(columns=8, rows=8, size=0.4):
    """Points (V, 3), counts and indices of a square of quads in z = 0 around the origin."""
    x, y = np.meshgrid(
        np.linspace(-size / 2, size / 2, columns + 1), np.linspace(-size / 2, size / 2, rows + 1)
    )
    points = np.column_stack([x.ravel(), y.ravel(), np.zeros(x.size)])
    first = (np.arange(rows)[:, None] * (columns + 1) + np.arange(columns)).ravel()
    quads = np.stack([first, first + 1, first + columns + 2, first + columns + 1], axis=1)
    return points, np.full(len(quads), 4), quads


def add_mesh(stage, path, points, counts, indices):
    mesh = UsdGeom.Mesh.Define(stage, path)
    mesh.CreateSubdivisionSchemeAttr("none")
    mesh.CreateFaceVertexCountsAttr(Vt.IntArray.FromNumpy(np.asarray(counts, np.int32)))
    mesh.CreateFaceVertexIndicesAttr(Vt.IntArray.FromNumpy(np.ravel(indices).astype(np.int32)))
    if points is not None:
        mesh.CreatePointsAttr(vec(points))
    return mesh


def lifted(points, height):
    return points + np.array([0, 0, height])


def vec(points):
    return Vt.Vec3fArray.FromNumpy(np.asarray(points, np.float32))


def add_skinned(stage, root="/bird"):
    """A sheet on two joints; the second, on x > 0, turns 90 deg about x between 1 and 25."""
    UsdSkel.Root.Define(stage, root)
    skeleton = UsdSkel.Skeleton.Define(stage, f"{root}/skeleton")
    joints = ["body", "body/wing"]
    still = Gf.Matrix4d(1)
    skeleton.CreateJointsAttr(joints)
    skeleton.CreateBindTransformsAttr([still, still])
    skeleton.CreateRestTransformsAttr([still, still])
    animation = UsdSkel.Animation.Define(stage, f"{root}/motion")
    animation.CreateJointsAttr(joints)
    animation.CreateTranslationsAttr([(0, 0, 0), (0, 0, 0)])
    animation.CreateScalesAttr(Vt.Vec3hArray([Gf.Vec3h(1), Gf.Vec3h(1)]))
    rotations = animation.CreateRotationsAttr()
    half = np.sqrt(0.5)
    one = Gf.Quatf(1)
    # frame 1 is not the bind pose
    rotations.Set(Vt.QuatfArray([one, Gf.Quatf(float(half), -float(half), 0, 0)]), 1)
    rotations.Set(Vt.QuatfArray([one, Gf.Quatf(float(half), float(half), 0, 0)]), 25)
    animation.CreateBlendShapesAttr(["bulge"])
    weights = animation.CreateBlendShapeWeightsAttr()
    weights.Set([0.0], 1)
    weights.Set([1.0], 25)
    points, counts, quads = sheet()
    mesh = add_mesh(stage, f"{root}/skin", points, counts, quads)
    binding = UsdSkel.BindingAPI.Apply(mesh.GetPrim())
    binding.CreateSkeletonRel().SetTargets([skeleton.GetPath()])
    binding.CreateJointIndicesPrimvar(False, 1).Set((points[:, 0] > 0).astype(int).tolist())
    binding.CreateJointWeightsPrimvar(False, 1).Set([1.0] * len(points))
    api = UsdSkel.BindingAPI.Apply(skeleton.GetPrim())
    api.CreateAnimationSourceRel().SetTargets([animation.GetPath()])
    shape = UsdSkel.BlendShape.Define(stage, f"{root}/skin/bulge")
    shape.CreateOffsetsAttr(vec([[0, 0, 0.1]] * 5))
    shape.CreatePointIndicesAttr([0, 1, 2, 40, 44])
    binding.CreateBlendShapesAttr(["bulge"])
    binding.CreateBlendShapeTargetsRel().SetTargets([shape.GetPath()])
    return mesh


def write_shot(folder, skin, frames=(1, 25), name="shot.toml", groom=None, more=""):
    """A shot with a row of coverts on z = 0, or the groom given, and the [skin] lines given."""
    folder = Path(folder)
    if groom is None:
        groom = "groom.toml"
        (folder / groom).write_text(
            'name = "patch"\n'
            "[[row]]\n"
            'id = "covert"\nkind = "covert"\ncount = 5\n'
            "first = { position = [-0.15, 0.013, 0], direction = [1, 0, 0.2], up = [0, 0, 1] }\n"
            "last = { position = [0.15, 0.017, 0.002], direction = [1, 0.3, 0.2], "
            "up = [0, 0, 1] }\n"
        )
    text = f'name = "patch"\ngroom = "{groom}"\nframes = [{frames[0]}, {frames[1]}]\n'
    text += COARSE + more
    if skin is not None:
        text += f"[skin]\n{skin}\n"
    path = folder / name
    path.write_text(text)
    return path
