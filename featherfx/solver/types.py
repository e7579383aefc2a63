"""Tuples and sizes of arrays that Python and the kernels of a step share, and ends of a solve."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from featherfx.algebra.types import Array
from featherfx.algebra.views import COUNT as LANES

# contacts of a feather that are followed, at most; others are as they are where K is made
MAX_FOLLOWED_CONTACTS = 16384
# steps since a matrix was made that correct it (banded_kernels)
MAX_SECANT_PAIRS = 6
# columns that a band is factorised by at once; banded_kernels writes `_column` and `_eight` out
BLOCK = 8
# pairs of areas and answers that settling mixes
MIXING_DEPTH = 6
# which second derivatives are wanted: none, those without what may be indefinite, all
FORCES_ONLY, STABILISING_STIFFNESS, WHOLE_STIFFNESS = 0, 1, 2

# Places in a block of LANES cells of a strip between two rows: gradients of the strains of
# triangles A and B (half), by strain, node and axis, and of the twist, by node and axis; the
# stiffnesses of both strains of A and B and of the twist; their stresses; and the geometric
# stiffness of the six pairs of nodes of A and B. STRIP_SIZE: all of them.
AXIS_SIZE = LANES
NODE_SIZE, STRAIN_SIZE, HALF_SIZE = 3 * AXIS_SIZE, 9 * AXIS_SIZE, 18 * AXIS_SIZE
TWIST_PLACE, WEIGHT_PLACE, STRESS_PLACE, GEOMETRIC_PLACE, STRIP_SIZE = (
    LANES * first for first in (36, 48, 53, 58, 70)
)
# the twist among WEIGHT_PLACE and STRESS_PLACE, and pairs among GEOMETRIC_PLACE
TWIST_LANE, PAIR_SIZE = 4 * LANES, 6 * LANES
# The same of LANES hinges on a barb: gradients of the angle by node and axis, stiffness, stress.
HINGE_WEIGHT_PLACE, HINGE_STRESS_PLACE, HINGE_SIZE = 12 * LANES, 13 * LANES, 14 * LANES


class Strains(NamedTuple):
    """Strains of one feather; those of a state have leading axes.

    rachis: (n-1, 6) of the elements. barb: (2, n, 2 C) rad, coefficients. cell: (2, n-1, m, 2, 2),
    e_ww and 2 e_vw of triangles A and B. hinge: (2, n, m) rad, dihedral angles. twist:
    (2, n-1, m), of the cells (vane_bending_kernels). openness: (2, n, m), of the hinges
    (vane_bending_kernels).
    """

    rachis: Array
    barb: Array
    cell: Array
    hinge: Array
    twist: Array
    openness: Array

    def at(self, *place: int) -> Strains:
        """Those at a place of the leading axes, the same memory."""
        return Strains(*(array[place] for array in self))

    def assign(self, other: Strains) -> None:
        """Set all, in place."""
        for array, value in zip(self, other, strict=True):
            array[...] = value


class IntegratorFactors(NamedTuple):
    """Factors of a step's energy: inertia (1/s^2) and rate of velocities (1/s) of the integrator,
    and damping of the rachis and the vane, q of strain_kernels."""

    inertia: float
    rate: float
    rachis_damping: float = 0.0
    vane_damping: float = 0.0


class StepSettings(NamedTuple):
    """Settings of one feather's steps through one frame.

    duration: s, of the frame. shortest: s, of a frame in as many even steps as it may have.
    spectral_radius: of the integrator.
    tolerance: m, error of a step. coarse: m, error that no step may have where it can be shorter.
    newton: m, distance from a step's solution that counts as converged. iterations: Newton's of a
    try at most. hard: work beyond which the next step is not made longer. most_iterations: work of
    the whole frame (attempt_work). unsolved: m, distance from its solution at which a step is taken
    where the frame must end. shared: part of the tolerance that the next step is to keep to where
    the frame is one step, which is cut only where Newton fails; else 0.
    """

    duration: float
    shortest: float
    spectral_radius: float
    tolerance: float
    coarse: float
    newton: float
    iterations: int
    hard: int
    most_iterations: int
    unsolved: float
    shared: float = 0.0


class MixingScratch(NamedTuple):
    """Scratch of mixing K numbers, of which R are a pose's.

    guess, change: (MIXING_DEPTH, K), pairs, the next one where the oldest was. next: (K,). normal:
    (MIXING_DEPTH, MIXING_DEPTH) and weight: (MIXING_DEPTH,), of the least squares. before: (R,),
    where nodes were after the last solution or when the last short step began, and way: (R,), where
    it led. direct: (R,), nodes at rest in the whole wind at once.
    """

    guess: Array
    change: Array
    next: Array
    normal: Array
    weight: Array
    before: Array
    way: Array
    direct: Array


def make_mixing(size: int) -> MixingScratch:
    """Scratch of K = R = size numbers."""
    return MixingScratch(
        guess=np.zeros((MIXING_DEPTH, size)),
        change=np.zeros((MIXING_DEPTH, size)),
        next=np.zeros(size),
        normal=np.zeros((MIXING_DEPTH, MIXING_DEPTH)),
        weight=np.zeros(MIXING_DEPTH),
        before=np.zeros(size),
        way=np.zeros(size),
        direct=np.zeros(size),
    )


class SettleResult(NamedTuple):
    """Result of settling, (F,): Newton's status, NO_REST or SEVERAL_RESTS, and Newton's
    iterations."""

    status: Array
    iterations: Array


def panel_shape(width: int) -> tuple[int, int]:
    """Shape of the scratch that factorise wants for a band of this width."""
    return BLOCK, (BLOCK + width + LANES) // LANES * LANES + LANES


CONVERGED = 0
NOT_CONVERGED = 1
NOT_FINITE = 2
NOT_DEFINITE = 3
# of one feather in one frame, whatever the single steps say
TOO_MUCH_WORK = 4
# of statics in wind
NO_REST = 5
# of statics in wind: at rest, and another start leads to another rest pose
SEVERAL_RESTS = 7
# of a step that Newton has solved
GREW = 6

# Newton iterations of one feather in one frame; bakes of the samples need 3 to 100
MAX_INTERVAL_WORK = 2000

REASONS = {
    NOT_CONVERGED: "Newton did not converge at the shortest step",
    NOT_FINITE: "a value is not finite",
    NOT_DEFINITE: "the linear system is not positive definite",
    NO_REST: "it finds no rest in this wind",
    GREW: "its energy would grow without work being done",
}


def reason_of(status: int, most: int = MAX_INTERVAL_WORK) -> str:
    """Why a feather stopped, in words. most: Newton iterations that it had for a frame."""
    if status == TOO_MUCH_WORK:
        return f"more work than {most} Newton iterations in one frame"
    return REASONS[status]
