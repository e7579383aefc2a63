"""Plates that touch, stepped as the feathers of a shot are, and what is measured of them.

Roots bear what the first element of the rachis pulls with, and the weight of row 0:

    F = - sum (c v)_k R_k - m_0 g

c v forces and R frame of the element (mechanics/rachis_kernels.py). No force of contact is in it.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np

from featherfx.algebra.rotation import quats_to_frames
from featherfx.algebra.types import Array
from featherfx.lab.contact.plates import Plate, PlateSetup, make_shot
from featherfx.shot.contact.contact_group import ContactStage
from featherfx.shot.loop.free_group import free_groups
from featherfx.shot.loop.groups import FeatherGroup
from featherfx.shot.loop.run import ShotRun, StepGroup, make_groups
from featherfx.solver.solver import specific_energy


class PlateSample(NamedTuple):
    """Plates at one time.

    tips: (P,) m, heights over rest. velocity: (P, 3) m/s, of their middles of mass. momentum: (3,)
    N s. kinetic, energy: J, the latter with elastic energy and that of weight. reactions: (P, 3) N,
    on their roots, 0 of free ones; of what is at rest.
    """

    tips: Array
    velocity: Array
    momentum: Array
    kinetic: float
    energy: float
    reactions: Array


class TouchingPlates:
    """Plates that may touch each other, at rest without loads to begin with."""

    def __init__(self, plates: Sequence[Plate], setup: PlateSetup) -> None:
        self._plates, self._weight = plates, setup.weight
        self._run = run = ShotRun(make_shot(plates, setup), 1, 1, None, 0)
        stage, self._index = ContactStage(run), 0
        run.groups = make_groups(run)
        for group in run.groups:
            group.solver.model.held[:] = [not plates[f].is_free for f in group.members]
        stage.prepare()
        self._stage = stage
        self._steps: list[StepGroup] = [*stage.contact_groups, *free_groups(run)]
        self._rest = self._tips()

    def settle(self) -> PlateSample:
        """Bring the plates to rest."""
        for each in self._steps:
            each.settle()
        return self.sample()

    def throw(self, plate: int, velocity: Sequence[float]) -> None:
        """Give a plate a velocity (3,) m/s."""
        for group in self._run.groups:
            group.state.velocity.nodes[group.members == plate] += velocity

    def go(self, frames: int) -> Iterator[PlateSample]:
        """Yield the plates where they are, and after each of so many frames."""
        yield self.sample()
        for _ in range(frames):
            self._index += 1
            for each in self._steps:
                each.advance(self._index)
            yield self.sample()

    @property
    def slip_speed(self) -> float:
        """m/s, slip speed below which friction sets in."""
        return self._stage.contact_groups[0].contact.solver.settings.smoothing

    def contact_report(self) -> dict[str, Any]:
        """Return the figures of contact so far; {} of plates that cannot touch."""
        found: dict[str, Any] = self._stage.report().get("contact", {})
        return found

    def sample(self) -> PlateSample:
        """Measure the plates where they are."""
        count = len(self._plates)
        velocity, reactions, momentum = (np.zeros((count, 3)) for _ in range(3))
        kinetic = potential = 0.0
        for group in self._run.groups:
            model, state, some = group.solver.model, group.state, group.members
            mass = model.mass.sum(axis=(1, 2))
            for inertia, rate in zip(
                (model.mass, model.rotary_inertia), state.velocity, strict=True
            ):
                kinetic += 0.5 * float(np.einsum("fnp,fnpk,fnpk->", inertia, rate, rate))
            elastic = [specific_energy(model, state, f) for f in range(len(some))]
            potential += float(mass @ elastic)
            potential -= float(
                np.einsum("fnp,fnpk,k->", model.mass, state.points.nodes, self._weight)
            )
            momentum[some] = np.einsum("fnp,fnpk->fk", model.mass, state.velocity.nodes)
            velocity[some] = momentum[some] / mass[:, None]
            reactions[some] = self._reactions(group)
        return PlateSample(
            tips=self._tips() - self._rest,
            velocity=velocity,
            momentum=momentum.sum(axis=0),
            kinetic=kinetic,
            energy=kinetic + potential,
            reactions=reactions,
        )

    def _tips(self) -> Array:
        found = np.zeros(len(self._plates))
        for group in self._run.groups:
            found[group.members] = group.state.points.nodes[:, -1, 0, 2]
        return found

    def _reactions(self, group: FeatherGroup) -> Array:
        model, state = group.solver.model, group.state
        middle = state.rotation[:, 0] + state.rotation[:, 1]
        frames = quats_to_frames(middle / np.linalg.norm(middle, axis=1, keepdims=True))
        forces = model.rachis_stiffness[:, 0, :3] / model.length[:, :1]
        forces = forces * state.strains.rachis[:, 0, 0, :3]
        pull = np.einsum("fij,fj->fi", frames, forces)
        weight = model.mass[:, 0].sum(axis=1)[:, None] * self._weight
        return np.where(model.held[:, None], -pull - weight, 0.0)
