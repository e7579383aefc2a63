"""The sink of a bake: the writer of its cache, and what the cache tells of the bake."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Any, Self

from featherfx.baking.entries import drawn_entries, metadata_of, scenery_of
from featherfx.baking.types import Task
from featherfx.shot.checkpoint import Checkpoint
from featherfx.shot.frames import Frame
from featherfx.shot.layers.types import Laid
from featherfx.usd.write.cache_writer import CachePlace, CacheWriter, Continuation
from featherfx.usd.write.layers import table_text


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


class Sink:
    """A task's writer, built by a thread of its own while others go on; a context manager, which
    ends as the writer's block."""

    def __init__(self, task: Task) -> None:
        self._task, self._pool = task, ThreadPoolExecutor(1, "featherfx sink")
        self._made: Future[CacheWriter] | None = None
        self._compared: Future[dict[str, Any]] | None = None

    def begin(self) -> Future[CacheWriter]:
        """Have the writer built, if it is not."""
        self._made = self._made or self._pool.submit(new_writer, self._task)
        return self._made

    @property
    def writer(self) -> CacheWriter:
        """The writer; waits for it. Raises what new_writer raises."""
        return self.begin().result()

    def compare(self, laid: Laid | None) -> None:
        """Have found, when the writer is built, what the cache tells a later bake. laid: as of
        compared."""
        self._compared = self._pool.submit(compared, self._task, laid)

    def tell(self) -> None:
        """Have the writer keep what was to be found; waits for it, and raises what finding it
        raises."""
        assert self._compared is not None
        self.writer.tell(self._compared.result())

    def write(self, frame: Frame, checkpoint: Checkpoint | None) -> None:
        """Write the next sample, and where a chunk ends what goes on after it."""
        self.writer.write(frame, checkpoint.save if checkpoint else None)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: Any) -> None:
        self._pool.shutdown(cancel_futures=True)
        if self._built is not None:
            self._built.__exit__(*error)

    @property
    def _built(self) -> CacheWriter | None:
        """The writer, if it was built."""
        if self._made is None or self._made.cancelled() or self._made.exception() is not None:
            return None
        return self._made.result()

    @property
    def state(self) -> str:
        """What an interrupt has left, in words."""
        writer = self._built
        if writer is None:
            return "interrupted before the first frame: nothing new was written"
        if writer.published:
            return f"interrupted, but {self._task.path} is complete"
        if kept := writer.samples_kept:
            return f"interrupted: {kept} of {self._task.samples} samples are kept for --resume"
        return "interrupted: nothing was written"


def compared(task: Task, laid: Laid | None) -> dict[str, Any]:
    """What a later bake compares itself with (see `again`). laid: who is laid over whom."""
    return {} if task.dependences is None else tables(task, task.dependences.shown(laid))


def tables(task: Task, dependences: Sequence[str]) -> dict[str, Any]:
    """The same, by what is shown of the task's feathers."""
    depend = dict(zip(task.names, dependences, strict=True))
    found = {"inputs": table_text(task.shot.inputs), "dependences": table_text(depend)}
    if task.whole.layers is not None and task.dependences is not None:
        ids = [each.id for each in task.whole.groom.feathers]
        found["motions"] = table_text(dict(zip(ids, task.dependences.motion, strict=True)))
    return found
