"""Frames computed and written side by side."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from featherfx.baking.entries import drawn_entries, metadata_of, scenery_of
from featherfx.baking.task import Task
from featherfx.files.background import Background
from featherfx.jit.told import TELLER
from featherfx.phases import phase
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
    options, samples = task.options, task.samples
    TELLER.works = ("bake",) if task.shot.contact is None else ("bake", "contact")
    with phase("building", silent=True):
        writer = _writer(task)
    try:
        with writer:
            done = taken_over = writer.samples_done
            notify(done, samples)
            start = Checkpoint.load(writer.state) if writer.state else None
            with phase("building", silent=True):
                simulation = simulate(
                    task.whole, options.jobs, task.frames, options.subframes, start, task.wanted
                )
            sink = Background(writer.write)
            with sink:
                with phase("simulating", silent=True):
                    for frame in simulation if done < samples else ():
                        with phase("writing", silent=True):
                            sink(frame, simulation.checkpoint().save)
                        done += 1
                        notify(done, samples)
                with phase("writing"):
                    sink.close()
    except KeyboardInterrupt as error:
        raise KeyboardInterrupt(_state_of(writer, task)) from error
    return taken_over, simulation.report | {"writing_beside": sink.seconds}


def _writer(task: Task) -> CacheWriter:
    """The sink of a bake."""
    shot, quality = task.shot, task.shot.quality
    return CacheWriter(
        task.path,
        drawn_entries(shot.groom, quality, task.options, task.names, shot.skin),
        task.frames,
        shot.frames_per_second,
        task.options,
        metadata=metadata_of(shot.groom, quality)
        | scenery_of(shot, task.path)
        | {"shot": shot.name, "settings": task.settings},
        settings=task.settings,
        root=task.root,
        origin=origin_for([each.position for each in task.whole.groom.feathers]),
    )


def _state_of(writer: CacheWriter, task: Task) -> str:
    """What an interrupt has left, in words."""
    if writer.published:
        return f"interrupted, but {task.path} is complete"
    if kept := writer.samples_kept:
        return f"interrupted: {kept} of {task.samples} samples are kept for --resume"
    return "interrupted: nothing was written"
