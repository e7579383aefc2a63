"""Kernels of the judge: lengths of strands, jumps of points, errors of velocities.

    stretch    l / l_rest - 1                                of a rachis or barb, l along its nodes
    strain     |e| + r3 |k2 - k2_rest| + r2 |k3 - k3_rest|   of a rachis' outermost fibre, at a ring
    jump       x(t - h) - y(t - h) + x(t + h) - y(t + h), over L    of a point of a feather L long
    explained  h (v(t + h) - v(t - h)) / 2                   of a jump, by the velocities
    error      v(t) - (x(t - 2h) - 8 x(t - h) + 8 x(t + h) - x(t + 2h)) / 12h

y(t') = r(t') + R(t') R(t)^T (x(t) - r(t)) is where the point would be if it were rigid with its
root r, whose frame is R: a jump is a second difference without what the root explains. Velocities
are held against the whole one.

e is the stretch of the segments at a ring, k2 and k3 its curvature about two directions of the
section, of half widths r2 and r3: of a beam whose sections stay plane (Timoshenko, Strength of
Materials). Curvature is the turn from one segment to the next over their mean length at rest.

The five-point difference is exact to h^4 / 30 times the fifth derivative, the central one to
h^2 / 6 times the third (Abramowitz and Stegun, Handbook of Mathematical Functions, 25.3). What
they differ by the samples leave open. At a kink of the motion, as a skin's frames are, a velocity
may be that before or after it: the three-point differences of one side.
"""

from __future__ import annotations

from math import acos, log2, sqrt

import numpy as np
from numpy.typing import NDArray

from featherfx.algebra.vector_kernels import accumulate, add, cross, dot, length, scale, store, sub
from featherfx.jit.compiled import kernel
from featherfx.usd.check.tracks import BINS_PER_OCTAVE, MIN_EXPONENT

Array = NDArray[np.float64]
# of the angle between two segments of a rachis, and between two points of a ring, that give axes
_MIN_BEND_SINE, _MIN_RING_SINE = 1e-3, 0.1
_NO_LENGTH = 1e-300
Floats = NDArray[np.float32]
Indices = NDArray[np.int64]


@kernel
def find_nodes(points, strands, nodes):
    """Nodes (N, 3) of points (V, 3)."""
    for n in range(nodes.shape[0]):
        low, high = strands.node_first[n], strands.node_first[n + 1]
        x = y = z = 0.0
        for k in range(low, high):
            v = strands.node_points[k]
            x, y, z = x + points[v, 0], y + points[v, 1], z + points[v, 2]
        count = float(high - low)
        nodes[n, 0], nodes[n, 1], nodes[n, 2] = x / count, y / count, z / count


@kernel
def strand_lengths(nodes, strands, out):
    """Lengths (K,) of strands."""
    for k in range(out.shape[0]):
        total = 0.0
        for s in range(strands.first[k], strands.first[k + 1]):
            total += length(sub(nodes[strands.end[s]], nodes[strands.start[s]]))
        out[k] = total


@kernel
def _keep(value, code, f, kind, worst):
    if value > worst.value[f, kind]:
        worst.value[f, kind], worst.at[f, kind] = value, code


@kernel
def keep_stretches(lengths, rest, strands, rounding, code, worst):
    """Keep the largest stretches. lengths, rest: (K,). rounding: of a coordinate."""
    for k in range(rest.shape[0]):
        segments = strands.first[k + 1] - strands.first[k]
        away = abs(lengths[k] - rest[k]) - rounding * sqrt(float(segments))
        if away > 0.0 and rest[k] > 0.0:
            _keep(away / rest[k], code, strands.feather[k], strands.kind[k], worst)


@kernel
def find_curvatures(points, nodes, strands, out):
    """Curvatures (R, 5) where the segments of rachises begin: lengths of the segments before and
    after, the turn about two directions of the section, and its half width along the first."""
    for k in range(strands.kind.shape[0]):
        for s in range(strands.first[k] + 1, strands.first[k + 1]):
            if strands.kind[k] != 0:
                break
            n = strands.start[s]
            first = strands.node_first[n]
            before = sub(nodes[n], nodes[strands.start[s - 1]])
            after = sub(nodes[strands.end[s]], nodes[n])
            low, high = length(before), length(after)
            out[s, 0], out[s, 1] = low, high
            if strands.node_first[n + 1] - first < 3 or low * high == 0.0:
                continue
            along = add(scale(1.0 / low, before), scale(1.0 / high, after))
            along = scale(1.0 / max(length(along), 1e-30), along)
            corner = sub(points[strands.node_points[first]], nodes[n])
            side = sub(corner, scale(dot(corner, along), along))
            out[s, 4] = length(side)
            side = scale(1.0 / max(out[s, 4], 1e-30), side)
            turn = scale(1.0 / (low * high), cross(before, after))
            out[s, 2], out[s, 3] = dot(turn, side), dot(turn, cross(along, side))


@kernel
def keep_strains(now, rest, heights, strands, code, worst):
    """Keep the largest strains. now, rest: as of find_curvatures. heights: (R,) half widths along
    the second direction."""
    for k in range(strands.kind.shape[0]):
        for s in range(strands.first[k] + 1, strands.first[k + 1]):
            total = rest[s, 0] + rest[s, 1]
            if strands.kind[k] == 0 and total > 0.0:
                bent = heights[s] * abs(now[s, 2] - rest[s, 2])
                bent += rest[s, 4] * abs(now[s, 3] - rest[s, 3])
                strain = abs((now[s, 0] + now[s, 1]) / total - 1.0) + 2.0 * bent / total
                _keep(strain, code, strands.feather[k], 4, worst)


@kernel
def _unit(vector):
    return scale(1.0 / max(length(vector), _NO_LENGTH), vector)


@kernel
def _store_axes(first, third, axes):
    """Columns: a unit vector, the second of a right-handed frame, and a unit vector square to the
    first."""
    second = cross(third, first)
    for k in range(3):
        axes[k, 0], axes[k, 1], axes[k, 2] = first[k], second[k], third[k]


@kernel
def _find_ring_axes(points, nodes, strands, n, axes):
    """Axes of a ring about node n by its first two points; untouched where these give none."""
    first, last = strands.node_first[n], strands.node_first[n + 1] - 1
    one = sub(points[strands.node_points[first]], nodes[n])
    other = sub(points[strands.node_points[min(first + 1, last)]], nodes[n])
    normal = cross(one, other)
    if length(normal) > _MIN_RING_SINE * length(one) * length(other):
        _store_axes(_unit(one), _unit(normal), axes)


@kernel
def _find_curve_axes(nodes, n, axes):
    """Axes along a rachis from node n on, and in the plane in which it bends first. Points of a
    straight one have no side, so that any is right."""
    last = nodes.shape[0] - 1
    second, third = nodes[min(n + 1, last)], nodes[min(n + 2, last)]
    along = _unit(sub(second, nodes[n]))
    bend = cross(along, _unit(sub(third, second)))
    if length(bend) <= _MIN_BEND_SINE:
        x, y, z = abs(along[0]), abs(along[1]), abs(along[2])
        if x <= y and x <= z:
            bend = 0.0, along[2], -along[1]
        elif y <= z:
            bend = -along[2], 0.0, along[0]
        else:
            bend = along[1], -along[0], 0.0
    _store_axes(along, _unit(bend), axes)


@kernel
def find_root_axes(points, nodes, strands, axes):
    """Axes (F, 3, 3), columns: of the rings at the roots, or of the first points of a rachis that
    is a curve; the world's where none is."""
    for f in range(axes.shape[0]):
        for i in range(3):
            for k in range(3):
                axes[f, i, k] = 1.0 if i == k else 0.0
        if nodes.shape[0] != points.shape[0]:
            _find_ring_axes(points, nodes, strands, strands.root[f], axes[f])
    if nodes.shape[0] == points.shape[0]:
        for k in range(strands.kind.shape[0]):
            if strands.kind[k] == 0:
                f = strands.feather[k]
                _find_curve_axes(nodes, strands.root[f], axes[f])


@kernel
def measure_sample(points, rest, now, strands, rounding, code, worst):
    """Measure the points of a sample, written to now, and keep the largest stretches and strains.
    rest, now: SampleShape."""
    find_nodes(points, strands, now.nodes)
    strand_lengths(now.nodes, strands, now.lengths)
    keep_stretches(now.lengths, rest.lengths, strands, rounding, code, worst)
    find_curvatures(points, now.nodes, strands, now.bent)
    keep_strains(now.bent, rest.bent, rest.heights, strands, code, worst)
    find_root_axes(points, now.nodes, strands, now.axes)


@kernel
def _jump(before, here, after):
    return (
        float(before[0]) - 2.0 * here[0] + after[0],
        float(before[1]) - 2.0 * here[1] + after[1],
        float(before[2]) - 2.0 * here[2] + after[2],
    )


@kernel
def _seen_from(vector, axes):
    """Components of a vector along the columns of axes."""
    x, y, z = float(vector[0]), float(vector[1]), float(vector[2])
    return (
        axes[0, 0] * x + axes[1, 0] * y + axes[2, 0] * z,
        axes[0, 1] * x + axes[1, 1] * y + axes[2, 1] * z,
        axes[0, 2] * x + axes[1, 2] * y + axes[2, 2] * z,
    )


@kernel
def _off_root(point, own, root, axes):
    """Offset of a point from a place that is rigid with its root. own: seen from the root."""
    x, y, z = own
    return (
        float(point[0]) - root[0] - axes[0, 0] * x - axes[0, 1] * y - axes[0, 2] * z,
        float(point[1]) - root[1] - axes[1, 0] * x - axes[1, 1] * y - axes[1, 2] * z,
        float(point[2]) - root[2] - axes[2, 0] * x - axes[2, 1] * y - axes[2, 2] * z,
    )


@kernel
def keep_jumps(samples, owner, sizes, limits, worst):
    """Keep the largest jumps.

    owner: (V,) feather of each point. sizes: (F,) lengths. limits: least jump, least ratio to that
    of the root, and least share that velocities leave of one that they do not explain.
    """
    points, roots, rates, axes = samples.points, samples.roots, samples.rates, samples.axes
    for v in range(owner.shape[0]):
        f = owner[v]
        own = _seen_from(sub(points[1][v], roots[1][f]), axes[1][f])
        before = _off_root(points[0][v], own, roots[0][f], axes[0][f])
        jump = _jump(points[0][v], points[1][v], points[2][v])
        # axes of a curve may turn where the feather hardly moves
        seen = length(add(before, _off_root(points[2][v], own, roots[2][f], axes[2][f])))
        size = min(seen, length(jump))
        if size <= limits[0] * sizes[f]:
            continue
        if size <= limits[1] * length(_jump(roots[0][f], roots[1][f], roots[2][f])):
            continue
        _keep(size / sizes[f], samples.code, f, 2, worst)
        left = jump
        if rates[0].shape[0] > 0:
            left = sub(jump, scale(0.5 * samples.step, sub(rates[1][v], rates[0][v])))
        if length(left) > limits[2] * length(jump):
            _keep(size / sizes[f], samples.code, f, 3, worst)


@kernel
def _count(square, counts):
    place = 0
    if square > 0.0:
        place = int((0.5 * log2(square) - MIN_EXPONENT) * BINS_PER_OCTAVE)
    counts[min(max(place, 0), counts.shape[0] - 1)] += 1


@kernel
def count_errors(points, rates, step, counts):
    """Count errors of velocities by size; return the sum of squares of the speeds of the points.

    points: at five samples. rates: (V, 3) at the third. step: s. counts: of errors, of what of them
    neither a kink nor the distance of the samples explains, and of what this leaves open.
    """
    total, double = 0.0, 2.0 * step
    for v in range(rates.shape[0]):
        error = wave = onwards = arrived = 0.0
        for c in range(3):
            here = float(points[2][v, c])
            first, second = points[0][v, c] - here, points[1][v, c] - here
            fourth, fifth = points[3][v, c] - here, points[4][v, c] - here
            rate = (8.0 * (fourth - second) - (fifth - first)) / (12.0 * step)
            error += (rates[v, c] - rate) ** 2
            wave += (rate - (fourth - second) / double) ** 2
            onwards += (rates[v, c] - (4.0 * fourth - fifth) / double) ** 2
            arrived += (rates[v, c] - (first - 4.0 * second) / double) ** 2
            total += rate**2
        _count(error, counts[0])
        left = max(sqrt(min(error, min(onwards, arrived))) - sqrt(wave), 0.0)
        _count(left * left, counts[1])
        _count(wave, counts[2])
    return total


@kernel
def find_normals(points, triangles, normals):
    """Unit normals (V, 3) of points, the mean of those of faces, by their angles at a point."""
    normals[:] = 0.0
    for t in range(triangles.shape[0]):
        for k in range(3):
            here = points[triangles[t, k]]
            ahead = _unit(sub(points[triangles[t, (k + 1) % 3]], here))
            behind = _unit(sub(points[triangles[t, (k + 2) % 3]], here))
            angle = acos(min(max(dot(ahead, behind), -1.0), 1.0))
            accumulate(normals[triangles[t, k]], angle, _unit(cross(ahead, behind)))
    for v in range(normals.shape[0]):
        store(normals[v], _unit(normals[v]))


@kernel
def _clamp(value):
    return min(max(value, 0.0), 1.0)


@kernel
def _on_edge(p, a, b):
    """Weight of b at the place of an edge that is nearest to p."""
    along = sub(b, a)
    square = dot(along, along)
    return _clamp(dot(sub(p, a), along) / square) if square > 0.0 else 0.0


@kernel
def _nearest_weights(p, a, b, c):
    """Weights of the corners at the place of a triangle that is nearest to p."""
    u, v, w = sub(b, a), sub(c, a), sub(p, a)
    uu, uv, vv, wu, wv = dot(u, u), dot(u, v), dot(v, v), dot(w, u), dot(w, v)
    square = uu * vv - uv * uv
    if square > 0.0:
        s, t = (vv * wu - uv * wv) / square, (uu * wv - uv * wu) / square
        if s >= 0.0 and t >= 0.0 and s + t <= 1.0:
            return 1.0 - s - t, s, t
    one, two, three = _on_edge(p, a, b), _on_edge(p, b, c), _on_edge(p, c, a)
    best = length(sub(p, add(a, scale(one, u))))
    weights = 1.0 - one, one, 0.0
    away = length(sub(p, add(b, scale(two, sub(c, b)))))
    if away < best:
        best, weights = away, (0.0, 1.0 - two, two)
    if length(sub(p, add(c, scale(three, sub(a, c))))) < best:
        weights = three, 0.0, 1.0 - three
    return weights


@kernel
def find_depths(places, faces, points, triangles, normals, border, depths):
    """Depths (P,) of places (P, 3) behind the nearest of their faces (P, k); 0 for others."""
    for p in range(places.shape[0]):
        place, best = places[p], 1e300
        for k in range(faces.shape[1]):
            corners = triangles[faces[p, k]]
            a, b, c = points[corners[0]], points[corners[1]], points[corners[2]]
            weights = _nearest_weights(place, a, b, c)
            foot = add(add(scale(weights[0], a), scale(weights[1], b)), scale(weights[2], c))
            away = sub(place, foot)
            size = length(away)
            if size >= best:
                continue
            best, depths[p] = size, 0.0
            normal = cross(sub(b, a), sub(c, a))
            if min(weights[0], min(weights[1], weights[2])) <= 0.0:
                normal, is_border = (0.0, 0.0, 0.0), True
                for j in range(3):
                    if weights[j] > 0.0:
                        normal = add(normal, scale(weights[j], normals[corners[j]]))
                        is_border = is_border and border[corners[j]]
                if is_border:
                    continue
            if dot(away, normal) < 0.0:
                depths[p] = size
