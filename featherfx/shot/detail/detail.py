"""How finely each feather of a shot is simulated.

The meshes always have the quality's rows and columns; a feather that is simulated on another grid
is carried over to them (featherfx/feather/density.py). Levels of detail:

    full      the quality's rows and columns
    coarse    half of both, one coefficient
    rachis    half the rows, one column of rigid barbs
    guided    nothing is solved: follows simulated feathers of its region (guided.py)
    rigid     nothing is solved: the rest shape follows the root
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from featherfx.algebra.types import Array
from featherfx.errors import Problem, require
from featherfx.feather.types import Feather
from featherfx.groom.types import FeatherKind, Placement
from featherfx.mechanics.batch import may_slip
from featherfx.mechanics.resolution import (
    GRID_SCALE,
    barb_load,
    coefficients_for,
    rachis_deflection,
    rows_for,
)
from featherfx.shot.detail.guides import GuideRule, skin_corners
from featherfx.shot.detail.promise import (
    Bends,
    Chosen,
    chosen_for,
    quality_of,
    rounded_down,
    rounded_up,
    stepped_down,
)
from featherfx.shot.loads.wind import exposures
from featherfx.shot.patterns import fits, last_fitting
from featherfx.shot.roots import Roots, sampled_rates
from featherfx.shot.types import Quality, Shot

CHOSEN_BY_SOLVER = -1
# levels at which nothing is solved
CARRIED = ("guided", "rigid")
# accelerations beyond gravity that feathers see, in gravities
LOAD_FACTOR = 3.0
# of the motion, a frame and in a shot at most; the place along a feather that is looked at
SAMPLES_A_FRAME, MOST_SAMPLES = 2, 240
REACH = 0.7
LEAST_ROWS, LEAST_COLUMNS = 6, 2


@dataclass(frozen=True)
class Resolution:
    """What is simulated of a feather: level of detail, rows, columns a side, curvature coefficients
    per barb and direction, and the tolerance of its steps (m)."""

    level: str
    rows: int
    columns: int
    coefficients: int
    tolerance: float

    @property
    def is_simulated(self) -> bool:
        """Whether anything is solved of the feather."""
        return self.level not in CARRIED


class LoadEstimate(NamedTuple):
    """(F,) largest acceleration, m/s^2, and pressure of the air, Pa, on every feather."""

    acceleration: Array
    pressure: Array


class _Given(NamedTuple):
    """What a shot says of a feather's level; named: whether by a [[detail]]."""

    level: str
    rule: GuideRule
    named: bool


class Detailer:
    """What is simulated of the feathers of a shot, at any level.

    feathers: as the meshes have them. levels: of every feather by [[detail]] and length, where
    nothing is seen; rules: how its guides would be chosen; pinned: (F,) whether no camera changes
    its level, as of vanes whose slip a new one would lose; air: (F,) its share of what bends the
    shaft, 0 where it was not asked for. Raises InputError for feathers that are not simulated, but
    pulled.
    """

    def __init__(self, shot: Shot, feathers: Sequence[Feather], motion: Roots) -> None:
        self._quality = shot.quality
        loads = load_estimate(shot, motion)
        bent = None if loads is None else deflections(shot, feathers, loads)
        self.air = np.zeros(len(feathers)) if bent is None else np.array([b.air for b in bent])
        self._chosen = simulated_settings(shot, feathers, loads, bent)
        pulled, placements = _pulled(shot), shot.groom.feathers
        self.free = np.array(last_fitting(shot.detachments, placements)) >= 0
        relative = length_factor(shot)
        given = [_level(shot, placement, relative) for placement in placements]
        self.levels, self.rules = [each.level for each in given], [each.rule for each in given]
        self._hooked = [may_slip(placement.kind) for placement in placements]
        named = [each.named or p.id in pulled for each, p in zip(given, placements, strict=True)]
        self.pinned = np.logical_or(named, self._hooked) | self.free
        problems = [
            Problem(
                str(shot.source),
                "detail",
                f"feather '{placement.id}' is {level}, but {why}",
            )
            for placement, level, free in zip(placements, self.levels, self.free, strict=True)
            for why in (
                *(["a grip or a force pulls it"] if placement.id in pulled else []),
                *(["it leaves its root"] if free else []),
            )
            if level in CARRIED
        ]
        require(*problems)

    def resolution(self, feather: int, level: str) -> Resolution:
        """Of one feather at a level."""
        n, m, count, tolerance = self._chosen[feather]
        if level == "full" and self._hooked[feather]:
            n = self._quality.rows  # a split is drawn where it is
        if level != "full":
            n = min(n, max(LEAST_ROWS, (n + 1) // 2))
            m, count = min(m, max(LEAST_COLUMNS, (m + 1) // 2)), min(count, 1)
        if level == "rachis":
            m, count = 1, 0
        return Resolution(level, n, m, count, tolerance)


def _pulled(shot: Shot) -> set[str]:
    """Ids of the feathers that a grip or a force acts on."""
    return {grip.feather for grip in shot.grips} | {force.feather for force in shot.forces}


def length_factor(shot: Shot) -> float:
    """What the quality's lengths are multiplied by on the shot's body."""
    if not shot.quality.body_size or not shot.groom.feathers:
        return 1.0
    corners = skin_corners(shot)
    places = [each.position for each in shot.groom.feathers]
    points = np.reshape(places if corners is None else corners, (-1, 3))
    size = float(np.linalg.norm(np.ptp(points, axis=0)))
    if corners is None:
        # a feather on its own has no box
        size = max(size, *(each.kind.length for each in shot.groom.feathers))
    return size / shot.quality.body_size


def _level(shot: Shot, placement: Placement, relative: float) -> _Given:
    """By the last detail that fits the feather, else by its length over what is relative."""
    for detail in reversed(shot.details):
        if fits(detail, placement):
            return _Given(detail.level, GuideRule(detail.every, detail.spacing), True)
    length, quality = placement.kind.length / relative, shot.quality
    rule = GuideRule(quality.guided_every, None)
    for level in ("rigid", "guided", "rachis", "coarse"):
        if length < getattr(quality, f"{level}_below"):
            return _Given(level, rule, False)
    return _Given("full", rule, False)


def simulated_settings(
    shot: Shot,
    feathers: Sequence[Feather],
    loads: LoadEstimate | None,
    bent: Sequence[Bends] | None,
) -> list[Chosen]:
    """What is simulated of every feather in full; tolerances are in m.

    Where the quality promises an error, what the front of error against work says for the
    deflections that the loads cause (promise.py). Else the quality's numbers, or, where they are
    -1, the fewest rows and coefficients whose error stays below three times the quality's
    tolerance. Loads: three times gravity and inertia of the roots' acceleration, and the pressure
    of the wind with its gusts and of the roots' speed through the air. At least one coefficient,
    because the vane's shear bends barbs as well, and two where a grip or a force pulls, or the air
    bears the whole feather. feathers: as the meshes have them. bent: their `deflections`.
    """
    quality = quality_of(shot)
    tolerance = quality.tolerance
    if loads is None or bent is None:
        assert tolerance is not None
        rows = min(quality.simulated_rows or quality.rows, quality.rows)
        every = Chosen(rows, quality.own_columns, quality.coefficients, tolerance)
        return [_bounded(every, shot, placement.kind) for placement in shot.groom.feathers]
    pulled = _pulled(shot)
    free = last_fitting(shot.detachments, shot.groom.feathers)
    found = []
    for f, (feather, placement) in enumerate(zip(feathers, shot.groom.feathers, strict=True)):
        kind = placement.kind
        own = settings_for(quality, feather, kind, bent[f], _pressure(kind, loads, f))
        if may_slip(kind):
            own = own._replace(columns=quality.columns)
        if quality.coefficients == CHOSEN_BY_SOLVER and not kind.vane_material.ribbon:
            least = 2 if placement.id in pulled or free[f] >= 0 else 1
            own = own._replace(coefficients=max(own.coefficients, least))
        found.append(_bounded(own, shot, kind))
    return found


def _bounded(own: Chosen, shot: Shot, kind: FeatherKind) -> Chosen:
    """With a tolerance of no more than the quality's part of the feather's length. Feathers that
    push each other take common steps, so theirs is as it is."""
    if shot.quality.tolerance is None or shot.contact is not None:
        return own
    most = stepped_down(shot.quality.relative_tolerance * kind.length)
    return own._replace(tolerance=min(own.tolerance, most))


def settings_for(
    quality: Quality,
    feather: Feather,
    kind: FeatherKind,
    bent: Bends,
    pressure: float,
) -> Chosen:
    """What a quality simulates of a feather whose shaft and barbs loads bend so far (m), with so
    much pressure (Pa) on its vane. feather: as the meshes have it."""
    error, tolerance = quality.promised, quality.tolerance
    if error is not None:
        shaft, barb = (rounded_up(each / kind.length) for each in bent[:2])
        own = chosen_for(error, Bends(shaft, barb, rounded_down(bent.air), bent.wrung))
        own = own._replace(tolerance=tolerance or stepped_down(own.tolerance * kind.length))
        if quality.simulated_columns:
            own = own._replace(columns=quality.own_columns)
    else:
        assert tolerance is not None
        most = GRID_SCALE * tolerance
        rows = (
            quality.rows
            if quality.simulated_rows == 0
            else rows_for(bent.shaft, most, quality.rows)
        )
        count = coefficients_for(feather, kind, _doubled(pressure), most)
        own = Chosen(rows, quality.own_columns, count, tolerance)
    if quality.simulated_rows > 0:
        own = own._replace(rows=min(quality.simulated_rows, quality.rows))
    if quality.coefficients != CHOSEN_BY_SOLVER:
        own = own._replace(coefficients=quality.coefficients)
    return own


def _pressure(kind: FeatherKind, loads: LoadEstimate, feather: int) -> float:
    """Pa on the vane of a feather by its own inertia and the air."""
    inertia = kind.vane_material.surface_density * loads.acceleration[feather]
    return float(inertia + loads.pressure[feather])


def _doubled(pressure: float) -> float:
    """The next power of two: loads within a factor of two are treated alike."""
    return float(2.0 ** np.ceil(np.log2(max(pressure, 1e-9))))


def deflections(shot: Shot, feathers: Sequence[Feather], loads: LoadEstimate) -> list[Bends]:
    """How far (m) the loads, grips and forces of a shot bend every feather's shaft, and loads would
    bend its barbs if they bent in proportion."""
    # a grip bends the shaft as far as it reaches
    reach = {grip.feather: float(np.linalg.norm(grip.displacement)) for grip in shot.grips}
    reach |= {force.feather: np.inf for force in shot.forces}
    wrung = _wrung(shot)
    found = []
    for f, (feather, placement) in enumerate(zip(feathers, shot.groom.feathers, strict=True)):
        kind = placement.kind
        inert = rachis_deflection(feather, kind, loads.acceleration[f], 0.0)
        blown = rachis_deflection(feather, kind, 0.0, loads.pressure[f])
        share = blown / max(inert + blown, 1e-12)
        sag = min(max(inert + blown, reach.get(placement.id, 0.0)), kind.length)
        barb = barb_load(feather, kind, _pressure(kind, loads, f))
        found.append(Bends(sag, barb, share, placement.id in wrung))
    return found


def _wrung(shot: Shot) -> set[str]:
    """Ids of the feathers that a grip pulls across the shaft within the plane of the vane, by half
    of what it does out of it at least, or a force pulls."""
    axes = {each.id: each.rotation for each in shot.groom.feathers}
    across = {each.feather: axes[each.feather].T @ each.displacement for each in shot.grips}
    pulled = {name for name, way in across.items() if abs(way[1]) > 0.5 * abs(way[2])}
    return pulled | {force.feather for force in shot.forces}


def load_estimate(shot: Shot, motion: Roots) -> LoadEstimate | None:
    """The loads that decide what the solver is to choose; None where it chooses nothing."""
    quality, wind = quality_of(shot), shot.wind
    chosen = CHOSEN_BY_SOLVER in (quality.coefficients, quality.simulated_rows)
    if not chosen and quality.promised is None:
        return None
    frames = shot.last_frame - shot.first_frame
    samples = min(SAMPLES_A_FRAME * max(frames, 1), MOST_SAMPLES)
    times = np.linspace(0.0, max(frames, 1) / shot.frames_per_second, samples + 1)
    along = REACH * np.array([p.kind.length for p in shot.groom.feathers])[:, None]
    poses = [motion.frames(float(time)) for time in times]
    places = np.stack([each.positions + along * each.rotations[:, :, 0] for each in poses])
    speed, acceleration = (
        np.linalg.norm(rate, axis=2).max(axis=0) for rate in sampled_rates(places, times)
    )
    through_air = wind.speed * (1.0 + 2.0 * wind.gust) + speed
    if shot.wind_source is not None:
        blowing = [
            np.linalg.norm(shot.wind_source.velocity(place, float(time)), axis=1)
            for place, time in zip(places, times if frames else times[:1], strict=False)
        ]
        through_air = through_air + np.max(blowing, axis=0)
    air = 0.5 * wind.air_density * wind.drag_normal * (exposures(shot) * through_air) ** 2
    gravity = float(np.linalg.norm(shot.gravity))
    return LoadEstimate(LOAD_FACTOR * gravity + acceleration, air)
