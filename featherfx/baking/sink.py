"""The sink of a bake: the writer of its cache, and what the cache tells of the bake."""

from __future__ import annotations

import json
from collections.abc import Sequence

from featherfx.baking.entries import drawn_entries, metadata_of, scenery_of
from featherfx.baking.task import Task
from featherfx.usd.write.write import CacheWriter, Continuation, Place


def new_writer(task: Task) -> CacheWriter:
    """A writer of a task's feathers; raises what CacheWriter raises."""
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
        place=Place(
            task.root,
            "{}of{}".format(*task.options.feathers) if task.options.feathers else "",
            task.origin,
        ),
        continuation=Continuation(task.settings, task.shot.inputs, task.frames_each),
    )


def compared(task: Task, dependences: Sequence[str]) -> dict[str, str]:
    """What a later bake compares itself with (again.py). dependences: of the task's feathers."""
    depend = dict(zip(task.names, dependences, strict=True))
    texts = {"inputs": task.shot.inputs, "dependences": depend}
    return {name: json.dumps(dict(value), separators=(",", ":")) for name, value in texts.items()}
