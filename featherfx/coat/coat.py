"""The coat of a plumage: fields and follicles that stay, and feathers drawn on any pose of it.

Plane forms: the part of a feather's shape that it keeps whatever it lies on.

Angles within the vane and lengths, of chords between nodes: the rachis turns by its geodesic
curvature, barbs leave it at their angles. Camber and twist are those of the leaf.

Stacking values of feathers that start side by side: overlapping leaves a gap apart.

Two leaves are a gap apart over a place if their values differ by gap q / T there. What a feather
deviates from its leaf takes a part of the room to those that it overlaps. A lift c at the tip
grows with s^2, so under a feather that is earlier by D = (p - p') / q

    c s^2 <= c' (s + D)^2 + part T D

which is hardest at tips. Feathers overlap if nodes of both lie in one cell of a grid of cubes. In
the order of phi each takes the value nearest to its own that is far enough from those around it
(leaf_kernels).
"""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from featherfx.algebra.types import Array, Flags, Indices
from featherfx.algebra.vectors import dots, unit
from featherfx.coat.carrier import Carrier, CoatMesh, pose_carrier
from featherfx.coat.fields import (
    MIN_PACE,
    CoatSpacing,
    Fields,
    Follicles,
    average_follicles,
    find_headings,
    find_tilts,
    make_coat_mesh,
    make_fields,
)
from featherfx.coat.leaf_kernels import (
    DOWN_SHARE,
    CarrierArrays,
    LeafArrays,
    RootArrays,
    count_pairs,
    draw_feathers,
    find_bases,
    fit_values,
)
from featherfx.errors import count_feathers
from featherfx.files.process import count_cores

# side of the cubes over the length of the feathers there
_CELL = 0.1
# of a feather's gain that its value may be earlier and later: later lays the base into the skin
_MAX_EARLIER, _MAX_LATER = 0.35, 0.16
_ROUNDS = 3  # in which feathers move to where there is most room
# of the room between two leaves, that lifts of tips take, and the roll of either
_LIFT_PART, _ROLL_PART = 0.15, 0.15
_BITS = 19  # of a cube's number along an axis


class OverlapLists(NamedTuple):
    """Feathers that overlap, as kernels take them.

    starts: (F + 1,) first entry of each feather. feather: (N,) which. gap: (N,) m, by which their
    values are to differ.
    """

    starts: Indices
    feather: Indices
    gap: Array


class Overlaps(NamedTuple):
    """Pairs of feathers that overlap. pairs: (K, 2), the lower number first. gaps: (K,) m, by which
    their values are to differ."""

    pairs: Indices
    gaps: Array


def find_overlaps(drawn: LeafArrays, covered: Flags, fields: Fields, faces: Indices) -> Overlaps:
    """Find the pairs of drawn feathers that overlap. covered: (F, n) rows that lie in the skin."""
    length, gain, thickness = (
        each[faces].mean(axis=1) for each in (fields.length, fields.gain, fields.thickness)
    )
    count, across = len(drawn.nodes), drawn.nodes.shape[2]
    shown = np.repeat(~covered.ravel(), across)
    feather = np.repeat(np.arange(count), covered.shape[1] * across)[shown]
    feet = drawn.feet.ravel()[shown]
    gap = (fields.gap * gain / thickness)[feet]
    cells = _cells(drawn.nodes.reshape(-1, 3)[shown], length[feet])
    # by cell, and as they were by feather: of each the greatest gap in a cell
    order = np.argsort(cells, kind="stable")
    feather, cells = feather[order], cells[order]
    first = np.flatnonzero(np.diff(cells, prepend=-1) | np.diff(feather, prepend=-1))
    gap = np.maximum.reduceat(gap[order], first) if len(first) else gap
    feather, cells = feather[first], cells[first]
    starts = np.append(np.flatnonzero(np.diff(cells, prepend=-1)), len(cells))
    sizes = np.diff(starts)
    found = np.zeros((int((sizes * (sizes - 1) // 2).sum()), 3))
    count_pairs(starts, feather, gap, found)
    key = found[:, 0].astype(np.int64) * count + found[:, 1].astype(np.int64)
    order = np.argsort(key, kind="stable")
    first = np.flatnonzero(np.diff(key[order], prepend=-1))
    gaps = np.maximum.reduceat(found[order, 2], first) if len(first) else found[:, 2]
    return Overlaps(np.stack(np.divmod(key[order][first], count), axis=1), gaps)


def _cells(nodes: Array, length: Array) -> Indices:
    """Number the cubes (N,) of nodes (N, 3); their side follows the length in octaves."""
    octave = np.round(np.log2(length)).astype(np.int64)
    steps = np.floor(nodes / (_CELL * 2.0**octave)[:, None]).astype(np.int64)
    found = octave & 31
    for axis in range(3):
        found = (found << _BITS) + (steps[:, axis] & ((1 << _BITS) - 1))
    return found


class Fit(NamedTuple):
    """Stacking values. values: (F,) m. shares: (F,) of its gaps that each feather has got."""

    values: Array
    shares: Array


def fit_ties(values: Array, gain: Array, overlaps: Overlaps) -> Fit:
    """Keep overlapping leaves apart. values: (F,) m, phi at the follicles. gain: (F,) m."""
    pairs, gaps = overlaps
    ends, other = np.append(pairs[:, 0], pairs[:, 1]), np.append(pairs[:, 1], pairs[:, 0])
    order = np.argsort(ends, kind="stable")
    starts = np.searchsorted(ends[order], np.arange(len(values) + 1))
    neighbours = OverlapLists(starts, other[order], np.tile(gaps, 2)[order])
    limits = np.stack([_MAX_EARLIER * gain, _MAX_LATER * gain], axis=1)
    order, found = np.argsort(values, kind="stable"), np.full_like(values, np.inf)
    near = np.empty((int(np.diff(starts).max(initial=0)), 2))
    for _ in range(_ROUNDS):
        fit_values(order, neighbours, values, limits, found, near)
    apart, shares = np.abs(np.diff(found[pairs], axis=1))[:, 0], np.ones(len(values))
    np.minimum.at(shares, pairs, (apart / gaps)[:, None])
    return Fit(found, shares)


class StackedLeaves(NamedTuple):
    """F leaves. values, gain, thickness: (F,) m, p, q and T."""

    values: Array
    gain: Array
    thickness: Array


def _find_rooms(leaves: StackedLeaves, overlaps: Overlaps) -> tuple[Array, Array]:
    """Return D and the room (m) between the leaves (K,) of each pair."""
    _, gain, thickness = (each[overlaps.pairs].mean(axis=1) for each in leaves)
    apart = np.abs(np.diff(leaves.values[overlaps.pairs], axis=1))[:, 0] / gain
    return apart, thickness * apart


def limit_lifts(wanted: Array, leaves: StackedLeaves, overlaps: Overlaps) -> Array:
    """Return (F,) m, lifts of tips that keep leaves in order. wanted: (F,) m."""
    apart, room = _find_rooms(leaves, overlaps)
    swap = np.argsort(leaves.values[overlaps.pairs], axis=1)
    upper, lower = np.take_along_axis(overlaps.pairs, swap, axis=1).T
    order = np.argsort(leaves.values[lower], kind="stable")
    columns = upper, lower, (1.0 + apart) ** 2, _LIFT_PART * room
    found = np.maximum(wanted, 0.0).tolist()
    # from the uppermost down
    for above, below, ratio, most in zip(*(each[order].tolist() for each in columns), strict=True):
        found[below] = min(found[below], ratio * found[above] + most)
    return np.array(found)


def find_roll_rooms(width: Array, leaves: StackedLeaves, overlaps: Overlaps) -> Array:
    """Return (F,) rad, rolls by which edges stay between the leaves around. width: (F,) m."""
    _, room = _find_rooms(leaves, overlaps)
    least = np.full(len(width), np.inf)
    np.minimum.at(least, overlaps.pairs.ravel(), np.repeat(room, 2))
    return np.asarray(_ROLL_PART * least / (0.5 * width))


# agreement of headings below which the flow counts as singular
_MIN_STRENGTH = 0.3
# of the thickness of a coat, that it may be pressed down by
_PRESSED_SHARE = 0.15
_FEATHERS_AT_ONCE = 256  # that a thread draws
_USUAL_SPACING = CoatSpacing()


@dataclass(frozen=True)
class Coat:
    """A coat of F feathers on a skin: constant while the skin moves.

    mesh: the skin. rest: its carrier at rest. fields: at its vertices. triangle: (F,) and place:
    (F, 3) barycentric, of the follicles; heading: (F, 2) of the rachises, by the sides of their
    triangles from its first corner. values: (F,) m, p. depths: (F,) m, of the follicles
    under their leaves. deviations: (F, 2) m and rad, by which each tip is lifted
    besides, and roll; as far as there is room once it is stacked. rooms: (F,) rad, by which each
    may roll.
    """

    mesh: CoatMesh
    rest: Carrier
    fields: Fields
    follicles: Follicles
    heading: Array
    values: Array
    depths: Array
    deviations: Array
    rooms: Array

    def roots(self, carrier: Carrier) -> RootArrays:
        """The follicles on the carrier in a pose."""
        sides = _sides(carrier, self.mesh, self.follicles.triangle)
        ways = unit(np.einsum("fij,fj->fi", sides, self.heading))
        own, (lift, roll) = self.follicles, self.deviations.T
        value = np.stack([self.values, lift], axis=1)
        return RootArrays(own.triangle, own.place, ways, value, self.depths, roll)

    def turned(self, numbers: Indices, turns: Array) -> Coat:
        """The coat with some feathers turned within their vanes at the roots. turns: (K,) rad."""
        headings, normals = self.follicles.heading.copy(), self.rest.normals[:, :3]
        own = headings[numbers]
        side = np.cross(unit(self.follicles.corners(self.mesh, normals)[numbers]), own)
        headings[numbers] = np.cos(turns)[:, None] * own + np.sin(turns)[:, None] * side
        return replace(self, heading=_by_sides(self.rest, self.mesh, self.follicles, headings))

    def arrays(self, carrier: Carrier, lift: Array | None = None) -> CarrierArrays:
        """The carrier in a pose as kernels take it. lift: (V, 2) m, a and r besides the coat's
        own. What presses the coat down makes it thinner above the roots, which keeps its order."""
        own, mesh = self.fields, self.mesh
        bent, raised = np.zeros((2, len(own.phi))) if lift is None else lift.T
        down = np.minimum(bent, 0.0) + np.minimum(raised, 0.0)
        room = _PRESSED_SHARE * own.thickness
        pressed = room * np.expm1(down / room)
        up = own.lift + np.maximum(bent, 0.0), np.maximum(raised, 0.0)
        points = carrier.points - DOWN_SHARE * pressed[:, None] * carrier.normals[:, :3]
        heights = own.thickness + pressed, *up
        columns = *heights, own.phi, own.gain, *np.zeros((2, len(points)))
        return CarrierArrays(
            vertices=np.column_stack([points, carrier.normals, *columns]),
            faces=mesh.faces,
            neighbours=mesh.neighbours,
            gradients=carrier.elements.gradients,
            planes=carrier.elements.normals,
        )


def _sides(carrier: Carrier, mesh: CoatMesh, triangle: Indices) -> Array:
    """Return (F, 3, 2), columns two sides of triangles (F,)."""
    corners = carrier.points[mesh.faces[triangle]]
    return np.asarray((corners[:, 1:] - corners[:, :1]).transpose(0, 2, 1))


def _by_sides(carrier: Carrier, mesh: CoatMesh, follicles: Follicles, ways: Array) -> Array:
    """Return (F, 2), vectors (F, 3) at the follicles by the sides of their triangles."""
    sides = np.linalg.pinv(_sides(carrier, mesh, follicles.triangle))
    return np.asarray(np.einsum("fij,fj->fi", sides, ways))


def grow_coat(
    points: Array, faces: Indices, follicles: Follicles, spacing: CoatSpacing = _USUAL_SPACING
) -> Coat:
    """Solve for the coat of feathers on a skin at rest, with the values of their follicles.

    points: (V, 3) m, each place once. faces: (T, 3).
    """
    mesh = make_coat_mesh(points, faces, follicles)
    rest = pose_carrier(mesh, points)
    normals = unit(follicles.corners(mesh, rest.normals[:, :3]))
    mean, tilts = average_follicles(rest.elements, faces, follicles), find_tilts(follicles, normals)
    follicles = follicles._replace(heading=find_headings(mesh, follicles, normals, mean))
    fields = make_fields(rest, faces, follicles, mean, tilts[:, 0], spacing)
    tilts[:, 0] -= follicles.corners(mesh, fields.rise)
    own = _by_sides(rest, mesh, follicles, follicles.heading)
    values = follicles.corners(mesh, fields.phi)
    depths, rooms = np.zeros(len(values)), np.full(len(values), np.inf)
    coat = Coat(mesh, rest, fields, follicles, own, values, depths, tilts, rooms)
    return replace(coat, depths=_find_depths(coat))


def _find_depths(coat: Coat) -> Array:
    """Return (F,) m, from the leaves of follicles at rest down to where they lie in the skin."""
    points, normals = np.empty((2, len(coat.values), 3))
    find_bases(coat.arrays(coat.rest), coat.roots(coat.rest), points, normals)
    above = dots(points - coat.follicles.position, normals)
    return np.maximum(above + coat.follicles.depth, 0.0)


@dataclass(frozen=True)
class StackReport:
    """Result of the ties of a coat.

    pairs: number of feathers that overlap, in pairs. shares: (F,) of its gap that a feather has
    got. cut: (F, 2) m and rad, lift of its tip and roll that it has no room for.
    """

    pairs: int
    shares: Array
    cut: Array


def stack(coat: Coat, footprints: PlaneForms) -> tuple[Coat, StackReport]:
    """Keep leaves that overlap a gap apart. footprints: of all feathers, on a coarse grid."""
    drawn = draw(replace(coat, deviations=0.0 * coat.deviations), coat.rest, footprints)
    overlaps = find_overlaps(drawn, footprints.sunk > 0.0, coat.fields, coat.mesh.faces)
    gain = coat.follicles.corners(coat.mesh, coat.fields.gain)
    found = fit_ties(coat.values, gain, overlaps)
    stacked = _deviate(replace(coat, values=found.values), overlaps)
    cut = np.abs(coat.deviations - stacked.deviations)
    report = StackReport(len(overlaps.pairs), found.shares, cut)
    return replace(stacked, depths=_find_depths(stacked)), report


def _deviate(coat: Coat, overlaps: Overlaps) -> Coat:
    """The coat, stacked, with deviations from its leaves as far as these leave room."""
    own, fields = coat.follicles, coat.fields
    columns = fields.gain, fields.thickness
    leaves = StackedLeaves(coat.values, *(own.corners(coat.mesh, each) for each in columns))
    lift, roll = coat.deviations.T
    rooms = find_roll_rooms(own.width, leaves, overlaps)
    found = limit_lifts(lift, leaves, overlaps), np.clip(roll, -rooms, rooms)
    return replace(coat, deviations=np.stack(found, axis=1), rooms=rooms)


def draw(
    coat: Coat, carrier: Carrier, forms: PlaneForms, numbers: Indices | None = None
) -> LeafArrays:
    """Draw feathers on their leaves over a carrier.

    forms: of K feathers. numbers: (K,) their follicles, default all. Returns arrays for K.
    """
    chosen = np.arange(len(forms.steps)) if numbers is None else numbers
    count, _, rows, columns = forms.angles.shape
    shape = count, rows, 1 + 2 * columns
    drawn = LeafArrays(
        nodes=np.empty((*shape, 3)),
        directors=np.empty((count, rows, 2, 3)),
        feet=np.empty(shape, dtype=np.int64),
        weights=np.empty((*shape, 3)),
        places=np.empty(shape),
    )
    arrays, roots = coat.arrays(carrier), coat.roots(carrier)

    with ThreadPoolExecutor(count_cores()) as pool:
        share_out(
            lambda low, high: draw_feathers(arrays, roots, forms, chosen, drawn, low, high),
            count,
            pool,
        )
    return drawn


def share_out(draw_some: Callable[[int, int], None], count: int, pool: ThreadPoolExecutor) -> None:
    """Draw feathers 0 to count - 1, some at a time, on the threads of a pool."""
    starts = range(0, count, _FEATHERS_AT_ONCE)
    list(pool.map(lambda low: draw_some(low, min(low + _FEATHERS_AT_ONCE, count)), starts))


def describe_doubts(coat: Coat) -> list[str]:
    """List where the flow of the feathers is singular or runs against itself."""
    own, found = coat.fields, []
    where = coat.follicles.position
    weak = own.strength[coat.follicles.triangle] < _MIN_STRENGTH
    if weak.any():
        found.append(
            f"the flow is singular beneath {count_feathers(weak.sum())}, as at "
            f"{_told(where[weak])}. Feathers lie over each other in no steady "
            "order there. Give the regions around a [flow] that does not meet itself"
        )
    ridge = ~weak & (own.growth < MIN_PACE)
    if ridge.any():
        found.append(
            f"the flow around runs against {count_feathers(ridge.sum())}, as at "
            f"{_told(where[ridge])}. Give regions that touch one flow"
        )
    return found


def _told(places: Array) -> str:
    """Return the first of places (N, 3) m as text."""
    return "(" + ", ".join(f"{x:.3g}" for x in places[0]) + ") m"


_ROUNDING = 1e-9  # of shares of a length


class PlaneForms(NamedTuple):
    """Plane forms of F feathers of n rows and m columns a side.

    steps: (F, n - 1) m, chords of the rachis. ahead, behind: (F, n - 1) rad, of each chord to the
    frames of the rows where it begins and ends, towards d2. angles: (F, 2, n, m) rad, of the
    barbs' pieces to their row, and pieces: (F, 2, n, m) m. sunk: (F, n) share u of the calamus that
    is still ahead, squared: how much of the follicle's depth each row lies under its leaf. bare:
    (F,) m, length of the calamus.
    """

    steps: Array
    ahead: Array
    behind: Array
    angles: Array
    pieces: Array
    sunk: Array
    bare: Array


def make_plane_forms(nodes: Array, directors: Array, bare: Array) -> PlaneForms:
    """Measure plane forms of feathers at rest.

    nodes: (F, n, 1 + 2 m, 3) m. directors: (F, n, 2, 3). bare: (F,) m.
    """
    lateral, dorsal = directors[:, :, 0], directors[:, :, 1]
    forward = np.cross(lateral, dorsal)

    def angle(ways: Array, rows: slice) -> Array:
        extra = (1,) * (ways.ndim - 3)
        axes = [each[:, rows].reshape(len(each), -1, *extra, 3) for each in (lateral, forward)]
        return np.asarray(np.arctan2(*(_dots(ways, each) for each in axes)))

    chords = np.diff(nodes[:, :, 0], axis=1)
    columns = (nodes.shape[2] - 1) // 2
    sides = []
    for side in range(2):
        own = nodes[:, :, 1 + side * columns : 1 + (side + 1) * columns]
        sides.append(np.diff(np.concatenate([nodes[:, :, :1], own], axis=2), axis=2))
    ways, steps = np.stack(sides, axis=1), np.sqrt(_dots(chords, chords))
    station = np.concatenate([np.zeros((len(steps), 1)), np.cumsum(steps, axis=1)], axis=1)
    ahead = np.maximum(1.0 - station / np.where(bare > 0.0, bare, 1.0)[:, None], 0.0)
    # rounding of the row where the vane begins
    sunk = np.where((bare > 0.0)[:, None] & (ahead > _ROUNDING), ahead**2, 0.0)
    return PlaneForms(
        steps=steps,
        ahead=angle(chords, slice(None, -1)),
        behind=angle(chords, slice(1, None)),
        angles=np.stack([angle(way, slice(None)) for way in sides], axis=1),
        pieces=np.sqrt(_dots(ways, ways)),
        sunk=sunk,
        bare=bare,
    )


def _dots(first: Array, second: Array) -> Array:
    """(...) dot products of vectors (..., 3)."""
    return np.asarray(np.einsum("...k,...k->...", first, second))
