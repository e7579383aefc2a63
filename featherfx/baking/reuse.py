"""Samples of an earlier cache at the output that a bake with `resume` keeps and reuses.

A finished bake is left as it is; the chunks of an unfinished one are kept; of one with other
settings, feathers that no change touched are reused.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from featherfx.baking.task import BakeTask, ReusedFeathers
from featherfx.errors import Problem
from featherfx.usd.types import OutputError
from featherfx.usd.write.previous_cache import PreviousCache, describe_changes, is_finished

if TYPE_CHECKING:
    from featherfx.shot.loop.simulate import Checkpoint
    from featherfx.usd.write.cache_writer import CacheWriter

_GONE = "was begun with samples of a cache that is gone; --overwrite bakes it anew"
# settings that need not be equal: frames are looked at, the others are in what feathers depend on
_FREE = ("frames", "feathers", "textures")


def resume_task(task: BakeTask) -> BakeTask:
    """Return the task as it goes on from the cache at its output.

    Raises OutputError where the task cannot go on from that cache.
    """
    inputs = task.shot.inputs
    try:
        finished = is_finished(task.path, task.settings, inputs, task.options.overwrite)
        return replace(task, finished=finished)
    except OutputError:
        if task.options.can_be_taken_over:
            taken = find_reused(task)
            if taken is not None:
                return replace(task, taken=taken)
        raise


def find_reused(task: BakeTask) -> ReusedFeathers | None:
    """Return what a bake may reuse of a finished cache at its output; None for nothing."""
    if not task.path.is_file():
        return None
    earlier = PreviousCache(task.path)
    if not _fits(earlier.settings, task.settings):
        return None
    assert task.dependences is not None
    same = _alike(earlier.dependences, task.names, task.dependences.texts)
    if not same:
        return None
    changes = describe_changes(earlier.settings, earlier.inputs, task.settings, task.shot.inputs)
    changed = tuple(f"{key}: {change}" for key, change in changes.items())
    return ReusedFeathers(earlier, same, changed)


def numbers_to_simulate(
    task: BakeTask, every: Sequence[int], writer: CacheWriter, start: Checkpoint | None
) -> Sequence[int]:
    """Return numbers, in the whole, of the feathers to simulate; the writer takes the others.

    every: numbers of the task's feathers. writer: of a bake with resume. start: of the bake that
    goes on; it simulates what that has simulated.
    """
    taken = set(task.taken.feathers) if task.taken else set()
    if task.taken and task.taken.cache.chunk != writer.chunk:
        taken = set()  # samples of a feather that hardly moves depend on where chunks begin
    wanted = [number for place, number in enumerate(every) if place not in taken]
    if start is not None and start.wanted.tolist() != wanted:
        wanted = start.wanted.tolist()
        known = set(wanted)
        taken = {place for place, number in enumerate(every) if number not in known}
        if taken and not (task.taken and taken <= set(task.taken.feathers)):
            raise OutputError(Problem(str(task.path), "", _GONE))
    if task.taken and taken:
        writer.take_over(task.taken.cache, sorted(taken))
    return wanted


def count_again(task: BakeTask, wanted: Sequence[int]) -> dict[str, Any]:
    """Count the feathers that were simulated again, for the report, with the reasons."""
    assert task.taken is not None
    kept = len(task.names) - len(wanted)
    counts = {"feathers_simulated": len(wanted), "feathers_taken_over": kept}
    return counts | {"changed": list(task.taken.changed)}


def _alike(
    earlier: Mapping[str, str], names: Sequence[str], texts: Sequence[str]
) -> tuple[int, ...]:
    """Return numbers of the names that had the same text."""
    pairs = enumerate(zip(names, texts, strict=True))
    return tuple(k for k, (name, text) in pairs if earlier.get(name) == text)


def _fits(earlier: Mapping[str, str], settings: Mapping[str, str]) -> bool:
    """Check that samples are written alike, from the same first frame to a last that is there."""
    alike = all(
        earlier.get(key) == text
        for key, text in settings.items()
        if key not in _FREE and not key.startswith("shot.")
    )
    before, now = (_frames(each.get("frames", "")) for each in (earlier, settings))
    return alike and before[0] == now[0] and now[1] <= before[1]


def _frames(text: str) -> tuple[int, int]:
    """Read first and last of "A-B"; an empty range where it is not that."""
    found = re.fullmatch(r"(-?\d+)-(-?\d+)", text)
    return (int(found[1]), int(found[2])) if found else (1, 0)
