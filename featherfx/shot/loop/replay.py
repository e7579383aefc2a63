"""The motion of solved feathers before they are laid over each other, kept from bake to bake.

What is laid depends on all that is beneath it, so a change to one row shows in most of a coat. How
the others move does not depend on it: a later bake takes their poses from here, sample by sample,
and only lays them anew.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from functools import cached_property
from itertools import product
from typing import Any

import numpy as np

from featherfx.algebra.types import Indices
from featherfx.errors import InputError, Problem
from featherfx.feather.types import RowPoints, stacked
from featherfx.files.disk_cache import Arrays, is_kept, keep, kept_before, room
from featherfx.shot.frames import FeatherPose

_WHAT = "motion"
# part of the store that the motion of one bake may take
_PART = 0.25
_RATES = "points", "velocities", "accelerations"


class Replay:
    """Motion that is taken from an earlier bake, and kept for later ones.

    ids: of all feathers of the shot. own, earlier: what tells this bake and the earlier one from
    others, "": keeps nothing, takes nothing. same: numbers of the feathers that move as they did
    in the earlier one. samples: how many are to be kept, or taken, from the first frame on.
    """

    def __init__(
        self,
        ids: Sequence[str] = (),
        own: str = "",
        earlier: str = "",
        same: Iterable[int] = (),
        samples: int = 0,
    ) -> None:
        self._ids, self._own, self._earlier = ids, own, earlier
        self._same, self._samples = set(same), samples
        self._known: tuple[int, dict[int, FeatherPose]] = -1, {}

    @cached_property
    def numbers(self) -> Indices:
        """Numbers of the feathers whose motion is taken, ascending; none where that of any sample
        is no longer there."""
        whole = all(is_kept(_WHAT, [self._earlier, k]) for k in range(self._samples))
        if not (self._earlier and self._same and self._samples and whole):
            return np.zeros(0, dtype=np.int64)
        arrays = kept_before(_WHAT, [self._earlier, 0])
        found = set() if arrays is None else set(arrays["ids"].tolist())
        numbers = [f for f in sorted(self._same) if self._ids[f] in found]
        return np.array(numbers, dtype=np.int64)

    def poses(self, sample: int) -> dict[int, FeatherPose]:
        """By number, those of the feathers whose motion is taken, at a sample counted from the
        first frame's. Raises InputError where they are no longer there."""
        if not len(self.numbers):
            return {}
        if self._known[0] != sample:
            arrays = kept_before(_WHAT, [self._earlier, sample])
            if arrays is None:
                message = f"the motion that was kept of sample {sample} is gone. Bake again"
                raise InputError(Problem("cache folder", "", message))
            self._known = sample, self._read(arrays)
        return self._known[1]

    def note(self, sample: int, poses: Mapping[int, FeatherPose]) -> None:
        """Keep the poses of feathers that are solved, or were before, at a sample."""
        if not self._own or not 0 <= sample < self._samples:
            return
        every = {f: pose for f, pose in sorted(poses.items()) if pose.gaps is None}
        if not every:
            return
        arrays = _arrays(list(every.values()))
        if self._samples * sum(each.nbytes for each in arrays.values()) > _PART * room():
            self._own = ""
            return
        ids = np.array([self._ids[f] for f in every])
        keep(_WHAT, [self._own, sample], arrays | {"ids": ids})

    def _read(self, arrays: Arrays) -> dict[int, FeatherPose]:
        places = {each: k for k, each in enumerate(arrays["ids"].tolist())}
        points, velocities, accelerations = (
            RowPoints(*(arrays[f"{rate}.{part}"] for part in RowPoints._fields)) for rate in _RATES
        )
        return {
            f: FeatherPose(points.at(k), velocities.at(k), accelerations.at(k))
            for f, k in ((f, places[self._ids[f]]) for f in self.numbers.tolist())
        }


def _arrays(poses: Sequence[FeatherPose]) -> dict[str, Any]:
    whole = {rate: stacked([getattr(pose, rate) for pose in poses]) for rate in _RATES}
    return {
        f"{rate}.{part}": getattr(whole[rate], part)
        for rate, part in product(_RATES, RowPoints._fields)
    }
