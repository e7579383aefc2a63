"""Feathers drawn on their leaves: straight lines over a carrier, lifted to a height field.

Leaf of the stacking value p, with n the smoothed normal over the foot x:

    y = x + h n,   h = T (d + s) + (a + c) w(s) + r v(s),   s = (phi - p) / q
    w = s^2,   v = (1 + e) s^2 / (s + e) for s > 0

r raises feathers about their roots, a bends them up, c lifts the feather's own tip. Its vane rolls
about the rachis: a point beside that lies higher by its distance times the roll.

x lies on the carrier rounded over its facets (Phong tessellation, Boubekeur and Alexa 2008). A line
over the carrier keeps its direction d in the plane of the smoothed normals n, which turn steadily
from triangle to triangle; over one with the normal m it goes along (d x n) x m, onto the next one
whichever way that lies. A chord's line is drawn anew until the chord has its length.

Directions are unit vectors square to n. Feet are a triangle and a 3-tuple of barycentric
coordinates. A line that leaves the carrier at a border, or past the end of its flow, goes straight
on through the air.

Stacking values that keep overlapping leaves apart: neighbours in one cell, and first fit.
"""

from __future__ import annotations

from math import cos, sin, sqrt
from typing import NamedTuple

from featherfx.algebra.types import Array, Indices
from featherfx.algebra.vector_kernels import combined, cross, dot, length, over, store, sub
from featherfx.jit.compiled import kernel

# share of the thickness beneath all leaves: bases of late stacking values stay above the carrier
DOWN_SHARE = 0.15
# of the way from a facet to the round surface over it, as published
_ROUNDING = 0.75
# of a feather's length that s may fall along a rachis, and along a barb, before it leaves the skin
_MAX_FALL, _MAX_BARB_FALL = 0.05, 0.5
_MAX_TRIANGLES = 400  # that one chord passes over
_CHORDS = 2  # that are drawn for one of the right length; always as many: shapes move smoothly
_MIN_CHORD = 0.05  # of its length, that a chord on the carrier has
HINGE = 0.15  # e: of a feather's length, in which it turns where it is raised
_TINY = 1e-12  # of unit vectors and barycentric coordinates
# first columns of what vertices have
_NORMAL, _OWN_NORMAL, _HEIGHTS, _PHI = 3, 6, 9, 12


class CarrierArrays(NamedTuple):
    """A carrier as kernels take it; shapes as of CoatMesh, Carrier and TriangleElements.

    vertices: (V, 16) points (m), smoothed normals, those of the mesh, T, a and r (m), phi and q
    (m), and nothing.
    """

    vertices: Array
    faces: Indices
    neighbours: Indices
    gradients: Array
    planes: Array


class RootArrays(NamedTuple):
    """F follicles. triangle: (F,). place: (F, 3) barycentric. heading: (F, 3) unit, of the rachis
    over the carrier. value: (F, 2) m, p and c. depth: (F,) m, of the follicle under its leaf. roll:
    (F,) rad."""

    triangle: Indices
    place: Array
    heading: Array
    value: Array
    depth: Array
    roll: Array


class LeafArrays(NamedTuple):
    """F feathers as drawn. nodes: (F, n, 1 + 2 m, 3) m. directors: (F, n, 2, 3). feet: (F, n,
    1 + 2 m) triangles beneath, weights: (F, n, 1 + 2 m, 3) barycentric, and places: s."""

    nodes: Array
    directors: Array
    feet: Indices
    weights: Array
    places: Array


@kernel
def _at(b, k):
    return b[0] if k == 0 else (b[1] if k == 1 else b[2])


@kernel
def _mixed(b, array, face, first):
    """Mean of the columns first to first + 2 of an array's rows at a face, by weights b."""
    u, v, w = array[face[0]], array[face[1]], array[face[2]]
    x = b[0] * u[first] + b[1] * v[first] + b[2] * w[first]
    y = b[0] * u[first + 1] + b[1] * v[first + 1] + b[2] * w[first + 1]
    z = b[0] * u[first + 2] + b[1] * v[first + 2] + b[2] * w[first + 2]
    return x, y, z


@kernel
def unit(a):
    return over(a, max(length(a), _TINY))


@kernel
def without(a, n):
    """The part of a vector that is square to a unit vector."""
    return combined(1.0, a, -dot(a, n), n)


@kernel
def trace(carrier, triangle, b, d, way):
    """Go straight over the carrier from a foot along d by a way (m).

    Returns the foot, the direction there, and what is left of the way at a border.
    """
    entry, n = -1, unit(_mixed(b, carrier.vertices, carrier.faces[triangle], _NORMAL))
    for _ in range(_MAX_TRIANGLES):
        m = carrier.planes[triangle]
        m = m[0], m[1], m[2]
        # the plane of d and n cuts the triangle so, and leads back where this lies upside down
        own = unit(combined(dot(n, m), d, -dot(d, m), n))
        hats = carrier.gradients[triangle]
        rates = dot(hats[0], own), dot(hats[1], own), dot(hats[2], own)
        least, leaving = way, -1
        for k in range(3):
            rate = _at(rates, k)
            if k != entry and rate < -_TINY:
                reach = max(_at(b, k), 0.0) / -rate
                if reach < least:
                    least, leaving = reach, k
        b = (
            max(b[0] + least * rates[0], 0.0),
            max(b[1] + least * rates[1], 0.0),
            max(b[2] + least * rates[2], 0.0),
        )
        b = over(b, b[0] + b[1] + b[2])
        way -= least
        face = carrier.faces[triangle]
        n = unit(_mixed(b, carrier.vertices, face, _NORMAL))
        d = unit(without(d, n))
        if leaving < 0:
            return triangle, b, d, 0.0
        other = carrier.neighbours[triangle, leaving]
        if other < 0:
            return triangle, b, d, way
        u, v = face[(leaving + 1) % 3], face[(leaving + 2) % 3]
        bu, bv = _at(b, (leaving + 1) % 3), _at(b, (leaving + 2) % 3)
        total = max(bu + bv, _TINY)
        bu, bv = bu / total, bv / total
        there = carrier.faces[other]
        b = (
            bu if there[0] == u else (bv if there[0] == v else 0.0),
            bu if there[1] == u else (bv if there[1] == v else 0.0),
            bu if there[2] == u else (bv if there[2] == v else 0.0),
        )
        for k in range(3):
            if there[k] != u and there[k] != v:
                entry = k
        triangle = other
    return triangle, b, d, way


@kernel
def _raised_share(s):
    """v and its rate by s."""
    if s <= 0.0:
        return 0.0, 0.0
    far = s + HINGE
    return (1.0 + HINGE) * s * s / far, (1.0 + HINGE) * s * (s + 2.0 * HINGE) / (far * far)


@kernel
def rounded(found, x, share, point, normal):
    """A point that is going to the round surface, taken there by a share of a vertex."""
    return combined(1.0, found, -_ROUNDING * share * dot(sub(x, point), normal), normal)


@kernel
def _round(carrier, triangle, b, x):
    """The point of the round surface over a foot at x of its facet."""
    face, found = carrier.faces[triangle], x
    for k in range(3):
        own = carrier.vertices[face[k]]
        normal = own[_OWN_NORMAL], own[_OWN_NORMAL + 1], own[_OWN_NORMAL + 2]
        found = rounded(found, x, _at(b, k), (own[0], own[1], own[2]), normal)
    return found


@kernel
def _find_shares(carrier, triangle, b, leaf):
    """Shares of T, a and r in the height of a leaf (p, c) over a foot, c besides (m), s, and the
    rate of h by phi."""
    face = carrier.faces[triangle]
    phi, gain, _ = _mixed(b, carrier.vertices, face, _PHI)
    thickness, lift, rise = _mixed(b, carrier.vertices, face, _HEIGHTS)
    s, lift = (phi - leaf[0]) / gain, lift + leaf[1]
    ahead = max(s, 0.0)
    raised, raising = _raised_share(s)
    by_phi = (thickness + 2.0 * lift * ahead + rise * raising) / gain
    return (DOWN_SHARE + s, ahead * ahead, raised), leaf[1] * ahead * ahead, s, by_phi


@kernel
def leaf_point(carrier, triangle, b, leaf):
    """The point of a leaf (p, c) over a foot, n, the gradient of h (3,), s, and the shares of T, a
    and r in h."""
    shares, own, s, by_phi = _find_shares(carrier, triangle, b, leaf)
    face, slope = carrier.faces[triangle], (0.0, 0.0, 0.0)
    normal = unit(_mixed(b, carrier.vertices, face, _NORMAL))
    point = _round(carrier, triangle, b, _mixed(b, carrier.vertices, face, 0))
    height = own + dot(shares, _mixed(b, carrier.vertices, face, _HEIGHTS))
    for k in range(3):
        vertex, hat = carrier.vertices[face[k]], carrier.gradients[triangle, k]
        change = dot(shares, (vertex[_HEIGHTS], vertex[_HEIGHTS + 1], vertex[_HEIGHTS + 2]))
        slope = combined(1.0, slope, change + by_phi * (vertex[_PHI] - s * vertex[_PHI + 1]), hat)
    return combined(1.0, point, height, normal), normal, slope, s, shares


@kernel
def _lifted(d, n, slope):
    """The unit tangent of the leaf over a direction, and the leaf's unit normal."""
    normal = unit(sub(n, slope))
    tangent = combined(1.0, d, -dot(d, normal) / max(dot(n, normal), _TINY), n)
    return unit(tangent), normal


@kernel
def _turned(d, n, slope, angle):
    """The direction over the carrier whose tangent of the leaf is d's, turned by an angle (rad)."""
    tangent, normal = _lifted(d, n, slope)
    turned = combined(cos(angle), tangent, sin(angle), cross(normal, tangent))
    return unit(without(turned, n))


@kernel
def _advance(carrier, foot, leaf, at, way, drop, least):
    """Draw a chord of a length (m) from a point: the foot, point and s where it ends.

    foot: triangle, b, d, whether it is off the carrier, n, slope. drop: m, that the end lies under
    the leaf. least: s below which it leaves the carrier.
    """
    triangle, b, d, off, n, slope, s = foot
    if not off:
        rise = dot(slope, d)
        step = way / sqrt(1.0 + rise * rise)
        for _ in range(_CHORDS):
            there, c, e, left = trace(carrier, triangle, b, d, step)
            point, m, up, t, _ = leaf_point(carrier, there, c, leaf)
            chord = sub(combined(1.0, point, -drop, m), at)
            gone = max(length(chord), _MIN_CHORD * way)
            step *= way / gone
        if left <= 0.0 and t >= least and gone > _MIN_CHORD * way:
            return (there, c, e, False, m, up, t), combined(1.0, at, way / gone, chord)
        d, n = _lifted(d, n, slope)
        slope = 0.0, 0.0, 0.0
    gain = _mixed(b, carrier.vertices, carrier.faces[triangle], _PHI)[1]
    return (triangle, b, d, True, n, slope, s + way / gain), combined(1.0, at, way, d)


@kernel
def _note(drawn, f, i, column, point, foot):
    store(drawn.nodes[f, i, column], point)
    store(drawn.weights[f, i, column], foot[1])
    drawn.feet[f, i, column], drawn.places[f, i, column] = foot[0], foot[6]


@kernel
def _draw_barb(carrier, forms, f, i, side, start, leaf, drawn):
    """Draw a barb from its row's foot, whose d is that of the row's frame. start: foot, roll."""
    foot, roll = start
    columns, at = forms.pieces.shape[3], drawn.nodes[f, i, 0]
    point, last, least = (at[0], at[1], at[2]), 0.0, foot[6] - _MAX_BARB_FALL
    drop = 0.0
    for j in range(columns):
        column, piece = 1 + side * columns + j, forms.pieces[f, side, i, j]
        if piece > 0.0:
            angle = forms.angles[f, side, i, j]
            triangle, b, d, off, n, slope, s = foot
            foot = triangle, b, _turned(d, n, slope, angle - last), off, n, slope, s
            last, drop = angle, drop - roll * piece * sin(angle)
            foot, point = _advance(carrier, foot, leaf, point, piece, drop, least)
        _note(drawn, f, i, column, point, foot)


@kernel
def _rising(tangent, normal, n, depth, sunk, bare):
    """Tangent and normal of a rachis that rises through the skin: its depth falls as u^2."""
    if sunk > 0.0 and depth > 0.0:
        tangent = unit(combined(1.0, tangent, 2.0 * depth * sqrt(sunk) / bare, n))
        normal = unit(without(normal, tangent))
    return tangent, normal


@kernel
def draw_feathers(carrier, roots, forms, numbers, drawn, low, high):
    """Draw feathers from low to high - 1 of a list. numbers: (K,) follicles; forms, drawn: K."""
    rows = forms.sunk.shape[1]
    for f in range(low, high):
        r = numbers[f]
        place, heading = roots.place[r], roots.heading[r]
        triangle, b, roll = roots.triangle[r], (place[0], place[1], place[2]), roots.roll[r]
        leaf = roots.value[r, 0], roots.value[r, 1]
        depth = roots.depth[r] if forms.sunk[f, 0] > 0.0 else 0.0
        x, n, slope, s, _ = leaf_point(carrier, triangle, b, leaf)
        d = unit(without((heading[0], heading[1], heading[2]), n))
        point = combined(1.0, x, -depth, n)
        foot, top = (triangle, b, d, False, n, slope, s), s
        for i in range(rows):
            _note(drawn, f, i, 0, point, foot)
            triangle, b, d, off, n, slope, s = foot
            if i > 0:
                d = _turned(d, n, slope, -forms.behind[f, i - 1])
            foot = triangle, b, d, off, n, slope, s
            tangent, normal = _lifted(d, n, slope)
            tangent, normal = _rising(tangent, normal, n, depth, forms.sunk[f, i], forms.bare[f])
            lateral = cross(normal, tangent)
            store(drawn.directors[f, i, 0], combined(cos(roll), lateral, sin(roll), normal))
            store(drawn.directors[f, i, 1], combined(cos(roll), normal, -sin(roll), lateral))
            for side in range(2):
                _draw_barb(carrier, forms, f, i, side, (foot, roll), leaf, drawn)
            if i + 1 < rows:
                d = _turned(d, n, slope, forms.ahead[f, i])
                foot, drop = (triangle, b, d, off, n, slope, s), depth * forms.sunk[f, i + 1]
                way = forms.steps[f, i]
                foot, point = _advance(carrier, foot, leaf, point, way, drop, top - _MAX_FALL)
                top = max(top, foot[6])


@kernel
def find_bases(carrier, roots, points, normals):
    """Points of the leaves over their own follicles (F, 3), and normals n there (F, 3)."""
    for f in range(roots.triangle.shape[0]):
        place = roots.place[f]
        b, leaf = (place[0], place[1], place[2]), (roots.value[f, 0], roots.value[f, 1])
        point, normal, _, _, _ = leaf_point(carrier, roots.triangle[f], b, leaf)
        store(points[f], point)
        store(normals[f], normal)


_FIT_ROUNDING = 1e-9  # of gaps


@kernel
def count_pairs(starts, feather, gap, found):
    """Pairs of different feathers in one cell; returns how many there are.

    starts: (C + 1,) first entry of each cell. feather, gap: (N,) of the entries. found: pair
    (K, 3), the lower number first and the greater gap, written as far as there is room.
    """
    count = 0
    for cell in range(starts.shape[0] - 1):
        for a in range(starts[cell], starts[cell + 1]):
            for b in range(a + 1, starts[cell + 1]):
                if count < found.shape[0]:
                    found[count, 0] = min(feather[a], feather[b])
                    found[count, 1] = max(feather[a], feather[b])
                    found[count, 2] = max(gap[a], gap[b])
                count += 1
    return count


@kernel
def _find_share(value, near, count):
    """The least share of its gap that a value is apart from others; 1 at most."""
    share = 1.0
    for k in range(count):
        share = min(share, abs(near[k, 0] - value) / near[k, 1])
    return share


@kernel
def _find_near(neighbours, f, values, low, high, near):
    """Values and gaps of neighbours within a gap of low to high, sorted. Returns their count."""
    count = 0
    for e in range(neighbours.starts[f], neighbours.starts[f + 1]):
        value, gap = values[neighbours.feather[e]], neighbours.gap[e]
        if low - gap < value < high + gap:
            k = count
            while k > 0 and near[k - 1, 0] > value:
                near[k, 0], near[k, 1] = near[k - 1, 0], near[k - 1, 1]
                k -= 1
            near[k, 0], near[k, 1] = value, gap
            count += 1
    return count


@kernel
def fit_values(order, neighbours, own, limits, values, near):
    """Fit stacking values between those of their neighbours, in an order.

    Each feather takes the value nearest to its own that is apart from its neighbours', or else the
    one with the largest share of its gaps. own: (F,) m. limits: (F, 2) m, how much earlier and
    later it may be. values: (F,) m, inf where not yet found. near: (N, 2), scratch memory for the
    neighbours of one.
    """
    for place in range(order.shape[0]):
        f = order[place]
        low, high = own[f] - limits[f, 0], own[f] + limits[f, 1]
        count, best = _find_near(neighbours, f, values, low, high, near), -1.0
        if low <= values[f] <= high and _find_share(values[f], near, count) >= 1.0 - _FIT_ROUNDING:
            continue
        # its own value and both limits; of each neighbour, a gap to either side, and half way on
        for k in range(-3, 3 * count):
            if k < 0:
                value = own[f] if k == -3 else (low if k == -2 else high)
            elif k % 3 < 2:
                value = (
                    near[k // 3, 0] + (2 * (k % 3) - 1) * (1.0 + _FIT_ROUNDING) * near[k // 3, 1]
                )
            else:
                value = 0.5 * (near[k // 3, 0] + near[min(k // 3 + 1, count - 1), 0])
            share = _find_share(value, near, count) if low <= value <= high else -1.0
            nearer = abs(value - own[f]) < abs(values[f] - own[f])
            if share > best or (share == best and nearer):
                values[f], best = value, share
