"""Scratch memory of one thread: everything that a feather's step needs, allocated once.

The parts are separate tuples because a compiled function's build time grows with the number of
arrays that are handed to it.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from featherfx.algebra.types import Array
from featherfx.feather.types import RowPoints
from featherfx.mechanics.model import Gaps, Model
from featherfx.solver.types import (
    HINGE_SIZE,
    LANES,
    MAX_FOLLOWED_CONTACTS,
    MAX_SECANT_PAIRS,
    STRIP_SIZE,
    Strains,
    panel_shape,
)

# numbers of a ConvergenceHistory (newton_kernels) that are stored
_HISTORY_SIZE = 5


class Pose(NamedTuple):
    """Coordinates of one feather and what follows from them.

    rotation: (n, 4) row quaternions. centre: (n, 3) m. coefficient: (2, n, 2 C) rad. points:
    nodes and directors. frames: (2, n, m, 4) quaternions of the barbs' segments. halfway:
    (n-1, 3, 3) and rachis: (n-1, 6), frames and strains of the rachis elements. strains: all,
    measured from rest.
    """

    rotation: Array
    centre: Array
    coefficient: Array
    points: RowPoints
    frames: Array
    halfway: Array
    rachis: Array
    strains: Strains


class StepEnvironment(NamedTuple):
    """References against which a step's energy is measured.

    target, past: of the integrator. reference: strains that damping pulls towards. angles: (2, n,
    m) rad, of the hinges at the step's start, and gaps there. Of the nodes (air_kernels): wind
    (n, 1 + 2 m, 3) m/s, area (n, 1 + 2 m, 3) m^2, speed (n, 1 + 2 m) m/s, carried
    (n, 1 + 2 m) kg, added mass, slip (n, 1 + 2 m) m/s^2, g; aside (n, 1 + 2 m, 3) m, scratch;
    stream (n, 1 + 2 m, 3): force (m2/s2) and slope (m/s) of attached flow, and scratch.
    """

    target: RowPoints
    past: RowPoints
    reference: Strains
    angles: Array
    gaps: Gaps
    wind: Array
    area: Array
    speed: Array
    carried: Array
    slip: Array
    aside: Array
    stream: Array


class LinearSystem(NamedTuple):
    """Linear system of N unknowns: band (N, B + 1), right (N,), panel: scratch of factorise."""

    band: Array
    right: Array
    panel: Array


def make_system(unknowns: int, width: int) -> LinearSystem:
    """A system of N unknowns whose band is B + 1 = width wide."""
    return LinearSystem(
        band=np.zeros((unknowns, width)),
        right=np.zeros(unknowns),
        panel=np.zeros(panel_shape(width)),
    )


class CellScratch(NamedTuple):
    """Scratch of a barb's cells or hinges, between two of its nodes each.

    Of neighbouring rows (vane/line_kernels): strips (2, .) of cells, hinges (3, .). Lines of S
    numbers: rest (2, 3, S), of triangles A and B; coupling (S,), of shear in the strain across that
    the stiffness belongs to, where gaps slip. Of two rarer strains, stiffness, weight (2, S), and
    gradient (2, 9, S); halved: (S,). left: (m,), stiffness of hinges that open gaps leave. single:
    (3, 4, 3), of one cell.
    """

    strips: Array
    hinges: Array
    rest: Array
    coupling: Array
    weight: Array
    gradient: Array
    halved: Array
    left: Array
    single: Array


class VaneScratch(NamedTuple):
    """Stiffness of a vane's nodes, and sums of one row and side, w = 6 + 2 C.

    blocks: (n, 2, 6, 3, 3 S), N/m, of pairs of nodes (vane/line_kernels), S at least m + 2 and a
    multiple of four. nodes: (n, 2, 3, S + 4) m and pull: (n, 2, 3, S + 4) N, gradient, of the nodes
    of all barbs, line by line. product: (w, 3 S) of one barb and sums: (w, w)
    (vane/assembly_kernels). tension: (m,) N.
    """

    blocks: Array
    nodes: Array
    pull: Array
    product: Array
    sums: Array
    tension: Array
    cells: CellScratch


class RachisScratch(NamedTuple):
    """One rachis element: gradient (6, 12) of its strains, stress (6,), matrix (12, 12)."""

    gradient: Array
    stress: Array
    matrix: Array


class ActiveContacts(NamedTuple):
    """Contacts that open or close within a Newton step (active_contact_kernels).

    Of a feather's contacts: on, whether they are in the matrix, and push, N, which they press with
    where they are. band (N, B + 1), right (N,): matrix, not factored, and right-hand side with what
    is on. turns: (n, 4) quaternions, from the rows where the Jacobian is to where the matrix was
    made. stiff: (n, 1 + 2 m, 6) N/m, of contacts at their nodes. nodes: (n, 2, 3 S) m, how far
    those of barbs go in the step. slopes, pulled: (3, 6 + 2 C), of one node.
    """

    on: NDArray[np.int8]
    push: Array
    band: Array
    right: Array
    turns: Array
    stiff: Array
    nodes: Array
    slopes: Array
    pulled: Array


class StoredMatrix(NamedTuple):
    """The matrix that a feather's steps may begin with. made: (n, 4) rotations of the rows where it
    was made. plain: (N, B + 1), without contacts that are followed, or (0, 0) where no later solve
    asks for it. pace: (_HISTORY_SIZE,), what it was left with; zeros for none.
    """

    made: Array
    plain: Array
    pace: Array


class StoredMatrices(NamedTuple):
    """matrices: of all feathers of a batch, (F, ...) each. hard: (F,) whether the first solve of
    the last interval took many iterations; then the next one begins with a new matrix."""

    matrices: StoredMatrix
    hard: NDArray[np.int8]


class SolverScratch(NamedTuple):
    """now, trial: poses. around: StepEnvironment. system, vane: sums. secants
    (MAX_SECANT_PAIRS, 3, N): steps since the matrix was made (banded_kernels). kept: that matrix.
    spin (n, 3), coefficient_rate (2, n, 2 C): those of State in the step before the last. force (n,
    1 + 2 m, 3), stiff (n, 1 + 2 m, 6): of the nodes. axes (2, n, m, 6): of the barbs' joints.
    jacobian (n, 2, 6 + 2 C, 3 S): of the barbs, axis by axis. beam: sums of one rachis element.
    gaps and history (2 + B, ...), the dashpots' strains: at the step's end. closing: contacts.
    """

    now: Pose
    trial: Pose
    around: StepEnvironment
    system: LinearSystem
    secants: Array
    kept: StoredMatrix
    spin: Array
    coefficient_rate: Array
    vane: VaneScratch
    force: Array
    stiff: Array
    axes: Array
    jacobian: Array
    beam: RachisScratch
    gaps: Gaps
    history: Strains
    closing: ActiveContacts


def make_matrices(model: Model) -> StoredMatrices:
    """Room for a matrix of every feather of a batch; none is kept yet."""
    count = model.feathers
    matrices = StoredMatrix(
        made=np.zeros((count, model.rows, 4)),
        plain=np.zeros((count, model.unknowns, _width(model))),
        pace=np.zeros((count, _HISTORY_SIZE)),
    )
    return StoredMatrices(matrices, np.zeros(count, dtype=np.int8))


def _width(model: Model) -> int:
    """B + 1 of a batch's matrices."""
    return 3 * (6 + 4 * model.coefficients)


def make_strains(model: Model, *lead: int) -> Strains:
    """Strains of zero with leading axes."""
    n, m, c = model.rows, model.columns, model.coefficients
    return Strains(
        rachis=np.zeros((*lead, n - 1, 6)),
        barb=np.zeros((*lead, 2, n, 2 * c)),
        cell=np.zeros((*lead, 2, n - 1, m, 2, 2)),
        hinge=np.zeros((*lead, 2, n, m)),
        twist=np.zeros((*lead, 2, n - 1, m)),
        openness=np.zeros((*lead, 2, n, m)),
    )


def make_gaps(model: Model, *lead: int) -> Gaps:
    """Gaps that have not slipped yet, with leading axes.

    lead: the batch's feathers, of which some are split from the start, or none for scratch.
    """
    shape = (*lead, *model.hooks.opened.shape[1:])
    opened = model.hooks.opened if lead else np.zeros(shape)
    return Gaps(
        slip=np.zeros((*shape, 2)),
        level=np.where(opened > 0.0, opened, 1.0),
        hooked=np.where(opened > 0.0, 0.0, 1.0),
        spent=np.zeros((*lead, 5)),
        length=np.zeros((*lead, 2)),
    )


def make_points(rows: int, columns: int, *lead: int) -> RowPoints:
    """Nodes and directors of zero with leading axes."""
    nodes = np.zeros((*lead, rows, 1 + 2 * columns, 3))
    return RowPoints(nodes, np.zeros((*lead, rows, 2, 3)))


def make_pose(model: Model) -> Pose:
    """Scratch for one pose of a feather of this batch."""
    n, m, c = model.rows, model.columns, model.coefficients
    return Pose(
        rotation=np.zeros((n, 4)),
        centre=np.zeros((n, 3)),
        coefficient=np.zeros((2, n, 2 * c)),
        points=make_points(n, m),
        frames=np.zeros((2, n, m, 4)),
        halfway=np.zeros((n - 1, 3, 3)),
        rachis=np.zeros((n - 1, 6)),
        strains=make_strains(model),
    )


def _lines(*shape: int) -> Array:
    """Zeros, with room around them: loops begin before the first line and end beyond the last one
    (line_kernels)."""
    count = math.prod(shape)
    return np.zeros(count + 2 * LANES)[LANES : LANES + count].reshape(shape)


def make_scratch(model: Model) -> SolverScratch:
    """Scratch for one thread working on feathers of this batch."""
    n, m, c = model.rows, model.columns, model.coefficients
    size, wide, padded = 1 + 2 * m, 6 + 2 * c, 4 * ((m + 1) // 4 + 1)
    return SolverScratch(
        now=make_pose(model),
        trial=make_pose(model),
        around=StepEnvironment(
            target=make_points(n, m),
            past=make_points(n, m),
            reference=make_strains(model),
            angles=np.zeros((2, n, m)),
            gaps=make_gaps(model),
            wind=np.zeros((n, size, 3)),
            area=np.zeros((n, size, 3)),
            speed=np.zeros((n, size)),
            carried=np.zeros((n, size)),
            slip=np.zeros((n, size)),
            aside=np.zeros((n, size, 3)),
            stream=np.zeros((n, size, 3)),
        ),
        system=make_system(model.unknowns, _width(model)),
        secants=np.zeros((MAX_SECANT_PAIRS, 3, model.unknowns)),
        kept=StoredMatrix(np.zeros((n, 4)), np.zeros((0, 0)), np.zeros(_HISTORY_SIZE)),
        spin=np.zeros((n, 3)),
        coefficient_rate=np.zeros((2, n, 2 * c)),
        vane=VaneScratch(
            blocks=_lines(n, 2, 6, 3, 3 * padded),
            nodes=np.zeros((n, 2, 3, padded + 4)),
            pull=np.zeros((n, 2, 3, padded + 4)),
            product=np.zeros((wide, 3 * padded)),
            sums=np.zeros((wide, wide)),
            tension=np.zeros(m),
            cells=CellScratch(
                strips=np.zeros((2, (padded // LANES + 1) * STRIP_SIZE)),
                hinges=np.zeros((3, (padded // LANES + 1) * HINGE_SIZE)),
                rest=np.zeros((2, 3, padded)),
                coupling=np.zeros(padded),
                weight=np.zeros((2, padded)),
                gradient=np.zeros((2, 9, padded)),
                halved=np.zeros(padded),
                left=np.zeros(m),
                single=np.zeros((3, 4, 3)),
            ),
        ),
        force=np.zeros((n, size, 3)),
        stiff=np.zeros((n, size, 6)),
        axes=np.zeros((2, n, m, 6)),
        jacobian=_lines(n, 2, wide, 3 * padded),
        beam=RachisScratch(
            gradient=np.zeros((6, 12)), stress=np.zeros(6), matrix=np.zeros((12, 12))
        ),
        gaps=make_gaps(model),
        history=make_strains(model, 2 + model.relaxation_time.shape[2]),
        closing=ActiveContacts(
            on=np.zeros(MAX_FOLLOWED_CONTACTS, dtype=np.int8),
            push=np.zeros(MAX_FOLLOWED_CONTACTS),
            band=np.zeros((model.unknowns, _width(model))),
            right=np.zeros(model.unknowns),
            turns=np.zeros((n, 4)),
            stiff=np.zeros((n, size, 6)),
            nodes=np.zeros((n, 2, 3 * padded)),
            slopes=np.zeros((3, wide)),
            pulled=np.zeros((3, wide)),
        ),
    )
