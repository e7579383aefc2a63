"""Fibre networks in space: test networks with closed forms, elastic medium, time steps, random.

Direct and iterative solution, on lattices of growing size and on the matrix of a vane.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from itertools import product
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from scipy import sparse

from featherfx.algebra.types import Array
from featherfx.feather.build import build_feather
from featherfx.lab.feather import feather_kind
from featherfx.lab.networks.experiments import NetworkPlan, sheared_system
from featherfx.lab.networks.layouts import (
    FibreSection,
    Mikado,
    Sheared,
    SpaceMikado,
    linked_sheets,
    mikado,
    shear,
    space_mikado,
)
from featherfx.lab.networks.network import (
    FibreNetwork,
    HeldSystem,
    Method,
    Preconditioner,
    held_system,
    network_energy,
    solve,
    strung,
)
from featherfx.lab.nodal.model import nodal_model
from featherfx.lab.nodal.solver import NodalSolver, nodal_rest_state
from featherfx.lab.studies.study import (
    Comparisons,
    StudyResult,
    draw,
    independent,
    ourselves,
    published,
)
from featherfx.mechanics.batch import make_model
from featherfx.mechanics.model import no_loads
from featherfx.solver.solver import Settings
from featherfx.solver.step.banded_kernels import factorise, solve_factored
from featherfx.solver.types import panel_shape

_HOUGHTON = "Houghton 2020"


class _Small(NamedTuple):
    """A network whose last nodes are free, and its equations under a shear u_x = rate y."""

    network: FibreNetwork
    moved: Array
    system: HeldSystem

    def energy(self, free: Array) -> float:
        moved = self.moved.copy()
        moved.ravel()[self.system.free] = free
        return network_energy(self.network, moved)


def _sheared(
    places: Sequence[Sequence[float]],
    fibres: Sequence[Sequence[int]],
    free: int,
    stiffness: tuple[float, float],
    rate: float,
) -> _Small:
    """free: number of nodes at the end that are. stiffness: of stretching and bending."""
    points = np.array(places, dtype=float)
    network = strung(points, fibres, *stiffness)
    moved = np.zeros_like(points)
    moved[:, 0] = rate * points[:, 1]
    held = np.arange(len(points) - free)
    return _Small(network, moved, held_system(network, held, moved[held]))


def _solved(small: _Small) -> Array:
    return np.asarray(np.linalg.solve(small.system.matrix.toarray(), small.system.right))


# radius of fibres and shear of the tables, Young's modulus 1
def _section(radius: float) -> tuple[float, float]:
    return np.pi * radius**2, 0.25 * np.pi * radius**4


_TRIPOD = ((0.75, 0, 0.5), (0.25, 1, 0.5), (0.25, 0, 0.25), (0.25, 0, 0.75), (0.5, 0.5, 0.5))
# the lambda of equation 5.13 at two heights
_LAMBDA = ((1, 0, 0), (3, 0, 0), (1, 2, 0), (2, 1, 0))
# equation 6.34, for nodes e and j in turn
_TILTED = (0.00499928, 0.00140852, -0.00499968, -0.00304621, -0.00952402, 0.00413602)
# tables 6.5 and 6.6: stiffness of the medium, relative difference, energy without bending
_MEDIUM = (
    (1e-10, 1.013119e-9, 1.110721e-10),
    (1e-9, 1.012298e-7, 1.110721e-10),
    (1e-8, 1.004149e-5, 1.110732e-10),
    (1e-7, 9.277988e-4, 1.111751e-10),
    (1e-6, 4.818023e-2, 1.164236e-10),
)
# table 6.7: tolerance, steps, relative error of the energy, distance from the solution
_STEPS: tuple[tuple[float, int, float | None, float], ...] = (
    (1e-12, 41930, 4.049473e-9, 6.36355e-7),
    (1e-13, 52294, 4.049681e-11, 6.36371e-8),
    (1e-14, 62658, None, 6.36388e-9),
    (1e-15, 73022, None, 6.36405e-10),
    (1e-16, 83386, None, 6.36422e-11),
)
_STEP, _RATE = 100.0, 1e-2


def small(folder: Path) -> StudyResult:
    """Tripod, lambda networks alone and linked, in a medium, and by steps of pseudo-time."""
    rows = Comparisons()
    for mu, kappa in ((1.0, 0.02), (3e-4, 8e-9)):
        found = _solved(_sheared(_TRIPOD, ((0, 4, 1), (2, 4), (3, 4)), 1, (mu, kappa), 1.0))
        source = published(f"{_HOUGHTON}, equation 6.24")
        # equation 6.24
        r5, r6, r30 = np.sqrt([5.0, 6.0, 30.0])
        last = (125 * r5 + 150 * r6) * mu**2
        top = (36864 * r6 + 110592 * r5) * kappa**2 + (5520 * r5 + 8280 * r6) * kappa * mu + last
        below = (13824 * r6 + 55296 * r5) * kappa**2 + (2610 * r5 + 5880 * r6) * kappa * mu + last
        aside = r30 * (48 * kappa + 5 * mu) / ((144 * r30 + 2880) * kappa + 40 * r30 * mu)
        for axis, printed in zip("xy", (float(top / (4 * below)), float(-aside)), strict=True):
            text = f"tripod's node along {axis} over the shear, mu {mu:g}, kappa {kappa:g}"
            rows.compare(text, found["xy".index(axis)], printed, 1e-9, source)
    rows += _layered()
    rows += _medium()
    return StudyResult(rows)


def _layered() -> Comparisons:
    mu, kappa = _section(1e-2)
    rows = Comparisons()
    for name, second, end in (
        ("parallel", (2.0, 1.0, 0.6), (1.0, 2.0, 0.6)),
        ("turned", (2.625, 0.75, 0.6), (2.0, 2.0, 0.6)),
    ):
        ends = [(1, 0, 0.4), (3, 0, 0.4), (1, 2, 0.4), (1, 0, 0.6), (3, 0, 0.6), end]
        fibres = ((0, 6), (1, 6, 2), (3, 7), (4, 7, 5), (6, 7))
        linked = _sheared([*ends, (2, 1, 0.4), second], fibres, 2, (mu, kappa), 1e-2)
        found = _solved(linked).reshape(2, 3).T
        if name == "parallel":
            half = 0.5e-2 / (2.0 * kappa + mu)
            printed = np.repeat([half * (4.0 * kappa + mu), -half * mu, 0.0], 2)
        else:
            printed = np.array(_TILTED)
        source = published(f"{_HOUGHTON}, equation {6.31 if name == 'parallel' else 6.34}")
        text = f"two linked lambda networks, {name}: largest difference of a displacement"
        gap = float(np.abs(found.ravel() - printed).max())
        rows.bound(text, gap, source, at_most=1e-8, unit="m", note="of 5 mm")
    return rows


def _medium() -> Comparisons:
    """The lambda network in space: tables 6.5 to 6.8."""
    mu, kappa = _section(1e-3)
    rows = Comparisons()
    whole, springs = (
        _sheared(_LAMBDA, ((0, 3), (1, 3, 2)), 1, (mu, bend), _RATE) for bend in (kappa, 0.0)
    )
    affine = whole.moved[-1]
    exact = _solved(whole)
    least = whole.energy(exact)
    for medium, more, energy in _MEDIUM:
        found = []
        for each in (whole, springs):
            matrix = each.system.matrix.toarray() + medium * np.eye(3)
            found.append(each.energy(np.linalg.solve(matrix, each.system.right + medium * affine)))
        text = f"energy in a medium of {medium:g} N/m"
        source = published(f"{_HOUGHTON}, table 6.5")
        rows.compare(f"{text}, change", found[0] / least - 1.0, more, 1e-4, source)
        source = published(f"{_HOUGHTON}, table 6.6")
        rows.compare(f"{text}, without bending", found[1], energy, 1e-6, source, unit="J")
    matrix, right = whole.system.matrix.toarray(), whole.system.right
    moved, count = affine.copy(), 0
    for tolerance, steps, change, distance in _STEPS:
        while np.abs(force := right - matrix @ moved).max() >= tolerance:
            moved, count = moved + _STEP * force, count + 1
        source = published(f"{_HOUGHTON}, table 6.7")
        text = f"steps of pseudo-time to a force of {tolerance:g} N"
        rows.compare(text, count, steps, 0.0, source)
        if change is not None:
            text = f"change of the energy after {steps} steps"
            rows.compare(text, whole.energy(moved) / least - 1.0, change, 1e-3, source)
        gap = float(np.linalg.norm(moved - exact))
        text = f"distance from the solution after {steps} steps"
        rows.compare(text, gap, distance, 1e-3, source, unit="m")
    rows.compare(
        "energy without bending",
        springs.energy(np.linalg.lstsq(springs.system.matrix.toarray(), springs.system.right)[0]),
        1.1107207e-10,
        1e-7,
        published(f"{_HOUGHTON}, table 6.8"),
        unit="J",
    )
    return rows


# table 6.3, 2000 fibres: energy over that of affine nodes, its standard error of nine, share of
# bending in it; fibres and seeds of ours
_TABLE_6_3, _CUBE, _CUBES = (4.57e-3, 1.34e-4, 4.39e-3 / 4.57e-3), 2000, 2
# m; the distance below which fibres are coupled is not printed: this one gives the energy
_COUPLED, _MERGED = 9e-3, 2e-3
# section 6.3: radius and length of fibres, and the printed exponent of figure 6.25 and its error
_SHEET_RADIUS, _SHEET_LENGTH, _EXPONENT = 1.996e-3, 0.5, (2.007796, 6.66698e-3)
_SHEETS, _ASIDE = 3, 0.05
_DIRECTIONS = {"xy": (0, 1), "yz": (1, 2), "xz": (0, 2)}


def random(folder: Path) -> StudyResult:
    """Random networks in a cube, and layers of random sheets."""
    rows = Comparisons()
    rows += _cube()
    rows += _sheets()
    return StudyResult(rows)


def _gradient(i: int, j: int) -> Array:
    gradient = np.zeros((3, 3))
    gradient[i, j] = _RATE
    return gradient


def _cube() -> Comparisons:
    section = FibreSection(*_section(1e-3))
    plans = [SpaceMikado(_CUBE, _COUPLED, merge=_MERGED, seed=seed) for seed in range(_CUBES)]
    found = [shear(space_mikado(each, section), _gradient(0, 1)) for each in plans]
    printed, error, bent = _TABLE_6_3
    rows = Comparisons()
    rows.compare(
        f"energy over affine, {_CUBE} random fibres in a cube",
        float(np.mean([each.energy / each.affine for each in found])),
        printed,
        3.0 * error * float(np.sqrt(1.0 + 9.0 / _CUBES)),
        ourselves(f"{_HOUGHTON}, table 6.3, to which the distance of coupling was chosen"),
        absolute=True,
        note=f"fibres nearer than {_COUPLED:g} m are coupled, which is not printed",
    )
    text = "share of bending in it"
    source = published(f"{_HOUGHTON}, table 6.3")
    rows.compare(
        text, float(np.mean([each.bend / each.energy for each in found])), bent, 0.03, source
    )
    return rows


def _sheets() -> Comparisons:
    """Count the links that join two sheets, and compare their shear stiffnesses."""
    section = FibreSection(*_section(_SHEET_RADIUS))
    counts, links = (100, 150, 200, 300), []
    for count in counts:
        plan = Mikado(count, 1.0, _SHEET_LENGTH, periodic=False)
        links.append(int(linked_sheets(mikado(plan, section), 2, 0.2, _ASIDE).links.sum()))
    crossings = len(mikado(Mikado(2000, 2.0, _SHEET_LENGTH), section).places)
    density = 2000 * _SHEET_LENGTH / 4.0
    slope, error = _power(counts, links)
    note = "1-1 links of crossings that lie within 5 cm, the tolerance is not printed"
    allowed = 3.0 * float(np.hypot(error, _EXPONENT[1]))
    rows = Comparisons()
    text = "crossings of an area, over the square of the fibres' length in it"
    source = published(f"{_HOUGHTON}, equation 6.35")
    rows.compare(text, crossings / 4.0 / density**2, 1.0 / np.pi, 0.02, source)
    text = "power of the number of fibres with which links between sheets grow"
    source = published(f"{_HOUGHTON}, figure 6.25")
    rows.compare(text, slope, _EXPONENT[0], allowed, source, absolute=True, note=note)
    sheet = mikado(Mikado(150, 1.0, _SHEET_LENGTH, periodic=False), section)
    layout = linked_sheets(sheet, _SHEETS, 0.2, _ASIDE)
    found = {name: shear(layout, _gradient(*each)) for name, each in _DIRECTIONS.items()}
    energy = {name: each.energy for name, each in found.items()}
    words = published(f"{_HOUGHTON}, figures 6.16 and 6.17, in words")
    similar = published(f"{_HOUGHTON}, figure 6.24, in words")
    note = f"{_SHEETS} sheets of 150 fibres"
    linked = {name: each.links / each.energy for name, each in found.items()}
    text = "shear modulus in the sheets over that between them"
    rows.bound(text, energy["xy"] / max(energy["yz"], energy["xz"]), words, at_least=1.0, note=note)
    rows.compare("modulus yz over xz", energy["yz"] / energy["xz"], 1.0, 0.1, similar, note=note)
    rows.bound(
        "share of links in the energy, xz over xy", linked["xz"] / linked["xy"], words, at_least=1.0
    )
    rows.report("energy over affine, xy", energy["xy"] / found["xy"].affine)
    rows.report("energy over affine, xz", energy["xz"] / found["xz"].affine)
    return rows


def _power(counts: Sequence[int], found: Sequence[int]) -> tuple[float, float]:
    """Exponent of a power law, and its standard error."""
    (slope, _), covariance = np.polyfit(np.log(counts), np.log(found), 1, cov=True)
    return float(slope), float(np.sqrt(covariance[0, 0]))


# figures 6.26 to 6.28: fibres of a sheet and distances of sheets (m), ours as none are printed
_COUNTS, _APART = (100, 150, 200), (0.1, 0.2, 0.4)
_FRACTIONS: dict[str, Callable[[Sheared], float]] = {
    "links over sheets": lambda each: each.links / (each.energy - each.links),
    "bending over all": lambda each: each.bend / each.energy,
    "energy over affine": lambda each: each.energy / each.affine,
}


def contours(folder: Path) -> StudyResult:
    """Figures 6.26 to 6.28: shares of the energy of layers over density and distance of sheets."""
    section = FibreSection(*_section(_SHEET_RADIUS))
    found: dict[tuple[str, str], list[float]] = {}
    for count in _COUNTS:
        sheet = mikado(Mikado(count, 1.0, _SHEET_LENGTH, periodic=False), section)
        for apart in _APART:
            layout = linked_sheets(sheet, _SHEETS, apart, _ASIDE)
            for way in ("xy", "xz"):
                sheared = shear(layout, _gradient(*_DIRECTIONS[way]))
                for name, fraction in _FRACTIONS.items():
                    found.setdefault((name, way), []).append(fraction(sheared))
    grids = {key: np.reshape(each, (len(_COUNTS), len(_APART))) for key, each in found.items()}
    rows = Comparisons()
    for name, way, figure, grows in (
        ("links over sheets", "xy", "6.26", False),
        ("links over sheets", "xz", "6.26", True),
        ("energy over affine", "xz", "6.28", True),
    ):
        ratio = float(grids[name, way][-1, -1] / grids[name, way][0, 0])
        words = published(
            f"{_HOUGHTON}, figure {figure}, in words: {'grows' if grows else 'falls'}"
        )
        text = f"{name}, {way}, densest and farthest sheets over least and nearest"
        note = "" if grows else "sheets of fewer fibres, near where they lose hold, do not keep it"
        most, least = (None, 1.0) if grows else (1.0, None)
        rows.bound(text, ratio, words, at_most=most, at_least=least, note=note)
    none = published(f"{_HOUGHTON}, figures 6.19 and 6.20, in words: no dependence")
    for name in ("bending over all", "energy over affine"):
        last = grids[name, "xy"][-1]
        rows.compare(
            f"{name}, xy, farthest sheets over nearest", last[-1] / last[0], 1.0, 0.1, none
        )
    falls = published(f"{_HOUGHTON}, figure 6.20, in words: more stretching")
    last = grids["bending over all", "xz"][-1]
    text = "bending over all, xz, farthest sheets over nearest"
    rows.bound(text, float(last[-1] / last[0]), falls, at_most=1.0)

    def paint(canvas: Any) -> None:
        panels = canvas.subplots(len(_FRACTIONS), 2)
        for place, key in enumerate(product(_FRACTIONS, ("xy", "xz"))):
            axes = panels.flat[place]
            drawn = axes.contourf(_APART, _COUNTS, grids[key], levels=8, cmap="viridis")
            canvas.colorbar(drawn, ax=axes)
            axes.set_title(", ".join(key), fontsize=9)
            axes.set(xlabel="distance of sheets, m", ylabel="fibres of a sheet")

    caption = (
        f"Shares of the energy of {_SHEETS} linked sheets under shear in them and between them."
    )
    file = folder / "fibre_contours.png"
    return StudyResult(rows, draw(file, caption, paint, (8.0, 9.0)))


# nodes in a row of the lattices; the last has 99,456 unknowns
_SIZES = (48, 112, 224)
_GRAVITY, _ROWS, _COLUMNS = (0.0, 0.0, -9.81), 41, 8
# 1/s^2, what inertia adds in a step of 1/240 s of the solver's second order
_INERTIA = (1.5 * 240.0) ** 2
_CHOICES: tuple[Preconditioner, ...] = ("P_J", "P_Db", "P_Ab")
_TOLERANCE = 1e-8


def lattices(folder: Path) -> StudyResult:
    """A sparse factorisation beside PCG with P_Db: time, kept numbers, iterations."""
    rows = Comparisons()
    source = published(
        "Houghton 2020, table 5.4 and section 5.3.1, in words: the count does not grow"
    )
    for size in _SIZES:
        system = sheared_system(NetworkPlan(size=size).layout(periodic=False))
        text = f"{len(system.right)} unknowns"
        by_factors = solve(system, "direct")
        by_steps = solve(system, "pcg", "P_Db")
        rows.compare(
            f"iterations of PCG with P_Db, {text}",
            by_steps.iterations,
            21,
            2.0,
            source,
            absolute=True,
        )
        for name, found in (("sparse factorisation", by_factors), ("PCG with P_Db", by_steps)):
            note = f"{found.preparing:.3g} s of it preparing"
            text_of = f"processor time of the {name}, {text}"
            rows.report(text_of, found.seconds, unit="s", note=note)
            rows.report(f"numbers kept by the {name}, {text}", found.entries)
        apart = by_steps.displacements - by_factors.displacements
        rows.bound(
            f"difference of the two solutions over the largest displacement, {text}",
            float(np.abs(apart).max() / np.abs(by_factors.displacements).max()),
            independent("the other of the two methods"),
            at_most=1e-7,
        )
    return StudyResult(rows)


def vane(folder: Path) -> StudyResult:
    """The banded solver of the nodal feather beside preconditioned iterations on its matrix."""
    rows = Comparisons()
    kind = feather_kind("swan_primary")
    feather = build_feather(kind, _ROWS, _COLUMNS)
    model = make_model([feather], [kind], 2)
    nodes = nodal_model(model, [feather], [kind], bending="barbs")
    solver = NodalSolver(model, nodes, Settings(newton=1e-7 * kind.length))
    state = nodal_rest_state(model, nodes, np.zeros((1, 3)), np.eye(3)[None])
    loads = no_loads(1, _GRAVITY)
    found = solver.system(state, loads, 0, _INERTIA)
    exact, seconds = _banded(found.band, -found.gradient)
    text = f"{len(exact)} unknowns, a step of 1/240 s"
    rows.report(f"processor time of the banded solver, {text}", seconds, unit="s")
    system = HeldSystem(_whole(found.band), -found.gradient, np.arange(len(exact)))
    for choice in _CHOICES:
        method: Method = "gmres" if choice == "P_Ab" else "pcg"
        solved = solve(system, method, choice, _TOLERANCE, 20_000, directions=3)
        note = f"residual {solved.residual:.1e}"
        rows.report(
            f"iterations of {method.upper()} with {choice}, {text}", solved.iterations, note=note
        )
        ratio = solved.seconds / seconds
        rows.report(f"its time over the banded solver's, {choice}, {text}", ratio, unit="s/s")
    factors = solve(system, "direct", directions=3)
    apart = np.abs(factors.displacements - exact).max() / np.abs(exact).max()
    rows.bound(
        f"difference of the banded solution over its largest value, {text}",
        float(apart),
        independent("a sparse factorisation (SuperLU)"),
        at_most=1e-6,
    )
    return StudyResult(rows)


def _banded(band: Array, right: Array) -> tuple[Array, float]:
    """Solution, and least processor time of five."""
    panel = np.zeros(panel_shape(band.shape[1]))
    seconds = []
    for _ in range(6):
        factors, found = band.copy(), right.copy()
        begin = time.process_time()
        if not factorise(factors, panel):
            raise ArithmeticError("the vane's matrix is not positive definite")
        solve_factored(factors, found)
        seconds.append(time.process_time() - begin)
    return found, min(seconds[1:])


def _whole(band: Array) -> sparse.csr_array:
    """Sparse matrix of a band: band[j, d] of unknowns j and j + d."""
    size = len(band)
    j, d = np.nonzero(band)
    inside = j + d < size
    j, d = j[inside], d[inside]
    lower = sparse.coo_array((band[j, d], (j + d, j)), shape=(size, size)).tocsr()
    upper = sparse.triu(lower.T, 1)
    return sparse.csr_array(lower + upper)
