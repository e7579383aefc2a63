"""Limit surfaces of subdivided USD meshes, with their creases, corners and face-varying values."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

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
from featherfx.algebra.types import Array, Indices
from featherfx.usd.read.values import (
    EARLIEST_TIME,
    INTEGER_ARRAY,
    NUMBER_ARRAY,
    describe_range,
    fault,
    read_sized_array,
    read_text,
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


def is_fine(counts: Indices, indices: Indices, points: Array, scheme: str) -> bool:
    """Return whether faces of a large mesh are so small that a refinement would be no nearer."""
    if len(counts) <= MAX_REFINED_FACES:
        return False
    return estimate_cage_distance(counts, indices, points, scheme) <= MAX_LIMIT_DISTANCE


def read_cage_distance(
    mesh: Any, topology: tuple[Indices, Indices], scheme: str, points: Array
) -> float:
    """Return the largest distance (m) of points (V, 3) of a mesh to its limit surface; of a large
    mesh an estimate that takes creases as smooth."""
    if len(topology[0]) > MAX_REFINED_FACES:
        return estimate_cage_distance(*topology, points, scheme)
    return measure_cage_distance(_read_cage(mesh, topology, scheme, len(points)), points)


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
