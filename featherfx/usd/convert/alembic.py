"""A cache as one Alembic file: a polygon mesh per feather, all samples.

The library is alembic3d, unofficial wheels of the Alembic project's own Python binding; it is an
optional extra. Faces run clockwise in Alembic, so their corners are turned round. Units and axes
stay those of the stage, since Alembic has no place to tell them.
"""

from __future__ import annotations

from collections.abc import Sequence
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

from featherfx.errors import InputError, Problem
from featherfx.files.whole import standing, write_all
from featherfx.phases import counted
from featherfx.usd.read.cached_feather import CachedFeather
from featherfx.usd.read.read import Cache, CachedPose
from featherfx.usd.types import OutputError
from featherfx.usd.write.output import file_problems

_EVEN = 1e-6  # of a frame


def export_alembic(
    path: str | Path,
    output: str | Path,
    frames: tuple[float, float] | None = None,
    overwrite: bool = False,
) -> Path:
    """Write the meshes of a cache with points, normals, velocities, st, subsets and ids.

    output: .abc. frames: first and last time code, by default all samples, subframes included.
    The file appears complete or not at all. Raises InputError where alembic3d is missing, the
    cache cannot be read, its samples are not evenly spaced, or the file cannot be written.
    """
    abc, output = _library(), Path(output)
    cache = Cache(path)
    codes = _codes(cache, frames)
    before, problems = {output: standing(output)}, file_problems([output], overwrite)
    if problems:
        raise OutputError(*problems)

    def store(temporary: Path) -> None:
        _write(abc, cache, codes, temporary)
        _verify(abc, cache, codes, temporary)

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


def _write(abc: Any, cache: Cache, codes: Sequence[float | None], path: Path) -> None:
    """The archive is complete once the last object of it is gone, which is when this returns."""
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
    # frame by frame, as many feathers share a mesh
    for code in counted("writing", codes, len(codes)):
        for index, (feather, schema) in enumerate(zip(cache.feathers, schemas, strict=True)):
            schema.set(_sample(abc, feather, cache.pose(index, code)))


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
        st = _array("V2f", feather.st)
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


def _verify(abc: Any, cache: Cache, codes: Sequence[float | None], path: Path) -> None:
    """Raise OSError unless the file read back has every mesh, sample, and the last points."""
    top = abc.Abc.IArchive(str(path)).getTop()
    if top.getNumChildren() != len(cache.feathers):
        raise OSError(f"the file read back has {top.getNumChildren()} meshes")
    for index, feather in enumerate(cache.feathers):
        schema = abc.AbcGeom.IPolyMesh(top, feather.name).getSchema()
        # by time: the binding takes a whole number for a time, too
        time = schema.getTimeSampling().getSampleTime(len(codes) - 1)
        written = schema.getValue(abc.Abc.ISampleSelector(float(time))).getPositions()
        expected = cache.pose(index, codes[-1]).points
        same = len(written) == len(expected) and tuple(written[-1]) == tuple(expected[-1])
        if schema.getNumSamples() != len(codes) or not same:
            raise OSError(f"the file read back differs at {feather.path}")


def _vectors(values: Any) -> Any:
    return _array("V3f", values)


def _ints(values: Any) -> Any:
    return _array("Int", np.ravel(values), np.int32)


def _array(kind: str, values: Any, dtype: Any = np.float32) -> Any:
    make = getattr(import_module("imath"), f"{kind}ArrayFromBuffer")
    return make(np.ascontiguousarray(values, dtype=dtype))
