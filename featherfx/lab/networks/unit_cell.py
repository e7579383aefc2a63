"""A periodic cell of barbs and barbules, and the moduli of the vane that it amounts to.

x across the barbs, y along them. Barbs stand at distance d. From each, barbules leave at the angle
beta to both sides towards its tip: distal ones to +x, proximal ones to -x, at distance s along the
barb. Each distal barbule crosses 2 m - 1 proximal ones of the next barb, m = d cot(beta) / s (s is
changed so that m is whole); its last crossings are hooked, hinges that join the two; at the others
the barbules pass each other. Barbules are clamped in their barb.

Three laws of soft tissue under a pull along x1, and their fits to measured curves.

    Fung     S = a1 E1 + a4 E2 + c (b1 E1 + b4 E2) exp(b1 E1^2 + b2 E2^2 + 2 b4 E1 E2)
    Sacks    S = int a (exp(b E_f) - 1) R cos^2 t dt,   E_f = E1 cos^2 t + E2 sin^2 t
    Arnoux   S = (1 - D) 2 a b [e (1 - l^-3) - l^-1 / 2 + l^-4 / 2],   e = exp(b (l^2 + 2 / l - 3))
             (D + D0)^(1/n) = D0^(1/n) + a b / Q int_1^l (e - 1 / l) dl

S second Piola-Kirchhoff stress, E Green-Lagrange strains along and across the pull, l the stretch,
R a normal distribution of fibre directions t about the pull. Source: Jacquemoud 2007, equations
2-18, 2-25, 2-29 and 2-31. Equation 2-35 writes p / l for p / l^2, the first component of p C^-1;
ours follows from the energy 2-29 at S22 = 0. The law of D is hers, integrated: it depends on the
stretch alone, not on its rate.
"""

from __future__ import annotations

import csv
import json
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.integrate import cumulative_simpson
from scipy.optimize import least_squares
from scipy.stats import t as student

from featherfx.algebra.types import Array
from featherfx.errors import InputError, Problem, require
from featherfx.groom.materials import Profile, VaneMaterial
from featherfx.groom.types import FeatherKind
from featherfx.lab.declare import value
from featherfx.lab.networks.network import FibreNetwork, homogenised
from featherfx.limits import MAX_LISTED


@dataclass(frozen=True)
class UnitCell:
    """barb_spacing: m. barb_stretch: N, EA. barb_bending_normal: N m^2, EI. angle: deg, between
    barbule and barb. barbule_spacing: m, along the barb. barbule_diameter: m, round and solid.
    young: Pa, of the barbules. hooks: crossings at the end of a distal barbule that are joined.
    thickness: m, of the vane, by which stiffnesses become moduli."""

    barb_spacing: float
    barb_stretch: float
    barb_bending_normal: float
    thickness: float
    angle: float = 45.0
    barbule_spacing: float = 30e-6
    barbule_diameter: float = 5e-6
    young: float = 2.5e9
    hooks: int = 3

    def __post_init__(self) -> None:
        positive = (
            *("barb_spacing", "barb_stretch", "barb_bending_normal", "thickness"),
            *("barbule_spacing", "barbule_diameter", "young"),
        )
        problems = [
            Problem("unit cell", name, f"{found:g} is not allowed. Give a value above 0")
            for name in positive
            if not 0.0 < (found := getattr(self, name)) < np.inf
        ]
        if not 5.0 <= self.angle <= 85.0:
            problems.append(
                Problem("unit cell", "angle", f"{self.angle:g} is not allowed. Give 5 to 85 deg")
            )
        if not problems and self.crossings < 2:
            text = f"{self.barbule_spacing:g} is above half of spacing times cot(angle)"
            problems.append(Problem("unit cell", "barbule_spacing", text))
        elif not problems and not 1 <= self.hooks <= 2 * self.crossings - 1:
            text = f"{self.hooks} is not allowed. Give 1 to {2 * self.crossings - 1}, its crossings"
            problems.append(Problem("unit cell", "hooks", text))
        elif not problems and self.crossings > 200:
            text = f"{self.barbule_spacing:g} makes more than 400 crossings a barbule"
            problems.append(Problem("unit cell", "barbule_spacing", text))
        if self.hooks < 1 and not any(each.key == "hooks" for each in problems):
            problems.append(
                Problem("unit cell", "hooks", f"{self.hooks} is not allowed. Give 1 or more")
            )
        require(*problems)

    @property
    def crossings(self) -> int:
        """m: rows of barbules that a barbule spans."""
        rise = self.barb_spacing / np.tan(np.radians(self.angle))
        return round(rise / self.barbule_spacing)

    @property
    def height(self) -> float:
        """m, of the cell along the barb: the barbule spacing that makes m whole."""
        return float(self.barb_spacing / np.tan(np.radians(self.angle)) / self.crossings)


@dataclass(frozen=True)
class CellModuli:
    """along, across, shear: Pa, as those of VaneMaterial. bending_along, bending_across: N m.
    poisson: contraction along the barbs over strain across them, when pulled across. relaxed,
    affine: (3, 3) N/m, membrane stiffness for strains (vv, ww, 2 vw), nodes free or moving with
    the mean strain."""

    along: float
    across: float
    shear: float
    bending_along: float
    bending_across: float
    poisson: float
    relaxed: Array
    affine: Array


@dataclass(frozen=True)
class CellTest:
    """A periodic lattice of barbs and hooked barbules, and the vane that it amounts to.

    Barbs are those of the preset: spacing, stretch and bending stiffness. `poisson` is the
    contraction along the barbs over the strain across them. `barbule_spacing` is that of the
    cell, for which a barbule spans a whole number of rows.
    """

    preset: str = value("Feather preset.")
    angle: float = value("deg, barbule to barb.", UnitCell.angle)
    barbule_spacing: float = value(
        "m, of barbules along the barb.", UnitCell.barbule_spacing, option="spacing"
    )
    barbule_diameter: float = value(
        "m, of a barbule.", UnitCell.barbule_diameter, option="diameter"
    )
    young: float | None = value("Pa, of the barbules.  [default: the rachis']", None)
    hooks: int = value("Hooked crossings a barbule.", UnitCell.hooks)

    def cell(self, kind: FeatherKind) -> UnitCell:
        """The cell with the barbs of a feather kind."""
        names = ("angle", "barbule_spacing", "barbule_diameter", "young", "hooks")
        values = {name: getattr(self, name) for name in names}
        return cell_of(kind, **{name: each for name, each in values.items() if each is not None})


def cell_of(kind: FeatherKind, **changes: Any) -> UnitCell:
    """The cell of a feather kind: its barbs as the vane's material says. changes: other values."""
    vane = kind.vane_material
    width = kind.barb_spacing
    cell = UnitCell(
        barb_spacing=width,
        barb_stretch=vane.modulus_along_barbs * vane.thickness * width,
        barb_bending_normal=vane.barb_bending_normal * width,
        thickness=vane.thickness,
        young=kind.rachis_material.youngs_modulus,
    )
    return replace(cell, **changes)


def barbule_nodes(cell: UnitCell) -> tuple[list[int], list[int], int]:
    """Nodes of the distal and of the proximal barbule from their roots, and how many there are.

    Node 0 is the barb's, the others are the distal barbule's crossings in turn, of which the
    proximal one has those at the hooks; beyond the last hook it carries nothing and is left out.
    """
    last = 2 * cell.crossings - 1
    distal = list(range(last + 1))
    return distal, [0, *range(last, last - cell.hooks, -1)], last + 1


def cell_network(cell: UnitCell) -> FibreNetwork:
    """The periodic network of a cell, in its plane."""
    distal, proximal, count = barbule_nodes(cell)
    area, inertia = _section(cell)
    step = np.array([cell.barb_spacing, cell.crossings * cell.height]) / (2 * cell.crossings)
    ends, span, stretch = [(0, 0)], [np.array([0.0, cell.height])], [cell.barb_stretch]
    pairs, reach = [], []
    length = float(np.linalg.norm(step))
    for nodes, side in ((distal, 1.0), (proximal, -1.0)):
        for k in range(len(nodes) - 1):
            # the root is clamped to the barb, segment 0, which turns as a whole
            pairs.append((len(ends) - 1 if k else 0, len(ends)))
            reach.append(2.0 * length if k else length)
            ends.append((nodes[k], nodes[k + 1]))
            span.append(step * np.array([side, 1.0]))
            stretch.append(cell.young * area)
    return FibreNetwork(
        nodes=count,
        ends=np.array(ends),
        span=np.array(span),
        stretch=np.array(stretch),
        pairs=np.array(pairs),
        reach=np.array(reach),
        bend=np.full(len(pairs), cell.young * inertia),
    )


def _section(cell: UnitCell) -> tuple[float, float]:
    return np.pi / 4.0 * cell.barbule_diameter**2, np.pi / 64.0 * cell.barbule_diameter**4


def cell_moduli(cell: UnitCell) -> CellModuli:
    """Homogenised moduli of a cell: inverse diagonal of its compliance, so that the strains that
    are not asked for are free."""
    along, across, shear = np.zeros((3, 2, 2))
    along[1, 1] = across[0, 0] = 1.0
    shear[0, 1] = shear[1, 0] = 0.5
    area = cell.barb_spacing * cell.height
    relaxed, affine = homogenised(cell_network(cell), np.stack([along, across, shear]))
    compliance = np.linalg.inv(relaxed / area)
    moduli = 1.0 / np.diag(compliance) / cell.thickness
    bending = np.linalg.inv(bending_form(cell))
    return CellModuli(
        along=float(moduli[0]),
        across=float(moduli[1]),
        shear=float(moduli[2]),
        bending_along=1.0 / float(bending[0, 0]),
        bending_across=1.0 / float(bending[1, 1]),
        poisson=-float(compliance[0, 1] / compliance[1, 1]),
        relaxed=relaxed / area,
        affine=affine / area,
    )


def bending_form(cell: UnitCell) -> Array:
    """(2, 2) N m, bending stiffness for curvatures along and across the barbs, twist none.

    Unknowns: heights of the nodes and the barb's tilt about itself. A triplet's kink is the
    second difference of heights plus r / 2 times the mean curvature along the fibre.
    """
    distal, proximal, count = barbule_nodes(cell)
    _, inertia = _section(cell)
    step = np.array([cell.barb_spacing, cell.crossings * cell.height]) / (2 * cell.crossings)
    length = float(np.linalg.norm(step))
    along = np.array([step[1] ** 2, step[0] ** 2]) / length**2
    rows, mean, weights = [], [], []
    for nodes, side in ((distal, 1.0), (proximal, -1.0)):
        for k in range(len(nodes) - 1):
            row = np.zeros(count + 1)
            row[nodes[k + 1]] += 1.0 / length
            row[nodes[k]] -= 1.0 / length
            if k:
                row[nodes[k]] -= 1.0 / length
                row[nodes[k - 1]] += 1.0 / length
            else:
                row[count] -= side * step[0] / length
            reach = 2.0 * length if k else length
            rows.append(row)
            mean.append(0.5 * reach * along)
            weights.append(2.0 * cell.young * inertia / reach)
    lines, applied, stiff = np.array(rows), np.array(mean), np.array(weights)
    moved = np.linalg.lstsq(
        np.sqrt(stiff)[:, None] * lines, -np.sqrt(stiff)[:, None] * applied, rcond=1e-12
    )[0]
    strains = lines @ moved + applied
    form = strains.T @ (stiff[:, None] * strains)
    form[0, 0] += cell.barb_bending_normal * cell.height
    return np.asarray(form / (cell.barb_spacing * cell.height))


def vane_of(cell: UnitCell, vane: VaneMaterial) -> VaneMaterial:
    """A vane material with the cell's moduli; what the cell does not tell is taken over."""
    found = cell_moduli(cell)
    return replace(
        vane,
        modulus_along_barbs=found.along,
        modulus_across_barbs=found.across,
        shear_modulus=found.shear,
        barb_bending_normal=found.bending_along,
        bending_across=found.bending_across,
    )


def vane_text(vane: VaneMaterial, source: str) -> str:
    """A vane material as the text of a preset file. source: the feather whose barbs it has."""
    lines = [f"# Vane from a cell of barbs and barbules, with the barbs of {source}.", ""]
    for each in fields(vane):
        lines.append(f"{each.name} = {_told(getattr(vane, each.name))}")
    return "\n".join(lines) + "\n"


def _told(value: float | str | Profile) -> str:
    """A value as TOML has it."""
    if isinstance(value, Profile):
        curves = (
            f"{each.name} = {json.dumps(getattr(value, each.name))}" for each in fields(value)
        )
        return f"{{ {', '.join(curves)} }}"
    return f"{value:.9g}" if isinstance(value, float) else json.dumps(value)


# of fibre directions, and of the stretch that damage is integrated over
_DIRECTIONS, _STRETCHES = 201, 400
_SPREAD = np.pi / 2.0
_FIRST_DAMAGE = 0.01
_CONFIDENCE = 0.95
# where a curve does not tell all parameters, the search goes on along those that it does not
_TRIALS = 300
_COLUMNS = ("strain", "stress")
_ACROSS = "strain_across"


def fung(parameters: Array, along: Array, across: Array) -> Array:
    """Stress for a1, a4, c, b1, b2, b4; a and c in the unit of the stress."""
    a1, a4, c, b1, b2, b4 = parameters
    exponent = b1 * along**2 + b2 * across**2 + 2.0 * b4 * along * across
    steep = c * (b1 * along + b4 * across) * np.exp(np.minimum(exponent, 50.0))
    return np.asarray(a1 * along + a4 * across + steep)


def sacks(parameters: Array, along: Array, across: Array) -> Array:
    """Stress for a (unit of the stress) and b, fibres spread by _SPREAD about the pull."""
    a, b = parameters
    angle = np.linspace(-np.pi / 2.0, np.pi / 2.0, _DIRECTIONS)
    fraction = np.exp(-(angle**2) / (2.0 * _SPREAD**2)) / (_SPREAD * np.sqrt(2.0 * np.pi))
    square = np.cos(angle) ** 2
    strain = along[:, None] * square + across[:, None] * (1.0 - square)
    stress = a * np.expm1(np.minimum(b * strain, 50.0))
    return np.asarray(np.trapezoid(stress * fraction * square, angle, axis=1))


def arnoux(parameters: Array, along: Array, across: Array) -> Array:
    """Stress for a (unit of the stress), b, Q (the same unit) and n; 0 once D is 1."""
    a, b, q, n = parameters
    stretch = np.sqrt(1.0 + 2.0 * along)
    path = np.linspace(1.0, max(float(stretch.max()), 1.0 + 1e-9), _STRETCHES)
    growth = np.exp(np.minimum(b * (path**2 + 2.0 / path - 3.0), 50.0)) - 1.0 / path
    done = cumulative_simpson(growth, x=path, initial=0.0)
    damage = (_FIRST_DAMAGE ** (1.0 / n) + a * b / q * done) ** n - _FIRST_DAMAGE
    whole = np.clip(1.0 - np.interp(stretch, path, damage), 0.0, 1.0)
    e = np.exp(np.minimum(b * (stretch**2 + 2.0 / stretch - 3.0), 50.0))
    elastic = e * (1.0 - stretch**-3) - 0.5 / stretch + 0.5 * stretch**-4
    return np.asarray(2.0 * a * b * whole * elastic)


@dataclass(frozen=True)
class TissueLaw:
    """stress: function of parameters, strain along and across. names: of the parameters. start:
    values from which a fit begins. scaled: those that go with the stress."""

    stress: Callable[[Array, Array, Array], Array]
    names: tuple[str, ...]
    start: tuple[float, ...]
    scaled: tuple[str, ...]


LAWS = {
    "fung": TissueLaw(
        fung,
        ("a1", "a4", "c", "b1", "b2", "b4"),
        (1.0, 1e-3, 0.1, 10.0, 1e-3, 1e-3),
        ("a1", "a4", "c"),
    ),
    "sacks": TissueLaw(sacks, ("a", "b"), (0.1, 10.0), ("a",)),
    "arnoux": TissueLaw(arnoux, ("a", "b", "q", "n"), (0.1, 10.0, 1.0, 0.8), ("a", "q")),
}


@dataclass(frozen=True)
class FittedTissue:
    """parameters: by name, stresses in Pa. intervals: 95 %, or None where the curve does not tell a
    parameter. error: root mean square of the stress that is left, over that of the curve. points:
    of the curve."""

    law: str
    parameters: dict[str, float]
    intervals: dict[str, tuple[float, float] | None]
    error: float
    points: int


def fit_tissue(name: str, along: Array, stress: Array, across: Array, source: str) -> FittedTissue:
    """Least squares, all parameters positive, in their logarithms.

    along, across: (n,) Green-Lagrange strains. stress: (n,) Pa. Raises InputError where there are
    too few points.
    """
    law = LAWS[name]
    count, size = len(along), len(law.names)
    if count <= size:
        text = f"{count} points are not allowed. Give more than the {size} parameters of {name}"
        require(Problem(source, "strain", text))
    scale = float(np.sqrt(np.mean(stress**2))) or 1.0
    units = np.array([scale if each in law.scaled else 1.0 for each in law.names])

    def left(logarithms: Array) -> Array:
        return (law.stress(np.exp(logarithms) * units, along, across) - stress) / scale

    found = least_squares(left, np.log(law.start), bounds=(-25.0, 25.0), max_nfev=_TRIALS)
    values = np.exp(found.x) * units
    variance = float(found.fun @ found.fun) / (count - size)
    covariance = np.linalg.pinv(found.jac.T @ found.jac, rcond=1e-12) * variance
    width = student.ppf(0.5 + 0.5 * _CONFIDENCE, count - size) * np.sqrt(np.diag(covariance))
    told = np.linalg.norm(found.jac, axis=0) > 1e-9
    return FittedTissue(
        name,
        dict(zip(law.names, values.tolist(), strict=True)),
        {
            each: (value * np.exp(-way), value * np.exp(way)) if seen and way < 3.0 else None
            for each, value, way, seen in zip(
                law.names, values.tolist(), width.tolist(), told.tolist(), strict=True
            )
        },
        float(np.sqrt(np.mean(found.fun**2))),
        count,
    )


def incompressible(along: Array) -> Array:
    """Strain across a pull of an isotropic tissue that keeps its volume."""
    return np.asarray(0.5 * (1.0 / np.sqrt(1.0 + 2.0 * along) - 1.0))


def read_tissue(path: Path) -> tuple[Array, Array, Array]:
    """Strain, stress (Pa) and strain across, one point a line, of a CSV file with the columns of
    _COLUMNS; without _ACROSS, that of a tissue that keeps its volume. Raises InputError."""
    source, problems = str(path), list[Problem]()
    try:
        with path.open(encoding="utf-8-sig", newline="") as file:
            reader = csv.DictReader(file)
            given = [each for each in (*_COLUMNS, _ACROSS) if each in (reader.fieldnames or ())]
            lines = [[line[each] for each in given] for line in reader]
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise InputError(Problem(source, "", f"cannot be read as CSV: {error}")) from error
    require(*(Problem(source, each, "column is missing") for each in _COLUMNS if each not in given))
    table = np.full((len(lines), len(given)), np.nan)
    for number, line in enumerate(lines):
        for k, (key, text) in enumerate(zip(given, line, strict=True)):
            with suppress(TypeError, ValueError):
                table[number, k] = float(text)
            if not np.isfinite(table[number, k]) or (key != "stress" and table[number, k] <= -0.5):
                allowed = "finite" if key == "stress" else "above -0.5"
                problems.append(
                    Problem(
                        source,
                        f"line {number + 2}: {key}",
                        f"{text!r} is not allowed. Give {allowed}",
                    )
                )
    require(*problems[:MAX_LISTED])
    along, stress = table[:, 0], table[:, 1]
    return along, stress, table[:, 2] if _ACROSS in given else incompressible(along)
