"""Where the simulation of a shot begins: at its first frame, or with what leads there."""

from __future__ import annotations

from dataclasses import replace

from featherfx.shot.detail.promise import common_tolerance
from featherfx.shot.direction.roots import warn_of_shares
from featherfx.shot.motion.motion import root_motion
from featherfx.shot.motion.preroll import RunUpRoots, run_up_of
from featherfx.shot.motion.roots import Roots
from featherfx.shot.types import Shot


def from_preroll(shot: Shot, subframes: int) -> tuple[Shot, Roots, int]:
    """A shot, what moves its roots, and the number of its first sample: below 0 where the motion
    does not begin at rest."""
    motion, preroll = root_motion(shot), shot.preroll / shot.frames_per_second
    warn_of_shares(shot, motion)
    tolerance = common_tolerance(shot)
    run_up = run_up_of(motion, preroll, tolerance)
    if run_up is None:
        return shot, motion, 0
    colliders = tuple(each.brought_up(run_up, tolerance) for each in shot.colliders)
    begun = replace(shot, colliders=colliders, run_up=run_up)
    return begun, RunUpRoots(motion, run_up), -shot.preroll * subframes
