"""Hooks of a shot's vanes: strokes that close gaps, healing, and an account of both."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from featherfx.algebra.types import Flags
from featherfx.shot.loop.groups import FeatherGroup
from featherfx.shot.loop.run import Stage
from featherfx.shot.patterns import fits
from featherfx.shot.types import Preen
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
