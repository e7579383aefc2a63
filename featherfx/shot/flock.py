"""A flock: groups of birds that share a shot, each bird on its own path, and shots of their caches.

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

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Annotated, Any, NamedTuple, Protocol

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation, Slerp
from scipy.stats import qmc

from featherfx.algebra.types import Array, Indices
from featherfx.algebra.vectors import frames_to_quats
from featherfx.groom.keys.preset import PRESET_FAMILIES, Wind
from featherfx.groom.keys.values import ArrayOf, Key, Number, Table, Text, keys_of, tables, vector
from featherfx.limits import MAX_BIRDS
from featherfx.shot.frames import MAX_RATE, MIN_RATE
from featherfx.shot.sources import TimedCamera, relative_sizes
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


_MOST_OFF = 3.0  # standard deviations, of sizes


def place_birds(group: BirdGroup, number: int, path: Spline, loop: Loop) -> list[Bird]:
    """Place the birds of a group around its path. number: of the group."""
    places = qmc.Halton(3, seed=group.seed).random(group.birds)
    # each bird fills the box evenly; one alone is in its middle
    shifts = (2.0 * places - 1.0) * group.spread * (group.birds > 1)
    heading = path.turns(path.times[:1])[0] @ [1.0, 0.0, 0.0]
    turn = forward_turn(heading)
    return birds_on(group, number, [path.moved(turn @ shift) for shift in shifts], loop)


def birds_on(
    group: BirdGroup, number: int, paths: Sequence[BirdPath], loop: Loop, names: Sequence[str] = ()
) -> list[Bird]:
    """Return a bird on each path, with its phase, size and gusts. names: default: numbers."""
    random = np.random.default_rng([group.seed, number])
    phases = random.integers(0, loop.frames, len(paths))
    off = np.clip(random.standard_normal(len(paths)), -_MOST_OFF, _MOST_OFF)
    gusts = random.integers(0, group.gusts, len(paths))
    return [
        Bird(
            name=names[k] if names else f"bird_{number + 1}_{k + 1:04d}",
            group=number,
            path=path,
            phase=int(phases[k]),
            size=1.0 + group.size_variation * float(off[k]),
            gust=int(gusts[k]),
        )
        for k, path in enumerate(paths)
    ]


def look_at_birds(
    birds: Sequence[Bird], spans: Array, camera: TimedCamera, limits: SeenFrom, times: Array
) -> list[Bird]:
    """Choose by their sizes in the picture which birds are near, and which are far.

    spans: (N,) m, across each bird. times: (K,) s.
    """
    places = np.stack([each.path.positions(times) for each in birds])
    views = [camera.view(float(time)) for time in times]
    sizes = [relative_sizes(view, places[:, k], spans, 0.0) for k, view in enumerate(views)]
    pixels = limits.image_height * np.max(sizes, axis=0)

    def way(size: float) -> str:
        return (
            NEAR_BIRD
            if size > limits.near_above
            else FAR_BIRD
            if size < limits.far_below
            else MIDDLE_BIRD
        )

    return [
        replace(
            bird,
            way=way(size),
            pixels=float(size),
            size=1.0 if way(size) == NEAR_BIRD else bird.size,
        )
        for bird, size in zip(birds, pixels, strict=True)
    ]


_BEFORE, _AFTER = 4, 1  # frames, of a path before the first and after the last
_STEP = 1e-4  # s, of differences along a path


def frame_times(flock: FlockShot, before: int = 0, after: int = 0) -> Array:
    """(K,) s of a flock's frames, and of so many before and after them."""
    first, last = flock.frames
    return np.arange(-before, last - first + after + 1) / flock.frames_per_second


def near_tables(flock: FlockShot, bird: Bird, own: dict[str, Any], wind: Any) -> dict[str, Any]:
    """Keys that a shot of a bird changes so that the bird flies along its path.

    own: tables of the bird's shot. wind: of the flock's file.
    """
    shot = flock.groups[bird.group].shot
    start = shot.motion.clock.start - bird.phase / flock.frames_per_second
    given = own.get("motion", "hold")
    part = {"base": given} if isinstance(given, str) else dict(given)
    joints = part.pop("joints", {})  # of the whole act
    motion = {"kind": "act", "motions": [part | {"start": start}, _path_keys(flock, bird)]}
    if shot.surfaces is not None:
        motion |= {"body": "act", "joints": joints}
    return {
        "name": bird.name,
        "frames": list(flock.frames),
        "wind": wind,
        "motion": motion,
        "cycle": None,
    }


def _path_keys(flock: FlockShot, bird: Bird) -> dict[str, Any]:
    """Keyframes of a path, at every frame."""
    group = flock.groups[bird.group]
    handles = group.shot.handles
    times = frame_times(flock, _BEFORE + handles, _AFTER + handles)
    forward = np.array(group.keys.forward)

    def ways(at: Array) -> Array:
        return bird_poses(bird.path, forward, group.middle, at)[1]

    turns, places = bird_poses(bird.path, forward, group.middle, times)
    rates = (ways(times + _STEP) - ways(times - _STEP)) / (2.0 * _STEP)
    quats = frames_to_quats(turns)
    keys: list[dict[str, Any]] = []
    for k, time in enumerate(times.tolist()):
        keys.append({"time": time, "position": places[k].tolist(), "tangents": rates[k].tolist()})
        keys.append({"time": time, "rotation": quats[k].tolist()})
    return {"kind": "keys", "keyframes": keys}


def replay_tables(flock: FlockShot, bird: Bird) -> dict[str, Any]:
    """Keys that a shot changes to be the replay of a bird: its loop, in the wind of the flight."""
    group = flock.groups[bird.group]
    changes: dict[str, Any] = {
        "frames": [group.shot.first_frame, group.loop.first + group.loop.frames],
        "wind": _felt_wind(flock, group, bird),
        "handles": None,
    }
    if bird.way == FAR_BIRD:
        changes |= {"detail": [{"level": "rigid"}], "contact": None, "level_of_detail": None}
    return changes


def _felt_wind(flock: FlockShot, group: GroupOfFlock, bird: Bird) -> dict[str, Any]:
    """The wind that birds of a group feel against themselves, mean over the flight."""
    times, wind = frame_times(flock), flock.wind
    forward = np.array(group.keys.forward)
    turns, _ = bird_poses(bird.path, forward, group.middle, times)
    against = wind.speed * wind.direction - bird.path.velocities(times)
    felt = np.einsum("kji,kj->ki", turns, against).mean(axis=0)
    speed = float(np.linalg.norm(felt))
    values = {each.name: getattr(wind, each.name) for each in fields(Wind)}
    gust = min(wind.gust * wind.speed / speed, 2.0) if speed > 0.0 else 0.0
    return values | {
        "direction": (felt / speed).tolist() if speed > 0.0 else [1.0, 0.0, 0.0],
        "speed": speed,
        "gust": gust,
        "seed": wind.seed + bird.gust,
    }
