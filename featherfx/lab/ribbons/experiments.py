"""Experiments on one ribbon: hung by one end, and beside a rod of the same bending stiffness.

Gravity is (0, -9.81, 0) m/s^2. The clamp is at the origin, the strip's width along z.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from featherfx.algebra.types import Array
from featherfx.errors import InputError, Problem, require
from featherfx.feather.build import build_feather
from featherfx.groom.materials import RachisMaterial, VaneMaterial
from featherfx.groom.types import BarbGuide, FeatherKind, RachisShape, VaneShape
from featherfx.lab.declare import FINITE, NOT_NEGATIVE, POSITIVE, out_of_range, part, value
from featherfx.lab.ribbons.energy import Ribbon
from featherfx.lab.ribbons.ribbon import Air, FixedSteps, RibbonMotion, RibbonRest, settle_ribbon
from featherfx.lab.ribbons.rod import Rod, rod_loads, rod_model, tributary_length
from featherfx.mechanics.batch import make_model
from featherfx.mechanics.model import Loads, Model, no_loads
from featherfx.solver.solver import Settings, Solver, raise_if_failed
from featherfx.solver.state import rest_state

Clamp = Literal["level", "down", "up"]

GRAVITY_ALONG_Y = np.array([0.0, -9.81, 0.0])
# direction along the strip and normal to it, at the clamp; a rest curvature curls a level strip
# downwards
_CLAMPS: dict[str, tuple[tuple[float, ...], tuple[float, ...]]] = {
    "level": ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0)),
    "down": ((0.0, -1.0, 0.0), (1.0, 0.0, 0.0)),
    "up": ((0.0, 1.0, 0.0), (1.0, 0.0, 0.0)),
}
# elements of a rod, and how far gravity is tilted to let it leave its plane
_ROD_SEGMENTS, _TILT = 200, 1e-3
# width over length of the ribbons of the cantilever curve, how their stations crowd, and elements
_NARROW, _GRADING, _ELEMENTS = 0.05, 2.5, 20


@dataclass(frozen=True)
class HangTest:
    """Rest shape of a developable strip under its weight.

    Unknowns are its normal curvature and the slope of its rulings; gravity is along -y, the width
    along z. `stability` is the lowest eigenvalue of the energy's Hessian, in units of rigidity
    times width over length with curvatures times the length: negative where the shape is not
    stable, which only --planar shows.

    With --seconds it then moves in a wind, and `times` (s) and `tips` (m) tell where its end goes.
    """

    ribbon: Ribbon = part("finite_width")
    sadowsky: bool = value("The limit of a narrow ribbon.", False)
    clamp: Clamp = value("Direction at the clamp.", "level")
    planar: bool = value("Stay in the plane of the clamp, stable or not.", False)
    wind: float = value("m/s, along x.", 0.0, FINITE)
    seconds: float = value("s, that it moves.", 0.0, NOT_NEGATIVE)
    step: float = value("s, of the motion.", 0.01, POSITIVE)


@dataclass(frozen=True)
class Hung:
    """A ribbon at rest, and how it lies. rest: its shape. out_of_plane: m, largest distance from
    the plane of the clamp. seconds: of the solve."""

    rest: RibbonRest
    out_of_plane: float
    seconds: float


def clamp_frame(clamp: Clamp) -> Array:
    """(3, 3) columns across, normal and along the strip at its clamp. Raises InputError."""
    if clamp not in _CLAMPS:
        message = f"'{clamp}' is not one of {', '.join(_CLAMPS)}"
        raise InputError(Problem("ribbon", "clamp", message))
    along, normal = (np.array(each) for each in _CLAMPS[clamp])
    return np.stack([np.cross(normal, along), normal, along], axis=1)


def hang(ribbon: Ribbon, clamp: Clamp = "level", *, planar: bool = False) -> Hung:
    """A rest shape of a ribbon under its weight.

    planar: stay in the plane of the clamp, also where that is not stable. Raises InputError for an
    unknown clamp, SimulationError where no shape is found.
    """
    frame = clamp_frame(clamp)
    begin = time.perf_counter()
    rest = settle_ribbon(ribbon, frame, GRAVITY_ALONG_Y, leave_saddles=not planar)
    seconds = time.perf_counter() - begin
    return Hung(rest, float(np.abs(rest.curve.points[:, 2]).max()), seconds)


def blown(test: HangTest, hung: Hung) -> tuple[Array, Array]:
    """Times (T,) s and places (T, 3) m of the tip of a ribbon that hung and moves in the wind.

    Raises InputError for values out of range, SimulationError where a step finds no solution.
    """
    problems = out_of_range(test, "ribbon")
    if test.ribbon.series:
        problems.append(Problem("ribbon", "series", "is for rest. What moves is made of links"))
    require(*problems)
    ribbon = replace(test.ribbon, finite_width=not test.sadowsky)
    moving = RibbonMotion(ribbon, clamp_frame(test.clamp), GRAVITY_ALONG_Y)
    state, pace = moving.let_go(hung.rest.unknowns), FixedSteps(test.step)
    times, tips = [0.0], [hung.rest.curve.points[-1]]
    while times[-1] < test.seconds - 0.5 * test.step:
        state = moving.advance(state, pace, Air((test.wind, 0.0, 0.0)))
        times.append(state.time)
        tips.append(moving.points(state.unknowns)[-3])
    return np.array(times), np.array(tips)


def planar_limit(ribbon: Ribbon, clamp: Clamp, shortest: float, longest: float) -> float:
    """Length (m) at which the planar shape of a ribbon stops being a minimum of the energy.

    Bisection between two lengths; the other values are the ribbon's. NaN if the planar shape is
    stable at the longest or not at the shortest.
    """

    def stable(length: float) -> bool:
        return hang(replace(ribbon, length=length), clamp, planar=True).rest.stability > 0.0

    return _last(stable, shortest, longest, 1e-3)


def _last(holds: Callable[[float], bool], low: float, high: float, accuracy: float) -> float:
    if not holds(low) or holds(high):
        return float("nan")
    while high - low > accuracy:
        middle = 0.5 * (low + high)
        low, high = (middle, high) if holds(middle) else (low, middle)
    return 0.5 * (low + high)


def cantilever_ratios(loads: Sequence[float]) -> Array:
    """Drop over reach of the tip of ribbons clamped level, under their weight.

    loads: ascending, weight per length times length^3 over D w. Each shape starts from the one
    before. The stations crowd at the clamp: under a large load the strip bends only there.
    """
    frame, start, ratios = clamp_frame("level"), None, []
    for load in loads:
        density = load / float(np.linalg.norm(GRAVITY_ALONG_Y))
        ribbon = Ribbon(1.0, _NARROW, 1.0, density, elements=_ELEMENTS, grading=_GRADING)
        rest = settle_ribbon(ribbon, frame, GRAVITY_ALONG_Y, start=start)
        start, tip = rest.unknowns, rest.curve.points[-1]
        ratios.append(-tip[1] / tip[0])
    return np.array(ratios)


def rod_of(ribbon: Ribbon, thickness: float) -> Rod:
    """The rod of rectangular section that would commonly stand for a ribbon.

    Its bending stiffness out of the plane is the plate's, D w; within the plane
    (1 - nu^2) D w (w / h)^2; torsion from Saint-Venant's series for a rectangle w by h.
    thickness: h, m. Raises InputError for a ribbon that tapers or whose rest curvature varies.
    """
    if ribbon.tip_width not in (None, ribbon.width) or np.shape(ribbon.rest_curvature):
        message = "tapers or has a rest curvature that varies. Give a uniform strip"
        raise InputError(Problem("ribbon", "rod", message))
    width, poisson = ribbon.width, ribbon.poisson
    ei = ribbon.rigidity * width
    odd = 2.0 * np.arange(10) + 1.0
    series = float(np.sum(np.tanh(0.5 * odd * np.pi * width / thickness) / odd**5))
    correction = 1.0 - 192.0 / np.pi**5 * thickness / width * series
    return Rod(
        ribbon.length,
        ei,
        ei2=(1.0 - poisson**2) * ei * (width / thickness) ** 2,
        # Y / (2 (1 + nu)) w h^3 / 3 with Y h^3 = 12 (1 - nu^2) D
        gj=2.0 * (1.0 - poisson) * ei * correction,
        rest_curvature=float(ribbon.rest_curvature),
        segments=_ROD_SEGMENTS,
    )


def hang_rod(rod: Rod, line_density: float) -> Array:
    """(n, 3) m, points of a rod clamped level at rest in the frame of the ribbon experiments.

    line_density: kg/m. Gravity is tilted by a thousandth out of the plane, so that a rod which is
    unstable in it leaves it. Raises InputError, SimulationError.
    """
    across, normal, along = clamp_frame("level").T
    loads = rod_loads(rod)
    loads.force[0, :, 0] = line_density * tributary_length(rod)[:, None] * _tilted(_TILT)
    root = np.stack([along, -normal, across], axis=1)
    return _rest(rod_model(rod), root, [loads], 1e-8 * rod.length)


def _tilted(fraction: float) -> Array:
    """(3,) m/s^2, gravity with a share of it out of the plane."""
    return GRAVITY_ALONG_Y + np.array([0.0, 0.0, fraction * np.linalg.norm(GRAVITY_ALONG_Y)])


def _rest(model: Model, root: Array, loads: Sequence[Loads], move: float) -> Array:
    """(n, 3) m, the rachis at rest under the last of some loads, each from the rest of the one
    before. root: (3, 3) of the clamp, at the origin. move: m, that ends Newton."""
    state = rest_state(model, np.zeros((1, 3)), root[None])
    solver = Solver(model, Settings(newton=move))
    for each in loads:
        state, status, _ = solver.equilibrium(state, each)
        raise_if_failed(status, state.time, ["strip"])
    return np.array(state.centre[0])


# m, and moduli and density, of a rachis that is as good as none
_RACHIS_SIZE, _NOTHING = 1e-5, 1.0


def feather_of(ribbon: Ribbon, thickness: float) -> FeatherKind:
    """The feather that a uniform ribbon is in a shot (mechanics/ribbon_kernels.py).

    thickness: m. What it lacks beside the ribbon is what fans of rulings add where the strip is
    wide; what it has besides, the stretch of a strip that is not infinitely thin.
    """
    half = 0.5 * ribbon.width / ribbon.length
    vane = VaneShape(((0.0, half), (1.0, half)), (BarbGuide(0.0, 90.0), BarbGuide(1.0, 90.0)))
    return FeatherKind(
        name="ribbon",
        length=ribbon.length,
        calamus=0.0,
        vane_material=VaneMaterial(
            modulus_along_barbs=_NOTHING,
            modulus_across_barbs=_NOTHING,
            shear_modulus=_NOTHING,
            barb_bending_normal=_NOTHING,
            barb_bending_in_plane=_NOTHING,
            thickness=thickness,
            surface_density=ribbon.surface_density,
            bending_across=ribbon.rigidity,
            ribbon=True,
            poissons_ratio=ribbon.poisson,
        ),
        rachis_material=RachisMaterial(
            youngs_modulus=_NOTHING,
            shear_modulus=_NOTHING,
            cortex_fraction=1.0,
            cortex_density=_NOTHING,
        ),
        rachis=RachisShape(
            _RACHIS_SIZE,
            _RACHIS_SIZE,
            camber=np.degrees(float(ribbon.rest_curvature) * ribbon.length),
        ),
        leading=vane,
        trailing=vane,
    )


def hang_feather(kind: FeatherKind, rows: int) -> Array:
    """(rows, 3) m, the rachis of a feather clamped level at rest in the frame of the ribbon
    experiments.

    It leaves its plane as in `hang_rod`, then gravity is straight. Raises InputError,
    SimulationError.
    """
    across, normal, along = clamp_frame("level").T
    loads = [no_loads(1, tuple(_tilted(fraction))) for fraction in (0.1, 0.0)]
    model = make_model([build_feather(kind, rows, 1)], [kind], 0)
    return _rest(model, np.stack([along, across, normal], axis=1), loads, 1e-6 * kind.length)
