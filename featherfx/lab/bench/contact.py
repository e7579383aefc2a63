"""Ways to solve the contact forces of a stack of cantilevers, side by side.

n equal cantilevers lie on each other and touch at N points; the top one is loaded. A contact k has
two multipliers, the forces that its upper and its lower plate feel, and one spring r_k. A round
solves every plate once, those of even number first, with K its stiffness and J_k the displacement
at contact k:

    (K + sum r J_k^T J_k) u = f + sum +-J_k^T (lambda_other +- r J_k u_other)
    lambda_own = lambda_other - r g,     g the gap

(Robin transmission conditions: Lions 1990; the choice of r: Gander 2006.) Anderson mixing and GMRES
speed up the map from one round to the next (Walker and Ni 2011; Saad and Schultz 1986). The Schur
complement S = sum J K^-1 J^T gives all forces at once, for a back-substitution a contact and side.

All contacts are closed and nothing turns: a feather has more to ask, but what needs many rounds
here needs them there.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from time import thread_time
from typing import NamedTuple

import numpy as np
from scipy.linalg import cho_solve_banded, cholesky_banded

from featherfx.algebra.types import Array
from featherfx.lab.bench.report import ResultTable, Row

# stiffness of a spring over that of its plate at the contact, as in the solver (interval._FIT)
_FIT = 8.0
# error of a tip over its droop that ends a solve, and most rounds
_TOLERANCE, MAX_ROUNDS = 0.01, 600
# rounds that Anderson mixing remembers
_WINDOW = 5
# plates and contacts of each pair of them
QUICK_STACKS = ((2, 20), (2, 168), (4, 168))
FULL_STACKS = (*QUICK_STACKS, (2, 600), (8, 20), (8, 168))


class Solved(NamedTuple):
    """Outcome of a way: rounds, back-substitutions of one plate, and error of the worst tip over
    the droop."""

    rounds: int
    solves: int
    error: float


class Stack:
    """Cantilevers of N nodes each, of unit length and stiffness, that touch their neighbours at all
    nodes but those at the root.

    springs: (N,) of the contacts, by place. forces: (2, n - 1, N) multipliers, of upper and lower
    plate at each contact.
    """

    def __init__(self, plates: int, contacts: int, shared: bool) -> None:
        self.plates, self.contacts = plates, contacts
        spacing = 1.0 / contacts
        place = spacing * np.arange(1, contacts + 1)
        # stiffness of a cantilever towards a force at a place: 3 / s^3
        self.springs = _FIT * 3.0 / place**3 / (contacts if shared else 1)
        self._load = np.zeros((plates, contacts))
        self._load[-1] = spacing
        self._band = _bending_band(contacts, spacing)
        beside = np.full(plates, 2.0)
        beside[[0, -1]] = 1.0
        self._factors = [self._factorise(each * self.springs) for each in beside]
        self.bare = self._factorise(np.zeros(contacts))
        self.exact = float(cho_solve_banded(self.bare, self._load[-1])[-1]) / plates

    def _factorise(self, springs: Array) -> tuple[Array, bool]:
        band = self._band.copy()
        band[-1] += springs
        return cholesky_banded(band), False

    def round(self, forces: Array) -> tuple[Array, Array]:
        """Return the forces after a round, and the plates' displacements (n, N)."""
        new, u, r = forces.copy(), self._rest(forces), self.springs
        for first in (0, 1):
            for plate in range(first, self.plates, 2):
                load = self._load[plate].copy()
                if plate > 0:
                    load += new[1, plate - 1] + r * u[plate - 1]
                if plate < self.plates - 1:
                    load += r * u[plate + 1] - new[0, plate]
                u[plate] = cho_solve_banded(self._factors[plate], load)
                if plate > 0:
                    new[0, plate - 1] = new[1, plate - 1] - r * (u[plate] - u[plate - 1])
                if plate < self.plates - 1:
                    new[1, plate] = new[0, plate] - r * (u[plate + 1] - u[plate])
        return new, u

    def _rest(self, forces: Array) -> Array:
        """Displacements (n, N) of the odd plates that the forces which they felt belong to."""
        u = np.zeros_like(self._load)
        for plate in range(1, self.plates, 2):
            load = self._load[plate] + forces[0, plate - 1]
            if plate < self.plates - 1:
                load = load - forces[1, plate]
            u[plate] = cho_solve_banded(self.bare, load)
        return u

    def error(self, u: Array) -> float:
        """Error of the worst tip over the droop."""
        return float(np.abs(u[:, -1] / self.exact - 1.0).max())

    def joint(self) -> Array:
        """Displacements (n, N) with all forces from the Schur complement."""
        count, n = self.contacts, self.plates
        flexible = cho_solve_banded(self.bare, np.eye(count))
        free = cho_solve_banded(self.bare, self._load.T).T
        chain = 2.0 * np.eye(n - 1) - np.eye(n - 1, k=1) - np.eye(n - 1, k=-1)
        force = np.linalg.solve(np.kron(chain, flexible), (free[:-1] - free[1:]).ravel())
        ends = np.pad(force.reshape(n - 1, count), ((1, 1), (0, 0)))
        return np.asarray(free + (ends[:-1] - ends[1:]) @ flexible)


def _bending_band(nodes: int, spacing: float) -> Array:
    """(3, nodes) upper band of the bending stiffness of a clamped beam: squares of its curvatures
    at all nodes but the free end."""
    curvature = np.zeros((nodes, nodes))
    for node in range(nodes):
        # about the node before: the root is at rest, and so is what lies behind it
        for other, weight in ((node - 2, 1.0), (node - 1, -2.0), (node, 1.0)):
            if other >= 0:
                curvature[node, other] += weight
    curvature[0] *= 2.0
    stiffness = curvature.T @ curvature / spacing**3
    band = np.zeros((3, nodes))
    for k in range(3):
        band[2 - k, k:] = np.diag(stiffness, k)
    return band


def plain_rounds(stack: Stack) -> Solved:
    """Solve by one round after the other."""
    forces = np.zeros((2, stack.plates - 1, stack.contacts))
    return _repeat(stack, lambda: stack.round(forces), lambda new: forces.__setitem__(..., new))


def _repeat(
    stack: Stack, go: Callable[[], tuple[Array, Array]], take: Callable[[Array], None]
) -> Solved:
    """Take rounds until the tips are where they should be."""
    number, error = 0, 1.0
    while error >= _TOLERANCE and number < MAX_ROUNDS:
        new, u = go()
        take(new)
        number, error = number + 1, stack.error(u)
    return Solved(number, number * stack.plates, error)


def mixed_rounds(stack: Stack) -> Solved:
    """Solve by rounds whose forces Anderson mixing extrapolates."""
    forces = np.zeros((2, stack.plates - 1, stack.contacts))
    points: list[Array] = []
    images: list[Array] = []

    def mix(new: Array) -> None:
        points.append(forces.ravel().copy())
        images.append(new.ravel().copy())
        del points[: -_WINDOW - 1], images[: -_WINDOW - 1]
        off = np.array(images) - np.array(points)
        mixed = images[-1]
        if len(off) > 1:
            weights = np.linalg.lstsq(np.diff(off, axis=0).T, off[-1], rcond=None)[0]
            mixed = mixed - weights @ np.diff(np.array(images), axis=0)
        forces[...] = mixed.reshape(forces.shape)

    return _repeat(stack, lambda: stack.round(forces), mix)


def krylov_rounds(stack: Stack) -> Solved:
    """Solve by GMRES on the forces, one round an iteration."""
    shape = (2, stack.plates - 1, stack.contacts)
    begin, _ = stack.round(np.zeros(shape))
    right = begin.ravel()
    size = float(np.linalg.norm(right))
    hessenberg = np.zeros((MAX_ROUNDS + 1, MAX_ROUNDS))
    basis: list[Array] = [right / size]
    for number in range(1, MAX_ROUNDS + 1):
        image, _ = stack.round(basis[-1].reshape(shape))
        away = basis[-1] - (image.ravel() - right)
        for k, known in enumerate(basis):
            hessenberg[k, number - 1] = known @ away
            away = away - hessenberg[k, number - 1] * known
        length = float(np.linalg.norm(away))
        hessenberg[number, number - 1] = length
        goal = np.zeros(number + 1)
        goal[0] = size
        weights = np.linalg.lstsq(hessenberg[: number + 1, :number], goal, rcond=None)[0]
        forces: Array = np.asarray((weights @ np.array(basis)).reshape(shape), dtype=np.float64)
        # as after its last round: not counted, since the solver would end here
        error = stack.error(stack.round(forces)[1])
        if error < _TOLERANCE or length < 1e-12 * size:
            break
        basis.append(away / length)
    return Solved(number + 1, (number + 1) * stack.plates, error)


def joint_solve(stack: Stack) -> Solved:
    """Solve for all forces at once."""
    return Solved(1, 2 * stack.contacts * (stack.plates - 1), stack.error(stack.joint()))


# what is compared: whether springs are shared by the contacts of a plate, and how forces are found
_WAYS: tuple[tuple[str, bool, Callable[[Stack], Solved]], ...] = (
    ("rounds, springs of single nodes", False, plain_rounds),
    ("rounds, springs that share the plate (the solver's)", True, plain_rounds),
    ("Anderson mixing, springs that share the plate", True, mixed_rounds),
    ("GMRES, springs that share the plate", True, krylov_rounds),
    ("Schur complement", True, joint_solve),
)


def contact_tables(stacks: tuple[tuple[int, int], ...]) -> Iterator[ResultTable]:
    """Yield the table of all ways on stacks of (plates, contacts)."""
    rows: list[Row] = []
    for plates, contacts in stacks:
        for name, shared, way in _WAYS:
            begin = thread_time()
            found = way(Stack(plates, contacts, shared))
            rows.append(
                {
                    "plates": plates,
                    "contacts": contacts,
                    "way": name,
                    "rounds": found.rounds,
                    "back-substitutions": found.solves,
                    "ms": 1e3 * (thread_time() - begin),
                    "error": found.error,
                }
            )
    note = (
        "Linear cantilevers on each other, the top one loaded, contacts of each with the next."
        f" Until the tips are within {100.0 * _TOLERANCE:g} % of the droop, {MAX_ROUNDS} rounds at"
        " most. ms: processor time, with factors, of which the Schur complement needs one, as the"
        " plates are alike; error: of the worst tip, over the droop."
    )
    yield ResultTable("contact", "Ways to solve contact", note, rows)
