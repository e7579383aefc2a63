"""What a bake takes over of an earlier one with other settings: feathers that nothing touched."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from featherfx import usd
from featherfx.baking.types import TakenOver, Task
from featherfx.errors import Problem
from featherfx.files.content import digest
from featherfx.shot.replay import Replay
from featherfx.usd.types import OutputError

if TYPE_CHECKING:
    from featherfx.shot.checkpoint import Checkpoint
    from featherfx.usd.write.previous_cache import EarlierCache

GONE = "was begun with samples of a cache that is gone; --overwrite bakes it anew"
# settings that need not be equal: frames are looked at, the others are in what feathers depend on
_FREE = ("frames", "feathers", "textures")


def taken_over(task: Task, inputs: Mapping[str, str]) -> TakenOver | None:
    """What a bake may take of a finished cache at its output; None where that is nothing.

    inputs: what the files of its whole shot say.
    """
    if not task.path.is_file():
        return None
    earlier = usd.previous_cache.EarlierCache(task.path)
    if not _fits(earlier.settings, task.settings):
        return None
    assert task.dependences is not None
    same = _alike(earlier.dependences, task.names, task.dependences.shown())
    moving = _moving(task, earlier)
    if not same and not moving:
        return None
    told = usd.previous_cache.difference(earlier.settings, earlier.inputs, task.settings, inputs)
    changed = tuple(f"{key}: {change}" for key, change in told.items())
    return TakenOver(earlier, same, moving, changed)


def _moving(task: Task, earlier: EarlierCache) -> tuple[int, ...]:
    """Numbers in the shot of the feathers that move as in an earlier cache; none where its motion
    was not kept."""
    if task.whole.layers is None or task.dependences is None:
        return ()
    ids = [each.id for each in task.whole.groom.feathers]
    same = _alike(earlier.motions, ids, task.dependences.motion)
    return same if len(_replay(task, earlier, same).numbers) else ()


def replay_of(task: Task, start: Checkpoint | None) -> Replay:
    """What a bake takes, and keeps, of the motion of feathers that are laid over each other.

    start: of the bake that goes on, which takes what that took. Raises OutputError where that is
    gone.
    """
    taken = task.taken
    moving = taken.moving if taken else ()
    if start is not None:
        moving = tuple(start.replayed.tolist())
    replay = _replay(task, taken.cache if taken else None, moving)
    if start is not None and replay.numbers.tolist() != start.replayed.tolist():
        raise OutputError(Problem(str(task.path), "", GONE))
    return replay


def _replay(task: Task, earlier: EarlierCache | None, moving: Sequence[int]) -> Replay:
    shot, subframes = task.whole, task.options.subframes
    if shot.layers is None:
        return Replay()
    end, last = (
        (frame - shot.first_frame) * subframes for frame in (task.frames[1], shot.last_frame)
    )
    ahead = shot.layers.samples_ahead(1.0 / (shot.frames_per_second * subframes))
    ids = [each.id for each in shot.groom.feathers]
    own = digest(task.settings) if task.dependences else ""
    before = digest(earlier.settings) if earlier else ""
    return Replay(ids, own, before, moving, min(end + ahead, last) + 1)


def _alike(
    earlier: Mapping[str, str], names: Sequence[str], texts: Sequence[str]
) -> tuple[int, ...]:
    """Numbers of the names that had the same text."""
    pairs = enumerate(zip(names, texts, strict=True))
    return tuple(k for k, (name, text) in pairs if earlier.get(name) == text)


def _fits(earlier: Mapping[str, str], settings: Mapping[str, str]) -> bool:
    """Whether samples are written alike, from the same first frame to a last that is there."""
    alike = all(
        earlier.get(key) == text
        for key, text in settings.items()
        if key not in _FREE and not key.startswith("shot.")
    )
    before, now = (_frames(each.get("frames", "")) for each in (earlier, settings))
    return alike and before[0] == now[0] and now[1] <= before[1]


def _frames(text: str) -> tuple[int, int]:
    """First and last of "A-B"; none where it is not that."""
    found = re.fullmatch(r"(-?\d+)-(-?\d+)", text)
    return (int(found[1]), int(found[2])) if found else (1, 0)
