"""Shots of a flock's caches, as tables: of birds that are near, and of replays."""

from __future__ import annotations

from dataclasses import fields
from typing import Any

import numpy as np

from featherfx.algebra.rotation import frames_to_quats
from featherfx.algebra.types import Array
from featherfx.groom.keys.preset import Wind
from featherfx.shot.flock.paths import bird_poses
from featherfx.shot.flock.types import FAR_BIRD, Bird, FlockShot, GroupOfFlock

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
