"""Level of detail of every feather at every frame, known before the first one is simulated.

A feather's size in the picture, in pixels, times 1 + motion a / g, a the acceleration of its root
and of its tip were it rigid, chooses the level; the quality's lengths may ask for a coarser one,
and [[detail]] and what pulls a feather decide alone. The finest level that a feather needs within
`fade` frames before and after is taken: a finer one is there before it is needed, and what lies at
a threshold does not flicker. Levels depend on frames only, not on what was simulated.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from featherfx.algebra.types import Array, Flags, Indices
from featherfx.feather.types import Feather
from featherfx.limits import refuse_beyond_memory
from featherfx.shot.detail.detail import CARRIED, Detailer, Resolution
from featherfx.shot.detail.guides import with_guides
from featherfx.shot.detail.view import relative_sizes
from featherfx.shot.motion.roots import RootFrames, Roots, sampled_rates
from featherfx.shot.types import LEVELS, LevelOfDetail, Shot

Numbers = NDArray[np.int8]

NUMBER = {level: number for number, level in enumerate(LEVELS)}
# m/s^2, accelerations are measured in
GRAVITY = 9.81
# of a feather and frame while levels are chosen: root frames, sizes, accelerations
_SEEN_BYTES = 300


@dataclass(frozen=True)
class LevelPlan:
    """table: (frames, F) numbers of levels; one row where none changes. resolutions: per feather,
    of the levels that it ever has, the first frame's first. free: (F,) which leave their roots.
    air: (F,) its share of what bends their shafts."""

    table: Numbers
    resolutions: tuple[tuple[Resolution, ...], ...]
    free: Flags
    air: Array

    @property
    def changes(self) -> bool:
        """Whether any feather changes its level."""
        return bool((self.table != self.table[:1]).any())

    def of(self, level: str) -> Indices:
        """Numbers of the feathers that are ever at a level."""
        return np.flatnonzero((self.table == NUMBER[level]).any(axis=0))

    @property
    def leading(self) -> Indices:
        """Numbers of the feathers that may guide: never guided nor free, and simulated at some
        level."""
        solved = np.array([bool(simulated(each)) for each in self.resolutions])
        return np.setdiff1d(np.flatnonzero(solved & ~self.free), self.of("guided"))

    def part(self, feathers: Indices, played: Indices) -> LevelPlan:
        """The plan in which nothing is solved of all others, and these are rigid but for some whose
        motion is known."""
        others = np.ones(self.table.shape[1], dtype=np.bool_)
        others[feathers] = False
        rigid = others.copy()
        rigid[played] = False
        table = np.where(rigid, np.int8(NUMBER["rigid"]), self.table)
        kept = zip(self.resolutions, others, strict=True)
        resolutions = tuple(() if other else each for each, other in kept)
        return replace(self, table=table, resolutions=resolutions)

    @property
    def steady(self) -> Indices:
        """Numbers of the feathers that are solved, always at one level."""
        solved = [bool(simulated(each)) for each in self.resolutions]
        return np.flatnonzero(solved & (self.table == self.table[:1]).all(axis=0))

    def at(self, frame: int) -> Numbers:
        """(F,) at a frame, counted from the shot's first."""
        return self.table[min(max(frame, 0), len(self.table) - 1)]


def level_plan(shot: Shot, feathers: Sequence[Feather], motion: Roots) -> LevelPlan:
    """Levels of all feathers; feathers: as the meshes have them.

    Raises InputError for feathers that are not simulated but pulled, or that lack guides.
    """
    detailer = Detailer(shot, feathers, motion)
    table = np.array([[NUMBER[level] for level in detailer.levels]], dtype=np.int8)
    if shot.level_of_detail is not None:
        table = np.maximum(table, _seen(shot, shot.level_of_detail, motion))
        pinned = np.flatnonzero(detailer.pinned)
        table[:, pinned] = [NUMBER[detailer.levels[f]] for f in pinned]
    ever = (table == NUMBER["guided"]).any(axis=0)
    wanted = [
        "guided" if guided else LEVELS[finest]
        for guided, finest in zip(ever, table.min(axis=0), strict=True)
    ]
    chosen = with_guides(shot, wanted, detailer.rules)
    guides = np.flatnonzero([a != b for a, b in zip(wanted, chosen, strict=True)])
    table[:, guides] = np.where(table[:, guides] == NUMBER["guided"], 0, table[:, guides])
    return LevelPlan(table, _resolutions(detailer, table), detailer.free, detailer.air)


def _resolutions(detailer: Detailer, table: Numbers) -> tuple[tuple[Resolution, ...], ...]:
    found = []
    for f in range(table.shape[1]):
        levels = dict.fromkeys([table[0, f], *np.unique(table[:, f])])
        found.append(tuple(detailer.resolution(f, LEVELS[number]) for number in levels))
    return tuple(found)


def _seen(shot: Shot, rules: LevelOfDetail, motion: Roots) -> Numbers:
    """(frames, F) by size in the picture and motion, the finest within the fade."""
    frames, count = shot.last_frame - shot.first_frame + 1, len(shot.groom.feathers)
    what = f"levels of {count} feathers in {frames} frames"
    refuse_beyond_memory(_SEEN_BYTES * frames * count, str(shot.source), "level_of_detail", what)
    times = np.arange(frames) / shot.frames_per_second
    lengths = np.array([p.kind.length for p in shot.groom.feathers])
    roots = [motion.frames(float(time)) for time in times]
    sizes = np.stack(
        [_pixels(rules, t, each.positions, lengths) for t, each in zip(times, roots, strict=True)]
    )
    if rules.motion > 0.0 and frames > 2:
        sizes = sizes * (1.0 + rules.motion / GRAVITY * _accelerations(roots, times, lengths))
    levels = np.zeros(sizes.shape, dtype=np.int8)
    for level in ("coarse", "rachis", "guided", "rigid"):
        levels[sizes < getattr(rules, f"{level}_below")] = NUMBER[level]
    levels[sizes == 0.0] = NUMBER[rules.outside]
    around = np.pad(levels, ((rules.fade, rules.fade), (0, 0)), mode="edge")
    return np.asarray(sliding_window_view(around, 2 * rules.fade + 1, axis=0).min(axis=-1))


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


def simulated(resolutions: Sequence[Resolution]) -> list[Resolution]:
    """Those at which something is solved."""
    return [each for each in resolutions if each.level not in CARRIED]
