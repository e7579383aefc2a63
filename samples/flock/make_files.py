"""Makes body.usdc, the pigeon of samples/pigeon standing still, and camera.usda.

The camera looks at the flock from the side.

python samples/flock/make_files.py
"""

from pathlib import Path

from pxr import Gf, Sdf, Usd, UsdGeom, UsdSkel

HERE = Path(__file__).parent
EYE, AT = Gf.Vec3d(10.5, -11.0, 10.9), Gf.Vec3d(9.5, -1.4, 11.75)


def write_body(path):
    layer = Sdf.Layer.CreateAnonymous()
    layer.TransferContent(Sdf.Layer.FindOrOpen(str(HERE.parent / "pigeon/body.usdc")))
    stage = Usd.Stage.Open(layer)
    for prim in list(stage.Traverse()):
        if prim.IsA(UsdSkel.Animation):
            stage.RemovePrim(prim.GetPath())
        elif prim.HasRelationship("skel:animationSource"):
            prim.RemoveProperty("skel:animationSource")
    layer.ClearStartTimeCode()
    layer.ClearEndTimeCode()
    layer.Export(str(path))


def write_camera(path):
    stage = Usd.Stage.CreateNew(str(path))
    UsdGeom.SetStageMetersPerUnit(stage, 1.0)
    UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.z)
    camera = UsdGeom.Camera.Define(stage, "/camera")
    view = Gf.Matrix4d().SetLookAt(EYE, AT, Gf.Vec3d(0, 0, 1))
    camera.AddTransformOp().Set(view.GetInverse())
    camera.CreateFocalLengthAttr(30.0)
    stage.SetDefaultPrim(camera.GetPrim())
    stage.GetRootLayer().Save()


if __name__ == "__main__":
    write_body(HERE / "body.usdc")
    (HERE / "camera.usda").unlink(missing_ok=True)
    write_camera(HERE / "camera.usda")
