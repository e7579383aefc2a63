"""Levels of detail by the size of feathers in the image, and the guides of guided feathers.

A feather's size in the image, in pixels, times 1 + motion a / g, a the acceleration of its root
and of its tip were it rigid, chooses the level by its largest value over the shot's frames. The
quality's lengths may ask for a coarser one; [[detail]] and what pulls a feather decide alone.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from featherfx.algebra.types import Array
from featherfx.limits import refuse_beyond_memory
from featherfx.shot.detail.guides import GuideRule, with_guides
from featherfx.shot.roots import RootFrames, Roots, sampled_rates
from featherfx.shot.types import LEVELS, LevelOfDetail, Shot
from featherfx.shot.view import relative_sizes

_NUMBER = {level: number for number, level in enumerate(LEVELS)}
# m/s^2, accelerations are measured in
_GRAVITY = 9.81
# of a feather and frame while levels are chosen: root frames, sizes, accelerations
_BYTES_PER_FEATHER_FRAME = 300


def refine_levels(
    shot: Shot,
    motion: Roots,
    levels: Sequence[tuple[str, str]],
    entries: Sequence[int],
    pinned: Sequence[bool],
) -> list[tuple[str, str]]:
    """Return levels of all feathers with their sources, coarser where a feather is seen small, and
    full where it guides others.

    entries: of each the [[detail]] that fits, -1 for none. pinned: which no camera changes. Raises
    InputError for regions whose guided feathers have no guide.
    """
    found = list(levels)
    if (rules := shot.level_of_detail) is not None:
        for f, (level, source) in enumerate(_levels_by_size(shot, rules, motion)):
            if not pinned[f] and _NUMBER[level] > _NUMBER[found[f][0]]:
                found[f] = level, source
    details, every = shot.details, shot.quality.guided_every
    guide_rules = [
        GuideRule(details[k].every, details[k].spacing) if k >= 0 else GuideRule(every, None)
        for k in entries
    ]
    own = [level for level, _ in found]
    for f, level in enumerate(with_guides(shot, own, guide_rules)):
        if level != own[f]:
            found[f] = level, f"guide of region {shot.groom.feathers[f].region!r}"
    return found


def _levels_by_size(shot: Shot, rules: LevelOfDetail, motion: Roots) -> list[tuple[str, str]]:
    """Return the levels of all feathers by their largest size in the image, weighted by their
    motion, and the keys that these follow from."""
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
        sizes = sizes * (1.0 + rules.motion / _GRAVITY * _accelerations(shot, roots, lengths))
    return [_level_of_size(rules, size) for size in sizes.max(axis=0).tolist()]


def _level_of_size(rules: LevelOfDetail, size: float) -> tuple[str, str]:
    if size == 0.0:
        return rules.outside, "[level_of_detail] outside"
    for level in ("rigid", "guided", "rachis", "coarse"):
        if size < getattr(rules, f"{level}_below"):
            return level, f"[level_of_detail] {level}_below"
    return "full", "[level_of_detail]"


def _pixels(rules: LevelOfDetail, time: float, roots: Array, lengths: Array) -> Array:
    if rules.camera is None:
        return (rules.pixels_per_metre or 0.0) * lengths
    view = rules.camera.view(time)
    return rules.image_height * relative_sizes(view, roots, lengths, rules.margin)


def _accelerations(shot: Shot, roots: Sequence[RootFrames], lengths: Array) -> Array:
    """(frames, F) m/s^2, the larger of roots and of tips that are rigid."""
    found = []
    for reach in (np.zeros_like(lengths), lengths):
        places = np.stack([p + reach[:, None] * r[:, :, 0] for p, r in roots])
        _, acceleration = sampled_rates(places, np.arange(len(roots), dtype=float), shot)
        found.append(np.linalg.norm(acceleration, axis=2))
    return np.maximum(*found)
