"""Batches of feathers that share a grid, and what acts on them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from featherfx.algebra.types import Array, Flags, Indices
from featherfx.feather.density import PointCarrier
from featherfx.feather.types import Feather, RowMap
from featherfx.mechanics.model import Loads, Model
from featherfx.shot.frames import FeatherPose
from featherfx.shot.options.options import FeatherOptions
from featherfx.shot.types import Force, Grip
from featherfx.solver.solver import Solver, StepReport
from featherfx.solver.state import State

# strain of the rachis to which a grip draws it by default: half of what keratin breaks at
MAX_GRIP_STRAIN = 0.05
# contact group of a feather that pushes nothing
ALONE = -1


class GroupLoad:
    """A load on a batch of feathers; it may change their model over time."""

    def renew(self, group: FeatherGroup, start: float, end: float) -> bool:
        """Take the values of a step from start to end (s); whether the model is another one."""
        return False

    def model(self, model: Model) -> Model:
        """Constant data with the present values, from those without this load."""
        return model

    def added(self, loads: Loads, group: FeatherGroup, start: float, end: float) -> Loads:
        """Loads with those of a step from start to end (s)."""
        return loads


@dataclass
class FeatherGroup:
    """Feathers that share a grid: their places in the groom, solver, state and loads.

    options: how they are simulated. island: contact group, or ALONE. feathers: as simulated. maps:
    to the meshes' grid, where that is another one. own: model without what loads change. start:
    nodes at the first frame. acting: loads beside grips and forces.
    loads: of the step before. stirred: (F,) feathers that something else than a step has changed
    since the sample before. several: places of those with several rest poses; fluttering: of those
    that found none. report: of the last step, None where none was taken.
    """

    options: FeatherOptions
    island: int
    members: Indices
    feathers: list[Feather]
    maps: list[RowMap | None]
    names: list[str]
    grips: list[tuple[int, Grip]]
    forces: list[tuple[int, Force, Array]]
    solver: Solver
    own: Model
    state: State
    start: Array
    stirred: Flags
    acting: list[GroupLoad] = field(default_factory=list)
    loads: Loads | None = None
    several: Indices = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    fluttering: Indices = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    report: StepReport | None = None

    @property
    def level(self) -> str:
        """Level of detail."""
        return self.options.level

    @cached_property
    def carrier(self) -> PointCarrier | None:
        """Map to the meshes' grid, where that is another one."""
        maps = [each for each in self.maps if each is not None]
        return PointCarrier(maps) if maps else None

    @property
    def is_flying(self) -> bool:
        """Return whether the feathers have left their roots."""
        return not self.solver.model.held.any()

    def renew(self, start: float, end: float) -> bool:
        """Give the solver the model of a step from start to end (s); whether it is a new one."""
        new = [load.renew(self, start, end) for load in self.acting]
        if any(new):
            model = self.own
            for load in self.acting:
                model = load.model(model)
            self.solver.model = model
        return any(new)

    def restart_steps(self, step: float) -> None:
        """Have the next step, of `step` s, find accelerations first: the loads have changed."""
        self.state = self.state.copy()
        self.state.step[:], self.state.proposal[:] = 0.0, step


def grips_of(names: Sequence[str], grips: Sequence[Grip], model: Model) -> list[tuple[int, Grip]]:
    """List the grips on a batch of feathers with these ids, each with its place in the batch and
    its largest force."""
    place = {name: k for k, name in enumerate(names)}
    found = [(place[each.feather], each) for each in grips if each.feather in place]
    return [(f, replace(each, max_force=_max_force(model, f, each))) for f, each in found]


def _max_force(model: Model, feather: int, grip: Grip) -> float:
    """Return the largest force of a grip (N), by default what the rachis bears up to its row."""
    if grip.max_force is not None:
        return grip.max_force
    elements = max(1, round(grip.row * (model.rows - 1)))
    tension = model.rachis_stiffness[feather, :elements, 0] / model.length[feather, :elements]
    return MAX_GRIP_STRAIN * float(tension.min())


def poses_of(group: FeatherGroup) -> dict[int, FeatherPose]:
    """Return points and rates of a group's feathers, by their numbers, on the grid of the
    meshes."""
    state, hooked = group.state, group.solver.model.hooked
    numbers = group.members.tolist()
    if (carrier := group.carrier) is not None:
        every = np.arange(len(numbers))
        moving = carrier(every, state.points, state.velocity, state.acceleration)
        return dict(zip(numbers, FeatherPose.each(moving), strict=True))
    found = {}
    for k, f in enumerate(numbers):
        gaps = state.gaps_of(k) if hooked else None
        points, rate, second = state.points.at(k), state.velocity.at(k), state.acceleration.at(k)
        found[f] = FeatherPose(points, rate, second, gaps)
    return found
