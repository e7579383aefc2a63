"""A square of fibre membrane between two clamps that slide sideways, pulled until it tears.

Bilinear elements with 2 x 2 points, in Green-Lagrange strain. The clamps hold the specimen's height
and let its width go. Force and displacement both fall back where it tears, so neither is given: a
step goes a given length in the space of all displacements (Crisfield 1991, cylindrical and
linearised as in Jacquemoud 2007, section 4.5.2), and the clamp's way is an unknown.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import LinAlgError, solve

from featherfx.lab.fibres.law import Directions, Fibre, directions, membrane_response

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

GAUSS = 1.0 / np.sqrt(3.0)
ITERATIONS, TOLERANCE = 30, 1e-7
# a step that does not converge is cut in two, this often
CUTS = 8


@dataclass(frozen=True)
class Specimen:
    """size, thickness: m. mean: (rows, columns) rad, main direction of the fibres of each element,
    pi/2 along the pull. deviation: rad, of the directions. fibres: directions to count."""

    fibre: Fibre
    mean: Array
    deviation: float
    size: float = 10e-3
    thickness: float = 1e-3
    fibres: int = 3142


@dataclass(frozen=True)
class Pulled:
    """A specimen in equilibrium. moved: (rows + 1, columns + 1, 2) m. force: N, of a clamp.
    strain: E_22 by the clamp's way, stress: Pa, mean second Piola-Kirchhoff stress S_22 by force,
    way and first section. intact: (rows, columns) mean share of whole fibres. strains, stresses:
    (rows, columns, 3), means of the elements, (11, 22, 12), engineering shear."""

    moved: Array
    force: float
    strain: float
    stress: float
    intact: Array
    strains: Array
    stresses: Array


class _Mesh:
    """Elements of a specimen: nodes (K, 4), slopes (4, K, 4, 2) 1/m of the shape functions at the
    points, weight: m^3 of each point, fibres: Directions of 4 K points."""

    def __init__(self, specimen: Specimen) -> None:
        rows, columns = specimen.mean.shape
        number = np.arange((rows + 1) * (columns + 1)).reshape(rows + 1, columns + 1)
        corners = number[:-1, :-1], number[:-1, 1:], number[1:, 1:], number[1:, :-1]
        self.nodes: Indices = np.stack([each.ravel() for each in corners], axis=1)
        self.bottom, self.top = number[0], number[-1]
        wide, high = specimen.size / columns, specimen.size / rows
        signs = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]], dtype=float)
        at = GAUSS * signs
        self.slopes: Array = np.stack(
            [
                np.stack(
                    [
                        0.5 / wide * signs[:, 0] * (1.0 + y * signs[:, 1]),
                        0.5 / high * signs[:, 1] * (1.0 + x * signs[:, 0]),
                    ],
                    axis=1,
                )
                for x, y in at
            ]
        )
        self.weight = 0.25 * wide * high * specimen.thickness
        means = np.repeat(specimen.mean.ravel(), 4)
        self.fibres: Directions = directions(means, specimen.deviation, specimen.fibres)
        self.count = number.size


def pull(specimen: Specimen, step: float, furthest: float) -> Iterator[Pulled]:
    """Equilibria along the path, unloaded first.

    step: m, length of a step in the space of all displacements. furthest: E_22 at which it ends; it
    also ends where no equilibrium is found within a step cut CUTS times. Where fibres break and
    hold in turns from iteration to iteration, the step is tried with what broke once left broken.
    """
    mesh = _Mesh(specimen)
    moved = np.zeros((mesh.count, 2))
    largest: Array = np.ones(mesh.fibres.weight.shape)
    system = _System(specimen, mesh)
    direction = np.zeros(system.unknowns)
    direction[-1] = 1.0
    yield system.result(moved, largest)
    while True:
        found = None
        for final, cut in product((False, True), range(CUTS)):
            found = system.step(moved, largest, step * 0.5**cut, direction, final=final)
            if found is not None:
                break
        if found is None:
            return
        direction = system.unknowns_of(found - moved)
        moved, largest = found, system.largest
        state = system.result(moved, largest)
        yield state
        if state.strain >= furthest:
            return


class _System:
    """Equations of a specimen: free displacements, then the clamp's way."""

    def __init__(self, specimen: Specimen, mesh: _Mesh) -> None:
        self.specimen, self.mesh = specimen, mesh
        size = 2 * mesh.count
        place = np.arange(size).reshape(-1, 2)
        held = np.zeros(size, dtype=bool)
        held[place[mesh.bottom, 1]] = True
        held[place[mesh.top, 1]] = True
        held[place[mesh.bottom[0], 0]] = True
        free = np.flatnonzero(~held)
        self.unknowns = len(free) + 1
        # displacements of all nodes from the unknowns
        self.map = np.zeros((size, self.unknowns))
        self.map[free, np.arange(len(free))] = 1.0
        self.map[place[mesh.top, 1], -1] = 1.0
        self.largest: Array = np.zeros(0)

    def unknowns_of(self, moved: Array) -> Array:
        """Unknowns of displacements (nodes, 2) that the clamps allow."""
        unknowns = moved.ravel() @ self.map
        unknowns[-1] = moved[self.mesh.top[0], 1]
        return unknowns

    def forces(self, moved: Array, largest: Array) -> tuple[Array, Array]:
        """Force by each unknown (the last is the clamp's) and matrix; sets what fibres have seen.

        moved: (nodes, 2) m. largest: C of the fibres after the last step.
        """
        mesh = self.mesh
        local = moved[mesh.nodes]
        gradient = np.einsum("eni,gnj->egij", local, mesh.slopes) + np.eye(2)
        square = np.einsum("egki,egkj->egij", gradient, gradient)
        strain = np.stack(
            [
                0.5 * (square[..., 0, 0] - 1.0),
                0.5 * (square[..., 1, 1] - 1.0),
                square[..., 0, 1],
            ],
            axis=-1,
        )
        found = membrane_response(self.specimen.fibre, mesh.fibres, strain.reshape(-1, 3), largest)
        self.largest, self.found, self.strain = found.largest, found, strain
        stress = found.stress.reshape(strain.shape)
        tangent = found.tangent.reshape(*strain.shape, 3)
        # dE of each displacement of the element: (e, g, 3, node, axis)
        by = np.stack(
            [
                np.einsum("gn,egi->egni", mesh.slopes[..., 0], gradient[..., 0]),
                np.einsum("gn,egi->egni", mesh.slopes[..., 1], gradient[..., 1]),
                np.einsum("gn,egi->egni", mesh.slopes[..., 0], gradient[..., 1])
                + np.einsum("gn,egi->egni", mesh.slopes[..., 1], gradient[..., 0]),
            ],
            axis=2,
        )
        by = by.reshape(*by.shape[:3], 8)
        force = mesh.weight * np.einsum("egk,egka->ea", stress, by)
        matrix = mesh.weight * np.einsum("egka,egkl,eglb->eab", by, tangent, by)
        tensor = stress[..., [0, 2, 2, 1]].reshape(*stress.shape[:2], 2, 2)
        lift = mesh.weight * np.einsum("gni,egij,gmj->enm", mesh.slopes, tensor, mesh.slopes)
        matrix += np.einsum("enm,ij->enimj", lift, np.eye(2)).reshape(-1, 8, 8)
        places = (2 * mesh.nodes[:, :, None] + np.arange(2)).reshape(-1, 8)
        total, whole = np.zeros(2 * mesh.count), np.zeros((2 * mesh.count, 2 * mesh.count))
        np.add.at(total, places, force)
        np.add.at(whole, (places[:, :, None], places[:, None, :]), matrix)
        return total @ self.map, self.map.T @ whole @ self.map

    def step(
        self, start: Array, largest: Array, length: float, direction: Array, *, final: bool
    ) -> Array | None:
        """Displacements of the next equilibrium, or None; direction: of the last step. final:
        whether fibres that an iteration breaks stay broken."""
        _, matrix = self.forces(start, largest)
        try:
            way = np.append(solve(matrix[:-1, :-1], -matrix[:-1, -1], assume_a="sym"), 1.0)
        except LinAlgError:
            return None
        first = way * (length / np.linalg.norm(way))
        first *= 1.0 if first @ direction >= 0.0 else -1.0
        change = first.copy()
        for _ in range(ITERATIONS):
            moved = start + (self.map @ change).reshape(-1, 2)
            force, matrix = self.forces(moved, largest)
            if final:
                broken = self.largest >= self.specimen.fibre.release
                largest = np.where(broken, self.largest, largest)
            scale = np.abs(force).max() + 1e-12
            miss = np.append(-force[:-1], length**2 - first @ change)
            if np.abs(miss[:-1]).max() < TOLERANCE * scale and abs(miss[-1]) < 1e-9 * length**2:
                return moved
            try:
                change = change + solve(np.vstack([matrix[:-1], first]), miss)
            except LinAlgError:
                return None
        return None

    def result(self, moved: Array, largest: Array) -> Pulled:
        """What a step has come to."""
        force, _ = self.forces(moved, largest)
        specimen, shape = self.specimen, self.specimen.mean.shape
        stretch = 1.0 + moved[self.mesh.top[0], 1] / specimen.size
        found = self.found
        return Pulled(
            moved=moved.reshape(shape[0] + 1, shape[1] + 1, 2),
            force=float(force[-1]),
            strain=float(0.5 * (stretch**2 - 1.0)),
            stress=float(force[-1] / (specimen.size * specimen.thickness * stretch)),
            intact=found.intact.reshape(*shape, 4).mean(axis=2),
            strains=self.strain.mean(axis=1).reshape(*shape, 3),
            stresses=found.stress.reshape(*shape, 4, 3).mean(axis=2),
        )
