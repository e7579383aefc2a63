"""Shafts and barbs of a cache as Alembic curves with the attributes by which Unreal reads a groom.

After Epic Games, "Alembic for Grooms Specification", schema 1.5: linear curves, of which each has a
number, a group and a width at every point; a colour and the place of the root in the feather's
texture, where the cache has them.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import numpy as np
from pxr import Usd, UsdGeom

from featherfx._version import __version__
from featherfx.algebra.types import Array, Floats, Indices
from featherfx.usd.read.values import (
    DEFAULT,
    INTEGERS,
    NUMBERS,
    VECTORS,
    array_of,
    flattened,
    matrix_of,
    sized_array,
)

SCHEMA = (1, 5)
# groom_group_id: what shafts are, and barbs
GROUPS = {"shafts": 0, "barbs": 1}


class Arrays(NamedTuple):
    """How arrays of Alembic are made: (N, 3) vectors, (N, 2) pairs, numbers, whole numbers."""

    vectors: Callable[[Any], Any]
    pairs: Callable[[Any], Any]
    numbers: Callable[[Any], Any]
    integers: Callable[[Any], Any]


class Curves:
    """The curves of one prim: n curves of V points. first: the number of its first one. name: of
    its prim, which others may share."""

    def __init__(self, prim: Any, first: int) -> None:
        self.name, self.path, self.first = prim.GetName(), str(prim.GetPath()), first
        self._prim, self._curves = prim, UsdGeom.BasisCurves(prim)
        self._stage = prim.GetStage()  # a prim does not keep its own
        counts = sized_array(self._curves.GetCurveVertexCountsAttr(), DEFAULT, INTEGERS)
        self.counts: Indices = counts.astype(np.int64)
        primvars = UsdGeom.PrimvarsAPI(prim)
        self.group = GROUPS["barbs" if primvars.HasPrimvar("side") else "shafts"]
        self._roots = np.cumsum(self.counts) - self.counts
        widths = array_of(self._curves.GetWidthsAttr(), DEFAULT, NUMBERS)
        self.widths = None if widths is None else self._of_points(widths)
        self.colours = self._primvar("displayColor")
        st = self._primvar("st")
        self.root_uv = None if st is None else st[self._roots]

    def _of_points(self, values: Array) -> Array | None:
        """Values of points, from those of points, of curves or of all; None for another number."""
        total = int(self.counts.sum())
        known: dict[int, Any] = {1: total, len(self.counts): self.counts, total: 1}
        return np.repeat(values, known[len(values)], axis=0) if len(values) in known else None

    def _primvar(self, name: str) -> Array | None:
        found = flattened(UsdGeom.PrimvarsAPI(self._prim).GetPrimvar(name), DEFAULT)
        return None if found is None else self._of_points(np.asarray(found))

    def points(self, code: float | None) -> Floats:
        """(V, 3) in the world, in the stage's units."""
        time = DEFAULT if code is None else Usd.TimeCode(code)
        return self._world(sized_array(self._curves.GetPointsAttr(), time, VECTORS), time, 1.0)

    def velocities(self, code: float | None) -> Floats | None:
        """(V, 3) in the world, in the stage's units per second; None where there are none."""
        time = DEFAULT if code is None else Usd.TimeCode(code)
        found = array_of(self._curves.GetVelocitiesAttr(), time, VECTORS)
        return None if found is None else self._world(found, time, 0.0)

    def _world(self, values: Any, time: Any, moved: float) -> Floats:
        matrix = matrix_of(self._prim, time)
        turned: Array = np.asarray(values, np.float64) @ matrix[:3, :3]
        return (turned + moved * matrix[3, :3]).astype(np.float32)


def curves_of(stage: Any) -> Iterator[Curves]:
    """Every curves prim of a stage, whichever representation is chosen."""
    first = 0
    for prim in Usd.PrimRange(stage.GetPseudoRoot(), Usd.TraverseInstanceProxies()):
        if prim.IsA(UsdGeom.BasisCurves):
            curves = Curves(prim, first)
            if len(curves.counts):
                yield curves
                first += len(curves.counts)


def author(abc: Any, made: Any, curves: Curves, make: Arrays) -> Any:
    """Give an OCurves what never changes; returns its schema, for the samples."""
    geometry, schema = abc.AbcGeom, made.getSchema()
    told = schema.getUserProperties()
    for name, number in zip(("major", "minor"), SCHEMA, strict=True):
        abc.Abc.OInt16Property(told, f"groom_version_{name}").setValue(number)
    abc.Abc.OStringProperty(told, "groom_tool").setValue(f"featherfx {__version__}")
    scope = geometry.GeometryScope
    numbers = np.arange(curves.first, curves.first + len(curves.counts))
    attributes = (
        ("groom_group_id", "Int32", scope.kConstantScope, make.integers([curves.group])),
        ("groom_id", "Int32", scope.kUniformScope, make.integers(numbers)),
        ("groom_width", "Float", scope.kVertexScope, _made(make.numbers, curves.widths)),
        ("groom_root_uv", "V2f", scope.kUniformScope, _made(make.pairs, curves.root_uv)),
        ("groom_color", "V3f", scope.kVertexScope, _made(make.vectors, curves.colours)),
    )
    for name, kind, where, values in attributes:
        if values is not None:
            make_one = getattr(geometry, f"O{kind}GeomParam")
            parameter = make_one(schema.getArbGeomParams(), name, False, where, 1)
            parameter.set(getattr(geometry, f"O{kind}GeomParamSample")(values, where))
    return schema


def sample(abc: Any, curves: Curves, code: float | None, make: Arrays) -> Any:
    """Points, widths and velocities at a time code."""
    geometry = abc.AbcGeom
    made = geometry.OCurvesSchemaSample(
        make.vectors(curves.points(code)),
        make.integers(curves.counts),
        geometry.CurveType.kLinear,
        geometry.CurvePeriodicity.kNonPeriodic,
    )
    if curves.widths is not None:
        widths = make.numbers(curves.widths)
        scope = geometry.GeometryScope.kVertexScope
        made.setWidths(geometry.OFloatGeomParamSample(widths, scope))
    velocities = curves.velocities(code)
    if velocities is not None:
        made.setVelocities(make.vectors(velocities))
    return made


def _made(make: Callable[[Any], Any], values: Array | None) -> Any:
    return None if values is None else make(values)
