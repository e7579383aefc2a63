"""How finely each feather of a shot is resolved."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from featherfx.feather.types import Feather
from featherfx.mechanics.resolution import coefficients_for
from featherfx.shot.motion import Roots
from featherfx.shot.types import Shot

CHOSEN_BY_SOLVER = -1
# accelerations beyond gravity that feathers see, in gravities
LOAD_FACTOR = 3.0
SAMPLES = 33


def barb_coefficients(shot: Shot, feathers: Sequence[Feather], motion: Roots) -> list[int]:
    """Curvature coefficients per barb and direction of every feather.

    The quality's number, or, where that is -1, the fewest whose error stays below the quality's
    tolerance under the shot's load: three times gravity and inertia of the roots' acceleration,
    and the pressure of the wind with its gusts and of the roots' speed through the air. At least
    one, because the vane's shear bends barbs as well, and two where a grip pulls.
    """
    quality = shot.quality
    if quality.coefficients != CHOSEN_BY_SOLVER:
        return [quality.coefficients] * len(feathers)
    speed, acceleration = _root_rates(shot, motion)
    gravity = float(np.linalg.norm(shot.gravity))
    wind = shot.wind
    through_air = wind.speed * (1.0 + 2.0 * wind.gust) + speed
    air = 0.5 * wind.air_density * wind.drag_normal * through_air**2
    gripped = {grip.feather for grip in shot.grips}
    chosen: dict[tuple[int, int], int] = {}
    counts = []
    for f, (feather, placement) in enumerate(zip(feathers, shot.groom.feathers, strict=True)):
        kind = placement.kind
        inertia = kind.vane_material.surface_density * (LOAD_FACTOR * gravity + acceleration[f])
        pressure = inertia + float(air[f])
        # loads within a factor of two are treated alike, by the largest of them
        doublings = int(np.ceil(np.log2(max(pressure, 1e-9))))
        key = (id(feather), doublings)
        if key not in chosen:
            chosen[key] = coefficients_for(feather, kind, 2.0**doublings, quality.tolerance)
        least = 2 if placement.id in gripped else 1
        counts.append(max(chosen[key], least))
    return counts


def _root_rates(shot: Shot, motion: Roots) -> tuple[np.ndarray, np.ndarray]:
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
