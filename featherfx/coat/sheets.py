"""Sheets of feathers that a coat lies on: fans of tails, and coverts of folded wings.

A skin rises to coverts that lie over it as a membrane that they bear, so that feathers before them
lie on them. Its height h over the skin, with c along the flow f and b across it, is

    int h^2 + (c f . grad h)^2 + b^2 (|grad h|^2 - (f . grad h)^2) = min,   h >= H at coverts

and 0 under what hides the skin. As b is less than c, it falls steeply beside the coverts.

A fan is sewn to the skin that it stands in. Skin behind the roots of the fan is cut out. A tube of
rings, each around all feathers there, is sewn to the loop that is left and closed at the tips. Its
extents are concave along the fan. So rump and vent lie on a tail and its coverts as on skin: above
and below, never through them.

The ceiling of a coat bounds how far it rises: by feathers over it, such as a folded wing, and
where the skin is hollow.

With y the points of these feathers, over their feet x on the carrier by heights H, there is room at
x' for a rise of

    (min (0.8 H + m |x' - x|) - T (d + s) - a w) / v,    |x' - x| along edges of the skin

with w and v at the greatest s of the leaves there.
Ways n from a hollow skin meet at the height H where det (1 + H grad n) = 0.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from featherfx.algebra.triangulation import (
    factorise,
    find_edges,
    find_vertex_normals,
    make_elements,
    make_smoother,
    make_stiffness,
    spread_heights,
)
from featherfx.algebra.types import Array, Flags, Indices
from featherfx.algebra.vectors import dots, unit
from featherfx.coat.coat import Coat
from featherfx.coat.leaf_kernels import DOWN_SHARE, HINGE
from featherfx.errors import warn_input
from featherfx.groom.skin.field import search_tree
from featherfx.groom.skin.skin import closest

# of the fan's length: how far ahead of its feathers the skin is cut, the first that gives a loop,
# within this of its axis
_AHEAD, _MAX_ASIDE = (0.1, 0.0), 0.6
_CLEARANCE = 0.01  # of the fan's length, of the sheet from the feathers
_STATION = 0.03  # of the fan's length, between rings
# of the height of the highest point that a membrane lies on: its rise over these, its reaches along
# and across the flow, and that of its smoothing; fewest feathers of three birds cross wings so
_OVER, _ALONG, _ACROSS, _REACH = 0.06, 2.0, 0.6, 0.1
_STEEPNESS = 0.5  # of what a membrane lies on, to the corners of triangles around
_MAX_ROUNDS = 40  # in which a membrane finds what bears it; usually 5 to 8
_TRIES = 4  # in which the feet of feathers are found along ways up
# exponent of a ring's section, of an ellipse 2 as at the loop; of the fan's length, until it is so
_ROUNDNESS, _FLATTENING = 4.0, 0.25


class _FanAxes(NamedTuple):
    """Root (3,) m of a fan, its unit way back, to its side and up, and its length, m."""

    root: Array
    back: Array
    side: Array
    up: Array
    length: float


class BearingPoints(NamedTuple):
    """Points of feathers that lie over a skin, (N, 3) m each.

    always: of those that bear its coat. shown: of those that bear it where none of hidden lies over
    the skin, too. hidden: of those that hide the skin.
    """

    always: Array
    shown: Array
    hidden: Array


def raise_onto(points: Array, faces: Indices, onto: BearingPoints, flow: Array) -> Array:
    """The points of a skin, raised as a membrane to feathers that lie over it.

    Ways up are normals smoothed by as much as the skin rises, so that they do not meet over a
    crease. points: (V, 3) m, each place once. faces: (T, 3). flow: (3,), the way of the feathers.
    """
    triangle, place = closest(onto.always, points[faces])
    away = onto.always - np.einsum("nk,nkc->nc", place, points[faces][triangle])
    elements = make_elements(points, faces)
    normals = elements.masses[:, None] * find_vertex_normals(points, faces)
    ways = unit(make_smoother(elements, faces, np.linalg.norm(away, axis=1).max())(normals))
    always, shown, hidden = (_find_heights(points, faces, ways, each) for each in onto)
    top = max(height.max(initial=0.0) for _, _, height in (always, shown))
    least, other = (_find_least(points, each, _OVER * top) for each in (always, shown))
    corners, _, height = hidden
    held = np.zeros(len(points), dtype=bool)
    held[corners[height > 0.0]] = True
    held &= least == 0.0
    least = np.where(held, 0.0, np.maximum(least, other))
    along = unit(flow - (elements.normals @ flow)[:, None] * elements.normals)
    along = np.eye(3) + (_ALONG**2 / _ACROSS**2 - 1.0) * along[:, :, None] * along[:, None]
    tension = make_stiffness(elements, faces, (_ACROSS * top) ** 2 * along)
    rise = _stretch(elements.masses, tension, least, held)
    smooth = make_smoother(elements, faces, _REACH * top)
    soft = smooth(elements.masses * rise)
    soft += smooth(elements.masses * np.maximum(rise - soft, 0.0))
    return np.asarray(points + soft[:, None] * ways)


def _find_least(points: Array, feet: tuple[Indices, Array, Array], over: float) -> Array:
    """Return (V,) m, the least heights of a membrane that lies m over points of some heights."""
    (corners, foot, height), least = feet, np.zeros(len(points))
    for own in corners.T:
        fall = _STEEPNESS * np.linalg.norm(points[own] - foot, axis=1)
        np.maximum.at(least, own, height + over - fall)
    return least


def _stretch(masses: Array, tension: Any, least: Array, held: Flags) -> Array:
    """Return (V,) m, a membrane over least heights (V,) m; it is 0 where held.

    By active sets of primal and dual (Hintermueller, Ito and Kunisch 2003).
    """
    from scipy.sparse import diags_array

    matrix = (diags_array(masses) + tension).tocsr()
    bears = least > 0.0
    for _ in range(_MAX_ROUNDS):
        free = np.flatnonzero(~(bears | held))
        rise = np.where(bears, least, 0.0)
        own = matrix[free]
        rise[free] = -factorise(own[:, free])(own @ rise)
        before = bears
        bears = ~held & np.where(bears, matrix @ rise > 0.0, rise < least)
        if (bears == before).all():
            return rise
    warn_input(
        f"the coat onto a folded wing found no rest in {_MAX_ROUNDS} rounds and may stand off it."
        " Give the skin beneath the wing a more even mesh"
    )
    return rise


def _find_heights(
    points: Array, faces: Indices, ways: Array, own: Array
) -> tuple[Indices, Array, Array]:
    """Find the corners (N, 3) and feet (N, 3) m on a skin of points (N, 3) m over it, and their
    heights (N,) m, along ways up (V, 3)."""
    at, height = own, np.zeros(len(own))
    for _ in range(_TRIES):
        triangle, place = closest(at, points[faces])
        corners = faces[triangle]
        foot, way = (np.einsum("nk,nkc->nc", place, x[corners]) for x in (points, ways))
        height = dots(own - foot, unit(way))
        at = own - height[:, None] * unit(way)
    return corners, foot, height


def sew_fan(points: Array, faces: Indices, nodes: Array, others: Array) -> tuple[Array, Indices]:
    """Sew the sheet of a fan to a skin; returns the skin as it is where it is not cut in one loop.

    points: (V, 3) m, each place once. faces: (T, 3). nodes: (K, n, 3) m of the rachises of the fan,
    right over left. others: (N, 3) m, of all that the sheet encloses: vanes, coverts.
    """
    axes = _find_axes(nodes)
    ways = (others - axes.root) @ axes.back
    for ahead in _AHEAD:
        loop, cut = _cut_behind(points, faces, axes, ways.min() - ahead * axes.length)
        if len(loop):
            break
    else:
        return points, faces
    order = np.argsort((nodes[:, -1] - axes.root) @ axes.side)
    cloud = np.concatenate([others, points[np.unique(faces[cut])]])
    turns = _find_turns(points[loop], axes)
    rings = _make_rings(nodes[order], cloud, points[loop], axes, turns)
    count, first = len(loop), len(points) + len(loop) * np.arange(len(rings))
    bands = [loop, *(begin + np.arange(count) for begin in first)]
    tip = len(points) + count * len(rings)
    found = [faces[~cut]]
    for near, far in zip(bands, [*bands[1:], np.full(count, tip)], strict=True):
        after, beyond = np.roll(near, -1), np.roll(far, -1)
        found.append(np.stack([near, after, beyond], axis=1))
        if far[0] != tip:
            found.append(np.stack([near, beyond, far], axis=1))
    whole = np.concatenate([points, *rings, rings[-1].mean(axis=0)[None]])
    used, number = np.unique(np.concatenate(found), return_inverse=True)
    return whole[used], number.reshape(-1, 3)


def _find_axes(nodes: Array) -> _FanAxes:
    root, tip = nodes[:, 0].mean(axis=0), nodes[:, -1].mean(axis=0)
    back = unit(tip - root)
    wide = np.linalg.svd((nodes[:, -1] - tip) - ((nodes[:, -1] - tip) @ back)[:, None] * back)[2][0]
    side = unit(wide - wide @ back * back)
    up = np.cross(back, side)
    return _FanAxes(root, back, side, up, float(np.linalg.norm(tip - root)))


def _cut_behind(
    points: Array, faces: Indices, axes: _FanAxes, first: float
) -> tuple[Indices, Flags]:
    """Return the loop (M,) around the skin behind a fan's roots, as its faces go round, and its
    faces (T,); an empty one where it is not one loop."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    away = points - axes.root
    way = away @ axes.back
    aside = np.linalg.norm(away - way[:, None] * axes.back, axis=1)
    behind = way > first
    nothing: tuple[Indices, Flags] = np.zeros(0, dtype=np.int64), np.zeros(len(faces), dtype=bool)
    if not behind.any():
        return nothing
    edges = find_edges(faces)
    inner = edges[behind[edges].all(axis=1)]
    shape = len(points), len(points)
    _, part = connected_components(coo_array((np.ones(len(inner)), tuple(inner.T)), shape=shape))
    nearest = np.flatnonzero(behind)[np.linalg.norm(away[behind], axis=1).argmin()]
    cut = (part == part[nearest])[faces].any(axis=1)
    if aside[faces[cut]].max() > _MAX_ASIDE * axes.length:
        return nothing
    own, others = (find_edges(faces[some]) for some in (cut, ~cut))
    key = len(points)
    seam = own[np.isin(own[:, 0] * key + own[:, 1], others[:, 1] * key + others[:, 0])]
    after = dict(seam.tolist())
    loop = [int(seam[0, 0])] if len(seam) else []
    while loop and len(loop) <= len(seam) and after.get(loop[-1], loop[0]) != loop[0]:
        loop.append(after[loop[-1]])
    # of a border within the cut, or several loops, there is no tube
    if len(loop) < 3 or len(loop) != len(seam) or len(after) != len(seam):
        return nothing
    return np.array(loop), cut


def _find_turns(loop: Array, axes: _FanAxes) -> Array:
    """Return (M,) in turns, where points of a loop stand around its axis: 0 above, 0.25 at the
    side. Steps are those of its length."""
    away = loop - loop.mean(axis=0)
    y, z = away @ axes.side, away @ axes.up
    steps = np.linalg.norm(np.roll(loop, -1, axis=0) - loop, axis=1)
    way = np.append(0.0, np.cumsum(steps))[:-1] / steps.sum()
    turns = np.sign(np.sum(z * np.roll(y, -1) - y * np.roll(z, -1))) * way
    return np.asarray(turns - turns[np.argmax(z - np.abs(y))])


def _make_rings(
    nodes: Array, cloud: Array, loop: Array, axes: _FanAxes, turns: Array
) -> list[Array]:
    """Return rings (M, 3) m around a fan, from a loop (M, 3) to the tips.

    nodes: (K, n, 3) from side to side. cloud: (N, 3) m, what they enclose.
    """
    ways = (nodes - axes.root) @ axes.back
    way, aside, high = (((cloud - axes.root) @ each) for each in (axes.back, axes.side, axes.up))
    start = ((loop - axes.root) @ axes.back).max()
    stations = np.arange(start, way.max() + _STATION * axes.length, _STATION * axes.length)
    lines, extents, known = [], [], []
    for station in stations:
        at = np.clip(station, ways[:, 0], ways[:, -1])
        rows = zip(at, ways, nodes - axes.root, strict=True)
        line = np.array([[np.interp(w, own, x) for x in each.T] for w, own, each in rows])
        lines.append((np.maximum.accumulate(line @ axes.side), line @ axes.up))
        near = np.abs(way - station) <= _STATION * axes.length
        if not near.any():  # between rows
            continue
        known.append(station)
        over = high[near] - np.interp(aside[near], *lines[-1])
        extents.append([aside[near].max(), -aside[near].min(), over.max(), -over.min()])
    clear = _CLEARANCE * axes.length
    right, left, above, below = (
        np.interp(stations, *_find_majorant(np.array(known), x)) + clear
        for x in np.array(extents).T
    )
    y, z = np.sin(2.0 * np.pi * turns), np.cos(2.0 * np.pi * turns)
    # an ellipse as the body is, then as flat as the fan
    flat = stations[0] + _FLATTENING * axes.length
    exponents = np.interp(stations, [stations[0], flat], [2.0, _ROUNDNESS])
    rings = []
    for k in range(1, len(stations)):
        size = (np.abs(y) ** exponents[k] + np.abs(z) ** exponents[k]) ** (1.0 / exponents[k])
        across = 0.5 * (right[k] - left[k]) + 0.5 * (right[k] + left[k]) * y / size
        height = np.interp(across, *lines[k])
        height += 0.5 * (above[k] - below[k]) + 0.5 * (above[k] + below[k]) * z / size
        rings.append(
            axes.root
            + stations[k] * axes.back
            + across[:, None] * axes.side
            + height[:, None] * axes.up
        )
    return rings


def _find_majorant(x: Array, y: Array) -> tuple[Array, Array]:
    """Return the corners of the least concave function over (x, y): a tail has no waist."""
    corners: list[int] = []
    for k in range(len(x)):
        while len(corners) > 1 and (y[corners[-1]] - y[corners[-2]]) * (x[k] - x[corners[-2]]) <= (
            y[k] - y[corners[-2]]
        ) * (x[corners[-1]] - x[corners[-2]]):
            corners.pop()
        corners.append(k)
    return x[corners], y[corners]


# of the height of what lies above, and of that where ways from the skin meet, that a coat fills
_FILLED_RATIO, _MEETING_RATIO = 0.8, 0.4
# m: rise of the ceiling over the distance from what lies above
_CEILING_SLOPE = 0.5
# of the feathers' length there: what is higher bounds nothing
_MAX_HEIGHT = 1.0


def find_ceiling(coat: Coat, above: Array, reach: Array, ways: Array) -> Array:
    """Return (V,) m, by which a coat may rise at the vertices of its skin, inf where nothing is
    near.

    above: (N, 3) m, points that may lie over it, at rest. reach: (V,) greatest s there. ways:
    (V, 3) unit, along which it rises.
    """
    faces, rest, fields = coat.mesh.faces, coat.rest, coat.fields
    found = np.full(len(rest.points), np.inf)
    np.minimum.at(found, faces, _MEETING_RATIO * _find_meetings(coat, ways)[:, None])
    if len(above):
        away, _ = search_tree(rest.points).query(above)
        above = above[away < 2.0 * _MAX_HEIGHT * fields.length.max()]
        triangle, place = closest(above, rest.points[faces])
        corners = faces[triangle]
        foot, normal, length = (
            np.einsum("nk,nk...->n...", place, each[corners])
            for each in (rest.points, rest.normals[:, :3], fields.length)
        )
        height = dots(above - foot, unit(normal))
        near = (height > 0.0) & (height < _MAX_HEIGHT * length)
        for k in range(3):
            own = corners[near, k]
            away = np.linalg.norm(rest.points[own] - foot[near], axis=1)
            np.minimum.at(found, own, _FILLED_RATIO * height[near] + _CEILING_SLOPE * away)
    floor = -2.0 * _MAX_HEIGHT * fields.length
    found = -spread_heights(rest.points, faces, -found, _CEILING_SLOPE, floor)
    room = found - (DOWN_SHARE + reach) * fields.thickness - fields.lift * reach**2
    return np.asarray(np.maximum(room, 0.0) * (reach + HINGE) / ((1.0 + HINGE) * reach**2))


def _find_meetings(coat: Coat, ways: Array) -> Array:
    """Return (T,) m, heights at which ways (V, 3) from a triangle meet, inf where they part."""
    turns = np.einsum("tki,tkj->tij", coat.rest.elements.gradients, ways[coat.mesh.faces])
    trace, square = np.trace(turns, axis1=1, axis2=2), np.einsum("tij,tji->t", turns, turns)
    # the lesser principal curvature, of 1 + H trace + H^2 det = 0
    least = 0.5 * (trace - np.sqrt(np.maximum(2.0 * square - trace * trace, 0.0)))
    return np.asarray(1.0 / np.maximum(-least, np.finfo(float).tiny))


def limit_rises(rises: Array, ceiling: Array) -> Array:
    """Return (V,) m, rises that stay below a ceiling, smoothly. rises: (V,) m."""
    up = np.maximum(rises, 0.0)
    ratio = up / np.maximum(ceiling, np.finfo(float).tiny)
    return np.minimum(rises, 0.0) + up / np.hypot(1.0, ratio)
