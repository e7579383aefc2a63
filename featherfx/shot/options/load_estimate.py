"""An estimate of the loads on every feather of a shot, and how far these bend it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from featherfx.algebra.types import Array
from featherfx.feather.types import Feather
from featherfx.groom.types import FeatherKind
from featherfx.mechanics.resolution import barb_load, rachis_deflection
from featherfx.shot.loads.wind import exposures
from featherfx.shot.options.error_model import Deflection
from featherfx.shot.roots import Roots, sampled_rates
from featherfx.shot.types import Shot

# accelerations beyond gravity that feathers see, in gravities
_LOAD_FACTOR = 3.0
# of the motion, a frame and in a shot at most; the place along a feather that is looked at
_SAMPLES_PER_FRAME, _MAX_SAMPLES = 2, 240
_PLACE = 0.7


class LoadEstimate(NamedTuple):
    """Largest loads on every feather. acceleration: (F,) m/s^2. pressure: (F,) of the air, Pa."""

    acceleration: Array
    pressure: Array


def vane_pressure(kind: FeatherKind, loads: LoadEstimate, feather: int) -> float:
    """Return the pressure (Pa) on the vane of a feather by its own inertia and the air."""
    inertia = kind.vane_material.surface_density * loads.acceleration[feather]
    return float(inertia + loads.pressure[feather])


def estimate_deflections(
    shot: Shot, feathers: Sequence[Feather], loads: LoadEstimate
) -> list[Deflection]:
    """Estimate how far (m) the loads, grips and forces of a shot bend every feather's rachis, and
    how far loads would bend its barbs if they bent in proportion."""
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
        barb = barb_load(feather, kind, vane_pressure(kind, loads, f))
        found.append(Deflection(sag, barb, share, placement.id in wrung))
    return found


def _wrung(shot: Shot) -> set[str]:
    """Return the ids of the feathers that a grip pulls across the rachis within the plane of the
    vane, by half of what it does out of it at least, or a force pulls."""
    axes = {each.id: each.rotation for each in shot.groom.feathers}
    across = {each.feather: axes[each.feather].T @ each.displacement for each in shot.grips}
    pulled = {name for name, way in across.items() if abs(way[1]) > 0.5 * abs(way[2])}
    return pulled | {force.feather for force in shot.forces}


def estimate_loads(shot: Shot, motion: Roots) -> LoadEstimate:
    """Estimate the largest loads on every feather over the frames of a shot.

    Three times gravity and inertia of the roots' acceleration, and the pressure of the wind with
    its gusts and of the roots' speed through the air.
    """
    wind = shot.wind
    frames = shot.last_frame - shot.first_frame
    samples = min(_SAMPLES_PER_FRAME * max(frames, 1), _MAX_SAMPLES)
    moments = np.linspace(0.0, max(frames, 1), samples + 1)
    times = moments / shot.frames_per_second
    along = _PLACE * np.array([p.kind.length for p in shot.groom.feathers])[:, None]
    poses = [motion.frames(float(time)) for time in times]
    places = np.stack([each.positions + along * each.rotations[:, :, 0] for each in poses])
    speed, acceleration = (
        np.linalg.norm(rate, axis=2).max(axis=0) for rate in sampled_rates(places, moments, shot)
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
    return LoadEstimate(_LOAD_FACTOR * gravity + acceleration, air)
