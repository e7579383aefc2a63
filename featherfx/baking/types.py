"""A bake that can start, and what it takes over of an earlier one."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

from featherfx.baking.options import BakeOptions
from featherfx.shot.layers.types import Laid
from featherfx.shot.types import Shot

if TYPE_CHECKING:
    from featherfx.usd.write.previous_cache import EarlierCache


@dataclass(frozen=True)
class TakenOver:
    """Of an earlier cache at a bake's output.

    cache: the earlier one. feathers: numbers among the bake's of those whose samples are taken.
    moving: numbers in the shot of those that move as they did, before they are laid over others.
    changed: what is different, in words.
    """

    cache: EarlierCache
    feathers: tuple[int, ...]
    moving: tuple[int, ...]
    changed: tuple[str, ...]


class Dependences:
    """Texts of what some feathers of a shot depend on, by their numbers; found once."""

    def __init__(self, shot: Shot, numbers: Sequence[int]) -> None:
        self._shot, self._numbers = shot, numbers
        self._shown: list[str] = []

    @cached_property
    def motion(self) -> list[str]:
        """Of the motion of all feathers of the shot, before they are laid over each other."""
        # loads compiled code, which a finished cache does without
        from featherfx.shot.dependence import motion_dependences

        return motion_dependences(self._shot)

    def shown(self, laid: Laid | None = None) -> list[str]:
        """Of what is shown, given who is laid over whom where that is known."""
        from featherfx.shot.dependence import dependences

        if not self._shown:
            every = dependences(self._shot, laid, self.motion)
            self._shown = [every[k] for k in self._numbers]
        return self._shown


@dataclass(frozen=True)
class Task:
    """A bake that can start: shot (reduced to its part of the feathers), output, frames, settings.

    whole, wanted: what is simulated for it, and the numbers of the task's feathers in that (None:
    all). names: prim name per feather. root: name of the root prim. finished: whether the output is
    there already. taken: what is taken over of a cache of other settings at the output. origin:
    where the root prim stands. options: with units and axis as they will be. dependences: texts of
    its feathers (featherfx/shot/dependence.py), None: of a trial, which nothing is kept of.
    frames_each: of a chunk, where it must be another cache's; else the writer's choice.
    """

    shot: Shot
    path: Path
    frames: tuple[int, int]
    settings: dict[str, str]
    names: Sequence[str]
    root: str
    finished: bool
    options: BakeOptions
    whole: Shot
    wanted: Sequence[int] | None
    taken: TakenOver | None
    origin: tuple[float, float, float]
    dependences: Dependences | None
    frames_each: int | None = None

    @property
    def samples(self) -> int:
        """Samples from the first frame to the last."""
        return (self.frames[1] - self.frames[0]) * self.options.subframes + 1

    @property
    def samples_after(self) -> int:
        """Samples that are simulated after the last one, since it is laid with regard to them."""
        shot, subframes = self.whole, self.options.subframes
        if shot.layers is None:
            return 0
        ahead = shot.layers.samples_ahead(1.0 / (shot.frames_per_second * subframes))
        return min(ahead, (shot.last_frame - self.frames[1]) * subframes)
