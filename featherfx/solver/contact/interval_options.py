"""Options of one interval of contact, and what comes of it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from featherfx.algebra.types import Flags
from featherfx.solver.contact.types import Array

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

    def of(self, bodies: Flags) -> ContactReport:
        """The same with residual and depth of some bodies (B,) only."""
        off, deep = np.where(bodies, self.off, 0.0), np.where(bodies, self.deep, 0.0)
        return replace(self, off=off, deep=deep, residual=float(off.max()), depth=float(deep.max()))
