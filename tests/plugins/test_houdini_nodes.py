"""The nodes of the plugin for Houdini, with a stand-in for `hou`, and the real command beside it.

The stand-in has what Houdini's own description of `hou` says of each call (21.0).
"""

from __future__ import annotations

import importlib
import sys
import types
from pathlib import Path
from unittest.mock import MagicMock

import numpy as np
import pytest
from places import ROOT
from pxr import Usd, UsdGeom

import featherfx
from featherfx.usd.read.cache import Cache

PLUGIN = ROOT / "featherfx" / "plugins"
# the length and the kinds of two feathers that grow along x, m
LENGTH, KINDS = 0.03, ("covert", "body_contour")


class Element:
    """A point or a polyline: where it is, or which points it joins, and its attributes."""

    def __init__(self, position=(), points=(), **attributes):
        self._position, self._points, self._attributes = position, points, attributes

    def position(self):
        return self._position

    def vertices(self):
        return [types.SimpleNamespace(point=lambda each=each: each) for each in self._points]

    def type(self):
        return "Polygon"

    def isClosed(self):
        return False

    def attribValue(self, name):
        return self._attributes[name]

    stringAttribValue = floatListAttribValue = attribValue


class Geometry:
    """hou.Geometry, as far as the plugin calls it."""

    def __init__(self, points=(), prims=()):
        self._points, self._prims = list(points), list(prims)
        self.clear()

    def clear(self):
        self.positions, self.polygons, self.point_values, self.texts = [], [], {}, {}

    def prims(self):
        return self._prims

    def findPrimAttrib(self, name):
        return name if name in self._prims[0]._attributes else None

    def findPointAttrib(self, name):
        own = {"P", *self.point_values, *(self._points[0]._attributes if self._points else ())}
        return name if name in own else None

    def createPoints(self, positions):
        self.positions = [tuple(each) for each in positions]

    def createPolygons(self, polygons):
        assert all(isinstance(number, int) for each in polygons for number in each)
        self.polygons = list(polygons)

    def addAttrib(self, kind, name, default):
        if kind == "Point":
            assert name not in self.point_values
            self.point_values[name] = np.full((len(self.positions), 3), default)
        else:
            self.texts[name] = [default] * len(self.polygons)

    def setPrimStringAttribValues(self, name, values):
        assert len(values) == len(self.texts[name])
        self.texts[name] = values

    def setPointFloatAttribValuesFromString(self, name, values):
        found = np.frombuffer(values, np.float32).reshape(len(self.positions), 3)
        if name == "P":
            self.positions = [tuple(each) for each in found.tolist()]
        else:
            assert name in self.point_values
            self.point_values[name] = found

    def merge(self, other):
        self.positions, self.polygons = list(other.positions), list(other.polygons)
        self.point_values, self.texts = dict(other.point_values), dict(other.texts)


class Node:
    """A node with parameters; its input is another."""

    def __init__(self, source, **values):
        self.values, self._source, self.kept, self.cooked = values, source, {}, 0
        self.templates = MagicMock()

    def parmTemplateGroup(self):
        return self.templates

    def setParmTemplateGroup(self, group):
        assert group is self.templates

    def setName(self, name, unique_name=False):
        self.name = name

    def parm(self, name):
        if name == "skin" and name not in self.values:
            return None
        set_to = lambda value: self.values.__setitem__(name, value)  # noqa: E731
        return types.SimpleNamespace(set=set_to, eval=lambda: self.values[name])

    parmTuple = parm

    def evalParm(self, name):
        return self.values[name]

    def inputs(self):
        return (self._source,)

    def cachedUserData(self, name):
        return self.kept.get(name)

    def setCachedUserData(self, name, value):
        self.kept[name] = value

    def cook(self, force=False):
        self.cooked += force


class SopNode(Node):
    def __init__(self, source, **values):
        super().__init__(source, **values)
        self.own = Geometry()

    def geometry(self):
        return self.own


class LopNode(Node):
    def __init__(self, source, **values):
        super().__init__(source, **values)
        self.own = None

    def stage(self):
        return self._source

    def editableStage(self):
        self.own = Usd.Stage.CreateInMemory()
        return self.own

    def addSubLayer(self, identifier):
        self.own.GetRootLayer().subLayerPaths.append(identifier)


@pytest.fixture
def houdini(tmp_path, monkeypatch):
    """The plugin's module as Houdini imports it, and the stand-in for `hou`."""
    command = tmp_path / "featherfx"
    command.write_text(
        f"#!{sys.executable}\nimport runpy, sys\nsys.path.insert(0, {str(ROOT)!r})\n"
        "runpy.run_module('featherfx', run_name='__main__')\n"
    )
    command.chmod(0o755)
    monkeypatch.setenv("FEATHERFX_COMMAND", str(command))
    hou = MagicMock()
    hou.SopNode, hou.LopNode, hou.Geometry = SopNode, LopNode, Geometry
    hou.primType.Polygon = "Polygon"
    hou.attribType.Point, hou.attribType.Prim = "Point", "Prim"
    hou.fps.return_value = 24.0
    for name in ("OperationInterrupted", "NodeWarning"):
        setattr(hou, name, type(name, (Exception,), {}))
    hou.ui.displayMessage.side_effect = lambda text, **_: pytest.fail(text)
    monkeypatch.setitem(sys.modules, "hou", hou)
    for folder in ("shared", "houdini/scripts/python"):
        monkeypatch.syspath_prepend(PLUGIN / folder)
    names = ("featherfx_host", "featherfx_geometry", "featherfx_houdini")
    for name in names:
        monkeypatch.delitem(sys.modules, name, raising=False)
    yield importlib.import_module("featherfx_houdini"), hou
    for name in names:
        sys.modules.pop(name, None)


def curves():
    """Two polylines 5 cm apart, dorsal sides up, that is y."""
    lines = []
    for number, kind in enumerate(KINDS):
        along = np.linspace(0.0, LENGTH, 6)
        points = [Element((float(x), 0.1 - 4.0 * float(x * x), 0.05 * number)) for x in along]
        told = {"featherId": f"f{number}", "featherKind": kind, "up": (0.0, 1.0, 0.0)}
        lines.append(Element(points=points, **told))
    return Geometry([point for line in lines for point in line._points], lines)


def test_condensed_feathers_keep_their_barbs(houdini, tmp_path):
    import featherfx_geometry

    made = curves()
    for point in made._points:
        x, y, z = point.position()
        reach = 0.4 * (LENGTH - x) + 1e-3
        for name, way in (("P_barbl", 1.0), ("P_barbr", -1.0)):
            ends = [(x + 0.5 * s * reach, y, z + way * s * reach) for s in (0.5, 1.0)]
            point._attributes[name] = tuple(np.ravel(ends).tolist())
    file = tmp_path / "curves.usda"
    assert featherfx_geometry.write_curves(made, str(file)) == 2
    drawn = featherfx.read_groom(file)
    made._points[0]._attributes.pop("P_barbl")  # as if the geometry had none
    plain = tmp_path / "plain.usda"
    featherfx_geometry.write_curves(made, str(plain))
    longest = [
        [each.barb_length.max() for each in featherfx.build(groom, "draft")]
        for groom in (drawn, featherfx.read_groom(plain))
    ]
    assert [each.id for each in drawn.feathers] == ["f0", "f1"]
    np.testing.assert_allclose(longest[0], 1.25**0.5 * (0.4 * LENGTH + 1e-3), rtol=0.1)
    assert abs(longest[1][0] / longest[0][0] - 1.0) > 0.2


def parameters(tmp_path, **more):
    told = {"cache": str(tmp_path / "out/wing.usdc"), "kind": "", "quality": "draft", "shot": ""}
    return told | {"frames": (1, 2), "wind": (0.0, 0.0, -4.0), "gust": 0.3, "show": "groom"} | more


def test_a_node_is_houdinis_own_with_parameters_and_one_line_of_code(houdini):
    module, hou = houdini
    for kind in ("sop", "lop"):
        node = module.dressed(Node(None), kind)
        assert node.values["python"].endswith(f"featherfx_houdini.cook_{kind}()\n")
        compile(node.values["python"], "code", "exec")
        assert callable(getattr(module, f"cook_{kind}"))
    calls = [call.kwargs["script_callback"] for call in hou.ButtonParmTemplate.call_args_list]
    for call, name in zip(calls[:2], ("groom", "bake"), strict=True):
        assert call == f"import featherfx_houdini; featherfx_houdini.{name}(kwargs['node'])"
        assert callable(getattr(module, name))


def test_a_sop_grooms_and_bakes_curves_and_loads_the_cache(houdini, tmp_path):
    module, hou = houdini
    source = SopNode(None)
    source.own = curves()
    node = SopNode(source, **parameters(tmp_path, frame=1.0))
    hou.pwd.return_value = node
    with pytest.raises(hou.NodeWarning, match="press Groom or Bake"):
        module.cook_sop()
    module.groom(node)
    module.cook_sop()
    rest = np.array(node.own.positions)
    assert set(node.own.texts["featherId"]) == {"f0", "f1"}
    assert set(node.own.texts["featherKind"]) == set(KINDS)
    assert np.ptp(rest[:, 0]) == pytest.approx(LENGTH, rel=0.1)
    corners = rest[np.array([each for each in node.own.polygons if len(each) == 3])]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 1])
    assert np.mean(np.sign(normals), axis=0)[1] < -0.3  # vanes are clockwise from above
    module.bake(node)
    assert (node.values["show"], node.cooked) == ("cache", 2)
    hou.lop.reloadLayer.assert_called_with(node.values["cache"], True)
    cache = Cache(node.values["cache"])
    for frame in (1.0, 2.0):
        node.values["frame"] = frame
        module.cook_sop()
        expected = np.concatenate([cache.points(number, frame) for number in (0, 1)])
        np.testing.assert_allclose(node.own.positions, expected, atol=1e-6)
    assert np.abs(node.own.point_values["v"]).max() > 0.0
    # wind to -z, where Houdini has y up, moves tips there
    assert np.mean(np.array(node.own.positions)[:, 2] - rest[:, 2]) < 0.0
    assert "direction = [0.0, 4.0, 0.0]" in (tmp_path / "out/wing.shot.toml").read_text()


@pytest.mark.parametrize("skin", ["", "/body"])
def test_a_lop_bakes_the_curves_of_its_stage_and_adds_the_cache(houdini, tmp_path, skin):
    module, hou = houdini
    stage = Usd.Stage.CreateInMemory()
    UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.y)
    UsdGeom.SetStageMetersPerUnit(stage, 0.01)
    drawn = UsdGeom.BasisCurves.Define(stage, "/curve")
    drawn.CreateTypeAttr(UsdGeom.Tokens.linear)
    drawn.CreateCurveVertexCountsAttr([3])
    drawn.CreatePointsAttr([(0, 0, 0), (2, -0.05, 0), (4, -0.2, 0)])
    body = UsdGeom.Mesh.Define(stage, "/body")
    corners = np.array([(-1, 0, -1), (-1, 0, 1), (1, 0, 1), (1, 0, -1)], dtype=np.float32)
    body.CreateFaceVertexCountsAttr([4])
    body.CreateFaceVertexIndicesAttr([0, 1, 2, 3])
    body.CreatePointsAttr(corners)
    for frame in (1, 2):  # half a centimetre to z
        body.GetPointsAttr().Set(corners + np.float32([0, 0, 0.5 * (frame - 1)]), frame)
    input_node = LopNode(stage)
    node = LopNode(input_node, **parameters(tmp_path, kind="covert", skin=skin))
    hou.pwd.return_value = node
    with pytest.raises(hou.NodeWarning):
        module.cook_lop()
    module.bake(node)
    module.cook_lop()
    (mesh,) = [UsdGeom.Mesh(each) for each in node.own.Traverse() if each.IsA(UsdGeom.Mesh)]
    points = np.array(mesh.GetPointsAttr().Get(2))
    assert np.ptp(points[:, 0]) == pytest.approx(4.0, rel=0.1)  # centimetres, as the stage has them
    shaft = UsdGeom.BasisCurves(
        next(each for each in node.own.Traverse() if each.IsA(UsdGeom.BasisCurves))
    )
    roots = [np.array(shaft.GetPointsAttr().Get(frame)[0]) for frame in (1, 2)]
    moved = (0.0, 0.0, 0.5 if skin else 0.0)
    np.testing.assert_allclose(roots[1] - roots[0], moved, atol=1e-5)
    (layer,) = node.own.GetRootLayer().subLayerPaths
    assert UsdGeom.GetStageUpAxis(Usd.Stage.Open(layer)) == UsdGeom.Tokens.y


def test_another_bake_takes_the_place_of_a_cache_if_that_is_wanted(houdini, tmp_path):
    module, hou = houdini
    source = SopNode(None)
    source.own = curves()
    node = SopNode(source, **parameters(tmp_path, frame=1.0))
    module.bake(node)
    cache = Path(node.values["cache"])
    before, asked = cache.read_bytes(), []

    def answer(text, buttons=("OK",), **_):
        asked.append((text, buttons))
        return len(asked) % 2  # the second of two buttons, then the first

    hou.ui.displayMessage.side_effect = answer
    node.values["wind"] = (3.0, 0.0, 0.0)
    module.bake(node)
    assert cache.read_bytes() == before
    module.bake(node)
    assert cache.read_bytes() != before
    assert [buttons for _, buttons in asked] == 2 * [("Bake anew", "Cancel")]
    assert "shot.wind.direction" in asked[0][0]
    assert node.cooked == 2


def test_what_is_wrong_is_shown_and_nothing_is_loaded(houdini, tmp_path):
    module, hou = houdini
    told = []
    hou.ui.displayMessage.side_effect = lambda text, **_: told.append(text)
    node = SopNode(None, **parameters(tmp_path, frame=1.0))
    module.bake(node)
    source = SopNode(None)
    source.own = Geometry([Element((0, 0, 0))], [])
    node._source = source
    module.bake(node)
    source.own = curves()
    node.values |= {"kind": "none_such", "quality": "best"}
    module.bake(node)
    assert told[0] == "connect what has the curves, or name a shot"
    assert told[1] == "the input has no open polylines"
    assert "best" in told[2]
    assert node.cooked == 0
    assert not Path(node.values["cache"]).exists()
