"""Stress-strain curves of traction tests, read from CSV."""

from __future__ import annotations

import csv
from dataclasses import dataclass
from math import isfinite
from pathlib import Path

import numpy as np

from featherfx.algebra.types import Array
from featherfx.errors import InputError, Problem
from featherfx.lab.vane.sample import Sample, sample_problems

CURVE_COLUMNS = ("strain", "stress", "angle", "width", "height", "thickness")
# problems named one by one; more than these are counted
_NAMED = 20


@dataclass(frozen=True)
class MeasuredCurve:
    """One test: its sample, and strain (n,) with stress (n,), Pa, as sample.py defines them."""

    sample: Sample
    strain: Array
    stress: Array


def read_curves(path: Path, in_order: bool = False) -> tuple[MeasuredCurve, ...]:
    """Curves of a CSV file with the columns of COLUMNS (SI units, degrees), one point a line.

    Lines of equal angle, width, height and thickness are one curve, by strain or, in_order, as the
    lines follow each other. Raises InputError with all
    problems found; OSError if the file cannot be read.
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
    return _grouped([point for point in points if point is not None], in_order)


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
            message = f"{value:g} is not allowed, must be above -0.5 to 2; is this in percent?"
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


def _grouped(points: list[tuple[float, ...]], in_order: bool) -> tuple[MeasuredCurve, ...]:
    groups: dict[tuple[float, ...], list[tuple[float, ...]]] = {}
    for point in points:
        groups.setdefault(point[2:], []).append(point)
    curves = []
    for key, members in groups.items():
        ordered = np.array(members if in_order else sorted(members))
        curves.append(MeasuredCurve(Sample(*key), ordered[:, 0], ordered[:, 1]))
    return tuple(curves)
