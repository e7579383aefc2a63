"""Triangles of one pose with the attributes that shading needs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from featherfx.algebra.types import Array, Floats, Indices
from featherfx.algebra.vectors import unit

# barbs where there are none: no place is between them
_WHOLE = np.array([0.5, 0.0, 0.0, 1.0, 0.0], dtype=np.float32)


@dataclass(frozen=True)
class Geometry:
    """V vertices and T triangles; metres, z up.

    points: (V, 3). triangles: (T, 3). material: (T,) VANE, SHAFT, SKIN or EYE of light_kernels.
    normals, tangents: (V, 3), zero where there is none. colours: (V, 3), as a kernel takes them.
    barbs: (V, 5) of vanes: number of the barb and place on it, how round it is shaded, the part of
    it over which its end is free (barb_kernels.py), and nm of a film that shines by interference.
    """

    points: Floats
    triangles: NDArray[np.int32]
    material: NDArray[np.uint8]
    normals: Floats
    tangents: Floats
    colours: Floats
    barbs: Floats


def geometry_of(
    points: Array | Floats,
    triangles: Indices,
    material: Array | int,
    normals: Array | Floats,
    colours: Array | Floats,
) -> Geometry:
    """Make geometry of triangles without barbs. material: one, or (T,). colours: (V, 3) or (3,)."""
    flat = np.zeros_like(points, dtype=np.float32)
    return Geometry(
        points=points.astype(np.float32),
        triangles=triangles.astype(np.int32),
        material=np.broadcast_to(material, len(triangles)).astype(np.uint8),
        normals=normals.astype(np.float32),
        tangents=flat,
        colours=np.broadcast_to(colours, points.shape).astype(np.float32),
        barbs=np.broadcast_to(_WHOLE, (len(points), 5)),
    )


def joined(parts: Sequence[Geometry]) -> Geometry:
    """Several as one."""
    starts = np.cumsum([0, *(len(part.points) for part in parts[:-1])])
    values = {
        each.name: np.concatenate([getattr(part, each.name) for part in parts])
        for each in fields(Geometry)
    }
    values["triangles"] = np.concatenate(
        [part.triangles + np.int32(start) for part, start in zip(parts, starts, strict=True)]
    )
    return Geometry(**values)


def apart(points: Array, triangles: Indices, normals: Array, colours: Array) -> Geometry:
    """Triangles that share no vertices, of colours (T, 3)."""
    corners = triangles.ravel()
    own = np.arange(len(corners)).reshape(-1, 3)
    return geometry_of(points[corners], own, 0, normals[corners], np.repeat(colours, 3, axis=0))


def vertex_normals(points: Array, triangles: Indices) -> Array:
    """(V, 3) unit, the mean of the triangles around weighted by area; zero where there are none."""
    a, b, c = (points[triangles[:, k]] for k in range(3))
    normal = np.cross(b - a, c - a)
    summed = np.stack(
        [
            sum(np.bincount(triangles[:, k], normal[:, axis], len(points)) for k in range(3))
            for axis in range(3)
        ],
        axis=1,
    )
    return np.asarray(unit(summed))
