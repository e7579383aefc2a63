"""Ribbons: the cantilever curve, a hanging curl that leaves its plane, and a rod beside it.

All after Charrondiere, Bertails-Descoubes, Neukirch and Romero 2019.
"""

from __future__ import annotations

import time
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from scipy.interpolate import PchipInterpolator
from scipy.special import ellipe, ellipk

from featherfx.lab.ribbons.curve import LINKS
from featherfx.lab.ribbons.energy import Ribbon
from featherfx.lab.ribbons.experiments import (
    GRAVITY_ALONG_Y,
    cantilever_ratios,
    clamp_frame,
    feather_of,
    hang,
    hang_feather,
    hang_rod,
    planar_limit,
    rod_of,
)
from featherfx.lab.ribbons.oracles import heavy_elastica, shell_tip, solved
from featherfx.lab.ribbons.ribbon import FarClamp, RibbonMotion, settle_ribbon
from featherfx.lab.ribbons.rod import Rod, bend, enough_segments
from featherfx.lab.studies.study import (
    Comparisons,
    StudyResult,
    draw,
    independent,
    ourselves,
    published,
)

# the published curve spans slopes from linear theory to a strip that hangs down
_LOADS = 10.0 ** np.arange(-3.0, 5.01, 0.5)
# section 5.1: 1 cm wide, 100 g/m^2, natural curvature 60 1/m, Poisson's ratio 0.5, D = 2e-4
_CURL = Ribbon(0.5, 0.01, 2e-4, 0.1, 60.0)
_LENGTHS = (0.05, 0.10, 0.20, 0.27, 0.31, 0.35, 0.40, 0.50)
_THICKNESS = 1e-4


def cantilever(folder: Path) -> StudyResult:
    """Drop over reach of a strip clamped level, over the range of the load parameter."""
    exact = np.array([drop / x for x, drop in map(heavy_elastica, _LOADS)])
    ribbon = cantilever_ratios(_LOADS.tolist())
    rod, segments = [], []
    for load in _LOADS:
        rough = Rod(1.0, 1.0, line_weight=float(load))
        segments.append(enough_segments(rough, float(load)))
        tip = bend(replace(rough, segments=segments[-1])).tip
        rod.append(-tip[2] / tip[0])
    rows = Comparisons()
    text = "drop / reach of the elastica at load 0.001"
    rows.compare(text, exact[0], _LOADS[0] / 8.0, 1e-4, independent("linear theory, load / 8"))
    shooting = independent("planar elastica, by shooting")
    for k in range(0, len(_LOADS), 2):
        for name, found in (("ribbon", ribbon), (f"rod of {segments[k]} segments", rod)):
            rows.compare(
                f"drop / reach, {name}, load {_LOADS[k]:g}", found[k], exact[k], 5e-3, shooting
            )

    rows += _many_strips(exact)

    def paint(canvas: Any) -> None:
        axes = canvas.add_subplot()
        axes.loglog(_LOADS, _LOADS / 8.0, "k:", label="linear theory, load / 8")
        axes.loglog(_LOADS, exact, "r-", label="planar elastica, shooting")
        axes.loglog(_LOADS, ribbon, "bo", mfc="none", label="ribbon, 20 elements")
        axes.loglog(_LOADS, rod, "g+", label=f"rod, {min(segments)} to {max(segments)} segments")
        axes.set_ylim(exact[0] / 3.0, 3.0 * exact[-1])
        axes.set_xlabel("weight per length, times length^3, over bending stiffness")
        axes.set_ylabel("drop over reach of the tip")
        axes.legend()

    caption = "Cantilever under its weight, figure 7 of Charrondiere et al. 2019."
    return StudyResult(rows, draw(folder / "ribbon_cantilever.png", caption, paint))


def hanging(folder: Path) -> StudyResult:
    """A naturally curled strip, of growing length."""
    limit = planar_limit(_CURL, "level", 0.20, 0.40)
    narrow = planar_limit(replace(_CURL, finite_width=False), "level", 0.20, 0.40)
    note = (
        "the clamp is not told; level here, as the published first guess. D is printed"
        " with the unit N m^2, but only 2e-4 N m, the plate's rigidity, gives the published shapes."
    )
    rows = Comparisons()
    source = published("Charrondiere et al. 2019, section 5.1: 29 cm")
    rows.compare(
        "length beyond which it leaves its plane", limit, 0.29, 0.02, source, unit="m", note=note
    )
    rows.report("the same in Sadowsky's limit of a narrow strip", narrow, unit="m")
    rows.report("the same, hung downwards", planar_limit(_CURL, "down", 0.2, 0.4), unit="m")
    seen = ourselves("a bound of ours; the publication shows the shapes, figure 9")
    shapes = {length: hang(replace(_CURL, length=length)) for length in _LENGTHS}
    for length, hung in shapes.items():
        ratio = hung.out_of_plane / length
        text = f"distance from its plane at length {length:g} m, over length"
        if length < 0.29:
            rows.bound(text, ratio, seen, at_most=1e-6, note="shown: planar below 29 cm")
        else:
            rows.bound(text, ratio, seen, at_least=0.01, note="shown: out of its plane")
    last = shapes[_LENGTHS[-1]]
    rows.report("seconds of the longest", last.seconds, unit="s", note="published: 2.1 s")
    curves = {length: hung.rest.curve.points for length, hung in shapes.items()}
    figures = draw(
        folder / "ribbon_hanging.png",
        "A curled strip hanging from a level clamp, of length 5 to 50 cm (figure 9): planar up to"
        " 27 cm.",
        lambda canvas: _paint_curves(canvas, curves, {}),
        (9.0, 5.0),
    )
    return StudyResult(rows, figures)


# section 5.4: 5 cm wide, 1200 kg/m^3, 1 mm thick, Poisson's ratio 0.5; Young's moduli (Pa) and
# lengths (m) of 2,500 strips, of which those are taken that _LOADS span
_SHEET = Ribbon(1.0, 0.05, 1.0, 1.2, elements=20, grading=2.5)
_YOUNGS, _STRIPS = np.geomspace(0.5e6, 10e6, 50), np.linspace(0.05, 0.9, 50)
_SHEET_THICKNESS = 1e-3
# figure 8: length, width, thickness (m) of a strip of PET; its modulus (Pa), Poisson's ratio and
# density are not printed: those of a film are table 1 of Mylar's product information H-37232-3
_PET = (0.29, 0.03, 0.143e-3)
_PET_FILM = 500.0 * 9.80665e6, 0.38, 1390.0


def _many_strips(exact: np.ndarray) -> Comparisons:
    """Strips of section 5.4 beside the elastica, and what one takes. exact: ratios at _LOADS."""
    rigidities = _YOUNGS * _SHEET_THICKNESS**3 / (12.0 * (1.0 - _SHEET.poisson**2))
    weight = _SHEET.surface_density * float(np.linalg.norm(GRAVITY_ALONG_Y))
    strips = sorted(
        (weight * length**3 / rigidity, length, rigidity)
        for rigidity in rigidities.tolist()
        for length in _STRIPS.tolist()
    )
    strips = [each for each in strips if each[0] <= _LOADS[-1]]
    curve = PchipInterpolator(np.log(_LOADS), np.log(exact))
    start, before, worst = None, 1.0, 0.0
    begin = time.process_time()
    for load, length, rigidity in strips:
        strip = replace(_SHEET, length=length, rigidity=rigidity)
        if start is not None:
            start[: strip.elements + 1] *= before / length
        rest = settle_ribbon(strip, clamp_frame("level"), GRAVITY_ALONG_Y, start=start)
        start, before = rest.unknowns.copy(), length
        ratio = -rest.curve.points[-1, 1] / rest.curve.points[-1, 0]
        worst = max(worst, abs(ratio / float(np.exp(curve(np.log(load)))) - 1.0))
    spent = time.process_time() - begin
    young, poisson, density = _PET_FILM
    length, width, thickness = _PET
    rigidity = young * thickness**3 / (12.0 * (1.0 - poisson**2))
    pet = density * thickness * float(np.linalg.norm(GRAVITY_ALONG_Y)) * length**3 / rigidity
    x, drop = heavy_elastica(pet)
    shell = shell_tip(pet, width / length, thickness / length, poisson)
    note = (
        f"load {pet:.3g}; its modulus is not printed and the figure is a photograph: with that of a"
        " film of Mylar (product information H-37232-3, table 1: 490 and 510 kg/mm^2)"
    )
    rows = Comparisons()
    rows.bound(
        f"drop / reach of {len(strips)} strips, largest difference from the elastica",
        worst,
        independent("planar elastica, by shooting, interpolated between loads"),
        at_most=0.01,
        note="of 2,500 with moduli and lengths over the published ranges, those up to the last"
        " load of the curve",
    )
    rows.report("processor time of all of them", spent, unit="s")
    rows.report("drop / reach of the strip of PET of figure 8, elastica", drop / x, note=note)
    rows.report("the same, thin shell", shell[1] / shell[0])
    return rows


# section 5.3: length 1, D 1, weight 100 per area, Poisson's ratio and width, width over thickness
_SHELL_LOAD, _SHELL_POISSON, _SHELL_WIDTH = 100.0, 0.4, 0.03
_THINNESS = (10, 20, 50, 100, 200)


def shell(folder: Path) -> StudyResult:
    """Section 5.3: a thin shell of growing width over thickness beside the ribbon."""
    density = _SHELL_LOAD / float(np.linalg.norm(GRAVITY_ALONG_Y))
    ribbon = Ribbon(1.0, _SHELL_WIDTH, 1.0, density, poisson=_SHELL_POISSON, grading=2.5)
    begin = time.process_time()
    tip = settle_ribbon(ribbon, clamp_frame("level"), GRAVITY_ALONG_Y).curve.points[-1, :2] * [
        1.0,
        -1.0,
    ]
    spent = time.process_time() - begin
    section = independent("a thin shell whose section is free to curl (Lamb 1891), by collocation")
    words = published("Charrondiere et al. 2019, section 5.3, in words")
    note = "clamp and rest curvature are not printed: level and flat here; figure 6 is a picture"
    gaps = []
    for thinness in _THINNESS:
        found = shell_tip(_SHELL_LOAD, _SHELL_WIDTH, _SHELL_WIDTH / thinness, _SHELL_POISSON)
        gaps.append(float(np.linalg.norm(found - tip)))
    rows = Comparisons()
    for each, gap in zip(_THINNESS[:-1], gaps, strict=False):
        rows.report(f"gap of the tips over length, shell of w / h = {each:g}", gap)
    rows.bound(
        "gap of the tips over length, shell of w / h = 200", gaps[-1], section, at_most=0.005
    )
    rows.bound("its gap over that of w / h = 10", gaps[-1] / gaps[0], words, at_most=1.0, note=note)
    rows.report("processor time of the ribbon", spent, unit="s", note="published: 0.1 s")

    def paint(canvas: Any) -> None:
        axes = canvas.add_subplot()
        axes.loglog(_THINNESS, gaps, "o-")
        axes.set_xlabel("width over thickness of the shell")
        axes.set_ylabel("gap of the tips of shell and ribbon over length")

    caption = "A thin shell clamped level under its weight nears the ribbon as it becomes thin."
    return StudyResult(rows, draw(folder / "ribbon_shell.png", caption, paint))


# section 5.2; D in N m, as in the other figures
_BARB = Ribbon(0.5, 0.015, 2e-4, 0.015, 30.0, elements=40)
# m, thicknesses of it in a shot, and rows
_THIN, _FILM, _BAKED_ROWS = 1e-6, 84e-6, 161


def _from_equations(thickness: float, points: np.ndarray) -> float:
    """Largest gap over length between the strip of section 5.2 in a shot and points (N, 3)."""
    found = hang_feather(feather_of(_BARB, thickness), _BAKED_ROWS)
    place = np.linspace(0.0, 1.0, len(points))
    along = np.linspace(0.0, 1.0, _BAKED_ROWS)
    exact = np.stack([np.interp(along, place, points[:, k]) for k in range(3)], axis=1)
    # it may leave its plane to either side
    found[:, 2] *= np.sign(found[-1, 2] * exact[-1, 2])
    return float(np.abs(found - exact).max() / _BARB.length)


def ends(folder: Path) -> StudyResult:
    """One end held, beside the equations of equilibrium; both, beside the elastica."""
    rest, frame = hang(_BARB).rest, clamp_frame("level")
    exact_points = solved(_BARB, rest, frame, GRAVITY_ALONG_Y)
    gap = np.abs(exact_points - rest.curve.points).max() / _BARB.length
    equations = independent("equations of equilibrium, by collocation")
    shown = "the text shows two curves that are nearly identical (section 5.2, figure 5)"
    text = "largest gap over length, strip of section 5.2"
    rows = Comparisons()
    rows.bound(text, float(gap), equations, at_most=1e-3, note=shown)
    away = _from_equations(_THIN, exact_points)
    rows.bound("the same in a shot, 1 micrometre thick", away, equations, at_most=0.01)
    away = _from_equations(_FILM, exact_points)
    note = "of 3 GPa: not so thin that it would be developable"
    rows.report("the same in a shot, 84 micrometres thick", away, note=note)
    # section 6 has both ends held as work to do
    strip = Ribbon(0.1, 0.005, 2e-4, 0.05, elements=16)
    first, second = ellipk(_MODULUS**2), ellipe(_MODULUS**2)
    apart = strip.length * (2.0 * second / first - 1.0)
    far = FarClamp(np.array([apart, 0.0, 0.0]), frame)
    held = RibbonMotion(strip, frame, np.zeros(3), far)
    turns = -20.0 * np.cos(2.0 * np.pi * strip.stations / strip.length)
    state = held.at_rest(np.concatenate([turns, np.zeros(strip.elements + 1)]))
    height = float(np.abs(held.points(state.unknowns)[:, 1]).max())
    push = -float(state.pull.sum(axis=0)[0])
    elastica = independent("elastica clamped at both ends, elliptic integrals")
    note = f"ends {apart / strip.length:.3f} of the length apart"
    exact = 16.0 * first**2 * strip.rigidity * strip.width / strip.length**2
    rows.compare(
        "height of a strip held at both ends, over length",
        height / strip.length,
        _MODULUS / first,
        5e-3,
        elastica,
        note=note,
    )
    rows.compare("force that holds it", push, exact, 5e-3, elastica, unit="N")
    return StudyResult(rows)


# of the elliptic integrals of the strip that is held at both ends
_MODULUS = 0.5


class Discretisation(NamedTuple):
    """Discretisation of a strip. degree: of curvature and ruling on an element. links: of an
    element; 0: power series. counts: numbers of elements that are tried."""

    degree: int
    links: int
    counts: tuple[int, ...]


_LINKED = "1 link an element"
_WAYS = {
    _LINKED: Discretisation(1, 1, (5, 10, 20, 40)),
    "8 links": Discretisation(1, 8, (5, 10, 20, 40)),
    "power series": Discretisation(1, 0, (5, 10, 20, 40)),
    "power series of degree 2": Discretisation(2, 0, (5, 10, 20)),
    "power series of degree 3": Discretisation(3, 0, (3, 5)),
}


def degree(folder: Path) -> StudyResult:
    """Error of the tip against the number of unknowns, by links and by power series."""
    ribbon = replace(_CURL, length=0.25)
    clamp, rows = clamp_frame("level"), Comparisons()
    exact = solved(ribbon, settle_ribbon(ribbon, clamp, GRAVITY_ALONG_Y), clamp, GRAVITY_ALONG_Y)[
        -1
    ]
    errors: dict[tuple[str, int], float] = {}
    for name, way in _WAYS.items():
        for count in way.counts:
            far = np.linalg.norm(_tip(replace(ribbon, elements=count), way) - exact)
            errors[name, count] = float(far) / ribbon.length
            text = f"error of the tip over length, {count} elements, {name}"
            rows.report(text, errors[name, count])
    source = independent("Wunderlich's equations of equilibrium, by collocation")
    many = errors[_LINKED, 40]
    for name, count in (
        ("power series", 10),
        ("power series of degree 2", 5),
        ("power series of degree 3", 3),
    ):
        text = f"error of {count} elements by {name} over that of 40 of one link"
        note = f"{2 * (_WAYS[name].degree * count + 1)} unknowns against 82"
        rows.bound(text, errors[name, count] / many, source, at_most=1.0, note=note)
    text = "error of 5 elements by power series of degree 1 over that of 40 of one link"
    note = "12 unknowns: its lines miss the curvature, links or not"
    rows.report(text, errors["power series", 5] / many, note=note)
    finest = errors["power series of degree 2", 20]
    text = "error of the tip over length, 20 elements of degree 2"
    rows.bound(text, finest, source, at_most=1e-5)

    def paint(canvas: Any) -> None:
        axes = canvas.add_subplot()
        for name, way in _WAYS.items():
            unknowns = [2 * (way.degree * count + 1) for count in way.counts]
            axes.loglog(unknowns, [errors[name, k] for k in way.counts], "o-", label=name)
        axes.set(xlabel="unknowns", ylabel="error of the tip over length")
        axes.legend()

    caption = "A curled strip of 25 cm: error of its tip by the number of unknowns."
    return StudyResult(rows, draw(folder / "ribbon_degree.png", caption, paint))


def _tip(ribbon: Ribbon, way: Discretisation) -> np.ndarray:
    ribbon = replace(ribbon, degree=way.degree, series=not way.links)
    rest = settle_ribbon(ribbon, clamp_frame("level"), GRAVITY_ALONG_Y, links=way.links or LINKS)
    return rest.curve.points[-1]


def against_rod(folder: Path) -> StudyResult:
    """The same strip as a ribbon and as a rod of rectangular section, of growing length."""
    rows = Comparisons()
    rod = independent("a rod of directors, of the same bending stiffness")
    apart = ourselves("a bound of ours; the publication says that they part where torsion appears")
    ribbons, rods = {}, {}
    for length in _LENGTHS:
        ribbon = replace(_CURL, length=length)
        ribbons[length] = hang(ribbon).rest.curve.points
        rods[length] = hang_rod(rod_of(ribbon, _THICKNESS), ribbon.surface_density * ribbon.width)
        gap = float(np.linalg.norm(_extent(ribbons[length]) - _extent(rods[length]))) / length
        text = f"distance of the tips at length {length:g} m, over length"
        if length < 0.29:
            rows.bound(text, gap, rod, at_most=0.01)
        else:
            rows.bound(text, gap, apart, at_least=0.02)
    caption = (
        "Ribbon (blue) and rod of the same bending stiffness (orange), of length 5 to 50 cm; the"
        " rod's thickness is a hundredth of its width."
    )
    figures = draw(
        folder / "ribbon_and_rod.png",
        caption,
        lambda canvas: _paint_curves(canvas, ribbons, rods),
        (9.0, 5.0),
    )
    return StudyResult(rows, figures)


def _extent(points: np.ndarray) -> np.ndarray:
    """The tip, on whichever side of the plane the curve went."""
    side = np.sign(points[np.abs(points[:, 2]).argmax(), 2]) or 1.0
    return points[-1] * np.array([1.0, 1.0, side])


def _paint_curves(canvas: Any, first: dict[float, np.ndarray], second: dict) -> None:
    for k, length in enumerate(first):
        axes = canvas.add_subplot(2, 4, k + 1, projection="3d")
        for points, colour in ((first[length], "C0"), (second.get(length), "C1")):
            if points is not None:
                axes.plot(points[:, 0], points[:, 2], points[:, 1], color=colour, lw=1.2)
        axes.set_title(f"{100 * length:g} cm", fontsize=9)
        axes.set_box_aspect((1, 1, 2))
        axes.set_xlim(-0.05, 0.05)
        axes.set_ylim(-0.05, 0.05)
        axes.set_zlim(-0.2, 0.02)
        axes.tick_params(labelsize=5)
