"""A rectangular vane of any bending moduli, held at one end, that is bent by its weight.

    W = 1/2 k.D k per area,    k = (k_11, k_22, 2 k_12),    D = [[D_11, D_12, 0],
                                                                 [D_12, D_22, 0],
                                                                 [0,    0,    D_66]]

1 along the barbs, which lie at an angle to the plate's length, 2 across them. A plate that is
narrow beside its length L bends and twists as a rod of the compliance d = D'^-1, D' in the plate's
own axes: its moment q (L - x)^2 / 2 gives it the curvatures d_11 and d_16 / 2 times as much, so
that under a load q its end is q d_11 L^4 / 8 below its clamp and turned by q d_16 L^3 / 12
(Lekhnitskii 1968). A wide one is stiffer, because its clamp lets it neither curl nor twist.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import radians

import numpy as np

from featherfx.algebra.types import Array
from featherfx.errors import Problem, require
from featherfx.groom.materials import VaneMaterial
from featherfx.lab.declare import POSITIVE, Range, out_of_range, value
from featherfx.lab.feathers.strip import strip_feather, strip_kind
from featherfx.lab.nodal.model import nodal_model
from featherfx.lab.nodal.plate import hinge_places, plate_tables
from featherfx.lab.nodal.solver import NodalSolver
from featherfx.lab.nodal.state import nodal_rest_state
from featherfx.mechanics.batch import make_model
from featherfx.mechanics.model import no_loads
from featherfx.solver.solver import Settings, raise_if_failed

_GRAVITY = 9.81
# of the membrane, which such small deflections do not stretch
_THICKNESS, _STRETCH = 1e-4, 1e4
# m over the deflection, that the pose may be off
_CLOSE = 1e-6


@dataclass(frozen=True)
class PlateTest:
    """Bend a rectangular vane of any bending moduli by its weight, held at one end."""

    along: float = value("N m, bending modulus along the barbs, D_11.", allowed=POSITIVE)
    across: float = value("N m, across them, D_22.", allowed=POSITIVE)
    twist: float = value("N m, in twist, D_66; D (1 - poisson) / 2 if isotropic.", allowed=POSITIVE)
    coupling: float = value("N m, D_12; D times Poisson's ratio if isotropic.", 0.0, Range())
    angle: float = value(
        "Of the barbs to the length of the plate.", 90.0, Range(-180.0, 180.0, unit="deg")
    )
    length: float = value("m", 0.1, POSITIVE)
    width: float = value("m", 0.01, POSITIVE)
    deflection: float = value(
        "Of a narrow plate's end under its weight, over its length.",
        1e-4,
        Range(0.0, 0.01, above=True),
    )
    rows: int = value("Cells along the plate.", 80, Range(4, 2000))
    columns: int = value("Cells to each side of its middle.", 4, Range(1, 100))


@dataclass(frozen=True)
class PlateRun:
    """Outcome of a PlateTest. load: N/m^2. deflection: m, of the middle of the free end, downwards,
    and twist: rad, of that end about the plate's length. narrow_deflection, narrow_twist: of a
    plate that is narrow beside its length."""

    load: float
    deflection: float
    twist: float
    narrow_deflection: float
    narrow_twist: float


def run_plate(test: PlateTest) -> PlateRun:
    """Bend a plate. Raises InputError with every wrong value, SimulationError where no balance is
    found."""
    problems = out_of_range(test, "plate")
    if not problems and test.coupling**2 >= test.along * test.across:
        most = np.sqrt(test.along * test.across)
        message = f"{test.coupling:g}; allowed: less than {most:g} either way"
        problems.append(Problem("plate", "coupling", message))
    require(*problems)
    moduli = _turned(test)
    compliance = np.linalg.inv(moduli)
    load = 8.0 * test.deflection / (compliance[0, 0] * test.length**3)
    end = _bent(test, moduli, load)
    sides = end[2 * test.columns] - end[test.columns]
    return PlateRun(
        load=load,
        deflection=float(-end[0, 2]),
        twist=float(sides[2] / sides[1]),
        narrow_deflection=test.deflection * test.length,
        narrow_twist=float(-load * compliance[0, 2] * test.length**3 / 12.0),
    )


def _turned(test: PlateTest) -> Array:
    """(3, 3) N m, D' for curvatures along the plate (x), across it (y) and twice the twist."""
    c, s = np.cos(radians(test.angle)), np.sin(radians(test.angle))
    turn = np.array(
        [[c * c, s * s, c * s], [s * s, c * c, -c * s], [-2 * c * s, 2 * c * s, c * c - s * s]]
    )
    own = np.array(
        [[test.along, test.coupling, 0.0], [test.coupling, test.across, 0.0], [0, 0, test.twist]]
    )
    moduli: Array = turn.T @ own @ turn
    return moduli


def _bent(test: PlateTest, moduli: Array, load: float) -> Array:
    """(1 + 2 m, 3) m, nodes of the free end of the plate under a load (N/m^2)."""
    # the plate bends from the middle between the two rows that are held on
    cell = test.length / (test.rows - 0.5)
    whole = test.length + 0.5 * cell
    vane = VaneMaterial(
        modulus_along_barbs=_STRETCH / _THICKNESS,
        modulus_across_barbs=_STRETCH / _THICKNESS,
        shear_modulus=0.5 * _STRETCH / _THICKNESS,
        thickness=_THICKNESS,
        surface_density=load / _GRAVITY,
        barb_bending_normal=test.along,
        barb_bending_in_plane=0.0,
        barb_taper=0.0,
        bending_across=test.across,
        loss_factor=0.0,
    )
    kind = strip_kind(whole, vane)
    feather = strip_feather(whole, test.width, test.rows + 1, test.columns)
    model = make_model([feather], [kind], 0)
    pinned = np.zeros((test.rows + 1, 1 + 2 * test.columns), dtype=np.bool_)
    pinned[:2] = True
    nodal = nodal_model(model, [feather], [kind], bending="plate", shaft=False, pinned=pinned)
    y, x, xy = 1, 0, 2
    order = np.ix_((y, x, xy), (y, x, xy))
    weight = moduli[order] * np.outer((1.0, 1.0, 2.0), (1.0, 1.0, 2.0))
    area = np.full(feather.cell.shape, 0.5 * cell * 0.5 * test.width / test.columns)
    table = plate_tables(feather.rest.nodes, area, hinge_places(feather.cell), weight)
    nodal = nodal._replace(plate=table[None])
    settings = Settings(1e30, _CLOSE * test.deflection * test.length, 1, 0.0)
    state = nodal_rest_state(model, nodal, np.zeros((1, 3)), np.eye(3)[None])
    solver = NodalSolver(model, nodal, settings)
    bent, status, _ = solver.equilibrium(state, no_loads(1, (0.0, 0.0, -_GRAVITY)))
    raise_if_failed(status, np.zeros(1), ["plate"])
    end: Array = bent.points.nodes[0, -1] - bent.points.nodes[0, 0, 0]
    return end
