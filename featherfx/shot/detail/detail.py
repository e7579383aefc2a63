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
from numpy.typing import NDArray

from featherfx.errors import InputError, Problem
from featherfx.feather.types import Feather
from featherfx.groom.types import Placement
from featherfx.mechanics.resolution import GRID_SHARE, coefficients_for, rachis_deflection, rows_for
from featherfx.shot.detail.guides import GuideRule
from featherfx.shot.loads.wind import exposures
from featherfx.shot.motion.roots import Roots
from featherfx.shot.patterns import fits
from featherfx.shot.types import Shot

Array = NDArray[np.float64]

CHOSEN_BY_SOLVER = -1
# levels at which nothing is solved
CARRIED = ("guided", "rigid")
# accelerations beyond gravity that feathers see, in gravities
LOAD_FACTOR = 3.0
SAMPLES = 33
LEAST_ROWS, LEAST_COLUMNS = 6, 2


@dataclass(frozen=True)
class Resolution:
    """What is simulated of a feather: level of detail, rows, columns a side and curvature
    coefficients per barb and direction."""

    level: str
    rows: int
    columns: int
    coefficients: int


class _LoadEstimate(NamedTuple):
    """(F,) largest acceleration, m/s^2, and pressure of the air, Pa, on every feather."""

    acceleration: Array
    pressure: Array


class Detailer:
    """What is simulated of the feathers of a shot, at any level.

    feathers: as the meshes have them. levels: of every feather by [[detail]] and length, where
    nothing is seen; rules: how its guides would be chosen; pinned: (F,) whether no camera changes
    its level. Raises InputError for feathers that are not simulated, but pulled.
    """

    def __init__(self, shot: Shot, feathers: Sequence[Feather], motion: Roots) -> None:
        self._quality = shot.quality
        self._coefficients = barb_coefficients(shot, feathers, motion)
        self._rows = _simulated_rows(shot, feathers, motion)
        given = [_level(shot, placement) for placement in shot.groom.feathers]
        self.levels = [level for level, _, _ in given]
        self.rules = [rule for _, rule, _ in given]
        pulled = _pulled(shot)
        problems = []
        pinned = []
        for placement, (level, _, named) in zip(shot.groom.feathers, given, strict=True):
            is_pulled = placement.id in pulled
            pinned.append(named or is_pulled)
            if level in CARRIED and is_pulled:
                message = f"feather '{placement.id}' is {level}, but a grip or a force pulls it"
                problems.append(Problem(str(shot.source), "detail", message))
        if problems:
            raise InputError(*problems)
        self.pinned = np.array(pinned, dtype=np.bool_)

    def resolution(self, f: int, level: str) -> Resolution:
        """Of one feather at a level."""
        n, m, count = self._rows[f], self._quality.columns, self._coefficients[f]
        if level != "full":
            n = min(n, max(LEAST_ROWS, (n + 1) // 2))
            m, count = min(m, max(LEAST_COLUMNS, (m + 1) // 2)), min(count, 1)
        if level == "rachis":
            m, count = 1, 0
        return Resolution(level, n, m, count)


def _pulled(shot: Shot) -> set[str]:
    """Ids of the feathers that a grip or a force acts on."""
    return {grip.feather for grip in shot.grips} | {force.feather for force in shot.forces}


def _level(shot: Shot, placement: Placement) -> tuple[str, GuideRule, bool]:
    """By the last detail that fits the feather, else by its length; and whether by a detail."""
    for detail in reversed(shot.details):
        if fits(detail, placement):
            return detail.level, GuideRule(detail.every, detail.spacing), True
    length, quality = placement.kind.length, shot.quality
    rule = GuideRule(quality.guided_every, None)
    for level in ("rigid", "guided", "rachis", "coarse"):
        if length < getattr(quality, f"{level}_below"):
            return level, rule, False
    return "full", rule, False


def _simulated_rows(shot: Shot, feathers: Sequence[Feather], motion: Roots) -> list[int]:
    quality = shot.quality
    if quality.simulated_rows != CHOSEN_BY_SOLVER:
        return [min(quality.simulated_rows or quality.rows, quality.rows)] * len(feathers)
    loads = _loads(shot, motion)
    # a grip bends the shaft as far as it reaches
    reach = {grip.feather: float(np.linalg.norm(grip.displacement)) for grip in shot.grips}
    forced = {force.feather for force in shot.forces}
    rows = []
    for f, (feather, placement) in enumerate(zip(feathers, shot.groom.feathers, strict=True)):
        kind = placement.kind
        sag = rachis_deflection(feather, kind, loads.acceleration[f], loads.pressure[f])
        sag = max(sag, min(reach.get(placement.id, 0.0), kind.length))
        if placement.id in forced:
            sag = kind.length
        rows.append(rows_for(sag, GRID_SHARE * quality.tolerance, quality.rows))
    return rows


def barb_coefficients(shot: Shot, feathers: Sequence[Feather], motion: Roots) -> list[int]:
    """Curvature coefficients per barb and direction of every feather.

    The quality's number, or, where that is -1, the fewest whose error stays below three times the
    quality's tolerance under the shot's load: three times gravity and inertia of the roots'
    acceleration, and the pressure of the wind with its gusts and of the roots' speed through the
    air. At least one, because the vane's shear bends barbs as well, and two where a grip or a
    force pulls.
    """
    quality = shot.quality
    if quality.coefficients != CHOSEN_BY_SOLVER:
        return [quality.coefficients] * len(feathers)
    loads, allowed = _loads(shot, motion), GRID_SHARE * quality.tolerance
    pulled = _pulled(shot)
    chosen: dict[tuple[int, int], int] = {}
    counts = []
    for f, (feather, placement) in enumerate(zip(feathers, shot.groom.feathers, strict=True)):
        kind = placement.kind
        inertia = kind.vane_material.surface_density * loads.acceleration[f]
        pressure = float(inertia + loads.pressure[f])
        # loads within a factor of two are treated alike, by the largest of them
        doublings = int(np.ceil(np.log2(max(pressure, 1e-9))))
        key = (id(feather), doublings)
        if key not in chosen:
            chosen[key] = coefficients_for(feather, kind, 2.0**doublings, allowed)
        least = 2 if placement.id in pulled else 1
        counts.append(max(chosen[key], least))
    return counts


def _loads(shot: Shot, motion: Roots) -> _LoadEstimate:
    speed, acceleration = _root_rates(shot, motion)
    gravity = float(np.linalg.norm(shot.gravity))
    wind = shot.wind
    through_air = wind.speed * (1.0 + 2.0 * wind.gust) + _scene_speed(shot, motion) + speed
    through_air = exposures(shot) * through_air
    air = 0.5 * wind.air_density * wind.drag_normal * through_air**2
    return _LoadEstimate(LOAD_FACTOR * gravity + acceleration, air)


def _scene_speed(shot: Shot, motion: Roots) -> Array:
    """(F,) m/s, largest speed of a scene's wind at the roots over the shot."""
    speeds = np.zeros(len(shot.groom.feathers))
    if shot.wind_source is None:
        return speeds
    duration = (shot.last_frame - shot.first_frame) / shot.frames_per_second
    for time in np.linspace(0.0, duration, SAMPLES):
        roots, _ = motion.frames(float(time))
        there = np.linalg.norm(shot.wind_source.velocity(roots, float(time)), axis=1)
        speeds = np.maximum(speeds, there)
    return speeds


def _root_rates(shot: Shot, motion: Roots) -> tuple[Array, Array]:
    """(F,) largest speed (m/s) and acceleration (m/s^2) of the roots over the shot."""
    duration = max(shot.last_frame - shot.first_frame, 1) / shot.frames_per_second
    times = np.linspace(0.0, duration, SAMPLES)
    places = np.stack([motion.frames(float(time))[0] for time in times])
    velocity = np.gradient(places, times, axis=0)
    acceleration = np.gradient(velocity, times, axis=0)
    return (
        np.linalg.norm(velocity, axis=2).max(axis=0),
        np.linalg.norm(acceleration, axis=2).max(axis=0),
    )
