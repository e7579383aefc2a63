"""What the bake of a shot will take: processor time, memory and disk, by a few of its feathers."""

from __future__ import annotations

import time
from dataclasses import replace
from statistics import median
from typing import Any, NamedTuple

import numpy as np

from featherfx.baking.bake import peak_memory_bytes
from featherfx.baking.entries import entries_of
from featherfx.shot.detail.levels import level_plan
from featherfx.shot.motion.motion import root_motion
from featherfx.shot.share import part_of
from featherfx.shot.simulate import Simulation, drawn_feathers, simulate
from featherfx.shot.types import LEVELS, Detail, Shot
from featherfx.usd.space import StageSpace
from featherfx.usd.write.options import WriteOptions
from featherfx.usd.write.poses import posed_feathers
from featherfx.usd.write.write import chunk_bytes

# frames, and feathers of each level, that are simulated to learn what one costs
TRIED_FRAMES, TRIED_FEATHERS, TRIED_FOLLOWERS = 4, 8, 64
# poses of a frame that are in memory at once: computed, waiting twice, being written
_FRAMES_HELD = 4
# states of a simulated feather: before and after a step, at the first frame, for resuming
_STATES_HELD = 4
# a mesh as it is authored, over one sample of its points: topology, texture coordinates, rest pose
_AUTHORED = 4

_CARRIED = ("guided", "rigid")


class _Tried(NamedTuple):
    """One level on a few feathers. seconds: of a feather and frame. resident: bytes of a feather
    that is simulated. sample: bytes of one on disk. posed: bytes of its pose while it is handed
    on. unknowns: of one feather."""

    seconds: float
    resident: float
    sample: float
    posed: float
    unknowns: float
    feathers: int
    frames: int


def bake_cost(shot: Shot, jobs: int) -> dict[str, Any]:
    """What the frames of a shot will take, by those of a few of its feathers at every level.

    Memory is that of the process so far, which has read and laid out the groom, and of what the
    bake adds; an estimate. With contact, the feathers that are tried are neighbours.
    """
    counts, members = _levels(shot)
    tried: dict[str, _Tried] = {}
    for level in counts:
        full = tried["full"].seconds if "full" in tried else None
        tried[level] = _try(shot, level, members[level], full)
    frames = shot.last_frame - shot.first_frame + 1
    total = len(shot.groom.feathers)

    def of_a_frame(name: str) -> float:
        return sum(count * getattr(tried[level], name) for level, count in counts.items())

    seconds, sample = of_a_frame("seconds") * frames, of_a_frame("sample")
    memory = of_a_frame("resident") + _FRAMES_HELD * of_a_frame("posed")
    chunk = min(sample * min(frames, WriteOptions.chunk), max(sample, chunk_bytes(total)))
    memory += sample * _AUTHORED + chunk
    return {
        "frames": frames,
        "tried_feathers": sum(each.feathers for each in tried.values()),
        "tried_frames": max(each.frames for each in tried.values()),
        "levels": {level: count for level, count in counts.items() if count},
        "unknowns": round(of_a_frame("unknowns")),
        "seconds_of_a_feather_and_frame": seconds / frames / total,
        "processor_seconds": seconds,
        "wall_seconds": seconds / jobs,
        "jobs": jobs,
        "memory_bytes": round((peak_memory_bytes() or 0) + memory),
        "bytes_of_a_frame": round(sample),
        "bytes_of_the_cache": round(sample * frames),
    }


def _levels(shot: Shot) -> tuple[dict[str, float], dict[str, Any]]:
    """Mean feathers a frame at each level, full first, and the numbers of those ever at it."""
    table = level_plan(shot, drawn_feathers(shot), root_motion(shot)).table
    there = [name for k, name in enumerate(LEVELS) if (table == k).any()]
    # followers are tried beside the guides that they follow
    names = ["full", *[name for name in there if name != "full"]] if "guided" in there else there
    number = {name: LEVELS.index(name) for name in names}
    counts = {name: float((table == k).sum(axis=1).mean()) for name, k in number.items()}
    members = {name: np.flatnonzero((table == k).any(axis=0)) for name, k in number.items()}
    everyone = np.arange(table.shape[1])
    return counts, {name: own if len(own) else everyone for name, own in members.items()}


def _try(shot: Shot, level: str, members: Any, full: float | None) -> _Tried:
    """Simulate some of the feathers at one level. full: seconds of one that guides."""
    most = TRIED_FOLLOWERS if level in ("guided", "rigid") else TRIED_FEATHERS
    chosen = _neighbours(shot, members, most) if shot.contact else _spread(members, most)
    part = part_of(shot, chosen)
    pinned = (*part.details, Detail(level=level))
    part = replace(part, details=pinned, level_of_detail=None, grips=(), forces=())
    last = min(shot.last_frame, shot.first_frame + TRIED_FRAMES)
    simulation = simulate(part, 1, (shot.first_frame, last))
    each_frame = _frame_seconds(simulation)
    spent = median(each_frame) if each_frame else 0.0
    guides = sum(each.level == "full" for each in simulation.resolutions)
    count = len(chosen)
    if level == "guided" and full is not None:
        spent, count = max(spent - guides * full, 0.0), max(count - guides, 1)
    sample, posed = _written(part, simulation)
    return _Tried(
        seconds=spent / count,
        resident=_simulated_bytes(simulation) / len(chosen) if level not in _CARRIED else 0.0,
        sample=sample / len(chosen),
        posed=posed / len(chosen),
        unknowns=0.0 if level in _CARRIED else _unknowns(simulation) / len(chosen),
        feathers=len(chosen),
        frames=len(each_frame),
    )


def _spread(members: Any, most: int) -> Any:
    """Up to so many of some numbers, evenly."""
    return members[np.unique(np.linspace(0, len(members) - 1, most).astype(int))]


def _neighbours(shot: Shot, members: Any, most: int) -> Any:
    """Up to so many feathers around the one in the middle of the list."""
    roots = np.array([shot.groom.feathers[f].position for f in members])
    way = np.linalg.norm(roots - roots[len(roots) // 2], axis=1)
    return np.sort(members[np.argsort(way, kind="stable")[:most]])


def _frame_seconds(simulation: Simulation) -> list[float]:
    """Processor time of every frame after the first, which settles; one may compile, too."""
    seconds, before = [], time.process_time()
    for number, _ in enumerate(simulation):
        now = time.process_time()
        if number:
            seconds.append(now - before)
        before = now
    return seconds


def _written(part: Shot, simulation: Simulation) -> tuple[float, float]:
    """Bytes of one frame on disk, and of its poses on the way there."""
    entries = entries_of(part.groom, simulation.feathers, static=False, skin=part.skin)
    sample = sum(feather.bytes_per_sample for feather in posed_feathers(entries, StageSpace()))
    # points, velocities and accelerations
    return float(sample), 3.0 * sum(feather.points.nbytes for feather in simulation.feathers)


def _simulated_bytes(simulation: Simulation) -> float:
    """Bytes of what is held of the feathers that are simulated."""
    constant, state = simulation.simulated_bytes()
    return float(constant + _STATES_HELD * state)


def _unknowns(simulation: Simulation) -> int:
    """Six a row, and two directions of coefficients for the two barbs of a row."""
    simulated = [each for each in simulation.resolutions if each.level not in _CARRIED]
    return sum(each.rows * (6 + 4 * each.coefficients) for each in simulated)
