"""The three moduli of a vane from traction tests, with how well the tests determine them.

Least squares in the logarithms of the moduli, by Gauss-Newton; each curve weighs by the inverse of
its root mean square stress, so the noise is taken as a share of the stress. With J the derivative
of the n weighted stresses by the three logarithms and r the residuals,

    covariance = |r|^2 / (n - 3) (J^T J)^-1,      interval = modulus * exp(+- t sqrt(covariance))

with t Student's quantile for 95 %. A modulus is identified if no change of the other two imitates
its effect: 1 / sqrt(n (J^T J)^-1_ii), the stress that is left when it changes by the factor e, as a
share of the whole.

Stress-strain curves of traction tests, read from CSV.
"""

from __future__ import annotations

import csv
import re
import time
from collections.abc import Sequence
from dataclasses import dataclass
from math import isfinite
from pathlib import Path
from typing import Any

import numpy as np
from scipy.stats import t as student

from featherfx.algebra.types import Array
from featherfx.errors import InputError, Problem, require
from featherfx.files.atomic_write import write_text
from featherfx.lab.declare import out_of_range, value
from featherfx.lab.vane.sample import (
    FORM,
    Moduli,
    Sample,
    isotropic,
    membrane,
    sample_problems,
    slope,
)
from featherfx.lab.vane.statics import Statics
from featherfx.lab.vane.traction import ELEMENTS, Traction, clamped, mesh_of, pull

CURVE_COLUMNS = ("strain", "stress", "angle", "width", "height", "thickness")
# problems named one by one; more than these are counted
_NAMED = 20


@dataclass(frozen=True)
class MeasuredCurve:
    """One test: its sample, and strain (n,) with stress (n,), Pa, as sample.py defines them."""

    sample: Sample
    strain: Array
    stress: Array


def read_curves(path: Path) -> tuple[MeasuredCurve, ...]:
    """Curves of a CSV file with the columns of COLUMNS (SI units, degrees), one point a line.

    Lines of equal angle, width, height and thickness are one curve, by strain. Raises InputError
    with all problems found; OSError if the file cannot be read.
    """
    source = str(path)
    try:
        with path.open(encoding="utf-8-sig", newline="") as file:
            reader = csv.DictReader(file)
            missing = [each for each in CURVE_COLUMNS if each not in (reader.fieldnames or ())]
            if missing:
                message = f"columns are missing: {', '.join(missing)}"
                raise InputError(Problem(source, "line 1", message))
            lines = [(reader.line_num, line) for line in reader]
    except (UnicodeDecodeError, csv.Error) as error:
        raise InputError(Problem(source, "", f"is not a CSV file: {error}")) from error
    problems: list[Problem] = []
    points = [_point(source, number, line, problems) for number, line in lines]
    if not points:
        problems.append(Problem(source, "", "holds no points"))
    problems += _sample_problems(source, lines, points)
    if problems:
        more = len(problems) - _NAMED
        rest = [Problem(source, "", f"and {more} more problems")] if more > 0 else []
        raise InputError(*problems[:_NAMED], *rest)
    return _grouped([point for point in points if point is not None])


def _point(
    source: str, number: int, line: dict[str, str | None], problems: list[Problem]
) -> tuple[float, ...] | None:
    values = []
    for key in CURVE_COLUMNS:
        text = (line.get(key) or "").strip()
        place = f"line {number}, {key}"
        try:
            value = float(text)
        except ValueError:
            what = f"'{text}' is not a number" if text else "is empty"
            problems.append(Problem(source, place, what))
            continue
        if not isfinite(value):
            problems.append(Problem(source, place, f"{text} is not finite"))
            continue
        if key == "strain" and not -0.5 < value <= 2.0:
            message = f"{value:g} is not allowed, must be above -0.5 to 2. Is this in percent?"
            problems.append(Problem(source, place, message))
        values.append(value)
    return tuple(values) if len(values) == len(CURVE_COLUMNS) else None


def _sample_problems(
    source: str,
    lines: list[tuple[int, dict[str, str | None]]],
    points: list[tuple[float, ...] | None],
) -> list[Problem]:
    """Problems of the samples, each told once, at the first line of the sample."""
    seen: set[tuple[float, ...]] = set()
    problems: list[Problem] = []
    for (number, _), point in zip(lines, points, strict=True):
        if point is None or point[2:] in seen:
            continue
        seen.add(point[2:])
        found = sample_problems(Sample(*point[2:]), source)
        problems += [Problem(source, f"line {number}, {p.key}", p.message) for p in found]
    return problems


def _grouped(points: list[tuple[float, ...]]) -> tuple[MeasuredCurve, ...]:
    groups: dict[tuple[float, ...], list[tuple[float, ...]]] = {}
    for point in points:
        groups.setdefault(point[2:], []).append(point)
    curves = []
    for key, members in groups.items():
        ordered = np.array(sorted(members))
        curves.append(MeasuredCurve(Sample(*key), ordered[:, 0], ordered[:, 1]))
    return tuple(curves)


_BASE = "swan_vane"
CALIBRATED = ("along", "across", "shear")
# keys of a vane preset
_KEYS = ("modulus_along_barbs", "modulus_across_barbs", "shear_modulus")
# strains at which a tilted sample is solved; between them the secant modulus is interpolated
_KNOTS = 4
_COARSE, _FINE = 600, 8000
_ROUNDS, _CORRECTIONS = 8, 2
_CLOSE = 1e-5
_DIFFERENCE = 1e-3
# least share of the stress that must be left to tell a modulus from the others
IDENTIFIED = 0.02
# degrees; below, a sample says nothing of shear
_TILTED = 5.0
_MISSING = {
    "along": "a longitudinal test: barbs along the pull (angle 90), or steep enough to join both"
    " clamps (tan angle > height / width)",
    "across": "a transverse test: barbs across the pull (angle 0)",
    "shear": "a tilted test: barbs at 30 to 45 degrees that do not join both clamps"
    " (tan angle < height / width)",
}


@dataclass(frozen=True)
class CalibrateTest:
    """Fit the three moduli to FILE, a CSV with the columns strain, stress (Pa), angle (degrees),
    width, height and thickness (m), one point a line.

    Curves that cannot determine a modulus are refused, with the test that is missing.
    """

    elements: int = value("Of tilted samples.", _FINE, ELEMENTS)


@dataclass(frozen=True)
class Calibration:
    """moduli: Pa. low, high: their 95 % intervals, or None with no more points than moduli.
    identified: (along, across, shear) shares as above. conditioning: ratio of the largest to the
    smallest singular value of J. residual: root mean square, as a share of the stress. curves,
    points: how many. iterations: of Gauss-Newton. seconds: wall."""

    moduli: Moduli
    low: Moduli | None
    high: Moduli | None
    identified: tuple[float, ...]
    conditioning: float
    residual: float
    curves: int
    points: int
    iterations: int
    seconds: float

    def as_json(self) -> dict[str, Any]:
        """Plain values by key, SI units."""
        found: dict[str, Any] = {
            name: {
                "value": getattr(self.moduli, name),
                "low": None if self.low is None else getattr(self.low, name),
                "high": None if self.high is None else getattr(self.high, name),
                "identified": left,
            }
            for name, left in zip(CALIBRATED, self.identified, strict=True)
        }
        for key in ("conditioning", "residual", "curves", "points", "iterations", "seconds"):
            found[key] = getattr(self, key)
        return found


def calibrate(
    curves: Sequence[MeasuredCurve], elements: int = _FINE, source: str = ""
) -> Calibration:
    """Moduli that fit the curves best.

    elements: of the meshes of tilted samples. The fit uses coarser ones, corrected by the ratio of
    fine to coarse stresses until it stays. source: file of the curves. Raises InputError for
    curves that cannot determine the moduli, naming the tests that are missing.
    """
    begin = time.perf_counter()
    require(*out_of_range(CalibrateTest(elements), form=FORM))
    _require_tests(curves, source)
    scale = [float(np.sqrt(np.mean(curve.stress**2))) for curve in curves]
    data = np.concatenate([c.stress / s for c, s in zip(curves, scale, strict=True)])
    tests = [_Test(curve, size) for curve, size in zip(curves, scale, strict=True)]
    guess, iterations = _first_guess(curves), 0
    for _ in range(1 + _CORRECTIONS):
        before = guess
        guess, jacobian, spent = _gauss_newton(tests, data, guess, source)
        iterations += spent
        for test in tests:
            test.correct(_moduli(guess), elements)
        if np.abs(guess - before).max() < _CLOSE:
            break
    weighted: Array = np.concatenate([test.stress(_moduli(guess)) for test in tests])
    residual = np.asarray(weighted - data, dtype=np.float64)
    half = half_intervals(jacobian, residual)
    low, high = (None if half is None else _moduli(guess + each * half) for each in (-1.0, 1.0))
    singular = np.linalg.svd(jacobian, compute_uv=False)
    return Calibration(
        moduli=_moduli(guess),
        low=low,
        high=high,
        identified=identified_fractions(jacobian),
        conditioning=float(singular[0] / singular[-1]),
        residual=float(np.sqrt(np.mean(residual**2))),
        curves=len(curves),
        points=len(data),
        iterations=iterations,
        seconds=time.perf_counter() - begin,
    )


class _Test:
    """Prediction of one curve: weighted stresses at its strains."""

    def __init__(self, curve: MeasuredCurve, scale: float) -> None:
        self._curve, self._scale = curve, scale
        ends = curve.strain[np.argmax(np.abs(curve.strain))]
        self._knots = ends * np.arange(1, _KNOTS + 1) / _KNOTS
        self._correction = np.ones(_KNOTS)
        self._bodies: dict[int, Any] = {}

    def stress(self, moduli: Moduli) -> Array:
        """(n,) stresses over the curve's scale."""
        secant = self._secants(moduli, _COARSE) * self._correction
        fit = np.polynomial.Polynomial.fit(self._knots, secant, _KNOTS - 1)
        return fit(self._curve.strain) * self._curve.strain / self._scale

    def correct(self, moduli: Moduli, elements: int) -> None:
        """Make the stresses at these moduli those of a finer mesh."""
        if not self._uniform:
            fine = self._secants(moduli, elements)
            self._correction = fine / self._secants(moduli, _COARSE)

    @property
    def _uniform(self) -> bool:
        return abs(self._curve.sample.angle) in (0.0, 90.0)

    def _secants(self, moduli: Moduli, elements: int) -> Array:
        """(_KNOTS,) Pa, stress over strain."""
        sample = self._curve.sample
        if self._uniform:
            return np.full(_KNOTS, moduli.across if sample.angle == 0.0 else moduli.along)
        test = Traction(sample, moduli, 1.0, elements=elements)
        body = membrane(sample, mesh_of(test, moduli), moduli.as_array())
        statics = Statics(body, clamped(sample, body))
        return pull(sample, statics, self._knots).stress / self._knots


def _require_tests(curves: Sequence[MeasuredCurve], source: str) -> None:
    """InputError unless there is a test for every modulus."""
    problems = []
    for number, curve in enumerate(curves):
        if curve.sample.regime == "diagonal":
            problems.append(
                Problem(
                    source,
                    f"curve {number + 1}",
                    "one barb joins both clamps from corner to corner."
                    " Take a sample that determines a modulus",
                )
            )
        if not np.any(curve.strain):
            problems.append(Problem(source, f"curve {number + 1}", "has no strain other than zero"))
        elif not slope(curve.strain, curve.stress) > 0.0:
            problems.append(Problem(source, f"curve {number + 1}", "stress falls with strain"))
    regimes = {curve.sample.regime for curve in curves}
    free = [abs(c.sample.angle) for c in curves if c.sample.regime == "free"]
    missing = []
    if "bridged" not in regimes:
        missing.append("along")
    if not free:
        missing += ["across", "shear"]
    elif max(free) < _TILTED:
        missing.append("shear")
    elif len(set(free)) == 1 and len(free) == 1:
        missing.append("across" if max(free) >= _TILTED else "shear")
    problems += [_missing(name, source) for name in missing]
    require(*problems)


def _missing(name: str, source: str) -> Problem:
    return Problem(source, name, f"the curves do not determine it. Missing is {_MISSING[name]}")


def _first_guess(curves: Sequence[MeasuredCurve]) -> Array:
    """(3,) logarithms."""
    steep = max(curves, key=lambda c: abs(c.sample.angle))
    flat = min(curves, key=lambda c: abs(c.sample.angle))
    across = slope(flat.strain, flat.stress)
    return np.log([slope(steep.strain, steep.stress), across, isotropic(across).shear])


def _gauss_newton(
    tests: Sequence[_Test], data: Array, guess: Array, source: str
) -> tuple[Array, Array, int]:
    for iteration in range(_ROUNDS):
        base = np.concatenate([test.stress(_moduli(guess)) for test in tests])
        jacobian = np.empty((len(data), 3))
        for k in range(3):
            moved = guess + _DIFFERENCE * np.eye(3)[k]
            shifted = np.concatenate([test.stress(_moduli(moved)) for test in tests])
            jacobian[:, k] = (shifted - base) / _DIFFERENCE
        weak = [
            n
            for n, left in zip(CALIBRATED, identified_fractions(jacobian), strict=True)
            if left < IDENTIFIED
        ]
        if weak:
            raise InputError(*(_missing(name, source) for name in weak))
        step = np.linalg.lstsq(jacobian, data - base, rcond=None)[0]
        step = np.clip(step, -1.5, 1.5)
        guess = guess + step
        if np.abs(step).max() < _CLOSE:
            return guess, jacobian, iteration + 1
    return guess, jacobian, _ROUNDS


def identified_fractions(jacobian: Array) -> tuple[float, ...]:
    """Return, of each column, the stress left when it changes by e, as a fraction of the whole.

    The other columns change so that as little as possible is left."""
    found = []
    for k in range(jacobian.shape[1]):
        others = np.delete(jacobian, k, axis=1)
        own = jacobian[:, k]
        rest = own - others @ np.linalg.lstsq(others, own, rcond=None)[0]
        found.append(float(np.linalg.norm(rest) / np.sqrt(len(jacobian))))
    return tuple(found)


def half_intervals(jacobian: Array, residual: Array) -> Array | None:
    """(k,) half widths of the 95 % intervals of a least-squares fit; None with no more points than
    values. jacobian: (n, k). residual: (n,)."""
    freedom = len(residual) - jacobian.shape[1]
    if freedom < 1:
        return None
    inverse = np.linalg.inv(jacobian.T @ jacobian)
    variance = float(residual @ residual) / freedom * np.diag(inverse)
    return np.asarray(student.ppf(0.975, freedom) * np.sqrt(variance))


def _moduli(logarithms: Array) -> Moduli:
    return Moduli(*(float(each) for each in np.exp(logarithms)))


def check_name(folder: Path, name: str) -> Path:
    """The file of a preset. Raises InputError for a name that is none or is taken."""
    if not re.fullmatch(r"[a-z][a-z0-9_]*", name):
        message = f"'{name}' is not allowed, must be small letters, digits and _"
        raise InputError(Problem("", "name", message))
    file = folder / "material" / "vane" / f"{name}.toml"
    if file.exists():
        raise InputError(Problem(str(file), "", "exists already. Remove it or choose another name"))
    return file


def save_preset(folder: Path, name: str, found: Calibration, thickness: float) -> Path:
    """Write the preset and return its file; thickness: m.

    What traction does not tell (mass, bending, damping) is the swan's. Raises InputError as
    check_name.
    """
    file = check_name(folder, name)
    lines = [
        f"# Vane calibrated from {found.curves} traction tests with {found.points} points.",
        "# 95 % intervals behind the values. Mass, bending and damping are those of the base.",
        f'base = "{_BASE}"',
        "",
    ]
    for key, name in zip(_KEYS, CALIBRATED, strict=True):
        modulus = getattr(found.moduli, name)
        known = found.low is not None and found.high is not None
        told = (
            f"  # {getattr(found.low, name):.4g} to {getattr(found.high, name):.4g}"
            if known
            else ""
        )
        lines.append(f"{key} = {modulus:.6g}{told}")
    lines.append(f"thickness = {thickness:.6g}  # mean of the samples")
    file.parent.mkdir(parents=True, exist_ok=True)
    write_text(file, "\n".join(lines) + "\n")
    return file
