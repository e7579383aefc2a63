"""A gusty wind as a sum of travelling waves that compiled kernels can evaluate anywhere.

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
how the feathers lie on its skin does (shelter.py).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from featherfx.algebra.types import Array
from featherfx.shot.patterns import fits
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
