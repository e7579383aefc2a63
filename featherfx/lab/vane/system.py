"""The elastic system of a plane membrane some of whose nodes are held: energy, forces, steps."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csc_matrix
from scipy.sparse.linalg import SuperLU, splu

from featherfx.lab.vane.elements import Membrane
from featherfx.lab.vane.sample_kernels import (
    Elements,
    predicted_strains,
    sample_strains,
    sample_system,
)

Array = NDArray[np.float64]
Bools = NDArray[np.bool_]

UNIT = np.array([1.0, 0.0, 1.0])


class Pattern:
    """Pairs of coordinates that elements couple. nodes: (M, K). free: (2 N,) coordinates."""

    def __init__(self, nodes: NDArray[np.int64], free: Bools) -> None:
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
        """Of all coordinates."""
        return csc_matrix((values, self._rows, self._starts), (self._size, self._size))

    def inner(self, values: Array) -> csc_matrix:
        """Of the free coordinates."""
        count = len(self._inner_starts) - 1
        data = (values[self._inside], self._inner_rows, self._inner_starts)
        return csc_matrix(data, (count, count))


def _starts(columns: NDArray[np.int64], size: int) -> NDArray[np.int64]:
    return np.concatenate([[0], np.cumsum(np.bincount(columns, minlength=size))])


def factorised(matrix: csc_matrix) -> SuperLU:
    """Without pivoting, which a definite matrix does not need; the order of least fill."""
    return splu(
        matrix,
        permc_spec="MMD_AT_PLUS_A",
        diag_pivot_thresh=0.0,
        options={"SymmetricMode": True},
    )


class MembraneSystem:
    """membrane: constant data. held: (N,) bool, nodes whose positions are prescribed. size: m, of
    the sample. folding: let elements turn over, as they do where a mesh locks."""

    def __init__(self, membrane: Membrane, held: Bools, *, folding: bool = False) -> None:
        self.membrane, self.held, self.folding = membrane, held, folding
        self.size = float(np.ptp(membrane.points, axis=0).max())
        is_free = np.repeat(~held, 2)
        self.free = np.flatnonzero(is_free)
        self.pattern = Pattern(membrane.nodes, is_free)
        self._elements = Elements(
            *(membrane.nodes, membrane.along, membrane.across, membrane.volume, membrane.moduli)
        )
        count = membrane.nodes.shape[1]
        self._scratch = (*_scratch(), np.zeros(3), np.zeros((2 * count, 3)))
        self._blocks = np.zeros((len(membrane.nodes), 2 * count, 2 * count))

    def strains(self, positions: Array) -> Array:
        """(M, Q, 3) e_vv, e_ww, 2 e_vw at positions (N, 2)."""
        strain = np.zeros((*self.membrane.volume.shape, 3))
        sample_strains(positions, self._elements, UNIT, np.zeros((3, 3)), strain)
        return strain

    def stresses(self, positions: Array) -> Array:
        """(M, Q, 3) Pa, vv, ww, vw at positions (N, 2)."""
        return self.strains(positions) * self.membrane.moduli[:, None]

    def energy(self, positions: Array) -> float:
        """J."""
        return self.assembled(positions, np.zeros((*self.membrane.volume.shape, 3)))[0]

    def upright(self, positions: Array) -> bool:
        """Whether no element is turned over at positions (N, 2), or may be."""
        return self.folding or self.turned(positions) == 0

    def turned(self, positions: Array) -> int:
        """How many strain points are turned over at positions (N, 2)."""
        images = [
            np.einsum("mqk,mkx->mqx", each, positions[self.membrane.nodes])
            for each in (self.membrane.along, self.membrane.across)
        ]
        area = images[0][..., 0] * images[1][..., 1] - images[0][..., 1] * images[1][..., 0]
        return int((area <= 0.0).sum())

    def assembled(self, positions: Array, stresses: Array) -> tuple[float, Array, Array]:
        """Energy (J), forces (N, 2) N and the values of the pattern's pairs.

        stresses: (M, Q, 3) Pa, of the stiffness.
        """
        forces = np.zeros_like(positions)
        energy = sample_system(
            *(positions, self._elements, stresses, UNIT, self._scratch, forces, self._blocks)
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
        """(M, Q, 3) Pa after a step (N, 2), to first order."""
        strain = np.zeros((*self.membrane.volume.shape, 3))
        predicted_strains(positions, step, self._elements, UNIT, _scratch(), strain)
        return strain * self.membrane.moduli[:, None]

    def solve(self, positions: Array, stresses: Array, shift: Array) -> tuple[Array, Array] | None:
        """Newton's step (N, 2) and the forces (N, 2), N, without chains; None if not definite.

        stresses: (M, Q, 3) Pa, of the stiffness. shift: (N, 2) m, of the held nodes.
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
