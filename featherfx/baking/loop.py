"""Frames computed and written side by side."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

from featherfx.baking.entries import drawn_entries, metadata_of
from featherfx.baking.task import Task
from featherfx.files.background import Background
from featherfx.shot.checkpoint import Checkpoint
from featherfx.shot.simulate import simulate
from featherfx.usd.space import origin_for
from featherfx.usd.write.write import CacheWriter


def simulate_and_write(
    task: Task, notify: Callable[[int, int], None]
) -> tuple[int, dict[str, Any]]:
    """Run the frame loop beside the writer; returns the samples taken over and the figures.

    notify: called with the samples done and their number.
    """
    shot, quality, options, samples = task.shot, task.shot.quality, task.options, task.samples
    writer = CacheWriter(
        task.path,
        drawn_entries(shot.groom, quality, options, task.names, shot.skin),
        task.frames,
        shot.frames_per_second,
        options,
        metadata=metadata_of(shot.groom, quality) | {"shot": shot.name, "settings": task.settings},
        settings=task.settings,
        root=task.root,
        origin=origin_for([each.position for each in task.whole.groom.feathers]),
    )
    seconds = {"simulating": 0.0, "waiting": 0.0, "writing": 0.0, "finishing": 0.0}
    try:
        with writer:
            done = taken_over = writer.samples_done
            notify(done, samples)
            start = Checkpoint.load(writer.state) if writer.state else None
            simulation = simulate(
                task.whole, options.jobs, task.frames, options.subframes, start, task.wanted
            )
            sink, mark = Background(writer.write), time.perf_counter()
            with sink:
                for frame in simulation if done < samples else ():
                    mark = _spent(seconds, "simulating", mark)
                    sink(frame, simulation.checkpoint().save)
                    mark = _spent(seconds, "waiting", mark)
                    done += 1
                    notify(done, samples)
            seconds["writing"] = sink.seconds
    except KeyboardInterrupt as error:
        raise KeyboardInterrupt(_state_of(writer, task)) from error
    _spent(seconds, "finishing", mark)
    return taken_over, simulation.report | {"seconds": seconds}


def _state_of(writer: CacheWriter, task: Task) -> str:
    """What an interrupt has left, in words."""
    if writer.published:
        return f"interrupted, but {task.path} is complete"
    if kept := writer.samples_kept:
        return f"interrupted: {kept} of {task.samples} samples are kept for --resume"
    return "interrupted: nothing was written"


def _spent(seconds: dict[str, float], what: str, since: float) -> float:
    """Add the time since then to what; returns now."""
    now = time.perf_counter()
    seconds[what] += now - since
    return now
