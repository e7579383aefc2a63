"""Samples of a hooked vane between two clamps: torn apart, and loaded and unloaded in turns.

A rectangle whose barbs lie along its width, in the barb-curvature kinematics without a rachis.
Every row is a barb that moves by itself, joined to the next by barbules alone. The clamps hold
the first and the last barb whole. The pull is across the barbs, along them (the gaps are sheared),
or at 45 degrees. Tears are pulled at a steady speed, in which what opening gaps release sets the
barbs in motion; cycles go from rest to rest.

Where a pull crushes a corner of the sample the membrane of the vane has no resistance left, so the
samples have a compression guard (guard_kernels).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import atan2, degrees, radians
from typing import Any, Literal

import numpy as np
from scipy.ndimage import label

from featherfx.algebra.types import Array, Flags, Indices
from featherfx.errors import Problem, require
from featherfx.feather.types import Feather, FeatherSurface, RowPoints
from featherfx.groom.materials import VaneMaterial
from featherfx.groom.types import FeatherKind, Hooked, Splits
from featherfx.lab.declare import POSITIVE, Range, out_of_range, value
from featherfx.lab.feather import feather_kind
from featherfx.mechanics.batch import make_model
from featherfx.mechanics.model import Loads, Model, no_loads
from featherfx.mechanics.vane_rest import cell_weights
from featherfx.solver.solver import Settings, Solver, hold_roots, raise_if_failed
from featherfx.solver.state import State, rest_state
from featherfx.solver.step.energy_kernels import elastic_energy
from featherfx.solver.step.gap_kernels import (
    DAMPED_ENERGY,
    OPENING_WORK,
    RELEASED_ENERGY,
    SLIP_WORK,
)

Direction = Literal["across", "along", "tilted"]

_ANGLES = {"across": 0.0, "tilted": 45.0, "along": 90.0}
# Pa, of the compression guard; chosen so that corners of sheared samples stay open
_GUARD = 1e8
# N/m of each node of a clamp; a sample of this size has some 5 N/m in all
_CLAMP = 1e4
# s, Kelvin-Voigt; at one sample height a second it adds 0.3 % to the strength
_RELAXATION = 1e-3
# m. Where gaps open the sample snaps; with these and _RADIUS the steps lose less than 1 % of the
# work (a tolerance of 1e-6 with radius 0: 2 to 6 %)
_TOLERANCE, _SETTLED = 1e-9, 3e-10
_RADIUS = 0.8
_MAX_ITERATIONS = 20000
# of a part of the pull: what gives way at once may not slip far in one of them, because a gap does
# not weaken within a step
_MAX_SUBSTEPS = 4096
# of a reported step of the pull: strength and work are those of the parts. A sample parts within a
# hundredth of its height, over which its stress grows by 3 %
_PARTS = 20
_RACHIS_SIZE = 1e-4
# rows below which strips are of one height
_FEWEST = 5
# 2 bear 3 % more along the barbs than 3, more of them 0.2 % less (8 columns, until a gap opens)
_COEFFICIENTS = 3


@dataclass(frozen=True)
class SampleOf:
    """width, height: m, along and across the barbs. rows: barbs. columns: cells of a barb. gap: m,
    height of the strips beside the clamps, which are one real gap; 0: as the others."""

    width: float = 13e-3
    height: float = 14e-3
    rows: int = 21
    columns: int = 8
    gap: float = 0.0

    @property
    def stations(self) -> Array:
        """(rows,) m, of the barbs."""
        if self.gap == 0.0 or self.rows < _FEWEST or 2.0 * self.gap >= self.height:
            return np.linspace(0.0, self.height, self.rows)
        inner = np.linspace(self.gap, self.height - self.gap, self.rows - 2)
        return np.concatenate([[0.0], inner, [self.height]])

    def feather(self) -> Feather:
        """The sample as a feather without a rachis: barbs along +y on the leading side."""
        n, m = self.rows, self.columns
        nodes = np.zeros((n, 1 + 2 * m, 3))
        station = self.stations
        nodes[:, :, 0] = station[:, None]
        nodes[:, 1 : 1 + m, 1] = self.width * np.arange(1, m + 1) / m
        directors = np.broadcast_to(np.eye(3)[1:], (n, 2, 3)).copy()
        cell = np.zeros((2, n - 1, m, 2), dtype=np.bool_)
        cell[0] = True
        length, span = np.zeros((2, n)), np.zeros((2, n))
        length[0], span[0] = self.width, np.gradient(station)
        none, corners = np.zeros(0, dtype=np.int64), np.zeros((0, 3))
        return Feather(
            rest=RowPoints(nodes, directors),
            station=station / self.height,
            width=np.full(n, _RACHIS_SIZE),
            height=np.full(n, _RACHIS_SIZE),
            barb_length=length,
            barb_span=span,
            cell=cell,
            surface=FeatherSurface(
                none, none, corners[:, :2], corners.astype(int), none, corners, corners[:, :2]
            ),
        )


@dataclass(frozen=True)
class TearTest:
    """Pull a sample of a hooked vane until it parts along a gap between two barbs.

    Keys: strength (Pa; null where it has not parted), energy_per_length (J/m of split), split_angle
    (degrees away from the barbs), split_length (m), work, stored, dissipated (J), of the last
    slip_work, opening_work, released_energy (that gaps had stored), damping_work (J), unaccounted
    (J; of the work, what the steps of the motion lose), strain, stress (lists).
    """

    direction: Direction = value("Of the pull, to the barbs; along: the gaps are sheared.")
    rows: int = value("Simulated barbs.", 21, Range(3, 201))
    columns: int = value("Cells of a barb.", 8, Range(1, 50))
    preset: str = value("Feather preset whose vane it is.", "swan_primary")
    width: float = value("m, along the barbs.", 13e-3, POSITIVE)
    height: float | None = value(
        "m, across the barbs; without: 0.014, or 0.006 where the pull is along them.",
        None,
        POSITIVE,
    )
    rate: float = value("1/s, speed of the pull over the height.", 1.0, POSITIVE)
    step: float = value("Of the pull that is reported, over the height.", 0.01, Range(1e-5, 0.2))
    furthest: float = value("Pull over the height at which it ends.", 2.0, Range(0.01, 10.0))
    scatter: float = value("Deviation of the strength from gap to gap.", 0.01, Range(0.0, 0.5))
    release: float | None = value(
        "m, opening over which a gap loses its strength; without: the preset's.", None, POSITIVE
    )


@dataclass(frozen=True)
class CycleTest:
    """Load a sample of a hooked vane to given strains and back, in turns.

    Keys: strain, stress (lists through the cycles), stress_at_zero (Pa, after each cycle), loss
    (J/m^3, of each).
    """

    direction: Literal["across", "tilted"] = value("Of the pull, to the barbs.", "across")
    strains: str = value("Pull over the height of each cycle, with commas.", "0.1,0.2,0.3")
    rows: int = value("Simulated barbs.", 11, Range(3, 201))
    columns: int = value("Cells of a barb.", 4, Range(1, 50))
    preset: str = value("Feather preset whose vane it is.", "swan_primary")
    parts: int = value("Steps of a way up or down.", 20, Range(2, 1000))


@dataclass(frozen=True)
class CyclePoint:
    """A sample between clamps. pull: of the clamp, over the height. stress: Pa, force along the
    pull over the section at rest. stored, kinetic: J. spent: (5,) J, of the model's Gaps."""

    pull: float
    stress: float
    stored: float
    kinetic: float
    spent: Array


class HookedSample:
    """A sample between its clamps; go brings it to rest at another place of the moving clamp."""

    def __init__(self, size: SampleOf, vane: VaneMaterial, kind: FeatherKind, angle: float) -> None:
        """angle: degrees, of the pull to the normal of the barbs in the vane."""
        self.size, self.feather = size, size.feather()
        self.section = size.width * vane.thickness
        # of the material: where a preset's vane is loose or split does not count
        whole = replace(kind.leading, hooked=Hooked(), splits=Splits())
        kind = replace(kind, leading=whole, vane_material=vane)
        model = make_model([self.feather], [kind], _COEFFICIENTS)
        model.rachis_stiffness[:] = 0.0
        self.model: Model = model._replace(held=np.zeros(1, dtype=np.bool_))
        self.way = np.array([np.cos(radians(angle)), np.sin(radians(angle)), 0.0])
        self.model.retardation[:] = _RELAXATION
        self.solver = Solver(
            self.model,
            Settings(
                tolerance=_TOLERANCE,
                newton=_SETTLED,
                max_iterations=_MAX_ITERATIONS,
                max_substeps=_MAX_SUBSTEPS,
                spectral_radius=_RADIUS,
            ),
        )
        self.state: State = rest_state(self.model, np.zeros((1, 3)), np.eye(3)[None])
        self.still = hold_roots(self.state)
        self.pull = 0.0

    def go(self, pull: float, seconds: float = 0.0) -> CyclePoint:
        """Bring the clamp there evenly within a time (s), or, with none, the sample to rest there.

        Raises SimulationError where that fails.
        """
        loads = self._loads(self.pull if seconds > 0.0 else pull, pull)
        if seconds > 0.0:
            report = self.solver.advance(self.state, loads, self.still, seconds)
            status = report.status
        else:
            self.state, status, _ = self.solver.equilibrium(self.state, loads)
        raise_if_failed(status, self.state.time, ["sample"])
        self.pull = pull
        clamped = self._clamp(self.size.rows - 1)
        held = self.state.points.nodes[0, clamped[:, 0], clamped[:, 1]]
        apart = loads.grip_end[0, len(clamped) :] - held
        strains, gaps = self.state.strains.at(0, 0), self.state.gaps_of(0)
        rates = self.state.velocity.nodes[0]
        kinetic = 0.5 * np.einsum("np,npk->", self.model.mass[0], rates**2)
        return CyclePoint(
            pull=pull,
            stress=_CLAMP * float((apart @ self.way).sum()) / self.section,
            stored=float(elastic_energy(self.model, 0, strains, strains, gaps, 0.0, 0.0)),
            kinetic=float(kinetic),
            spent=gaps.spent.copy(),
        )

    def _clamp(self, row: int) -> Indices:
        """(m + 1, 2) row and node of all nodes of a row's barb, root to end."""
        return np.array([(row, node) for node in range(1 + self.size.columns)])

    def _loads(self, start: float, end: float) -> Loads:
        """Both clamps, the moving one on its way."""
        nodes = np.concatenate([self._clamp(0), self._clamp(self.size.rows - 1)])
        count = len(nodes) // 2
        targets = []
        for pull in (start, end):
            target = self.feather.rest.nodes[nodes[:, 0], nodes[:, 1]].copy()
            target[count:] += pull * self.size.height * self.way
            targets.append(target[None])
        return no_loads(1)._replace(
            gravity=np.zeros(3),
            grip_node=nodes[None],
            grip_start=targets[0],
            grip_end=targets[1],
            grip_stiffness=np.full((1, 2 * count), _CLAMP),
        )

    @property
    def opened(self) -> Flags:
        """(n-1, m, 2) which triangles are open."""
        hooked: Array = self.state.gaps.hooked[0, 0]
        return hooked == 0.0

    @property
    def opened_length(self) -> float:
        """m, of all splits; each triangle of a cell is half of its length."""
        return 0.5 * self.size.width / self.size.columns * float(self.opened.sum())

    @property
    def spent_length(self) -> float:
        """m, of all splits, and of what is weakened by its part of an opening's energy; each
        triangle for its weight in sums along the barb."""
        hooked: Array = self.state.gaps.hooked[0, 0]
        lost = (1.0 - hooked**2) * cell_weights(self.size.columns)[..., 0]
        return 0.5 * self.size.width / self.size.columns * float(lost.sum())

    @property
    def parted(self) -> bool:
        """Return whether a gap is open from end to end."""
        return bool(self.opened.all(axis=(1, 2)).any())


@dataclass(frozen=True)
class Torn:
    """path: of the pull, at rest first. strength: Pa, largest stress, also between its points, of a
    sample that has parted.
    opened_length: m, of all splits. spent_length: m, as of HookedSample. split_angle: degrees, of
    the longest to the barbs. work: J, of the clamp."""

    path: Sequence[CyclePoint]
    strength: float | None
    opened_length: float
    spent_length: float
    split_angle: float
    work: float

    def as_json(self) -> dict[str, Any]:
        """Plain values by key, SI units."""
        last = self.path[-1]
        opening = last.spent[OPENING_WORK]
        return {
            "strength": self.strength,
            "energy_per_length": opening / self.spent_length if self.opened_length else None,
            "split_angle": self.split_angle,
            "split_length": self.opened_length,
            "work": self.work,
            "stored": last.stored + last.kinetic,
            "dissipated": float(last.spent.sum()),
            "slip_work": last.spent[SLIP_WORK],
            "opening_work": opening,
            "released_energy": last.spent[RELEASED_ENERGY],
            "damping_work": last.spent[DAMPED_ENERGY],
            "unaccounted": self.work - last.stored - last.kinetic - float(last.spent.sum()),
            "strain": [point.pull for point in self.path],
            "stress": [point.stress for point in self.path],
        }


def tear(test: TearTest) -> Torn:
    """Raises InputError for values out of range or a preset without gaps."""
    kind = _kind_with_gaps("tear", test.preset)
    vane = replace(
        kind.vane_material, hooks="open", hook_scatter=test.scatter, compression_guard=_GUARD
    )
    if test.release is not None:
        vane = replace(vane, hook_release=test.release)
    require(*out_of_range(test, "tear"))
    usual = 6e-3 if test.direction == "along" else 14e-3
    height = usual if test.height is None else test.height
    # what is sheared begins to part in the corners of its clamps, within a few gaps
    gap = 0.0 if test.direction == "across" else kind.barb_spacing
    size = SampleOf(test.width, height, test.rows, test.columns, gap)
    sample = HookedSample(size, vane, kind, _ANGLES[test.direction])
    path, work, strength, parted = [sample.go(0.0)], 0.0, 0.0, False
    # one step more after it has parted, in which the rest comes loose
    while path[-1].pull < test.furthest and not parted:
        parted, last = sample.parted, path[-1]
        for pull in np.linspace(last.pull, last.pull + test.step, _PARTS + 1)[1:].tolist():
            before, last = last, sample.go(pull, test.step / _PARTS / test.rate)
            way = (last.pull - before.pull) * size.height
            work += 0.5 * (last.stress + before.stress) * sample.section * way
            strength = max(strength, last.stress)
        path.append(last)
    return Torn(
        path=path,
        strength=strength if sample.parted else None,
        opened_length=sample.opened_length,
        spent_length=sample.spent_length,
        split_angle=_split_angle(sample),
        work=work,
    )


def _kind_with_gaps(where: str, preset: str) -> FeatherKind:
    kind = feather_kind(preset)
    if kind.vane_material.ribbon:
        text = f"'{preset}' is a ribbon. Give vanes, whose barbs have gaps between them"
        require(Problem(where, "preset", text))
    return kind


def _split_angle(sample: HookedSample) -> float:
    """Degrees between the barbs and the line through the triangles of the split: those that are
    opened and hang together with most others. 0 where there are less than two columns."""
    size = sample.size
    groups, count = label(sample.opened.any(axis=2), np.ones((3, 3)))
    if count == 0:
        return 0.0
    longest = int(np.argmax(np.bincount(groups.ravel())[1:])) + 1
    rows, columns = np.nonzero(groups == longest)
    if np.ptp(columns) == 0:
        return 0.0
    across = size.stations[rows]
    along = columns * size.width / size.columns
    slope = float(np.polyfit(along, across, 1)[0])
    return abs(degrees(atan2(slope, 1.0)))


def cycle(test: CycleTest) -> dict[str, Any]:
    """Raises InputError for values out of range or a preset without gaps."""
    problems = out_of_range(test, "cycle")
    try:
        strains = [float(each) for each in test.strains.split(",")]
    except ValueError:
        strains = []
    if not strains or not all(0.0 < each <= 1.0 for each in strains):
        text = f"'{test.strains}' is not allowed. Give numbers above 0 to 1 with commas, as 0.1,0.2"
        problems.append(Problem("cycle", "strains", text))
    require(*problems)
    kind = _kind_with_gaps("cycle", test.preset)
    vane = replace(kind.vane_material, hooks="slip", compression_guard=_GUARD)
    size = SampleOf(rows=test.rows, columns=test.columns)
    sample = HookedSample(size, vane, kind, _ANGLES[test.direction])
    path, at_zero, loss = [sample.go(0.0)], [], []
    for strain in strains:
        begin = len(path) - 1
        up = np.linspace(0.0, strain, test.parts + 1)
        path += [sample.go(float(pull)) for pull in (*up[1:], *up[-2::-1])]
        pulls = [point.pull for point in path[begin:]]
        loss.append(float(np.trapezoid([point.stress for point in path[begin:]], pulls)))
        at_zero.append(path[-1].stress)
    return {
        "strain": [point.pull for point in path],
        "stress": [point.stress for point in path],
        "stress_at_zero": at_zero,
        "loss": loss,
    }
