"""The sink of a bake: the writer of its cache, and what the cache tells of the bake."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from featherfx.baking.entries import drawn_entries, metadata_of, scenery_of
from featherfx.baking.task import Task
from featherfx.usd.write.resume import table_text
from featherfx.usd.write.write import CachePlace, CacheWriter, Continuation


def new_writer(task: Task) -> CacheWriter:
    """A writer of a task's feathers; raises what CacheWriter raises."""
    shot, quality = task.shot, task.shot.quality
    return CacheWriter(
        task.path,
        drawn_entries(shot.groom, quality, task.options, task.names, shot.skin, shot.wets),
        task.frames,
        shot.frames_per_second,
        task.options,
        metadata=metadata_of(shot.groom, quality)
        | scenery_of(shot, task.path)
        | {"shot": shot.name, "settings": task.settings},
        place=CachePlace(
            task.root,
            "{}of{}".format(*task.options.feathers) if task.options.feathers else "",
            task.origin,
        ),
        continuation=Continuation(task.settings, task.shot.inputs, task.frames_each),
    )


def compared(task: Task, dependences: Sequence[str]) -> dict[str, Any]:
    """What a later bake compares itself with (see `task`). dependences: of the task's feathers."""
    depend = dict(zip(task.names, dependences, strict=True))
    return {"inputs": table_text(task.shot.inputs), "dependences": table_text(depend)}
