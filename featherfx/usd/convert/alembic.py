"""A cache as one Alembic file: a polygon mesh per feather, curves per curves prim, all samples.

The library is alembic3d, unofficial wheels of the Alembic project's own Python binding; it is an
optional extra. Faces run clockwise in Alembic, so their corners are turned round. Units and axes
stay those of the stage, since Alembic has no place to tell them.
"""

from __future__ import annotations

from collections.abc import Sequence
from importlib import import_module
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from featherfx.errors import InputError, Problem
from featherfx.files.atomic_write import standing, write_all
from featherfx.phases import counted
from featherfx.usd.convert import alembic_groom as groom
from featherfx.usd.read.cached_feather import CachedFeather
from featherfx.usd.read.opening import open_stage
from featherfx.usd.read.read import Cache, CachedPose
from featherfx.usd.types import OutputError
from featherfx.usd.write.output import file_problems, unique_prim_names

_EVEN = 1e-6  # of a frame


class _Content(NamedTuple):
    """What is written: a cache, its curves by name, and the time codes of the samples."""

    cache: Cache
    curves: dict[str, groom.Curves]
    codes: list[float | None]


def export_alembic(
    path: str | Path,
    output: str | Path,
    frames: tuple[float, float] | None = None,
    overwrite: bool = False,
) -> Path:
    """Write the meshes of a cache with points, normals, velocities, st, subsets and ids, and its
    shafts and barbs with what a groom in Unreal has (`alembic_groom.py`).

    output: .abc. frames: first and last time code, by default all samples, subframes included.
    The file appears complete or not at all. Raises InputError where alembic3d is missing, the
    cache cannot be read, its samples are not evenly spaced, or the file cannot be written.
    """
    abc, output = _library(), Path(output)
    cache = Cache(path)
    content = _Content(cache, _named_curves(cache), _codes(cache, frames))
    before, problems = {output: standing(output)}, file_problems([output], overwrite)
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
        message = 'Alembic needs alembic3d; pip install "featherfx[alembic]"'
        raise InputError(Problem("alembic3d", "", message)) from error


def _codes(cache: Cache, frames: tuple[float, float] | None) -> list[float | None]:
    """Time codes of the samples, evenly spaced; None for a cache without time."""
    if not cache.has_frames:
        return [None]
    first, last = frames or cache.frames
    if not cache.frames[0] <= first <= last <= cache.frames[1]:
        allowed = f"allowed {cache.frames[0]:g} to {cache.frames[1]:g}"
        raise InputError(Problem("frames", "", f"{first:g}-{last:g} is out of range; {allowed}"))
    codes = [code for code in cache.codes() if first <= code <= last]
    if len(codes) > 2 and np.ptp(np.diff(codes)) > _EVEN:
        message = "samples are not evenly spaced; Alembic is written with one rate"
        raise InputError(Problem("frames", "", message))
    return list(codes)


def _named_curves(cache: Cache) -> dict[str, groom.Curves]:
    """The curves of a cache by the names of their objects, which no feather has."""
    curves, feathers = list(groom.curves_of(open_stage(cache.path))), cache.feathers
    names = unique_prim_names([*(each.name for each in feathers), *(each.name for each in curves)])
    return dict(zip(names[len(feathers) :], curves, strict=True))


def _write(abc: Any, content: _Content, path: Path) -> None:
    """The archive is complete once the last object of it is gone, which is when this returns."""
    cache, curves, codes = content
    archive = abc.Abc.OArchive(str(path))
    sampling = archive.addTimeSampling(_sampling(abc, codes, cache.frames_per_second))
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
        lines.append((each, groom.author(abc, made, each, _ARRAYS)))
    # frame by frame, as many feathers share a mesh
    for code in counted("writing", codes, len(codes)):
        for index, (feather, schema) in enumerate(zip(cache.feathers, schemas, strict=True)):
            schema.set(_sample(abc, feather, cache.pose(index, code)))
        for each, schema in lines:
            schema.set(groom.sample(abc, each, code, _ARRAYS))


def _sampling(abc: Any, codes: Sequence[float | None], rate: float) -> Any:
    """Evenly spaced times in seconds; a time code is code / rate."""
    first = codes[0] or 0.0
    step = (codes[1] or 0.0) - first if len(codes) > 1 else 1.0
    return abc.AbcCoreAbstract.TimeSampling(step / rate, first / rate)


def _sample(abc: Any, feather: CachedFeather, pose: CachedPose) -> Any:
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
    """featherId, featherKind and region, as user properties."""
    properties = schema.getUserProperties()
    labels = {"featherId": feather.id, "featherKind": feather.kind, "region": feather.region}
    for name, value in labels.items():
        abc.Abc.OStringProperty(properties, name).setValue(value)


def _verify(abc: Any, content: _Content, path: Path) -> None:
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


def _ints(values: Any) -> Any:
    return _array("Int", np.ravel(values), np.int32)


def _array(kind: str, values: Any, dtype: Any = np.float32) -> Any:
    make = getattr(import_module("imath"), f"{kind}ArrayFromBuffer")
    return make(np.ascontiguousarray(values, dtype=dtype))


def _pairs(values: Any) -> Any:
    return _array("V2f", values)


def _numbers(values: Any) -> Any:
    return _array("Float", values)


_ARRAYS = groom.Arrays(_vectors, _pairs, _numbers, _ints)
