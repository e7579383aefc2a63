"""A simulation that a viewer watches and changes while it goes on."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from featherfx.algebra.types import Array
from featherfx.algebra.vectors import along_rows, frames_to_quats, quats_to_frames
from featherfx.feather.types import Feather, RowPoints
from featherfx.jit.compiled import KernelModule
from featherfx.mechanics.model import Model
from featherfx.shot.frames import Frame
from featherfx.shot.loads import grip_node
from featherfx.shot.loop.groups import FeatherGroup, grips_of
from featherfx.shot.loop.simulate import Simulation
from featherfx.shot.patterns import Grip
from featherfx.shot.types import Wind
from featherfx.solver.scratch import make_gaps
from featherfx.solver.state import State, rest_state, set_pose

energy_kernels = KernelModule("featherfx.solver.step.energy_kernels")


class Energy(NamedTuple):
    """J. kinetic: against the world. elastic: of shafts and vanes. height: in gravity, against
    the roots."""

    kinetic: float
    elastic: float
    height: float


def energy_of(model: Model, state: State, gravity: Array) -> Energy:
    """Energy of all feathers of a batch together. gravity: (3,) m/s^2."""
    velocity, nodes = state.velocity, state.points.nodes
    moving = (model.mass * (velocity.nodes**2).sum(-1)).sum()
    turning = (model.rotary_inertia * (velocity.directors**2).sum(-1)).sum()
    fallen = (model.mass * ((nodes - nodes[:, :1, :1]) @ gravity)).sum()
    elastic = 0.0
    for f in range(model.feathers):
        strains = state.strains.at(f, 0)
        gaps = state.gaps_of(f)
        elastic += energy_kernels.elastic_energy(model, f, strains, strains, gaps, 0.0, 0.0)
    return Energy(0.5 * float(moving + turning), elastic, -float(fallen))


class JoinedSurfaces:
    """Meshes of feathers as one, whose points are found at once."""

    def __init__(self, feathers: Sequence[Feather]) -> None:
        row, node, rows, nodes = [], [], 0, 0
        for each in feathers:
            count, across = each.rest.nodes.shape[:2]
            row.append(rows + each.surface.row)
            node.append(nodes + each.surface.row * across + each.surface.node)
            rows, nodes = rows + count, nodes + count * across
        self._row, self._node = np.concatenate(row), np.concatenate(node)
        self._offset = np.concatenate([each.surface.offset for each in feathers])

    def points(self, of: Sequence[RowPoints]) -> Array:
        """(V, 3) m, points of the meshes of all feathers, one after the other, from those of each
        (FeatherSurface.points)."""
        nodes = np.concatenate([each.nodes.reshape(-1, 3) for each in of])
        directors = np.concatenate([each.directors for each in of])[self._row]
        offsets = np.einsum("vk,vkc->vc", self._offset, directors)
        return np.asarray(nodes[self._node] + offsets)


class LiveSimulation(Simulation):
    """A simulation whose wind, grips and rest shapes may change between two frames."""

    def live_samples(self) -> Iterator[Callable[[], Frame]]:
        """As samples, in whose frames points mean something, and no rates. Raises what those
        raise."""
        for draw, _ in self.samples(lambda sample: False, rates=0):
            yield draw

    def act(self, wind: Wind, pulls: Sequence[tuple[Grip, Array]] = ()) -> None:
        """From here on this is the wind, and the shot's grips are joined by some that lead their
        points to places (3,) m in the world."""
        self._run.shot = shot = replace(self.shot, wind=wind)
        for group in self._run.groups:
            own = grips_of(group.names, shot.grips, group.own)
            group.grips = own + pulled(group, pulls)

    def reshaped(self, other: LiveSimulation) -> bool:
        """Stand where a simulation of the same feathers in other shapes stands, its deviations from
        rest carried over; False, and nothing is done, where something else is simulated."""
        own, others = self._run.groups, other._run.groups
        if [each.names for each in own] != [each.names for each in others] or any(
            now.state.coefficient.shape != was.state.coefficient.shape
            for now, was in zip(own, others, strict=True)
        ):
            return False
        start = other.checkpoint()
        models = [
            (was.solver.model, now.solver.model) for was, now in zip(others, own, strict=True)
        ]
        states = [reshaped(*pair, state) for pair, state in zip(models, start.states, strict=True)]
        self.take_over(replace(start, states=tuple(states)))
        return True

    def energy(self) -> Energy:
        """J, of all feathers that are solved, after the frame that was simulated last."""
        gravity = np.array(self.shot.gravity, dtype=float)
        of_all = [energy_of(each.solver.model, each.state, gravity) for each in self._run.groups]
        return Energy(*np.sum(of_all, axis=0).tolist())


def pulled(group: FeatherGroup, pulls: Sequence[tuple[Grip, Array]]) -> list[tuple[int, Grip]]:
    """Grips on a group that lead their points to places (3,) m in the world, all the time."""
    found = []
    for grip, to in pulls:
        for place, each in grips_of(group.names, [grip], group.own):
            start = group.start[place][grip_node(each, group.feathers[place])]
            led = replace(each, displacement=to - start, start=-np.inf, end=-np.inf)
            found.append((place, led))
    return found


def reshaped(before: Model, after: Model, state: State) -> State:
    """A state of feathers as it is in their new shapes.

    before, after: models of one grid. Rows keep the turns by which they differ from rest, barbs
    their coefficients, points their velocities. What keeps its shape keeps its state.
    """
    same = [
        np.array_equal(getattr(before, name), getattr(after, name))
        for name in ("length", "rachis_rest", "clamp", "joints", "segment", "cell_rest")
    ]
    if all(same):
        gaps = make_gaps(after, after.feathers)
        return state if bool(gaps) == bool(state.gaps) else state._replace(gaps=gaps)
    roots = state.centre[:, 0], quats_to_frames(state.rotation[:, 0])
    was, new = (rest_state(model, *roots) for model in (before, after))
    turns = quats_to_frames(state.rotation) @ quats_to_frames(was.rotation).swapaxes(-1, -2)
    frames = turns @ quats_to_frames(new.rotation)
    for f in range(after.feathers):
        # (n, 3) points of an unstretched shaft with these row frames (n, 3, 3)
        quats = along_rows(frames_to_quats(frames[f]))
        middle = quats_to_frames(quats[1:] + quats[:-1])  # which makes them unit quaternions
        ways = np.einsum("nij,nj->ni", middle, after.rachis_rest[f, :, :3])
        centres = state.centre[f, 0] + np.concatenate(
            [np.zeros((1, 3)), np.cumsum(after.length[f, :, None] * ways, axis=0)]
        )
        velocity = state.velocity.at(f)
        rest = state.coefficient[f], velocity, float(state.time[f])
        set_pose(after, new, f, frames[f], centres, *rest)
    return new
