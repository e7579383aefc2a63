"""Energy of a batch of feathers, for those who watch it."""

from __future__ import annotations

from typing import NamedTuple

from featherfx.algebra.types import Array
from featherfx.mechanics.model import Model
from featherfx.solver.state import State
from featherfx.solver.step.energy_kernels import elastic_energy


class Energy(NamedTuple):
    """J. kinetic: against the world. elastic: of shafts and vanes. height: in gravity, against
    the roots."""

    kinetic: float
    elastic: float
    height: float


def energy_of(model: Model, state: State, gravity: Array) -> Energy:
    """Of all feathers of a batch together. gravity: (3,) m/s^2."""
    velocity, nodes = state.velocity, state.points.nodes
    moving = (model.mass * (velocity.nodes**2).sum(-1)).sum()
    turning = (model.rotary_inertia * (velocity.directors**2).sum(-1)).sum()
    fallen = (model.mass * ((nodes - nodes[:, :1, :1]) @ gravity)).sum()
    elastic = 0.0
    for f in range(model.feathers):
        strains = state.strains.at(f, 0)
        elastic += elastic_energy(model, f, strains, strains, state.gaps_of(f), 0.0)
    return Energy(0.5 * float(moving + turning), elastic, -float(fallen))
