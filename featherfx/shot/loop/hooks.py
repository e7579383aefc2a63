"""Hooks of a shot's vanes: strokes that close gaps, healing, an account of both, and wetness.

Gaps between barbs are closed again by strokes of a beak, and by hooks that find each other.
A gap that is closed by a share c of what is open gets that much of its strength back,

    h' = h + c (1 - h),    p' = (1 - c) p,    level' = 1 + (1 - c) (level - 1)

h hooks, p slip of vane_hook_kernels. An open one first takes its strains as its slip, so that it
hooks without stress. Where p' would leave it with more than _HELD_FRACTION of its strength, it
keeps as much slip as that takes: what is pulled apart as it is closed would open again at once. The
energy that this puts into the vane is work of the beak. Only gaps whose edges are within reach are
closed:

    (J - 1) / (1 / h_0) <= reach

J the ratio of areas of guard_kernels, 1 / h_0 that of the triangle's height at rest.

Wet feathers have water on the vane, hooks that it weakens, and air that finds its way through.
With the wetness w of a rule at a time, 0 to 1:

    mass of the vane at each node    m (1 + water w)
    yield and strength of hooks      f = 1 - (1 - hooks) w times what they are dry
    coefficients and added mass of the air    1 - (1 - drag) w times

Water comes and goes with the velocity of what it wets.
"""

from __future__ import annotations

from collections.abc import Hashable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from featherfx.algebra.types import Flags
from featherfx.feather.types import Feather
from featherfx.groom.types import Placement
from featherfx.mechanics.batch import vane_mass
from featherfx.mechanics.model import Gaps, Loads, Model
from featherfx.shot.frames import FeatherPose
from featherfx.shot.loop.groups import FeatherGroup, GroupLoad
from featherfx.shot.loop.run import ShotLoad, ShotRun, Stage
from featherfx.shot.patterns import Preen, Wet, fits, last_fitting
from featherfx.shot.types import Shot
from featherfx.solver.state import State
from featherfx.solver.step.gap_kernels import (
    DAMPED_ENERGY,
    HEALED_LENGTH,
    LOOSE_FRACTION,
    OPENED_LENGTH,
    OPENING_WORK,
    PREENING_WORK,
    RELEASED_ENERGY,
    SLIP_WORK,
)

# part of its strength that a gap may bear when it is closed
_HELD_FRACTION = 0.5
# smallest square of J
_FLAT = 1e-6


def close_gaps(
    model: Model, state: State, feather: int, touched: Flags, fraction: float, reach: float
) -> Gaps | None:
    """Gaps of a feather of a state after some of them are closed; None where none is.

    touched: (2, n-1, m, 2) triangles that are looked at. fraction: c, above 0 to 1. reach: m. The
    state is not changed.
    """
    gaps, hooks = state.gaps_of(feather), model.hooks
    strain, stiffness = state.strains.cell[feather, 0], model.cell_stiffness[feather]
    slipped = (gaps.hooked < 1.0) | (gaps.level > 1.0) | gaps.slip.any(axis=-1)
    chosen = touched & slipped & (stiffness[..., 0] > 0.0) & (hooks.limit[feather, ..., 0] > 0.0)
    square = np.maximum(1.0 + 2.0 * strain[..., 0] - strain[..., 1] ** 2, _FLAT)
    chosen &= np.sqrt(square) - 1.0 <= reach * model.cell_rest[feather, ..., 2] + 1e-12
    if not chosen.any():
        return None
    new = Gaps(*(array.copy() for array in gaps))
    x, k, y = strain[chosen], stiffness[chosen], hooks.limit[feather][chosen]
    was_open = gaps.hooked[chosen] == 0.0
    hooked = gaps.hooked[chosen] + fraction * (1.0 - gaps.hooked[chosen])
    hooked[hooked > 1.0 - LOOSE_FRACTION] = 1.0
    level = np.where(was_open, 1.0, 1.0 + (1.0 - fraction) * (gaps.level[chosen] - 1.0))
    before = np.where(was_open[:, None], x, gaps.slip[chosen])
    slip = (1.0 - fraction) * before
    stress = k * (x - slip)
    borne = np.hypot(np.maximum(stress[:, 0], 0.0) / y[:, 0], stress[:, 1] / y[:, 1])
    much = borne / (_HELD_FRACTION * hooked * level)
    slip = np.where(much[:, None] > 1.0, x - (x - slip) / np.maximum(much, 1.0)[:, None], slip)
    work = 0.5 * np.sum(k * ((x - slip) ** 2 - (x - before) ** 2))
    new.hooked[chosen], new.level[chosen], new.slip[chosen] = hooked, level, slip
    new.spent[PREENING_WORK] += work
    # m, length of a gap that each triangle stands for
    own = np.stack([model.segment[feather, :, :-1], model.segment[feather, :, 1:]], axis=-1)
    half = np.broadcast_to(0.5 * own[:, :, None], hooks.growth[feather].shape)
    new.length[HEALED_LENGTH] += half[chosen] @ (hooked - gaps.hooked[chosen])
    return new


class HookStage(Stage):
    """The hooks of a shot's vanes: strokes and healing that close gaps, and an account of both."""

    def prepare(self) -> None:
        """Take the batches whose hooks may slip."""
        self._groups = [group for group in self.run.groups if group.solver.model.hooked]
        self._changes: list[dict[str, Any]] = []
        self.restore({})

    def restore(self, arrays: Mapping[str, NDArray[Any]]) -> None:
        """Count from here what opens and heals: the states are those of another simulation."""
        self._before = [group.state.gaps.length.copy() for group in self._groups]

    def begin(self, index: int) -> None:
        """Close the gaps that strokes reach, and that heal, on the way to a sample."""
        if index <= 0:
            return
        start, end, shot = self.run.time(index - 1), self.run.time(index), self.run.shot
        for group in self._groups:
            changed = group.stirred
            for k, number in enumerate(group.members):
                placement = shot.groom.feathers[number]
                for stroke in shot.preens:
                    if fits(stroke, placement) and stroke.start < end and stroke.end > start:
                        changed[k] |= _stroke(group, k, stroke, start, end)
                rate = placement.kind.vane_material.hook_healing_rate
                if rate > 0.0:
                    every = np.ones(group.feathers[k].cell.shape, dtype=np.bool_)
                    fraction = 1.0 - np.exp(-rate * (end - start))
                    changed[k] |= _close(group, k, every, float(fraction), 0.0)

    def note(self, index: int) -> None:
        """Note what has opened and healed since the sample before."""
        number = self.run.number(index)
        for place, group in enumerate(self._groups):
            now = group.state.gaps.length.copy()
            change = now - self._before[place]
            for k in np.flatnonzero(change.any(axis=1)).tolist():
                opened, healed = change[k].tolist()
                self._changes.append(
                    {"feather": group.names[k], "frame": number}
                    | {"opened": opened, "healed": healed}
                )
            self._before[place] = now

    def report(self) -> dict[str, Any]:
        """Figures of a bake's report; empty where no hook slips."""
        if not self._groups:
            return {}
        gaps = [group.state.gaps for group in self._groups]
        spent = sum(each.spent.sum(axis=0) for each in gaps)
        length = sum(each.length.sum(axis=0) for each in gaps)
        return {
            "hooks": {
                "opened": float(length[OPENED_LENGTH]),
                "healed": float(length[HEALED_LENGTH]),
                "slip_work": float(spent[SLIP_WORK]),
                "opening_work": float(spent[OPENING_WORK]),
                "released_energy": float(spent[RELEASED_ENERGY]),
                "preening_work": float(spent[PREENING_WORK]),
                "damping_work": float(spent[DAMPED_ENERGY]),
                "changes": self._changes,
            }
        }


def _stroke(group: FeatherGroup, k: int, stroke: Preen, start: float, end: float) -> bool:
    """Close what a stroke comes to between two times; whether that was anything."""
    first, last = np.clip(
        (np.array([start, end]) - stroke.start) / (stroke.end - stroke.start), 0.0, 1.0
    )
    cell = group.feathers[k].cell
    if stroke.direction == "barbs":
        place = (np.arange(cell.shape[2]) + 0.5)[:, None] / cell.shape[2]
    else:
        station = group.feathers[k].station
        place = (0.5 * (station[1:] + station[:-1]) / station[-1])[:, None, None]
    touched = np.broadcast_to((place > first) & (place <= last), cell.shape)
    return _close(group, k, touched, stroke.closed_fraction, stroke.max_gap)


def _close(group: FeatherGroup, k: int, touched: Flags, fraction: float, reach: float) -> bool:
    gaps = close_gaps(group.solver.model, group.state, k, touched, fraction, reach)
    if gaps is None:
        return False
    # a checkpoint may still hold the state
    state = group.state.copy()
    for array, value in zip(state.gaps, gaps, strict=True):
        array[k] = value
    group.state = state
    return True


def wetness(rule: Wet, time: float) -> float:
    """Return the wetness of a rule at a time (s since the first frame), 0 to 1."""
    return float(np.interp(time, *np.transpose(rule.keys)))


class WetLoads(ShotLoad):
    """The feathers of a shot that are wet at times."""

    def __init__(self, run: ShotRun) -> None:
        super().__init__(run)
        self._rules = last_fitting(run.shot.wets, run.shot.groom.feathers)

    def key(self, feather: int) -> Hashable:
        """Number of the rule, or -1."""
        return self._rules[feather]

    def on(self, group: FeatherGroup) -> GroupLoad | None:
        """The water of a batch."""
        rule, placements = self._rules[group.members[0]], self.run.shot.groom.feathers
        if rule < 0:
            return None
        some = [placements[f] for f in group.members]
        return Water(self.run.shot.wets[rule], group.feathers, some)


class Water(GroupLoad):
    """The water of a batch of feathers, all wet by one rule."""

    def __init__(
        self, rule: Wet, feathers: Sequence[Feather], placements: Sequence[Placement]
    ) -> None:
        self._rule, self._wet = rule, 0.0
        pairs = zip(feathers, placements, strict=True)
        self._vane = np.stack([vane_mass(feather, each.kind) for feather, each in pairs])

    def renew(self, group: FeatherGroup, start: float, end: float) -> bool:
        """Be as wet as at the end of a step; whether that is other than before."""
        before, self._wet = self._wet, wetness(self._rule, end)
        return self._wet != before

    def model(self, model: Model) -> Model:
        """Constant data at the present wetness, from those of dry feathers."""
        rule, wet = self._rule, self._wet
        drag = 1.0 - (1.0 - rule.drag) * wet
        wetted = model._replace(
            mass=model.mass + rule.water * wet * self._vane,
            attached=model.attached * np.array([drag, 1.0]),
        )
        left = 1.0 - (1.0 - rule.hooks) * wet
        hooks = model.hooks
        weaker = hooks._replace(
            limit=hooks.limit * left,
            growth=hooks.growth / left,
            release=hooks.release * left,
            bounds=hooks.bounds / left,
        )
        return wetted._replace(hooks=weaker)

    def added(self, loads: Loads, group: FeatherGroup, start: float, end: float) -> Loads:
        """Loads of the batch at the present wetness: the shaft feels the air as ever."""
        left = 1.0 - (1.0 - self._rule.drag) * self._wet
        air = loads.air * np.array([1.0, left, left, 1.0])
        return loads._replace(air=air, added_mass=left * loads.added_mass)


class ClumpStage(Stage):
    """Barbs of wet feathers, as they are drawn."""

    def __init__(self, run: ShotRun) -> None:
        super().__init__(run)
        rules = last_fitting(run.shot.wets, run.shot.groom.feathers)
        self._rules = [rules[f] for f in run.wanted]

    def show(self, time: float, poses: list[FeatherPose]) -> list[FeatherPose]:
        """Have barbs come together in clumps."""
        clumps = [clumping(self.run.shot, rule, time) for rule in self._rules]
        return [p._replace(clumped=each) for p, each in zip(poses, clumps, strict=True)]


def clumping(shot: Shot, rule: int, time: float) -> tuple[float, int]:
    """Return how far barbs come together, and in how many clumps; rule: number, or -1."""
    if rule < 0:
        return 0.0, 1
    wet = shot.wets[rule]
    return wet.clump * wetness(wet, time), wet.clump_count
