"""Fit of a folded wing to a body: close to it all over, with its upper edge on the back.

The wing stays what it is in its plane. Where the plane stands, how it leans and how far it bends is
found by least squares over points of its flight feathers (Nelder and Mead 1965).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from itertools import count
from typing import Any, NamedTuple

import numpy as np

from featherfx.algebra.types import Array
from featherfx.files.disk_cache import kept
from featherfx.groom.anatomy.pose import folded
from featherfx.groom.anatomy.remiges import Flight, curvature_of, lying
from featherfx.groom.keys.anatomy import WingType
from featherfx.groom.skin.field import search_tree
from featherfx.phases import phase

_ALONG = np.linspace(0.0, 1.0, 6)  # of shafts, where they are held against the body
_WEIGHTS = np.array([3.0, 1.5, 1.0, 1.0, 1.0, 2.0, 2.0])  # of leading edge and these
_NEAR = 0.06  # of it, up to which a wing leaves no room for feathers below
_EDGE = 0.16  # of a feather's length, from its shaft to the edge of its inner vane
# deg, allowed: roof, tuck, bow, beyond which vanes part, shoulder and camber beyond the type's
_BOUNDS = ((25.0, 95.0), (-15.0, 30.0), (0.0, 25.0), (-18.0, 22.0), (0.0, 12.0))
_STEPS, _STARTS = 250, 3
_APART = 0.9  # tenths of the longest feather, from the middle of the back to either wing
_ASIDE, _ABOVE = 0.7, 0.5  # tenths, from the plane of symmetry, and over the tail behind its root
_OUTWARDS = 65  # places that are asked on a way out of a body
_MOVED = 0.3  # weight of ways from the landmark, against gaps


@dataclass(frozen=True)
class Body:
    """Body that a wing lies on. corners: (T, 3, 3) m, triangles that look outwards. axes: (3, 3)
    forward, left and up. middle: (3,) m, a point of the plane of symmetry."""

    corners: Array
    axes: Array
    middle: Array

    @cached_property
    def _centres(self) -> Array:
        return self.corners.mean(axis=1)

    @cached_property
    def _tree(self) -> Any:
        return search_tree(self._centres)

    @cached_property
    def _products(self) -> Array:
        return np.cross(
            self.corners[:, 1] - self.corners[:, 0], self.corners[:, 2] - self.corners[:, 0]
        )

    def gaps(self, points: Array) -> Array:
        """(N,) m, of points (N, 3) over the body, negative within."""
        distance, near = self._tree.query(points)
        size = np.linalg.norm(self._products[near], axis=1)
        above = np.einsum("nc,nc->n", points - self._centres[near], self._products[near]) / size
        beside = np.sqrt(np.maximum(distance**2 - above**2, 0.0))
        # past an edge of the body, where a plane says nothing
        return np.where(beside > 2.0 * np.sqrt(size), distance, above)

    def way_out(self, start: Array, way: Array, most: float) -> float:
        """m, from a point (3,) along a unit way (3,) to where the body ends, up to most m."""
        ways = np.linspace(0.0, most, _OUTWARDS)
        inside = self.gaps(start + ways[:, None] * way) < 0.0
        return float(ways[min(int(inside.nonzero()[0].max(initial=-1)) + 1, len(ways) - 1)])


def lie_on(
    kind: WingType, shoulder: Array, scale: float, body: Body, below: float
) -> tuple[WingType, Array]:
    """The type as its right folded wing lies on a body, and where its shoulder (3,) m is then.

    below: m, that coverts below its flight feathers take up.
    """
    fit = _Fit(kind, shoulder, scale, body, below)
    inputs = [replace(kind, bands=()), shoulder, scale, body.corners, body.axes, body.middle, below]
    found = kept("lie", inputs, lambda: {"values": _best(fit)})
    return fit.placed(found["values"])[:2]


def _best(fit: _Fit) -> Array:
    """(7,) values of `placed` that cost least."""
    from scipy.optimize import minimize

    kind = fit.kind
    found = np.array([60.0, kind.tuck[1], 20.0, kind.shoulder[1], 10.0, 0.0, 0.0])
    tried = count(1)
    with phase("fitting", _STARTS * _STEPS) as done:

        def cost(values: Array) -> float:
            value = fit.cost(values)
            done(next(tried))
            return value

        for _ in range(_STARTS):  # a simplex that has gone flat is put up again
            steps = np.vstack([found, found + np.diag([-15.0, 6.0, -8.0, -5.0, 8.0, 1.0, 0.7])])
            options = {"initial_simplex": steps, "maxfev": _STEPS, "xatol": 0.1, "fatol": 1e-4}
            found = minimize(cost, found, method="Nelder-Mead", options=options).x
    return np.asarray(found)


def _shafts(kind: WingType, scale: float, flight: Flight) -> Array:
    """(N, K, 3) m, of each feather a point of the leading edge, then some along its shaft, all on
    one arc."""
    ways = np.column_stack([-flight.forward, np.outer(flight.lengths, _ALONG)])
    turned = curvature_of(kind, scale) * ways
    forward = ways * np.sinc(turned / np.pi)
    down = 0.5 * ways * turned * np.sinc(0.5 * turned / np.pi) ** 2
    points = forward[:, :, None] * flight.frames[:, None, :, 0]
    return flight.roots[:, None] + points - down[:, :, None] * flight.frames[:, None, :, 2]


class Beneath(NamedTuple):
    """Places of a folded wing, (K, 3) m each. well: within its outline, near the body. front: of
    its leading edge. low: of its lower edge, near the body."""

    well: Array
    front: Array
    low: Array


def beneath(kind: WingType, shoulder: Array, scale: float, body: Body, left: bool) -> Beneath:
    """Find the part of a body that a folded wing hides, by places of it."""
    lengths = scale * np.array([kind.humerus, kind.forearm, kind.hand])
    bones = folded(kind, shoulder, lengths, body.axes, left, 1.0)
    points = _shafts(kind, scale, lying(kind, bones, scale))
    arm = len(points) - kind.primaries.count
    near = _NEAR * scale * max(kind.primaries.lengths)

    def close(places: Array, gap: float) -> Array:
        flat = places.reshape(-1, 3)
        return np.asarray(flat[body.gaps(flat) < gap])

    some = slice(len(points) // 8, len(points) // 2, 3)
    low = points[[arm - 1, len(points) - 1], 1:6]
    return Beneath(close(points[some, 2:5], near), points[:arm, 0], close(low, 2.0 * near))


@dataclass(frozen=True)
class _Fit:
    kind: WingType
    shoulder: Array
    scale: float
    body: Body
    below: float

    @property
    def longest(self) -> float:
        return self.scale * max(self.kind.primaries.lengths)

    def placed(self, values: Array) -> tuple[WingType, Array, Array, Array]:
        """Type, shoulder, points (N, 3) m of the wing's shafts and of its upper edge (K, 3) m.

        values: (7,) roof, tuck, bow, shoulder and added camber, deg, and the ways down and back
        from the landmark, in tenths of the longest feather.
        """
        put = np.array([0.0, 0.0, 0.0, self.kind.shoulder[1], 0.0])
        least, most = np.array(_BOUNDS).T + put
        roof, tuck, bow, back, camber = np.clip(values[:5], least, most).tolist()
        kind = replace(
            self.kind,
            roof=(self.kind.roof[0], roof),
            tuck=(self.kind.tuck[0], tuck),
            shoulder=(self.kind.shoulder[0], back),
            bow=bow,
            camber=self.kind.camber + camber,
        )
        lengths = self.scale * np.array([kind.humerus, kind.forearm, kind.hand])
        bones = folded(kind, self.shoulder, lengths, self.body.axes, False, 1.0)
        flight = lying(kind, bones, self.scale)
        roots, frames, sizes = flight.roots, flight.frames, flight.lengths
        dorsal = bones.frames[1][:, 2]
        across = np.cross(dorsal, frames[0, :, 0])
        across = across if (roots[-1] - roots[0]) @ across > 0.0 else -across
        aft = frames[0, :, 0] - frames[0, :, 0] @ dorsal * dorsal
        shift = 0.1 * self.longest * (values[5] * across + values[6] * aft)
        points = _shafts(kind, self.scale, flight)
        for _ in range(8):
            gap = self.body.gaps((points + shift).reshape(-1, 3)).min()
            shift = shift + (self.below + kind.body_clearance * self.longest - gap) * dorsal
        outwards = frames[:, :, 1] * np.sign(frames[:, :, 1] @ across)[:, None]
        points = points + shift
        inner = points - _EDGE * (sizes[:, None] * outwards)[:, None]
        upper = inner[: max(kind.tertials.count, 1), 2:6]  # of the feathers on the back
        return kind, self.shoulder + shift, points.reshape(-1, 3), upper.reshape(-1, 3)

    def cost(self, values: Array) -> float:
        kind, shoulder, points, upper = self.placed(values)
        size = 0.1 * self.longest
        gaps = self.body.gaps(points) / size
        # the back shows between both wings, of which this is the right one
        aside = ((upper - self.body.middle) @ self.body.axes[:, 1]).mean() / size + _APART
        put = [kind.roof[1], kind.tuck[1], kind.bow, kind.shoulder[1]]
        outside = values[:5] - [*put, kind.camber - self.kind.camber]
        ahead, inwards, up = ((points - self.body.middle) @ self.body.axes / size).T
        astray = np.maximum(inwards + _ASIDE, 0.0)
        sunk = np.clip(-ahead, 0.0, 1.0) * np.maximum(_ABOVE - up, 0.0)
        moved = np.linalg.norm(shoulder - self.shoulder) / size
        return float(
            np.average(gaps**2, weights=np.tile(_WEIGHTS, len(gaps) // len(_WEIGHTS)))
            + aside**2
            + np.sum(astray**2 + sunk**2)
            + _MOVED * moved**2
            + 0.01 * outside @ outside
        )
