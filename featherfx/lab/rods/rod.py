"""Rods for experiments: a rachis without vane, straight or bent to a circle at rest.

    stiffness of an element = l / integral of ds / EI(s)      (its exact compliance)
    mass of a row           = integral of rho A(s) N_i(s) ds  (N_i linear hat of the row)

with s the arc length, so both are second order in the element length l, and a uniform or tapered
rod under end loads bends as it should between rows. The section scales linearly by
c = 1 - taper s / length: bending and torsion by c^4, stretch, shear and mass by c^2. Half of the
elements are spread evenly, half so that c falls by the same share along each: a rod that ends in a
point would else hang its tip on one element that is far too soft for what little it carries.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from featherfx.algebra.types import Array
from featherfx.errors import Problem, require
from featherfx.lab.declare import FINITE, POSITIVE, Range, out_of_range, value
from featherfx.mechanics.model import Loads, Model, no_hooks, no_loads
from featherfx.solver.state import State, rest_state

Vector = tuple[float, float, float]

# stretch and shear stiffness of rods that are to have none, in units of EI / length^2: a load of
# EI / length^2 stretches them by one part in a million; more would cost digits of the forces
_RIGID = 1e6
# and at least this many times the load, for loads that are beyond all bending
_STIFFER = 1e5
# radius of gyration of the section as a share of the length, for rotary inertia
_GYRATION = 1e-4
# mass that gives statics a time scale to settle in: length^4 line mass / EI, s^2
_SETTLING = 1e-2


@dataclass(frozen=True)
class Rod:
    """A rod of circular or other doubly symmetric section, clamped at the origin, leaving along +x.

    Where ea or ga is not given, stretch or shear is practically rigid: 1e6 ei / length^2, or 1e5
    times the load if that is more. line_mass: where not given, length^4 line mass / ei = 0.01 s^2.
    """

    length: float = value("m.", allowed=POSITIVE)
    ei: float = value("Bending in the xy plane, N m^2.", allowed=POSITIVE)
    ei2: float | None = value(
        "Bending out of the xy plane, N m^2.  [default: that of --ei]", None, POSITIVE
    )
    gj: float | None = value("Torsion, N m^2.  [default: that of --ei]", None, POSITIVE)
    ea: float | None = value("Stretch, N.  [default: inextensible]", None, POSITIVE)
    ga: float | None = value("Shear, N.  [default: unshearable]", None, POSITIVE)
    taper: float = value(
        "Share C of the width lost at the tip: stiffness (1 - C s/L)^4, mass (1 - C s/L)^2.",
        0.0,
        Range(0.0, 1.0, below=True),
    )
    rest_curvature: float = value("1/m, in the xy plane, towards +y.", 0.0, FINITE)
    line_mass: float | None = value("kg/m at the clamp.", None, POSITIVE)
    line_weight: float = value("N/m at the clamp, along -z; tapers as the mass does.", 0.0, FINITE)
    segments: int = value("Elements of the rod.", 40, Range(2, 10_000))


def rod_problems(rod: Rod) -> list[Problem]:
    """Every value of the rod that is out of its range."""
    problems = out_of_range(rod, "rod")
    largest = np.pi * rod.segments / (rod.length or 1.0)
    if not problems and not abs(rod.rest_curvature) < largest:
        allowed = f"below {largest:g} 1/m in size (half a turn per segment)"
        message = f"{rod.rest_curvature:g}; allowed: {allowed}"
        problems.append(Problem("rod", "rest_curvature", message))
    return problems


def rod_model(rod: Rod, load: float = 0.0) -> Model:
    """Constant arrays of a batch of one rod: no columns, no curvature coefficients.

    load: N, size of the forces that act on it besides its weight; matters where nothing but they
    tells how stiff an inextensible rod must be. Raises InputError with every value that is out of
    its range.
    """
    require(*rod_problems(rod))
    rows = rod.segments + 1
    station = stations(rod)
    length = np.diff(station)
    # the chord of an arc is shorter than the arc
    half = 0.5 * rod.rest_curvature * length
    rachis_rest = np.zeros((rod.segments, 6))
    rachis_rest[:, 0] = np.sinc(half / np.pi)
    rachis_rest[:, 5] = 2.0 * half
    mass = (line_mass(rod) * tributary_length(rod))[None, :, None]
    barbs = (1, 2, rows, 0)
    return Model(
        held=np.ones(1, dtype=np.bool_),
        length=length[None],
        rachis_rest=rachis_rest[None],
        rachis_stiffness=_stiffness(rod, station, load)[None],
        clamp=np.broadcast_to(np.array([1.0, 0.0, 0.0, 0.0]), (1, 2, rows, 4)).copy(),
        joints=np.zeros((*barbs, 4)),
        segment=np.zeros((1, 2, rows)),
        shapes=np.zeros((0, 0)),
        barb_stiffness=np.zeros(barbs),
        cell_rest=np.zeros((1, 2, rows - 1, 0, 2, 3)),
        cell_stiffness=np.zeros((1, 2, rows - 1, 0, 2, 2)),
        hinge_rest=np.zeros((*barbs, 3)),
        hinge_stiffness=np.zeros(barbs),
        twist_rest=np.zeros((1, 2, rows - 1, 0, 2)),
        twist_stiffness=np.zeros((1, 2, rows - 1, 0)),
        mass=mass,
        rotary_inertia=np.repeat(mass * (_GYRATION * rod.length) ** 2, 2, axis=2),
        rachis_area=np.zeros((1, rows)),
        retardation=np.zeros((1, 2)),
        hooks=no_hooks(1, rows),
    )


def stations(rod: Rod) -> Array:
    """(n,) m, arc lengths of the rows."""
    even = np.linspace(0.0, 1.0, rod.segments + 1)
    if rod.taper == 0.0:
        return rod.length * even
    # places so far towards a point that they are known by the section that is left there
    section = np.geomspace(1.0, 1.0 - rod.taper, 1 + 64 * rod.segments)
    place = (1.0 - section) / rod.taper
    fraction = 0.5 * place + 0.5 * np.linspace(0.0, 1.0, len(section))
    found = rod.length * np.interp(even, fraction, place)
    return np.asarray(found)


def line_mass(rod: Rod) -> float:
    """Mass per length at the clamp, kg/m."""
    return _SETTLING * rod.ei / rod.length**4 if rod.line_mass is None else rod.line_mass


def _stiffness(rod: Rod, station: Array, load: float) -> Array:
    """(n-1, 6) rachis_stiffness of Model. load: as for rod_model."""
    load += abs(rod.line_weight) * rod.length
    rigid = max(_RIGID * rod.ei / rod.length**2, _STIFFER * load)
    ea, ga = rod.ea or rigid, rod.ga or rigid
    along = np.array([ea, ga, ga])
    turning = np.array([rod.gj or rod.ei, rod.ei2 or rod.ei, rod.ei])
    length = np.diff(station)
    start = 1.0 - rod.taper * station[:-1] / rod.length
    end = 1.0 - rod.taper * station[1:] / rod.length
    # means of c^-2 and c^-4 over an element, in a form that holds at taper 0
    second = 1.0 / (start * end)
    fourth = (start**2 + start * end + end**2) / (3.0 * (start * end) ** 3)
    stretch = along * (length / second)[:, None]
    bend = turning / (length * fourth)[:, None]
    return np.concatenate([stretch, bend], axis=1)


def tributary_length(rod: Rod) -> Array:
    """(n,) m: integral of the section's area, 1 at the clamp, times each row's linear hat."""
    station = stations(rod)
    length = np.diff(station)
    tributary = np.zeros(len(station))
    # two Gauss points integrate the cubic exactly
    for place in (0.5 - np.sqrt(1.0 / 12.0), 0.5 + np.sqrt(1.0 / 12.0)):
        area = (1.0 - rod.taper * (station[:-1] + place * length) / rod.length) ** 2
        tributary[:-1] += 0.5 * length * area * (1.0 - place)
        tributary[1:] += 0.5 * length * area * place
    return tributary


def straight(model: Model) -> State:
    """A batch of one rod held straight along +x, whatever its rest shape, clamped at the origin."""
    rest = model.rachis_rest.copy()
    rest[:] = [1.0, 0.0, 0.0, 0.0, 0.0, 0.0]
    return clamped(model._replace(rachis_rest=rest))


def rod_loads(
    rod: Rod, tip_force: Vector = (0.0, 0.0, 0.0), points: Sequence[tuple[float, Vector]] = ()
) -> Loads:
    """The rod's weight, a dead force at its tip and dead forces at other places.

    tip_force: N. points: (arc length from the clamp in m, force in N) pairs; a force between rows
    is shared linearly. Raises InputError for places off the rod and forces that are not finite.
    """
    require(*load_problems(rod, tip_force, points))
    force = np.zeros((rod.segments + 1, 3))
    force[:, 2] = -rod.line_weight * tributary_length(rod)
    station = stations(rod)
    for place, vector in ((rod.length, tip_force), *points):
        low = min(int(np.searchsorted(station, place, side="right")) - 1, rod.segments - 1)
        weight = (place - station[low]) / (station[low + 1] - station[low])
        force[low] += (1.0 - weight) * np.asarray(vector)
        force[low + 1] += weight * np.asarray(vector)
    return no_loads(1)._replace(force=force[None, :, None])


def load_problems(
    rod: Rod, tip_force: Vector, points: Sequence[tuple[float, Vector]]
) -> list[Problem]:
    """Every value of a rod and of the loads on it that is out of its range."""
    problems = rod_problems(rod) + [
        Problem("rod", name, f"{vector}; allowed: finite numbers")
        for name, vector in (
            ("tip_force", tip_force),
            *((f"points[{k}]", force) for k, (_, force) in enumerate(points)),
        )
        if not np.isfinite(vector).all()
    ]
    problems += [
        Problem("rod", f"points[{k}]", f"{place:g}; allowed: 0 to {rod.length:g} m")
        for k, (place, _) in enumerate(points)
        if rod.length > 0.0 and not 0.0 <= place <= rod.length
    ]
    return problems


def clamped(model: Model) -> State:
    """A batch of one rod in its rest shape, clamped at the origin, leaving along +x."""
    return rest_state(model, np.zeros((1, 3)), np.eye(3)[None])
