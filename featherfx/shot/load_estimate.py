"""An estimate of the loads on every feather of a shot, and how far these bend it."""

from __future__ import annotations

from collections.abc import Container, Sequence
from typing import NamedTuple

import numpy as np

from featherfx.algebra.types import Array
from featherfx.feather.types import Feather
from featherfx.groom.types import FeatherKind
from featherfx.mechanics.resolution import barb_load, rachis_deflection
from featherfx.shot.loads import exposures, wind_field
from featherfx.shot.roots import Roots, sampled_rates, some_roots
from featherfx.shot.types import Shot

# accelerations beyond gravity that feathers see, in gravities
_LOAD_FACTOR = 3.0
# of the motion, a frame and in a shot at most; the place along a feather that is looked at
_SAMPLES_PER_FRAME, _MAX_SAMPLES = 2, 240
_PLACE = 0.7


class LoadEstimate(NamedTuple):
    """Largest loads on every feather that was looked at; nan of the others. acceleration: (F,)
    m/s^2. pressure: (F,) of the air, Pa. peak: (F,) s since the first frame, when root and wind
    load it most."""

    acceleration: Array
    pressure: Array
    peak: Array


class Deflection(NamedTuple):
    """Deflection of a rachis by its loads, and of the barbs if they bent in proportion, m.

    is_pulled: whether a grip or a force acts on it.
    """

    rachis: float
    barb: float
    is_pulled: bool = False


def vane_pressure(kind: FeatherKind, loads: LoadEstimate, feather: int) -> float:
    """Return the pressure (Pa) on the vane of a feather by its own inertia and the air."""
    inertia = kind.vane_material.surface_density * loads.acceleration[feather]
    return float(inertia + loads.pressure[feather])


def estimate_deflections(
    shot: Shot, feathers: Sequence[Feather], loads: LoadEstimate, chosen: Container[int]
) -> list[Deflection]:
    """Estimate how far (m) the loads, grips and forces of a shot bend every feather's rachis, and
    how far loads would bend its barbs if they bent in proportion; 0 of those that are not chosen,
    by number."""
    # a grip bends the shaft as far as it reaches
    reach = {grip.feather: float(np.linalg.norm(grip.displacement)) for grip in shot.grips}
    reach |= {force.feather: np.inf for force in shot.forces}
    found = []
    for f, (feather, placement) in enumerate(zip(feathers, shot.groom.feathers, strict=True)):
        kind, is_pulled = placement.kind, placement.id in reach
        if f not in chosen:
            found.append(Deflection(0.0, 0.0, is_pulled))
            continue
        sag = rachis_deflection(feather, kind, loads.acceleration[f], loads.pressure[f])
        sag = min(max(sag, reach.get(placement.id, 0.0)), kind.length)
        barb = barb_load(feather, kind, vane_pressure(kind, loads, f))
        found.append(Deflection(sag, barb, is_pulled))
    return found


def estimate_loads(shot: Shot, motion: Roots, chosen: Sequence[int] | None = None) -> LoadEstimate:
    """Estimate the largest loads on feathers over the frames of a shot. chosen: numbers in
    ascending order, default all.

    Three times gravity and inertia of the roots' acceleration, and the pressure of the wind with
    its gusts and of the roots' speed through the air.
    """
    wind = shot.wind
    frames = shot.last_frame - shot.first_frame
    samples = min(_SAMPLES_PER_FRAME * max(frames, 1), _MAX_SAMPLES)
    moments = np.linspace(0.0, max(frames, 1), samples + 1)
    times = moments / shot.frames_per_second
    count = len(shot.groom.feathers)
    own = np.arange(count) if chosen is None else np.array(chosen, dtype=np.int64)
    lengths, exposed = np.array([p.kind.length for p in shot.groom.feathers]), exposures(shot)[own]
    along, motion = _PLACE * lengths[own, None], some_roots(motion, own)
    poses = [motion.frames(float(time)) for time in times]
    places = np.stack([each.positions + along * each.rotations[:, :, 0] for each in poses])
    velocity, rate = sampled_rates(places, moments, shot)
    speed, acceleration = (np.linalg.norm(each, axis=2) for each in (velocity, rate))
    gravity = float(np.linalg.norm(shot.gravity))
    field = wind_field(wind)
    seen = [field.velocity(place, float(time)) for place, time in zip(places, times, strict=True)]
    against = np.linalg.norm(np.stack(seen) - velocity, axis=2)
    felt = exposed * against
    still = max(wind.speed, 1.0) ** 2
    peak = times[np.argmax(acceleration / max(gravity, 1.0) + felt**2 / still, axis=0)]
    speed, acceleration = speed.max(axis=0), acceleration.max(axis=0)
    through_air = wind.speed * (1.0 + 2.0 * wind.gust) + speed
    if shot.wind_source is not None:
        blowing = [
            np.linalg.norm(shot.wind_source.velocity(place, float(time)), axis=1)
            for place, time in zip(places, times if frames else times[:1], strict=False)
        ]
        through_air = through_air + np.max(blowing, axis=0)
    air = 0.5 * wind.air_density * wind.drag_normal * (exposed * through_air) ** 2
    found = np.full((3, count), np.nan)
    found[:, own] = _LOAD_FACTOR * gravity + acceleration, air, peak
    return LoadEstimate(*found)
