"""Topology of USD meshes: faults, triangles, values of primvars on them, subdivision schemes."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from pxr import UsdGeom

from featherfx.algebra.subdivision import (
    MAX_REFINED_FACES,
    estimate_cage_distance,
    measure_cage_distance,
    refine,
    refine_within,
)
from featherfx.algebra.subdivision_cage import Cage, Rules, Sharp, make_cage, make_value_cage
from featherfx.algebra.triangulation import orient, triangulate
from featherfx.algebra.types import Array, Flags, Indices
from featherfx.groom.skin.skin import is_flat
from featherfx.usd.read.stage import list_times
from featherfx.usd.read.values import (
    EARLIEST_TIME,
    INTEGER_ARRAY,
    NUMBER_ARRAY,
    VECTOR_ARRAY,
    describe_range,
    describe_time,
    fault,
    list_elements,
    read_array,
    read_flattened,
    read_sized_array,
    read_text,
    read_value,
    to_numpy,
)

MAX_LIMIT_DISTANCE = 1e-5  # m, of faces from the limit surface: a tenth of a vane's thickness


def _read_cage(mesh: Any, topology: tuple[Indices, Indices], scheme: str, size: int) -> Cage:
    """Return the cage of a mesh with sound topology and a scheme of subdivision.

    Raises InputError for creases or corners that do not fit, and for loop without triangles.
    """
    counts, indices = topology
    rules = Rules(
        scheme=scheme,
        boundary=read_text(mesh.GetInterpolateBoundaryAttr(), EARLIEST_TIME),
        smooth_triangles=read_text(mesh.GetTriangleSubdivisionRuleAttr(), EARLIEST_TIME)
        == UsdGeom.Tokens.smooth,
        holes=_read_indices(mesh.GetHoleIndicesAttr(), len(counts)),
        creases=_read_creases(mesh, size),
        corners=_read_corners(mesh, size),
    )
    if rules.scheme == "loop" and (counts != 3).any():
        face = int(np.flatnonzero(counts != 3)[0])
        message = f"loop needs triangles, but face {face} has {counts[face]} sides"
        raise fault(mesh.GetSubdivisionSchemeAttr(), message)
    return make_cage(counts, indices, size, rules)


class LimitSurface:
    """The subdivided surface of a mesh at rest: faces, and the points that frames move.

    off: m, how far faces may be from the limit surface.
    """

    def __init__(
        self, mesh: Any, topology: tuple[Indices, Indices], scheme: str, points: Array
    ) -> None:
        self._mesh, self._cage = mesh, _read_cage(mesh, topology, scheme, len(points))
        self._refined, self.off = refine_within(self._cage, points, MAX_LIMIT_DISTANCE)

    @property
    def faces(self) -> tuple[Indices, Indices, Indices]:
        """Corners of each face, the points at these, and the faces of the mesh they are part of."""
        return self._refined.counts, self._refined.indices, self._refined.parent

    def move(self, points: NDArray[Any]) -> Array:
        """Return (R, 3) points of the surface, of points (V, 3) of the mesh."""
        return self._refined.matrix @ points

    def spread(self, values: Array, interpolation: str, numbers: Indices | None) -> Array | None:
        """Return (C, ...) values at the corners of the faces; None for values that do not fit.

        values: (K, ...) of a primvar, by vertex, varying, or by corners of the mesh. numbers: of
        the values of face-varying corners, None where each has its own.
        """
        cage, flat = self._cage, values.reshape(len(values), -1)
        if interpolation == UsdGeom.Tokens.faceVarying:
            attribute = self._mesh.GetFaceVaryingLinearInterpolationAttr()
            own = np.arange(len(cage.indices)) if numbers is None else numbers
            if len(own) != len(cage.indices) or own.max(initial=-1) >= len(values):
                return None
            cage, place = make_value_cage(cage, own, read_text(attribute, EARLIEST_TIME))
            flat = flat[place]
        elif len(values) != len(cage.corner_sharpness):
            return None
        elif interpolation == UsdGeom.Tokens.varying:
            cage = replace(cage, rules=cage.rules._replace(is_linear=True))
        refined = refine(cage, self._refined.levels)
        corners = (refined.matrix @ flat)[refined.indices]
        return corners.reshape(-1, *values.shape[1:])


def _read_creases(mesh: Any, size: int) -> Sharp:
    """Return the edges of the polylines of creases; one sharpness for each line or each edge."""
    lengths = _read_indices(mesh.GetCreaseLengthsAttr(), None)
    attribute = mesh.GetCreaseIndicesAttr()
    indices, sharpness = (
        _read_indices(attribute, size),
        _read_sharpness(mesh.GetCreaseSharpnessesAttr()),
    )
    if (lengths < 2).any() or lengths.sum() != len(indices):
        message = f"has {len(indices)}, where creaseLengths add up to {lengths.sum()}, of 2 or more"
        raise fault(attribute, message)
    edges = np.ones(max(len(indices) - 1, 0), np.bool_)
    edges[(np.cumsum(lengths) - 1)[:-1]] = False
    first = np.flatnonzero(edges)
    if len(sharpness) == len(lengths):
        sharpness = np.repeat(sharpness, np.maximum(lengths - 1, 0))
    if len(sharpness) != len(first):
        message = (
            f"has {len(sharpness)}, expects {len(lengths)} for lines or {len(first)} for edges"
        )
        raise fault(mesh.GetCreaseSharpnessesAttr(), message)
    return Sharp(np.stack([indices[first], indices[first + 1]], axis=1), sharpness)


def _read_corners(mesh: Any, size: int) -> Sharp:
    indices = _read_indices(mesh.GetCornerIndicesAttr(), size)
    sharpness = _read_sharpness(mesh.GetCornerSharpnessesAttr())
    if len(sharpness) != len(indices):
        message = f"has {len(sharpness)}, expects {len(indices)} as cornerIndices"
        raise fault(mesh.GetCornerSharpnessesAttr(), message)
    return Sharp(indices, sharpness)


def _read_indices(attribute: Any, size: int | None) -> Indices:
    """(K,) integers within 0 and size."""
    values = read_sized_array(attribute, EARLIEST_TIME, INTEGER_ARRAY).astype(np.int64)
    if size is not None and len(values) and (values.min() < 0 or values.max() >= size):
        wrong = values[(values < 0) | (values >= size)][0]
        raise fault(attribute, f"{wrong} {describe_range(size)}")
    return values


def _read_sharpness(attribute: Any) -> Array:
    values = read_sized_array(attribute, EARLIEST_TIME, NUMBER_ARRAY).astype(np.float64)
    if np.isnan(values).any():
        raise fault(attribute, "holds values that are no numbers")
    return values


def list_topology_faults(mesh: Any) -> Iterator[tuple[str, str]]:
    """Yield (attribute, message) of all that keeps a mesh from being followed."""
    attributes = {
        "faceVertexCounts": mesh.GetFaceVertexCountsAttr(),
        "faceVertexIndices": mesh.GetFaceVertexIndicesAttr(),
        "holeIndices": mesh.GetHoleIndicesAttr(),
    }
    values = {name: _read_constant(attribute) for name, attribute in attributes.items()}
    for name, (_, changed) in values.items():
        if changed is not None:
            told = f"changes at time code {changed:g}. Export a mesh whose faces stay the same"
            yield name, told
            return
    counts, indices = values["faceVertexCounts"][0], values["faceVertexIndices"][0]
    if counts is None or indices is None:
        yield "faceVertexCounts" if counts is None else "faceVertexIndices", "has no value"
        return
    total, size = check_points(mesh.GetPointsAttr())
    if total:
        yield "points", total
        return
    if (counts < 3).any():
        face = int(np.flatnonzero(counts < 3)[0])
        yield "faceVertexCounts", f"face {face} has {counts[face]} sides, expects 3 at least"
    elif counts.sum() != len(indices):
        yield "faceVertexIndices", f"has {len(indices)}, the counts add up to {counts.sum()}"
    elif len(indices) and (indices.min() < 0 or indices.max() >= size):
        bad = int(indices[(indices < 0) | (indices >= size)][0])
        yield "faceVertexIndices", f"{bad} {describe_range(size)}"
    holes = values["holeIndices"][0]
    if holes is not None and len(holes) and (holes.min() < 0 or holes.max() >= len(counts)):
        bad = int(holes[(holes < 0) | (holes >= len(counts))][0])
        yield "holeIndices", f"name face {bad} of {len(counts)}"


def _read_constant(attribute: Any) -> tuple[Indices | None, float | None]:
    """Return the first value of an integer array, and the time code at which another stands."""
    known = None
    for code in list_times(attribute):
        value = read_array(attribute, code, INTEGER_ARRAY)
        if known is None and value is not None:
            known = value.astype(np.int64)
        elif known is not None and (value is None or not np.array_equal(value, known)):
            return known, code.GetValue()
    return known, None


def check_points(attribute: Any) -> tuple[str, int]:
    """Return the first fault of the points of any sample (empty: none), and their number.

    Every sample is read.
    """
    size = -1
    for code in list_times(attribute):
        where = describe_time(code)
        points = read_array(attribute, code, VECTOR_ARRAY)
        if points is None:
            return f"has no value {where}. Give points at every sample", 0
        if size not in (-1, len(points)):
            told = f"has {len(points)} points {where}, {size} before"
            return f"{told}. Export a mesh that keeps its points", 0
        size = len(points)
        # the sum of finite values is finite here, and one pass over them is enough
        if not np.isfinite(points.sum(dtype=np.float64)):
            return f"holds values that are not finite {where}", 0
    return ("has no value", 0) if size < 0 else ("", size)


def read_topology(mesh: Any) -> tuple[Indices, Indices]:
    """Return (F,) counts of points of the faces, and the indices of all of them."""
    counts = read_sized_array(mesh.GetFaceVertexCountsAttr(), EARLIEST_TIME, INTEGER_ARRAY)
    indices = read_sized_array(mesh.GetFaceVertexIndicesAttr(), EARLIEST_TIME, INTEGER_ARRAY)
    return counts.astype(np.int64), indices.astype(np.int64)


class MeshTriangles(NamedTuple):
    """Triangles (T, 3) of a mesh. places, face, closed, turned, border: as of Surface."""

    triangles: Indices
    places: Indices
    face: Indices
    closed: Flags
    turned: Flags
    border: Flags


def read_primvar(primvar: Any, kind: Any) -> tuple[Array, str, Indices | None] | None:
    """Return the values (K, ...) of a primvar, its interpolation and its indices; None without.

    kind: of values.to_numpy.
    """
    indexed = bool(primvar) and primvar.IsIndexed()
    value = read_value(primvar.GetAttr(), EARLIEST_TIME) if indexed else None
    by_corner = indexed and primvar.GetInterpolation() == UsdGeom.Tokens.faceVarying
    numbers = None
    if by_corner and value is not None:
        numbers = read_sized_array(primvar.GetIndicesAttr(), EARLIEST_TIME, INTEGER_ARRAY)
        size = len(list_elements(value))
        if len(numbers) and (numbers.min() < 0 or numbers.max() >= size):
            raise fault(primvar.GetIndicesAttr(), describe_range(size))
        numbers = numbers.astype(np.int64)
    else:
        value = read_flattened(primvar, EARLIEST_TIME)
    if value is None:
        return None
    values = to_numpy(list_elements(value), kind, primvar.GetAttr()).astype(np.float64)
    return values, str(primvar.GetInterpolation()), numbers


def read_triangles(
    mesh: Any, faces: tuple[Indices, Indices, Indices], points: Array, mirrored: bool
) -> MeshTriangles:
    """Return the triangles of a mesh with sound topology, the outside counter-clockwise.

    Holes, and triangles without area, are left out. faces: counts of corners, their points, and the
    faces of the mesh that each is part of. points: (V, 3), at rest. mirrored: whether transforms
    turn windings round, as a left-handed orientation does.
    """
    counts, indices, parent = faces
    places, face, normals = triangulate(counts, indices, points)
    triangles = indices[places]
    flat = is_flat(points, triangles)
    a, b, c = triangles[flat].T
    # what has two corners in one place of the list is no part of the surface, nor are holes
    absent = np.zeros(len(face), dtype=np.bool_)
    absent[flat] = (a == b) | (b == c) | (c == a)
    holes = read_sized_array(mesh.GetHoleIndicesAttr(), EARLIEST_TIME, INTEGER_ARRAY)
    if len(holes):
        absent |= np.isin(parent[face], holes)
    is_part = np.bincount(face[~absent], minlength=len(counts)) > 0
    sides = np.zeros((3, len(counts)), dtype=np.bool_)
    sides[:, is_part] = orient(
        counts[is_part], indices[np.repeat(is_part, counts)], points, normals[is_part]
    )
    if flat.any() or absent.any():
        sound = ~(flat | absent)
        places, face = places[sound], face[sound]
    closed, turned, border = sides[:, face]
    orientation = read_text(mesh.GetOrientationAttr(), EARLIEST_TIME)
    is_reversed = (orientation == UsdGeom.Tokens.leftHanded) != mirrored
    # the outside of a volume does not depend on its winding
    turned = turned ^ (closed & is_reversed)
    swapped = turned ^ is_reversed
    if swapped.any():
        places = np.where(swapped[:, None], places[:, [0, 2, 1]], places)
    return MeshTriangles(indices[places], places, parent[face], closed, turned, border)


# m, of a surface from the one that is drawn: a vane's thickness
MAX_UNTOLD_DISTANCE = 1e-4


def read_scheme(mesh: Any) -> str:
    """Return the scheme that a mesh is subdivided by: catmullClark, loop, bilinear or none.

    Raises InputError for another one.
    """
    attribute = mesh.GetSubdivisionSchemeAttr()
    scheme = read_text(attribute, EARLIEST_TIME)
    if scheme not in ("catmullClark", "loop", "bilinear", "none"):
        message = f"'{scheme}' is unknown. Give catmullClark, loop, bilinear or none"
        raise fault(attribute, message)
    return scheme


def open_limit(mesh: Any, counts: Indices, indices: Indices, points: Array) -> LimitSurface | None:
    """Return the subdivided surface of a mesh with points (V, 3) m at rest.

    None for a mesh that is drawn as it is, or whose faces are as near to the surface as need be.
    """
    scheme = read_scheme(mesh)
    if scheme == "none" or not len(counts):
        return None
    large = len(counts) > MAX_REFINED_FACES
    if large and estimate_cage_distance(counts, indices, points, scheme) <= MAX_LIMIT_DISTANCE:
        return None  # a refinement would be no nearer
    return LimitSurface(mesh, (counts, indices), scheme, points)


def measure_distance(mesh: Any, counts: Indices, indices: Indices, points: Array) -> float:
    """Return the largest distance (m) of points (V, 3) of a mesh to its subdivided surface; of a
    large mesh an estimate that takes creases as smooth."""
    scheme = read_scheme(mesh)
    if scheme in ("none", "bilinear") or not len(counts):
        return 0.0
    if len(counts) > MAX_REFINED_FACES:
        return estimate_cage_distance(counts, indices, points, scheme)
    return measure_cage_distance(_read_cage(mesh, (counts, indices), scheme, len(points)), points)
