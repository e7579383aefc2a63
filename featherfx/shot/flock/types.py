"""A flock: groups of birds that share a shot, each bird on its own path.

A bird is drawn in one of three ways, by its size in the picture:

    near      simulated along its path, in a cache of its own
    middle    a replay: one bake of the bird on the spot, in the wind of its flight, repeats
    far       a replay of rigid feathers on a coarser grid, in one mesh

Paths of birds: where each one is, and how it is turned.

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
from pathlib import Path
from typing import Annotated, Any, NamedTuple, Protocol

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation, Slerp

from featherfx.algebra.types import Array, Indices
from featherfx.groom.keys.preset import PRESET_FAMILIES, Wind
from featherfx.groom.keys.values import (
    ArrayOf,
    Key,
    Number,
    Table,
    Text,
    keys_of,
    tables,
    vector,
)
from featherfx.limits import MAX_BIRDS
from featherfx.shot.clock import MAX_RATE, MIN_RATE
from featherfx.shot.types import Shot

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


NEAR_BIRD, MIDDLE_BIRD, FAR_BIRD = "near", "middle", "far"
WAYS = (NEAR_BIRD, MIDDLE_BIRD, FAR_BIRD)

_KEYFRAME = ArrayOf(Number(-1e6, 1e6), 4, 4)
_PIXELS = Number(0, 1e6)


@dataclass(frozen=True, kw_only=True)
class BirdGroup:
    """Birds of one shot that fly together. path: (s, m, m, m) of each of its places."""

    shot: Annotated[
        str,
        Text(),
        "Shot of one bird that stays on its place, as seen from this file's folder. Its `cycle` "
        "frames are replayed, or all of its frames; its wind is that of this file.",
    ]
    birds: Annotated[int, Number(1, MAX_BIRDS, whole=True), "Number of birds, along a path."] = 1
    path: Annotated[
        tuple[tuple[float, ...], ...] | None,
        ArrayOf(_KEYFRAME, 2, 10_000),
        "[time in s, x, y, z in m] of the middle of the group in ascending time: smooth between "
        "them, straight on outside.",
    ] = None
    spread: Annotated[
        tuple[float, float, float],
        vector(0, 1e4, "m"),
        "How far birds stand from the middle at most: ahead, to the side, up. They fill the box "
        "evenly, and fly side by side.",
    ] = (0.0, 0.0, 0.0)
    usd: Annotated[
        str | None,
        Text(),
        "USD file of a PointInstancer instead of a path: a bird at each of its points, by its ids, "
        "turned by its orientations where it has any. Frame N is its time code N.",
    ] = None
    prim: Annotated[str | None, Text(), "Path of the PointInstancer."] = None
    forward: Annotated[
        tuple[float, float, float],
        vector(-1, 1, ""),
        "Direction in the bird's shot in which it looks, level.",
    ] = (1.0, 0.0, 0.0)
    gusts: Annotated[
        int,
        Number(1, 100, whole=True),
        "Different replays for birds that are not far, each in gusts of its own.",
    ] = 1
    size_variation: Annotated[
        float,
        Number(0, 0.3),
        "Standard deviation of the size from bird to bird, a share; birds that are near keep "
        "theirs.",
    ] = 0.0
    seed: Annotated[
        int, Number(0, 2**31 - 1, whole=True), "Seed of places, phases, sizes and gusts."
    ] = 1


@dataclass(frozen=True, kw_only=True)
class SeenFrom:
    """Sizes in a picture by which birds are near or far."""

    usd: Annotated[str, Text(), "USD file of the camera, as seen from this file's folder."]
    prim: Annotated[str, Text(), "Path of the camera."]
    image_height: Annotated[float, Number(1, 100_000), "Height of the image in pixels."] = 1080.0
    near_above: Annotated[
        float, _PIXELS, "Birds that are larger than this in any frame are near, in pixels."
    ] = 400.0
    far_below: Annotated[
        float, _PIXELS, "Birds that are smaller than this in all frames are far, in pixels."
    ] = 100.0


FLOCK_KEYS = {
    "name": Key(Text(), "Name of the shot."),
    "frames": Key(
        ArrayOf(Number(-1_000_000, 1_000_000, whole=True), 2, 2),
        "First and last frame, both baked.",
    ),
    "frames_per_second": Key(
        Number(MIN_RATE, MAX_RATE, "1/s"), "Frames per second, those of its birds' shots.", 24.0
    ),
    "wind": Key(PRESET_FAMILIES["wind"], "Wind that the flock flies in, as of a shot.", "calm"),
    "camera": Key(
        Table(keys_of(SeenFrom)), "What decides which birds are near; without it none is.", None
    ),
    "flock": tables(keys_of(BirdGroup), "Groups of birds."),
}
FLOCK_FILE = Table(FLOCK_KEYS, "flock")


_WARM_UP = 12  # frames before a loop, by which its feathers forget how they began


class Loop(NamedTuple):
    """Frames of a bird's shot that repeat: the first, and how many."""

    first: int
    frames: int

    @classmethod
    def of(cls, shot: Shot) -> Loop:
        """Return the loop of a bird's shot: whole cycles after its start, or all of its frames."""
        if not shot.cycle:
            return cls(shot.first_frame, max(shot.last_frame - shot.first_frame, 1))
        return cls(shot.first_frame + shot.cycle * -(-_WARM_UP // shot.cycle), shot.cycle)


@dataclass(frozen=True)
class Bird:
    """One bird. name: unique, fit for a prim. group: number of its group. phase: frames by which it
    is ahead in its loop. size: factor. gust: number of its replay. way: of WAYS. pixels: largest
    size in the picture; 0 without a camera."""

    name: str
    group: int
    path: BirdPath
    phase: int
    size: float
    gust: int
    way: str = MIDDLE_BIRD
    pixels: float = 0.0


@dataclass(frozen=True)
class GroupOfFlock:
    """A group with its bird's shot. span: m, across the bird. middle: (3,) m, of its roots."""

    keys: BirdGroup
    shot: Shot
    loop: Loop
    span: float
    middle: Array


@dataclass(frozen=True)
class FlockShot:
    """A flock as its file has it."""

    name: str
    source: Path
    frames: tuple[int, int]
    frames_per_second: float
    wind: Wind
    groups: tuple[GroupOfFlock, ...]
    birds: tuple[Bird, ...]
