"""Subdivision of USD meshes: schemes, and the surface that a renderer draws."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from featherfx.algebra.types import Array, Indices
from featherfx.usd.read.values import EARLIEST_TIME, fault, read_text

if TYPE_CHECKING:
    from featherfx.usd.read.limit_surface import LimitSurface

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
    # with sparse matrices, for meshes that are subdivided alone
    from featherfx.usd.read.limit_surface import LimitSurface, is_fine

    if is_fine(counts, indices, points, scheme):
        return None
    return LimitSurface(mesh, (counts, indices), scheme, points)


def measure_distance(mesh: Any, counts: Indices, indices: Indices, points: Array) -> float:
    """Return the largest distance (m) of points (V, 3) of a mesh to its subdivided surface."""
    scheme = read_scheme(mesh)
    if scheme in ("none", "bilinear") or not len(counts):
        return 0.0
    from featherfx.usd.read.limit_surface import read_cage_distance

    return read_cage_distance(mesh, (counts, indices), scheme, points)
