"""A study: one thing of the literature, computed anew and put beside the published values.

A study is a function of a folder for its pictures; it returns rows of numbers, each with its
verdict, and figures. The verdict follows from the numbers and is never written by hand. Every
number that is compared says with what (Source): only one that is printed in a publication, or a
solution by another method, can confirm it.
Listing all studies imports nothing heavy.

Pages of the texts that studies are held against, as their own tables of contents have them.

Where a text lists its tables and figures that is their page; else it is the range from the first
page of the section that holds them to that of the next.
"""

from __future__ import annotations

import importlib
import math
import re
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

from featherfx.errors import InputError, Problem
from featherfx.lab.bench.report import can_plot

_JOUVE = {
    "equation 4.1": "47-49",
    "equation A.5": "88-89",
    "equation 6.6": "78-79",
    "figure 5.8": "59-64",
    "figure 6.6": "75-78",
    "figure 6.8": "78-83",
    "figure D.3": "102-106",
    "section 3.3": "38-47",
    "section D.3": "103-106",
    "table 5.1": "59-64",
    "table 5.2": "64-67",
    "table D.2": "106-108",
}
_HOUGHTON = {
    "equation 5.35": "84-89",
    "equation 6.24": "106-109",
    "equation 6.31": "111-113",
    "equation 6.34": "111-113",
    "equation 6.35": "126-128",
    "figure 5.14": "95",
    "figure 6.16": "121",
    "figure 6.17": "122",
    "figure 6.19": "123",
    "figure 6.20": "124",
    "figure 6.24": "126",
    "figure 6.25": "127",
    "figure 6.26": "129",
    "figure 6.28": "129",
    "section 2.2.4": "28-31",
    "section 5.3.1": "84-89",
    "section 5.4.1": "93-96",
    "section 7.1": "137-140",
    "table 5.1": "83",
    "table 5.2": "83",
    "table 5.3": "84",
    "table 5.4": "89",
    "table 5.5": "92",
    "table 5.6": "97",
    "table 6.3": "131",
    "table 6.5": "134",
    "table 6.6": "134",
    "table 6.7": "135",
    "table 6.8": "135",
}
_JACQUEMOUD = {
    "figure 4-15": "177-193",
    "figure 4-16": "177-193",
    "section 4.5.2.2": "177-193",
    "table A5-3": "253-270",
}
PAGES = {"Jouve 2024": _JOUVE, "Houghton 2020": _HOUGHTON, "Jacquemoud 2007": _JACQUEMOUD}
_PLACE = re.compile(
    r"(?:\b(table|figure|equation|section)s? |(?<= and )|(?<=, ))((?:[A-E]?\d+[.-])+\d+|[A-E]\.\d+)"
)


def with_pages(text: str) -> str:
    """The source of a number, with the page behind each table, figure, equation or section.

    Raises KeyError for a place in one of these texts whose page is not listed here.
    """
    pages = PAGES.get(text.split(",")[0])
    if pages is None:
        return text
    kind = ""

    def paged(found: re.Match[str]) -> str:
        nonlocal kind
        kind = found[1] or kind
        page = pages[f"{kind} {found[2]}"]
        return f"{found[0]} ({'pp.' if '-' in page else 'p.'} {page})"

    return _PLACE.sub(paged, text)


Verdict = Literal["agrees", "differs", "holds", "fails", "only with itself", "no comparison"]
Kind = Literal["published", "independent", "self"]
Comparison = Literal["relative", "absolute", "at most", "at least", "none"]


@dataclass(frozen=True)
class Source:
    """Reference of a number.

    kind: "published", a number that is printed in the text, or what it says "in words";
    "independent", a solution by another method or of another model; "self": our own input, our own
    finer mesh, what was fitted to, or what is true by construction. text: the publication and the
    place in it, or the method, or what of ours it is.
    """

    kind: Kind
    text: str


def published(text: str) -> Source:
    """A number that is printed; text: publication, and table, equation, figure or section, to
    which the page is added where it is known."""
    return Source("published", with_pages(text))


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
    def is_time(self) -> bool:
        """Return whether ours is a time, or a ratio of times."""
        return self.unit in ("s", "s/s")

    @property
    def verdict(self) -> Verdict:
        """Return whether ours agrees with the reference, or what a text says in words holds of it;
        a number that is not finite never does."""
        if self.comparison == "none" or self.reference is None:
            return "no comparison"
        if self.comparison == "at most":
            right = self.ours <= self.reference
        elif self.comparison == "at least":
            right = self.ours >= self.reference
        else:
            scale = abs(self.reference) if self.comparison == "relative" else 1.0
            right = abs(self.ours - self.reference) <= scale * (self.tolerance or 0.0)
        if self.source is not None and "in words" in self.source.text:
            return "holds" if right else "fails"
        return "agrees" if right else "differs"


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
        if any(row.verdict in ("differs", "fails") for row in self.rows):
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
    def is_of_networks(self) -> bool:
        """Return whether it is about networks of fibres or skin, not feathers."""
        return self.place.split(":")[0].endswith((".networks", ".space", ".tissue"))

    @property
    def run(self) -> Callable[[Path], StudyResult]:
        """The function."""
        module, _, name = self.place.partition(":")
        found: Callable[[Path], StudyResult] = getattr(importlib.import_module(module), name)
        return found


class Comparisons(list[Row]):
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


_INCHES = (7.0, 4.6)
_DOTS = 110
# Okabe and Ito's, told apart by the colour-blind too
LINE_COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#56b4e9", "#e69f00")


def draw(
    file: Path, caption: str, paint: Callable[[Any], None], inches: tuple[float, float] = _INCHES
) -> tuple[Figure, ...]:
    """Write a PNG that paint draws on an empty matplotlib Figure; () without matplotlib."""
    if not can_plot():
        return ()
    from matplotlib import figure, rc_context

    file.parent.mkdir(parents=True, exist_ok=True)
    with rc_context({"axes.prop_cycle": f"cycler('color', {list(LINE_COLOURS)})"}):
        canvas = figure.Figure(figsize=inches, layout="constrained")
        paint(canvas)
        # no version or date inside: the same numbers give the same file
        canvas.savefig(file, format="png", dpi=_DOTS, metadata={"Software": None})
    return (Figure(file, caption),)


# of each: name, module and function here, title; then what it reproduces
_LISTED = """\
elastica rods:elastica Cantilever under a force at its tip
    Bisshopp and Drucker 1945; Mattiasson 1981, table 1
heavy_elastica rods:heavy Rod clamped level under its weight
    Kirchhoff's rod, by shooting
bend_45 rods:bend_of_45_degrees 45 degree bend
    Bathe and Bolourchi 1979; Simo and Vu-Quoc 1986
frequencies rods:frequencies Natural frequencies of a clamped rod
    closed form; Rayleigh and Ritz
released_rod rods:released A rod let go
    chain of rigid links
feather_masses feathers:masses Presets beside feathers that were weighed, shaken and pulled
    Harvey et al. 2022, data of AvInertia; abstracts of Deng et al. 2022 and others
feathers_in_air whole_feathers:in_air Feathers in air beside plates, strips and wings
    Lindenburg 2003 (ECN-C--03-025); abstracts of Withers 1981 and others
vane_locking vane:locking Locking of unaligned meshes
    Jouve 2024, figures 4.4 and 4.7; Jouve et al. 2024, figure 5
vane_mesoscale vane:mesoscale Barbs and barbules as bands
    Jouve 2024, eq. 5.2 and 5.4, table 5.1
vane_size_effect vane:size_effect Size effect in compression along the barbs
    Jouve 2024, figures A.5 and A.6
vane_shear_modulus vane:shear_modulus Shear modulus of the membrane from tilted tests of bands
    Jouve 2024, tables 5.2 and D.2; Jouve et al. 2024, table 1
vane_samples vane:samples The measured samples: tilted tests, Poisson effect, share of barbs
    Jouve 2024, table 3.1, section 3.3, figures 3.10, 5.6, 5.8 and D.3
vane_angles vane:angles Slopes at all angles, and the shear band
    Jouve 2024, figures 5.11 and 5.12; Jouve et al. 2024, figures 9 and 11
ribbon_cantilever ribbons:cantilever Ribbon and rod clamped level, under their weight
    Charrondiere et al. 2019, figure 7
ribbon_hanging ribbons:hanging A curled ribbon leaves its plane as its length grows
    Charrondiere et al. 2019, section 5.1 and figure 9
ribbon_degree ribbons:degree A curled ribbon by rigid links and by power series
    Charrondiere et al. 2019, sections 3.2 and 3.3
ribbon_shell ribbons:shell A thin shell beside the ribbon
    Charrondiere et al. 2019, section 5.3 and figure 6
ribbon_and_rod ribbons:against_rod The curled ribbon beside a rod of rectangular section
    Charrondiere et al. 2019, section 5.5 and figure 9
ribbon_ends ribbons:ends A curled ribbon by its equations of equilibrium, and one held at both ends
    Charrondiere et al. 2019, sections 5.2 and 6
full_feather_side whole_feathers:side_pull A whole feather, its vane pulled
    Jouve 2024, figure 6.9; Jouve et al. 2024, figure 1
full_feather_tip whole_feathers:tip_pull A whole feather, its tip pulled
    Jouve 2024, figure 6.5
guard_truss whole_feathers:guard Does a penalty on lost area make a truss buckle?
    Jouve 2024, equation 6.6 and figure 6.8
fibre_lattice networks:lattice Triangular lattices, whole and diluted, and their iterative solution
    Houghton 2020, section 5.3, tables 5.4 and 5.5; section 2.2.4
fibre_random networks:random Random networks: rigidity, affinity, iterative solution
    Houghton 2020, section 5.4, figure 5.14 and table 5.6; section 2.2.4
fibre_merging networks:merging What merging of near crossings costs
    Houghton 2020, section 5.2.4, tables 5.1 to 5.3
fibre_large networks:large Networks under large strain
    Houghton 2020, section 7.1
fibre_space space:small Small networks in space, in a medium, and by steps of pseudo-time
    Houghton 2020, sections 6.2 and 6.4, tables 6.5 to 6.8
fibre_layers space:random Random networks in space and layers of them
    Houghton 2020, sections 6.3 and 6.4, table 6.3, figures 6.16 to 6.25
fibre_contours space:contours Shares of the energy of layers, over density and distance
    Houghton 2020, figures 6.19, 6.20 and 6.26 to 6.28
fibre_solvers space:lattices A sparse factorisation beside preconditioned iterations
    Houghton 2020, section 5.3
vane_solvers space:vane Preconditioned iterations on the nodal matrix of a vane
    Houghton 2020, section 4.2, on a feather
fibre_rupture tissue:rupture A membrane of fibres is pulled until it tears
    Jacquemoud 2007, sections 4.5 and 4.6
tissue_laws tissue:laws Laws of soft tissue with the parameters printed for skin
    Jacquemoud 2007, sections 2.4 to 2.6, tables 2-1, 2-2 and A5-3
contact_rest rods:plates_at_rest Plates that bear each other's load
    Timoshenko and Young 1961
contact_motion rods:plates_in_motion Plates that swing, slide and collide
    Timoshenko and Young 1961; Coulomb's friction
"""


def _listed() -> tuple[Study, ...]:
    lines, found = _LISTED.splitlines(), []
    for head, reproduces in zip(lines[::2], lines[1::2], strict=True):
        name, place, title = head.split(" ", 2)
        found.append(Study(name, title, reproduces.strip(), f"featherfx.lab.studies.{place}"))
    return tuple(found)


STUDIES = _listed()


def studies(names: Sequence[str] = ()) -> list[Study]:
    """The studies of the given names, or all; in the order of the report.

    Raises InputError with every name that there is no study of.
    """
    known = {study.name: study for study in STUDIES}
    wrong = [name for name in dict.fromkeys(names) if name not in known]
    if wrong:
        allowed = ", ".join(known)
        raise InputError(
            *(Problem("lab", "only", f"'{each}' is not allowed. Give {allowed}") for each in wrong)
        )
    return [study for study in STUDIES if not names or study.name in names]
