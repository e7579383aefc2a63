"""A bird of cubes, one a bone, whose body stands or walks, and shots of acts that move it."""

import numpy as np
from pxr import Gf, Usd, UsdGeom, UsdSkel, Vt

from featherfx.groom.read.read import read_groom

GROOM = """
name = "bird"
[[wing]]
id = "right_wing"
type = "pigeon"
shoulder = [0.03, -0.03, 0.03]
fold = 0
mirror = "y"
[[feather]]
id = "breast"
kind = "contour"
position = [0.02, 0, 0.05]
direction = [-1, 0, 0.2]
up = [0, 0, 1]
"""
TURN, WAY = (0.0, -30.0, 10.0), (0.2, 0.1, 0.4)
SHOT = f"""
name = "s"
groom = "groom.toml"
frames = [1, 7]
quality = "draft"
[skin]
usd = "body.usda"
prim = "/bird/body"
tolerance = 1
[[detail]]
level = "rigid"
[motion]
kind = "act"
body = "act"
[[motion.motions]]
kind = "keys"
keyframes = [
  {{ time = 0, rotation = [0, 0, 0], position = [0, 0, 0] }},
  {{ time = 0.25, rotation = {list(TURN)}, position = {list(WAY)} }},
]
[[motion.motions]]
kind = "fold"
joints = "*_wing_*"
folds = [{{ time = 0, fold = 0 }}, {{ time = 0.25, fold = 0.5 }}]
"""
CUBE = 0.05 * np.array([(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
FACES = np.array([0, 1, 3, 2, 4, 6, 7, 5, 0, 4, 5, 1, 2, 3, 7, 6, 0, 2, 6, 4, 1, 5, 7, 3])
WALK = np.array((0.01, 0.0, 0.004))  # m a frame
BONES = ("right_wing_shoulder", "right_wing_elbow", "right_wing_wrist")
JOINTS = ("root", "root/arm", "root/arm/fore", "root/arm/fore/hand", "root/arm/fore/hand/tip")


def points_of(points, up, unit):
    """Vt array of points (..., 3) m, z up, in the axes and units of a stage."""
    turned = points[..., [0, 2, 1]] * (1, 1, -1) if up == "Y" else points
    return Vt.Vec3fArray.FromNumpy(np.float32(turned / unit).reshape(-1, 3))


def bone_places(folder):
    """(4, 3) m, joints of the bones of the right wing, and the end of the last."""
    joints = {each.name: each.position for each in read_groom(folder / "groom.toml").joints}
    places = np.array([joints[name] for name in BONES])
    return np.vstack([places, places[-1] + (0.0, -0.1, 0.0)])


def define_mesh(stage, path, points, up, unit):
    mesh, count = UsdGeom.Mesh.Define(stage, path), len(points) // 8
    mesh.CreateFaceVertexCountsAttr([4] * 6 * count)
    mesh.CreateFaceVertexIndicesAttr(np.concatenate([FACES + 8 * k for k in range(count)]).tolist())
    mesh.CreateSubdivisionSchemeAttr("none")
    mesh.CreatePointsAttr(points_of(points, up, unit))
    return mesh


def write_body(path, kind, up="Z", unit=1.0, bones=()):
    """Write a cube, and small ones at bones (K, 3) m; return their points at rest, m.

    kind: still, or what walks: points, or a skeleton with a joint at each cube.
    """
    places = np.vstack([np.zeros((1, 3)), *np.reshape(bones, (-1, 1, 3))])
    cubes = np.concatenate([CUBE, *(0.2 * CUBE + each for each in places[1:])])
    stage = Usd.Stage.CreateNew(str(path))
    stage.SetMetadata("metersPerUnit", unit)
    UsdGeom.SetStageUpAxis(stage, up)
    root = UsdSkel.Root if kind == "skeleton" else UsdGeom.Xform
    stage.SetDefaultPrim(root.Define(stage, "/bird").GetPrim())
    mesh = define_mesh(stage, "/bird/body", cubes, up, unit)
    if kind == "points":
        for code in range(1, 8):
            mesh.GetPointsAttr().Set(points_of(cubes + code * WALK, up, unit), code)
    if kind == "skeleton":
        bind_skeleton(stage, mesh, places, up, unit)
    stage.Save()
    return cubes


def bind_skeleton(stage, mesh, places, up, unit):
    count = len(places)
    skeleton = UsdSkel.Skeleton.Define(stage, "/bird/skeleton")
    skeleton.CreateJointsAttr(JOINTS[:count])
    steps = np.diff(places, axis=0, prepend=0.0)
    for make, at in (
        (skeleton.CreateBindTransformsAttr, places),
        (skeleton.CreateRestTransformsAttr, steps),
    ):
        make([Gf.Matrix4d().SetTranslate(Gf.Vec3d(each)) for each in points_of(at, up, unit)])
    walk = UsdSkel.Animation.Define(stage, "/bird/walk")
    walk.CreateJointsAttr(JOINTS[:count])
    walk.CreateScalesAttr([Gf.Vec3h(1.0)] * count)
    walk.CreateRotationsAttr([Gf.Quatf(1.0)] * count)
    for code in range(1, 8):
        moved = steps + code * WALK * (np.arange(count) == 0)[:, None]
        walk.CreateTranslationsAttr().Set(points_of(moved, up, unit), code)
    binding = UsdSkel.BindingAPI.Apply(mesh.GetPrim())
    binding.CreateSkeletonRel().SetTargets(["/bird/skeleton"])
    binding.CreateJointIndicesPrimvar(False, 1).Set(np.repeat(np.arange(count), 8).tolist())
    binding.CreateJointWeightsPrimvar(False, 1).Set([1.0] * 8 * count)
    source = UsdSkel.BindingAPI.Apply(skeleton.GetPrim()).CreateAnimationSourceRel()
    source.SetTargets(["/bird/walk"])
