"""Drawn geometry of a simulated feather, at densities of its own: a finer surface, single barbs.

Barbs are drawn in clumps, frizzy, of uneven lengths: looks, not mechanics.
The points of a feather's barbs are linear in its nodes and directors, x = M y, and a look is one
more linear map, so that rates follow and nothing slides when the feather moves. With u a place
along a barb, 0 at the root and 1 at the end:

    length   x(u)  <-  x(l u),                         l = 1 - jitter r, r even within 0 and 1
    clump    x     <-  x + c u^p (x of the clump's middle barb - x)
    frizz    x     <-  x + f u (sin(2 pi w u + a) across + sin(2 pi w u + b) dorsal)

across: unit, at rest, from the barb before to the one after. Random numbers r, a, b and the waves w
(within a third of their number) go by the barb and by the draw that the feather's id chooses.

Water draws the ends of neighbouring barbs together, each clump to its middle barb: x_0 a point of a
dry barb, c the point at the same place of that one, a how far they come together,

    wet      x     =   x_0 + a u^2 (c - x_0)

Barbules of drawn barbs: curves from each barb to its neighbours, which close a hooked vane.

Along each barb stand N distal barbules, which reach the next barb, and N proximal ones, which reach
the one before (Lucas and Stettenheim 1972, Avian Anatomy, chapter 5). They leave their barb at 45
degrees towards its end (by eye). With d the distance of two on their barb, one is d sin 45 wide at
its root, so that each sort covers the vane by itself, and 0.7 times as wide at its end (by eye).
Points are means of the barbs' points, so that they move with these.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import scipy

from featherfx.algebra.interpolation import from_scipy, linear_weights
from featherfx.algebra.vectors import dots, unit
from featherfx.errors import InputError
from featherfx.feather.build import build_feather
from featherfx.feather.density import density_map
from featherfx.feather.profiles import at_places, vane_shares
from featherfx.feather.shapes import build_shapes
from featherfx.feather.types import (
    LEADING,
    TRAILING,
    Array,
    BarbCurves,
    Feather,
    Indices,
    PointMap,
    RowMap,
    barb_slice,
)
from featherfx.files.disk_cache import stable_number
from featherfx.groom.materials import BarbLook
from featherfx.groom.types import FeatherKind, Splits

if TYPE_CHECKING:
    from featherfx.feather.splits import SplitBarbs


# Pieces that a barb is drawn with.
BARB_SEGMENTS = 8
_RAMUS_FRACTION = 0.14  # of a vane's area
_MIN_GAP_RATIO = 0.1  # of a barb's mean distance from its neighbours; by eye
_END_FRACTION = 0.5  # of a ribbon's width, at its end; by eye


@lru_cache(maxsize=1024)
def render_feather(
    kind: FeatherKind, grid: tuple[int, int], render_grid: tuple[int, int], mirrored: bool
) -> tuple[Feather, RowMap | None]:
    """The feather to draw for one that is simulated, and the map to it.

    grid, render_grid: rows and columns. The map is None where the grids are equal. Raises
    InputError where a feather cannot be built at the grid.
    """
    fine = build_feather(kind, *render_grid, mirrored)
    if grid == render_grid:
        return fine, None
    return fine, density_map(build_feather(kind, *grid, mirrored), fine)


@lru_cache(maxsize=1024)
def barb_curves(kind: FeatherKind, grid: tuple[int, int], count: int, mirrored: bool) -> BarbCurves:
    """Barbs to draw of a feather that is simulated with a grid of rows and columns.

    count: barbs along each vane, at least 1, at equal distances on the rachis; those for which
    the outline leaves no length are left out. Barbs of vanes that may part follow the lips of
    splits. Raises InputError as build_feather does.

    A curve is a flat ribbon across its normals, as wide as the distance g to its neighbours: the
    barb with its barbules, which cover all of a hooked vane. Its end is half as wide. The ramus
    itself covers 0.14 of a vane (Jouve 2024, section 5.2), as wide a part of the distance on
    average. It tapers (Jouve et al. 2024, section 3), evenly, u from root to end:

        ramus = 0.14 mean(g) (3/2 - u)
    """
    rows = max(3, round(count / (1.0 - kind.calamus)) + 2)
    feather, whole = build_feather(kind, *grid, mirrored), _without_splits(kind)
    try:
        dense = build_feather(whole, rows, BARB_SEGMENTS, mirrored)
    except InputError as error:
        told = f"with {count} along a vane, as asked for, "
        raise InputError(
            *(replace(each, key="barbs", message=told + each.message) for each in error.problems)
        ) from error
    grown = [np.flatnonzero(dense.barb_length[side] > 0.0) for side in (LEADING, TRAILING)]
    nodes = np.arange(1 + 2 * BARB_SEGMENTS)
    own = [np.append(0, nodes[barb_slice(side, BARB_SEGMENTS)]) for side in (LEADING, TRAILING)]
    picked = np.concatenate(
        [row[:, None] * len(nodes) + barb for row, barb in zip(grown, own, strict=True)]
    )
    along = np.linspace(0.0, 1.0, BARB_SEGMENTS + 1)
    station = (dense.station / dense.station[-1])[np.concatenate(grown)]
    sign = np.repeat([1.0, -1.0], [len(row) for row in grown])
    u = 0.5 + 0.5 * sign[:, None] * along
    side = np.repeat(np.array([LEADING, TRAILING]), [len(row) for row in grown])
    points = dense.rest.nodes.reshape(-1, 3)[picked]
    to_dense = density_map(build_feather(whole, *grid, mirrored), dense, kind.may_part)
    points_map, strands = to_dense.nodes.picked(picked), None
    if kind.may_part:
        from featherfx.feather.splits import SplitBarbs

        each = (np.repeat(station, len(along)), np.repeat(side, len(along)))
        flat = points.reshape(-1, 3)
        strands = SplitBarbs.from_curves(feather, *each, np.tile(along, len(station)), flat)
        points = _at_rest(feather, points_map, strands)
    barbs = BarbCurves(
        points=points,
        widths=np.zeros(u.shape),
        ramus=np.zeros(u.shape),
        side=side,
        st=np.stack([u, np.broadcast_to(station[:, None], u.shape)], axis=-1),
        points_map=points_map,
        hooked=_hooked(kind, side, vane_shares(kind, station * kind.length), along),
        mirrored=mirrored,
        strands=strands,
    )
    whole_points = dense.rest.nodes.reshape(-1, 3)[picked]
    gaps = _gaps(barbs, whole_points, kind.length * (1.0 - kind.calamus) / count)
    widths = gaps * np.where(along < 1.0, 1.0, _END_FRACTION)
    ramus = _RAMUS_FRACTION * gaps.mean(axis=1, keepdims=True) * (1.5 - along)
    return replace(barbs, widths=widths, ramus=np.minimum(ramus / widths, 1.0))


def _hooked(kind: FeatherKind, side: Indices, places: Array, along: Array) -> Array:
    """(B, K) share of hooked barbules of barbs at places (B,) of the vane, at places (K,) along."""
    found = np.ones((len(side), len(along)))
    for number, vane in ((LEADING, kind.leading), (TRAILING, kind.trailing)):
        own = side == number
        across = at_places(vane.hooked.barb, along)
        found[own] = np.outer(at_places(vane.hooked.rachis, places[own]), across)
    return found


def _gaps(barbs: BarbCurves, points: Array, usual: float) -> Array:
    """(B, K) m, mean distances of barbs from their neighbours. usual: of one alone."""
    before, after = barbs.neighbours
    steps = points[after] - points[before]
    steps /= np.maximum(after - before, 1)[:, None, None]
    along = np.gradient(points, axis=1)
    along /= np.maximum(np.linalg.norm(along, axis=2, keepdims=True), 1e-300)
    gaps = np.linalg.norm(np.cross(steps, along), axis=2)
    least = _MIN_GAP_RATIO * gaps.mean(axis=1, keepdims=True)  # where barbs meet
    return np.where((after > before)[:, None], np.maximum(gaps, least), usual)


def _without_splits(kind: FeatherKind) -> FeatherKind:
    if not kind.is_split:
        return kind
    leading, trailing = (replace(v, splits=Splits()) for v in (kind.leading, kind.trailing))
    return replace(kind, leading=leading, trailing=trailing)


def _at_rest(feather: Feather, points_map: PointMap, strands: SplitBarbs) -> Array:
    """(B, K, 3) m, barbs of a feather whose splits are open."""
    points = points_map(feather.rest)
    if feather.split.size == 0:
        return points
    parted = strands.parted(np.where(feather.split, 0.0, 1.0))
    if parted is None:
        return points
    joined = parted.joined(points.reshape(-1, 3), parted.positions(feather.rest))
    return joined.reshape(points.shape)


# of the part of a vane that a clump takes, how unevenly the parts are cut
_UNEVEN = 0.7
_SEED = 7
# exponent of the way along a barb by which water draws barbs together
WET_SHAPE = 2.0

Matrix = Any

_DORSAL = 1  # number of the director


def drawn_barbs(
    kind: FeatherKind, grid: tuple[int, int], count: int, mirrored: bool, id: str | int
) -> BarbCurves:
    """As barb_curves, with the kind's look in the draw of a feather's id, or of that number. Vanes
    that may part have none. Raises InputError as build_feather does."""
    look = kind.barbs
    if kind.may_part or not look.moves_barbs:
        return barb_curves(kind, grid, count, mirrored)
    draw = stable_number(id) % look.variants if isinstance(id, str) else id
    return _dressed(kind, grid, count, mirrored, draw)


@lru_cache(maxsize=1024)
def _dressed(
    kind: FeatherKind, grid: tuple[int, int], count: int, mirrored: bool, draw: int
) -> BarbCurves:
    barbs, look = barb_curves(kind, grid, count, mirrored), kind.barbs
    feather, shape = build_feather(kind, *grid, mirrored), barbs.widths.shape
    random = draws_of(look, draw, shape[0])
    along = np.linspace(0.0, 1.0, shape[1])
    shorter = _shortened(along, random.lengths[:, 0])
    smooth = _clumped(barbs, look) @ shorter
    angles = 2.0 * np.pi * random.waves * along + random.phases
    across, out = (look.frizz * along * np.sin(angles)).reshape(2, -1)
    points = barbs.points.reshape(-1, 3)
    beside = _beside(barbs, smooth @ points)
    within = scipy.sparse.diags_array(across) @ beside @ smooth + smooth
    dorsal = scipy.sparse.diags_array(out) @ _dorsal(barbs, feather)
    matrix = within @ barbs.points_map.matrix.of_scipy(barbs.points_map.width) + dorsal
    rest = np.concatenate([part.reshape(-1, 3) for part in feather.rest])
    return replace(
        barbs,
        points=(within @ points + dorsal @ rest).reshape(barbs.points.shape),
        st=(shorter @ barbs.st.reshape(-1, 2)).reshape(barbs.st.shape),
        points_map=replace(barbs.points_map, matrix=from_scipy(matrix)),
    )


class RandomDraws(NamedTuple):
    """Random draws of B barbs. lengths: (B, 1) parts l that are left. waves: (B, 1) numbers w of
    them along a barb. phases: (2, B, 1) rad, a and b."""

    lengths: Array
    waves: Array
    phases: Array


def draws_of(look: BarbLook, draw: int, count: int) -> RandomDraws:
    """A draw for so many barbs."""
    random, each = np.random.default_rng([look.seed, draw]), (count, 1)
    return RandomDraws(
        lengths=1.0 - look.jitter * random.uniform(size=each),
        waves=look.frizz_waves * random.uniform(2.0 / 3.0, 4.0 / 3.0, each),
        phases=random.uniform(0.0, 2.0 * np.pi, (2, *each)),
    )


def clump_fraction(look: BarbLook, along: Array) -> Array:
    """Return how far points at places (K,) on their barb go to the middle barb of their clump."""
    return np.asarray(look.clump * along**look.clump_shape)


def _shortened(along: Array, lengths: Array) -> Matrix:
    """(B K, B K) points of barbs of which only the first part is left. along: (K,) places of the
    points. lengths: (B,) parts."""
    return scipy.sparse.block_diag([linear_weights(along, part * along) for part in lengths], "csr")


def _clumped(barbs: BarbCurves, look: BarbLook) -> Matrix:
    """(B K, B K) points that are drawn towards those of the middle barb of their clump."""
    count, each = barbs.widths.shape
    fraction = np.tile(clump_fraction(look, np.linspace(0.0, 1.0, each)), count)
    middle = middle_barbs(barbs.side, barbs.st[:, 0, 1], look.clump_count)
    own = np.arange(count * each)
    at = (middle[:, None] * each + np.arange(each)).ravel()
    moved = scipy.sparse.csr_array((fraction, (own, at)), shape=(own.size, own.size))
    return scipy.sparse.diags_array(1.0 - fraction) + moved


def _beside(barbs: BarbCurves, points: Array) -> Matrix:
    """(B K, B K) of points (B K, 3) at rest, unit vectors from the barb before to the one after."""
    count, each = barbs.widths.shape
    before, after = barbs.neighbours
    ends = [(barb[:, None] * each + np.arange(each)).ravel() for barb in (after, before)]
    apart = np.linalg.norm(points[ends[0]] - points[ends[1]], axis=1)
    scale = np.divide(1.0, apart, out=np.zeros_like(apart), where=apart > 0.0)
    rows = np.arange(count * each)
    entries = np.concatenate([scale, -scale]), (np.tile(rows, 2), np.concatenate(ends))
    return scipy.sparse.csr_array(entries, shape=(rows.size, rows.size))


def _dorsal(barbs: BarbCurves, feather: Feather) -> Matrix:
    """(B K, n (3 + 2 m)) dorsal directors of the rachis at the roots of the barbs."""
    rows, nodes = feather.rest.nodes.shape[:2]
    stations = feather.station / feather.station[-1]
    weights = np.repeat(linear_weights(stations, barbs.st[:, 0, 1]), barbs.widths.shape[1], axis=0)
    place, row = np.nonzero(weights)
    column = rows * nodes + 2 * row + _DORSAL
    shape = len(weights), rows * (nodes + 2)
    return scipy.sparse.csr_array((weights[place, row], (place, column)), shape=shape)


def clumped(barbs: BarbCurves, points: Array, amount: float, clumps: int) -> Array:
    """(B K, 3) points of barbs, or their rates, at an amount a. clumps: of each vane."""
    if amount == 0.0:
        return points
    each = points.reshape(*barbs.widths.shape, 3)
    along = np.linspace(0.0, 1.0, each.shape[1])[:, None]
    middle = each[middle_barbs(barbs.side, barbs.st[:, 0, 1], clumps)]
    fraction = amount * along**WET_SHAPE
    return np.asarray(each + fraction * (middle - each)).reshape(points.shape)


def middle_barbs(side: Indices, place: Array, clumps: int) -> Indices:
    """(B,) barb in the middle of each barb's clump. place: (B,) along the rachis, 0 to 1."""
    rng = np.random.default_rng(_SEED)
    cuts = (np.arange(clumps) + _UNEVEN * rng.uniform(-0.5, 0.5, clumps))[1:] / clumps
    span = np.ptp(place) or 1.0
    number = np.searchsorted(cuts, (place - place.min()) / span) + clumps * side
    _, first, clump, count = np.unique(
        number, return_index=True, return_inverse=True, return_counts=True
    )
    return np.asarray((first + count // 2)[clump])


# points of a barbule, and of its width at the root how much is left there
POINTS = 3
_TAPER = np.array([1.0, 0.85, 0.7])
_ANGLE = np.pi / 4.0
DISTAL, PROXIMAL = 1, 2


@dataclass(frozen=True)
class Barbules:
    """C barbules of B barbs with K points each. barb: (C,) that they stand on. sort: (C,) DISTAL or
    PROXIMAL. widths: (C, 3) m. matrix: (3 C, B K) means of the barbs' points."""

    barb: Indices
    sort: Indices
    widths: Array
    matrix: Any


def barbed_feather(
    kind: FeatherKind, grid: tuple[int, int], count: int, mirrored: bool, id: str, barbules: int
) -> BarbCurves:
    """As drawn_barbs, with so many barbules on either side of each barb; the barbs are then as
    wide as their ramus. Raises InputError as build_feather does."""
    if not barbules:
        return drawn_barbs(kind, grid, count, mirrored, id)
    look = kind.barbs
    variant = stable_number(id) % look.variants if look.moves_barbs else 0
    return _with_barbules(kind, grid, count, mirrored, variant, barbules)


@lru_cache(maxsize=64)
def _with_barbules(
    kind: FeatherKind,
    grid: tuple[int, int],
    count: int,
    mirrored: bool,
    variant: int,
    barbules: int,
) -> BarbCurves:
    barbs = drawn_barbs(kind, grid, count, mirrored, variant)
    steps = np.diff(barbs.points, axis=1)
    lengths = np.linalg.norm(steps, axis=2).sum(axis=1)
    found = [
        _of_sort(barbs, lengths, sort, other, barbules)
        for sort, other in zip((DISTAL, PROXIMAL), barbs.neighbours[::-1], strict=True)
    ]
    barb, sort, spacing, matrix = zip(*found, strict=True)
    widths = np.sin(_ANGLE) * np.concatenate(spacing)[:, None] * _TAPER
    own = Barbules(
        np.concatenate(barb), np.concatenate(sort), widths, scipy.sparse.vstack(matrix, "csr")
    )
    whole = np.ones_like(barbs.ramus)
    return replace(barbs, widths=barbs.widths * barbs.ramus, ramus=whole, barbules=own)


def _of_sort(
    barbs: BarbCurves, lengths: Array, sort: int, other: Indices, count: int
) -> tuple[Indices, Indices, Array, Any]:
    """Barb, sort, distance on the barb and points of the barbules of one sort.

    other: (B,) barbs that they reach; those of a barb that is its own are left out.
    """
    barb = np.repeat(np.flatnonzero(other != np.arange(len(other))), count)
    each = barbs.widths.shape[1]
    root = np.tile((np.arange(count) + 0.5) / count, len(barb) // count)
    nearest = np.round(root * (each - 1)).astype(np.int64)
    way = barbs.points[other[barb], nearest] - barbs.points[barb, nearest]
    tangent = unit(np.gradient(barbs.points, axis=1))[barb, nearest]
    ahead = dots(way, tangent)
    gap = np.linalg.norm(way - ahead[:, None] * tangent, axis=1)
    end = np.clip(root + (gap / np.tan(_ANGLE) - ahead) / lengths[other[barb]], 0.0, 1.0)
    half = 0.5 * (root + end)
    places = ((root, barb, 1.0), (half, barb, 0.5), (half, other[barb], 0.5), (end, other[barb], 1))
    rows, columns, values = [], [], []
    for (at, on, share), point in zip(places, (0, 1, 1, 2), strict=True):
        before = np.minimum((at * (each - 1)).astype(np.int64), each - 2)
        ahead = at * (each - 1) - before
        for node, weight in ((before, 1.0 - ahead), (before + 1, ahead)):
            rows.append(POINTS * np.arange(len(barb)) + point)
            columns.append(on * each + node)
            values.append(share * weight)
    shape = POINTS * len(barb), each * len(other)
    entries = np.concatenate(values), (np.concatenate(rows), np.concatenate(columns))
    matrix = scipy.sparse.csr_array(entries, shape=shape)
    return barb, np.full(len(barb), sort), lengths[barb] / count, matrix


@dataclass(frozen=True)
class ExpandedShape:
    """Shared parts of feathers of one shape and grid, unit size and metres.

    own: on the written grid. fine: on the drawn one. to_fine: the map to that, None where it is
    own.
    """

    own: Feather
    fine: Feather
    to_fine: RowMap | None


@lru_cache(maxsize=4096)
def expand_shape(
    shape: tuple[FeatherKind, bool], own: tuple[int, int], wanted: tuple[int, int]
) -> ExpandedShape:
    """Return feathers of a kind and side. own, wanted: rows and columns."""
    (fine,) = build_shapes((shape,), *wanted)
    if own == wanted:
        return ExpandedShape(fine, fine, None)
    (written,) = build_shapes((shape,), *own)
    return ExpandedShape(written, fine, density_map(written, fine))
