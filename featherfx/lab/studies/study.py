"""A study: one thing of the literature, computed anew and put beside the published values.

A study is a function of a folder for its pictures; it returns rows of numbers, each with its
verdict, and figures. The verdict follows from the numbers and is never written by hand. Every
number that is compared says with what (Source): only one that is printed in a publication, or a
solution by another method, can confirm it.
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

Verdict = Literal["agrees", "differs", "only with itself", "no comparison"]
Kind = Literal["published", "independent", "self"]
Comparison = Literal["relative", "absolute", "at most", "at least", "none"]


@dataclass(frozen=True)
class Source:
    """What a number of ours is held against.

    kind: "published", a number that is printed in the text; "independent", a solution by a method
    that shares no line with ours; "self": our own input, our own finer mesh, what was fitted to, or
    what is true by construction. text: the publication and the place in it, or the method, or what
    of ours it is.
    """

    kind: Kind
    text: str


def published(text: str) -> Source:
    """A number that is printed; text: publication, and table, equation, figure or section."""
    return Source("published", text)


def independent(text: str) -> Source:
    """A solution by another method; text: which."""
    return Source("independent", text)


def ourselves(text: str) -> Source:
    """Something of our own; text: what."""
    return Source("self", text)


@dataclass(frozen=True)
class Row:
    """One number beside what it is held against.

    quantity: what it is, with its conditions. ours: in SI units. unit: of ours and the reference.
    reference: value or bound that ours is held against, or None. tolerance: how far ours may be
    off, as a share of the reference ("relative") or in its unit ("absolute"). comparison: how they
    are compared; "at most" and "at least" take the reference as a bound. source: of the reference.
    note: why ours differs where it does, and what else must be known.
    """

    quantity: str
    ours: float
    unit: str = ""
    reference: float | None = None
    tolerance: float | None = None
    comparison: Comparison = "none"
    source: Source | None = None
    note: str = ""

    @property
    def verdict(self) -> Verdict:
        """Whether ours agrees with the reference; a number that is not finite never does."""
        if self.comparison == "none" or self.reference is None:
            return "no comparison"
        if self.comparison == "at most":
            return "agrees" if self.ours <= self.reference else "differs"
        if self.comparison == "at least":
            return "agrees" if self.ours >= self.reference else "differs"
        allowed = self.tolerance or 0.0
        if self.comparison == "relative":
            allowed *= abs(self.reference)
        return "agrees" if abs(self.ours - self.reference) <= allowed else "differs"


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
        """That of all rows together: one that differs is enough, and what agrees only with
        ourselves confirms nothing."""
        if any(row.verdict == "differs" for row in self.rows):
            return "differs"
        kinds = {row.source.kind for row in self.rows if row.source is not None}
        if not kinds:
            return "no comparison"
        return "only with itself" if kinds == {"self"} else "agrees"


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


class Rows(list[Row]):
    """Numbers of a study, in the order of the page."""

    def compare(
        self,
        quantity: str,
        ours: float,
        reference: float,
        tolerance: float,
        source: Source,
        *,
        unit: str = "",
        absolute: bool = False,
        note: str = "",
    ) -> None:
        """A number beside a reference; tolerance: a share of it, or absolute in its unit."""
        way: Comparison = "absolute" if absolute else "relative"
        values = float(ours), unit, float(reference), tolerance
        self.append(Row(quantity, *values, way, source, note))

    def bound(
        self,
        quantity: str,
        ours: float,
        source: Source,
        *,
        at_most: float | None = None,
        at_least: float | None = None,
        unit: str = "",
        note: str = "",
    ) -> None:
        """A number beside a bound on it; exactly one of the two bounds is given."""
        limit = at_most if at_most is not None else at_least
        way: Comparison = "at most" if at_most is not None else "at least"
        self.append(Row(quantity, float(ours), unit, limit, None, way, source, note))

    def report(self, quantity: str, ours: float, *, unit: str = "", note: str = "") -> None:
        """A number of ours that nothing stands beside."""
        self.append(Row(quantity, float(ours), unit, note=note))


def run_study(study: Study, folder: Path) -> StudyResult:
    """Run a study with its pictures in a folder (made if need be), and time it."""
    folder.mkdir(parents=True, exist_ok=True)
    begin, spent = time.perf_counter(), time.process_time()
    result = study.run(folder)
    return replace(
        result, seconds=time.perf_counter() - begin, processor_seconds=time.process_time() - spent
    )


INCHES = (7.0, 4.6)
DOTS = 110
# Okabe and Ito's, told apart by the colour-blind too
COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#56b4e9", "#e69f00")


def draw(
    file: Path, caption: str, paint: Callable[[Any], None], inches: tuple[float, float] = INCHES
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
