"""Linear finite elements of a mesh whose points move (triangulation.py)."""

from featherfx.algebra.vector_kernels import (
    accumulate,
    conjugate,
    cross,
    exponential,
    length,
    logarithm,
    matrix_into,
    multiply,
    normal_of,
    over,
    scale,
    store,
    sub,
)
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


@kernel
def multiply_rows(rows, values, result):
    """result (R, D) = rows times values (K, D), D small."""
    for r in range(result.shape[0]):
        for d in range(result.shape[1]):
            total = 0.0
            for k in range(rows.first[r], rows.first[r + 1]):
                total += rows.weights[k] * values[rows.columns[k], d]
            result[r, d] = total


@kernel
def blend_turns(turns, weights, fraction, away, out):
    """Fill rotations (K, 3, 3) between two knots. turns: KnotTurns of K joints. weights: (2, n).
    fraction: of the second knot. away: (2, 3), scratch."""
    ends, ways = turns
    for k in range(out.shape[0]):
        away[:] = 0.0
        for end in range(2):
            for n in range(weights.shape[1]):
                accumulate(away[end], weights[end, n], ways[end, n, k])
        before = multiply(ends[0, k], exponential(away[0]))
        after = multiply(ends[1, k], exponential(away[1]))
        way = multiply(conjugate(before), after)
        if way[0] < 0.0:
            way = -way[0], -way[1], -way[2], -way[3]
        matrix_into(multiply(before, exponential(scale(fraction, logarithm(way)))), out[k])
