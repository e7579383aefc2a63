"""A coat in motion: feathers drawn on their leaves over the skin of each frame.

The solver sees feathers on roots that the skin carries rigidly. With y their nodes, seen from these
roots, and y0 those at rest, a feather deviates from its leaf

    within the vane     by the angles of its plane form, which it keeps,
    across it           by z = (y - y0) . n0,  n0 the normal of its rows at rest.

Channels turn roots on those that the skin carries: z is seen from theirs. They raise a feather of
length l by l tan(pitch) and by the way that its root rises, turn its first row, and roll it. What
all feathers deviate across their vanes, and are raised by, are two fields of lift over the coat
(coat/leaf_kernels.py), so that leaves stay in order at any amount:

    h = T (d + s) + a w(s) + r v(s),   a = mean of z / w,   r = mean of what they are raised by,

means over the skin by the weights w(s)^2 and v(s)^2. A raised coat leaves its skin along normals
that are smoothed more, since those of a hollow soon meet. A vane rolls
as far as leaves leave room, x of m as x / sqrt(1 + (x / m)^2). Solved rows at the roots have the
velocities of the integrator, which ring. Rates are differences of what is drawn.
"""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from featherfx.algebra.types import Array, Indices
from featherfx.algebra.vectors import dots, face_products, unit
from featherfx.algebra.views import COUNT as LANES
from featherfx.coat.carrier import Carrier, pose_carrier
from featherfx.coat.coat import Coat, draw, make_plane_forms, share_out
from featherfx.coat.fields import SkinMeans, SkinPlaces
from featherfx.coat.leaf_kernels import HINGE, CarrierArrays
from featherfx.coat.sheets import find_ceiling, limit_rises
from featherfx.feather.leaves import plane_forms
from featherfx.feather.shapes import build_plane_feathers
from featherfx.feather.types import Feather, RowPoints, both, stacked
from featherfx.files.disk_cache import kept
from featherfx.files.process import count_cores
from featherfx.groom.skin.skin import closest
from featherfx.groom.types import Placement
from featherfx.shot.coat import leaf_kernels as kernels
from featherfx.shot.coat.leaf_kernels import CarriedShapes, ImageRoom, LeafFeet, VaneMotion
from featherfx.shot.roots import RootFrames
from featherfx.shot.sources import TimedSurface

# of the median length of the feathers, reach of the means of their lifts
_LIFT_REACH = 0.5
# of the time between two samples, by which the times are apart from which rates are found: first
# ones, whose errors grow with it, and second ones, which differences of rounding would swamp
_INSTANT, _STEP_RATIO = 1e-4, 0.02
_LEAST_ROOM = 1e-9  # rad, to roll in
_LEAST_TURN = 1e-6  # rad, of a first row
_LEAST_COSINE = 0.1  # of the pitch of roots: steeper ones raise a coat no further
# loss of the cosine between pieces of a feather from which folds are bridged, and at which wholly:
# those of 45 and 90 degrees
_FOLDING, _FOLDED = 0.3, 1.0


class CarriedPoints:
    """Points of a coat's skin (V, 3) m, carried by the surfaces of a shot."""

    def __init__(self, points: Array, surfaces: Sequence[TimedSurface]) -> None:
        self._surfaces = surfaces
        rest = [each.surface.rest for each in surfaces]
        first = np.cumsum([0, *map(len, rest[:-1])])
        triangles = np.concatenate(
            [each.surface.triangles + start for each, start in zip(surfaces, first, strict=True)]
        )
        corners = np.concatenate(rest)[triangles]
        how = points, corners
        found = kept("under", how, lambda: dict(zip(("at", "place"), closest(*how), strict=True)))
        triangle, self._weights = found["at"], found["place"]
        self._corners = triangles[triangle]
        own = corners[triangle]
        away = points - np.einsum("vk,vkc->vc", self._weights, own)
        self._away = np.einsum("vij,vj->vi", _find_axes(own), away)

    def at(self, time: float) -> Array:
        """The points at a time, s."""
        skin = np.concatenate([each.points(time) for each in self._surfaces])
        found = np.empty_like(self._away)
        kernels.carry_points(skin, self._corners, self._weights, self._away, found)
        return found


def _find_axes(corners: Array) -> Array:
    """Return (N, 3, 3), rows a side of triangles (N, 3, 3), square to it in them, and normals."""
    side, normal = unit(corners[:, 1] - corners[:, 0]), unit(face_products(corners))
    return np.stack([side, np.cross(normal, side), normal], axis=1)


@dataclass(frozen=True)
class PosedFeathers:
    """Feathers at one time: points (B) in the world of those that bend, roots (K) on the skin, and
    those (K) that channels have led, which are the same without any."""

    points: RowPoints
    roots: RootFrames
    led: RootFrames


class MovingCoat:
    """Some feathers of a coat on a skin that moves.

    placements, drawn: of the K feathers. bent: (B,) those of K whose deviations the coat takes; the
    others only lie on it. above: (N, 3) m, points that may lie over them at rest; None where
    nothing raises them.
    """

    def __init__(
        self,
        coat: Coat,
        skin: CarriedPoints,
        placements: Sequence[Placement],
        drawn: Sequence[Feather],
        bent: Indices,
        above: Array | None = None,
    ) -> None:
        self._coat, self._skin, self._bent = coat, skin, bent
        self._pool = ThreadPoolExecutor(count_cores())
        self._numbers = numbers = np.array([each.leaf.number for each in placements])
        plane = build_plane_feathers(placements, drawn[0].rows, drawn[0].columns)
        self._forms = plane_forms(placements, plane)
        rest = stacked([feather.rest for feather in drawn])
        self._length = coat.follicles.length[numbers]
        self._lain = make_plane_forms(rest.nodes, rest.directors, self._forms.bare)
        self._order = np.full(len(numbers), -1)
        self._order[bent] = np.arange(len(bent))
        self._still = rest.at(np.arange(0))
        self._shafts, self._ups = rest.nodes[bent, :, 0], rest.directors[bent, :, 1]
        self._rest, self.shares = rest, np.zeros(len(numbers))
        self._straight = straight = self._lay(self.shares)
        self._turned = np.zeros(0), straight
        grid, count = rest.nodes.shape[:3], rest.nodes[0, ..., 0].size
        places = np.sqrt(straight.places[:, 4, :count]).reshape(grid)
        feet = straight.feet[:, :count].reshape(grid)
        self._feet, self._place = feet[:, :, 0], places[:, :, 0]
        self._tips = self._means(self._place**4, bent)
        left = coat.rooms[numbers] - np.abs(coat.deviations[numbers, 1])
        self._rooms = np.maximum(left, _LEAST_ROOM)
        self._ceiling = np.full(len(coat.mesh.points), np.inf)
        if above is not None:
            reach = np.ones_like(self._ceiling)
            np.maximum.at(reach, coat.mesh.faces[feet], places[..., None])
            ways = self._find_ways(coat.rest)
            self._ceiling = find_ceiling(coat, above, reach, ways)

    def _lay(self, turns: Array) -> LeafFeet:
        """The feathers on their leaves at rest, turned within their vanes by (K,) rad."""
        coat, numbers, forms = self._coat, self._numbers, self._forms
        lain = draw(coat.turned(numbers, turns), coat.rest, forms, numbers)
        # a copy: of another layout all kernels would be compiled once more
        own = np.broadcast_to(np.eye(3)[1:], lain.directors.shape).copy()
        feet, weights, nodes = map(_in_lanes, (lain.feet, lain.weights, lain.nodes))
        leaves = LeafFeet(
            values=coat.values[numbers],
            feet=feet,
            places=np.tile(weights.swapaxes(1, 2), (1, 3, 1)),
            directors=own,
            steps=forms.steps,
            pieces=forms.pieces,
        )
        arrays = coat.arrays(coat.rest)
        kernels.find_offsets(arrays, leaves, nodes, 0, len(numbers))
        still = VaneMotion(*self._still, np.full(len(numbers), -1), 0.0 * turns, self._lain)
        roots = np.zeros((len(numbers), 3)), np.tile(np.eye(3), (len(numbers), 1, 1))
        carried = CarriedShapes(lain.nodes, lain.directors, self.shares, *roots)
        drawn = self._draw(arrays, leaves, carried, still)
        side, normal = drawn.directors.swapaxes(0, 2).swapaxes(1, 2)
        axes = np.stack([np.cross(side, normal), side, normal], axis=-2)
        return leaves._replace(directors=lain.directors @ axes.swapaxes(-1, -2))

    def find_bridges(self, times: Sequence[float]) -> Array:
        """Find how far feathers have to bridge what folds at any of some times (s).

        Returns (K,) shares of the way to where the roots alone carry them, to be `shares`.
        """
        mesh, folds = self._coat.mesh, np.zeros((len(self._numbers), 2))
        self._find_folds(self._coat.rest, folds)
        upright = folds[:, 1].copy()  # a shaft that rises from the skin leans at rest
        for time in times:
            self._find_folds(pose_carrier(mesh, self._skin.at(time)), folds)
        fold = np.maximum(folds[:, 0], folds[:, 1] - upright)
        share = np.clip((fold - _FOLDING) / (_FOLDED - _FOLDING), 0.0, 1.0)
        return np.asarray(share * share * (3.0 - 2.0 * share))

    def _find_folds(self, carrier: Carrier, folds: Array) -> None:
        """Raise (K, 2) folds to those over a carrier."""
        arrays, leaves, rest = self._coat.arrays(carrier), self._straight, self._rest.nodes

        def find_some(low: int, high: int) -> None:
            kernels.find_folds(arrays, leaves, rest, self._make_room(), folds, low, high)

        share_out(find_some, len(folds), self._pool)

    @cached_property
    def _raised(self) -> SkinMeans:
        shares = (1.0 + HINGE) * self._place**2 / (self._place + HINGE)
        return self._means(shares**2, slice(None))

    def _means(self, weights: Array, chosen: Indices | slice) -> SkinMeans:
        """Means over the skin of what rachises of chosen feathers have at their nodes. weights:
        (K, n)."""
        coat, triangle = self._coat, self._feet[chosen].ravel()
        reach = _LIFT_REACH * float(np.median(coat.follicles.length))
        middle = SkinPlaces(triangle, np.full((len(triangle), 3), 1.0 / 3.0))
        own = weights[chosen].ravel()
        return SkinMeans(coat.rest.elements, coat.mesh.faces, reach, middle, own)

    def follow(
        self,
        given: Sequence[RowPoints],
        roots: Sequence[RootFrames],
        span: tuple[float, float],
        led: Sequence[RootFrames] | None = None,
        rates: int = 2,
    ) -> list[RowPoints]:
        """Feathers on their leaves at the end of a span of time (s), and as many rates as asked.

        given: points of the bent on their roots, and their two rates; roots: of all as the skin
        carries them rigidly, and their two rates; led: the same as channels have led them, None
        without any. rates: how many are found.
        """
        instant, step = _INSTANT * (span[1] - span[0]), _STEP_RATIO * (span[1] - span[0])
        times = [0.0, -instant, -step, -2.0 * step][: (1, 2, 4)[rates]]
        posed, drawn = [], []
        for time in times:
            points = RowPoints(*(_extrapolated(each, time) for each in zip(*given, strict=True)))
            own = moved = _extrapolated_roots(roots, time)
            if led is not None:
                moved = _extrapolated_roots(led, time)
            posed.append(PosedFeathers(points, own, moved))
        for time, each in zip(times, posed, strict=True):
            carrier = pose_carrier(self._coat.mesh, self._skin.at(span[1] + time))
            lift = self._lift(each)
            arrays = self._coat.arrays(self._part(carrier, lift[:, 1]), lift)
            turns, motion = self._motion(each)
            carried = CarriedShapes(*self._rest, self.shares, *each.roots)
            drawn.append(self._draw(arrays, self._on_leaves(turns), carried, motion))
        now, *before = drawn
        if rates > 0:  # in place, as these arrays are the largest of a bake
            both(lambda x, y: np.divide(np.subtract(x, y, y), instant, y), now, before[0])
        if rates > 1:
            before[1:] = [both(lambda x, y, z: (x - 2.0 * y + z) / (step * step), now, *before[1:])]
        return drawn[:1] + before

    def _find_ways(self, carrier: Carrier) -> Array:
        """Return (V, 3) unit, along which a raised coat leaves its carrier."""
        return np.asarray(unit(self._tips.smooth(carrier.normals[:, :3])))

    def _part(self, carrier: Carrier, raised: Array) -> Carrier:
        """The carrier, with the ways along which its coat is raised, (V,) m, for normals."""
        up = np.maximum(raised, 0.0)
        if not up.any():
            return carrier
        smooth, own = np.hsplit(carrier.normals, 2)
        share = (up / (up + self._coat.fields.thickness))[:, None]
        ways = unit((1.0 - share) * smooth + share * self._find_ways(carrier))
        return replace(carrier, normals=np.hstack([ways, own]))

    def _lift(self, posed: PosedFeathers) -> Array:
        """(V, 2) m, a and r of the coat."""
        position, rotation = posed.led
        own = self._bent
        local = (posed.points.nodes[:, :, 0] - position[own, None]) @ rotation[own]
        across = np.einsum("fnk,fnk->fn", local - self._shafts, self._ups)
        place = self._place[own]
        bent = self._tips((across / np.where(place > 0.0, place, 1.0) ** 2).ravel())
        if posed.led is posed.roots:
            return np.stack([bent, np.zeros_like(bent)], axis=1)
        up = posed.roots.rotations[:, :, 2]
        sine = dots(rotation[:, :, 0], up)
        rise = dots(position - posed.roots.positions, up)
        rise += self._length * sine / np.sqrt(np.maximum(1.0 - sine * sine, _LEAST_COSINE**2))
        raised = self._raised(np.repeat(rise, self._feet.shape[1]))
        return np.stack([bent, limit_rises(raised, self._ceiling)], axis=1)

    def _motion(self, posed: PosedFeathers) -> tuple[Array, VaneMotion]:
        """Return (K,) rad, turns of the first rows, what turns after them, and rolls."""
        led, own = posed.led.rotations, posed.roots.rotations
        x, y = (dots(led[:, :, 0], own[:, :, k]) for k in range(2))
        first = np.arctan2(y, x)
        side = np.cross(own[:, :, 2], led[:, :, 0])
        roll = np.arctan2(-dots(side, led[:, :, 2]), dots(side, led[:, :, 1]))
        return first, VaneMotion(*posed.points, self._order, self.limit_rolls(roll), self._lain)

    def _on_leaves(self, turns: Array) -> LeafFeet:
        """The feathers with first rows turned by (K,) rad."""
        turns = np.where(np.abs(turns) > _LEAST_TURN, turns, 0.0)
        if not turns.any():
            return self._straight
        if not np.array_equal(turns, self._turned[0]):
            self._turned = turns, self._lay(turns)
        return self._turned[1]

    def limit_rolls(self, rolls: Array) -> Array:
        """Return (K,) rad, rolls as far as leaves leave room. rolls: (K,) rad."""
        return np.asarray(rolls / np.hypot(1.0, rolls / self._rooms))

    def limit_tips(self, rises: Array) -> Array:
        """Return (K,) m, rises of tips as far as what lies over the coat leaves room. rises: (K,)
        m."""
        faces = self._coat.mesh.faces[self._feet[:, -1]]
        return limit_rises(rises, self._ceiling[faces].mean(axis=1))

    def _draw(
        self, arrays: CarrierArrays, leaves: LeafFeet, carried: CarriedShapes, motion: VaneMotion
    ) -> RowPoints:
        """The feathers over a carrier."""
        made = RowPoints(np.empty(self._rest.nodes.shape), np.empty(leaves.directors.shape))

        def draw_some(low: int, high: int) -> None:
            room = self._make_room()
            kernels.draw_over(arrays, leaves, carried, motion, made, room, low, high)

        share_out(draw_some, len(made.nodes), self._pool)
        return made

    def _make_room(self) -> ImageRoom:
        """Scratch memory of a thread."""
        rows, columns = self._rest.nodes.shape[1:3]
        flat = np.empty((_fill_lanes(rows * columns), 4))
        return ImageRoom(
            image=flat[: rows * columns].reshape(rows, columns, 4),
            flat=flat,
            up=np.empty((rows, 3)),
            rachis=np.empty((rows, 3)),
            row=np.zeros(rows, dtype=np.int64),
            part=np.empty(rows),
            turns=np.empty((rows, 2)),
        )


def _in_lanes(values: Any) -> Any:
    """(K, P, ...) values (K, n, 1 + 2 m, ...) of nodes, the last repeated to fill lanes."""
    flat = values.reshape(len(values), -1, *values.shape[3:])
    places = np.minimum(np.arange(_fill_lanes(flat.shape[1])), flat.shape[1] - 1)
    return np.ascontiguousarray(flat[:, places])


def _fill_lanes(count: int) -> int:
    return -(-count // LANES) * LANES


def _extrapolated_roots(rates: Sequence[RootFrames], time: float) -> RootFrames:
    return RootFrames(*(_extrapolated(part, time) for part in zip(*rates, strict=True)))


def _extrapolated(rates: Sequence[Array], time: float) -> Array:
    """Values at a time (s) from now on, from those now and their two rates."""
    now, rate, second = rates
    if time == 0.0:
        return now
    return np.asarray(now + time * rate + 0.5 * time * time * second)
