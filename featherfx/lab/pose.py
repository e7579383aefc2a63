"""A state's pose in the solver's scratch memory, to measure energies and forces on."""

from __future__ import annotations

from featherfx.mechanics.model import Loads, Model
from featherfx.solver.state import State
from featherfx.solver.step.newton_kernels import evaluate
from featherfx.solver.step.pose_kernels import load_pose
from featherfx.solver.work import Work, make_work

STATIC = (0.0, 0.0, 0.0)


def posed(model: Model, loads: Loads, state: State) -> Work:
    """Scratch that holds points and strains of the first feather of a batch."""
    work = make_work(model)
    load_pose(state.turn[0], state.centre[0], state.coefficient[0], model.length[0], work.now)
    evaluate(model, loads, 0, 0.0, STATIC, work.now, work.around)
    return work
