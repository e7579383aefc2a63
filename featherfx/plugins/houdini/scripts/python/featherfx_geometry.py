"""Curves of Houdini's geometry as USD, and the meshes of a cache as Houdini's geometry.

With the host's own USD and numpy; Houdini's polygons turn clockwise, those of USD the other way.
"""

import hou
import numpy as np
from pxr import Sdf, Usd, UsdGeom, Vt

CURVES = "/feathers/curves"
# what a groom reads of a feather, by the name of the attribute of its polyline
TEXTS = ("featherId", "featherKind", "region")
BARBS = ("P_barbl", "P_barbr")


def space_of(stage):
    """Up axis of a stage, and metres in its unit."""
    return str(UsdGeom.GetStageUpAxis(stage)), UsdGeom.GetStageMetersPerUnit(stage)


def write_curves(geometry, file):
    """Write the open polylines of a hou.Geometry, root first, with what a groom reads of them; how
    many there are."""
    polygons = [each for each in geometry.prims() if each.type() == hou.primType.Polygon]
    lines = [each for each in polygons if not each.isClosed()]
    if not lines:
        return 0
    points = [[corner.point() for corner in each.vertices()] for each in lines]
    stage = Usd.Stage.CreateInMemory()
    UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.y)
    UsdGeom.SetStageMetersPerUnit(stage, 1.0)
    curves = UsdGeom.BasisCurves.Define(stage, CURVES)
    stage.SetDefaultPrim(curves.GetPrim().GetParent())
    curves.CreateTypeAttr(UsdGeom.Tokens.linear)
    curves.CreateCurveVertexCountsAttr([len(each) for each in points])
    flat = [each for line in points for each in line]
    curves.CreatePointsAttr([tuple(each.position()) for each in flat])
    primvars = UsdGeom.PrimvarsAPI(curves)
    for name in TEXTS:
        if geometry.findPrimAttrib(name) is not None:
            values = [each.stringAttribValue(name) for each in lines]
            kind = Sdf.ValueTypeNames.StringArray
            primvars.CreatePrimvar(name, kind, UsdGeom.Tokens.uniform).Set(values)
    for name in ("up", "N"):  # of the polylines, else of their roots
        if geometry.findPrimAttrib(name) is not None:
            ups = [each.floatListAttribValue(name) for each in lines]
        elif geometry.findPointAttrib(name) is not None:
            ups = [line[0].floatListAttribValue(name) for line in points]
        else:
            continue
        kind = Sdf.ValueTypeNames.Vector3fArray
        primvars.CreatePrimvar("up", kind, UsdGeom.Tokens.uniform).Set(ups)
        break
    if all(geometry.findPointAttrib(name) is not None for name in BARBS):
        for name in BARBS:
            values = [each.attribValue(name) for each in flat]
            kind = Sdf.ValueTypeNames.FloatArray
            primvar = primvars.CreatePrimvar(name, kind, UsdGeom.Tokens.constant)
            primvar.Set([number for each in values for number in each])
            lengths = f"{primvar.GetName()}:lengths"
            counts = curves.GetPrim().CreateAttribute(lengths, Sdf.ValueTypeNames.IntArray)
            counts.Set([len(each) for each in values])
    stage.GetRootLayer().Export(file)
    return len(lines)


class Meshes:
    """The meshes of a cache: what never changes, and the points of a frame, in world space."""

    def __init__(self, file):
        self._stage = Usd.Stage.Open(file)
        below = Usd.PrimRange(self._stage.GetPseudoRoot(), Usd.TraverseInstanceProxies())
        self._meshes = [UsdGeom.Mesh(each) for each in below if each.IsA(UsdGeom.Mesh)]

    def build(self, geometry):
        """Points at rest and polygons, with uv, rest and the texts of the feathers."""
        first, faces = 0, []
        for mesh in self._meshes:
            corners = np.asarray(mesh.GetFaceVertexIndicesAttr().Get()) + first
            counts = np.asarray(mesh.GetFaceVertexCountsAttr().Get())
            parts = np.split(corners, np.cumsum(counts)[:-1])
            faces += [tuple(part[::-1].tolist()) for part in parts]
            first += len(mesh.GetPointsAttr().Get())
        rest = self._points(Usd.TimeCode.Default())
        geometry.createPoints(rest.tolist())
        geometry.createPolygons(tuple(faces))
        geometry.addAttrib(hou.attribType.Point, "v", (0.0, 0.0, 0.0))
        st = [_primvar(mesh, "st") for mesh in self._meshes]
        if all(each is not None for each in st):
            flat = np.concatenate([np.asarray(each) for each in st])
            self._values(geometry, "uv", np.pad(flat, ((0, 0), (0, 1))))
        self._values(geometry, "rest", rest)
        for name in TEXTS:
            texts = []
            for mesh in self._meshes:
                values = _primvar(mesh, name) or [""]
                count = len(mesh.GetFaceVertexCountsAttr().Get())
                texts += list(values) if len(values) == count else [values[0]] * count
            geometry.addAttrib(hou.attribType.Prim, name, "")
            geometry.setPrimStringAttribValues(name, texts)

    @staticmethod
    def _values(geometry, name, values):
        if geometry.findPointAttrib(name) is None:
            geometry.addAttrib(hou.attribType.Point, name, (0.0, 0.0, 0.0))
        packed = np.ascontiguousarray(values, dtype=np.float32).tobytes()
        geometry.setPointFloatAttribValuesFromString(name, packed)

    def pose(self, geometry, frame):
        """Move what was built to a frame, with its velocities per second."""
        self._values(geometry, "P", self._points(Usd.TimeCode(frame)))
        found = [mesh.GetVelocitiesAttr().Get(frame) for mesh in self._meshes]
        for number, mesh in enumerate(self._meshes):
            if found[number] is None:  # what never moves has none
                found[number] = np.zeros((len(mesh.GetPointsAttr().Get()), 3))
        self._values(geometry, "v", self._world(found, Usd.TimeCode(frame), 0.0))

    def _points(self, time):
        return self._world([mesh.GetPointsAttr().Get(time) for mesh in self._meshes], time, 1.0)

    def _world(self, values, time, moved):
        """Points (moved 1) or vectors (0) of all meshes."""
        places = UsdGeom.XformCache(time)
        found = [np.zeros((0, 3))]
        for mesh, each in enumerate(values):
            matrix = np.array(places.GetLocalToWorldTransform(self._meshes[mesh].GetPrim()))
            found.append(np.asarray(each) @ matrix[:3, :3] + moved * matrix[3, :3])
        return np.concatenate(found)


def _primvar(mesh, name):
    found = UsdGeom.PrimvarsAPI(mesh).GetPrimvar(name).ComputeFlattened()
    return None if found is None else (found if isinstance(found, Vt.Vec2fArray) else list(found))
