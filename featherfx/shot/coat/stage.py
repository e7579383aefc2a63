"""The coat of a shot in the frame loop: feathers on a skin are written on their leaves."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from featherfx.algebra.types import Flags
from featherfx.feather.types import stacked
from featherfx.shot.clock import StageClock
from featherfx.shot.coat.leaves import SkinLeaves
from featherfx.shot.contact.skin_binding import surfaces_under
from featherfx.shot.frames import FeatherPose
from featherfx.shot.loop.groups import ALONE
from featherfx.shot.loop.run import Stage
from featherfx.shot.motion.cuts import CutRoots
from featherfx.shot.motion.limbs import limbs_of, moving_limbs
from featherfx.shot.motion.motion import undirected_motion
from featherfx.shot.patterns import last_fitting
from featherfx.shot.preroll import RunUpRoots
from featherfx.shot.roots import RootFrames, Roots, root_rates

_RATES = "points", "velocities", "accelerations"


class CoatStage(Stage):
    """Feathers of a shot that lie on a skin.

    The solver sees them on roots that the skin carries rigidly. Their deviation from rest there,
    which is zero for rigid ones, is written on the leaf of each on the moving skin.
    """

    def prepare(self) -> None:
        """Find the feathers that keep a leaf, with their feet."""
        run, shot = self.run, self.run.shot
        self._leaves: list[SkinLeaves] = []
        self._without: list[str] = []
        assert shot.skin is not None
        chosen = run.wanted[self._may_lie()[run.wanted]]
        for surface, own in surfaces_under(shot.skin, chosen, shot.run_up):
            if surface.surface.bones is None and surface.surface.sampled is not None:
                some = chosen[own]
                placements = [shot.groom.feathers[f] for f in some]
                found = SkinLeaves(surface, placements, [run.drawn[f] for f in some], some)
                self._without += [
                    shot.groom.feathers[f].id for f in np.setdiff1d(some, found.members)
                ]
                if len(found.members):
                    self._leaves.append(found)
        self._motion: Roots = run.motion
        if shot.channels:  # which turn feathers on their leaves
            plain = undirected_motion(shot)
            whole: Roots = RunUpRoots(plain, shot.run_up) if shot.run_up.duration else plain
            clock = StageClock(0.0, 1.0, shot.frames_per_second, shot.frame_cuts)
            self._motion = CutRoots(whole, clock)

    def _may_lie(self) -> Flags:
        """(F,) feathers that nothing but skin, loads and guides moves."""
        run, shot = self.run, self.run.shot
        placements = shot.groom.feathers
        led = {each.feather for each in shot.grips}
        rules = last_fitting((*shot.detachments, *shot.targets), placements)
        free = [
            each.id not in led and rule < 0 for each, rule in zip(placements, rules, strict=True)
        ]
        limbs = limbs_of(shot.groom) if shot.motion.of_limbs else moving_limbs(shot)
        if shot.groom.coat is not None:  # wings and tails stand on what the coat is not
            free = [
                own and each.leaf is not None for own, each in zip(free, placements, strict=True)
            ]
        return np.array(free) & (run.islands == ALONE) & np.equal(limbs, 0)

    def follow(self, index: int, poses: dict[int, FeatherPose]) -> None:
        """Draw the feathers on their leaves at a sample."""
        if not self._leaves:
            return
        span = self.run.time(index - 1), self.run.time(index)
        rates = root_rates(self._motion, *span)
        for leaves in self._leaves:
            members = leaves.members
            before = [poses[f] for f in members.tolist()]
            given = [stacked([getattr(pose, name) for pose in before]) for name in _RATES]
            roots = [RootFrames(*(values[members] for values in each)) for each in rates]
            drawn = [each.each() for each in leaves.follow(given, roots, span, self.run.jobs)]
            for f, pose, *values in zip(members.tolist(), before, *drawn, strict=True):
                poses[f] = replace(pose, **dict(zip(_RATES, values, strict=True)))

    def report(self) -> dict[str, Any]:
        """Ids of feathers that stand off the skin, and are written as they were simulated."""
        return {"without_leaf": self._without} if self._without else {}
