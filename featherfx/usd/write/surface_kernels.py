"""One pose of a feather as it is written: points, rates, normals, barb directions, extents.

material: (M, 3) material points or rates, world frame, m. quarter: whether y points up (x, y, z
becomes x, z, -y). scale: stage units per metre. Results are single precision.
"""

from __future__ import annotations

import math

from featherfx.jit.compiled import kernel


@kernel
def combine(material, row, terms, weights, size, scale, quarter, out):
    """Surface points (V, 3) of rows of size material points; True if all are finite."""
    total = 0.0
    for v in range(terms.shape[0]):
        first = row[v] * size
        x, y, z = 0.0, 0.0, 0.0
        for k in range(3):
            w = weights[v, k]
            if w != 0.0:
                n = first + terms[v, k]
                x += w * material[n, 0]
                y += w * material[n, 1]
                z += w * material[n, 2]
        out[v, 0] = x * scale
        out[v, 1] = (z if quarter else y) * scale
        out[v, 2] = (-y if quarter else z) * scale
        total += abs(out[v, 0]) + abs(out[v, 1]) + abs(out[v, 2])
    return math.isfinite(total)


@kernel
def place(material, row, terms, weights, size, world):
    """Surface points (V, 3) in the world, in double precision for what is derived of them."""
    for v in range(terms.shape[0]):
        first = row[v] * size
        x, y, z = 0.0, 0.0, 0.0
        for k in range(3):
            w = weights[v, k]
            if w != 0.0:
                n = first + terms[v, k]
                x += w * material[n, 0]
                y += w * material[n, 1]
                z += w * material[n, 2]
        world[v, 0], world[v, 1], world[v, 2] = x, y, z


@kernel
def turn(world, scale, quarter, out):
    """World points or rates (V, 3) as written; True if all are finite."""
    total = 0.0
    for v in range(world.shape[0]):
        x, y, z = world[v, 0], world[v, 1], world[v, 2]
        out[v, 0] = x * scale
        out[v, 1] = (z if quarter else y) * scale
        out[v, 2] = (-y if quarter else z) * scale
        total += abs(out[v, 0]) + abs(out[v, 1]) + abs(out[v, 2])
    return math.isfinite(total)


@kernel
def vertex_normals(world, triangles, quarter, summed, out):
    """Area-weighted unit normals; a point without faces (calamus) is given the up axis."""
    summed[:, :] = 0.0
    for t in range(triangles.shape[0]):
        a, b, c = triangles[t, 0], triangles[t, 1], triangles[t, 2]
        ux, vx = world[b, 0] - world[a, 0], world[c, 0] - world[a, 0]
        uy, vy = world[b, 1] - world[a, 1], world[c, 1] - world[a, 1]
        uz, vz = world[b, 2] - world[a, 2], world[c, 2] - world[a, 2]
        nx, ny, nz = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
        for corner in (a, b, c):
            summed[corner, 0] += nx
            summed[corner, 1] += ny
            summed[corner, 2] += nz
    for v in range(world.shape[0]):
        x, y, z = summed[v, 0], summed[v, 1], summed[v, 2]
        length = math.sqrt(x * x + y * y + z * z)
        if length > 0.0:
            share = 1.0 / length
        else:
            x, y, z, share = 0.0, 0.0, 1.0, 1.0
        out[v, 0] = x * share
        out[v, 1] = (z if quarter else y) * share
        out[v, 2] = (-y if quarter else z) * share


@kernel
def edge_directions(world, edges, quarter, out):
    """Unit vectors along edges (T, 2); x where an edge has no length."""
    for t in range(edges.shape[0]):
        tail, head = edges[t, 0], edges[t, 1]
        x = world[head, 0] - world[tail, 0]
        y = world[head, 1] - world[tail, 1]
        z = world[head, 2] - world[tail, 2]
        length = math.sqrt(x * x + y * y + z * z)
        if length > 0.0:
            share = 1.0 / length
        else:
            x, y, z, share = 1.0, 0.0, 0.0, 1.0
        out[t, 0] = x * share
        out[t, 1] = (z if quarter else y) * share
        out[t, 2] = (-y if quarter else z) * share


@kernel
def extent(points, padding, out):
    """(2, 3) least and greatest corner of points, padded."""
    for c in range(3):
        low = high = points[0, c]
        for v in range(points.shape[0]):
            low, high = min(low, points[v, c]), max(high, points[v, c])
        out[0, c], out[1, c] = low - padding, high + padding


@kernel
def pose_surface(
    material, row, terms, weights, size, triangles, edges, scale, quarter, world, summed,
    points, normals, directions, corners,
):  # fmt: skip
    """Points, normals, barb directions and extent of a surface; True if the points are finite.

    world, summed: (V, 3) scratch.
    """
    place(material, row, terms, weights, size, world)
    finite = turn(world, scale, quarter, points)
    vertex_normals(world, triangles, quarter, summed, normals)
    edge_directions(world, edges, quarter, directions)
    extent(points, 0.0, corners)
    return finite


@kernel
def pose_shaft(material, size, scale, quarter, out):
    """The first point of each row, as written; True if all are finite."""
    total = 0.0
    for i in range(out.shape[0]):
        x, y, z = material[i * size, 0], material[i * size, 1], material[i * size, 2]
        out[i, 0] = x * scale
        out[i, 1] = (z if quarter else y) * scale
        out[i, 2] = (-y if quarter else z) * scale
        total += abs(out[i, 0]) + abs(out[i, 1]) + abs(out[i, 2])
    return math.isfinite(total)


@kernel
def changed(points, rates, reference, rounding):
    """Whether points differ from the reference, or any rate is above rounding * |coordinate|.

    That is the greatest coordinate of all.
    """
    greatest = 0.0
    for v in range(points.shape[0]):
        for c in range(3):
            if points[v, c] != reference[v, c]:
                return True
            greatest = max(greatest, abs(points[v, c]))
    for v in range(points.shape[0]):
        for c in range(3):
            if abs(rates[v, c]) > rounding * greatest:
                return True
    return False
