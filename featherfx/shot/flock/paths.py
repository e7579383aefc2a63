"""Paths of birds: where each one is, and how it is turned.

The middle of a group runs along a cubic spline through its keys, of continuous acceleration, and
straight on outside. Birds of a group keep their places against it, so that all have the same
velocity and turn on paths of equal radius, as flocks of pigeons do. A bird looks along its
velocity, and banks so that gravity and the turn push it along its own dorsal axis,

    tan(bank) = a / g,

with a the level part of the acceleration across its way.

Source: Pomeroy and Heppner, Structure of turning in airborne rock dove (Columba livia) flocks,
The Auk 109 (1992), for paths of equal radius; bank of a level turn by balance of forces.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation, Slerp

from featherfx.algebra.types import Array, Indices

GRAVITY = 9.81  # m/s^2, by which birds bank
_SLOW = 1e-3  # of the mean speed: below it a bird keeps its heading


class BirdPath(Protocol):
    """The way of one bird over time."""

    def positions(self, times: Array) -> Array:
        """Return (K, 3) m at times (K,) s."""

    def velocities(self, times: Array) -> Array:
        """Return (K, 3) m/s at times (K,) s."""

    def turns(self, times: Array) -> Array:
        """Return (K, 3, 3) rotations from a bird that looks along x, at times (K,) s."""


@dataclass(frozen=True, eq=False)
class Spline:
    """A cubic spline with straight ends. times: (K,) s. curve: its scipy.interpolate.CubicSpline.
    shift: (3,) m, of a bird from the middle."""

    times: Array
    curve: Any
    shift: Array

    @classmethod
    def through(cls, times: Array, points: Array) -> Spline:
        """Return the spline through points (K, 3) m at ascending times (K,) s."""
        return cls(times, CubicSpline(times, points, bc_type="natural"), np.zeros(3))

    def moved(self, shift: Array) -> Spline:
        """Return the path of a bird that is (3,) m away."""
        return Spline(self.times, self.curve, self.shift + shift)

    def positions(self, times: Array) -> Array:
        within = np.clip(times, self.times[0], self.times[-1])
        beyond = (times - within)[:, None]
        return np.asarray(self.curve(within) + beyond * self.curve(within, 1) + self.shift)

    def velocities(self, times: Array) -> Array:
        return np.asarray(self.curve(np.clip(times, self.times[0], self.times[-1]), 1))

    def accelerations(self, times: Array) -> Array:
        """Return (K, 3) m/s^2 at times (K,) s; 0 outside of the keys."""
        inside = (times >= self.times[0]) & (times <= self.times[-1])
        return np.where(inside[:, None], self.curve(times, 2), 0.0)

    def turns(self, times: Array) -> Array:
        way = self._headings(times)
        ahead = way / np.linalg.norm(way, axis=1, keepdims=True)
        level = np.stack([-ahead[:, 1], ahead[:, 0], np.zeros(len(ahead))], axis=1)
        level /= np.linalg.norm(level, axis=1, keepdims=True)
        across = np.einsum("kx,kx->k", self.accelerations(times), level)
        bank = -np.arctan2(across, GRAVITY)
        up = np.cross(ahead, level)
        left = np.cos(bank)[:, None] * level + np.sin(bank)[:, None] * up
        return np.stack([ahead, left, np.cross(ahead, left)], axis=2)

    def _headings(self, times: Array) -> Array:
        """(K, 3) velocities; where a bird stands or falls straight, the level one nearest in time
        from which it came."""
        knots = np.linspace(self.times[0], self.times[-1], 20 * len(self.times))
        known = self.curve(knots, 1)
        slow = _SLOW * np.linalg.norm(known, axis=1).mean()
        sound = np.flatnonzero(np.hypot(known[:, 0], known[:, 1]) > slow)
        way = self.velocities(times)
        if not len(sound):  # straight up or down: it looks along x
            return np.tile([1.0, 0.0, 0.0], (len(times), 1))
        lost = np.hypot(way[:, 0], way[:, 1]) <= slow
        place = np.searchsorted(knots[sound], times[lost]) - 1
        kept = known[sound[np.clip(place, 0, None)]] * [1.0, 1.0, 0.0]
        way[lost] = kept
        return way


@dataclass(frozen=True, eq=False)
class TurnedSpline:
    """A spline whose turns are given. quats: (K, 4) x, y, z, w at the spline's times."""

    spline: Spline
    quats: Array

    def positions(self, times: Array) -> Array:
        return self.spline.positions(times)

    def velocities(self, times: Array) -> Array:
        return self.spline.velocities(times)

    def turns(self, times: Array) -> Array:
        own = self.spline.times
        found = Slerp(own, Rotation.from_quat(self.quats))(np.clip(times, own[0], own[-1]))
        return np.asarray(found.as_matrix())


def forward_turn(forward: Array) -> Array:
    """(3, 3) rotation about z from x to a level direction (3,)."""
    angle = np.arctan2(forward[1], forward[0])
    return np.asarray(Rotation.from_rotvec([0.0, 0.0, angle]).as_matrix())


def bird_poses(path: BirdPath, forward: Array, middle: Array, times: Array) -> tuple[Array, Array]:
    """Rotations (K, 3, 3) and ways (K, 3) m by which a bird goes from its own shot to its path.

    forward: level direction in which it looks there. middle: (3,) m, of the bird, which is on the
    path.
    """
    turns = path.turns(times) @ forward_turn(forward).T
    return turns, path.positions(times) - turns @ middle


def nearest_birds(places: Array) -> tuple[Array, Indices]:
    """Distances (N,) m from birds at (N, 3) m to the nearest other, and its number."""
    from scipy.spatial import cKDTree

    distance, other = cKDTree(places).query(places, k=2)
    return np.asarray(distance[:, 1]), np.asarray(other[:, 1])
