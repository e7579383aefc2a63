"""Loads on a batch of feathers during a frame: gravity, wind, grips and dead forces.

Loads on single feathers: dead forces at a point, along the rachis or along a barb, and grips.

A force is spread over the nodes around its place with linear hats along the rachis (by
arc length) and along the barbs, a line's with the integrals of those hats. So the total does not
depend on the grid, and the place converges with it.

A gusty wind as a sum of travelling waves that compiled kernels can evaluate anywhere.

    velocity(x, t) = mean + sum_k amplitude_k cos(wave_vector_k . x - frequency_k t + phase_k)

Each amplitude is perpendicular to its wave vector, so the field has no divergence. The gusts
travel with the mean wind (frozen turbulence, Taylor 1938): frequency = wave_vector . mean. Their
strengths follow the energy spectrum of von Karman (1948), E(k) ~ k^4 / (1 + k^2)^(17/6).

Feathers within a plumage are sheltered: they feel the air slower than it blows,

    u' = v + e (u - v)

u: velocity of the air, v: velocity of the feather's root over the interval, e: its exposure, how
much of the air's motion against the root reaches the feather (1: all of it). A vane alone in the
wind is pressed on from one side; one that lies on others and on the skin has nearly the same
pressure on both, and the air between them moves with the body. e stands for both. It is no measured
property; a bird's back needs less of it than the tips of its crest. Where a shot does not say it,
how the feathers lie on its skin does (loop/shelter.py).

Loads on every feather of a shot are estimated, and how far these bend it.
"""

from __future__ import annotations

import math
from collections.abc import Container, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from featherfx.algebra.interpolation import linear_weights, smooth_step
from featherfx.algebra.types import Array, Indices
from featherfx.errors import InputError, Problem
from featherfx.feather.types import LEADING, TRAILING, Feather, barb_slice
from featherfx.groom.types import FeatherKind
from featherfx.mechanics.model import Loads, no_contacts
from featherfx.mechanics.resolution import barb_load, rachis_deflection
from featherfx.shot.patterns import Force, Grip, fits
from featherfx.shot.roots import Roots, sampled_rates, some_roots
from featherfx.shot.types import Shot, Wind

_MODES = 24
# Wave numbers over that of the largest energy; 0.1 % of the energy lies below, 7 % above.
_LOWEST, _HIGHEST = 0.25, 60.0
_PEAK = math.sqrt(12.0 / 5.0)  # where E(k) is largest


@dataclass(frozen=True)
class WindField:
    """Wind velocity over space and time, K gust modes (K = 0: steady and uniform).

    mean: (3,) m/s. wave_vectors: (K, 3) rad/m. frequencies: (K,) rad/s. amplitudes: (K, 3) m/s.
    phases: (K,) rad.
    """

    mean: Array
    wave_vectors: Array
    frequencies: Array
    amplitudes: Array
    phases: Array

    def velocity(self, points: Array, time: float) -> Array:
        """(N, 3) m/s at points (N, 3) m, at a time in s."""
        angles = points @ self.wave_vectors.T - self.frequencies * time + self.phases
        return np.asarray(self.mean + np.cos(angles) @ self.amplitudes)


def wind_field(wind: Wind) -> WindField:
    """The field of a wind: the same wind, seed included, gives the same field.

    The gusts' speed has a root mean square of gust times speed, over all directions together;
    gust_length is half the wave length at which they hold most energy.
    """
    x, y, z = map(float, wind.direction)
    return _field((x, y, z), wind.speed, wind.gust, wind.gust_length, wind.seed)


@lru_cache(maxsize=16)
def _field(
    direction: tuple[float, float, float], speed: float, gust: float, length: float, seed: int
) -> WindField:
    """Kept, since every batch asks for it at every frame."""
    mean = speed * np.array(direction)
    strength = gust * speed
    if strength == 0.0:
        none = np.zeros((0, 3))
        return WindField(mean, none, np.zeros(0), none, np.zeros(0))
    random = np.random.default_rng(seed)
    numbers, energies = _spectrum(random, math.pi / length)
    directions = _directions(random)
    wave_vectors = numbers[:, None] * directions
    # (K, 3) unit vectors, each perpendicular to its direction, otherwise at random
    drawn = np.cross(directions, random.normal(size=directions.shape))
    amplitudes = (strength * np.sqrt(2.0 * energies))[:, None] * np.asarray(
        drawn / np.linalg.norm(drawn, axis=1, keepdims=True)
    )
    phases = random.uniform(0.0, 2.0 * math.pi, _MODES)
    return WindField(mean, wave_vectors, wave_vectors @ mean, amplitudes, phases)


def _spectrum(random: np.random.Generator, peak: float) -> tuple[Array, Array]:
    """Wave numbers (K,) rad/m, one in each of K bands, and how much of the energy each band has."""
    edges = np.geomspace(_LOWEST, _HIGHEST, _MODES + 1)
    within = random.uniform(0.0, 1.0, _MODES)
    numbers = edges[:-1] * (edges[1:] / edges[:-1]) ** within
    scaled = _PEAK * numbers
    energies = scaled**4 / (1.0 + scaled**2) ** (17.0 / 6.0) * np.diff(edges)
    return peak * numbers, energies / energies.sum()


def _directions(random: np.random.Generator) -> Array:
    """(K, 3) unit vectors spread evenly over the sphere, turned and ordered at random."""
    height = 1.0 - (2.0 * np.arange(_MODES) + 1.0) / _MODES
    around = math.pi * (3.0 - math.sqrt(5.0)) * np.arange(_MODES)
    radius = np.sqrt(1.0 - height**2)
    spread = np.stack((radius * np.cos(around), radius * np.sin(around), height), axis=1)
    rotation, _ = np.linalg.qr(random.normal(size=(3, 3)))
    return np.asarray(random.permutation(spread) @ rotation.T)


def exposures(shot: Shot) -> Array:
    """(F,) e of every feather of a shot: by the last shelter that fits it, else as it lies."""
    found = np.ones(len(shot.groom.feathers)) if shot.exposure is None else shot.exposure.copy()
    for shelter in shot.shelters:
        for f, placement in enumerate(shot.groom.feathers):
            if fits(shelter, placement):
                found[f] = 1.0 - shelter.share
    return found


def force_weights(force: Force, feather: Feather) -> Array:
    """(n, 1 + 2 m) how much of a force acts on every node; of a line's, m.

    Raises InputError where a barb is meant and none grows.
    """
    stations = feather.station / feather.station[-1]
    weights = np.zeros(feather.rest.nodes.shape[:2])
    if force.line == "rachis":
        weights[:, 0] = feather.station[-1] * hat_integrals(stations, *force.span)
        return weights
    rows = linear_weights(stations, np.array([force.row]))[0]
    if force.line == "point" and force.column == 0.0:
        weights[:, 0] = rows
        return weights
    side = LEADING if force.side == "leading" else TRAILING
    reach = feather.barb_length[side]
    rows = np.where(reach > 0.0, rows, 0.0)  # beside the first barb of a grid and the last one
    if not rows.any():
        where = f"no {force.side} barb grows at row = {force.row:g} of feather '{force.feather}'"
        grown = stations[reach > 0.0]
        raise InputError(
            Problem(
                "shot",
                "force",
                (f"{where}. Give {grown[0]:.3g} to {grown[-1]:.3g}" if len(grown) else where),
            )
        )
    rows /= rows.sum()
    columns = np.linspace(0.0, 1.0, feather.columns + 1)
    if force.line == "barb":
        rows, along = rows * reach, hat_integrals(columns, *force.span)
    else:
        along = linear_weights(columns, np.array([force.column]))[0]
    weights[:, 0] = rows * along[0]
    weights[:, barb_slice(side, feather.columns)] = rows[:, None] * along[1:]
    return weights


def hat_integrals(knots: Array, start: float, end: float) -> Array:
    """(n,) integrals of the linear hats of ascending knots from start to end."""
    inside = knots[(knots > start) & (knots < end)]
    places = np.concatenate([[start], inside, [end]])
    values = linear_weights(knots, places)
    # linear between all of these places, so the trapezoidal rule is exact
    return np.asarray(0.5 * np.diff(places) @ (values[:-1] + values[1:]))


def force_at(force: Force, time: float) -> Array:
    """(3,) N, or N/m of a line, at a time (s since the first frame): linear between its keys."""
    if not force.keys:
        return force.force
    times, factors = zip(*force.keys, strict=True)
    return force.force * float(np.interp(time, times, factors))


def dead_forces(
    forces: Sequence[tuple[int, Force, Array]],
    feathers: Sequence[Feather],
    start: float,
    end: float,
) -> tuple[Array, Array]:
    """force and force_change of Loads, from (place in the batch, force, its weights)."""
    if not forces:
        return np.zeros((len(feathers), 0, 0, 3)), np.zeros((0, 0, 0, 3))
    force = np.zeros((len(feathers), *feathers[0].rest.nodes.shape))
    change = np.zeros_like(force)
    for place, each, weights in forces:
        before, after = force_at(each, start), force_at(each, end)
        force[place] += weights[..., None] * before
        change[place] += weights[..., None] * (after - before)
    return force, change


def gripped(
    grips: Sequence[tuple[int, Grip]],
    feathers: Sequence[Feather],
    start_points: Sequence[Array],
    start: float,
    end: float,
) -> tuple[Indices, Array, Array, Array]:
    """grip_node, (grip_start, grip_end), grip_stiffness and max_grip_force of Loads (see
    frame_loads)."""
    count = len(feathers)
    most = max(np.bincount([place for place, _ in grips], minlength=count)) if grips else 0
    node = np.full((count, most, 2), -1, dtype=np.int64)
    targets, stiffness = np.zeros((2, count, most, 3)), np.zeros((count, most))
    force = np.full((count, most), np.inf)
    used = [0] * count
    for place, grip in grips:
        g = used[place]
        used[place] += 1
        node[place, g] = grip_node(grip, feathers[place])
        rest = start_points[place][tuple(node[place, g])]
        for k, time in enumerate((start, end)):
            targets[k, place, g] = rest + grip_fraction(grip, time) * grip.displacement
        stiffness[place, g] = grip.stiffness
        if grip.max_force is not None:
            force[place, g] = grip.max_force
    return node, targets, stiffness, force


def grip_fraction(grip: Grip, time: float) -> float:
    """Return how much of a grip's displacement is done at a time (s); no velocity at start and
    end."""
    if grip.end <= grip.start:
        return 1.0 if time >= grip.end else 0.0
    return smooth_step((time - grip.start) / (grip.end - grip.start))


def grip_node(grip: Grip, feather: Feather) -> tuple[int, int]:
    """Row and node that a grip holds."""
    row = round(grip.row * (feather.rows - 1))
    column = round(grip.column * feather.columns)
    if column == 0:
        return row, 0
    return row, (0 if grip.side == "leading" else feather.columns) + column


# drag coefficient of a round shaft across the wind (Hoerner, subcritical)
SHAFT_DRAG = 1.1


def frame_loads(
    shot: Shot,
    grips: Sequence[tuple[int, Grip]],
    feathers: Sequence[Feather],
    start_points: Sequence[Array],
    start: float,
    end: float,
    roots: Array | None = None,
    forces: Sequence[tuple[int, Force, Array]] = (),
) -> Loads:
    """Loads of a batch of F feathers from start to end (s since the first frame).

    grips: (place in the batch, grip) pairs. start_points: (n, 1 + 2 m, 3) world nodes of every
    feather at the first frame, from which the grips' displacements count. roots: (F, 3) m, where a
    scene's wind is sampled for each feather. forces: (place in the batch, force, its weights
    (n, 1 + 2 m)).
    """
    count, wind, source = len(feathers), shot.wind, shot.wind_source
    field = wind_field(wind)
    mean, change = np.tile(field.mean, (count, 1)), np.zeros((count, 3))
    if source is not None and roots is not None:
        mean += source.velocity(roots, 0.5 * (start + end))
        if end > start:
            # the acceleration of the air itself, which passes the roots halfway
            way = 0.5 * (end - start) * mean
            gain = source.velocity(roots + way, end) - source.velocity(roots - way, start)
            change = gain / (end - start)
    node, targets, stiffness, most = gripped(grips, feathers, start_points, start, end)
    force, force_change = dead_forces(forces, feathers, start, end)
    return Loads(
        # a copy: kernels would be compiled once more for arrays that are read-only
        gravity=np.array(shot.gravity, dtype=float),
        air=np.array([wind.air_density, wind.drag_normal, wind.drag_tangential, SHAFT_DRAG]),
        wind_mean=mean,
        wind_change=change,
        wind_wave=np.ascontiguousarray(field.wave_vectors.T),
        wind_rate=field.frequencies,
        wind_amplitude=np.ascontiguousarray(field.amplitudes.T),
        wind_phase=field.phases,
        grip_node=node,
        grip_start=targets[0],
        grip_end=targets[1],
        grip_stiffness=stiffness,
        max_grip_force=most,
        force=force,
        contacts=no_contacts(count),
        force_change=force_change,
        added_mass=np.ones(count) if wind.added_mass else np.zeros(0),
    )


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
