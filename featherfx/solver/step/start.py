"""Strains and acceleration of a feather whose steps are yet to begin."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from featherfx.algebra.rotation import quats_to_frames
from featherfx.algebra.rotation_kernels import conjugate, multiply
from featherfx.mechanics.model import Loads, Model
from featherfx.mechanics.node_kernels import blow
from featherfx.solver.state import State
from featherfx.solver.step.integrator_kernels import Factors
from featherfx.solver.step.newton_kernels import evaluate, minimise
from featherfx.solver.step.pose_kernels import load_pose
from featherfx.solver.step.root_kernels import root_at
from featherfx.solver.step.root_path import RootPath
from featherfx.solver.work import Pose, Work

Array = NDArray[np.float64]

# the instant over which the first acceleration is taken, as a part of the step, and the Newton
# iterations that it gets: the second one only corrects for the curved paths of barbs and frames
INSTANT, START_ITERATIONS = 1.0, 8


def start_acceleration(
    model: Model,
    loads: Loads,
    f: int,
    duration: float,
    state: State,
    work: Work,
    path: RootPath,
) -> None:
    """Set the strains of feather f, in place, to those of its pose, and the accelerations to those
    that pose and velocity give.

    One implicit Euler step over the duration (s), a = (x - x0 - h v0) / h^2, which is then taken
    back. Damping and air take part: without them a relaxing material would first be thrown, and a
    feather that hangs in balance with the wind would fall out of it. What vibrates faster than
    that is left at rest: with a tenth of the duration, vibrations that the first step does not
    resolve would double their energy in it (radius 0; with a fifth or more a linear one never
    gains, with the whole no crumpled feather was seen to). With wrong accelerations the time
    integration would lose its second order at once. The root of a feather that is in motion goes
    along its path; of one that is not, it stays, because a path that starts at full speed tells
    nothing of accelerations. path: of the roots, over the duration.
    """
    h = INSTANT * duration
    now, around = work.now, work.around
    factors, before = Factors(1.0 / (h * h), 1.0 / h, 1.0 / h), state.strains.at(f, 0)
    around.target[:] = around.past[:] = state.points[f]
    around.reference.assign(before)
    load_pose(model, f, state, now)
    evaluate(model, loads, f, 0.0, factors, now, around)
    before.assign(now.strains)
    around.reference.assign(before)
    if model.held[f] and state.velocity[f].any() and np.ptp(path.samples[f], axis=0).any():
        _carry_along(path, f, now)
    around.target[:] = state.points[f] + h * state.velocity[f]
    if loads.air[0] > 0.0:
        now.points[:] = state.points[f]
        time, stiffness = state.time[f] + h, model.cell_stiffness[f]
        blow(now.points, time, loads, f, state.velocity[f], stiffness, around)
    minimise(model, loads, f, 0.0, factors, 0.0, START_ITERATIONS, work)
    state.acceleration[f] = (now.points - around.target) / (h * h)
    state.smoothed[f] = state.acceleration[f]


def _carry_along(path: RootPath, f: int, pose: Pose) -> None:
    """Carry the rows of a pose rigidly to where their root's path ends."""
    end, place = np.zeros(4), np.zeros(3)
    root_at(path, f, 1.0, end, place)
    move = multiply(end, conjugate(pose.rotation[0]))
    pose.rotation[:] = [multiply(move, row) for row in pose.rotation]
    away = pose.centre - pose.centre[0]
    pose.centre[:] = place + away @ quats_to_frames(np.array(move)).T
