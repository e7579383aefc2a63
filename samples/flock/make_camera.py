"""Makes camera.usda: a camera that looks at the path of the flock from the side.

python samples/flock/make_camera.py
"""

from pathlib import Path

from pxr import Gf, Usd, UsdGeom

EYE, AT = Gf.Vec3d(14.0, -9.0, 11.0), Gf.Vec3d(16.0, 0.0, 12.0)

stage = Usd.Stage.CreateNew(str(Path(__file__).parent / "camera.usda"))
UsdGeom.SetStageMetersPerUnit(stage, 1.0)
UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.z)
camera = UsdGeom.Camera.Define(stage, "/camera")
view = Gf.Matrix4d().SetLookAt(EYE, AT, Gf.Vec3d(0, 0, 1))
camera.AddTransformOp().Set(view.GetInverse())
camera.CreateFocalLengthAttr(35.0)
stage.SetDefaultPrim(camera.GetPrim())
stage.GetRootLayer().Save()
