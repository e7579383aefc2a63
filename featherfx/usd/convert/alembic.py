"""Export to Alembic: a polygon mesh per feather and curves per curves prim, with all samples.

GroomCurves carry the attributes by which Unreal reads a groom (Epic Games, "Alembic for Grooms
Specification", schema 1.5): linear curves with a number, a group, a width at every point, and,
where the cache has them, a colour and the root's place in the feather's texture.

The library is alembic3d, unofficial wheels of the Alembic project's own Python binding; it is an
optional extra. Faces run clockwise in Alembic, so their corners are reversed. Units and axes stay
those of the stage, since Alembic cannot store them.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from pxr import Usd, UsdGeom

from featherfx._version import __version__
from featherfx.algebra.types import Array, Floats, Indices
from featherfx.errors import InputError, Problem
from featherfx.files.atomic_write import standing, write_all
from featherfx.phases import counted
from featherfx.usd.read.cache import Cache, CachedPose
from featherfx.usd.read.cached_feather import CachedFeather
from featherfx.usd.read.values import (
    DEFAULT_TIME,
    INTEGER_ARRAY,
    NUMBER_ARRAY,
    VECTOR_ARRAY,
    open_stage,
    read_array,
    read_flattened,
    read_matrix,
    read_sized_array,
)
from featherfx.usd.types import OutputError
from featherfx.usd.write.output import find_file_problems, unique_prim_names

_SCHEMA = (1, 5)
# groom_group_id of rachises and of barbs
_RACHIS_GROUP, _BARB_GROUP = 0, 1
_SPACING_TOLERANCE = 1e-6  # of a frame


class GroomCurves:
    """The n curves of a prim, with V points.

    first: number of its first curve. name: of the prim, which other prims may share.
    """

    def __init__(self, prim: Any, first: int) -> None:
        self.name, self.path, self.first = prim.GetName(), str(prim.GetPath()), first
        self._prim, self._curves = prim, UsdGeom.BasisCurves(prim)
        self._stage = prim.GetStage()  # a prim does not keep its own
        counts = read_sized_array(
            self._curves.GetCurveVertexCountsAttr(), DEFAULT_TIME, INTEGER_ARRAY
        )
        self.counts: Indices = counts.astype(np.int64)
        primvars = UsdGeom.PrimvarsAPI(prim)
        self.group = _BARB_GROUP if primvars.HasPrimvar("side") else _RACHIS_GROUP
        self._roots = np.cumsum(self.counts) - self.counts
        widths = read_array(self._curves.GetWidthsAttr(), DEFAULT_TIME, NUMBER_ARRAY)
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
        found = read_flattened(UsdGeom.PrimvarsAPI(self._prim).GetPrimvar(name), DEFAULT_TIME)
        return None if found is None else self._of_points(np.asarray(found))

    def points(self, code: float | None) -> Floats:
        """(V, 3) in the world, in the stage's units."""
        time = DEFAULT_TIME if code is None else Usd.TimeCode(code)
        return self._world(
            read_sized_array(self._curves.GetPointsAttr(), time, VECTOR_ARRAY), time, 1.0
        )

    def velocities(self, code: float | None) -> Floats | None:
        """(V, 3) in the world, in the stage's units per second; None where there are none."""
        time = DEFAULT_TIME if code is None else Usd.TimeCode(code)
        found = read_array(self._curves.GetVelocitiesAttr(), time, VECTOR_ARRAY)
        return None if found is None else self._world(found, time, 0.0)

    def _world(self, values: Any, time: Any, moved: float) -> Floats:
        matrix = read_matrix(self._prim, time)
        turned: Array = np.asarray(values, np.float64) @ matrix[:3, :3]
        return (turned + moved * matrix[3, :3]).astype(np.float32)


def _find_curves(stage: Any) -> Iterator[GroomCurves]:
    """Every curves prim of a stage, whichever representation is chosen."""
    first = 0
    for prim in Usd.PrimRange(stage.GetPseudoRoot(), Usd.TraverseInstanceProxies()):
        if prim.IsA(UsdGeom.BasisCurves):
            curves = GroomCurves(prim, first)
            if len(curves.counts):
                yield curves
                first += len(curves.counts)


def _author_constants(abc: Any, made: Any, curves: GroomCurves) -> Any:
    """Author the constant attributes of an OCurves; return its schema, for the samples."""
    geometry, schema = abc.AbcGeom, made.getSchema()
    told = schema.getUserProperties()
    for name, number in zip(("major", "minor"), _SCHEMA, strict=True):
        abc.Abc.OInt16Property(told, f"groom_version_{name}").setValue(number)
    abc.Abc.OStringProperty(told, "groom_tool").setValue(f"featherfx {__version__}")
    scope = geometry.GeometryScope
    numbers = np.arange(curves.first, curves.first + len(curves.counts))
    attributes: tuple[tuple[str, str, Any, Any], ...] = (
        ("groom_group_id", "Int32", scope.kConstantScope, [curves.group]),
        ("groom_id", "Int32", scope.kUniformScope, numbers),
        ("groom_width", "Float", scope.kVertexScope, curves.widths),
        ("groom_root_uv", "V2f", scope.kUniformScope, curves.root_uv),
        ("groom_color", "V3f", scope.kVertexScope, curves.colours),
    )
    arrays: dict[str, Callable[[Any], Any]] = {
        "Int32": _ints,
        "Float": partial(_array, "Float"),
        "V2f": _pairs,
        "V3f": _vectors,
    }
    for name, kind, where, values in attributes:
        if values is not None:
            make_one = getattr(geometry, f"O{kind}GeomParam")
            parameter = make_one(schema.getArbGeomParams(), name, False, where, 1)
            sample = getattr(geometry, f"O{kind}GeomParamSample")
            parameter.set(sample(arrays[kind](values), where))
    return schema


def _curves_sample(abc: Any, curves: GroomCurves, code: float | None) -> Any:
    """Points, widths and velocities at a time code."""
    geometry = abc.AbcGeom
    made = geometry.OCurvesSchemaSample(
        _vectors(curves.points(code)),
        _ints(curves.counts),
        geometry.CurveType.kLinear,
        geometry.CurvePeriodicity.kNonPeriodic,
    )
    if curves.widths is not None:
        widths = _array("Float", curves.widths)
        scope = geometry.GeometryScope.kVertexScope
        made.setWidths(geometry.OFloatGeomParamSample(widths, scope))
    velocities = curves.velocities(code)
    if velocities is not None:
        made.setVelocities(_vectors(velocities))
    return made


class _AlembicContent(NamedTuple):
    """Content of the file: a cache, its curves by name, and the time codes of the samples."""

    cache: Cache
    curves: dict[str, GroomCurves]
    codes: list[float | None]


def export_alembic(
    path: str | Path,
    output: str | Path,
    frames: tuple[float, float] | None = None,
    overwrite: bool = False,
) -> Path:
    """Write the meshes, rachises and barbs of a cache to an Alembic file.

    output: .abc. frames: first and last time code; default: all samples, subframes included.
    The file appears complete or not at all. Raises InputError where alembic3d is missing, the
    cache cannot be read, its samples are not evenly spaced, or the file cannot be written.
    """
    abc, output = _library(), Path(output)
    cache = Cache(path)
    curves, feathers = list(_find_curves(open_stage(path))), cache.feathers
    # names of objects, which no two have
    names = unique_prim_names([*(each.name for each in feathers), *(each.name for each in curves)])
    named = dict(zip(names[len(feathers) :], curves, strict=True))
    content = _AlembicContent(cache, named, _codes(cache, frames))
    before, problems = {output: standing(output)}, find_file_problems([output], overwrite)
    if problems:
        raise OutputError(*problems)

    def store(temporary: Path) -> None:
        _write(abc, content, temporary)
        _verify(abc, content, temporary)

    try:
        write_all([(output, store)], before)
    except (OSError, RuntimeError) as error:
        reason = error.strerror if isinstance(error, OSError) else error
        raise OutputError(Problem(str(output), "", f"not written: {reason}")) from error
    return output


def _library() -> Any:
    try:
        for name in ("Abc", "AbcCoreAbstract", "AbcGeom"):
            import_module(f"alembic3d.{name}")
        return import_module("alembic3d")
    except ImportError as error:
        message = 'Alembic needs alembic3d. Run pip install "featherfx[alembic]"'
        raise InputError(Problem("alembic3d", "", message)) from error


def _codes(cache: Cache, frames: tuple[float, float] | None) -> list[float | None]:
    """Time codes of the samples, evenly spaced; None for a cache without time."""
    if not cache.has_frames:
        return [None]
    first, last = frames or cache.frames
    if not cache.frames[0] <= first <= last <= cache.frames[1]:
        allowed = f"Give {cache.frames[0]:g} to {cache.frames[1]:g}"
        raise InputError(Problem("frames", "", f"{first:g}-{last:g} is out of range. {allowed}"))
    codes = [code for code in cache.codes() if first <= code <= last]
    if len(codes) > 2 and np.ptp(np.diff(codes)) > _SPACING_TOLERANCE:
        message = (
            "samples are not evenly spaced. Bake with even samples, since Alembic has one rate"
        )
        raise InputError(Problem("frames", "", message))
    return list(codes)


def _write(abc: Any, content: _AlembicContent, path: Path) -> None:
    """The archive is complete once the last object of it is gone, which is when this returns."""
    cache, curves, codes = content
    archive = abc.Abc.OArchive(str(path))
    # evenly spaced times in seconds; a time code is code / rate
    rate, first = cache.frames_per_second, codes[0] or 0.0
    step = (codes[1] or 0.0) - first if len(codes) > 1 else 1.0
    times = abc.AbcCoreAbstract.TimeSampling(step / rate, first / rate)
    sampling = archive.addTimeSampling(times)
    schemas = []
    for feather in cache.feathers:
        mesh = abc.AbcGeom.OPolyMesh(archive.getTop(), feather.name, sampling)
        schemas.append(schema := mesh.getSchema())
        _author_ids(abc, schema, feather)
        for subset, faces in feather.subsets.items():
            sample = abc.AbcGeom.OFaceSetSchemaSample(_ints(faces))
            schema.createFaceSet(subset).getSchema().set(sample)
    lines = []
    for name, each in curves.items():
        made = abc.AbcGeom.OCurves(archive.getTop(), name, sampling)
        lines.append((each, _author_constants(abc, made, each)))
    # frame by frame, as many feathers share a mesh
    for code in counted("writing", codes, len(codes)):
        for index, (feather, schema) in enumerate(zip(cache.feathers, schemas, strict=True)):
            schema.set(_mesh_sample(abc, feather, cache.pose(index, code)))
        for each, schema in lines:
            schema.set(_curves_sample(abc, each, code))


def _mesh_sample(abc: Any, feather: CachedFeather, pose: CachedPose) -> Any:
    geometry = abc.AbcGeom
    corners = feather.triangles[:, ::-1]
    counts = np.full(len(corners), 3)
    sample = geometry.OPolyMeshSchemaSample(_vectors(pose.points), _ints(corners), _ints(counts))
    scope = geometry.GeometryScope
    if feather.st is not None:
        st = _pairs(feather.st)
        sample.setUVs(geometry.OV2fGeomParamSample(st, scope.kVertexScope))
    if pose.normals is not None:
        normals = _vectors(pose.normals)
        sample.setNormals(geometry.ON3fGeomParamSample(normals, scope.kVertexScope))
    if pose.velocities is not None:
        sample.setVelocities(_vectors(pose.velocities))
    return sample


def _author_ids(abc: Any, schema: Any, feather: CachedFeather) -> None:
    """Author featherId, featherKind and region as user properties."""
    properties = schema.getUserProperties()
    labels = {"featherId": feather.id, "featherKind": feather.kind, "region": feather.region}
    for name, value in labels.items():
        abc.Abc.OStringProperty(properties, name).setValue(value)


def _verify(abc: Any, content: _AlembicContent, path: Path) -> None:
    """Raise OSError unless the file read back has every object, sample, and the last points."""
    cache, curves, codes = content
    top = abc.Abc.IArchive(str(path)).getTop()
    if top.getNumChildren() != len(cache.feathers) + len(curves):
        raise OSError(f"the file read back has {top.getNumChildren()} objects")

    def compare(made: Any, expected: NDArray[Any], source: str) -> None:
        schema = made.getSchema()
        # by time: the binding takes a whole number for a time, too
        time = schema.getTimeSampling().getSampleTime(len(codes) - 1)
        written = schema.getValue(abc.Abc.ISampleSelector(float(time))).getPositions()
        same = len(written) == len(expected) and tuple(written[-1]) == tuple(expected[-1])
        if schema.getNumSamples() != len(codes) or not same:
            raise OSError(f"the file read back differs at {source}")

    for index, feather in enumerate(cache.feathers):
        mesh = abc.AbcGeom.IPolyMesh(top, feather.name)
        compare(mesh, cache.pose(index, codes[-1]).points, feather.path)
    for name, each in curves.items():
        compare(abc.AbcGeom.ICurves(top, name), each.points(codes[-1]), each.path)


def _vectors(values: Any) -> Any:
    return _array("V3f", values)


def _pairs(values: Any) -> Any:
    return _array("V2f", values)


def _ints(values: Any) -> Any:
    return _array("Int", np.ravel(values), np.int32)


def _array(kind: str, values: Any, dtype: Any = np.float32) -> Any:
    make = getattr(import_module("imath"), f"{kind}ArrayFromBuffer")
    return make(np.ascontiguousarray(values, dtype=dtype))
