"""A membrane of fibres of all directions, each of which hardens, yields and breaks.

    w = a (exp[b (I - 3)] - 1),   I = C + 2 / sqrt(C)                     elastic, per volume
    s(C) = 2 a b exp[b (I - 3)] (1 - C^(-3/2))                            its stress, 2 dw/dC
    S_ij = 1/Q int s(C_f) n_i n_j R(t) dt,   C_f = n.C n,  n = (cos t, sin t)

C is the square of a fibre's stretch; fibres are incompressible. Beyond the critical C_c its stress
stays s(C_c); unloaded, it falls by the slope of the elastic law; at the release C_r it breaks. R is
a normal distribution of fibres about the mean direction, cut at a right angle to either side, Q its
integral. Source: Jacquemoud 2007, eq. 4-15, 4-27 to 4-31, 4-38 and 4-83; in her eq. 4-25
the exponent 3/2 has the wrong sign, in 4-27 the right one (here -3/2 follows from w by S_22 = 0).
Unloading is that of her section 4.4.2.

A square of it between two clamps that slide sideways is pulled until it tears (`lab rupture`;
sections 4.5 and 4.6). Bilinear elements with 2 x 2 points, in Green-Lagrange strain. The clamps
hold the specimen's height and let its width go. Force and displacement both fall back where it
tears, so neither is given: a step goes a given length in the space of all displacements (Crisfield
1991, cylindrical and linearised as in section 4.5.2), and the clamp's way is an unknown.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import product
from math import pi
from typing import Any

import numpy as np
from scipy.linalg import LinAlgError, solve

from featherfx.algebra.types import Array, Indices
from featherfx.errors import Problem, require
from featherfx.lab.declare import POSITIVE, Range, out_of_range, value

# fitted to the test RHD14 of human skin (section 4.5.1.2)
_STIFFNESS, _EXPONENT = 0.5289e6, 14.1395


@dataclass(frozen=True)
class Fibre:
    """critical, release: C_c and C_r, squares of stretches. stiffness: a, Pa. exponent: b."""

    critical: float
    release: float
    stiffness: float = _STIFFNESS
    exponent: float = _EXPONENT

    @property
    def plateau(self) -> float:
        """Stress between C_c and C_r, Pa."""
        return float(self.elastic(np.array(self.critical))[0])

    def elastic(self, square: Array) -> tuple[Array, Array]:
        """s (Pa) and ds/dC of squares of stretches, of any shape."""
        a, b = self.stiffness, self.exponent
        turned = 1.0 - square**-1.5
        growth = a * b * np.exp(b * (square + 2.0 / np.sqrt(square) - 3.0))
        return 2.0 * growth * turned, growth * (2.0 * b * turned**2 + 3.0 * square**-2.5)

    def response(self, square: Array, largest: Array) -> tuple[Array, Array]:
        """Stress (Pa) and its slope; largest: C that the fibre has seen, this one included."""
        stress, slope = self.elastic(square)
        slipped = largest > self.critical
        stress[slipped] -= self.elastic(largest[slipped])[0] - self.plateau
        slope[slipped & (square >= largest)] = 0.0
        whole = largest < self.release
        return np.where(whole, stress, 0.0), np.where(whole, slope, 0.0)


@dataclass(frozen=True)
class Directions:
    """T fibres by direction at each of G points.

    weight: (G, T), R dt / Q; sums to one. parts: (G, T, 3), those of S_11, S_22 and S_12 in a
    fibre's stress, which are those of E_11, E_22 and 2 E_12 in its strain, too.
    """

    weight: Array
    parts: Array


def directions(mean: Array, deviation: float, count: int) -> Directions:
    """T = count fibres at each of G points; mean: (G,) rad, deviation: rad, of R."""
    offset = (np.arange(count) + 0.5) * (np.pi / count) - 0.5 * np.pi
    weight = np.exp(-0.5 * (offset / deviation) ** 2)
    angle = mean[:, None] + offset
    cosine, sine = np.cos(angle), np.sin(angle)
    parts = np.stack([cosine**2, sine**2, cosine * sine], axis=-1)
    return Directions(np.broadcast_to(weight / weight.sum(), angle.shape), parts)


@dataclass(frozen=True)
class MembraneResponse:
    """stress: (G, 3) Pa, (S_11, S_22, S_12). tangent: (G, 3, 3) Pa, by (E_11, E_22, 2 E_12).
    largest: (G, T), C of every fibre's past. intact: (G,) share of fibres that are whole."""

    stress: Array
    tangent: Array
    largest: Array
    intact: Array


def membrane_response(
    fibre: Fibre, fibres: Directions, strain: Array, largest: Array
) -> MembraneResponse:
    """The membrane under strain (G, 3), Green-Lagrange (E_11, E_22, 2 E_12).

    largest: (G, T), 1 at first. Nothing that is given is changed.
    """
    square = 1.0 + 2.0 * np.einsum("gtk,gk->gt", fibres.parts, strain)
    seen = np.maximum(largest, square)
    stress, slope = fibre.response(square, seen)
    by_direction = np.swapaxes(fibres.parts, 1, 2)
    stiff = by_direction * (slope * fibres.weight)[:, None]
    return MembraneResponse(
        stress=(by_direction @ (stress * fibres.weight)[..., None])[..., 0],
        tangent=2.0 * (stiff @ fibres.parts),
        largest=seen,
        intact=np.sum(fibres.weight, axis=1, where=seen < fibre.release),
    )


_GAUSS = 1.0 / np.sqrt(3.0)
_ITERATIONS, _TOLERANCE = 30, 1e-7
# a step that does not converge is cut in two, this often
_CUTS = 8


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
        at = _GAUSS * signs
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
    also ends where no equilibrium is found within a step cut _CUTS times. Where fibres break and
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
        for final, cut in product((False, True), range(_CUTS)):
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
            [0.5 * (square[..., 0, 0] - 1.0), 0.5 * (square[..., 1, 1] - 1.0), square[..., 0, 1]],
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
        for _ in range(_ITERATIONS):
            moved = start + (self.map @ change).reshape(-1, 2)
            force, matrix = self.forces(moved, largest)
            if final:
                broken = self.largest >= self.specimen.fibre.release
                largest = np.where(broken, self.largest, largest)
            scale = np.abs(force).max() + 1e-12
            miss = np.append(-force[:-1], length**2 - first @ change)
            if np.abs(miss[:-1]).max() < _TOLERANCE * scale and abs(miss[-1]) < 1e-9 * length**2:
                return moved
            try:
                change = change + solve(np.vstack([matrix[:-1], first]), miss)
            except LinAlgError:
                return None
        return None

    def result(self, moved: Array, largest: Array) -> Pulled:
        """Return the state after a step."""
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


# rows and columns of the specimens of section 4.5; of the 24 elements only the number is printed
_SHAPES = {1: (1, 1), 9: (3, 3), 24: (6, 4)}
# weak elements, counted from 1 along the rows from the fixed clamp: figure 4-12, appendix 8
_WEAK = {9: (6, 5), 24: (12, 11)}
# (C_c, C_r) of the sections with narrow (4.5) and with wide (4.6) distributions of fibres
_NARROW, _WIDE = (1.36, 1.41), (1.34, 1.44)
_FURTHEST = 0.3


@dataclass(frozen=True)
class RuptureTest:
    """Pull a square of fibrous membrane (skin) until its fibres break, past the peak."""

    elements: int = value("Elements: 1, 9 or 24.", 1)
    sigma: float = value(
        "rad, deviation of the fibres' directions.", pi / 2, Range(0.01, 100.0, unit="rad")
    )
    mu: float = value(
        "rad, main direction of the fibres; pi/2: along the pull.", pi / 2, Range(-10, 10)
    )
    critical: float | None = value(
        "Square of the stretch at which a fibre yields; without: 1.36 for a sigma up to 1, else "
        "1.34, as published.",
        None,
        Range(1.0, 4.0, above=True),
    )
    release: float | None = value(
        "Square of the stretch at which it breaks; without: 1.41 or 1.44.",
        None,
        Range(1.0, 4.0, above=True),
    )
    stiffness: float = value("Pa, of the fibres (a).", _STIFFNESS, POSITIVE)
    exponent: float = value("Exponent of the fibres (b).", _EXPONENT, Range(0.0, 100.0, above=True))
    weak: int = value("Elements with another main direction, 0 to 2.", 0, Range(0, 2))
    weak_mu: float = value("rad, their main direction.", pi / 3, Range(-10, 10))
    scatter: float = value(
        "rad, deviation of the main direction from element to element (published: 1.4).",
        0.0,
        Range(0.0, 10.0),
    )
    seed: int = value("Of the scatter.", 0, Range(0, 2**31))
    step: float = value(
        "m, in the space of all displacements (published: 5e-5 to 1e-4).", 5e-5, Range(1e-7, 1e-3)
    )
    fibres: int = value("Directions of fibres at each point.", 1571, Range(8, 20000))

    def fibre(self) -> Fibre:
        """The law of its fibres."""
        critical, release = _NARROW if self.sigma <= 1.0 else _WIDE
        return Fibre(
            critical if self.critical is None else self.critical,
            release if self.release is None else self.release,
            self.stiffness,
            self.exponent,
        )

    def means(self) -> np.ndarray:
        """(rows, columns) rad, main directions."""
        shape = _SHAPES[self.elements]
        rng = np.random.default_rng(self.seed)
        means = self.mu + self.scatter * rng.normal(size=shape)
        for number in _WEAK.get(self.elements, ())[: self.weak]:
            means.flat[number - 1] = self.weak_mu
        return means


@dataclass(frozen=True)
class Rupture:
    """path: equilibria, unloaded first. fibre: their law. weakest: element that lost most fibres
    at the end, counted from 1."""

    path: Sequence[Pulled]
    fibre: Fibre
    weakest: int

    @property
    def peak(self) -> Pulled:
        """The equilibrium of the largest stress."""
        return max(self.path, key=lambda each: each.stress)

    def as_json(self) -> dict[str, Any]:
        """Plain values by key, SI units."""
        return {
            "plateau_stress": self.fibre.plateau,
            "peak_stress": self.peak.stress,
            "strain_at_peak": self.peak.strain,
            "strain": [each.strain for each in self.path],
            "stress": [each.stress for each in self.path],
            "intact": [float(each.intact.mean()) for each in self.path],
            "weakest_element": self.weakest,
            "intact_at_end": self.path[-1].intact,
        }


def run_rupture(test: RuptureTest) -> Rupture:
    """InputError for values out of range."""
    problems = out_of_range(test, "rupture")
    if test.elements not in _SHAPES:
        allowed = ", ".join(str(each) for each in _SHAPES)
        problems.append(
            Problem("rupture", "elements", f"{test.elements} is not allowed. Give {allowed}")
        )
    elif test.weak > 0 and test.elements not in _WEAK:
        problems.append(Problem("rupture", "weak", "one element alone has no weaker neighbour"))
    fibre = test.fibre()
    if not problems and fibre.release < fibre.critical:
        text = f"{fibre.release:g} is not allowed. Give {fibre.critical:g} (critical) or more"
        problems.append(Problem("rupture", "release", text))
    require(*problems)
    specimen = Specimen(fibre, test.means(), test.sigma, fibres=test.fibres)
    path = list(pull(specimen, test.step, _FURTHEST))
    return Rupture(path, fibre, int(np.argmin(path[-1].intact)) + 1)
