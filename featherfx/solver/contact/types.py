"""Types of contact: bodies and what touches, as the kernels take it, options and reports."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from featherfx.algebra.types import Flags

Array = NDArray[np.float64]
Indices = NDArray[np.int64]
Bytes = NDArray[np.int8]

# parts into which the rim between two rows is divided
RIM_SAMPLES = 4
# One contact of a guest's node with a host, a body or a wall (host -1). pair: its number, -1 for a
# wall. row, column: of the guest's points (search_kernels.guest_point); point, fraction: node
# there, and how far it lies towards the next row. side: of the host where the guest belongs;
# mirror: side of the triangle on the host's own vane; corner: row and node of its corners, weight:
# theirs. normal: unit, out of the host on the guest's side. Gaps in m: at the
# start and now; thickness: sum of both halves, less Candidates.depth; spared: of a depth that was
# there at the start.
# Forces, N, that guest and host feel; stiffness, N/m, of the spring that each of them is pressed
# against, and stiffest: that it may become; leeway: m, misfit that rounds may leave; before: m, its
# gap one solve ago; clear: m, ways of both bodies up to which it presses nothing.
# place_start, place_now: m, of the host's point; guest_now: the guest's. joint: its place among the
# forces that are solved together (JointForces), FIXED where what never gives way presses it, else
# APART.
FIXED, APART = -2, -1
# of bodies that are led (LedMotion): for a span of time, and for good
FOR_NOW, FOR_GOOD = 1, 2
CONTACT_DTYPE = np.dtype(
    [(name, "i8") for name in ("pair", "row", "column", "point", "guest", "host", "side", "mirror")]
    + [("corner", "i8", (3, 2)), ("weight", "f8", (3,)), ("normal", "f8", (3,))]
    + [(name, "f8") for name in ("start_gap", "gap", "thickness", "spared", "fraction")]
    + [(name, "f8") for name in ("guest_force", "host_force", "stiffness", "stiffest")]
    + [(name, "f8") for name in ("leeway", "before", "clear")]
    + [(name, "f8", (3,)) for name in ("place_start", "place_now", "guest_now")]
    + [("joint", "i8")]
)
# (K,) of CONTACT_DTYPE
Touch = NDArray[Any]


class VaneSurfaces(NamedTuple):
    """Constant surfaces of B bodies on the widest grid (surfaces.Grids). present:
    (B, n, 2 m + 1), which nodes a triangle has. guests: (B, n, W) points that may touch others
    (search_kernels.guest_point). exists: (B, 2, n-1, m, 2) triangles. half: (B, n, 1 + 2 m) m,
    half thickness at the nodes. columns: (B,) of each body's own grid. far: (B,) m, from the
    nearest node, of points that may still be in the vane or touch it."""

    present: Bytes
    guests: Bytes
    exists: Bytes
    half: Array
    columns: Indices
    far: Array


class MovingBodies(NamedTuple):
    """B bodies in an interval. start: (B, n, 1 + 2 m, 3) m, nodes at its begin; ahead: where they
    will be about its end. boxes: (B, n, 6) and bounds: (B, 6) m, around both. impedance: (B, n, 1 +
    2 m) N/m, for each contact that presses a body, of led bodies more than of any other; leeway: N,
    of forces that rounds may leave; whole, firm: N/m, for all of it, towards walls and towards
    obstacles. led: (B,) FOR_NOW, FOR_GOOD or 0. way: (B,) m, farthest that a node goes; swing: (B,)
    m, beyond its root. slab: (B, 5), a normal and the lowest and highest along it, m, of all nodes
    ahead, between which no triangle is turned over; endless where there is none."""

    start: Array
    ahead: Array
    boxes: Array
    bounds: Array
    impedance: Array
    leeway: Array
    whole: Array
    firm: Array
    led: Bytes
    way: Array
    swing: Array
    slab: Array


# bits of ContactMemory.inside for a wall, and those of all walls that say that guests have grown in
WALL_BITS, GROWN_IN = 3, sum(1 << 3 * k for k in range(20))


class ContactMemory(NamedTuple):
    """Data that is kept between intervals. key: (K,) ascending, pair, row and guest's column of K
    contacts of feathers, as one number; force: (K, 2) N, on guest and host; side: (K,) of the host.
    wall: (B, n, W) N, forces of walls. inside: (B, n, W), three bits for each
    wall (WALL_BITS): guests have grown into it (GROWN_IN), are before a sheet, or behind it.
    surprise: (B,) m/s^2, how far each body went from where it was headed, over the square of the
    interval; endless where nothing is known.
    """

    key: Indices
    force: Array
    side: Bytes
    wall: Array
    inside: Indices
    surprise: Array


class Candidates(NamedTuple):
    """pairs: (N, 2) guest and host by body. order: (N,) side of the host where the guest belongs
    (1: that of its normal, -1), 0 where only the poses tell. depth: (N,) m, by which the pair is
    closer than its thickness as it is drawn, and may be; endless of one that is not kept apart."""

    pairs: Indices
    order: Indices
    depth: Array


class SearchSettings(NamedTuple):
    """Settings of a search. margin: (B,) m, gap below which a body's nodes are followed, for two
    bodies the mean of theirs; widest: the largest that one may have. recovery: m, that a depth may
    be reduced by. wall_fit: stiffness of a contact with a wall over that of the node. turns:
    whether points that come around a rim stay on the side where they come, against an order. again:
    whether the memory is of an earlier search of the same interval."""

    surfaces: VaneSurfaces
    bodies: MovingBodies
    memory: ContactMemory
    margin: Array
    widest: float
    recovery: float
    wall_fit: float
    turns: bool = False
    again: bool = False


class EarlierContacts(NamedTuple):
    """The first number contacts of touch, found last; they hold on for pairs of bodies that are
    not stale (B,)."""

    touch: Touch
    number: int
    stale: Bytes


class Clearance(NamedTuple):
    """Data that tells which of N pairs of B bodies cannot touch yet (clearance_kernels). frame: (B,
    4, 3), where each body was to be in the search before: its origin, m, and three axes; nodes: (B,
    n, 1 + 2 m, 3) m, in that. half: (B,) m, largest half thickness. facets: (B, 17, T) triangles in
    the frame, the first facet_count (B,) of them: their middle, m, normal, size and width, m, and
    corners, m. size: (B,) m, the largest; extent: (B,) m, of a node from the origin. as_guest,
    as_host: (B,) m, what each body has changed, as it counts for pairs in that role. until: (N,) m,
    what both may change, and go past each other, until they may touch; pose: (N, 12), the guest's
    frame in the host's when that was asked for. wait: (N,) looks until it is asked for again."""

    frame: Array
    nodes: Array
    half: Array
    facets: Array
    facet_count: Indices
    size: Array
    extent: Array
    as_guest: Array
    as_host: Array
    until: Array
    pose: Array
    wait: Bytes


class ByBody(NamedTuple):
    """Contacts of each body b: items[first[b]] to items[first[b + 1] - 1]; first (B + 1,)."""

    first: Indices
    items: Indices


class HandoverRules(NamedTuple):
    """Rules by which contacts are handed to bodies. friction: coefficient. smoothing: m, slip over
    which it sets in. reach: (B,) m, how far each body is expected to go in a solve: a contact
    without a force is left out whose gap is more than both go. widest: columns of the widest grid;
    columns: (B,) of the bodies' own. beginning: whether they are to press with the forces that they
    had before the interval, whatever their gaps."""

    friction: float
    smoothing: float
    reach: Array
    widest: int
    columns: Indices
    beginning: bool = False


class CubeGrid(NamedTuple):
    """origin: (3,) m. edge: m, of a cube. reach: m, distance at which triangles are found. cubes:
    (3,) along the axes."""

    origin: Array
    edge: float
    reach: float
    cubes: Indices


class Wall(NamedTuple):
    """A mesh over an interval. start, end: (V, 3) m. triangles: (T, 3), counter-clockwise seen from
    outside. first: (cubes + 1,) and items: triangles of each cube. beginning: 1 where nodes that
    are inside now have grown in. open: 1 for a sheet, which holds a node on the side where it came.
    """

    start: Array
    end: Array
    triangles: Indices
    grid: CubeGrid
    first: Indices
    items: Indices
    beginning: int
    open: int


class SkinMesh(NamedTuple):
    """triangles: (T, 3), counter-clockwise seen from outside; beside: (T, 3) those across the edges
    opposite each corner, -1 for none."""

    triangles: Indices
    beside: Indices


class GroundSurface(NamedTuple):
    """A skin that feathers grow on, over an interval. start, end: (V, 3) m. triangles, beside: of a
    SkinMesh. under: (B, n, 1 + 2 m) the triangle that each node is over at rest, -1 for a node that
    is not over this skin. deepest: m, below it, up to which points are pushed out. beginning: as of
    a Wall."""

    start: Array
    end: Array
    triangles: Indices
    beside: Indices
    under: Indices
    deepest: float
    beginning: int


class JointForces(NamedTuple):
    """Forces at P places, of contacts of I islands of B bodies, that are solved together
    (joint_kernels).

    on: (I,) whether they are in this round, fresh: whether they were chosen for it. first, last:
    (I,) places of an island; room: (I + 1,) of its weights. chosen: (P,) contacts. counts: (B,) of
    a body's; items_at, weights_at: (B,) where its places begin among items (2 P,), and in weights
    how far it gives way at each of them for a force at another, (count, count) m/N. moves: (B,)
    whether it is solved. force: (P,) N. ahead: (P, 2) m, by which guest and host are to open the
    gap. lines: (6, P) scratch."""

    on: Bytes
    fresh: Bytes
    first: Indices
    last: Indices
    room: Indices
    chosen: Indices
    counts: Indices
    items_at: Indices
    weights_at: Indices
    items: Indices
    weights: Array
    moves: Bytes
    force: Array
    ahead: Array
    lines: Array


# Newton iterations of one solve of a feather; one that needs more gets a shorter interval
MAX_CONTACT_ITERATIONS = 1000


@dataclass(frozen=True)
class ContactSettings:
    """Settings of the contact solver.

    friction: Coulomb's coefficient. smoothing: m/s, slip speed below which friction is partial.
    margin: m, gap below which nodes of the thickest vane are followed, and the most of any; of
    others in proportion to their thickness, and of those that do not go where they were headed
    more. tolerance: m, that another round may move anything over a frame (s), or over an interval
    where frame is 0. rounds: most rounds over all feathers in an interval; twice as many over two
    alone. recovery: m/s, speed at which what begins too deep comes apart. newton: m, distance from
    its step's solution to which a feather is solved that nothing presses, where that may be more
    than for others. deepest: m, for all or (B,) bodies, depth beyond which two are no longer kept
    apart.
    """

    friction: float = 0.3
    smoothing: float = 0.02
    margin: float = 1e-3
    tolerance: float = 1.2e-5
    rounds: int = 12
    recovery: float = 0.1
    newton: float = 0.0
    frame: float = 0.0
    deepest: float | Array = np.inf


class LedMotion(NamedTuple):
    """Bodies whose motion over an interval is given. free: (B,) the others, which are solved.
    start, end: (B, n, 1 + 2 m, 3) m, nodes of those that are led. fixed: (B,) those that are led
    for good, as obstacles are, and not for this interval only."""

    free: Flags
    start: Array
    end: Array
    fixed: Flags


class IntervalOptions(NamedTuple):
    """Options of one interval's solve.

    substeps: most regular steps that a feather may divide it into by itself, to keep to its
    tolerance. resting: (B,) bodies that are solved only if what touches them asks for it; the
    report counts no steps of those that were not. left_out: (B,) bodies whose contacts are left
    out, because they cannot be solved otherwise; what goes too deep comes out later, at the
    recovery speed. led: bodies that the others meet as walls; their states come out as zero.
    iterations: of Newton in one solve of a feather, at most. turns: whether points that come around
    a rim stay on the side where they come, against an order. settling: whether all feathers are
    solved as closely as those that touch. lost: m, for all or (B,), misfit of a feather's contacts
    with which rounds end beyond which it stays where it is: no other search is likely to bring it
    where it should be.
    """

    substeps: int = 1
    resting: Flags | None = None
    left_out: Flags | None = None
    led: LedMotion | None = None
    iterations: int = MAX_CONTACT_ITERATIONS
    turns: bool = False
    settling: bool = False
    lost: float | Array = np.inf


PLAIN_INTERVAL = IntervalOptions()


@dataclass(frozen=True)
class ContactReport:
    """Work and result of an interval.

    contacts: closed ones at its end. rounds: over the feathers. solves: feathers solved. residual:
    m, largest gap that should be closed, or misfit of the two forces over the stiffness. depth: m,
    deepest penetration of a node below the sum of half thicknesses, at the interval's end.
    start_depth: m, what the interval spared of the depth that it began with. off, deep: (B,) m,
    residual and depth of each body.
    """

    contacts: int
    rounds: int
    solves: int
    residual: float
    depth: float
    start_depth: float
    off: Array
    deep: Array

    def but(self, bodies: Flags) -> ContactReport:
        """The same without depths of some bodies (B,), which stay where they were."""
        deep = np.where(bodies, 0.0, self.deep)
        return replace(self, deep=deep, depth=float(deep.max()))

    def of(self, bodies: Flags) -> ContactReport:
        """The same with residual and depth of some bodies (B,) only."""
        off, deep = np.where(bodies, self.off, 0.0), np.where(bodies, self.deep, 0.0)
        return replace(self, off=off, deep=deep, residual=float(off.max()), depth=float(deep.max()))
