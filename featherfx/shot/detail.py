"""How finely each feather of a shot is simulated.

The meshes always have the quality's rows and columns; a feather that is simulated on another grid
is carried over to them (featherfx/feather/density.py). Levels of detail:

    full      the quality's rows and columns
    coarse    half of both, one coefficient
    rachis    half the rows, one column of rigid barbs
    rigid     nothing is solved: the rest shape follows the root
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from featherfx.errors import InputError, Problem
from featherfx.feather.types import Feather
from featherfx.groom.types import Placement
from featherfx.mechanics.resolution import (
    GRID_SHARE,
    coefficients_for,
    rachis_deflection,
    rows_for,
)
from featherfx.shot.motion import Roots
from featherfx.shot.types import Shot

Array = NDArray[np.float64]

CHOSEN_BY_SOLVER = -1
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


def resolutions(shot: Shot, feathers: Sequence[Feather], motion: Roots) -> list[Resolution]:
    """The resolution of every feather; feathers: as the meshes have them.

    Raises InputError for rigid feathers that are to be pulled.
    """
    quality = shot.quality
    coefficients = barb_coefficients(shot, feathers, motion)
    rows = _simulated_rows(shot, feathers, motion)
    pulled = _pulled(shot)
    chosen, problems = [], []
    for f, placement in enumerate(shot.groom.feathers):
        level = _level(shot, placement)
        if level == "rigid" and placement.id in pulled:
            message = f"feather '{placement.id}' is rigid, but a grip or a force pulls it"
            problems.append(Problem(str(shot.source), "detail", message))
        n, m, count = rows[f], quality.columns, coefficients[f]
        if level != "full":
            n = min(n, max(LEAST_ROWS, (n + 1) // 2))
            m, count = min(m, max(LEAST_COLUMNS, (m + 1) // 2)), min(count, 1)
        if level == "rachis":
            m, count = 1, 0
        chosen.append(Resolution(level, n, m, count))
    if problems:
        raise InputError(*problems)
    return chosen


def _pulled(shot: Shot) -> set[str]:
    """Ids of the feathers that a grip or a force acts on."""
    return {grip.feather for grip in shot.grips} | {force.feather for force in shot.forces}


def _level(shot: Shot, placement: Placement) -> str:
    """By the last pattern that fits the id, else by the feather's length."""
    for detail in reversed(shot.details):
        if fnmatchcase(placement.id, detail.feathers):
            return detail.level
    length, quality = placement.kind.length, shot.quality
    for level in ("rigid", "rachis", "coarse"):
        if length < getattr(quality, f"{level}_below"):
            return level
    return "full"


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
