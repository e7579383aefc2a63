"""Stages with meshes, as several packages' tests write them."""

import numpy as np
from pxr import Usd, UsdGeom, Vt

SQUARE = np.array([(-1.0, -1.0, 0.0), (1.0, -1.0, 0.0), (1.0, 1.0, 0.0), (-1.0, 1.0, 0.0)])


def new_stage(path, unit=1.0, up="Z", rate=None):
    """Open a new stage. path: None for memory. unit: m. rate: time codes a second."""
    stage = Usd.Stage.CreateInMemory() if path is None else Usd.Stage.CreateNew(str(path))
    UsdGeom.SetStageMetersPerUnit(stage, unit)
    UsdGeom.SetStageUpAxis(stage, up)
    if rate is not None:
        stage.SetTimeCodesPerSecond(rate)
    return stage


def define_mesh(stage, path, points, faces=((0, 1, 2, 3),), scheme="none"):
    """Define a mesh of points (V, 3), with faces (F, K) or lists of corners."""
    mesh = UsdGeom.Mesh.Define(stage, path)
    if scheme is not None:
        mesh.CreateSubdivisionSchemeAttr(scheme)
    mesh.CreatePointsAttr(Vt.Vec3fArray.FromNumpy(np.array(points, dtype=np.float32)))
    mesh.CreateFaceVertexCountsAttr([len(face) for face in faces])
    mesh.CreateFaceVertexIndicesAttr([int(k) for face in faces for k in face])
    return mesh


def level_grid(low, high, count):
    """Points (V, 3) of a level square of count points a side, and its faces (F, 4)."""
    x, y = np.meshgrid(*2 * [np.linspace(low, high, count)])
    first = (count * np.arange(count - 1)[:, None] + np.arange(count - 1)).ravel()
    faces = np.stack([first, first + 1, first + count + 1, first + count], axis=1)
    return np.column_stack([x.ravel(), y.ravel(), np.zeros(x.size)]), faces
