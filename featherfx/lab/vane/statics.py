"""Equilibrium of a plane membrane whose clamped nodes are moved.

Newton's iterations with the exact stiffness; the stresses in it are predicted to first order from
the iteration before, which keeps full steps convergent at any ratio of moduli (see
sample_kernels.py). Barbs of constant length are held by multipliers, one for each segment:

    [ K + sum t d2e   J^T ] [ du ]     [ g ]
    [ J               0   ] [ t  ] = - [ e ],      e = (|d|^2 / s^2 - 1) / 2,   J = de

with t the new tensions. A moved clamp enters as a linear prediction first. Where the iterations do
not converge, its path is halved; where that does not help, descent.py finds a minimum.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import bmat, csc_matrix, csr_matrix
from scipy.sparse.linalg import splu

from featherfx.lab.vane.chain_kernels import chain_system
from featherfx.lab.vane.descent import NoEquilibrium, descend
from featherfx.lab.vane.elements import Membrane
from featherfx.lab.vane.system import MembraneSystem, factorised

Array = NDArray[np.float64]
Bools = NDArray[np.bool_]

# a step of Newton's below this share of the sample's size is the last one
CLOSE = 1e-8
ITERATIONS = 25
# the path of a descent is taken in so many parts
PARTS = 8
# a step that moves a node by more than this share of the size has gone astray
ASTRAY = 1.0


@dataclass(frozen=True)
class MembranePose:
    """Changing data: positions (N, 2) m, stresses (M, Q, 3) Pa of the stiffness, tensions (S,) of
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
    that a step of a descent must win to be followed by another. textbook: Newton's iterations take
    the stresses of the pose itself, which is kept as a measure.
    """

    def __init__(
        self,
        membrane: Membrane,
        held: Bools,
        *,
        folding: bool = False,
        accuracy: float = 1e-10,
        textbook: bool = False,
    ) -> None:
        self._textbook = textbook
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
        shape = (*self.membrane.volume.shape, 3)
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
        for part in range(1, PARTS + 1):
            pose = self.descend(pose, start + part / PARTS * (target - start))
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
            return self._newton(pose, target)
        except NoEquilibrium:
            if halvings == 0:
                raise
        half = 0.5 * (pose.positions + target)
        return self._halved(self._halved(pose, half, halvings - 1), target, halvings - 1)

    def _newton(self, pose: MembranePose, target: Array) -> MembranePose:
        shift = np.where(self.system.held[:, None], target - pose.positions, 0.0)
        last = np.inf
        for iteration in range(ITERATIONS):
            step, tensions = self._step(pose, shift)
            size = float(np.abs(step).max()) / self.system.size
            if not size < ASTRAY:
                raise NoEquilibrium("the iterations diverge")
            positions = pose.positions + step
            stresses = (
                self.system.stresses(positions)
                if self._textbook
                else self.system.predicted_stresses(pose.positions, step)
            )
            moved = replace(pose, positions=positions, stresses=stresses)
            pose = replace(moved, tensions=tensions, iterations=pose.iterations + 1)
            if iteration and size < CLOSE and last < 1e3 * CLOSE:
                self._check(pose.positions)
                return pose
            shift, last = np.zeros_like(shift), size
        raise NoEquilibrium(f"no convergence in {ITERATIONS} iterations")

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
        if not self.system.upright(positions):
            raise NoEquilibrium("elements are turned over")
