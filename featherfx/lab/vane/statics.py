"""Equilibrium of a plane membrane whose clamped nodes are moved.

Newton's iterations with the exact stiffness; the stresses in it are predicted to first order from
the iteration before, which keeps full steps convergent at any ratio of moduli (see
sample_kernels.py). Barbs of constant length are held by multipliers, one for each segment:

    [ K + sum t d2e   J^T ] [ du ]     [ g ]
    [ J               0   ] [ t  ] = - [ e ],      e = (|d|^2 / s^2 - 1) / 2,   J = de

with t the new tensions. A moved clamp enters as a linear prediction first. Where the iterations do
not converge, its path is halved; where that does not help, the energy is followed downhill.

A membrane has no bending stiffness, so where barbs are compressed it may buckle within its plane,
and its stiffness is then indefinite. The stiffness of a step downhill is taken with the stresses

    (1 - t) S + t S+,      S+ the part of S without its negative principal stresses and pressure,

with the least t found at which it is definite, and a line search on the energy follows. Near a
minimum t is zero and the convergence quadratic.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.sparse import bmat, csc_matrix, csr_matrix
from scipy.sparse.linalg import SuperLU, splu

from featherfx.algebra.types import Array, Flags, Indices
from featherfx.lab.vane.sample import Membrane
from featherfx.lab.vane.sample_kernels import (
    Elements,
    chain_system,
    predicted_strains,
    sample_pressures,
    sample_strains,
    sample_system,
)

_UNIT = np.array([1.0, 0.0, 1.0])
# of the guard's modulus, what a volume stores at J = 0 (guard_kernels)
_GUARD = 1.0 / 2592.0


class CoupledCoordinates:
    """Pairs of coordinates that elements couple. nodes: (M, K). free: (2 N,) coordinates."""

    def __init__(self, nodes: Indices, free: Flags) -> None:
        unknown = (2 * nodes[:, :, None] + np.arange(2)).reshape(len(nodes), -1)
        rows = np.repeat(unknown, unknown.shape[1], axis=1).ravel()
        columns = np.tile(unknown, (1, unknown.shape[1])).ravel()
        self._size = len(free)
        key, self._slot = np.unique(columns * self._size + rows, return_inverse=True)
        self._columns, self._rows = np.divmod(key, self._size)
        number = np.cumsum(free) - 1
        self._inside = free[self._rows] & free[self._columns]
        self._inner_rows = number[self._rows[self._inside]]
        self._inner_starts = _starts(number[self._columns[self._inside]], int(free.sum()))
        self._starts = _starts(self._columns, self._size)

    def sum(self, blocks: Array) -> Array:
        """Values of the pairs, of the elements' blocks (M, 2 K, 2 K)."""
        return np.bincount(self._slot.ravel(), blocks.ravel()).astype(np.float64)

    def matrix(self, values: Array) -> csc_matrix:
        """Return the matrix of all coordinates."""
        return csc_matrix((values, self._rows, self._starts), (self._size, self._size))

    def inner(self, values: Array) -> csc_matrix:
        """Return the matrix of the free coordinates."""
        count = len(self._inner_starts) - 1
        data = (values[self._inside], self._inner_rows, self._inner_starts)
        return csc_matrix(data, (count, count))


def _starts(columns: Indices, size: int) -> Indices:
    return np.concatenate([[0], np.cumsum(np.bincount(columns, minlength=size))])


def factorised(matrix: csc_matrix) -> SuperLU:
    """Without pivoting, which a definite matrix does not need; the order of least fill."""
    return splu(
        matrix, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True}
    )


class MembraneSystem:
    """membrane: constant data. held: (N,) bool, nodes whose positions are prescribed. size: m, of
    the sample. folding: let elements turn over, as they do where a mesh locks."""

    def __init__(self, membrane: Membrane, held: Flags, *, folding: bool = False) -> None:
        self.membrane, self.held, self.folding = membrane, held, folding
        self.size = float(np.ptp(membrane.points, axis=0).max())
        is_free = np.repeat(~held, 2)
        self.free = np.flatnonzero(is_free)
        self.pattern = CoupledCoordinates(membrane.nodes, is_free)
        self._elements = Elements(
            *(membrane.nodes, membrane.along, membrane.across, membrane.volume, membrane.moduli),
            guard=membrane.guard * _GUARD,
        )
        count = membrane.nodes.shape[1]
        self._scratch = (*_scratch(), np.zeros(3), np.zeros((2 * count, 3)))
        self._blocks = np.zeros((len(membrane.nodes), 2 * count, 2 * count))

    def strains(self, positions: Array) -> Array:
        """(M, Q, 3) e_vv, e_ww, 2 e_vw at positions (N, 2)."""
        strain = np.zeros((*self.membrane.volume.shape, 3))
        sample_strains(positions, self._elements, _UNIT, np.zeros((3, 3)), strain)
        return strain

    def stresses(self, positions: Array) -> Array:
        """(M, Q, 4) Pa, vv, ww, vw and the guard's pressure at positions (N, 2)."""
        strain = self.strains(positions)
        return self._stresses(strain, positions, np.zeros_like(positions))

    def _stresses(self, strain: Array, positions: Array, step: Array) -> Array:
        pressure = np.zeros(self.membrane.volume.shape)
        if self.membrane.guard > 0.0:
            sample_pressures(positions, step, self._elements, np.zeros((3, 3)), pressure)
        stress = strain * self.membrane.moduli[:, None]
        return np.concatenate([stress, pressure[..., None]], axis=-1)

    def energy(self, positions: Array) -> float:
        """J."""
        return self.assembled(positions, np.zeros((*self.membrane.volume.shape, 4)))[0]

    def turned(self, positions: Array) -> int:
        """Count the strain points that are turned over at positions (N, 2)."""
        return int((self.areas(positions) <= 0.0).sum())

    def areas(self, positions: Array) -> Array:
        """(M, Q) areas at positions (N, 2) over those at rest."""
        images = [
            np.einsum("mqk,mkx->mqx", each, positions[self.membrane.nodes])
            for each in (self.membrane.along, self.membrane.across)
        ]
        area = images[0][..., 0] * images[1][..., 1] - images[0][..., 1] * images[1][..., 0]
        return np.asarray(area)

    def assembled(self, positions: Array, stresses: Array) -> tuple[float, Array, Array]:
        """Energy (J), forces (N, 2) N and the values of the pattern's pairs.

        stresses: (M, Q, 4) Pa, of the stiffness.
        """
        forces = np.zeros_like(positions)
        energy = sample_system(
            *(positions, self._elements, stresses, _UNIT, self._scratch, forces, self._blocks)
        )
        if self.membrane.bending is not None:
            moved = (positions - self.membrane.points).ravel()
            bent = self.membrane.bending @ moved
            energy, forces = energy + 0.5 * float(moved @ bent), forces + bent.reshape(-1, 2)
        return energy, forces, self.pattern.sum(self._blocks)

    def matrix(self, values: Array) -> csc_matrix:
        """Stiffness of all coordinates. values: of the pattern's pairs, from assembled."""
        whole = self.pattern.matrix(values)
        return whole if self.membrane.bending is None else whole + self.membrane.bending

    def inner(self, values: Array) -> csc_matrix:
        """The same of the free coordinates."""
        inner = self.pattern.inner(values)
        if self.membrane.bending is None:
            return inner
        return inner + self.membrane.bending[self.free][:, self.free]

    def predicted_stresses(self, positions: Array, step: Array) -> Array:
        """(M, Q, 4) Pa after a step (N, 2), to first order."""
        strain = np.zeros((*self.membrane.volume.shape, 3))
        predicted_strains(positions, step, self._elements, _UNIT, _scratch(), strain)
        return self._stresses(strain, positions, step)

    def solve(self, positions: Array, stresses: Array, shift: Array) -> tuple[Array, Array] | None:
        """Newton's step (N, 2) and the forces (N, 2), N, without chains; None if not definite.

        stresses: (M, Q, 4) Pa, of the stiffness. shift: (N, 2) m, of the held nodes.
        """
        _, forces, stiffness = self.assembled(positions, stresses)
        factor = factorised(self.inner(stiffness))
        definite = np.array_equal(factor.perm_r, factor.perm_c) and factor.U.diagonal().min() > 0.0
        if not definite:
            return None
        load = -forces.ravel() - self.matrix(stiffness) @ shift.ravel()
        step = shift.ravel().copy()
        step[self.free] = factor.solve(load[self.free])
        return step.reshape(-1, 2), forces


def _scratch() -> tuple[Array, ...]:
    return (
        np.zeros((3, 3)),
        np.zeros((3, 3)),
        np.zeros((2, 3, 3)),
        np.zeros(6),
        np.zeros((3, 2, 2)),
    )


_LIMIT = 150
# the last step: below this share of the size
# how t grows until the stiffness is definite, and how it falls from one iteration to the next
_FIRST, _MORE, _LESS = 0.1, 0.15, 0.3
_SHORTEST = 1e-6
_ARMIJO = 1e-4


class NoEquilibrium(Exception):
    """No equilibrium was found; holds the reason."""


def tensile(stresses: Array) -> Array:
    """Stresses (..., 4) of (vv, ww, vw) without their negative principal parts, no pressure."""
    mean = 0.5 * (stresses[..., 0] + stresses[..., 1])
    half = 0.5 * (stresses[..., 0] - stresses[..., 1])
    radius = np.hypot(half, stresses[..., 2])
    large, small = np.maximum(mean + radius, 0.0), np.maximum(mean - radius, 0.0)
    ratio = np.divide(0.5 * (large - small), radius, out=np.zeros_like(radius), where=radius > 0)
    centre = 0.5 * (large + small)
    return np.stack(
        [
            centre + ratio * half,
            centre - ratio * half,
            ratio * stresses[..., 2],
            np.zeros_like(mean),
        ],
        axis=-1,
    )


def descend(
    system: MembraneSystem, positions: Array, shift: Array, accuracy: float
) -> tuple[Array, int] | None:
    """Positions (N, 2) of a minimum and the iterations taken, or None. Raises NoEquilibrium.

    positions: where it begins. shift: (N, 2) m, of the held nodes; zero elsewhere. accuracy: share
    of the energy that a step must win to be followed by another.
    """
    weight = 0.0
    for iteration in range(_LIMIT):
        stresses = system.stresses(positions)
        step, gain, weight = _direction(system, positions, stresses, weight, shift)
        length = 1.0 if iteration == 0 else _length(system, positions, step, gain)
        positions = positions + length * step
        shift = np.zeros_like(shift)
        close = np.abs(step).max() < _CLOSE * system.size
        if iteration and (close or gain < accuracy * system.energy(positions)):
            return positions, iteration + 1
    return None


def _direction(
    system: MembraneSystem, positions: Array, stresses: Array, weight: float, shift: Array
) -> tuple[Array, float, float]:
    """Newton's step, what it would win (J, twice), and the weight t that it took."""
    convex = tensile(stresses)
    weight = max(0.0, weight - _LESS)
    while True:
        found = system.solve(positions, stresses + weight * (convex - stresses), shift)
        if found is not None or weight >= 1.0:
            break
        weight = min(1.0, weight + _MORE) if weight > 0.0 else _FIRST
    if found is None:
        raise NoEquilibrium("the stiffness is singular")
    step, forces = found
    return step, -float((forces * step).sum()), weight


def _length(system: MembraneSystem, positions: Array, step: Array, gain: float) -> float:
    energy, length = system.energy(positions), 1.0
    if gain < 1e-13 * abs(energy):
        return length
    # a moved clamp may have turned some over, which the way down has to mend
    most = np.inf if system.folding else system.turned(positions)
    while length > _SHORTEST:
        trial = positions + length * step
        falls = system.energy(trial) <= energy - _ARMIJO * length * gain
        if falls and system.turned(trial) <= most:
            break
        length *= 0.5
    return length


# a step of Newton's below this share of the sample's size is the last one
_CLOSE = 1e-8
_ITERATIONS = 25
# the path of a descent is taken in so many parts
_PARTS = 8
# a step that moves a node by more than this share of the size has gone astray
_ASTRAY = 1.0


@dataclass(frozen=True)
class MembranePose:
    """Changing data: positions (N, 2) m, stresses (M, Q, 4) Pa of the stiffness, tensions (S,) of
    the chains (N, times their scale), the iterations spent so far, and how often the pose had to
    be found by descent."""

    positions: Array
    stresses: Array
    tensions: Array
    iterations: int = 0
    descents: int = 0


class Statics:
    """Equilibria of one membrane.

    membrane: constant data. held: (N,) bool, nodes whose positions are prescribed. Unknowns are
    the coordinates of the others and the tensions of chains that are not held at both ends.
    folding: let elements turn over, as they do where a mesh locks. accuracy: share of its energy
    that a step of a descent must win to be followed by another.
    """

    def __init__(
        self, membrane: Membrane, held: Flags, *, folding: bool = False, accuracy: float = 1e-10
    ) -> None:
        self.system = MembraneSystem(membrane, held, folding=folding)
        self.membrane, self._accuracy = membrane, accuracy
        self._chains = membrane.chains[~held[membrane.chains].all(axis=1)]
        ends = membrane.points[self._chains]
        self._inverse = 1.0 / np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
        stiff = membrane.moduli.max() * membrane.volume.max() ** (1 / 3)
        self._scale = stiff / self._inverse.mean() if len(self._chains) else 1.0

    @property
    def unknowns(self) -> int:
        return len(self.system.free) + len(self._chains)

    def rest(self) -> MembranePose:
        """The undeformed pose."""
        shape = (*self.membrane.volume.shape, 4)
        return MembranePose(
            self.membrane.points.copy(), np.zeros(shape), np.zeros(len(self._chains))
        )

    def forces(self, pose: MembranePose) -> Array:
        """(N, 2) N, on the nodes: on held ones, what holds them; on free ones, the residual."""
        forces = self.system.assembled(pose.positions, pose.stresses)[1]
        if len(self._chains):
            _, jacobian = self._chain(pose)
            forces += (jacobian.T @ pose.tensions).reshape(-1, 2)
        return forces

    def move(self, pose: MembranePose, target: Array) -> MembranePose:
        """Equilibrium with the held nodes at target (N, 2) m; other entries are not read.

        Raises NoEquilibrium.
        """
        try:
            return self._halved(pose, target, 5 if len(self._chains) else 1)
        except NoEquilibrium:
            if len(self._chains):
                raise
        start = pose.positions
        for part in range(1, _PARTS + 1):
            pose = self.descend(pose, start + part / _PARTS * (target - start))
        return pose

    def descend(self, pose: MembranePose, target: Array) -> MembranePose:
        """As move, downhill all the way, so that the equilibrium is stable; without chains."""
        shift = np.where(self.system.held[:, None], target - pose.positions, 0.0)
        found = descend(self.system, pose.positions, shift, self._accuracy)
        if found is None:
            raise NoEquilibrium("the energy falls without coming to rest")
        positions, spent = found
        self._check(positions)
        return replace(
            pose,
            positions=positions,
            stresses=self.system.stresses(positions),
            iterations=pose.iterations + spent,
            descents=pose.descents + 1,
        )

    def _halved(self, pose: MembranePose, target: Array, halvings: int) -> MembranePose:
        try:
            shift = np.where(self.system.held[:, None], target - pose.positions, 0.0)
            last = np.inf
            for iteration in range(_ITERATIONS):
                step, tensions = self._step(pose, shift)
                size = float(np.abs(step).max()) / self.system.size
                if not size < _ASTRAY:
                    raise NoEquilibrium("the iterations diverge")
                positions = pose.positions + step
                stresses = self.system.predicted_stresses(pose.positions, step)
                moved = replace(pose, positions=positions, stresses=stresses)
                pose = replace(moved, tensions=tensions, iterations=pose.iterations + 1)
                if iteration and size < _CLOSE and last < 1e3 * _CLOSE:
                    self._check(pose.positions)
                    return pose
                shift, last = np.zeros_like(shift), size
            raise NoEquilibrium(f"no convergence in {_ITERATIONS} iterations")
        except NoEquilibrium:
            if halvings == 0:
                raise
        half = 0.5 * (pose.positions + target)
        return self._halved(self._halved(pose, half, halvings - 1), target, halvings - 1)

    def _step(self, pose: MembranePose, shift: Array) -> tuple[Array, Array]:
        _, forces, stiffness = self.system.assembled(pose.positions, pose.stresses)
        load = -forces.ravel() - self.system.matrix(stiffness) @ shift.ravel()
        step = shift.ravel().copy()
        if not len(self._chains):
            try:
                factor = factorised(self.system.inner(stiffness))
                step[self.system.free] = factor.solve(load[self.system.free])
            except RuntimeError as error:
                raise NoEquilibrium("the stiffness is singular") from error
            return step.reshape(-1, 2), pose.tensions
        return self._chained_step(pose, stiffness, load, step)

    def _chained_step(
        self, pose: MembranePose, stiffness: Array, load: Array, step: Array
    ) -> tuple[Array, Array]:
        excess, jacobian = self._chain(pose)
        inner = self.system.inner(stiffness) + self._tension_stiffness(pose)
        coupled = jacobian[:, self.system.free]
        system = bmat([[inner, coupled.T], [coupled, None]], format="csc")
        pulled = self._tension_stiffness(pose, whole=True) @ step
        right = np.concatenate([(load - pulled)[self.system.free], -excess - jacobian @ step])
        try:
            found = splu(system).solve(right)
        except RuntimeError as error:
            raise NoEquilibrium("the constraints contradict each other") from error
        count = len(self.system.free)
        step[self.system.free] = found[:count]
        return step.reshape(-1, 2), found[count:]

    def _chain(self, pose: MembranePose) -> tuple[Array, csr_matrix]:
        count = len(self._chains)
        excess, table = np.zeros(count), np.zeros((count, 4))
        line, ends = np.zeros(6), np.zeros((2, 3))
        chain_system(pose.positions, self._chains, self._inverse, line, ends, excess, table)
        rows = np.repeat(np.arange(count), 4)
        columns = (2 * self._chains[:, [0, 0, 1, 1]] + [0, 1, 0, 1]).ravel()
        shape = (count, 2 * len(self.membrane.points))
        jacobian = csr_matrix((self._scale * table.ravel(), (rows, columns)), shape)
        return self._scale * excess, jacobian

    def _tension_stiffness(self, pose: MembranePose, whole: bool = False) -> csc_matrix:
        """Second variation of the tensions: t / s^2 |dx_1 - dx_0|^2."""
        value = self._scale * pose.tensions * self._inverse**2
        a, b = self._chains.T
        size = 2 * len(self.membrane.points)
        parts = [
            (sign * value, (2 * i + axis, 2 * j + axis))
            for axis in range(2)
            for sign, i, j in ((1.0, a, a), (1.0, b, b), (-1.0, a, b), (-1.0, b, a))
        ]
        values = np.concatenate([each[0] for each in parts])
        rows = np.concatenate([each[1][0] for each in parts])
        columns = np.concatenate([each[1][1] for each in parts])
        matrix = csc_matrix((values, (rows, columns)), (size, size))
        return matrix if whole else matrix[self.system.free][:, self.system.free]

    def _check(self, positions: Array) -> None:
        areas = self.system.areas(positions).min(axis=1)
        if areas.min() > 0.0 or self.system.folding:
            return
        worst = self.membrane.nodes[areas.argmin()]
        x, y = 1e3 * self.membrane.points[worst].mean(axis=0)
        reason = f"elements are turned over, the most at x {x:.3g}, y {y:.3g} mm"
        advice = "" if self.membrane.guard else " (a compression guard keeps barbs apart)"
        raise NoEquilibrium(reason + advice)
