"""The skin of a wing that is there: rows of feathers lie on it and reach its edges.

Over the plan of the bones, with s outwards and c backwards, either side of the wing is a height

    h(s, c) = sum of k_ij T_i(s) T_j(c) + the most that the skin stands out of this sum,

T Chebyshev polynomials, k by least squares: smooth where the mesh is coarse, and nowhere within it.
A feather of length l that stands at t = 0 is an arc through h(0), h(l / 2) and h(l) along its way.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.polynomial import chebyshev

from featherfx.algebra.types import Array
from featherfx.algebra.vectors import face_products, frames_from, unit
from featherfx.groom.anatomy.remiges import Remiges, WingBones, frames_at
from featherfx.groom.skin.field import search_tree

_DEGREES = 6, 2  # along the wing, which bends at each joint, and across, which is cambered
_FAR = 0.2  # of the span, where a wing is alone
_THICK = 2.0  # of the height of a wing's sections, from which on they are the body's
_STEEPEST = 0.3  # least cosine of skin to the plan's normal: others are edges
_FINENESS = 0.01  # of the span, between points of the skin
_NEAR = 0.03  # of the span, within which skin lies over a place of the plan
_FLATTEST = 0.15  # of the span, that skin may be off the plan of its bones
_THERE, _MIDDLE = 0.5, 0.3  # of flight feathers, that have skin there, and of their lengths
_FRONT = 0.3  # of the way from bones to leading edge, from which on small coverts are a coat
_BESIDE = 0.07  # of the span, from the innermost feather to the coat beside it; by eye
_STATIONS = 40  # along its edges
_BEYOND = 0.04  # of its length, that a flight feather reaches beyond the edge; by eye
_WIDEST = 2.5  # of a vane's width; by eye
_AHEAD = 1.5  # of the square way from bone to leading edge, to it along a feather at most
_CLEAR = 0.002  # of the span, from the skin to the lowest row on either side; by eye
_ROOT_SHARE = 0.4  # of the height of a row over the wing, that its roots have; by eye


class LaidRow(NamedTuple):
    """Feathers on a wing: roots (n, 3) m, frames (n, 3, 3), bends (n,) rad along them and turns
    (n,) rad that their vanes wrap by over a length."""

    roots: Array
    frames: Array
    bends: Array
    wraps: Array


class WingParts(NamedTuple):
    """Points (N, 3) m of a skin: before the rows of a wing, beneath these, and of all else."""

    front: Array
    rows: Array
    rest: Array


@dataclass(frozen=True)
class WingSkin:
    """origin: (3,) m, the shoulder. axes: (3, 3), columns outwards, backwards and dorsal. span: m.
    heights: coefficients of the upper and of the lower side. edges: (3, K) m, s of stations, and c
    of the leading and the trailing edge there.
    """

    origin: Array
    axes: Array
    span: float
    heights: tuple[Array, Array]
    edges: Array
    parts: WingParts

    def fit(self, remiges: Remiges, bones: WingBones, usual: Array) -> Remiges:
        """Flight feathers that reach from the bones to the edge behind, and what is ahead.

        Vanes are as wide as roots stand apart. usual: (3,) m, bones at their size.
        """
        ways = frames_at(bones, remiges.angles)[:, :, 0] @ self.axes[:, :2]
        roots = (remiges.roots - self.origin) @ self.axes[:, :2]
        behind = (1.0 + _BEYOND) * self._way_to_edge(roots, ways)
        lead = np.interp(roots[:, 0], self.edges[0], self.edges[1])
        square = np.maximum(roots[:, 1] - lead, 0.0)
        ahead = np.minimum(self._way_to_edge(roots, -ways), _AHEAD * square)
        apart = (bones.lengths / usual)[remiges.bone]
        widening = np.clip(apart * remiges.lengths / behind, 1.0, _WIDEST)
        return replace(remiges, lengths=behind, forward=ahead, widening=widening)

    def _way_to_edge(self, roots: Array, ways: Array) -> Array:
        """(n,) m, from roots (n, 2) along ways (n, 2) to the edge of the wing."""
        steps = np.linspace(0.0, self.span, 400)
        places = roots[:, None] + steps[:, None] * ways[:, None]
        lead, trail = (
            np.interp(places[..., 0], self.edges[0], each, right=np.nan) for each in self.edges[1:]
        )
        outside = ~((places[..., 1] >= lead) & (places[..., 1] <= trail))
        outside[:, 0] = False
        return np.asarray(steps[np.where(outside.any(axis=1), outside.argmax(axis=1), -1)])

    def lay(self, roots: Array, ways: Array, lengths: Array, height: float) -> LaidRow:
        """Lay a row of feathers on the wing, on its lower side where its height (m) is below 0.

        roots: (n, 3) m over whose plan they stand. ways: (n, 3).
        """
        below = int(height < 0.0)
        plan, along = (roots - self.origin) @ self.axes[:, :2], unit(ways @ self.axes[:, :2])
        aside = np.stack([-along[:, 1], along[:, 0]], axis=1)
        half = 0.5 * lengths[:, None]
        middle = plan + half * along

        def over(places: Array, share: float) -> Array:
            return (
                self._height(places, below) + share * height + (1 - 2 * below) * _CLEAR * self.span
            )

        low, mid = over(plan, _ROOT_SHARE), over(middle, 0.5 * (1.0 + _ROOT_SHARE))
        high = over(middle + half * along, 1.0)
        slope = (4.0 * mid - 3.0 * low - high) / lengths
        reach = 0.25 * lengths[:, None] * aside
        right, left = (self._height(middle + way, below) for way in (reach, -reach))
        falls = (2.0 * self._height(middle, below) - right - left) / (0.25 * lengths) ** 2
        forward = np.column_stack([along, slope]) @ self.axes.T
        side = np.column_stack([aside, 2.0 * (right - left) / lengths]) @ self.axes.T
        normals = np.cross(forward, side)
        normals *= np.sign(normals @ self.axes[:, 2])[:, None]
        places = self.origin + np.column_stack([plan, low]) @ self.axes.T
        bends = 4.0 * (2.0 * mid - low - high) / lengths
        return LaidRow(places, frames_from(forward, normals), bends, falls * lengths)

    def _height(self, places: Array, side: int) -> Array:
        known = np.clip(places[:, 0], *self.edges[0, [0, -1]])  # beyond, polynomials run away
        arguments = _scaled(np.column_stack([known, places[:, 1]]), self.span)
        return np.asarray(chebyshev.chebval2d(*arguments, self.heights[side]))


def _scaled(places: Array, span: float) -> tuple[Array, Array]:
    """Arguments of polynomials at places (N, 2) m; beyond the wing those of its border."""
    s, c = places.T
    return np.clip(2.0 * s / span - 1.0, -1.0, 1.0), np.clip(2.0 * c / span, -1.0, 1.0)


def find_wing_skin(bones: WingBones, remiges: Remiges, corners: Array) -> WingSkin | None:
    """The skin of a wing beneath its flight feathers; None where most of these have none.

    corners: (T, 3, 3) m, of the whole skin.
    """
    shoulder, tip = bones.points[0], bones.points[3]
    span = float(np.linalg.norm(tip - shoulder))
    out, (points, normals) = (tip - shoulder) / span, _sampled(corners, span)
    far = points[(points - shoulder) @ out > _FAR * span]
    if len(far) < _STATIONS:
        return None
    # square to the way out, along which wings bend
    across = far - far.mean(axis=0)
    across -= (across @ out)[:, None] * out
    dorsal = np.linalg.svd(across, full_matrices=False)[2][1]
    dorsal *= np.sign(bones.frames[1][:, 2] @ dorsal)
    turned = replace(
        bones, frames=frames_from(np.diff(bones.points, axis=0), np.tile(dorsal, (3, 1)))
    )
    shafts = frames_at(turned, remiges.angles)[:, :, 0]
    back = np.cross(out, dorsal)
    axes = np.stack([out, np.sign(shafts.sum(axis=0) @ back) * back, dorsal], axis=1)
    local = (points - shoulder) @ axes
    own = (local[:, 0] > _inner_end(local, span)) & (np.abs(local[:, 2]) < _FLATTEST * span)
    sides = [own & (sign * normals @ dorsal > _STEEPEST) for sign in (1.0, -1.0)]
    middles = ((remiges.roots + _MIDDLE * remiges.lengths[:, None] * shafts) - shoulder) @ axes
    for side in sides:
        if not side.any():
            return None
        away, _ = search_tree(local[side, :2]).query(middles[:, :2])
        if (away < _NEAR * span).mean() < _THERE:
            return None
    edges = _edges(local[own])
    heights = [_fitted(local[side], span, sign) for side, sign in zip(sides, (1, -1), strict=True)]
    joints = (bones.points - shoulder) @ axes
    lead = np.interp(local[:, 0], edges[0], edges[1])
    bone = np.interp(local[:, 0], joints[:, 0], joints[:, 1])
    innermost = float(((remiges.roots - shoulder) @ out).min())
    ahead = (local[:, 1] < bone + _FRONT * (lead - bone)) | (
        local[:, 0] < innermost - _BESIDE * span
    )
    parts = [points[each] for each in (own & ahead, own & ~ahead, ~own)]
    return WingSkin(shoulder, axes, span, (heights[0], heights[1]), edges, WingParts(*parts))


def _inner_end(local: Array, span: float) -> float:
    """m outwards, from where on sections of points (N, 3) m are as thin as a wing's."""
    stations = np.linspace(0.0, span, _STATIONS)
    near = local[np.abs(local[:, 2]) < _FLATTEST * span]
    number = np.searchsorted(stations, near[:, 0])
    rows = [near[number == k, 2] for k in range(_STATIONS)]
    high = np.array([np.ptp(each) if len(each) else 0.0 for each in rows])
    thick = np.flatnonzero(high > _THICK * np.median(high[_STATIONS // 4 :]))
    return float(stations[min(thick[thick < _STATIONS // 4].max(initial=0) + 1, _STATIONS - 1)])


def _edges(local: Array) -> Array:
    """(3, K) m, as of WingSkin, of points (N, 3) m of a wing."""
    stations = np.linspace(local[:, 0].min(), local[:, 0].max(), _STATIONS)
    number = np.searchsorted(stations, local[:, 0])
    rows = [(k, local[number == k, 1]) for k in range(_STATIONS)]
    return np.array([(stations[k], c.min(), c.max()) for k, c in rows if len(c)]).T


def _sampled(corners: Array, span: float) -> tuple[Array, Array]:
    """Points (N, 3) m of a skin, evenly, and its normals there."""
    size = np.linalg.norm(np.roll(corners, -1, axis=1) - corners, axis=2).max(axis=1)
    number = np.maximum(np.ceil(size / (_FINENESS * span)), 1).astype(np.int64)
    normals = unit(face_products(corners))
    points, owners = [], []
    for n in np.unique(number):
        own = np.flatnonzero(number == n)
        grid = np.array([(i, j, n - i - j) for i in range(n + 1) for j in range(n + 1 - i)]) / n
        points.append(np.einsum("kc,tcx->tkx", grid, corners[own]).reshape(-1, 3))
        owners.append(np.repeat(own, len(grid)))
    found, normal = np.concatenate(points), normals[np.concatenate(owners)]
    keys = np.column_stack([np.floor(found / (_FINENESS * span)), np.round(normal)])
    once = np.unique(keys, axis=0, return_index=True)[1]
    return found[once], normal[once]


def _fitted(local: Array, span: float, sign: float) -> Array:
    """Coefficients of the height of one side, beyond all of its points (N, 3) m."""
    s, c = _scaled(local[:, :2], span)
    basis = chebyshev.chebvander2d(s, c, _DEGREES)
    found = np.linalg.lstsq(basis, local[:, 2], rcond=None)[0]
    found[0] += sign * float((sign * (local[:, 2] - basis @ found)).max())
    return np.asarray(found.reshape(_DEGREES[0] + 1, _DEGREES[1] + 1))
