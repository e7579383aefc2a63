"""One pose of all feathers as it is written: points, rates, normals, barb directions, extents.

Arrays of all feathers stand one after the other (SurfaceSet). world: (V, 3) scratch, m.
quarter: whether y points up (x, y, z becomes x, z, -y). scale: stage units per metre.
"""

from __future__ import annotations

import math

from featherfx.compiled import kernel


@kernel
def store_turned(x, y, z, scale, quarter, out):
    """A vector of the world frame, turned and scaled, into out (3,)."""
    out[0] = x * scale
    out[1] = (z if quarter else y) * scale
    out[2] = (-y if quarter else z) * scale


@kernel
def combine(material, terms, weights, scale, quarter, world, out):
    """Surface points from material points (M, 3): world in m, out as written."""
    for v in range(terms.shape[0]):
        for c in range(3):
            total = 0.0
            for k in range(3):
                total += weights[v, k] * material[terms[v, k], c]
            world[v, c] = total
        store_turned(world[v, 0], world[v, 1], world[v, 2], scale, quarter, out[v])


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
            store_turned(x, y, z, 1.0 / length, quarter, out[v])
        else:
            store_turned(0.0, 0.0, 1.0, 1.0, quarter, out[v])


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
            store_turned(x, y, z, 1.0 / length, quarter, out[t])
        else:
            store_turned(1.0, 0.0, 0.0, 1.0, quarter, out[t])


@kernel
def extents(points, starts, padding, out):
    """(N, 2, 3) least and greatest corner of each run of points, padded by (N,)."""
    for n in range(starts.shape[0] - 1):
        for c in range(3):
            low = high = points[starts[n], c]
            for v in range(starts[n], starts[n + 1]):
                low, high = min(low, points[v, c]), max(high, points[v, c])
            out[n, 0, c], out[n, 1, c] = low - padding[n], high + padding[n]


@kernel
def changed(points, rates, reference, starts, slow, out):
    """Set out[n] where a run of points differs from the reference or is faster than slow[n]."""
    for n in range(starts.shape[0] - 1):
        for v in range(starts[n], starts[n + 1]):
            for c in range(3):
                if points[v, c] != reference[v, c] or abs(rates[v, c]) > slow[n]:
                    out[n] = True
            if out[n]:
                break
