"""Poses of the feathers at a sample: solved, replayed, rigid on their roots, or guided."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from featherfx.algebra.types import Indices
from featherfx.feather.types import Feather
from featherfx.shot.detail.followers import GuidedFeathers, rigid_poses
from featherfx.shot.detail.levels import LevelPlan
from featherfx.shot.frames import FeatherPose
from featherfx.shot.groups import Group, poses_of
from featherfx.shot.motion.roots import Roots
from featherfx.shot.replay import Replay


class SampledPoses:
    """Poses of the feathers that are shown, and of the guides of these, sample by sample.

    drawn: all feathers on the meshes' grid. groups: of those that are solved. wanted: numbers of
    those that are shown. duration: s, between two samples.
    """

    def __init__(
        self,
        plan: LevelPlan,
        drawn: Sequence[Feather],
        groups: Sequence[Group],
        motion: Roots,
        guided: GuidedFeathers,
        replay: Replay,
        wanted: Indices,
        duration: float,
    ) -> None:
        self._groups, self._motion, self._guided = groups, motion, guided
        self._replay, self._wanted, self._duration = replay, wanted, duration
        rigid = plan.at_level("rigid")
        self._rigid = {f: drawn[f] for f in np.intersect1d(rigid, wanted).tolist()}
        self.counts = len(self._rigid), len(guided.guided)
        solved = [replay.numbers, *(group.members for group in groups)]
        self._solved = set(np.concatenate(solved).tolist())

    def at(self, index: int) -> tuple[list[FeatherPose], dict[int, FeatherPose]]:
        """Return the poses of the wanted feathers at a sample, and by number those of all that are
        solved or replayed."""
        start, end = (index - 1) * self._duration, index * self._duration
        found = dict(self._replay.poses(index))
        for group in self._groups:
            found |= poses_of(group)
        solved = {f: pose for f, pose in found.items() if f in self._solved}
        if self._rigid:
            found |= rigid_poses(self._rigid, self._motion, start, end)
        if len(self._guided.guided):
            found |= self._guided.poses(found, self._motion, start, end)
        return [found[f] for f in self._wanted.tolist()], solved
