"""The level of detail of every feather of a shot, chosen before the first frame.

A feather's size in the image, in pixels, times 1 + motion a / g, a the acceleration of its root
and of its tip were it rigid, chooses the level by its largest value over the shot's frames. The
quality's lengths may ask for a coarser one; [[detail]] and what pulls a feather decide alone.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from featherfx.algebra.types import Array, Flags, Indices
from featherfx.feather.types import Feather
from featherfx.limits import refuse_beyond_memory
from featherfx.shot.detail.detail import Detailer, Resolution
from featherfx.shot.detail.guides import with_guides
from featherfx.shot.roots import RootFrames, Roots, sampled_rates
from featherfx.shot.types import LEVELS, LevelOfDetail, Shot
from featherfx.shot.view import relative_sizes

_NUMBER = {level: number for number, level in enumerate(LEVELS)}
# m/s^2, accelerations are measured in
_GRAVITY = 9.81
# of a feather and frame while levels are chosen: root frames, sizes, accelerations
_BYTES_PER_FEATHER_FRAME = 300


@dataclass(frozen=True)
class LevelPlan:
    """How each feather of a shot is simulated.

    resolutions: of every feather. free: (F,) which leave their roots. air: (F,) the air's share of
    what bends their rachises.
    """

    resolutions: tuple[Resolution, ...]
    free: Flags
    air: Array

    @property
    def simulated(self) -> Flags:
        """(F,) which feathers are solved."""
        return np.array([each.is_simulated for each in self.resolutions], dtype=np.bool_)

    @property
    def leading(self) -> Indices:
        """Numbers of the feathers that may guide others: solved, and never free."""
        return np.flatnonzero(self.simulated & ~self.free)

    def at_level(self, level: str) -> Indices:
        """Return the numbers of the feathers at a level."""
        return np.flatnonzero([each.level == level for each in self.resolutions])


def level_plan(shot: Shot, feathers: Sequence[Feather], motion: Roots) -> LevelPlan:
    """Choose the levels of all feathers; feathers: as the meshes have them.

    Raises InputError for feathers that are not simulated but pulled, or that lack guides.
    """
    detailer = Detailer(shot, feathers, motion)
    levels = list(detailer.levels)
    if shot.level_of_detail is not None:
        seen = _levels_by_size(shot, shot.level_of_detail, motion)
        levels = [
            own if pinned else max(own, by_size, key=_NUMBER.__getitem__)
            for own, by_size, pinned in zip(levels, seen, detailer.pinned, strict=True)
        ]
    levels = with_guides(shot, levels, detailer.rules)
    resolutions = tuple(detailer.resolution(f, level) for f, level in enumerate(levels))
    return LevelPlan(resolutions, detailer.free, detailer.air)


def _levels_by_size(shot: Shot, rules: LevelOfDetail, motion: Roots) -> list[str]:
    """Levels of all feathers by their largest size in the image, weighted by their motion."""
    frames, count = shot.last_frame - shot.first_frame + 1, len(shot.groom.feathers)
    what = f"levels of {count} feathers in {frames} frames"
    needed = _BYTES_PER_FEATHER_FRAME * frames * count
    refuse_beyond_memory(needed, str(shot.source), "level_of_detail", what)
    times = np.arange(frames) / shot.frames_per_second
    lengths = np.array([p.kind.length for p in shot.groom.feathers])
    roots = [motion.frames(float(time)) for time in times]
    sizes = np.stack(
        [_pixels(rules, t, each.positions, lengths) for t, each in zip(times, roots, strict=True)]
    )
    if rules.motion > 0.0 and frames > 2:
        sizes = sizes * (1.0 + rules.motion / _GRAVITY * _accelerations(roots, times, lengths))
    return [_level_of_size(rules, size) for size in sizes.max(axis=0).tolist()]


def _level_of_size(rules: LevelOfDetail, size: float) -> str:
    if size == 0.0:
        return rules.outside
    for level in ("rigid", "guided", "rachis", "coarse"):
        if size < getattr(rules, f"{level}_below"):
            return level
    return "full"


def _pixels(rules: LevelOfDetail, time: float, roots: Array, lengths: Array) -> Array:
    if rules.camera is None:
        return (rules.pixels_per_metre or 0.0) * lengths
    view = rules.camera.view(time)
    return rules.image_height * relative_sizes(view, roots, lengths, rules.margin)


def _accelerations(roots: Sequence[RootFrames], times: Array, lengths: Array) -> Array:
    """(frames, F) m/s^2, the larger of roots and of tips that are rigid."""
    found = []
    for reach in (np.zeros_like(lengths), lengths):
        places = np.stack([p + reach[:, None] * r[:, :, 0] for p, r in roots])
        _, acceleration = sampled_rates(places, times)
        found.append(np.linalg.norm(acceleration, axis=2))
    return np.maximum(*found)
