"""Linear finite elements of a mesh whose points move (surface_elements.py)."""

from __future__ import annotations

from featherfx.algebra.vector_kernels import accumulate, cross, length, normal_of, over, store, sub
from featherfx.jit.compiled import kernel

_NO_AREA = 1e-30  # m^2, twice the area of a triangle that has none


@kernel
def fill_elements(points, faces, elements):
    """Fill TriangleElements of triangles (T, 3) of points (V, 3) m."""
    elements.masses[:] = 0.0
    for t in range(faces.shape[0]):
        corners = faces[t]
        product = normal_of(points[corners[0]], points[corners[1]], points[corners[2]])
        twice = length(product)
        size = max(twice, _NO_AREA)
        normal = over(product, size)
        store(elements.normals[t], normal)
        elements.areas[t] = 0.5 * twice
        for k in range(3):
            elements.masses[corners[k]] += twice / 6.0
            opposite = sub(points[corners[(k + 2) % 3]], points[corners[(k + 1) % 3]])
            store(elements.gradients[t, k], over(cross(normal, opposite), size))


@kernel
def fill_normals(points, faces, normals):
    """Fill unit normals (V, 3) of points, the mean of the triangles around by their area."""
    normals[:] = 0.0
    for t in range(faces.shape[0]):
        corners = faces[t]
        product = normal_of(points[corners[0]], points[corners[1]], points[corners[2]])
        for k in range(3):
            accumulate(normals[corners[k]], 1.0, product)
    for v in range(normals.shape[0]):
        size = length(normals[v])
        if size > 0.0:
            store(normals[v], over(normals[v], size))
