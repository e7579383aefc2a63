"""What happens to the hooks of a shot's vanes: strokes that close gaps, and an account of both."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from featherfx.algebra.types import Flags
from featherfx.shot.groups import Group
from featherfx.shot.patterns import fits
from featherfx.shot.types import Preen, Shot
from featherfx.solver.preen import close_gaps
from featherfx.solver.step.gap_kernels import (
    DAMPED_ENERGY,
    HEALED_LENGTH,
    OPENED_LENGTH,
    OPENING_WORK,
    PREENING_WORK,
    RELEASED_ENERGY,
    SLIP_WORK,
)


class Hooks:
    """Batches of a shot whose hooks may slip."""

    def __init__(self, shot: Shot, groups: Sequence[Group]) -> None:
        self._groups = [group for group in groups if group.solver.model.hooked]
        self._shot = shot
        self._stirred: dict[int, Flags] = {}
        self.begin()
        self._changes: list[dict[str, Any]] = []

    def begin(self) -> None:
        """Count from here what opens and heals: the states are those of another simulation."""
        self._before = [group.state.gaps.length.copy() for group in self._groups]

    def preen(self, start: float, end: float) -> None:
        """Close the gaps that strokes reach between two samples, from start to end (s)."""
        self._stirred = {}
        for group in self._groups:
            changed = np.zeros(len(group.members), dtype=np.bool_)
            for k, number in enumerate(group.members):
                placement = self._shot.groom.feathers[number]
                for stroke in self._shot.preens:
                    if fits(stroke, placement) and stroke.start < end and stroke.end > start:
                        changed[k] |= _stroke(group, k, stroke, start, end)
                rate = placement.kind.vane_material.hook_healing_rate
                if rate > 0.0:
                    every = np.ones(group.feathers[k].cell.shape, dtype=np.bool_)
                    fraction = 1.0 - np.exp(-rate * (end - start))
                    changed[k] |= _close(group, k, every, float(fraction), 0.0)
            self._stirred[id(group)] = changed

    def stirred(self, group: Group) -> Flags:
        """(F,) feathers of a batch whose gaps were closed on the way to this sample."""
        return self._stirred.get(id(group), np.zeros(len(group.members), dtype=np.bool_))

    def note(self, number: float) -> None:
        """Note at a frame what has opened and healed since the last one."""
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


def _stroke(group: Group, k: int, stroke: Preen, start: float, end: float) -> bool:
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


def _close(group: Group, k: int, touched: Flags, fraction: float, reach: float) -> bool:
    gaps = close_gaps(group.solver.model, group.state, k, touched, fraction, reach)
    if gaps is None:
        return False
    # a checkpoint may still hold the state
    state = group.state.copy()
    for array, value in zip(state.gaps, gaps, strict=True):
        array[k] = value
    group.state = state
    return True
