"""Shots of a flock's caches, as tables: of birds that are near, and of replays."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields, replace
from typing import Any

import numpy as np
from scipy.stats import qmc

from featherfx.algebra.rotation import frames_to_quats
from featherfx.algebra.types import Array
from featherfx.groom.keys.preset import Wind
from featherfx.shot.flock.types import (
    FAR_BIRD,
    MIDDLE_BIRD,
    NEAR_BIRD,
    Bird,
    BirdGroup,
    BirdPath,
    FlockShot,
    GroupOfFlock,
    Loop,
    SeenFrom,
    Spline,
    bird_poses,
    forward_turn,
)
from featherfx.shot.sources import TimedCamera, relative_sizes

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
