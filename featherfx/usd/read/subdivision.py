"""Subdivision of USD meshes: their schemes, creases and corners, and how far cages are off."""

from __future__ import annotations

from typing import Any

import numpy as np
from pxr import UsdGeom

from featherfx.algebra.subdivision import (
    MAX_REFINED_FACES,
    Cage,
    Rules,
    Sharp,
    estimate_cage_distance,
    make_cage,
    measure_cage_distance,
)
from featherfx.algebra.types import Array, Indices
from featherfx.usd.read.values import (
    EARLIEST_TIME,
    INTEGER_ARRAY,
    NUMBER_ARRAY,
    fault,
    read_sized_array,
    read_text,
)


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


def read_cage(mesh: Any, counts: Indices, indices: Indices, size: int) -> Cage:
    """Return the cage of a mesh with sound topology and a scheme of subdivision.

    Raises InputError for creases or corners that do not fit, and for loop without triangles.
    """
    rules = Rules(
        scheme=read_scheme(mesh),
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


def read_cage_distance(mesh: Any, counts: Indices, indices: Indices, points: Array) -> float:
    """Return the largest distance (m) of points (V, 3) of a mesh to its limit surface, 0 without
    subdivision; of more than 200,000 faces an estimate that takes creases as smooth."""
    scheme = read_scheme(mesh)
    if scheme in ("none", "bilinear"):
        return 0.0
    if len(counts) > MAX_REFINED_FACES:
        return estimate_cage_distance(counts, indices, points, scheme)
    return measure_cage_distance(read_cage(mesh, counts, indices, len(points)), points)


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
        raise fault(attribute, f"{wrong} is out of range. Give 0 to {size - 1}")
    return values


def _read_sharpness(attribute: Any) -> Array:
    values = read_sized_array(attribute, EARLIEST_TIME, NUMBER_ARRAY).astype(np.float64)
    if np.isnan(values).any():
        raise fault(attribute, "holds values that are no numbers")
    return values
