"""What the bake of a shot will take: time, memory and disk, by a few of its feathers."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from featherfx.baking.bake import in_parts, peak_memory_bytes
from featherfx.baking.entries import entries_of
from featherfx.baking.options import TRIAL_SECONDS
from featherfx.baking.trial import expected, unknowns
from featherfx.shot.detail.detail import CARRIED
from featherfx.shot.detail.levels import level_plan
from featherfx.shot.detail.promise import common_tolerance
from featherfx.shot.motion.motion import root_motion
from featherfx.shot.motion.preroll import moves_before
from featherfx.shot.share import part_of
from featherfx.shot.simulate import Simulation, drawn_feathers, simulate
from featherfx.shot.types import LEVELS, Detail, Shot
from featherfx.usd.space import StageSpace
from featherfx.usd.write.options import WriteOptions
from featherfx.usd.write.poses import posed_feathers
from featherfx.usd.write.write import chunk_bytes

# feathers of each level that are looked at to learn what one holds
TRIED_FEATHERS, TRIED_FOLLOWERS = 8, 64
# poses of a frame that are in memory at once: computed, waiting twice, being written
_FRAMES_HELD = 4
# states of a simulated feather: before and after a step, at the first frame, for resuming
_STATES_HELD = 4
# a mesh as it is authored, over one sample of its points: topology, texture coordinates, rest pose
_AUTHORED = 4


class _Held(NamedTuple):
    """One level on a few feathers. resident: bytes of a feather that is simulated. sample: bytes of
    one on disk. posed: bytes of its pose while it is handed on. unknowns: of one feather."""

    resident: float
    sample: float
    posed: float
    unknowns: float


class Spent(NamedTuple):
    """Time that something took: s on the clock, and of the processors."""

    seconds: float
    processor: float


def bake_cost(shot: Shot, jobs: int, read: Spent, budget: float = TRIAL_SECONDS) -> dict[str, Any]:
    """What a bake of a shot will take on this machine as it is now.

    read: starting and reading the shot. The rest of the time is what bakes of a few of its feathers
    (trial.py) tell of all. budget: s for these. Memory is that of the process so far and of what
    the bake adds; an estimate.
    """
    counts, members = _levels(shot)
    held = {level: _hold(shot, level, members[level]) for level in counts}
    frames = shot.last_frame - shot.first_frame + 1
    total = len(shot.groom.feathers)

    def of_a_frame(name: str) -> float:
        return sum(count * getattr(held[level], name) for level, count in counts.items())

    sample = of_a_frame("sample")
    memory = of_a_frame("resident") + _FRAMES_HELD * of_a_frame("posed")
    chunk = min(sample * min(frames, WriteOptions.chunk), max(sample, chunk_bytes(total)))
    memory += sample * _AUTHORED + chunk
    learnt = expected(shot, jobs, _preroll(shot), budget)
    phases = {"reading": read.seconds, **learnt.phases}
    seconds = in_parts(phases)
    return {
        "frames": frames,
        "tried_feathers": max(each.feathers for each in learnt.trials),
        "tried_frames": max(each.frames for each in learnt.trials),
        "trial_seconds": sum(each.seconds for each in learnt.trials),
        "levels": {level: count for level, count in counts.items() if count},
        "unknowns": round(of_a_frame("unknowns")),
        "seconds_of_a_feather_and_frame": phases["simulating"] * jobs / max(frames - 1, 1) / total,
        "wall_seconds": sum(seconds.values()),
        "processor_seconds": read.processor + learnt.processor,
        "cores": learnt.cores,
        "seconds": seconds,
        "jobs": jobs,
        "memory_bytes": round((peak_memory_bytes() or 0) + memory),
        "bytes_of_a_frame": round(sample),
        "bytes_of_the_cache": round(sample * frames),
    }


def _preroll(shot: Shot) -> int:
    """Frames that are simulated before the first."""
    preroll = shot.preroll / shot.frames_per_second
    moves = moves_before(root_motion(shot), preroll, common_tolerance(shot))
    return shot.preroll if moves else 0


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


def _hold(shot: Shot, level: str, members: Any) -> _Held:
    """Memory and disk of some of the feathers at one level."""
    chosen = _spread(members, TRIED_FOLLOWERS if level in CARRIED else TRIED_FEATHERS)
    part = part_of(shot, chosen)
    pinned = (*part.details, Detail(level=level))
    part = replace(part, details=pinned, level_of_detail=None, grips=(), forces=())
    simulation = simulate(part, 1)
    sample, posed = _written(part, simulation)
    count, carried = len(chosen), level in CARRIED
    solved = sum(unknowns(each) for each in simulation.resolutions)
    return _Held(
        resident=0.0 if carried else _simulated_bytes(simulation) / count,
        sample=sample / count,
        posed=posed / count,
        unknowns=0.0 if carried else solved / count,
    )


def _spread(members: Any, most: int) -> Any:
    """Up to so many of some numbers, evenly."""
    return members[np.unique(np.linspace(0, len(members) - 1, most).astype(int))]


def _written(part: Shot, simulation: Simulation) -> tuple[float, float]:
    """Bytes of one frame on disk, and of its poses on the way there."""
    entries = entries_of(part.groom, simulation.feathers, static=False, skin=part.skin)
    sample = sum(feather.bytes_per_sample for feather in posed_feathers(entries, StageSpace()))
    # points, velocities and accelerations
    return float(sample), 3.0 * sum(
        part.nbytes for feather in simulation.feathers for part in feather.rest
    )


def _simulated_bytes(simulation: Simulation) -> float:
    """Bytes of what is held of the feathers that are simulated."""
    constant, state = simulation.simulated_bytes()
    return float(constant + _STATES_HELD * state)
