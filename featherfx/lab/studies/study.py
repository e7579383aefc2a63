"""A study: one thing of the literature, computed anew and put beside the published values.

A study is a function of a folder for its pictures; it returns rows of numbers, each with its
verdict, and figures. The verdict follows from the numbers and is never written by hand.
"""

from __future__ import annotations

import importlib
import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

from featherfx.lab.bench.report import can_plot

Verdict = Literal["agrees", "differs", "no comparison"]
Comparison = Literal["relative", "absolute", "at most", "at least", "none"]


@dataclass(frozen=True)
class Row:
    """One number beside the published one.

    quantity: what it is, with its conditions. ours: in SI units. unit: of ours and published.
    published: value or bound that ours is held against, or None. tolerance: how far ours may be
    off, as a share of the published value ("relative") or in its unit ("absolute"). comparison:
    how they are compared; "at most" and "at least" take published as a bound. note: where the
    published value is from, and why ours differs where it does.
    """

    quantity: str
    ours: float
    unit: str = ""
    published: float | None = None
    tolerance: float | None = None
    comparison: Comparison = "none"
    note: str = ""

    @property
    def verdict(self) -> Verdict:
        """Whether ours agrees with the published value; a number that is not finite never does."""
        if self.comparison == "none" or self.published is None:
            return "no comparison"
        if self.comparison == "at most":
            return "agrees" if self.ours <= self.published else "differs"
        if self.comparison == "at least":
            return "agrees" if self.ours >= self.published else "differs"
        allowed = self.tolerance or 0.0
        if self.comparison == "relative":
            allowed *= abs(self.published)
        return "agrees" if abs(self.ours - self.published) <= allowed else "differs"


@dataclass(frozen=True)
class Figure:
    """A picture that a study has written. file: PNG. caption: what it shows and how to read it."""

    file: Path
    caption: str


@dataclass(frozen=True)
class StudyResult:
    """rows: numbers, in the order of the page. figures: none without matplotlib. seconds,
    processor_seconds: wall and processor time of the study, filled in by run_study; compilation
    is in them unless the kernels were compiled before."""

    rows: Sequence[Row]
    figures: Sequence[Figure] = ()
    seconds: float = math.nan
    processor_seconds: float = math.nan

    @property
    def verdict(self) -> Verdict:
        """That of all rows together: one that differs is enough."""
        found = {row.verdict for row in self.rows}
        if "differs" in found:
            return "differs"
        return "agrees" if "agrees" in found else "no comparison"


@dataclass(frozen=True)
class Study:
    """name: by which it is asked for. title: of its section. reproduces: publication and figure or
    table. place: "module:name" of the function that does the work, imported when it runs, not when
    it is listed or sent to a process. It is called with a folder, which exists, for the pictures,
    named after the study."""

    name: str
    title: str
    reproduces: str
    place: str

    @property
    def run(self) -> Callable[[Path], StudyResult]:
        """The function."""
        module, _, name = self.place.partition(":")
        found: Callable[[Path], StudyResult] = getattr(importlib.import_module(module), name)
        return found


def compared(
    quantity: str,
    ours: float,
    published: float,
    tolerance: float,
    *,
    unit: str = "",
    absolute: bool = False,
    note: str = "",
) -> Row:
    """A number beside a published one; tolerance: a share of it, or absolute in its unit."""
    kind: Comparison = "absolute" if absolute else "relative"
    return Row(quantity, float(ours), unit, float(published), tolerance, kind, note)


def bounded(
    quantity: str,
    ours: float,
    *,
    at_most: float | None = None,
    at_least: float | None = None,
    unit: str = "",
    note: str = "",
) -> Row:
    """A number beside a bound on it; exactly one of the two bounds is given."""
    bound = at_most if at_most is not None else at_least
    kind: Comparison = "at most" if at_most is not None else "at least"
    return Row(quantity, float(ours), unit, bound, None, kind, note)


def reported(quantity: str, ours: float, *, unit: str = "", note: str = "") -> Row:
    """A number of ours that nothing published stands beside."""
    return Row(quantity, float(ours), unit, note=note)


def run_study(study: Study, folder: Path) -> StudyResult:
    """Run a study with its pictures in a folder (made if need be), and time it."""
    folder.mkdir(parents=True, exist_ok=True)
    begin, spent = time.perf_counter(), time.process_time()
    result = study.run(folder)
    return replace(
        result,
        seconds=time.perf_counter() - begin,
        processor_seconds=time.process_time() - spent,
    )


INCHES = (7.0, 4.6)
DOTS = 110
# Okabe and Ito's, told apart by the colour-blind too
COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#56b4e9", "#e69f00")


def draw(
    file: Path,
    caption: str,
    paint: Callable[[Any], None],
    inches: tuple[float, float] = INCHES,
) -> tuple[Figure, ...]:
    """Write a PNG that paint draws on an empty matplotlib Figure; () without matplotlib."""
    if not can_plot():
        return ()
    from matplotlib import figure, rc_context

    file.parent.mkdir(parents=True, exist_ok=True)
    with rc_context({"axes.prop_cycle": f"cycler('color', {list(COLOURS)})"}):
        canvas = figure.Figure(figsize=inches, layout="constrained")
        paint(canvas)
        # no version or date inside: the same numbers give the same file
        canvas.savefig(file, format="png", dpi=DOTS, metadata={"Software": None})
    return (Figure(file, caption),)
