"""A curve that roots follow without a skin: a narrow ribbon along it, whose frames are carried.

The ribbon's side at each point is that of the first point, carried along the curve without turning
about it, and the first one's is that of rest, turned by the least that takes its tangent along. A
curve does not tell how it is turned about itself; transforms of its prim do, and are followed.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from pxr import UsdGeom

from featherfx.algebra.rotation import transported
from featherfx.groom.keys.values import Place, Problems
from featherfx.usd.read.curves import curves_of
from featherfx.usd.read.skinning import Ribbons, SkinPose
from featherfx.usd.read.stage import SourceScene, codes_of, rest_code
from featherfx.usd.read.values import at

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

_WIDTH = 0.2  # half of the ribbon's, in lengths of a piece of the curve


class CurveRibbon(Ribbons):
    """A ribbon along a curve, which has been looked at by `curve_fault`; faces are its pieces."""

    def __init__(self, scene: SourceScene, prim: Any) -> None:
        self.space, self._path = prim, scene.path
        self._points = UsdGeom.BasisCurves(prim).GetPointsAttr()
        line = self._line(rest_code(self._points))
        pieces = np.linalg.norm(np.diff(line, axis=0), axis=1)
        self._half = _WIDTH * float(pieces.mean())
        self._tangent = _start(line, _stations(line))
        across = np.cross(self._tangent, np.eye(3)[np.argmin(np.abs(self._tangent))])
        self._across = across / np.linalg.norm(across)
        self.rest = self._ribbon(line)
        first = 2 * np.arange(len(pieces))[:, None, None]
        self.triangles = (first + np.array([[0, 1, 3], [0, 3, 2]])).reshape(-1, 3)
        self.faces = np.repeat(np.arange(len(pieces)), 2)
        self.lengths = np.repeat(pieces, 2)

    def pose(self, code: Any) -> SkinPose:
        """What moves the ribbon at a time code: the points of the curve."""
        return SkinPose(np.eye(4)[None], np.zeros(0), self._line(code))

    def posed(self, pose: SkinPose) -> Array:
        """(V, 3) along a curve of our own."""
        return self._ribbon(pose.points)

    def attributes(self) -> list[Any]:
        """What moves the curve, for its time samples."""
        return [self._points]

    def _line(self, code: Any) -> Array:
        problems = Problems()
        place = Place(str(self._path), str(self.space.GetPath()), problems)
        found = curves_of(self.space, code, place)
        problems.raise_any()
        assert found is not None
        return found.line(0)

    def _ribbon(self, line: Array) -> Array:
        stations = _stations(line)
        # a turn without one about the tangent takes what is square to it along
        tangent = _start(line, stations)
        axis, cosine = np.cross(self._tangent, tangent), self._tangent @ tangent
        start = self._across + np.cross(axis, self._across)
        start = start + np.cross(axis, np.cross(axis, self._across)) / max(1.0 + cosine, 1e-9)
        side = self._half * transported(line, stations) @ start
        return np.stack([line - side, line + side], axis=1).reshape(-1, 3)


def _stations(line: Array) -> Array:
    """(k,) lengths along a line to its points."""
    pieces = np.linalg.norm(np.diff(line, axis=0), axis=1)
    return np.concatenate([[0.0], np.cumsum(pieces)])


def _start(line: Array, stations: Array) -> Array:
    """(3,) unit tangent at the first point, as `transported` has it."""
    way = line[1] - line[0]
    if len(line) > 2:
        way = np.gradient(line, stations, axis=0, edge_order=2)[0]
    return np.asarray(way / np.linalg.norm(way))


def curve_fault(scene: SourceScene, prim: Any, place: Place) -> str:
    """Why roots cannot follow a curve; empty where they can, or after adding problems."""
    sizes = set()
    for code in codes_of(UsdGeom.BasisCurves(prim).GetPointsAttr()):
        curves = curves_of(prim, code, Place(str(scene.path), str(prim.GetPath()), place.problems))
        if curves is None:
            return ""
        if len(curves) != 1:
            return f"holds {len(curves)} curves, roots follow one"
        line = curves.line(0)
        if (np.diff(line, axis=0) == 0.0).all(axis=1).any():
            return f"has two points at one place {at(code)}"
        sizes.add(len(line))
        if len(sizes) > 1:
            return f"changes its number of points {at(code)}"
    return "" if sizes else "has no points"
