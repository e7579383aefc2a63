"""What a groom or shot holds and what its bake will cost, before any bake."""

from __future__ import annotations

import time
import tomllib
from collections import Counter
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from featherfx.api import Folders, read_groom, read_quality, read_shot
from featherfx.baking.bake import in_parts, peak_memory_bytes
from featherfx.baking.entries import entries_of
from featherfx.baking.options import TRIAL_SECONDS
from featherfx.baking.trial import expected, unknowns
from featherfx.errors import all_of
from featherfx.feather.build import repeated_shapes
from featherfx.feather.layout.layout import cover, measured
from featherfx.feather.shapes import feathers_of
from featherfx.groom.types import Groom
from featherfx.phases import account
from featherfx.shot.detail.detail import CARRIED
from featherfx.shot.detail.levels import level_plan
from featherfx.shot.motion.motion import root_motion
from featherfx.shot.share import part_of
from featherfx.shot.simulate import Simulation, drawn_feathers, simulate
from featherfx.shot.types import LEVELS, Detail, Quality, Shot
from featherfx.usd.space import StageSpace
from featherfx.usd.write.options import CHUNK
from featherfx.usd.write.poses import posed_feathers
from featherfx.usd.write.write import chunk_bytes

_MOST_NAMED = 10


def plumage_stats(
    path: str | Path,
    *,
    quality: str | None = None,
    jobs: int = 1,
    preset_folders: Folders = (),
    budget: float = TRIAL_SECONDS,
) -> dict[str, Any]:
    """Counts, overlap and penetration of a groom; of a shot also the expected cost of its bake.

    quality: preset instead of the shot's; for a groom, that its meshes are counted at (default
    final). jobs: threads of the bake. Its cost is measured by bakes of a few feathers of the shot,
    which take about budget seconds. SI units, bytes. Raises InputError, and SimulationError where
    one of these feathers cannot be simulated.
    """
    path, folders = Path(path), tuple(preset_folders)
    if _is_shot(path):
        begin, worked = time.perf_counter(), time.process_time()
        shot, chosen = all_of(
            lambda: read_shot(path, folders),
            lambda: read_quality(quality, folders) if quality else None,
        )
        shot = replace(shot, quality=chosen) if chosen else shot
        current = account()
        # a layout that was found here is kept for the bake
        read = Spent(time.perf_counter() - begin, time.process_time() - worked)
        if current is not None:
            own = current.processor_seconds()
            done = sum(own.get(name, 0.0) for name in ("starting", "reading"))
            read = Spent(current.spent("starting", "reading"), done)
        cost = bake_cost(shot, jobs, read, budget)
        return _of_groom(shot.groom, shot.quality) | {"bake": cost}
    groom, grid = all_of(
        lambda: read_groom(path, folders), lambda: read_quality(quality or "final", folders)
    )
    return _of_groom(groom, grid)


def _is_shot(path: Path) -> bool:
    if path.suffix != ".toml":
        return False
    try:
        return "groom" in tomllib.loads(path.read_text(encoding="utf-8-sig"))
    except (OSError, ValueError):
        return False  # the reader of grooms tells what is wrong with it


def _of_groom(groom: Groom, quality: Quality) -> dict[str, Any]:
    first, shapes = repeated_shapes(groom.feathers)
    report = measured(groom)
    lengths = [feather.kind.length for feather in groom.feathers]
    used = Counter(shapes)
    built = feathers_of([groom.feathers[k] for k in first], quality.rows, quality.columns)
    points = [len(feather.surface.row) for feather in built]
    return {
        "name": groom.name,
        "feathers": len(groom.feathers),
        "regions": dict(Counter(feather.region for feather in groom.feathers)),
        "kinds": dict(Counter(feather.kind.name for feather in groom.feathers)),
        "shapes": len(first),
        "most_of_one_shape": max(used.values()),
        "length": {"least": min(lengths), "greatest": max(lengths)},
        "quality": quality.name,
        "mesh_points": sum(points[shape] for shape in shapes),
        "mesh_points_of_shapes": sum(points),
        "overlap": {
            "pairs": len(report.pairs),
            "neighbours_of_each": 2.0 * len(report.pairs) / len(groom.feathers),
            "feathers_over_a_point": cover(groom),
        },
        "penetration": {
            "pairs": len(report.unresolved),
            "deepest": report.unresolved[0].depth if report.unresolved else 0.0,
            "worst": [
                {"feather": each.upper, "under": each.lower or "skin", "depth": each.depth}
                for each in report.unresolved[:_MOST_NAMED]
            ],
        },
    }


# feathers of each level that are looked at to learn what one holds
TRIED_FEATHERS, TRIED_FOLLOWERS = 8, 64
# poses of a frame that are in memory at once: computed, waiting twice, being written
_FRAMES_HELD = 4
# of a pose that waits to be laid for good: its rates are in single precision
_OF_POSED = 2.0 / 3.0
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
    (trial.py) tell of all. budget: s of processor time for these. Memory is that of the process so
    far and of what the bake adds; an estimate.
    """
    counts, members = _levels(shot)
    held = {level: _hold(shot, level, members[level]) for level in counts}
    frames = shot.last_frame - shot.first_frame + 1
    total = len(shot.groom.feathers)

    def of_a_frame(name: str) -> float:
        return sum(count * getattr(held[level], name) for level, count in counts.items())

    sample = of_a_frame("sample")
    memory = of_a_frame("resident") + _FRAMES_HELD * of_a_frame("posed")
    chunk = min(sample * min(frames, CHUNK), max(sample, chunk_bytes(total)))
    memory += sample * _AUTHORED + chunk
    if shot.layers is not None:
        waiting = shot.layers.samples_ahead(1.0 / shot.frames_per_second)
        memory += waiting * _OF_POSED * of_a_frame("posed")
    learnt = expected(shot, jobs, budget)
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
