"""Three laws of soft tissue under a pull along x1, and their fits to measured curves.

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
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.integrate import cumulative_simpson
from scipy.optimize import least_squares
from scipy.stats import t as student

from featherfx.algebra.types import Array
from featherfx.errors import InputError, Problem, require
from featherfx.limits import MAX_LISTED

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
